# `make demo` shows the main job, `make test` proves it, `make check` is what one runs while working: a few
# minutes, without browser, torch, network and whatever takes seconds. All set up .venv first.
PYTHON ?= python3
BIN := .venv/bin

QUICK := not slow and not network and not torch and not browser

PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: demo test check bench format wheel lock clean

demo: .venv/core
	$(BIN)/gcs demo

test: .venv/test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m pytest
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -m 'decision and not slow and not compiled'

check: .venv/check
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m pytest -m '$(QUICK)'

bench: .venv/test
	$(BIN)/python -m bench accuracy
	$(BIN)/python -m bench speed
	$(BIN)/python -m bench papers

format: .venv/test
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

wheel: .venv/core   # what is shipped, tried in an empty environment and from another folder
	rm -rf build dist
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .
	$(PYTHON) -m venv --clear .venv/shipped
	.venv/shipped/bin/python -m pip install --quiet --constraint constraints.txt dist/*.whl
	cd "$$(mktemp -d)" && $(CURDIR)/.venv/shipped/bin/gcs demo --seconds 8 --no-view --out run && \
	    test "$$(wc -l < run/track.csv)" -gt 1

lock:   # constraints.txt from the newest versions that pyproject.toml allows; run `make test` before it is kept
	$(PYTHON) -m venv --clear .venv/newest
	.venv/newest/bin/python -m pip install --quiet --disable-pip-version-check '.[test,train,bench]'
	sed -i '/^[^#]/d' constraints.txt
	.venv/newest/bin/python -m pip freeze --all --exclude gcs-trajectory --exclude pip >> constraints.txt
	rm -rf .venv/newest

.venv/core: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=python3.11")'
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(PIP) --editable .
	touch $@

.venv/check: .venv/core
	$(PIP) --editable '.[test]'
	touch $@

.venv/test: .venv/core
	$(PIP) --editable '.[test,train,bench]'
	touch $@

clean:
	rm -rf .venv logs/runs

# `make demo` shows the main job, `make test` proves it, `make check` is what one runs while working: a few
# minutes, without browser, torch, network and whatever takes seconds. All set up .venv first.
PYTHON ?= python3
BIN := .venv/bin

NUMBERS := tests/bench tests/filters
QUICK := not slow and not network and not torch and not browser

PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
LOCKED := $(PIP) --require-hashes --only-binary :all: --requirement
SUPPLY := .venv/supply/bin
COMPILE := $(SUPPLY)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --only-binary :all: \
    --no-annotate --custom-compile-command "make lock"

.PHONY: demo test style compiled numbers rest plain check bench format wheel lock sbom audit fuzz clean

demo: .venv/core
	$(BIN)/gcs demo

test: style plain compiled rest numbers   # one after the other, or side by side with `make --jobs 2 test`

style: .venv/test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

compiled: .venv/test   # the filter, once, before two need it
	$(BIN)/python -c 'from gcs.commands.compiled import prepare; prepare()'

numbers: compiled   # the two halves of the whole suite
	$(BIN)/python -m pytest $(NUMBERS)

rest: compiled
	$(BIN)/python -m pytest $(NUMBERS:%=--ignore %) tests

plain: .venv/test   # the logic of decisions without numba
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
	$(BIN)/python -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist .
	$(PYTHON) -m venv --clear .venv/shipped
	.venv/shipped/bin/python -m pip install --quiet --require-hashes --only-binary :all: \
	    --requirement requirements/core.txt
	.venv/shipped/bin/python -m pip install --quiet --no-deps dist/*.whl
	cd "$$(mktemp -d)" && $(CURDIR)/.venv/shipped/bin/gcs demo --seconds 8 --no-view --out run && \
	    test "$$(wc -l < run/track.csv)" -gt 1

lock: $(SUPPLY)/uv   # requirements/ from the newest versions that pyproject.toml allows; `make test` before it is kept
	$(COMPILE) --upgrade --group build --all-extras pyproject.toml --output-file requirements/test.txt
	$(COMPILE) --upgrade --group build --extra test pyproject.toml --constraint requirements/test.txt \
	    --output-file requirements/check.txt
	$(COMPILE) --upgrade --group build pyproject.toml --constraint requirements/test.txt \
	    --output-file requirements/core.txt
	$(COMPILE) --upgrade --group supply --output-file requirements/supply.txt

sbom: $(SUPPLY)/uv   # what `make demo` installs, with versions and hashes, as CycloneDX
	mkdir -p dist
	$(SUPPLY)/cyclonedx-py requirements requirements/core.txt --pyproject pyproject.toml --output-reproducible \
	    --output-file dist/sbom.json

audit: $(SUPPLY)/uv   # known vulnerabilities of all that is locked; fails, and says so, where nobody can be asked
	$(SUPPLY)/python docs/audit.py requirements/test.txt requirements/supply.txt

fuzz: .venv/check   # about an hour; what is found is kept in found/
	$(BIN)/python -m tests.fuzz logs --count 2000 --seed $${SEED:-0}
	$(BIN)/python -m tests.fuzz csv station override frames --count 2000 --seed $${SEED:-0}
	$(BIN)/python -m tests.fuzz datagram payload stamp --count 100000 --seed $${SEED:-0}

.venv/core: pyproject.toml requirements/core.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=python3.11")'
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(LOCKED) requirements/core.txt
	$(PIP) --no-deps --no-build-isolation --editable .
	touch $@

.venv/check: .venv/core requirements/check.txt
	$(LOCKED) requirements/check.txt
	touch $@

.venv/test: .venv/core requirements/test.txt
	$(LOCKED) requirements/test.txt
	touch $@

$(SUPPLY)/uv: requirements/supply.txt   # an environment of its own: these want other versions
	test -x $(SUPPLY)/python || $(PYTHON) -m venv .venv/supply
	.venv/supply/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes \
	    --only-binary :all: --requirement $<
	touch $@

clean:
	rm -rf .venv logs/runs

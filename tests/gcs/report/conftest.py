"""The run folder written by hand, and what was read of it."""

import pytest

from gcs.report.basis import run as runs
from tests.gcs.report import folder


@pytest.fixture
def written(tmp_path):
    return folder.write(tmp_path)


@pytest.fixture
def run(written):
    return runs.load(written)

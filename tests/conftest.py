"""With GCS_REQUIRE_ALL set a skipped test fails the run, unless it lacks the flights beside the clone."""

import os

import numba
import pytest

from gcs.commands.compiled import prepare

MAY_MISS = "shared/data"


def pytest_sessionstart():
    if not numba.config.DISABLE_JIT:  # else there is nothing to compile
        prepare()


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session):
    reporter = session.config.pluginmanager.getplugin("terminalreporter")
    if "GCS_REQUIRE_ALL" not in os.environ or reporter is None:
        return
    reasons = {report.longrepr[2] for report in reporter.stats.get("skipped", [])}
    missing = sorted(reason for reason in reasons if MAY_MISS not in reason)
    if missing:
        reporter.write_line(f"GCS_REQUIRE_ALL is set, yet skipped: {'; '.join(missing)}")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED

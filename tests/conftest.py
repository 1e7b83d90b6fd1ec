"""Settings of every test: no screen, the same examples in each run, one store of shared results (see `tests.shared`).

`make test` runs pytest with -qq, which omits the last line of pytest: one with the CPU time of all processes replaces it.
"""

from __future__ import annotations

import os
import resource
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from tests import shared

pytest.register_assert_rewrite(*(f"tests.sil.{path.stem}" for path in Path(__file__).with_name("sil").glob("checks_*.py")))

os.environ["MPLBACKEND"] = "Agg"

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        shared.folder()


def counted(reporter: Any, outcome: str) -> int:
    """Return the number of tests with an outcome."""
    return len(reporter.stats.get(outcome, []))


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """In CI, `make test` fails if it skips a test."""
    reporter = session.config.pluginmanager.getplugin("terminalreporter")
    if session.config.option.verbose < -1 and shared.IS_CI and counted(reporter, "skipped"):
        session.exitstatus = session.exitstatus or pytest.ExitCode.TESTS_FAILED


def pytest_unconfigure(config: pytest.Config) -> None:
    if hasattr(config, "workerinput"):
        return
    reporter = config.pluginmanager.getplugin("terminalreporter")
    if reporter is not None and config.option.verbose < -1:
        used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]  # the workers have ended
        minutes = sum(each.ru_utime + each.ru_stime for each in used) / 60.0
        failed = [f"{counted(reporter, outcome)} {outcome}, " for outcome in ("failed", "error") if counted(reporter, outcome)]
        counts = f"{counted(reporter, 'passed')} passed, {counted(reporter, 'skipped')} skipped"
        reporter.write_line(f"{''.join(failed)}{counts}, CPU {minutes:.1f} min")

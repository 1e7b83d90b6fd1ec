"""Resume of the evidence: skip tests that passed in an earlier run of the same code."""

import os
from pathlib import Path

import pytest

from tests.evidence.pytest_part import PROGRESS_VARIABLE, end_with_parent

PASSED = Path(os.environ[PROGRESS_VARIABLE]) if PROGRESS_VARIABLE in os.environ else None
"""File with the ids of passed tests."""

if "PYTEST_XDIST_WORKER" in os.environ:
    end_with_parent()  # otherwise a worker continues for up to 15 s


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Append passed tests to the file, in the process that starts the workers."""
    if PASSED and "PYTEST_XDIST_WORKER" not in os.environ and report.when == "call" and report.passed:
        with PASSED.open("a", encoding="utf-8") as stream:
            stream.write(f"{report.nodeid}\n")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if PASSED and PASSED.is_file():
        before = set(PASSED.read_text(encoding="utf-8").splitlines())
        config.hook.pytest_deselected(items=[item for item in items if item.nodeid in before])
        items[:] = [item for item in items if item.nodeid not in before]

"""Resume of the evidence: tests that passed in an earlier run of the same code are not run again."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

VARIABLE = "ARS_EVIDENCE_PASSED"


def _passed() -> Path | None:
    return Path(os.environ[VARIABLE]) if VARIABLE in os.environ else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    path = _passed()
    if path is None or not path.is_file():
        return
    before = set(path.read_text(encoding="utf-8").splitlines())
    done = [item for item in items if item.nodeid in before]
    items[:] = [item for item in items if item.nodeid not in before]
    config.hook.pytest_deselected(items=done)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Runs in the process that starts the workers, for all of them."""
    path = _passed()
    if path is not None and "PYTEST_XDIST_WORKER" not in os.environ and report.when == "call" and report.passed:
        with path.open("a", encoding="utf-8") as stream:
            stream.write(f"{report.nodeid}\n")

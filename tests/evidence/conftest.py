"""Resume of the evidence: tests that passed in an earlier run of the same code are not run again."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

VARIABLE = "ARS_EVIDENCE_PASSED"


class Passed:
    """Writes the tests that pass to a file; in the process that starts the workers, for all of them."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call" and report.passed:
            with self._path.open("a", encoding="utf-8") as stream:
                stream.write(f"{report.nodeid}\n")


def pytest_configure(config: pytest.Config) -> None:
    if VARIABLE in os.environ and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Passed(Path(os.environ[VARIABLE])))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    path = Path(os.environ.get(VARIABLE, ""))
    if VARIABLE in os.environ and path.is_file():
        before = set(path.read_text(encoding="utf-8").splitlines())
        config.hook.pytest_deselected(items=[item for item in items if item.nodeid in before])
        items[:] = [item for item in items if item.nodeid not in before]

"""Tests that need SocketCAN run in a second pytest, which `vcan_run` starts once; the first one gives out its reports.

So each test keeps its own name, result, time and traceback, and -k, node ids, -x and xdist work as for every other test.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import pytest

from codegen.sil.cache import cache_folder
from tests.can.vcan_run import UNAVAILABLE

REPORTS = "VCAN_REPORTS"
"""The child's environment: the file that it adds its reports to."""

PLACE = (sys.executable, "-m", "tests.can.vcan_run")

SECONDS_PER_TEST = 600.0
SECONDS_TO_TRACE = 120
SECONDS_BETWEEN_LOOKS = 0.02


def in_child() -> bool:
    """Whether this process already runs where there is a vcan0: under `vcan_run`."""
    return "VCAN_RUN" in os.environ


def hand_over(report: pytest.TestReport, config: pytest.Config) -> None:
    """The child's side; where there is nobody to hand it to, nothing."""
    if REPORTS not in os.environ:
        return
    data = config.hook.pytest_report_to_serializable(config=config, report=report)
    with Path(os.environ[REPORTS]).open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(data) + "\n")
        stream.flush()
        os.fsync(stream.fileno())  # what a guest writes is seen by its host only then


class ChildSession:
    """The second pytest, with `items`."""

    def __init__(self, config: pytest.Config, items: Sequence[pytest.Item]) -> None:
        self._config = config
        self._folder = tempfile.TemporaryDirectory(prefix="reports-", dir=cache_folder())
        self._reports = Path(self._folder.name, "reports")
        self._output = Path(self._folder.name, "output")
        self._reports.touch()
        self._read = 0
        self._received: dict[str, list[dict[str, Any]]] = {}
        self._finished: set[str] = set()
        self._problem = ""
        self._process = self._start([item.nodeid for item in items])

    def _start(self, node_ids: list[str]) -> subprocess.Popen[bytes]:
        # -vv: a failed comparison is told in full, whatever this pytest is asked for.
        options = ["-vv", "--color=no", "-p", "no:cacheprovider", "-o", f"faulthandler_timeout={SECONDS_TO_TRACE}"]
        tests = [sys.executable, "-m", "pytest", *options, *node_ids]
        place = [*PLACE, "--steady", "--writable", str(cache_folder())]
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
        environment |= {REPORTS: str(self._reports), "ARS_CACHE": str(cache_folder())}
        with self._output.open("wb") as output:
            return subprocess.Popen(
                [*place, "--", *tests],
                cwd=self._config.rootpath,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
            )

    def close(self) -> None:
        """End it, where it still runs."""
        self._process.terminate()
        self._process.wait()
        self._folder.cleanup()

    def reports(self, item: pytest.Item) -> Iterator[pytest.TestReport]:
        """Wait for the test; its reports, under the node id that it has here."""
        name = item.nodeid
        self._wait_for(name)
        for data in self._received.get(name, []):
            report = self._config.hook.pytest_report_from_serializable(config=self._config, data=data)
            if isinstance(report.longrepr, list):  # JSON knows no tuples
                report.longrepr = tuple(report.longrepr)
            yield report
        if name not in self._finished:
            yield self._not_run(item)

    def _wait_for(self, name: str) -> None:
        limit = time.monotonic() + SECONDS_PER_TEST
        while name not in self._finished and not self._problem:
            code = self._process.poll()  # first: what it wrote before it ended is read after
            self._receive()
            if name in self._finished:
                return
            if code is not None:
                self._problem = self._last_words(f"pytest where SocketCAN is ended with exit code {code} before this test did")
            elif time.monotonic() > limit:
                self._process.terminate()
                self._process.wait()
                self._problem = self._last_words(f"no result within {SECONDS_PER_TEST:g} s")
            time.sleep(SECONDS_BETWEEN_LOOKS)

    def _receive(self) -> None:
        with self._reports.open("rb") as stream:
            stream.seek(self._read)
            for line in stream:
                if not line.endswith(b"\n"):  # the rest comes later
                    break
                self._read += len(line)
                data = json.loads(line)
                self._received.setdefault(data["nodeid"], []).append(data)
                if data["when"] == "teardown":
                    self._finished.add(data["nodeid"])

    def _last_words(self, problem: str) -> str:
        return problem + "; its output:\n" + self._output.read_text(encoding="utf-8", errors="replace")[-5000:]

    def _not_run(self, item: pytest.Item) -> pytest.TestReport:
        keywords: dict[str, Literal[1]] = dict.fromkeys(item.keywords, 1)
        if self._process.returncode == UNAVAILABLE and not is_ci():
            (*_, reason) = self._output.read_text(encoding="utf-8", errors="replace").splitlines()
            where = (str(Path(__file__).parent), None, f"Skipped: {reason}")  # one place: the summary tells it in one line
            return pytest.TestReport(item.nodeid, item.location, keywords, "skipped", where, "setup")  # type: ignore[arg-type]
        return pytest.TestReport(item.nodeid, item.location, keywords, "failed", self._problem, "call")


def is_ci() -> bool:
    """Whether this is continuous integration, where all tests must run."""
    return os.environ.get("CI", "").lower() not in ("", "0", "false")

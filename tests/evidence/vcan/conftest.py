"""Runs the tests marked `vcan` in a second pytest under `vcan_run`, and the others here: see README.md."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest

from codegen.cache import cache_folder
from codegen.sil.software import Software, load
from tests import shared
from tests.evidence.vcan.interfaces import INTERFACE, is_up, set_interface
from tests.evidence.vcan.vcan_run import UNAVAILABLE

HERE = Path(__file__).resolve().parent
FOLDER = HERE.parents[2] / "generated/4ws2-paper"
STATE = "VCAN_TESTS"
"""Environment variable: `done` when the marked tests have run, `unavailable` if this machine cannot run them."""


@pytest.fixture
def vcan() -> Iterator[str]:
    """Provide the name of a virtual CAN interface that is up and unused; set it up again after the test."""
    assert is_up(INTERFACE), f"{INTERFACE} is not up: the test needs pytest.mark.vcan"
    yield INTERFACE
    if not is_up(INTERFACE):
        set_interface(INTERFACE, up=True)


@pytest.fixture(scope="session")
def software() -> Software:
    """Return the committed build, compiled."""
    return load(FOLDER)


def is_under_vcan_run() -> bool:
    """Return whether SocketCAN and a private vcan0 exist in this process."""
    return "VCAN_RUN" in os.environ


@pytest.hookimpl(wrapper=True)
def pytest_cmdline_main(config: pytest.Config) -> Generator[None, int | None, int | None]:
    named = [Path(argument.partition("::")[0]).resolve() for argument in config.args]
    if is_under_vcan_run() or hasattr(config, "workerinput") or not all(path.is_relative_to(HERE) for path in named):
        return (yield)
    options = ["-p", "no:cacheprovider", "-n0", "-o", "faulthandler_timeout=120"]
    tests = [sys.executable, "-m", "pytest", *config.invocation_params.args, *options]
    place = [sys.executable, "-m", "tests.evidence.vcan.vcan_run", "--steady", "--writable", str(cache_folder())]
    environment = {name: value for name, value in os.environ.items() if name != shared.VARIABLE}  # a guest cannot write to it
    there = subprocess.run([*place, "--", *tests], env={**environment, "ARS_CACHE": str(cache_folder())}).returncode
    os.environ[STATE] = "unavailable" if there == UNAVAILABLE else "done"
    if there == UNAVAILABLE and os.environ.get("CI", "").lower() in ("", "0", "false"):
        there = int(pytest.ExitCode.NO_TESTS_COLLECTED)  # a failure in CI, where all tests must run
    here = yield
    codes = {there, int(here or 0)} - {int(pytest.ExitCode.NO_TESTS_COLLECTED)}
    return max(codes, default=int(pytest.ExitCode.NO_TESTS_COLLECTED))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    inside, state = is_under_vcan_run(), os.environ.get(STATE)
    if inside or state == "done":
        left_out = [item for item in items if bool(item.get_closest_marker("vcan")) != inside]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]
    else:
        reason = "run pytest tests/evidence/vcan alone"
        if state == "unavailable":
            reason = "SocketCAN is not available: vcan_run reports the reason above"
        for item in items:
            if item.get_closest_marker("vcan"):
                item.add_marker(pytest.mark.skip(reason=reason))

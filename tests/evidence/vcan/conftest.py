"""Runs the tests in a second pytest under `vcan_run`: see README.md."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
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
"""Environment variable: it is set if this machine cannot run the tests."""


@pytest.fixture
def vcan() -> Iterator[str]:
    """Provide the name of a virtual CAN interface that is up and unused; set it up again after the test."""
    assert is_up(INTERFACE), f"{INTERFACE} is not up: the test needs vcan_run"
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


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> int | None:
    """Run the tests there, and return the exit code; where that is not possible, this process skips them."""
    named = [Path(argument.partition("::")[0]).resolve() for argument in config.args]
    if is_under_vcan_run() or hasattr(config, "workerinput") or not all(path.is_relative_to(HERE) for path in named):
        return None
    options = ["-p", "no:cacheprovider", "-n0", "-o", "faulthandler_timeout=120"]
    tests = [sys.executable, "-m", "pytest", *config.invocation_params.args, *options]
    place = [sys.executable, "-m", "tests.evidence.vcan.vcan_run", "--steady", "--writable", str(cache_folder())]
    environment = {name: value for name, value in os.environ.items() if name != shared.VARIABLE}  # a guest cannot write to it
    code = subprocess.run([*place, "--", *tests], env={**environment, "ARS_CACHE": str(cache_folder())}).returncode
    if code == UNAVAILABLE and not shared.IS_CI:
        os.environ[STATE] = "unavailable"
        return None
    return code


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if not is_under_vcan_run():
        reason = "run pytest tests/evidence/vcan alone"
        if STATE in os.environ:
            reason = "SocketCAN is not available: vcan_run reports the reason above"
        for item in items:
            if item.path.is_relative_to(HERE):
                item.add_marker(pytest.mark.skip(reason=reason))

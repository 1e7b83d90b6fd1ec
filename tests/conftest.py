"""What holds for every test: no screen, and the same examples on each run with no limit on their time."""

from __future__ import annotations

import os
from typing import Any

import pytest
from hypothesis import settings

os.environ["MPLBACKEND"] = "Agg"

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """With -n: the tests on CAN go to one worker, because each worker starts a guest of its own for them; the others anywhere.

    Not --dist=loadgroup: that needs node ids that can be changed, which pytest 9.2 no longer has.
    """
    from xdist.scheduler import LoadScopeScheduling

    class OneWorkerForCan(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return "tests/can" if nodeid.startswith("tests/can/") else nodeid

    return OneWorkerForCan(config, log) if config.getoption("dist") == "load" else None

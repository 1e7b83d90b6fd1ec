"""What holds for every test: no screen, and the same examples on each run with no limit on their time."""

from __future__ import annotations

import os
from typing import Any

import pytest
from hypothesis import settings

from tests.can.interfaces import has_socketcan

os.environ["MPLBACKEND"] = "Agg"

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")


CAN = "tests/can"

ALONE = has_socketcan()
"""Whether the tests on CAN have the machine to themselves.

On a kernel's own SocketCAN they run by its clock: a processor that is busy with other tests holds up frames and cycles, which
are then told as the faults that they are. The guest that they have elsewhere has a steady clock (tests/can/uml-clock.c), and
mostly waits: there they run beside the others.
"""


SPREAD = frozenset({"tests/docs/test_commands.py", "tests/refmap/test_ipopt.py"})
"""Files of long tests that share nothing: any worker takes the next. All else stays together by the file: where several workers
had a part of one, each would make its fixtures, solve its maps and compile its builds."""


def _is_on_can(nodeid: str) -> bool:
    return nodeid.startswith(f"{CAN}/")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The tests on CAN come last where they run alone, and first where others fill the time in which they wait."""
    items.sort(key=lambda item: _is_on_can(item.nodeid), reverse=not ALONE)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """With -n: the tests on CAN run in one worker, because each worker starts a guest of its own for them; those of any other
    file too, but for files that are spread.

    Not --dist=loadgroup: that needs node ids that can be changed, which pytest 9.2 no longer has.
    """
    from xdist.scheduler import LoadScopeScheduling
    from xdist.workermanage import WorkerController

    class CanInOneWorker(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.partition("::")[0]
            return CAN if _is_on_can(nodeid) else nodeid if file in SPREAD else file

        def _reschedule(self, node: WorkerController) -> None:
            """Where only CAN is left and is to be alone, the first worker waits until the others have run all and ended."""
            if not ALONE or list(self.workqueue) != [CAN] or len(self.nodes) == 1:
                super()._reschedule(node)
            elif node is not self.nodes[0] and not node.shutting_down:
                node.shutdown()

        def remove_node(self, node: WorkerController) -> str | None:
            crashed = super().remove_node(node)
            for other in self.nodes:
                self._reschedule(other)
            return crashed

    if config.getoption("dist") != "load":
        return None
    config.option.loadscopereorder = False  # in the order of collection
    return CanInOneWorker(config, log)

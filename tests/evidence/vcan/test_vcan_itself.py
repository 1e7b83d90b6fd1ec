"""The bus of these tests, `codegen doctor` on it, and the blocks of README and guide that name vcan0."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import can
import pytest

from codegen.doctor import buses
from codegen.doctor.finding import State
from tests.docs.blocks import PAGES, blocks
from tests.docs.page import run_page
from tests.evidence.vcan.interfaces import is_up, set_interface
from tests.evidence.vcan.uml import ROOT

pytestmark = pytest.mark.vcan

ON_VCAN = {page: found for page in PAGES if (found := [block for block in blocks(page) if block.needs_vcan])}


@pytest.mark.parametrize("attempt", [1, 2])
def test_an_interface_that_is_down_is_reported_and_up_for_the_next_test(vcan: str, attempt: int) -> None:
    assert buses.socketcan().state is State.GOOD
    set_interface(vcan, up=False)
    found = buses.socketcan()
    assert (found.state, found.what) == (State.MISSING, f"{vcan} is down")


@pytest.mark.long
def test_an_own_network_has_its_own_vcan0(vcan: str) -> None:
    """The native backend is tested here, because this kernel always has SocketCAN."""
    script = """
import os, socket
assert os.environ["VCAN_RUN"] == "native"
sender, listener = (socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) for _ in range(2))
for bus in (sender, listener):
    bus.bind(("vcan0",))
sender.send(bytes(16))
assert listener.recv(16) == bytes(16)
"""
    with can.Bus(interface="socketcan", channel=vcan) as outside:
        command = [sys.executable, "-m", "tests.evidence.vcan.vcan_run", "--backend", "native", "--timeout", "60"]
        assert subprocess.run([*command, "--", sys.executable, "-c", script], cwd=ROOT).returncode == 0
        assert outside.recv(timeout=0) is None
    assert is_up(vcan)


@pytest.mark.long
@pytest.mark.parametrize("page", ON_VCAN)
def test_the_blocks_of_a_page_on_vcan(vcan: str, page: str, tmp_path: Path) -> None:
    run_page(ON_VCAN[page], tmp_path)

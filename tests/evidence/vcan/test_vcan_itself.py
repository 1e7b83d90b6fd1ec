"""The bus of these tests is a kernel's; `codegen doctor` and the blocks of README and guide that name vcan0 work on it."""

from __future__ import annotations

import errno
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

pytestmark = pytest.mark.vcan

ROOT = Path(__file__).resolve().parents[3]
ARPHRD_CAN = 280  # linux/if_arp.h
ON_VCAN = {page: found for page in PAGES if (found := [block for block in blocks(page) if block.needs_vcan])}


def open_bus(vcan: str) -> can.BusABC:
    return can.Bus(interface="socketcan", channel=vcan)


def test_the_interface_is_the_kernels_and_reports_each_frame_to_every_other_socket(vcan: str) -> None:
    assert Path("/sys/class/net", vcan, "type").read_text(encoding="ascii").strip() == str(ARPHRD_CAN)
    sent = can.Message(arbitration_id=0x101, is_extended_id=False, data=bytes(range(8)))
    with open_bus(vcan) as sender, open_bus(vcan) as first, open_bus(vcan) as second:
        sender.send(sent)
        for receiver in (first, second):
            message = receiver.recv(timeout=5.0)
            assert message is not None
            assert message.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)
        assert sender.recv(timeout=0) is None


@pytest.mark.parametrize("attempt", [1, 2])
def test_an_interface_that_is_down_takes_no_frame_and_is_up_for_the_next_test(vcan: str, attempt: int) -> None:
    with open_bus(vcan) as bus:
        assert buses.socketcan().state is State.GOOD
        set_interface(vcan, up=False)
        assert not is_up(vcan)
        with pytest.raises(can.CanOperationError) as caught:
            bus.send(can.Message(arbitration_id=0x101))
        assert caught.value.error_code == errno.ENETDOWN
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
    with open_bus(vcan) as outside:
        command = [sys.executable, "-m", "tests.evidence.vcan.vcan_run", "--backend", "native", "--timeout", "60"]
        assert subprocess.run([*command, "--", sys.executable, "-c", script], cwd=ROOT).returncode == 0
        assert outside.recv(timeout=0) is None
    assert is_up(vcan)


@pytest.mark.long
@pytest.mark.parametrize("page", ON_VCAN)
def test_the_blocks_of_a_page_on_vcan(vcan: str, page: str, tmp_path: Path) -> None:
    run_page(ON_VCAN[page], tmp_path)

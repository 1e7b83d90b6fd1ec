"""`codegen doctor` on real SocketCAN."""

from __future__ import annotations

import pytest

from codegen.doctor import buses
from codegen.doctor.finding import State
from tests.can.interfaces import set_interface


@pytest.mark.vcan
def test_a_frame_is_sent_and_received(vcan: str) -> None:
    found = buses.socketcan()
    assert (found.state, found.what) == (State.GOOD, f"a frame went through {vcan}")


@pytest.mark.vcan
def test_an_interface_that_is_down_is_named_with_its_remedy(vcan: str) -> None:
    set_interface(vcan, up=False)
    try:
        found = buses.socketcan()
    finally:
        set_interface(vcan, up=True)
    assert (found.state, found.what) == (State.MISSING, f"{vcan} is down")
    assert f"ip link set up {vcan}" in found.remedy

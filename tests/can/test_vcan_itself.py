"""The place where the tests on CAN run: the bus in it is a kernel's, loses nothing and is nobody else's."""

from __future__ import annotations

import errno
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from codegen.sil.toolchain import compiler_command
from tests.can.interfaces import is_up, set_interface

pytestmark = pytest.mark.vcan

ROOT = Path(__file__).resolve().parents[2]
ARPHRD_CAN = 280  # linux/if_arp.h
REQUEST, ANSWER = 0x101, 0x201
FRAMES, PERIOD = 1000, 0.010


def open_bus(vcan: str, identifier: int | None = None) -> can.BusABC:
    """On SocketCAN; with an identifier, only its frames."""
    filters = None if identifier is None else [can.typechecking.CanFilter(can_id=identifier, can_mask=0x7FF, extended=False)]
    return can.Bus(interface="socketcan", channel=vcan, can_filters=filters)


def frame(identifier: int, number: int) -> can.Message:
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=struct.pack("<II", number, 0))


@pytest.fixture
def replier(vcan: str, tmp_path: Path) -> Iterator[None]:
    """A program in C, on raw sockets, that answers each REQUEST."""
    program = tmp_path / "replier"
    subprocess.run([*compiler_command(), "-O2", "-Wall", "-o", program, Path(__file__).with_name("replier.c")], check=True)
    process = subprocess.Popen([program, vcan], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    yield
    process.terminate()
    process.wait()


def test_the_interface_is_a_can_interface_of_the_kernel(vcan: str) -> None:
    assert Path("/sys/class/net", vcan, "type").read_text(encoding="ascii").strip() == str(ARPHRD_CAN)
    assert Path("/proc/net/can/stats").is_file()


def test_a_thousand_requests_at_10_ms_are_all_answered(vcan: str, replier: None) -> None:
    answered: list[int] = []

    def receive() -> None:
        while len(answered) < FRAMES:
            message = bus.recv(timeout=5.0)
            if message is None:
                return
            answered.append(struct.unpack_from("<I", message.data)[0])

    with open_bus(vcan, ANSWER) as bus:
        receiver = threading.Thread(target=receive)
        receiver.start()
        start = time.perf_counter()
        for number in range(FRAMES):
            time.sleep(max(0.0, start + number * PERIOD - time.perf_counter()))
            bus.send(frame(REQUEST, number))
        receiver.join()
    assert answered == list(range(FRAMES))


def test_the_bus_reports_each_frame_to_every_other_socket(vcan: str) -> None:
    with open_bus(vcan) as sender, open_bus(vcan) as first, open_bus(vcan) as second:
        sender.send(frame(REQUEST, 7))
        for receiver in (first, second):
            message = receiver.recv(timeout=5.0)
            assert message is not None
            assert (message.arbitration_id, bytes(message.data)) == (REQUEST, struct.pack("<II", 7, 0))
        assert sender.recv(timeout=0) is None


def test_an_interface_that_is_down_takes_no_frame_and_says_so(vcan: str) -> None:
    with open_bus(vcan) as bus, open_bus(vcan) as other:
        set_interface(vcan, up=False)
        assert not is_up(vcan)
        with pytest.raises(can.CanOperationError) as sending:
            bus.send(frame(REQUEST, 1))
        with pytest.raises(can.CanOperationError) as receiving:
            other.recv(timeout=5.0)
        assert sending.value.error_code == receiving.value.error_code == errno.ENETDOWN
        set_interface(vcan, up=True)
        bus.send(frame(REQUEST, 2))
        message = other.recv(timeout=5.0)
        assert message is not None
        assert bytes(message.data) == struct.pack("<II", 2, 0)


@pytest.mark.parametrize("attempt", [1, 2])
def test_each_test_finds_the_interface_up(vcan: str, attempt: int) -> None:
    set_interface(vcan, up=False)


def test_multicast_works_beside_it(vcan: str) -> None:
    """The bus for systems without SocketCAN, so that both can be compared in one test."""

    def open_multicast() -> can.BusABC:
        return can.Bus(interface="udp_multicast", channel="239.74.163.2")

    with open_multicast() as sender, open_multicast() as receiver:
        sender.send(frame(REQUEST, 3))
        message = receiver.recv(timeout=5.0)
        assert message is not None
        assert bytes(message.data) == struct.pack("<II", 3, 0)


def test_a_network_of_ones_own_has_its_own_vcan0(vcan: str) -> None:
    """The native way, tried here because here the kernel has SocketCAN for certain."""
    script = """
import os, socket, struct
assert os.environ["VCAN_RUN"] == "native"
sender, listener = (socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) for _ in range(2))
for bus in (sender, listener):
    bus.bind(("vcan0",))
sender.send(bytes(16))
assert listener.recv(16) == bytes(16)
"""
    with open_bus(vcan) as outside:
        command = [sys.executable, "-m", "tests.can.vcan_run", "--backend", "native", "--timeout", "60"]
        assert subprocess.run([*command, "--", sys.executable, "-c", script], cwd=ROOT).returncode == 0
        assert outside.recv(timeout=0) is None
    assert is_up(vcan)

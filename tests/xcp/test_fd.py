"""The slave in frames of CAN FD: longer packets, and its description in the A2L."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import frame_kinds
from tests.xcp.checks import run_random_packets
from tests.xcp.description import Description
from tests.xcp.slave import CALIBRATION, MEASUREMENTS, Slave, compile_slave, dword, packet, word

COMMAND_MAX, MEASUREMENT_MAX = frame_kinds.XCP_FD["max_cto"], frame_kinds.XCP_FD["max_dto"]
PATTERN = bytes((7 * k + 3) % 256 for k in range(64))
"""The measurements of `slave.c`."""


@pytest.fixture(scope="module")
def fd_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the slave of the build."""
    return compile_slave(tmp_path_factory.mktemp("xcp-fd"), frame_kinds.xcp_folder())


@pytest.fixture
def slave(fd_program: Path) -> Iterator[Slave]:
    """Provide a connected slave."""
    with Slave(fd_program) as slave:
        slave.positive("CONNECT", 0)
        yield slave


def test_the_sizes_are_those_of_the_a2l(slave: Slave) -> None:
    _resources, _mode, command, low, high, *_ = slave.positive("CONNECT", 0)
    assert (command, low + 256 * high) == (COMMAND_MAX, MEASUREMENT_MAX)
    a2l = Description.read(frame_kinds.xcp_folder() / "ars.a2l")
    assert a2l.xcp["PROTOCOL_LAYER"].values[8:10] == [COMMAND_MAX, MEASUREMENT_MAX]
    assert a2l.xcp["DAQ"].after("GRANULARITY_ODT_ENTRY_SIZE_DAQ_BYTE") == slave.positive("GET_DAQ_RESOLUTION_INFO")[1]


def test_a_packet_is_used_up_to_its_last_byte(slave: Slave) -> None:
    most = COMMAND_MAX - 1
    assert slave.positive("SHORT_UPLOAD", most, 0, 0, dword(MEASUREMENTS))[1:] == PATTERN[1:most]
    assert slave.answer("SHORT_UPLOAD", most + 1, 0, 0, dword(MEASUREMENTS)) == "OUT_OF_RANGE"
    before = slave.positive("SHORT_UPLOAD", most, 0, 0, dword(CALIBRATION))
    assert slave.write(CALIBRATION, before[: most - 1]) == b""
    assert slave.positive("SHORT_UPLOAD", most, 0, 0, dword(CALIBRATION)) == before
    slave.positive("SET_MTA", 0, 0, 0, dword(CALIBRATION))
    assert slave.answer("DOWNLOAD", most, before[: most - 1]) == "OUT_OF_RANGE"
    assert slave.command(packet("GET_STATUS", bytes(most)))[0] == 0xFF  # type: ignore[index]
    assert slave.answer("GET_STATUS", bytes(most + 1)) == "CMD_SYNTAX"


@pytest.mark.parametrize("sizes", [[MEASUREMENT_MAX - 1], [1] * (MEASUREMENT_MAX - 1)])
def test_a_measurement_packet_is_used_up_to_its_last_byte(slave: Slave, sizes: list[int]) -> None:
    slave.positive("FREE_DAQ")
    slave.positive("ALLOC_DAQ", 0, word(1))
    slave.positive("ALLOC_ODT", 0, word(0), 1)
    assert slave.answer("ALLOC_ODT_ENTRY", 0, word(0), 0, MEASUREMENT_MAX) == "MEMORY_OVERFLOW"
    slave.positive("ALLOC_ODT_ENTRY", 0, word(0), 0, len(sizes))
    slave.positive("SET_DAQ_PTR", 0, word(0), 0, 0)
    assert slave.answer("WRITE_DAQ", 0xFF, MEASUREMENT_MAX, 0, dword(MEASUREMENTS)) == "OUT_OF_RANGE"
    for k, size in enumerate(sizes):
        slave.positive("WRITE_DAQ", 0xFF, size, 0, dword(MEASUREMENTS + 1 + k))
    slave.positive("SET_DAQ_LIST_MODE", 0, word(0), word(0), 1, 0)
    slave.positive("START_STOP_DAQ_LIST", 1, word(0))
    assert slave.event() == [b"\0" + PATTERN[1:MEASUREMENT_MAX]]


def test_random_packets_keep_every_invariant(fd_program: Path) -> None:
    seen, measured = run_random_packets(fd_program, 1_500)
    assert len(seen) > 30 and measured > 20

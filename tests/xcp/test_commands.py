"""Every command of the XCP slave: its positive answer, byte by byte, and each error by name (of ASAM MCD-1 XCP)."""

from __future__ import annotations

import binascii
import math
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from codegen.refmap.extend import extend
from tests import builds
from tests.xcp.slave import CALIBRATION, COMMANDS, MEASUREMENTS, Objects, Slave, dword, packet, word

ECU, MASTER, BOTH = 1, 2, 3
WORKING, REFERENCE = 0, 1
NAN = struct.pack("<f", math.nan)


def number(value: float) -> bytes:
    return struct.pack("<f", value)


def place(slave: Slave, name: str) -> int:
    return CALIBRATION + slave.places[name]


# --- the session ---------------------------------------------------------------------------------------------------


def test_nothing_is_answered_before_connect(program: Path) -> None:
    with Slave(program) as slave:
        for code in range(256):
            if code != COMMANDS["CONNECT"]:
                assert slave.command(bytes((code, *[0] * 7))) is None
        assert slave.command(b"") is None
        assert slave.command(b"\xff") is None  # too short
        assert slave.command(packet("CONNECT", 1)) is None  # a mode that it has not
        # Calibration, pages and measuring; little endian, bytes, more to be asked for; 8 bytes each way; versions 1.
        assert slave.command(packet("CONNECT", 0)) == bytes.fromhex("ff 05 80 08 08 00 01 01")
        assert slave.command(packet("CONNECT", 1)) == bytes.fromhex("fe 22")  # and stays connected
        assert slave.command(packet("GET_STATUS")) == bytes.fromhex("ff 00 00 00 00 00")
        assert slave.command(packet("DISCONNECT")) == b"\xff"
        assert slave.command(packet("GET_STATUS")) is None


def test_frames_may_be_padded_and_not_be_short(slave: Slave) -> None:
    needs = dict.fromkeys(COMMANDS, 1) | {
        **dict.fromkeys(("CONNECT", "GET_ID", "UPLOAD", "START_STOP_SYNCH", "DOWNLOAD"), 2),
        **dict.fromkeys(("GET_CAL_PAGE",), 3),
        **dict.fromkeys(("SET_CAL_PAGE", "GET_PAGE_INFO", "GET_DAQ_LIST_MODE", "START_STOP_DAQ_LIST"), 4),
        **dict.fromkeys(("GET_DAQ_EVENT_INFO", "ALLOC_DAQ"), 4),
        **dict.fromkeys(("GET_SEGMENT_INFO", "COPY_CAL_PAGE", "ALLOC_ODT"), 5),
        **dict.fromkeys(("SET_DAQ_PTR", "ALLOC_ODT_ENTRY"), 6),
        **dict.fromkeys(("SET_MTA", "SHORT_UPLOAD", "BUILD_CHECKSUM", "WRITE_DAQ", "SET_DAQ_LIST_MODE"), 8),
    }
    assert set(needs) == set(COMMANDS)
    for name, length in needs.items():
        data = packet(name, *[0] * 7)
        assert slave.command(data[: length - 1]) == bytes.fromhex("fe 21"), name
        if name != "DISCONNECT":
            told = slave.command(data[:length])
            assert told is not None
            assert told[:2] != bytes.fromhex("fe 21"), name
            assert slave.command(data) is not None
    assert slave.command(packet("GET_STATUS", *[0] * 8)) == bytes.fromhex("fe 21")  # nine bytes are no frame
    assert slave.error("DOWNLOAD", 2, 0) == "ERR_CMD_SYNTAX"  # one byte of two


def test_every_other_command_is_unknown(slave: Slave) -> None:
    for code in sorted(set(range(256)) - set(COMMANDS.values())):
        assert slave.command(bytes((code, *[0] * 7))) == bytes.fromhex("fe 20"), hex(code)


def test_synch_and_communication_mode(slave: Slave) -> None:
    assert slave.error("SYNCH") == "ERR_CMD_SYNCH"
    assert slave.positive("GET_COMM_MODE_INFO") == bytes.fromhex("00 00 00 00 00 00 10")


def test_identification(slave: Slave) -> None:
    for kind, name in enumerate((b"sample", b"ars")):
        assert slave.positive("GET_ID", kind) == bytes.fromhex("00 00 00") + dword(len(name))
        assert slave.positive("UPLOAD", len(name)) == name
        assert slave.error("UPLOAD", 1) == "ERR_ACCESS_DENIED"
        assert slave.error("DOWNLOAD", 1, 0) == "ERR_ACCESS_DENIED"
    slave.positive("GET_ID", 0)
    assert slave.error("DOWNLOAD", 1, 0) == "ERR_WRITE_PROTECTED"
    assert slave.positive("GET_ID", 2) == bytes(7)  # no length: there is none


# --- reading and writing -------------------------------------------------------------------------------------------


def test_transfer_address(slave: Slave) -> None:
    for name, rest in (("UPLOAD", (1,)), ("DOWNLOAD", (1, 0)), ("BUILD_CHECKSUM", (0, 0, 0, dword(1)))):
        assert slave.error(name, *rest) == "ERR_SEQUENCE"
    assert slave.error("SET_MTA", 0, 0, 1, dword(CALIBRATION)) == "ERR_OUT_OF_RANGE"
    pattern = bytes((7 * k + 3) % 256 for k in range(21))
    assert slave.read(MEASUREMENTS, 21) == pattern
    assert slave.positive("SHORT_UPLOAD", 5, 0, 0, dword(MEASUREMENTS + 2)) == pattern[2:7]
    assert slave.positive("UPLOAD", 3) == pattern[7:10]
    assert slave.error("SHORT_UPLOAD", 5, 0, 1, dword(MEASUREMENTS)) == "ERR_OUT_OF_RANGE"
    for size in (0, 8, 255):
        assert slave.error("UPLOAD", size) == "ERR_OUT_OF_RANGE"


@pytest.mark.parametrize("base", [CALIBRATION, MEASUREMENTS])
def test_bounds(slave: Slave, base: int) -> None:
    size = slave.places["size" if base == CALIBRATION else "measurements"]
    for at, count in ((0, 7), (size - 7, 7), (size - 1, 1)):
        slave.positive("SHORT_UPLOAD", count, 0, 0, dword(base + at))
    for at, count in ((-1, 1), (-1, 7), (size - 6, 7), (size, 1), (-base, 1), (2**32 - 1 - base, 7)):
        assert slave.error("SHORT_UPLOAD", count, 0, 0, dword(base + at)) == "ERR_ACCESS_DENIED"
        if count < 7:
            assert slave.error("DOWNLOAD", count, bytes(6)) == "ERR_ACCESS_DENIED"


def test_checksum(slave: Slave) -> None:
    whole = slave.read(CALIBRATION, slave.places["size"])
    slave.positive("SET_MTA", 0, 0, 0, dword(CALIBRATION))
    first = slave.positive("BUILD_CHECKSUM", 0, 0, 0, dword(100))
    assert first == bytes.fromhex("09 00 00") + dword(binascii.crc32(whole[:100]))
    rest = slave.positive("BUILD_CHECKSUM", 0, 0, 0, dword(len(whole) - 100))  # the address has moved on
    assert rest[3:] == dword(binascii.crc32(whole[100:]))
    assert slave.error("BUILD_CHECKSUM", 0, 0, 0, dword(1)) == "ERR_ACCESS_DENIED"
    assert slave.error("BUILD_CHECKSUM", 0, 0, 0, dword(0)) == "ERR_OUT_OF_RANGE"


def test_download(slave: Slave) -> None:
    at = place(slave, "enable_speed")
    before = slave.read(at, 4)
    assert slave.write(at, number(12.0)) is None
    assert slave.read(at, 4) == number(12.0)
    for refused in (NAN, number(math.inf), number(-1.0), number(0.0)):  # zero: not above the speed that disables
        assert slave.write(at, refused) == "ERR_OUT_OF_RANGE"
        assert slave.read(at, 4) == number(12.0)
    assert slave.write(at, before) is None
    for size in (0, 7, 255):
        assert slave.error("DOWNLOAD", size, bytes(6)) == "ERR_OUT_OF_RANGE"
    assert slave.write(MEASUREMENTS, b"\0") == "ERR_WRITE_PROTECTED"


def test_an_axis_out_of_order_is_refused(slave: Slave) -> None:
    at = place(slave, "speeds") + 4
    (first, second, third) = struct.unpack("<3f", slave.read(at, 12))
    for refused in (third, first, 1.5 * third, -second, math.nan):
        assert slave.write(at + 4, number(refused)) == "ERR_OUT_OF_RANGE"
    assert slave.read(at, 12) == struct.pack("<3f", first, second, third)


# --- pages ---------------------------------------------------------------------------------------------------------


def test_pages_are_told(slave: Slave) -> None:
    assert slave.positive("GET_PAG_PROCESSOR_INFO") == bytes((1, 0))
    assert slave.positive("GET_SEGMENT_INFO", 0, 0, 0, 0) == bytes(3) + dword(CALIBRATION)
    assert slave.positive("GET_SEGMENT_INFO", 0, 0, 1, 0) == bytes(3) + dword(slave.places["size"])
    assert slave.positive("GET_SEGMENT_INFO", 1, 0, 0, 0) == bytes((2, 0, 0, 0, 0))
    for mode, info in ((0, 2), (2, 0), (3, 0)):
        assert slave.error("GET_SEGMENT_INFO", mode, 0, info, 0) == "ERR_OUT_OF_RANGE"
    assert slave.error("GET_SEGMENT_INFO", 1, 1, 0, 0) == "ERR_SEGMENT_NOT_VALID"
    assert slave.positive("GET_PAGE_INFO", 0, 0, WORKING) == bytes((0x3F, 0))
    assert slave.positive("GET_PAGE_INFO", 0, 0, REFERENCE) == bytes((0x0F, 0))
    assert slave.error("GET_PAGE_INFO", 0, 0, 2) == "ERR_PAGE_NOT_VALID"
    assert slave.error("GET_PAGE_INFO", 0, 1, 0) == "ERR_SEGMENT_NOT_VALID"


def test_switching(slave: Slave) -> None:
    at = place(slave, "enable_speed")
    built = slave.read(at, 4)
    assert slave.write(at, number(12.0)) is None
    slave.positive("SET_CAL_PAGE", MASTER, 0, REFERENCE)
    assert [slave.positive("GET_CAL_PAGE", who, 0) for who in (ECU, MASTER)] == [bytes(3), bytes((0, 0, 1))]
    assert slave.read(at, 4) == built
    assert slave.write(at, number(12.0)) == "ERR_WRITE_PROTECTED"
    slave.positive("SET_CAL_PAGE", ECU, 0, REFERENCE)
    slave.positive("SET_CAL_PAGE", MASTER, 0, WORKING)
    assert slave.read(at, 4) == number(12.0)
    slave.positive("SET_CAL_PAGE", 0x80 | BOTH, 255, REFERENCE)  # all segments
    slave.positive("SET_CAL_PAGE", BOTH, 0, WORKING)
    assert slave.read(at, 4) == number(12.0)
    for mode in (0, 0x80, 4, 0x47):
        assert slave.error("SET_CAL_PAGE", mode, 0, 0) == "ERR_MODE_NOT_VALID"
    assert slave.error("SET_CAL_PAGE", BOTH, 1, 0) == "ERR_SEGMENT_NOT_VALID"
    assert slave.error("SET_CAL_PAGE", BOTH, 0, 2) == "ERR_PAGE_NOT_VALID"
    for mode in (0, 3, 0x80):
        assert slave.error("GET_CAL_PAGE", mode, 0) == "ERR_MODE_NOT_VALID"
    assert slave.error("GET_CAL_PAGE", ECU, 1) == "ERR_SEGMENT_NOT_VALID"


def test_a_whole_axis_is_changed_beside_the_page_in_use(slave: Slave) -> None:
    """Each point on its own is refused while the controller runs on the page; together they are a valid axis."""
    at, points = place(slave, "speeds"), extend(builds.paper_map(), builds.CONFIG).speed.size
    axis = struct.unpack(f"<{points}f", slave.read(at, 4 * points))
    moved = [1.05 * speed for speed in axis]
    assert slave.write(at + 4 * (points // 2), number(moved[points // 2])) == "ERR_OUT_OF_RANGE"
    slave.positive("SET_CAL_PAGE", ECU, 0, REFERENCE)
    for k, speed in enumerate(moved):
        if k == points // 2:
            assert slave.error("SET_CAL_PAGE", ECU, 0, WORKING) == "ERR_PAGE_NOT_VALID"
        assert slave.write(at + 4 * k, number(speed)) is None
    slave.positive("SET_CAL_PAGE", ECU, 0, WORKING)
    assert slave.read(at, 4 * points) == struct.pack(f"<{points}f", *moved)


def test_a_page_that_is_not_valid_is_not_taken(slave: Slave) -> None:
    at = place(slave, "enable_speed")
    slave.positive("SET_CAL_PAGE", ECU, 0, REFERENCE)
    assert slave.write(at, NAN) is None
    assert slave.error("SET_CAL_PAGE", BOTH, 0, WORKING) == "ERR_PAGE_NOT_VALID"
    assert slave.positive("GET_CAL_PAGE", ECU, 0)[2] == REFERENCE
    assert slave.read(at, 4) == NAN
    slave.positive("COPY_CAL_PAGE", 0, REFERENCE, 0, WORKING)
    slave.positive("SET_CAL_PAGE", BOTH, 0, WORKING)


def test_copying(slave: Slave) -> None:
    at = place(slave, "enable_speed")
    built = slave.read(at, 4)
    assert slave.write(at, number(12.0)) is None
    slave.positive("COPY_CAL_PAGE", 0, WORKING, 0, WORKING)
    assert slave.read(at, 4) == number(12.0)
    slave.positive("COPY_CAL_PAGE", 0, REFERENCE, 0, WORKING)
    assert slave.read(at, 4) == built
    assert slave.error("COPY_CAL_PAGE", 0, WORKING, 0, REFERENCE) == "ERR_WRITE_PROTECTED"
    for arguments in ((0, 2, 0, 0), (0, 0, 0, 2)):
        assert slave.error("COPY_CAL_PAGE", *arguments) == "ERR_PAGE_NOT_VALID"
    for arguments in ((1, 0, 0, 0), (0, 0, 1, 0)):
        assert slave.error("COPY_CAL_PAGE", *arguments) == "ERR_SEGMENT_NOT_VALID"


def test_the_calibration_outlives_the_session(slave: Slave) -> None:
    at = place(slave, "enable_speed")
    assert slave.write(at, number(12.0)) is None
    slave.positive("DISCONNECT")
    slave.positive("CONNECT", 0)
    assert slave.read(at, 4) == number(12.0)


# --- lists of measurements -----------------------------------------------------------------------------------------


def allocate(slave: Slave, *lists: tuple[int, ...]) -> None:
    """Lists, each of packets with so many entries."""
    slave.positive("FREE_DAQ")
    slave.positive("ALLOC_DAQ", 0, word(len(lists)))
    for number_, odts in enumerate(lists):
        slave.positive("ALLOC_ODT", 0, word(number_), len(odts))
    for number_, odts in enumerate(lists):
        for odt, entries in enumerate(odts):
            slave.positive("ALLOC_ODT_ENTRY", 0, word(number_), odt, entries)


def fill(slave: Slave, daq: int, odt: int, *entries: tuple[int, int], mode: int = 0, prescaler: int = 1) -> None:
    """Address and size of each entry of a packet, and the list's mode."""
    slave.positive("SET_DAQ_PTR", 0, word(daq), odt, 0)
    for address, size in entries:
        slave.positive("WRITE_DAQ", 0xFF, size, 0, dword(address))
    slave.positive("SET_DAQ_LIST_MODE", mode, word(daq), word(0), prescaler, 0)


def test_what_can_be_measured_is_told(slave: Slave) -> None:
    assert slave.positive("GET_DAQ_PROCESSOR_INFO") == bytes.fromhex("13 00 00 01 00 00 00")
    allocate(slave, (1,), (1,))
    assert slave.positive("GET_DAQ_PROCESSOR_INFO") == bytes.fromhex("13 02 00 01 00 00 00")
    assert slave.positive("GET_DAQ_RESOLUTION_INFO") == bytes.fromhex("01 07 01 00 62 01 00")  # ms, two bytes
    assert slave.positive("GET_DAQ_EVENT_INFO", 0, word(0)) == bytes((0x84, 8, len("task_10ms"), 10, 6, 0))
    assert slave.positive("UPLOAD", 7) + slave.positive("UPLOAD", 2) == b"task_10ms"
    assert slave.error("GET_DAQ_EVENT_INFO", 0, word(1)) == "ERR_OUT_OF_RANGE"


def test_a_list_is_sampled_with_each_run(slave: Slave) -> None:
    built = slave.read(place(slave, "enable_speed"), 4)
    allocate(slave, (2, 1), (1,))
    fill(slave, 0, 0, (MEASUREMENTS, 1), (MEASUREMENTS + 10, 4), mode=0x10)
    fill(slave, 0, 1, (MEASUREMENTS + 20, 7), mode=0x10)
    fill(slave, 1, 0, (place(slave, "enable_speed"), 4), prescaler=3)
    assert slave.event() == []
    for daq, first in ((0, 0), (1, 2)):
        assert slave.positive("START_STOP_DAQ_LIST", 2, word(daq)) == bytes((first,))
    assert slave.positive("GET_DAQ_LIST_MODE", 0, word(0)) == bytes.fromhex("11 00 00 00 00 01 00")
    slave.positive("START_STOP_SYNCH", 1)
    assert slave.positive("GET_DAQ_LIST_MODE", 0, word(1)) == bytes.fromhex("40 00 00 00 00 03 00")
    assert slave.positive("GET_STATUS")[0] == 0x40
    pattern = bytes((7 * k + 3) % 256 for k in range(30))
    for run in range(7):
        told = slave.event()
        assert told[0] == bytes((0,)) + word(10 * (run + 2)) + bytes((pattern[0] + run + 2,)) + pattern[10:14]
        assert told[1] == bytes((1,)) + pattern[20:27]
        assert told[2:] == ([bytes((2,)) + built] if run % 3 == 0 else [])
        assert slave.positive("GET_DAQ_CLOCK") == bytes(3) + dword(10 * (run + 2))
    slave.positive("START_STOP_DAQ_LIST", 0, word(0))
    assert [len(slave.event()) for _ in range(3)] == [0, 0, 1]
    slave.positive("START_STOP_SYNCH", 0)
    assert slave.event() == []
    assert slave.positive("GET_STATUS")[0] == 0


def test_selected_lists_stop_together(slave: Slave) -> None:
    allocate(slave, (1,), (1,))
    for daq in range(2):
        fill(slave, daq, 0, (MEASUREMENTS, 1))
        slave.positive("START_STOP_DAQ_LIST", 1, word(daq))
    slave.positive("START_STOP_DAQ_LIST", 2, word(1))
    slave.positive("START_STOP_SYNCH", 2)
    assert [told[0] for told in slave.event()] == [0]
    slave.positive("CONNECT", 0)  # a new session measures nothing
    assert slave.event() == []


def test_what_the_controller_runs_on_is_measured(slave: Slave) -> None:
    at = place(slave, "enable_speed")
    built = slave.read(at, 4)
    assert slave.write(at, number(12.0)) is None
    slave.positive("SET_CAL_PAGE", MASTER, 0, REFERENCE)
    allocate(slave, (1,))
    fill(slave, 0, 0, (at, 4))
    slave.positive("START_STOP_DAQ_LIST", 1, word(0))
    assert slave.event() == [b"\0" + number(12.0)]
    slave.positive("SET_CAL_PAGE", ECU, 0, REFERENCE)
    assert slave.event() == [b"\0" + built]


def test_the_order_of_allocation(slave: Slave) -> None:
    daq, odt, entry = ("ALLOC_DAQ", 0, word(2)), ("ALLOC_ODT", 0, word(0), 1), ("ALLOC_ODT_ENTRY", 0, word(0), 0, 1)
    for command in (daq, odt, entry):
        assert slave.error(*command) == "ERR_SEQUENCE"
    slave.positive("FREE_DAQ")
    for command in (odt, entry):
        assert slave.error(*command) == "ERR_SEQUENCE"
    slave.positive(*daq)
    assert slave.error(*entry) == "ERR_SEQUENCE"
    slave.positive(*odt)
    assert slave.error(*odt) == "ERR_SEQUENCE"  # it has its packets
    assert slave.error(*daq) == "ERR_SEQUENCE"
    slave.positive(*entry)
    for command in (entry, odt, daq):
        assert slave.error(*command) == "ERR_SEQUENCE"
    assert slave.error("WRITE_DAQ", 0xFF, 1, 0, dword(MEASUREMENTS)) == "ERR_SEQUENCE"  # no pointer
    slave.positive("SET_DAQ_PTR", 0, word(0), 0, 0)
    slave.positive("WRITE_DAQ", 0xFF, 1, 0, dword(MEASUREMENTS))
    assert slave.error("WRITE_DAQ", 0xFF, 1, 0, dword(MEASUREMENTS)) == "ERR_SEQUENCE"  # behind the last entry


def test_the_memory_of_lists_is_bounded(slave: Slave) -> None:
    slave.positive("FREE_DAQ")
    assert slave.error("ALLOC_DAQ", 0, word(9)) == "ERR_MEMORY_OVERFLOW"
    assert slave.error("ALLOC_DAQ", 0, word(0)) == "ERR_OUT_OF_RANGE"
    slave.positive("ALLOC_DAQ", 0, word(8))
    assert slave.error("ALLOC_ODT", 0, word(0), 33) == "ERR_MEMORY_OVERFLOW"
    slave.positive("ALLOC_ODT", 0, word(0), 30)
    assert slave.error("ALLOC_ODT", 0, word(1), 3) == "ERR_MEMORY_OVERFLOW"
    slave.positive("ALLOC_ODT", 0, word(1), 2)
    assert slave.error("ALLOC_ODT", 0, word(8), 1) == "ERR_OUT_OF_RANGE"
    assert slave.error("ALLOC_ODT", 0, word(2), 0) == "ERR_OUT_OF_RANGE"
    assert slave.error("ALLOC_ODT_ENTRY", 0, word(0), 0, 8) == "ERR_MEMORY_OVERFLOW"
    for arguments in ((word(0), 30, 1), (word(8), 0, 1)):
        assert slave.error("ALLOC_ODT_ENTRY", 0, *arguments) == "ERR_OUT_OF_RANGE"
    slave.positive("ALLOC_ODT_ENTRY", 0, word(0), 0, 7)


def test_entries_that_cannot_be(slave: Slave) -> None:
    allocate(slave, (2,))
    for arguments in ((word(1), 0, 0), (word(0), 1, 0), (word(0), 0, 2)):
        assert slave.error("SET_DAQ_PTR", 0, *arguments) == "ERR_OUT_OF_RANGE"
    slave.positive("SET_DAQ_PTR", 0, word(0), 0, 0)
    outside = dword(MEASUREMENTS + slave.places["measurements"])
    for arguments in ((0, 1, 0, dword(MEASUREMENTS)), (0xFF, 0, 0, dword(MEASUREMENTS)), (0xFF, 8, 0, dword(MEASUREMENTS))):
        assert slave.error("WRITE_DAQ", *arguments) == "ERR_OUT_OF_RANGE"
    assert slave.error("WRITE_DAQ", 0xFF, 1, 1, dword(MEASUREMENTS)) == "ERR_OUT_OF_RANGE"
    assert slave.error("WRITE_DAQ", 0xFF, 1, 0, outside) == "ERR_ACCESS_DENIED"
    slave.positive("WRITE_DAQ", 0xFF, 4, 0, dword(MEASUREMENTS))
    assert slave.error("WRITE_DAQ", 0xFF, 4, 0, dword(MEASUREMENTS)) == "ERR_OUT_OF_RANGE"  # eight bytes in all
    assert slave.error("START_STOP_DAQ_LIST", 1, word(0)) == "ERR_DAQ_CONFIG"  # an entry is not written, and no event set
    slave.positive("WRITE_DAQ", 0xFF, 3, 0, dword(MEASUREMENTS))
    assert slave.error("START_STOP_DAQ_LIST", 1, word(0)) == "ERR_DAQ_CONFIG"
    slave.positive("SET_DAQ_LIST_MODE", 0x10, word(0), word(0), 1, 0)
    assert slave.error("START_STOP_DAQ_LIST", 2, word(0)) == "ERR_DAQ_CONFIG"  # no room for the timestamp
    slave.positive("SET_DAQ_LIST_MODE", 0, word(0), word(0), 1, 0)
    slave.positive("START_STOP_DAQ_LIST", 2, word(0))
    slave.positive("SET_DAQ_LIST_MODE", 0x10, word(0), word(0), 1, 0)
    assert slave.error("START_STOP_SYNCH", 1) == "ERR_DAQ_CONFIG"


def test_a_packet_may_hold_the_timestamp_alone(slave: Slave) -> None:
    allocate(slave, (0, 1), (0,))
    fill(slave, 0, 1, (MEASUREMENTS + 1, 7), mode=0x10)
    slave.positive("START_STOP_DAQ_LIST", 1, word(0))
    assert [len(told) for told in slave.event()] == [3, 8]
    slave.positive("SET_DAQ_LIST_MODE", 0x10, word(1), word(0), 1, 0)
    assert slave.error("START_STOP_DAQ_LIST", 1, word(1)) == "ERR_DAQ_CONFIG"  # nothing to measure


def test_modes_that_cannot_be(slave: Slave) -> None:
    allocate(slave, (1,))
    fill(slave, 0, 0, (MEASUREMENTS, 1))
    for mode in (0x01, 0x02, 0x20, 0xFF):
        assert slave.error("SET_DAQ_LIST_MODE", mode, word(0), word(0), 1, 0) == "ERR_MODE_NOT_VALID"
    for arguments in ((word(1), word(0), 1, 0), (word(0), word(1), 1, 0), (word(0), word(0), 0, 0), (word(0), word(0), 1, 1)):
        assert slave.error("SET_DAQ_LIST_MODE", 0, *arguments) == "ERR_OUT_OF_RANGE"
    assert slave.error("GET_DAQ_LIST_MODE", 0, word(1)) == "ERR_OUT_OF_RANGE"
    assert slave.error("START_STOP_DAQ_LIST", 3, word(0)) == "ERR_MODE_NOT_VALID"
    assert slave.error("START_STOP_DAQ_LIST", 1, word(1)) == "ERR_OUT_OF_RANGE"
    assert slave.error("START_STOP_SYNCH", 3) == "ERR_MODE_NOT_VALID"


def test_a_list_that_runs_is_not_changed(slave: Slave) -> None:
    allocate(slave, (2,), (1,))
    fill(slave, 0, 0, (MEASUREMENTS, 1), (MEASUREMENTS, 1))
    slave.positive("SET_DAQ_PTR", 0, word(0), 0, 0)
    slave.positive("START_STOP_DAQ_LIST", 1, word(0))
    assert slave.error("WRITE_DAQ", 0xFF, 1, 0, dword(MEASUREMENTS)) == "ERR_DAQ_ACTIVE"
    assert slave.error("SET_DAQ_PTR", 0, word(0), 0, 0) == "ERR_DAQ_ACTIVE"
    assert slave.error("SET_DAQ_LIST_MODE", 0, word(0), word(0), 1, 0) == "ERR_DAQ_ACTIVE"
    assert slave.error("ALLOC_ODT_ENTRY", 0, word(1), 0, 1) == "ERR_DAQ_ACTIVE"
    fill(slave, 1, 0, (MEASUREMENTS, 1))  # another one is
    slave.positive("FREE_DAQ")
    assert slave.event() == []


# --- faults in what only a master can see --------------------------------------------------------------------------


FAULTS = [
    (test_switching, "&& (self->master_page == (uint8_t)ARS_XCP_PAGE_WORKING)) {", ") {"),
    (test_copying, "if (in->data[4] != (uint8_t)ARS_XCP_PAGE_WORKING) {", "if (false) {"),
    (test_a_list_is_sampled_with_each_run, "daq->waiting = daq->prescaler;", "daq->waiting = 1u;"),
    (test_checksum, "0xEDB88320u", "0xEDB88321u"),
    (test_transfer_address, "(uint8_t)(size + 1u);\n    self->address += size;", "(uint8_t)(size + 1u);"),
    (test_frames_may_be_padded_and_not_be_short, "(in->length >= commands[k].length)", "true"),
    (test_every_other_command_is_unknown, "uint8_t result = (uint8_t)ERR_CMD_UNKNOWN;", "uint8_t result = (uint8_t)DONE;"),
    (
        test_what_the_controller_runs_on_is_measured,
        "result = &self->setup.calibration[address - self->setup.calibration_address];",
        "",
    ),
]


@pytest.mark.parametrize(("check", "old", "new"), FAULTS, ids=lambda value: getattr(value, "__name__", ""))
def test_a_fault_is_seen(objects: Objects, check: Callable[[Slave], None], old: str, new: str) -> None:
    faulty = objects.program(f"wrong_{check.__name__}", (old, new))
    with Slave(faulty) as slave:
        slave.positive("CONNECT", 0)
        with pytest.raises(AssertionError):
            check(slave)

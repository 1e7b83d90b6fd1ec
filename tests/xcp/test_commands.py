"""Every command of the XCP slave: its positive response, byte by byte, and each error by name (of ASAM MCD-1 XCP)."""

import binascii
import math
import struct
from pathlib import Path

import pytest

from codegen.ecu_map.extend import extend
from codegen.map_file.map import load
from tests import builds
from tests.xcp.slave import BUILD, CALIBRATION, COMMANDS, MEASUREMENTS, Slave, dword, packet, word

ECU, MASTER, BOTH = 1, 2, 3
WORKING, REFERENCE = 0, 1
OK, PADDING = b"", bytes(3)
CONNECTED = bytes.fromhex("05 80 08 08 00 01 01")
"""Resources: calibration, pages and measuring. Little endian, bytes, more information. 8 bytes each way. Versions 1."""
PATTERN = bytes((7 * k + 3) % 256 for k in range(30))
"""The measurements of `slave.c`."""

Argument = int | bytes


def check(slave: Slave, *steps: tuple[Argument | str, ...]) -> None:
    """Send commands. A step is the expected response (data, or the name of an error), then the command and its arguments."""
    for wanted, name, *arguments in steps:
        assert slave.answer(name, *arguments) == wanted, (name, *arguments)


def refused(slave: Slave, error: str, name: str, *choices: tuple[Argument, ...]) -> None:
    """Send a command with each choice of arguments, all of which must give the error."""
    check(slave, *((error, name, *arguments) for arguments in choices))


def number(value: float) -> bytes:
    return struct.pack("<f", value)


def place(slave: Slave, name: str) -> int:
    return CALIBRATION + slave.places[name]


def test_the_session(program: Path) -> None:
    with Slave(program) as slave:
        for code in range(256):
            assert code == COMMANDS["CONNECT"] or slave.command(bytes((code, *[0] * 7))) is None
        for ignored in (b"", b"\xff", packet("CONNECT", 1)):  # too short; an unknown mode
            assert slave.command(ignored) is None
        check(slave, (CONNECTED, "CONNECT", 0), ("OUT_OF_RANGE", "CONNECT", 1), ("CMD_SYNTAX", "CONNECT"))
        # A short frame, nine bytes, and one byte of two.
        for name, rest in (("SET_MTA", 6), ("GET_STATUS", 8), ("DOWNLOAD", 1)):
            check(slave, ("CMD_SYNTAX", name, *[2] * rest))
        check(slave, (bytes(5), "GET_STATUS"), (OK, "DISCONNECT"))  # the rejected CONNECT did not end the session
        assert slave.command(packet("GET_STATUS")) is None


def test_identification(slave: Slave) -> None:
    check(slave, ("CMD_SYNCH", "SYNCH"), (bytes.fromhex("00 00 00 00 00 00 10"), "GET_COMM_MODE_INFO"))
    for kind, name in enumerate((b"4ws2-paper", b"ars")):
        check(slave, (PADDING + dword(len(name)), "GET_ID", kind), ("WRITE_PROTECTED", "DOWNLOAD", 1, 0))
        check(slave, *((name[k : k + 7], "UPLOAD", len(name[k : k + 7])) for k in range(0, len(name), 7)))
        check(slave, ("ACCESS_DENIED", "UPLOAD", 1), ("ACCESS_DENIED", "DOWNLOAD", 1, 0))
    check(slave, (bytes(7), "GET_ID", 2))  # no length: this identification does not exist


def test_reading(slave: Slave) -> None:
    for name, rest in (("UPLOAD", (1,)), ("DOWNLOAD", (1, 0)), ("BUILD_CHECKSUM", (0, 0, 0, dword(1)))):
        check(slave, ("SEQUENCE", name, *rest))
    assert slave.read(MEASUREMENTS, 21) == PATTERN[:21]
    check(
        slave,
        ("OUT_OF_RANGE", "SET_MTA", 0, 0, 1, dword(CALIBRATION)),
        (PATTERN[2:7], "SHORT_UPLOAD", 5, 0, 0, dword(MEASUREMENTS + 2)),
        (PATTERN[7:10], "UPLOAD", 3),
        ("OUT_OF_RANGE", "SHORT_UPLOAD", 5, 0, 1, dword(MEASUREMENTS)),
    )
    refused(slave, "OUT_OF_RANGE", "UPLOAD", (0,), (8,), (255,))


@pytest.mark.parametrize(("base", "name"), [(CALIBRATION, "size"), (MEASUREMENTS, "measurements")])
def test_bounds(slave: Slave, base: int, name: str) -> None:
    size = slave.places[name]
    for at, count in ((0, 7), (size - 7, 7), (size - 1, 1)):
        assert len(slave.positive("SHORT_UPLOAD", count, 0, 0, dword(base + at))) == count
    for at, count in ((-1, 1), (-1, 7), (size - 6, 7), (size, 1), (-base, 1), (2**32 - 1 - base, 7)):
        check(slave, ("ACCESS_DENIED", "SHORT_UPLOAD", count, 0, 0, dword(base + at)))
        if count < 7:
            check(slave, ("ACCESS_DENIED", "DOWNLOAD", count, bytes(6)))


def test_checksum(slave: Slave) -> None:
    whole = slave.read(CALIBRATION, slave.places["size"])
    slave.positive("SET_MTA", 0, 0, 0, dword(CALIBRATION))
    for part in (whole[:100], whole[100:]):  # the address advances
        wanted = bytes.fromhex("09 00 00") + dword(binascii.crc32(part))
        check(slave, (wanted, "BUILD_CHECKSUM", *PADDING, dword(len(part))))
    check(slave, ("ACCESS_DENIED", "BUILD_CHECKSUM", *PADDING, dword(1)))
    check(slave, ("OUT_OF_RANGE", "BUILD_CHECKSUM", *PADDING, dword(0)))


def test_writing(slave: Slave) -> None:
    at, axis = place(slave, "enable_speed"), place(slave, "speeds") + 4
    assert slave.write(at, number(12.0)) == OK
    for value in (math.nan, math.inf, -1.0, 0.0):  # zero: not above the disabling speed
        assert slave.write(at, number(value)) == "OUT_OF_RANGE"
    assert slave.read(at, 4) == number(12.0)
    refused(slave, "OUT_OF_RANGE", "DOWNLOAD", (0, bytes(6)), (7, bytes(6)), (255, bytes(6)))
    assert slave.write(MEASUREMENTS, b"\0") == "WRITE_PROTECTED"
    (first, second, third) = struct.unpack("<3f", slave.read(axis, 12))
    for value in (third, first, 1.5 * third, -second, math.nan):  # an axis must increase
        assert slave.write(axis + 4, number(value)) == "OUT_OF_RANGE"
    assert slave.read(axis, 12) == struct.pack("<3f", first, second, third)
    check(slave, (OK, "DISCONNECT"), (CONNECTED, "CONNECT", 0))
    assert slave.read(at, 4) == number(12.0)  # the calibration persists after the session


def test_information_on_pages(slave: Slave) -> None:
    check(
        slave,
        (bytes((1, 0)), "GET_PAG_PROCESSOR_INFO"),
        (PADDING + dword(CALIBRATION), "GET_SEGMENT_INFO", 0, 0, 0, 0),
        (PADDING + dword(slave.places["size"]), "GET_SEGMENT_INFO", 0, 0, 1, 0),
        (bytes((0x3F, 0)), "GET_PAGE_INFO", 0, 0, WORKING),
        (bytes((0x0F, 0)), "GET_PAGE_INFO", 0, 0, REFERENCE),
        ("SEGMENT_NOT_VALID", "GET_PAGE_INFO", 0, 1, 0),
    )
    refused(slave, "OUT_OF_RANGE", "GET_SEGMENT_INFO", (0, 0, 2, 0), (2, 0, 0, 0))


def test_switching(slave: Slave) -> None:
    at = place(slave, "enable_speed")
    built, upload = slave.read(at, 4), ("SHORT_UPLOAD", 4, 0, 0, dword(at))
    assert slave.write(at, number(12.0)) == OK
    check(
        slave,
        (OK, "SET_CAL_PAGE", MASTER, 0, REFERENCE),
        (bytes(3), "GET_CAL_PAGE", ECU, 0),
        (bytes((0, 0, 1)), "GET_CAL_PAGE", MASTER, 0),
        (built, *upload),
        (OK, "SET_MTA", 0, 0, 0, dword(at)),
        ("WRITE_PROTECTED", "DOWNLOAD", 4, number(12.0)),
        (OK, "SET_CAL_PAGE", ECU, 0, REFERENCE),
        (OK, "SET_CAL_PAGE", MASTER, 0, WORKING),
        (number(12.0), *upload),
        (OK, "SET_CAL_PAGE", 0x80 | BOTH, 255, REFERENCE),  # all segments
        (OK, "SET_CAL_PAGE", BOTH, 0, WORKING),
        (number(12.0), *upload),
        ("SEGMENT_NOT_VALID", "SET_CAL_PAGE", BOTH, 1, 0),
        ("PAGE_NOT_VALID", "SET_CAL_PAGE", BOTH, 0, 2),
        ("SEGMENT_NOT_VALID", "GET_CAL_PAGE", ECU, 1),
    )
    refused(slave, "MODE_NOT_VALID", "SET_CAL_PAGE", *((mode, 0, 0) for mode in (0, 0x80, 4, 0x47)))
    refused(slave, "MODE_NOT_VALID", "GET_CAL_PAGE", *((mode, 0) for mode in (0, 3, 0x80)))


def test_a_whole_axis_is_changed_while_the_reference_page_is_in_use(slave: Slave) -> None:
    """On the active page each point alone is rejected; together they are a valid axis."""
    at, points = place(slave, "speeds"), extend(load(BUILD.with_suffix(".npz")), builds.CONFIG).speed.size
    moved = [1.05 * speed for speed in struct.unpack(f"<{points}f", slave.read(at, 4 * points))]
    assert slave.write(at + 4 * (points // 2), number(moved[points // 2])) == "OUT_OF_RANGE"
    check(slave, (OK, "SET_CAL_PAGE", ECU, 0, REFERENCE))
    for k, speed in enumerate(moved):
        if k == points // 2:
            check(slave, ("PAGE_NOT_VALID", "SET_CAL_PAGE", ECU, 0, WORKING))
        assert slave.write(at + 4 * k, number(speed)) == OK
    check(slave, (OK, "SET_CAL_PAGE", ECU, 0, WORKING))
    assert slave.read(at, 4 * points) == struct.pack(f"<{points}f", *moved)


def test_copying_and_a_page_that_is_not_valid(slave: Slave) -> None:
    at = place(slave, "enable_speed")
    built = slave.read(at, 4)
    assert slave.write(at, number(12.0)) == OK
    check(slave, (OK, "COPY_CAL_PAGE", 0, WORKING, 0, WORKING))
    assert slave.read(at, 4) == number(12.0)
    check(slave, (OK, "SET_CAL_PAGE", ECU, 0, REFERENCE))
    assert slave.write(at, number(math.nan)) == OK
    check(slave, ("PAGE_NOT_VALID", "SET_CAL_PAGE", BOTH, 0, WORKING), (b"\0\0\1", "GET_CAL_PAGE", ECU, 0))
    assert slave.read(at, 4) == number(math.nan)
    check(slave, (OK, "COPY_CAL_PAGE", 0, REFERENCE, 0, WORKING), (OK, "SET_CAL_PAGE", BOTH, 0, WORKING))
    assert slave.read(at, 4) == built
    refused(slave, "WRITE_PROTECTED", "COPY_CAL_PAGE", (0, WORKING, 0, REFERENCE))
    refused(slave, "PAGE_NOT_VALID", "COPY_CAL_PAGE", (0, 2, 0, 0), (0, 0, 0, 2))
    refused(slave, "SEGMENT_NOT_VALID", "COPY_CAL_PAGE", (1, 0, 0, 0), (0, 0, 1, 0))


def allocate(slave: Slave, *lists: tuple[int, ...]) -> None:
    """Allocate lists, each of packets with that many entries."""
    check(slave, (OK, "FREE_DAQ"), (OK, "ALLOC_DAQ", 0, word(len(lists))))
    check(slave, *((OK, "ALLOC_ODT", 0, word(daq), len(odts)) for daq, odts in enumerate(lists)))
    for daq, odts in enumerate(lists):
        check(slave, *((OK, "ALLOC_ODT_ENTRY", 0, word(daq), odt, entries) for odt, entries in enumerate(odts)))


def fill(slave: Slave, daq: int, odt: int, *entries: tuple[int, int], mode: int = 0, prescaler: int = 1) -> None:
    """Write the address and size of each entry of a packet, and the list's mode."""
    check(slave, (OK, "SET_DAQ_PTR", 0, word(daq), odt, 0))
    check(slave, *((OK, "WRITE_DAQ", 0xFF, size, 0, dword(address)) for address, size in entries))
    check(slave, (OK, "SET_DAQ_LIST_MODE", mode, word(daq), word(0), prescaler, 0))


def test_information_on_measuring(slave: Slave) -> None:
    check(slave, (bytes.fromhex("13 00 00 01 00 00 00"), "GET_DAQ_PROCESSOR_INFO"))
    allocate(slave, (1,), (1,))
    check(
        slave,
        (bytes.fromhex("13 02 00 01 00 00 00"), "GET_DAQ_PROCESSOR_INFO"),
        (bytes.fromhex("01 07 01 00 62 01 00"), "GET_DAQ_RESOLUTION_INFO"),  # ms, two bytes
        (bytes((0x84, 8, len("task_10ms"), 10, 6, 0)), "GET_DAQ_EVENT_INFO", 0, word(0)),
        (b"task_10", "UPLOAD", 7),
        (b"ms", "UPLOAD", 2),
        ("OUT_OF_RANGE", "GET_DAQ_EVENT_INFO", 0, word(1)),
    )


def test_a_list_is_sampled_with_each_run(slave: Slave) -> None:
    at = place(slave, "enable_speed")
    built = slave.read(at, 4)
    allocate(slave, (2, 1), (1,))
    fill(slave, 0, 0, (MEASUREMENTS, 1), (MEASUREMENTS + 10, 4), mode=0x10)
    fill(slave, 0, 1, (MEASUREMENTS + 20, 7), mode=0x10)
    fill(slave, 1, 0, (at, 4), prescaler=3)
    check(
        slave,
        (b"\0", "START_STOP_DAQ_LIST", 2, word(0)),
        (b"\2", "START_STOP_DAQ_LIST", 2, word(1)),
        (bytes.fromhex("11 00 00 00 00 01 00"), "GET_DAQ_LIST_MODE", 0, word(0)),
        (OK, "START_STOP_SYNCH", 1),
        (bytes.fromhex("40 00 00 00 00 03 00"), "GET_DAQ_LIST_MODE", 0, word(1)),
        (b"\x40" + bytes(4), "GET_STATUS"),
    )
    for run in range(7):
        packets = slave.event()
        assert packets[0] == bytes((0,)) + word(10 * (run + 1)) + bytes((PATTERN[0] + run + 1,)) + PATTERN[10:14]
        assert packets[1:] == [bytes((1,)) + PATTERN[20:27], *([bytes((2,)) + built] if run % 3 == 0 else [])]
        check(slave, (PADDING + dword(10 * (run + 1)), "GET_DAQ_CLOCK"))
    check(slave, (b"\0", "START_STOP_DAQ_LIST", 0, word(0)))
    assert [len(slave.event()) for _ in range(3)] == [0, 0, 1]
    check(slave, (OK, "START_STOP_SYNCH", 0), (bytes(5), "GET_STATUS"))


def test_selected_lists_stop_together_and_a_new_session_measures_nothing(slave: Slave) -> None:
    allocate(slave, (1,), (1,))
    for daq in range(2):
        fill(slave, daq, 0, (MEASUREMENTS, 1))
        slave.positive("START_STOP_DAQ_LIST", 1, word(daq))
    check(slave, (b"\1", "START_STOP_DAQ_LIST", 2, word(1)), (OK, "START_STOP_SYNCH", 2))
    assert [measured[0] for measured in slave.event()] == [0]
    slave.positive("CONNECT", 0)
    assert slave.event() == []


def test_the_active_page_is_measured(slave: Slave) -> None:
    at = place(slave, "enable_speed")
    built = slave.read(at, 4)
    assert slave.write(at, number(12.0)) == OK
    check(slave, (OK, "SET_CAL_PAGE", MASTER, 0, REFERENCE))
    allocate(slave, (1,))
    fill(slave, 0, 0, (at, 4))
    slave.positive("START_STOP_DAQ_LIST", 1, word(0))
    assert slave.event() == [b"\0" + number(12.0)]
    check(slave, (OK, "SET_CAL_PAGE", ECU, 0, REFERENCE))
    assert slave.event() == [b"\0" + built]


def test_the_order_and_the_bounds_of_allocation(slave: Slave) -> None:
    daq, odt, entry = ("ALLOC_DAQ", 0, word(2)), ("ALLOC_ODT", 0, word(0), 1), ("ALLOC_ODT_ENTRY", 0, word(0), 0, 1)
    write = ("WRITE_DAQ", 0xFF, 1, 0, dword(MEASUREMENTS))
    check(slave, *(("SEQUENCE", *command) for command in (daq, odt, entry)), (OK, "FREE_DAQ"))
    check(slave, ("SEQUENCE", *odt), ("SEQUENCE", *entry), (OK, *daq), ("SEQUENCE", *entry), (OK, *odt))
    check(slave, ("SEQUENCE", *odt), ("SEQUENCE", *daq), (OK, *entry))  # its packets are already allocated
    check(slave, *(("SEQUENCE", *command) for command in (entry, odt, daq, write)))  # no pointer
    check(slave, (OK, "SET_DAQ_PTR", 0, word(0), 0, 0), (OK, *write), ("SEQUENCE", *write))  # after the last entry
    check(
        slave,
        (OK, "FREE_DAQ"),
        ("MEMORY_OVERFLOW", "ALLOC_DAQ", 0, word(9)),
        ("OUT_OF_RANGE", "ALLOC_DAQ", 0, word(0)),
        (OK, "ALLOC_DAQ", 0, word(8)),
        ("MEMORY_OVERFLOW", "ALLOC_ODT", 0, word(0), 33),
        (OK, "ALLOC_ODT", 0, word(0), 30),
        ("MEMORY_OVERFLOW", "ALLOC_ODT", 0, word(1), 3),
        (OK, "ALLOC_ODT", 0, word(1), 2),
    )
    refused(slave, "OUT_OF_RANGE", "ALLOC_ODT", (0, word(8), 1), (0, word(2), 0))
    entry = ("ALLOC_ODT_ENTRY", 0, word(0), 0)
    check(slave, ("MEMORY_OVERFLOW", *entry, 8), (OK, *entry, 7))
    refused(slave, "OUT_OF_RANGE", "ALLOC_ODT_ENTRY", (0, word(0), 30, 1), (0, word(8), 0, 1))


def test_entries_and_modes_that_are_not_valid(slave: Slave) -> None:
    allocate(slave, (2,))
    zero, one, inside = word(0), word(1), dword(MEASUREMENTS)
    refused(slave, "OUT_OF_RANGE", "SET_DAQ_PTR", (0, one, 0, 0), (0, zero, 1, 0), (0, zero, 0, 2))
    check(slave, (OK, "SET_DAQ_PTR", 0, zero, 0, 0))
    choices = ((0, 1, 0), (0xFF, 0, 0), (0xFF, 8, 0), (0xFF, 1, 1))
    refused(slave, "OUT_OF_RANGE", "WRITE_DAQ", *((*choice, inside) for choice in choices))
    check(
        slave,
        ("ACCESS_DENIED", "WRITE_DAQ", 0xFF, 1, 0, dword(MEASUREMENTS + slave.places["measurements"])),
        (OK, "WRITE_DAQ", 0xFF, 4, 0, inside),
        ("OUT_OF_RANGE", "WRITE_DAQ", 0xFF, 4, 0, inside),  # eight bytes in all
        ("DAQ_CONFIG", "START_STOP_DAQ_LIST", 1, zero),  # an entry is not written, and no event is set
        (OK, "WRITE_DAQ", 0xFF, 3, 0, inside),
        ("DAQ_CONFIG", "START_STOP_DAQ_LIST", 1, zero),
        (OK, "SET_DAQ_LIST_MODE", 0x10, zero, zero, 1, 0),
        ("DAQ_CONFIG", "START_STOP_DAQ_LIST", 2, zero),  # no room for the timestamp
        ("OUT_OF_RANGE", "GET_DAQ_LIST_MODE", 0, one),
        ("MODE_NOT_VALID", "START_STOP_DAQ_LIST", 3, zero),
        ("OUT_OF_RANGE", "START_STOP_DAQ_LIST", 1, one),
        ("MODE_NOT_VALID", "START_STOP_SYNCH", 3),
    )
    refused(slave, "MODE_NOT_VALID", "SET_DAQ_LIST_MODE", *((mode, zero, zero, 1, 0) for mode in (0x01, 0x02, 0x20, 0xFF)))
    choices = ((one, zero, 1, 0), (zero, one, 1, 0), (zero, zero, 0, 0), (zero, zero, 1, 1))
    refused(slave, "OUT_OF_RANGE", "SET_DAQ_LIST_MODE", *((0, *choice) for choice in choices))


def test_a_running_list_is_not_changed(slave: Slave) -> None:
    allocate(slave, (2,), (1,))
    fill(slave, 0, 0, (MEASUREMENTS, 1), (MEASUREMENTS, 1))
    check(
        slave,
        (OK, "SET_DAQ_PTR", 0, word(0), 0, 0),
        (b"\0", "START_STOP_DAQ_LIST", 1, word(0)),
        ("DAQ_ACTIVE", "WRITE_DAQ", 0xFF, 1, 0, dword(MEASUREMENTS)),
        ("DAQ_ACTIVE", "SET_DAQ_PTR", 0, word(0), 0, 0),
        ("DAQ_ACTIVE", "SET_DAQ_LIST_MODE", 0, word(0), word(0), 1, 0),
        ("DAQ_ACTIVE", "ALLOC_ODT_ENTRY", 0, word(1), 0, 1),
    )
    fill(slave, 1, 0, (MEASUREMENTS, 1))  # another list can be changed
    check(slave, (OK, "FREE_DAQ"))
    assert slave.event() == []

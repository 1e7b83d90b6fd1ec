"""The slave's answers are what the A2L of its build says."""

import shutil
from pathlib import Path

import pytest

from codegen.configuration.xcp import MANDATORY_COMMANDS, OPTIONAL_COMMANDS
from tests.xcp.description import Description, if_data
from tests.xcp.slave import BUILD, MEASUREMENTS, Slave, dword

UNKNOWN = bytes.fromhex("fe 20")
"""ERR_CMD_UNKNOWN."""


@pytest.fixture(scope="module")
def a2l(tmp_path_factory: pytest.TempPathFactory) -> Description:
    """Return the A2L of the committed build."""
    return Description.read(Path(shutil.copy(BUILD / "ars.a2l", tmp_path_factory.mktemp("a2l"))))


def test_the_commands(program: Path, a2l: Description) -> None:
    """The slave is sent every code: it knows those that the A2L lists, and those that every slave has."""
    known = set()
    with Slave(program) as slave:
        for code in range(256):
            slave.positive("CONNECT", 0)
            if slave.command(bytes((code, *[0] * 7))) != UNKNOWN:
                known.add(code)
    assert known == {OPTIONAL_COMMANDS[name] for name in a2l.commands} | set(MANDATORY_COMMANDS.values())
    assert len(a2l.commands) == len(set(a2l.commands))


def test_packets_and_byte_order(slave: Slave, a2l: Description) -> None:
    _resources, mode, max_cto, low, high, *_ = slave.positive("CONNECT", 0)
    assert a2l.xcp["PROTOCOL_LAYER"].values[8:10] == [max_cto, low + 256 * high]
    assert a2l.order == (">" if mode & 1 else "<")


def test_measurement_lists(slave: Slave, a2l: Description) -> None:
    daq = a2l.xcp["DAQ"]
    properties, _lists, _, events, _, least, key = slave.positive("GET_DAQ_PROCESSOR_INFO")
    kind, most, *rest = daq.values
    assert (kind, rest[:2]) == ("DYNAMIC" if properties & 1 else "STATIC", [events, least])
    assert ("PRESCALER_SUPPORTED" in daq.values, bool(properties & 0x10)) == (bool(properties & 2), True)
    assert key >> 6 == 0 and "IDENTIFICATION_FIELD_TYPE_ABSOLUTE" in daq.values
    granularity, entry, _, _, mode, ticks, _ = slave.positive("GET_DAQ_RESOLUTION_INFO")
    assert granularity == 1 and daq.after("GRANULARITY_ODT_ENTRY_SIZE_DAQ_BYTE") == entry
    units = [f"UNIT_{unit}" for unit in ["1NS", "10NS", "100NS", "1US", "10US", "100US", "1MS", "10MS", "100MS", "1S"]]
    sizes = {1: "SIZE_BYTE", 2: "SIZE_WORD", 4: "SIZE_DWORD"}
    assert daq["TIMESTAMP_SUPPORTED"].values == [ticks, sizes[mode & 7], units[mode >> 4]]
    name, short, number, direction, lists, cycle, unit, priority = daq["EVENT"].values
    info = slave.positive("GET_DAQ_EVENT_INFO", 0, 0, 0)
    assert (lists, len(str(name)), cycle, unit, priority) == tuple(info[1:6])
    assert (info[0] & 0x0C, direction) == (0x04, "DAQ") and lists == most
    assert slave.positive("UPLOAD", 7) + slave.positive("UPLOAD", info[2] - 7) == str(name).encode()
    assert len(str(short)) <= 8 and {each.event for each in a2l.measured.values()} == {number}


def test_pages(slave: Slave, a2l: Description) -> None:
    segment = if_data(a2l.segment)["SEGMENT"]
    assert a2l.xcp["PAG"].values == [slave.positive("GET_PAG_PROCESSOR_INFO")[0]]
    pages, extension, _most, compression, encryption = slave.positive("GET_SEGMENT_INFO", 1, 0, 0, 0)
    assert segment.values == [0, pages, extension, compression, encryption]
    accesses = ("NOT_ALLOWED", "WITHOUT_{}_ONLY", "WITH_{}_ONLY", "DONT_CARE")
    for number, page in enumerate(segment.blocks("PAGE")):
        properties, _ = slave.positive("GET_PAGE_INFO", 0, 0, number)
        ecu, read, write = (accesses[properties >> shift & 3] for shift in (0, 2, 4))
        xcp = [f"XCP_READ_ACCESS_{read.format('ECU')}", f"XCP_WRITE_ACCESS_{write.format('ECU')}"]
        assert page.values == [number, f"ECU_ACCESS_{ecu.format('XCP')}", *xcp]
    assert len(list(segment.blocks("PAGE"))) == pages
    slave.positive("SET_MTA", 0, 0, 0, dword(MEASUREMENTS))
    assert slave.positive("BUILD_CHECKSUM", 0, 0, 0, dword(1))[0] == 9 and segment["CHECKSUM"].values == ["XCP_CRC_32"]

"""Random packets to the slave, with invariants for any packets.

There is no crash and no write outside the calibration, and the controller always runs on valid parameters: `Slave` checks this
after each packet.
"""

import struct
from collections import Counter
from pathlib import Path

import numpy as np

from tests.xcp.slave import CALIBRATION, COMMANDS, ERRORS, MEASUREMENTS, Slave, dword, packet, word

NUMBERS = (0.0, -0.0, 1e-30, 0.05, 1.0, 12.0, 100.0, 1e9, -1.0, float("nan"), float("inf"), -float("inf"))
CALIBRATED = ("rear_angle_max", "enable_speed", "speeds", "table")
Random = np.random.Generator


def _address(rng: Random, places: dict[str, int]) -> int:
    """Return an address inside, at the edges, just beyond them, or anywhere."""
    base, size = [(CALIBRATION, places["size"]), (MEASUREMENTS, places["measurements"])][rng.integers(2)]
    near = (rng.integers(-8, 9), size + rng.integers(-8, 9), rng.integers(size), rng.integers(2**32) - base)
    return int(base + near[rng.integers(4)]) % 2**32


def _shaped(rng: Random, places: dict[str, int], name: str) -> bytes:
    """Return a command whose arguments are valid or nearly valid."""
    small = [int(value) for value in rng.choice([0, 0, 0, 1, 1, 2, 3, 7, 8, 255], 7)]
    address, size, flag = dword(_address(rng, places)), int(rng.integers(9)), int(rng.random() < 0.05)
    arguments: dict[str, tuple[int | bytes, ...]] = {
        "SET_MTA": (size, 0, flag, address),
        "SHORT_UPLOAD": (size, 0, flag, address),
        "DOWNLOAD": (int(rng.choice([1, 2, 4, 4, 4, 6, 7])), struct.pack("<f", rng.choice(NUMBERS)), rng.bytes(2)),
        "BUILD_CHECKSUM": (0, 0, 0, dword(int(rng.choice([0, 1, 100, places["size"], 2**32 - 1])))),
        "WRITE_DAQ": (0xFF, size, 0, address),
        "SET_DAQ_LIST_MODE": (int(rng.choice([0, 0x10, 0x02])), word(small[0]), word(flag), int(rng.integers(4)), 0),
        "SET_CAL_PAGE": (int(rng.choice([1, 2, 3, 3, 0x83, 4, 0])), flag, int(rng.integers(3))),
        **dict.fromkeys(("START_STOP_DAQ_LIST", "GET_DAQ_LIST_MODE"), (small[0], word(small[1]))),
        "COPY_CAL_PAGE": (0, int(rng.integers(2)), flag, int(rng.integers(2))),
    }
    return packet(name, *arguments.get(name, small))


def _lists(rng: Random, places: dict[str, int]) -> list[bytes]:
    """Return the packets that set up and start a measurement list, one time in ten in random order."""
    lists, odts, entries = (int(rng.choice([2, 2, 2, 2, 2, more])) for more in (9, 33, 8))
    packets = [packet("FREE_DAQ"), packet("ALLOC_DAQ", 0, word(lists)), packet("ALLOC_ODT", 0, word(0), odts)]
    packets += [packet("ALLOC_ODT_ENTRY", 0, word(0), odt, entries) for odt in range(min(odts, 3))]
    for odt in range(min(odts, 3)):
        at = MEASUREMENTS + int(rng.integers(places["measurements"]))
        packets.append(packet("SET_DAQ_PTR", 0, word(0), odt, 0))
        packets += [packet("WRITE_DAQ", 0xFF, int(rng.integers(1, 5)), 0, dword(at)) for _ in range(entries)]
    packets.append(packet("SET_DAQ_LIST_MODE", int(rng.choice([0, 0x10])), word(0), word(0), int(rng.integers(1, 3)), 0))
    packets += [packet("START_STOP_DAQ_LIST", int(rng.integers(1, 3)), word(0)), packet("START_STOP_SYNCH", 1)]
    return packets if rng.random() < 0.9 else [packets[k] for k in rng.permutation(len(packets))]


def random_packets(rng: Random, places: dict[str, int]) -> list[bytes | None]:
    """Return a few consecutive packets; None is a run of the task."""
    kind, names = rng.random(), list(COMMANDS)
    if kind < 0.25:
        return [rng.bytes(int(rng.integers(13)))]
    if kind < 0.27:
        return [packet("DISCONNECT"), rng.bytes(8), packet("CONNECT", int(rng.random() < 0.1)), packet("CONNECT", 0)]
    if kind < 0.34:
        return [*_lists(rng, places), *[None] * 3]
    if kind < 0.50:  # parameters on the active page or the other, between two changes of the pages
        at = (CALIBRATION + places[str(rng.choice(CALIBRATED))] for _ in range(3))
        writes = (each for one in at for each in (packet("SET_MTA", 0, 0, 0, dword(one)), _shaped(rng, places, "DOWNLOAD")))
        pages = [_shaped(rng, places, name) for name in ("SET_CAL_PAGE", "SET_CAL_PAGE", "COPY_CAL_PAGE")]
        return [pages[0], *writes, *pages[1 : int(rng.integers(2, 4))], None]
    if kind < 0.60:
        return [_shaped(rng, places, name) for name in ("SET_MTA", str(rng.choice(["UPLOAD", "DOWNLOAD", "BUILD_CHECKSUM"])))]
    shaped = _shaped(rng, places, names[rng.integers(2, len(names))])
    return [shaped[: rng.integers(1, 9)] if rng.random() < 0.1 else shaped]


def run_random_packets(program: Path, count: int) -> tuple[Counter[str], int]:
    """Send `count` packets to a connected slave.

    Returns:
        The number of positive responses of each command and of each error, by name, and the number of measurement packets.

    Raises:
        AssertionError: an invariant does not hold.
    """
    rng, seen, measured, sent = np.random.default_rng(1), Counter[str](), 0, 0
    names = {code: name for name, code in COMMANDS.items()}
    with Slave(program) as slave:
        slave.positive("CONNECT", 0)
        while sent < count:
            for data in random_packets(rng, slave.places):
                if data is None:
                    measured += len(slave.event())
                    continue
                answer, sent = slave.command(data), sent + 1
                if answer is not None:
                    seen[names[data[0]] if answer[0] == 0xFF else ERRORS[answer[1]]] += 1
    return seen, measured

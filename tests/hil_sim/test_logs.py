"""Logs of the bus, read back with python-can, cantools and asammdf."""

import math
import os
import random
import resource
import signal
import sys
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import asammdf
import can
import cantools
import pytest
from cantools.logreader import Parser

from codegen.errors import CodegenError
from hil_sim.codec import Frame
from hil_sim.logs import BusLog

START = 1_700_000_000.123
"""2023-11-14 22:13:20.123 UTC: whole milliseconds, which every format can store, with a nonzero first decimal."""

DBC = """VERSION ""
BU_: Plant Ecu
BO_ 257 VehicleMotion: 8 Plant
 SG_ Speed : 16|16@1- (0.005,0) [-163.835|163.835] "m/s" Ecu
"""
formats = pytest.mark.parametrize("extension", ["blf", "asc", "log", "mf4"])


def some_frames(count: int = 400) -> list[tuple[Frame, bool]]:
    """Return all kinds of frames with every length and times in whole microseconds, exact in each format; the first is not at
    zero."""
    source = random.Random(20230714)
    frames, now = [], 500_000
    for number in range(count):
        now += source.choice((0, 1, 7, 9_999, 10_000, 123_457))
        extended = source.random() < 0.4
        # Ids at the edges; an extended id that would fit into 11 bits must stay an extended one.
        identifier = source.choice((0, 1, 0x101, 0x7FF) + ((0x800, 0x1FFF_FFFF) if extended else ()))
        kind = source.choice(("data", "data", "data", "remote", "error"))
        data = source.randbytes(number % 9)
        if kind == "error":
            identifier, extended, data = 0x80, False, bytes(8)
        frame = Frame(identifier, data, now / 1e6, extended, kind == "remote", kind == "error")
        frames.append((frame, source.random() < 0.5))
    return frames


def signal_frames() -> list[tuple[Frame, bool]]:
    """Return one second of the DBC's message, 10 ms apart."""
    encode = cantools.database.load_string(DBC).encode_message
    return [(Frame(0x101, encode(0x101, {"Speed": k * 0.5}), 0.02 + k / 100), True) for k in range(100)]


def write(path: Path, frames: list[tuple[Frame, bool]], error: BaseException | None = None, **options: Any) -> Path:
    """Log frames; the run then ends with the error, if given."""
    with BusLog(path, **{"start": START, **options}) as log:
        for frame, received in frames:
            log.write(frame, received)
        if error is not None:
            raise error
    return path


def read(path: Path) -> list[can.Message]:
    """Return messages with times from the start of the run, read by python-can."""
    reader: Any = can.LogReader(path)
    offset = START if path.suffix in (".log", ".mf4") else 0.0
    if path.suffix == ".blf":
        reader.start_timestamp = 0.0  # otherwise added to each time, with 0.2 us of rounding
    messages = list(reader)
    for message in messages:
        message.timestamp -= offset
    return messages


# python-can adds the Unix time of the start to times of candump and MF4. The spacing of float64 near 1.7e9 is 0.24 us, and both
# the time and START are rounded. BLF is accurate to half a nanosecond, ASC exact (six decimals of whole microseconds).
TIME_TOLERANCE = {".blf": 0.6e-9, ".asc": 1e-12, ".log": 0.3e-6, ".mf4": 0.3e-6}


@formats
def test_frames_read_back(tmp_path: Path, extension: str) -> None:
    frames = some_frames()
    path = write(tmp_path / f"run.{extension}", frames)
    messages = read(path)
    if extension == "mf4":  # three groups, merged by time: the order of simultaneous frames is free
        messages.sort(key=lambda one: (round(one.timestamp, 6), one.is_error_frame, one.is_remote_frame))
        frames.sort(key=lambda one: (one[0].time, one[0].error, one[0].remote))
    for message, (frame, received) in zip(messages, frames, strict=True):
        assert message.timestamp == pytest.approx(frame.time, rel=0, abs=TIME_TOLERANCE[path.suffix])
        assert message.is_error_frame == frame.error
        if frame.error:
            continue  # ASC stores no more of it
        assert (message.arbitration_id, message.is_extended_id) == (frame.id, frame.extended)
        assert (message.is_remote_frame, message.dlc) == (frame.remote, len(frame.data))
        assert message.is_rx == received
        assert bytes(message.data) == (b"" if frame.remote else frame.data)
        # python-can counts the channels of Vector's formats from 0.
        assert message.channel == {".log": "vcan0", ".mf4": 1}.get(path.suffix, 0)
    assert read(write(path, [])) == []


@formats
def test_frames_of_can_fd_read_back(tmp_path: Path, extension: str) -> None:
    """All lengths, with bit-rate switching; and a classical frame among them."""
    lengths = (*range(9), 12, 16, 20, 24, 32, 48, 64)
    frames = [Frame(0x18FF0101, bytes(range(n)), n / 1e3, extended=True, fd=True) for n in lengths]
    frames.insert(3, Frame(0x101, b"\1\2", frames[3].time - 0.0005))
    messages = read(write(tmp_path / f"run.{extension}", [(frame, True) for frame in frames]))
    for message, frame in zip(messages, frames, strict=True):
        assert (message.arbitration_id, message.is_extended_id, bytes(message.data)) == (frame.id, frame.extended, frame.data)
        assert (message.is_fd, message.bitrate_switch) == (frame.fd, frame.fd)


def test_a_long_blf_has_every_frame_and_the_times_of_start_and_end(tmp_path: Path) -> None:
    """BLF packs frames into containers; a frame split between two must be restored."""
    frames = [(Frame(number % 0x800, number.to_bytes(8, "big"), number / 1000), True) for number in range(5000)]
    messages = read(write(tmp_path / "run.blf", frames))
    assert [int.from_bytes(one.data, "big") for one in messages] == list(range(5000))
    # All are multiples of 1 ms, many of which are not exact in float64: none may be 1 ns early.
    assert all(math.isclose(one.timestamp, number / 1000, rel_tol=0, abs_tol=0.1e-9) for number, one in enumerate(messages))
    with can.BLFReader(tmp_path / "run.blf") as reader:
        assert reader.start_timestamp == START
        assert reader.stop_timestamp == pytest.approx(START + 4.999, abs=0.5e-3)  # SYSTEMTIME: whole milliseconds


@pytest.fixture
def other_time_zone(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Set a time zone other than UTC: 13 h ahead in November."""
    monkeypatch.setenv("TZ", "NZDT-13")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.usefixtures("other_time_zone")
def test_lines_of_asc(tmp_path: Path) -> None:
    path = write(tmp_path / "run.asc", signal_frames(), start=START - 0.118, channel="my bus")  # .005: 5 ms are not .5 s
    lines = path.read_text().splitlines()
    assert lines[0] == "date Wed Nov 15 11:13:20.005 2023"
    assert lines[3].startswith("// CAN 1: my_bus") and lines[4] == "Begin Triggerblock Wed Nov 15 11:13:20.005 2023"
    assert lines[6] == " 0.020000 1  101             Rx   d 8 00 00 00 00 00 00 00 00"
    with can.ASCReader(path, relative_timestamp=False) as reader:
        assert next(iter(reader)).timestamp == pytest.approx(START - 0.118 + 0.02, rel=0, abs=0.3e-6)


def test_lines_of_candump(tmp_path: Path) -> None:
    expected = {
        "(1700000000.123000) can7 001# R": (Frame(0x1, b"", -0.25), True),  # times before the start become the start
        "(1700000000.123001) can7 101#01AB T": (Frame(0x101, b"\x01\xab", 0.000001), False),
        "(1700000001.123000) can7 00000007#09 R": (Frame(0x7, b"\x09", 1.0, extended=True), True),
        "(1700000001.623000) can7 007#R3 R": (Frame(0x7, bytes(3), 1.5, remote=True), True),
        "(1700000002.123000) can7 20000004#0001000000000000 R": (Frame(0x4, b"\x00\x01", 2.0, error=True), True),
        "(1700000002.373000) can7 20000080#0000000000000000 R": (Frame(0, b"", 2.25, error=True), True),
    }
    path = write(tmp_path / "run.log", list(expected.values()), channel="can7")
    assert path.read_text().splitlines() == list(expected)
    with path.open() as file:
        parsed = [frame for _, frame in Parser(file).iterlines() if frame is not None]
    assert [one.frame_id for one in parsed] == [0x1, 0x101, 0x7, 0x7]  # cantools skips error frames


def test_mf4_gives_physical_signals_by_its_embedded_database(tmp_path: Path) -> None:
    path = write(tmp_path / "run.mf4", signal_frames(), dbc=DBC.encode())
    with asammdf.MDF(path) as log:
        assert log.start_time == datetime.fromtimestamp(START, UTC)
        assert log.attachments[0].file_name == "ars.dbc"
        assert log.attachments[0].extract() == DBC.encode()
        one = log.get("Speed")
        assert one.unit == "m/s"
        assert one.timestamps.tolist() == [0.02 + cycle / 100 for cycle in range(100)]  # float64, unchanged
        assert one.samples.tolist() == pytest.approx([0.5 * cycle for cycle in range(100)], abs=1e-12)


@pytest.mark.usefixtures("other_time_zone")
@formats
def test_without_a_wall_clock_logs_repeat(tmp_path: Path, extension: str, monkeypatch: pytest.MonkeyPatch) -> None:
    first = write(tmp_path / f"first.{extension}", some_frames(), start=None, dbc=DBC.encode()).read_bytes()
    real = time.time
    monkeypatch.setattr(time, "time", lambda: real() + 86_400.0)
    monkeypatch.setenv("TZ", "UTC+5")
    time.tzset()
    assert write(tmp_path / f"second.{extension}", some_frames(), start=None, dbc=DBC.encode()).read_bytes() == first


@pytest.mark.parametrize(("extension", "interruption"), [("blf", KeyboardInterrupt), ("mf4", CodegenError)])
def test_an_interrupted_run_leaves_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, extension: str, interruption: type[BaseException]
) -> None:
    """A further Ctrl-C waits for the file."""
    path, synchronise = tmp_path / f"run.{extension}", os.fsync
    path.write_text("old content")

    def interrupted(handle: int) -> None:
        assert path.read_text() == "old content"
        signal.raise_signal(signal.SIGINT)
        synchronise(handle)

    monkeypatch.setattr(os, "fsync", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in background jobs of a shell
    try:
        with pytest.raises((interruption, KeyboardInterrupt)):
            write(path, some_frames(), interruption("stop"))
    finally:
        signal.signal(signal.SIGINT, before)
    assert len(read(path)) == 400
    assert list(tmp_path.iterdir()) == [path]


@pytest.fixture
def full_disk() -> Iterator[None]:
    """Limit files to 2 kB, so that writes really fail, as on a full disk."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2048, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.usefixtures("full_disk")
@formats
@pytest.mark.parametrize(
    ("error", "words"),
    [
        (CodegenError("no answer"), "no answer"),  # the run's error comes first; Ctrl-C has no message
        (KeyboardInterrupt(), r"run\.\w+: the log cannot be written \(File too large\); check that"),
        (None, r"run\.\w+: the log cannot be written \(File too large\); check that"),
    ],
)
def test_a_full_disk_is_one_error_and_the_old_file_stays(
    tmp_path: Path, extension: str, error: BaseException | None, words: str
) -> None:
    path = tmp_path / f"run.{extension}"
    path.write_text("old content")
    with pytest.raises(CodegenError, match=words):
        # With a failing run: more than 2 kB, but no more than the buffers hold until the end.
        write(path, some_frames(150 if error else 2000), error)
    assert path.read_text() == "old content"
    assert list(tmp_path.iterdir()) == [path]


def test_an_invalid_log_is_rejected_before_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("run", "run.blf.gz", ".blf"):
        with pytest.raises(CodegenError, match=r"one of \.blf, \.asc, \.log, \.mf4"):
            BusLog(tmp_path / name)
    (tmp_path / "folder.blf").mkdir()
    for name in ("missing/run.blf", "folder.blf", "nul\0.blf"):
        with pytest.raises(CodegenError, match="cannot be written"):
            BusLog(tmp_path / name).__enter__()
    assert [one.name for one in tmp_path.iterdir()] == ["folder.blf"]
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(CodegenError, match=r'pip install "asammdf>=8.8,<9"$'):
        BusLog(tmp_path / "run.mf4")

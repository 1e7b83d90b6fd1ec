"""Frames of logs of a bus."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import numpy as np
import pytest

from codegen.errors import CodegenError
from codegen.limits import MIB, Limits
from codegen.logs import account, mf4
from codegen.logs.account import read_frames
from codegen.logs.frames import Collector, Kind


@pytest.mark.parametrize("name", ["bus.asc", "bus.log"])
def test_a_text_log_that_ends_inside_a_line_is_refused(name: str, tmp_path: Path) -> None:
    """python-can reads a frame with fewer bytes, or none."""
    path = tmp_path / name
    with can.Logger(path) as log:
        for time in (1.0, 2.0):
            log(can.Message(timestamp=time, arbitration_id=0x101, data=bytes(8)))
    whole = path.read_bytes()
    path.write_bytes(whole.removesuffix(b"TriggerBlock\n"))  # cut where no frame is
    assert read_frames(path)[1].read == 2
    lines = whole.removesuffix(b"End TriggerBlock\n").splitlines(keepends=True)
    for cut in range(1, len(lines[-1]) - 1):
        path.write_bytes(b"".join(lines)[:-cut])
        with pytest.raises(CodegenError, match=f"line {len(lines)}: it ends inside a line; copy it again"):
            read_frames(path)


def random_message(rng: np.random.Generator, time: float) -> can.Message:
    """Return a frame of any kind, with or without a channel."""
    kind, channel = rng.integers(0, 4), [None, 1, 2][rng.integers(0, 3)]
    if kind == 0:
        return can.Message(timestamp=time, is_error_frame=True, channel=channel)
    is_extended, is_fd = bool(rng.integers(0, 2)), kind == 1
    identifier = int(rng.integers(0, 0x2000_0000 if is_extended else 0x800))
    about: dict[str, Any] = {"timestamp": time, "arbitration_id": identifier, "is_extended_id": is_extended, "channel": channel}
    if kind == 2:
        return can.Message(**about, is_remote_frame=True, dlc=4)
    data = rng.bytes(int(rng.choice([0, 8, 12, 64]) if is_fd else rng.integers(0, 9)))
    return can.Message(**about, is_fd=is_fd, is_rx=bool(rng.integers(0, 2)), data=data)


def test_frames_of_an_mf4_are_those_that_python_can_reads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """More than one block of records, and groups that are merged by time."""
    monkeypatch.setattr(mf4, "CHUNK", 500)
    path, rng = tmp_path / "bus.mf4", np.random.default_rng(4)
    with can.Logger(path) as log:
        for k in range(2_000):
            log(random_message(rng, 1.7e9 + 1e-3 * k))
    found, account = mf4.read(path)
    expected = Collector("MF4", in_file=account.in_file)
    with can.LogReader(path) as log:
        for message in log:
            expected.add(message, message.timestamp, str(message.channel or 0), str(path))
    whole, _ = expected.finish("")
    for name in ("time", "identifier", "is_extended", "is_fd", "is_sent", "kind"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name), name)
    assert found.data == whole.data
    assert [found.channels[k] for k in found.channel] == [whole.channels[k] for k in whole.channel]


@pytest.mark.parametrize("kind", ["mf4", "asc", "blf"])
def test_logs_up_to_64_mib_have_the_limits_of_a_small_file(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, used = tmp_path / f"bus.{kind}", list[Limits]()
    with path.open("wb") as file:
        file.truncate(64 * MIB)

    def of(*arguments: int) -> Limits:
        used.append(Limits.of(*arguments))
        raise CodegenError("known")

    monkeypatch.setattr(account, "Limits", SimpleNamespace(of=of))
    with pytest.raises(CodegenError, match="known"):
        read_frames(path)
    assert used == [Limits()]


def test_an_object_of_no_size_is_refused(tmp_path: Path) -> None:
    """python-can would read it for ever."""
    path = tmp_path / "bus.blf"
    with can.BLFWriter(path, compression_level=0) as log:
        log.on_message_received(can.Message(timestamp=1.0, arbitration_id=0x101, data=bytes(8)))
    assert read_frames(path)[0].identifier.tolist() == [0x101]
    data = bytearray(path.read_bytes())
    start = data.rindex(b"LOBJ")  # the frame, inside the container
    data[start + 8 : start + 12] = bytes(4)  # its size, behind signature, header size and header version
    path.write_bytes(data)
    with pytest.raises(CodegenError, match="an object has the size 0"):
        read_frames(path)


def test_a_blf_is_read_as_python_can_reads_it(tmp_path: Path) -> None:
    """CAN messages are read without python-can, between the frames of other kinds that it reads."""
    path, rng = tmp_path / "bus.blf", np.random.default_rng(0)
    with can.BLFWriter(path) as log:
        for k, length in enumerate(rng.integers(9, size=300).tolist()):
            kind: dict[str, Any] = [{}, {}, {"is_fd": True}, {"is_error_frame": True}, {"is_remote_frame": True}][k % 5]
            is_extended = bool(rng.integers(2))
            log.on_message_received(
                can.Message(
                    timestamp=1.7e9 + 0.0123 * k,
                    arbitration_id=int(rng.integers(2**29 if is_extended else 2**11)),
                    is_extended_id=is_extended,
                    is_rx=bool(rng.integers(2)),
                    channel=int(rng.integers(3)),
                    dlc=length,
                    data=None if k % 5 > 2 else rng.bytes(length),
                    **kind,
                )
            )
    frames, account = read_frames(path)
    assert account.read == account.in_file == len(frames) == 300
    with can.BLFReader(path) as reader:
        for k, message in enumerate(reader):
            assert frames.time[k] == message.timestamp
            assert frames.data[k] == bytes(message.data)
            assert frames.channels[frames.channel[k]] == str(message.channel + 1)
            flags = frames.is_extended[k], frames.is_fd[k], not frames.is_sent[k], frames.kind[k] == Kind.REMOTE
            assert flags == (message.is_extended_id, message.is_fd, message.is_rx, message.is_remote_frame)
            assert (frames.kind[k] == Kind.ERROR) == message.is_error_frame
            assert frames.identifier[k] == (0 if message.is_error_frame else message.arbitration_id)

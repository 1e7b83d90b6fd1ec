"""Every frame of a log is accounted for, and the frames of a message come from one sender."""

import struct
from pathlib import Path

import can
import numpy as np
import pytest

from codegen.errors import CodegenError
from codegen.logs.account import BusLog, findings, open_bus_log, read_frames, to_dict
from codegen.logs.databases import Identifiers
from codegen.logs.formats import LOGS
from codegen.logs.senders import Fate

KNOWN = Identifiers({(0x100, False): "Motion", (0x101, False): "Steering"})


def message(time: float, number: int, **options: object) -> can.Message:
    """Return a frame of Motion whose data are a number."""
    options = {"arbitration_id": 0x100, "is_extended_id": False, "is_rx": True, "channel": 0, **options}
    return can.Message(timestamp=time, data=struct.pack("<q", number), **options)  # type: ignore[arg-type]


def write(path: Path, messages: list[can.Message]) -> Path:
    with can.Logger(path) as log:
        for each in messages:
            log.on_message_received(each)
    return path


def opened(path: Path, messages: list[can.Message], channel: str | None = None) -> BusLog:
    return open_bus_log(write(path, sorted(messages, key=lambda each: each.timestamp)), KNOWN, channel)


def fates(log: BusLog) -> dict[Fate, int]:
    return {fate: count for fate in Fate if (count := int(np.count_nonzero(log.allotment.fate == fate)))}


@pytest.mark.parametrize("ending", LOGS)
def test_the_account_closes_in_every_format(ending: str, tmp_path: Path) -> None:
    messages = [message(1.7e9 + 0.01 * k, k) for k in range(20)]
    messages += [
        message(1.7e9 + 0.2, 1, arbitration_id=0x77),
        can.Message(timestamp=1.7e9 + 0.3, is_error_frame=True, channel=0),
    ]
    messages += [
        can.Message(timestamp=1.7e9 + 0.4, arbitration_id=0x100, is_remote_frame=True, is_extended_id=False, channel=0)
    ]
    log = opened(tmp_path / f"drive{ending}", messages)
    assert (log.file.in_file, log.file.read, dict(log.file.skipped)) == (23, 23, {})
    assert fates(log) == {Fate.USED: 20, Fate.ERROR: 1, Fate.REMOTE: 1, Fate.UNKNOWN: 1}
    assert findings(log) == []
    assert to_dict(log)["frames"]["in_file"] == 23
    assert sum(row["frames"] for row in to_dict(log)["channels"]) == 23


# --- copies --------------------------------------------------------------------------------------------------------------


def test_frames_that_a_tester_sends_do_not_replace_those_of_the_bus(tmp_path: Path) -> None:
    messages = [message(0.01 * k, k) for k in range(1000)] + [message(k + 0.004, -1, is_rx=False) for k in range(10)]
    log = opened(tmp_path / "drive.blf", messages)
    assert fates(log) == {Fate.USED: 1000, Fate.OTHER_SENDER: 10}
    assert not log.frames.is_sent[log.allotment.keys[0x100, False]].any()
    assert "10 frames (channel 1, sent by the logger) have other data" in findings(log)[0]


@pytest.mark.parametrize("first_is_late", [False, True])
def test_of_a_frame_and_its_copy_the_first_counts(first_is_late: bool, tmp_path: Path) -> None:
    """The delay of a gateway, 12 ms, is longer than the period, and the copies may be on the first channel."""
    late, soon = (0, 1) if first_is_late else (1, 0)
    messages = [message(0.01 * k, k, channel=soon) for k in range(100)]
    messages += [message(0.01 * k + 0.012, k, channel=late) for k in range(100)]
    log = opened(tmp_path / "drive.blf", messages)
    assert fates(log) == {Fate.USED: 100, Fate.COPY: 100}
    np.testing.assert_allclose(log.frames.time[log.allotment.keys[0x100, False]], 0.01 * np.arange(100), atol=1e-6)
    assert "12 ms later" in findings(log)[0]


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("frames_each", [3, 50])
def test_a_late_copy_of_data_that_change_slowly_is_no_original(late: int, frames_each: int, tmp_path: Path) -> None:
    """Each copy comes 12 ms late, and so 8 ms before the next frame of the original, which has the same data."""
    original = [message(0.02 * k, k // frames_each, channel=1 - late) for k in range(400)]
    copies = [message(0.02 * k + 0.012, k // frames_each, channel=late) for k in range(400)]
    log = opened(tmp_path / "drive.blf", [*original, *copies])
    assert fates(log) == {Fate.USED: 400, Fate.COPY: 400}
    np.testing.assert_allclose(log.frames.time[log.allotment.keys[0x100, False]], 0.02 * np.arange(400), atol=1e-6)
    assert "12 ms later" in findings(log)[0]


@pytest.mark.parametrize("every", [1, 2])
def test_a_gateway_may_leave_out_frames(every: int, tmp_path: Path) -> None:
    original = [message(0.01 * k, k) for k in range(0, 300)]
    log = opened(tmp_path / "drive.blf", [*original, *(message(0.01 * k + 0.007, k, channel=1) for k in range(0, 300, every))])
    assert fates(log) == {Fate.USED: 300, Fate.COPY: 300 // every}
    assert "7 ms later" in findings(log)[0]


PARTS = {
    "half": lambda k: k % 2 == 0,
    "third": lambda k: k % 3 == 0,
    "sparse": lambda k: k % 100 == 0,
    "begin": lambda k: k < 500,
    "end": lambda k: k >= 500,
    "gap": lambda k: not 400 <= k < 700,
}


def gateway(part: str, frames_each: int, *, of_original: bool) -> list[can.Message]:
    """Return 10 s of frames on the second channel and their copies, 12 ms later, on the first; of one of them only a part."""
    of = {1: PARTS[part] if of_original else bool, 0: bool if of_original else PARTS[part]}
    numbers = {channel: [k for k in range(1000) if of[channel] is bool or of[channel](k)] for channel in of}
    return [message(0.01 * k + 0.012 * (1 - at), k // frames_each, channel=at) for at in of for k in numbers[at]]


@pytest.mark.parametrize("frames_each", [1, 50])
@pytest.mark.parametrize("part", PARTS)
def test_a_part_of_the_copies_does_not_matter(part: str, frames_each: int, tmp_path: Path) -> None:
    log = opened(tmp_path / "drive.log", gateway(part, frames_each, of_original=False))
    if (part, frames_each) == ("sparse", 50):  # ten frames of data that change twice a second have no clear order
        assert "which of them are the copies cannot be determined" in findings(log)[0]
        return
    assert fates(log)[Fate.USED] == 1000
    np.testing.assert_allclose(log.frames.time[log.allotment.keys[0x100, False]], 0.01 * np.arange(1000), atol=1e-6)


@pytest.mark.parametrize("frames_each", [1, 50])
@pytest.mark.parametrize("part", PARTS)
def test_an_original_that_covers_only_a_part_needs_a_choice(part: str, frames_each: int, tmp_path: Path) -> None:
    """Neither the late copies nor a part of the drive are used without a word."""
    log = opened(tmp_path / "drive.log", gateway(part, frames_each, of_original=True))
    assert set(fates(log)) == {Fate.CONFLICT}
    what, remedy = log.allotment.conflicts[0x100, False]
    assert "have the same data" in what
    assert remedy.startswith("choose a bus with `channel='can0' or 'can1'`")
    if frames_each == 1:
        assert what.endswith("; those of channel can1 are 12 ms earlier, but cover only a part of the others")
    if part == "begin":
        assert "1000 frames (channel can0, received, 0.01 to 10.00 s) and 500 frames (channel can1, received, 0.00 to" in what


def test_frames_of_two_buses_at_different_times_need_a_choice(tmp_path: Path) -> None:
    messages = [message(0.01 * k, k, channel=int(k >= 500)) for k in range(1000)]
    what, _ = opened(tmp_path / "drive.log", messages).allotment.conflicts[0x100, False]
    assert what.endswith("have no time in common")


@pytest.mark.parametrize("late_s", [0.0005, 0.012])
def test_of_one_channel_the_sender_with_most_frames_counts(late_s: float, tmp_path: Path) -> None:
    """A logger notes only some of the frames that it sends."""
    messages = [message(0.01 * k + late_s, k) for k in range(200)] + [
        message(0.01 * k, k, is_rx=False) for k in range(0, 200, 3)
    ]
    log = opened(tmp_path / "drive.blf", messages)
    assert fates(log) == {Fate.USED: 200, Fate.COPY: 67}
    assert not log.frames.is_sent[log.allotment.keys[0x100, False]].any()


def test_copies_of_data_that_repeat_need_a_choice(tmp_path: Path) -> None:
    """Data of a counter from 0 to 3 are 12 ms late or 28 ms early."""
    messages = [message(0.01 * k + 0.012 * channel, k % 4, channel=channel) for k in range(200) for channel in (0, 1)]
    log = opened(tmp_path / "drive.blf", messages)
    assert fates(log) == {Fate.CONFLICT: 400}
    what, remedy = log.allotment.conflicts[0x100, False]
    assert what.endswith("have the same data, and which of them are the copies cannot be determined")
    assert remedy.startswith("choose a bus with `channel='1' or '2'`")
    of_bus = [
        message(0.01 * k + 0.0002 * (k % 3 - 1) * channel, k % 4, channel=channel) for k in range(200) for channel in (0, 1)
    ]
    assert fates(opened(tmp_path / "one.blf", of_bus)) == {Fate.USED: 200, Fate.COPY: 200}


def test_data_that_stay_are_no_copy_of_data_that_change(tmp_path: Path) -> None:
    """A gateway that lost its source repeats the last value; for most of the time the original has it too."""
    messages = [message(0.01 * k, max(k - 900, 0)) for k in range(1000)] + [message(0.01 * k, 0, channel=1) for k in range(999)]
    assert fates(opened(tmp_path / "drive.blf", messages)) == {Fate.CONFLICT: 1999}
    same = [message(0.01 * k + 0.003 * channel, 5, channel=channel) for k in range(50) for channel in (0, 1)]
    assert fates(opened(tmp_path / "same.blf", same)) == {Fate.USED: 50, Fate.COPY: 50}


def test_a_node_that_hears_itself_is_plain(tmp_path: Path) -> None:
    messages = [message(0.01 * k + (0.001 if heard else 0.0), k, is_rx=heard) for k in range(50) for heard in (False, True)]
    log = opened(tmp_path / "drive.blf", messages)
    assert fates(log) == {Fate.USED: 50, Fate.COPY: 50}
    assert log.frames.is_sent[log.allotment.keys[0x100, False]].all()
    assert findings(log) == []


def test_two_buses_with_one_identifier_need_a_choice(tmp_path: Path) -> None:
    """Both are mostly at rest: equal data that do not change are no sign of a copy."""
    rest = [message(0.01 * k, 0, channel=channel) for k in range(100) for channel in (0, 1)]
    moving = [message(1.0 + 0.01 * k, k, channel=0) for k in range(20)] + [
        message(1.0 + 0.01 * k, -k, channel=1) for k in range(40)
    ]
    log = opened(tmp_path / "drive.log", [*rest, *moving])
    assert fates(log) == {Fate.CONFLICT: 260}
    assert log.allotment.conflicts[0x100, False][1].startswith("choose a bus with `channel='can1' or 'can0'`")
    chosen = open_bus_log(tmp_path / "drive.log", KNOWN, "can0")
    assert fates(chosen) == {Fate.USED: 120, Fate.OTHER_CHANNEL: 140}
    with pytest.raises(CodegenError, match="no channel 'can2'; choose one of its channels with `channel=`: can0, can1"):
        open_bus_log(tmp_path / "drive.log", KNOWN, "can2")


@pytest.mark.parametrize("is_extended", [False, True])
def test_an_identifier_of_the_other_length_is_a_finding(is_extended: bool, tmp_path: Path) -> None:
    path = write(tmp_path / "drive.blf", [message(0.01 * k, k, is_extended_id=is_extended) for k in range(20)])
    log = open_bus_log(path, Identifiers({(0x100, not is_extended): "Motion"}))
    bits = "29 bits in the log and 11" if is_extended else "11 bits in the log and 29"
    assert findings(log) == [f"the identifier 0x100 has {bits} in the databases"]
    both = Identifiers({(0x100, not is_extended): "Motion", (0x100, is_extended): "Other"})
    assert findings(open_bus_log(path, both)) == []


# --- clocks --------------------------------------------------------------------------------------------------------------

ASC_HEAD = "date Sat Jan 1 00:00:00.000 2000\nbase hex  timestamps {clock}\ninternal events logged\n"


def asc(path: Path, lines: list[str], clock: str = "absolute") -> Path:
    path.write_text(ASC_HEAD.format(clock=clock) + "".join(f"{line}\n" for line in lines), encoding="ascii")
    return path


def test_relative_stamps_of_an_asc_are_added_up(tmp_path: Path) -> None:
    """They count from the event before, whatever it is."""
    lines = [
        "0.000000 Start of measurement",
        "0.010000 1 100 Rx d 1 00",
        "0.004000 1 Statistic: D 0",
        "0.006000 1 100 Rx d 1 01",
    ]
    frames, account = read_frames(asc(tmp_path / "drive.asc", lines, "relative"))
    np.testing.assert_allclose(frames.time, [0.01, 0.02])
    assert account.clock == "time from the event before"
    assert dict(account.others) == {"Start": 1, "Statistic": 1}


@pytest.mark.parametrize("of_event", [False, True])
def test_relative_stamps_under_an_absolute_header_are_refused(of_event: bool, tmp_path: Path) -> None:
    """Taken as they are, the period of every message would be 0."""
    steps = [0.0] + [0.0002, 0.0098] * 20
    lines = [f"{step:.6f} 1 {0x100 + k % 2:X} Rx d 1 00" for k, step in enumerate(steps)]
    if of_event:
        lines[1::10] = ["0.000200 1 Statistic: D 0"] * len(lines[1::10])
    with pytest.raises(CodegenError, match=r"line 2: its stamps do not grow.*change `absolute` to `relative` there"):
        read_frames(asc(tmp_path / "drive.asc", lines))
    frames, _ = read_frames(asc(tmp_path / "drive.asc", lines, "relative"))
    assert frames.time[-1] == pytest.approx(0.2)


CLASSIC_LINE = "   0.020000 1  100             Rx   d 8 00 11 22 33 44 55 66 77"
FD_LINE = "   0.020000 CANFD   1 Rx        123                 Name   0 0 8  8 00 11 22 33 44 55 66 77   0    0     3000   0"


@pytest.mark.parametrize("line", [CLASSIC_LINE, FD_LINE, "   0.020000 1  ErrorFrame"])
@pytest.mark.parametrize("goes_on", [False, True])
def test_a_line_of_an_asc_that_is_cut_is_a_frame_that_is_not_read(line: str, goes_on: bool, tmp_path: Path) -> None:
    """It may go on with the line behind it, as a block of the file is missing. The sum closes wherever it is cut."""
    whole = "   0.010000 1  100             Rx   d 8 00 11 22 33 44 55 66 77"
    last_byte = line.rfind("77") + 1 if "77" in line else len(line) - 1
    for length in range(4, last_byte + 1):
        cut = line[:length] + ("" if goes_on else "\n") + whole
        frames, account = read_frames(asc(tmp_path / "drive.asc", [whole, cut]))
        assert account.in_file == (2 if goes_on else 3), cut
        assert len(frames) == account.in_file - 1
        ((reason, lost),) = account.skipped.items()
        assert (reason, lost) in {(reason, (1, "line 5")) for reason in ("its line is damaged", "fewer bytes than its length")}
        assert not account.others


def test_events_that_are_no_frames_are_not_damaged(tmp_path: Path) -> None:
    lines = [
        "0.010000 CAN 1 Status:chip status error active",
        "0.010000 J1939TP FEE3p 6 0 0 - Rx d 23 A0 0F A6 60 3B D1 40 1F DE 80",
        "0.010000 1  Statistic: D 0 R 0 XD 18 XR 0 E 0 O 0 B 0.04%",
        "0.010000 log trigger event",
        "// 5 1 100 Rx d 1 00",
        "0.010000 1  100  TxRq d 1 00",
        "0.010000 1  100  Rx   d 1 0 Length = 0 BitCount = 64",
        "0.020000 1  100  Rx   r 8",
        "0.030000 1  100  Rx   d 0",
    ]
    frames, account = read_frames(asc(tmp_path / "drive.asc", lines))
    assert (len(frames), account.in_file, dict(account.skipped)) == (3, 3, {})
    assert account.others == {"Status": 1, "J1939TP": 1, "Statistic": 1, "log": 1, "transmit request": 1}


def test_a_frame_before_the_start_of_the_measurement_is_read(tmp_path: Path) -> None:
    frames, account = read_frames(asc(tmp_path / "drive.asc", ["-0.010000 1 100 Rx d 1 00", "0.010000 1 100 Rx d 1 01"]))
    assert frames.time.tolist() == [-0.01, 0.01]
    assert account.in_file == account.read == 2


@pytest.mark.parametrize("head", ["date Sam janv. 1 00:00:00.000 2000\n", "a log of a bench\n", "\n", ""])
def test_the_base_of_an_asc_counts_whatever_stands_above_it(head: str, tmp_path: Path) -> None:
    path = tmp_path / "drive.asc"
    trigger = "Begin Triggerblock Sam janv. 1 00:00:00.000 2000\n"
    path.write_text(f"{head}Base DEC  timestamps absolute\n{trigger}0.5 1 256 Rx d 2 10 16\n", encoding="ascii")
    frames, account = read_frames(path)
    assert (frames.identifier.tolist(), frames.data) == ([256], [b"\x0a\x10"])
    assert account.others == ({"line that is no event": 1} if head.startswith("a") else {})


def test_two_logs_of_different_bases_in_one_are_refused(tmp_path: Path) -> None:
    path = asc(tmp_path / "drive.asc", ["0.5 1 100 Rx d 1 10", "base dec  timestamps absolute", "0.6 1 100 Rx d 1 10"])
    with pytest.raises(CodegenError, match="line 5: the base of its numbers becomes dec"):
        read_frames(path)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("drive.asc", "0,500 1 100 Rx d 1 10\n", "line 1: a frame has an invalid time, 0,500; export it with decimal points"),
        ("drive.asc", ";$FILEVERSION=1.1\n 1) 0.5 Rx 0100 1 10\n", r"no line is an event \(first: line 1: ;\$FILEVERSION"),
        ("drive.asc", "\ufeff0.5 1 100 Rx d 1 10\n".encode("utf-16-le"), "it is in UTF-16"),
        ("drive.log", " (0.5)  can0  100   [2]  11`22\n", "its bytes are swapped; log without -S"),
        ("drive.log", " (0.5)  can0  100   [1]  00010001\n", "its bytes are binary digits; log without -i"),
    ],
)
def test_what_is_wrong_with_a_text_log_is_named(name: str, text: str | bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(CodegenError, match=words):
        read_frames(tmp_path / name)


def test_options_of_candump(tmp_path: Path) -> None:
    """Causes below an error frame, lost frames, colours, lengths of 9 to 15, and a frame of CAN XL."""
    path = tmp_path / "drive.log"
    lines = [
        " (0.5)  can0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME",
        "\tcontroller-problem{rx-overflow}",
        " \x1b[31m(0.6)\x1b[0m  can0  100   [2]  11 22",
        " (0.7)  can0  100   {E}  11 22 33 44 55 66 77 88",
        "DROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 3)",
        "(0.8) can0 100#1122334455667788_E",
        "(0.9) can0 123#81:00:12345678#11223344.556677",
    ]
    path.write_text("".join(f"{line}\n" for line in lines), encoding="ascii")
    log = open_bus_log(path, KNOWN)
    whole = bytes.fromhex("1122334455667788")
    assert [data for data, kind in zip(log.frames.data, log.frames.kind, strict=True) if kind == 0] == [whole[:2], whole, whole]
    assert (log.file.in_file, log.file.read, log.file.others) == (5, 4, {"frame that the logger dropped": 3})
    assert findings(log) == [
        "1 of 5 frames are not read: a frame of CAN XL (first: line 7)",
        "the logger dropped 3 frames",
    ]


def test_damaged_lines_of_candump_are_skipped_with_their_reason(tmp_path: Path) -> None:
    """python-can reads half a byte, data beyond those of a classic frame, and identifiers of any length."""
    lines = [
        "100#1122334455667788",
        "100#112",
        "100#112233445566778899",
        "1FFFFFFFF#11",
        "100##1112233445566778899AABBCC",
        "100#",
    ]
    path = tmp_path / "drive.log"
    path.write_text("".join(f"({k}.5) can0 {line}\n" for k, line in enumerate(lines)), encoding="ascii")
    frames, account = read_frames(path)
    assert [len(data) for data in frames.data] == [8, 12, 0]
    assert (account.in_file, account.read) == (6, 3)
    assert account.skipped == {
        "its data end within a byte": (1, "line 2"),
        "over 8 bytes in a classic frame": (1, "line 3"),
        "an identifier of over 8 digits": (1, "line 4"),
    }


@pytest.mark.parametrize("view", [False, True])
def test_differences_in_a_candump_are_added_up(view: bool, tmp_path: Path) -> None:
    steps = [0.0] + [0.001, 0.019] * 10
    form = " ({:010.6f})  can0  100   [1]  0{:X}\n" if view else "({:010.6f}) can0 100#0{:X}\n"
    (tmp_path / "drive.log").write_text("".join(form.format(step, k % 16) for k, step in enumerate(steps)), encoding="ascii")
    frames, account = read_frames(tmp_path / "drive.log")
    np.testing.assert_allclose(frames.time, np.cumsum(steps))
    assert account.clock == "time from the frame before"


@pytest.mark.parametrize(
    ("stamps", "are_added"),
    [
        ([0.0, 0.01, 0.01], True),
        ([0.0, 0.01, 0.009, 0.011, 0.01], True),
        ([0.0, 0.01, 0.02, 0.02], False),
        ([0.0, 0.01, 0.009, 0.02, 0.019, 0.03], False),
        ([5.0, 0.01, 0.01], False),
    ],
)
def test_differences_of_few_frames_begin_with_zero(stamps: list[float], are_added: bool, tmp_path: Path) -> None:
    text = "".join(f"({stamp:010.6f}) can{k % 2} 100#00\n" for k, stamp in enumerate(stamps))
    (tmp_path / "drive.log").write_text(text, encoding="ascii")
    np.testing.assert_allclose(read_frames(tmp_path / "drive.log")[0].time, np.cumsum(stamps) if are_added else stamps)


def test_frames_out_of_order_are_no_differences(tmp_path: Path) -> None:
    """Two buses whose frames are written one after the other go back at every second frame."""
    stamps = [1.7e9 + 0.01 * k + late for k in range(50) for late in (0.009, 0.0)]
    text = "".join(f"({stamp:.6f}) can{k % 2} 100#00\n" for k, stamp in enumerate(stamps))
    (tmp_path / "drive.log").write_text(text, encoding="ascii")
    frames, account = read_frames(tmp_path / "drive.log")
    assert account.clock == "Unix time"
    np.testing.assert_allclose(frames.time, stamps)


# --- text ----------------------------------------------------------------------------------------------------------------


def test_the_view_of_candump_is_read(tmp_path: Path) -> None:
    lines = [
        " (1700000000.000000)  can0  100   [8]  20 1C 00 00 00 00 00 00   ' .......'",
        " (2023-11-14 22:13:20.500000)  can0  TX - -  18F0090B   [2]  01 02",
        " (1700000001.000000)  can1  100  [12]  00 01 02 03 04 05 06 07 08 09 0A 0B",
        " (1700000002.000000)  can0  100   [4]  remote request",
    ]
    (tmp_path / "drive.log").write_text("\n".join(lines) + "\n", encoding="ascii")
    frames, account = read_frames(tmp_path / "drive.log")
    assert frames.time.tolist() == [1.7e9, 1.7e9 + 0.5, 1.7e9 + 1.0, 1.7e9 + 2.0]
    assert frames.identifier.tolist() == [0x100, 0x18F0090B, 0x100, 0x100]
    assert frames.is_sent.tolist() == [False, True, False, False]
    assert frames.is_extended.tolist() == [False, True, False, False]
    assert frames.is_fd.tolist() == [False, False, True, False]
    assert [len(data) for data in frames.data] == [8, 2, 12, 0]
    assert account.form == "candump, view"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("  can0  100   [1]  20", "its frames have no times; log with candump -l, or -t a"),
        ("(x) can0 100#00", "a frame has an invalid time, x"),
        ("hello", "not a readable log of a CAN bus: no frame of candump, 'hello'"),
    ],
)
def test_what_is_no_log_of_candump_is_refused_with_its_line(line: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "drive.log").write_text(f"(1.0) can0 100#00\n{line}\n", encoding="ascii")
    with pytest.raises(CodegenError) as error:
        read_frames(tmp_path / "drive.log")
    assert message in str(error.value)
    assert "drive.log, line 2" in str(error.value)


def test_an_asc_in_windows_1252_is_read(tmp_path: Path) -> None:
    path = asc(tmp_path / "drive.asc", ["0.01 1 100 Rx d 1 07"])
    path.write_bytes(b"// Pr\xfcfstand \x80\n" + path.read_bytes())
    assert read_frames(path)[0].data == [b"\x07"]


def test_frames_that_python_can_does_not_return_are_counted(tmp_path: Path) -> None:
    lines = ["0.01 1 EngineData Rx d 1 07", "0.02 1 100 Rx d 2 07", "0.03 1 100 Rx d 1 07", "0.03 1 100 TxRq d 1 07"]
    frames, account = read_frames(asc(tmp_path / "drive.asc", lines))
    assert (account.in_file, account.read, len(frames)) == (3, 1, 1)
    assert dict(account.skipped) == {
        "its identifier is a name; log numbers": (1, "line 4"),
        "fewer bytes than its length": (1, "line 5"),
    }
    assert dict(account.others) == {"transmit request": 1}
    log = open_bus_log(tmp_path / "drive.asc", KNOWN)
    assert findings(log)[0] == "1 of 3 frames are not read: its identifier is a name; log numbers (first: line 4)"


def test_the_first_line_of_an_asc_without_a_head_is_read(tmp_path: Path) -> None:
    (tmp_path / "drive.asc").write_text("0.01 1 100 Rx d 1 07\n0.02 1 100 Rx d 1 08\n", encoding="ascii")
    assert read_frames(tmp_path / "drive.asc")[1].read == 2


# --- BLF -----------------------------------------------------------------------------------------------------------------


def blf(path: Path, count: int = 5) -> tuple[bytes, bytes]:
    """Write a BLF without compression; return its head and the objects of its container."""
    with can.BLFWriter(path, compression_level=0) as log:
        for k in range(count):
            log.on_message_received(message(1.7e9 + k, k))
    content = path.read_bytes()
    return content[:144], content[144 + 32 :]


def test_objects_with_an_unknown_header_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "drive.blf"
    blf(path)
    data = bytearray(path.read_bytes())
    second = data.index(b"LOBJ", data.index(b"LOBJ", data.index(b"LOBJ") + 4) + 4)
    data[second + 6 : second + 8] = struct.pack("<H", 3)  # version of the header
    path.write_bytes(data)
    frames, account = read_frames(path)
    assert (account.in_file, account.read, len(frames)) == (5, 4, 4)
    assert dict(account.skipped) == {"object header of version 3, which is not known": (1, "object 1")}


def test_objects_outside_of_containers_are_read(tmp_path: Path) -> None:
    head, objects = blf(tmp_path / "drive.blf")
    (tmp_path / "drive.blf").write_bytes(head + objects)
    size = struct.pack("<Q", len(head + objects))
    (tmp_path / "drive.blf").write_bytes(head[:16] + size + head[24:] + objects)
    frames, account = read_frames(tmp_path / "drive.blf")
    assert account.read == 5
    np.testing.assert_allclose(frames.time, 1.7e9 + np.arange(5), atol=1e-6)
    assert frames.data == [struct.pack("<q", k) for k in range(5)]


def test_an_object_over_two_containers_is_read(tmp_path: Path) -> None:
    head, objects = blf(tmp_path / "drive.blf")
    parts = [objects[:70], objects[70:]]
    containers = b"".join(
        struct.pack("<4sHHLLH6xL4x", b"LOBJ", 16, 1, 32 + len(part), 10, 0, len(part)) + part + bytes(len(part) % 4)
        for part in parts
    )
    size = struct.pack("<Q", len(head + containers))
    (tmp_path / "drive.blf").write_bytes(head[:16] + size + head[24:] + containers)
    assert read_frames(tmp_path / "drive.blf")[1].read == 5


def test_a_container_of_zeros_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    import zlib

    head, _ = blf(tmp_path / "drive.blf")
    packed = zlib.compress(bytes(2**27))
    container = struct.pack("<4sHHLLH6xL4x", b"LOBJ", 16, 1, 32 + len(packed), 10, 2, 2**16) + packed
    (tmp_path / "drive.blf").write_bytes(head[:16] + bytes(8) + head[24:] + container)
    with pytest.raises(CodegenError, match="a container of more than 67108864 bytes"):
        read_frames(tmp_path / "drive.blf")

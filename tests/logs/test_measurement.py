"""The account of a measurement: every row is read or skipped with a reason, every sample is a number or has a reason."""

import dataclasses
import re
from pathlib import Path

import asammdf
import numpy as np
import pandas as pd
import pytest

from codegen.errors import CodegenError
from codegen.importing.rows import Count, Group
from codegen.logs.account import BusLog, open_log, to_dict
from codegen.logs.databases import Databases
from codegen.logs.measurement import Account, open_measurement
from tests.importing.conftest import in_this_process

__all__ = ["in_this_process"]

NONE = Databases(())

CSV = """# a bench
time_s;vx;yaw;gear

s;m/s;rad/s;-
0.0;20;0.1;D
0.1;20;;D
0.1;21;0.1;1
;22;0.1;2
0.05;;n/a;3
;;;
# the end
"""
COUNTS = [
    Count("vx [m/s]", "", 0, 4, {"no value": 1}),
    Count("yaw [rad/s]", "", 0, 3, {"no value": 2}),
    Count("gear", "", 0, 3, {"a text": 2}),
]


def account(path: Path, **options: str) -> Account:
    found = open_log(path, NONE, **options)
    assert isinstance(found, Account)
    return found


def write(folder: Path, text: str) -> Path:
    (folder / "drive.csv").write_text(text, encoding="utf-8")
    return folder / "drive.csv"


def test_rows_of_a_table_of_text(tmp_path: Path) -> None:
    found = account(write(tmp_path, CSV))
    assert found.others == {"empty line": 2, "comment": 2, "line of names": 1, "line of units": 1}
    assert found.groups == [Group("", 5, {"no time": (1, "line 8")}, 0.0, pytest.approx(0.1), 1, 1)]
    assert found.channels == COUNTS
    assert found.clock == "time from the start of the log"
    assert found.findings == ["1 of 5 rows are not read: no time (first: line 8)"]
    assert found.channel_findings == ["1 stamps go back", "1 stamps repeat another one"]


def test_only_the_columns_that_are_read_are_counted(tmp_path: Path) -> None:
    measurement = open_measurement(write(tmp_path, CSV))
    assert measurement is not None
    (samples,), found = measurement.read([2])
    assert samples.values.tolist() == [0.1, 0.1, 0.1]
    assert found.channels == COUNTS[1:2]
    assert found.groups[0].rows == 5


def test_rows_of_parquet(tmp_path: Path) -> None:
    columns = {"t": [0.0, 0.1, None], "vx": [20.0, None, 21.0], "gear": ["D", "D", "1"], "wheels": [[1.0], [2.0], [3.0]]}
    pd.DataFrame(columns).to_parquet(tmp_path / "drive.parquet")
    found = account(tmp_path / "drive.parquet")
    assert found.groups == [Group("", 3, {"no time": (1, "row 3")}, 0.0, pytest.approx(0.1))]
    assert found.channels == [
        Count("vx", "", 0, 2, {"no value": 1}),
        Count("gear", "", 0, 0, {"a text": 3}),
        Count("wheels", "", 0, 0, {"an array": 3}),
    ]
    assert found.channel_findings == ["channels without a number: gear, wheels"]


def mf4(path: Path) -> Path:
    time = np.array([0.0, 0.1, 0.1, 0.05, 0.2])
    invalid = np.array([False, True, False, False, False])
    degrees = asammdf.Signal(np.arange(3.0), np.arange(3.0), name="torque", unit="Nm", master_metadata=("crank", 2))
    with asammdf.MDF(version="4.10") as mdf:
        mdf.append(
            [
                asammdf.Signal(np.array([1.0, 2.0, np.nan, 4.0, 5.0]), time, name="vx", unit="m/s", invalidation_bits=invalid),
                asammdf.Signal(np.array([b"SNA", b"1", b"2", b"3", b"4"]), time, name="gear", encoding="utf-8"),
            ],
            acq_name="ESP",
        )
        mdf.append([asammdf.Signal(np.array([]), np.array([]), name="ay", unit="m/s^2")])
        mdf.append([degrees], acq_name="Engine")
        mdf.save(path, overwrite=True)
    return path


@pytest.mark.usefixtures("in_this_process")
def test_rows_of_an_mf4(tmp_path: Path) -> None:
    """Those of a group over the crank angle have no time; asammdf would return angles as seconds."""
    path = mf4(tmp_path / "drive.mf4")
    found = account(path)
    why = "their stamps are angles, not times"
    assert found.groups == [
        Group("ESP", 5, {}, 0.0, pytest.approx(0.2), 1, 1),
        Group("", 0),
        Group("Engine", 3, {why: (3, "group 2")}),
    ]
    assert found.channels == [
        Count("ESP.vx", "m/s", 0, 3, {"marked as invalid": 1, "no value": 1}),
        Count("ESP.gear", "", 0, 4, {"a text": 1}),
        Count("ay", "m/s^2", 1, 0),
    ]
    assert found.findings == [f"3 of 3 rows of group Engine are not read: {why} (first: group 2)"]
    measurement = open_measurement(path)
    assert measurement is not None
    assert [column.path for column in measurement.columns] == ["ESP.vx", "ESP.gear", "ay"]
    (samples,), read = measurement.read([measurement.columns[2].place])
    assert samples.values.size == 0
    assert read.groups[0].skipped == {"no channel of their group is used": (5, "group 0")}
    assert read.findings == found.findings, "what is not used is plain"


@pytest.mark.usefixtures("in_this_process")
def test_a_bus_without_frames_of_data_is_no_measurement(tmp_path: Path) -> None:
    with asammdf.MDF(version="4.10") as mdf:
        mdf.append([asammdf.Signal(np.zeros(3), np.arange(3.0), name="CAN_ErrorFrame")])
        mdf.save(tmp_path / "drive.mf4", overwrite=True)
    found = open_log(tmp_path / "drive.mf4", NONE)
    assert isinstance(found, BusLog)
    assert dict(found.file.skipped) == {"its group is not marked as bus events": (3, "group 0")}


def test_the_account_of_every_channel_closes(tmp_path: Path) -> None:
    found = account(write(tmp_path, CSV))
    lost = [dataclasses.replace(found.channels[0], samples=3), *found.channels[1:]]
    with pytest.raises(CodegenError, match=r"vx \[m/s\]: its account does not close: 5 rows, 3 samples"):
        dataclasses.replace(found, channels=lost)


@pytest.mark.parametrize(
    ("stamps", "clock"),
    [
        (0.01 * np.arange(30), "time from the start of the log"),
        (1.7e9 + 0.01 * np.arange(30), "Unix time"),
        (0.01 * np.arange(30)[::-1], "time from the start of the log"),
        (np.tile([0.01, 0.011], 15), "time from the row before"),
    ],
)
def test_the_kind_of_the_clock(stamps: np.ndarray, clock: str, tmp_path: Path) -> None:
    found = account(write(tmp_path, "t,vx\n" + "".join(f"{stamp:.3f},20\n" for stamp in stamps)))
    assert found.clock == to_dict(found)["clock"] == clock
    assert len(found.findings) == (clock == "time from the row before")


def test_the_column_of_the_time_can_be_named(tmp_path: Path) -> None:
    path = write(tmp_path, "when,vx\n0,20\n10,20\n")
    with pytest.raises(CodegenError, match="no column is called time"):
        account(path)
    assert account(path, time="when", time_unit="ms").groups[0].duration_s == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("head", "options", "seconds"),
    [
        ("time;vx\nmin;m/s", {}, 60.0),
        ("time;vx\nh;m/s", {}, 3600.0),
        ("time;vx\nseconds;m/s", {}, 1.0),
        ("Time;vx\n(µs);m/s", {}, 1e-6),
        ("Time [μs];vx", {}, 1e-6),
        ("time_ms;vx", {}, 1e-3),
        ("t in ms;vx", {}, 1e-3),
        ("clock [min];vx", {"time": "clock [min]"}, 60.0),
        ("clock_ms;vx", {"time": "clock_ms"}, 1e-3),
        ("clock [ticks];vx", {"time": "clock [ticks]", "time_unit": "us"}, 1e-6),
        ("the_clock;vx", {"time": "the_clock"}, 1.0),
    ],
)
def test_the_unit_of_the_time(tmp_path: Path, head: str, options: dict[str, str], seconds: float) -> None:
    found = account(write(tmp_path, f"{head}\n0;20\n1;21\n2;22\n"), **options)
    assert found.groups[0].duration_s == pytest.approx(2.0 * seconds)


@pytest.mark.parametrize(
    ("head", "options", "words"),
    [
        ("time [s];vx\nms;m/s", {}, "line 2: ms under the name 'time [s]'"),
        ("time;vx\nticks;m/s", {}, "'ticks' is no known unit of a time"),
        ("time [cycles];vx", {}, "'cycles' is no known unit of a time"),
        ("clock [days];vx", {"time": "clock [days]"}, "'days' is no known unit of a time"),
    ],
)
def test_an_unclear_unit_of_the_time_is_refused(tmp_path: Path, head: str, options: dict[str, str], words: str) -> None:
    with pytest.raises(CodegenError, match=re.escape(words)):
        account(write(tmp_path, f"{head}\n0;20\n1;21\n2;22\n"), **options)


@pytest.mark.usefixtures("in_this_process")
def test_stamps_of_an_mf4_in_milliseconds(tmp_path: Path) -> None:
    with asammdf.MDF(version="4.10") as mdf:
        mdf.append([asammdf.Signal(np.arange(3.0), np.array([0.0, 20.0, 40.0]), name="vx", unit="m/s")])
        mdf.groups[0].channels[0].unit = "ms"
        mdf.save(tmp_path / "drive.mf4")
    assert account(tmp_path / "drive.mf4").groups[0].duration_s == pytest.approx(0.04)
    measurement = open_measurement(tmp_path / "drive.mf4")
    assert measurement is not None
    (samples,), _ = measurement.read([measurement.columns[0].place])
    assert samples.time == pytest.approx([0.0, 0.02, 0.04])


@pytest.mark.usefixtures("in_this_process")
def test_an_older_mdf_is_named_as_such(tmp_path: Path) -> None:
    with asammdf.MDF(version="3.30") as mdf:
        mdf.append([asammdf.Signal(np.arange(3.0), np.arange(3.0), name="vx", unit="m/s")])
        written = mdf.save(tmp_path / "drive.mdf")
    with pytest.raises(CodegenError, match=r"an MDF of version 3\.30; only version 4 is read"):
        account(Path(written).rename(tmp_path / "drive.mf4"))


def test_another_format_is_named_as_such(tmp_path: Path) -> None:
    (tmp_path / "drive.trc").write_text(";$FILEVERSION=1.1\n", encoding="ascii")
    with pytest.raises(
        CodegenError, match=r"drive\.trc: not a log; give \.mf4, \.blf, \.asc, \.log \(candump\), \.csv or \.parquet"
    ):
        open_log(tmp_path / "drive.trc", NONE)


def test_options_of_a_bus_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CodegenError, match="it is not the log of a bus; leave `dbc=` and `channel=` out"):
        open_log(write(tmp_path, CSV), NONE, "can0")

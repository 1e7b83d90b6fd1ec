"""Logs of every format, written by independent libraries, give the signals that went into them."""

import shutil
from pathlib import Path

import asammdf
import cantools
import numpy as np
import pandas as pd
import pytest

from codegen.errors import CodegenError
from codegen.identify.channels import NOT_AVAILABLE
from codegen.identify.drive import Drive
from codegen.identify.names import Names, SignalChoice
from codegen.identify.reading import read_drives
from hil_sim.codec import Frame
from hil_sim.logs import BusLog
from tests.cli.conftest import TRACKING as BUILD
from tests.identify import made
from tests.identify.made import PERIODS, RESOLUTION, SIGNALS, frames, interpolation_error, write_bus


def check(drive: Drive, periods: dict[str, float], rounding: dict[str, float] | None = None) -> None:
    """Compare a drive with SIGNALS: half a step of the resolution, and the error of linear interpolation."""
    assert drive.signals.keys() == SIGNALS.keys()
    for key, wave in SIGNALS.items():
        tolerance = 0.5 * (rounding or {}).get(key, 0.0) + interpolation_error(key, periods[key]) + 1e-9
        has_value = np.isfinite(drive.signals[key])
        # The first and last slow samples are up to a period away from the ends.
        assert np.count_nonzero(~has_value) <= 2 * periods[key] / 0.01 + 1, key
        error = np.abs(drive.signals[key] - wave(drive.time))[has_value]
        assert error.max() <= tolerance, key


BUS_PERIODS = {
    **dict.fromkeys(("vx", "yaw_rate", "lateral_acceleration"), PERIODS["Motion"]),
    "steering_wheel_angle": PERIODS["Steering"],
    "delta_r": PERIODS["Rear"],
}


@pytest.mark.parametrize("ending", ["blf", "asc", "log", "mf4"])
def test_log_of_a_bus(ending: str, tmp_path: Path) -> None:
    path = write_bus(tmp_path / f"drive.{ending}", frames())
    reading = read_drives([path], [tmp_path / "car.dbc"])
    assert reading.findings == ()
    # Time stamps of candump and ASC have 1 us: 5 m/s^2 at 0.5 Hz change by 1.6e-5 m/s^2 in it.
    rounding = {key: value + 4e-6 * float(np.ptp(SIGNALS[key](np.linspace(0, 2, 99)))) for key, value in RESOLUTION.items()}
    check(reading.drives[0], BUS_PERIODS, rounding)
    assert reading.sources[0]["steering_wheel_angle"].channel == "Steering.SteeringWheelAngle"
    assert reading.sources[0]["delta_r"].samples == len(made.stamps("Rear"))


def test_measurement_in_mf4(tmp_path: Path) -> None:
    reading = read_drives([made.write_mf4(tmp_path / "drive.mf4")], names=Names(sampling_time_s=0.005))
    assert reading.findings == ()
    slow = ("steering_wheel_angle", "delta_r")
    check(reading.drives[0], {key: 0.02 if key in slow else 0.0 for key in SIGNALS})
    assert reading.sources[0]["delta_r"].channel == "EPS.RearAngle"


@pytest.mark.parametrize("form", ["csv", "semicolon", "parquet", "parquet with dates"])
def test_table(form: str, tmp_path: Path) -> None:
    table, path = made.table(), tmp_path / ("drive.parquet" if "parquet" in form else "drive.csv")
    if form == "parquet with dates":
        table = table.assign(time_s=pd.to_datetime(1.7e9 + table["time_s"], unit="s")).rename(columns={"time_s": "timestamp"})
    if "parquet" in form:
        table.to_parquet(path)
    else:
        table.to_csv(path, index=False, sep=";" if form == "semicolon" else ",", decimal="," if form == "semicolon" else ".")
    reading = read_drives([path])
    assert reading.findings == ()
    slow = ("steering_wheel_angle", "delta_r")
    # A float64 of Unix time has 0.24 us; see the test of the logs.
    rounding = {key: 2e-6 * float(np.ptp(SIGNALS[key](np.linspace(0, 2, 99)))) for key in SIGNALS}
    check(reading.drives[0], {key: 0.02 if key in slow else 0.01 for key in SIGNALS}, rounding)


def test_units_of_a_run_of_this_package_in_parquet(tmp_path: Path) -> None:
    from codegen.export import runs
    from codegen.sil.software import RECORD_COLUMNS

    record = np.zeros((50, len(RECORD_COLUMNS)))
    record[:, 0] = 0.01 * np.arange(50)
    record[:, RECORD_COLUMNS.index("speed_m_s")] = 20.0
    for name in ("run.csv", "run.parquet", "run.mf4"):
        runs.save(record, tmp_path / name)
        (drive,) = read_drives([tmp_path / name]).drives
        assert np.all(drive.signals["vx"] == 20.0), name
        assert {"delta_f", "delta_r", "delta_r_command", "sideslip"} < drive.signals.keys(), name


def test_arxml_gives_the_same_as_the_dbc(tmp_path: Path) -> None:
    from codegen.export.arxml import export

    database = cantools.database.load_file(BUILD / "ars.dbc")
    with BusLog(tmp_path / "bus.blf") as log:
        for number in range(100):
            for message in database.messages:
                values = dict.fromkeys((signal.name for signal in message.signals), 0)
                if message.name == "VehicleMotion":
                    values |= {"Speed": 20.0 + 0.005 * number, "YawRate": -0.002 * number, "FrontAngle": 0.001 * number}
                data = message.encode(values, strict=False)
                log.write(Frame(message.frame_id, bytes(data), 0.01 * number), True)
    folder = export(BUILD, "transformer")
    (tmp_path / "ars.arxml").write_bytes(folder.folder.files[folder.arxml])
    (by_dbc,) = read_drives([tmp_path / "bus.blf"], [BUILD / "ars.dbc"]).drives
    (by_arxml,) = read_drives([tmp_path / "bus.blf"], [tmp_path / "ars.arxml"]).drives
    assert by_dbc.signals.keys() == by_arxml.signals.keys()
    for key, values in by_dbc.signals.items():
        np.testing.assert_array_equal(values, by_arxml.signals[key], err_msg=key)
    np.testing.assert_allclose(by_dbc.signals["yaw_rate"], -0.002 * np.arange(100), atol=1e-4)  # half the resolution


def test_several_drives_with_names_of_their_own(tmp_path: Path) -> None:
    first = made.write_mf4(tmp_path / "one.mf4")
    (tmp_path / "two").mkdir()
    second = write_bus(tmp_path / "two" / "one.blf", frames())
    reading = read_drives([first, second], [tmp_path / "two" / "car.dbc"])
    assert [drive.name for drive in reading.drives] == ["one.mf4", "one.blf"]
    assert reading.drives[0].signals.keys() == reading.drives[1].signals.keys()
    copied = Path(shutil.copy(first, tmp_path / "two" / "one.mf4"))
    reading = read_drives([first, copied])
    assert [drive.name for drive in reading.drives] == [f"{tmp_path.name}/one.mf4", "two/one.mf4"]


@pytest.mark.parametrize(
    ("text", "is_reserved"),
    [
        ("SNA", True),
        ("Signal_not_available", True),
        ("N/A", True),
        ("SNA_1", True),
        ("ERR", True),
        ("InitValue", True),
        ("Sensor error", True),
        ("ungültig", True),
        ("Override", False),
        ("standstill", False),
        ("Antenna", False),
    ],
)
def test_names_of_reserved_values(text: str, is_reserved: bool) -> None:
    assert bool(NOT_AVAILABLE.search(text)) == is_reserved


def test_a_command_is_held_and_a_measurement_is_not(tmp_path: Path) -> None:
    table = made.table().rename(columns={"steering_wheel_angle_deg": "delta_r_command_deg"})
    table["delta_r_command_deg"] *= 0.1
    table["delta_f_deg"] = 1.0
    table.to_csv(tmp_path / "drive.csv", index=False)
    signals = read_drives([tmp_path / "drive.csv"]).drives[0].signals
    command, angle = signals["delta_r_command"], signals["delta_r"]
    np.testing.assert_array_equal(command[1:-1:2], command[0:-2:2])
    assert np.all(np.abs(angle[1:-1:2] - 0.5 * (angle[0:-2:2] + angle[2::2])) < 1e-12)


def test_a_line_of_units_with_that_of_the_time(tmp_path: Path) -> None:
    lines = ["time,VehicleSpeed,YawRate,SteeringWheelAngle", "ms,km/h,deg/s,deg"]
    lines += [f"{10 * k},72,{0.1 * k},{k}" for k in range(50)]
    (tmp_path / "drive.csv").write_text("\n".join(lines), encoding="ascii")
    reading = read_drives([tmp_path / "drive.csv"])
    assert reading.sources[0]["vx"].period == pytest.approx(0.01)
    np.testing.assert_allclose(reading.drives[0].signals["vx"], 20.0)


def test_an_unknown_unit_below_a_name_is_named(tmp_path: Path) -> None:
    lines = ["time,vx,yaw_rate,delta_f", "s,furlong,rad/s,rad", *(f"{0.01 * k:g},72,0.1,0.01" for k in range(50))]
    (tmp_path / "drive.csv").write_text("\n".join(lines), encoding="ascii")
    with pytest.raises(CodegenError, match="'furlong' is no unit for vx"):
        read_drives([tmp_path / "drive.csv"])
    names = Names.model_validate({"vx": {"signal": "vx", "unit": "km/h"}, "yaw_rate": {"signal": "yaw_rate"}})
    np.testing.assert_allclose(read_drives([tmp_path / "drive.csv"], (), names).drives[0].signals["vx"], 20.0)


@pytest.mark.parametrize("text", ["2024-05-06T07:08:09.5", "2024-05-06 07:08:09Z", "06.05.2024 07:08", "07:08:09.5", "8:09.5"])
def test_dates_and_times_of_the_day_in_a_table_are_named(text: str, tmp_path: Path) -> None:
    (tmp_path / "drive.csv").write_text(f"time,vx_m_s,yaw_rate_rad_s,delta_f_rad\n{text},20,0.1,0.01\n", encoding="ascii")
    with pytest.raises(CodegenError, match=r"line 2: '.*' is a date or a time of day; export times in seconds"):
        read_drives([tmp_path / "drive.csv"])


def test_durations_in_parquet(tmp_path: Path) -> None:
    table = made.table()
    table = table.assign(time=pd.to_timedelta(table["time_s"], unit="s")).drop(columns="time_s")
    table.to_parquet(tmp_path / "drive.parquet")
    assert read_drives([tmp_path / "drive.parquet"]).sources[0]["vx"].period == pytest.approx(0.01)


def test_an_optional_channel_without_samples_is_left_out(tmp_path: Path) -> None:
    lines = ["time_s,vx_m_s,yaw_rate_rad_s,delta_f_rad,lateral_acceleration_m_s2"]
    lines += [f"{0.01 * k:g},20,0.1,0.01," for k in range(50)]
    (tmp_path / "drive.csv").write_text("\n".join(lines), encoding="ascii")
    reading = read_drives([tmp_path / "drive.csv"])
    assert "lateral_acceleration" not in reading.sources[0]
    assert [finding.text for finding in reading.findings] == ["lateral_acceleration_m_s2 has 0 samples"]


def test_an_optional_channel_of_texts_in_mf4_is_left_out_and_a_needed_one_is_named(tmp_path: Path) -> None:
    time = np.arange(0.0, 1.0, 0.01)
    moving = {"vx": ("m/s", 20.0 + time), "yaw_rate": ("rad/s", np.sin(time)), "delta_f": ("rad", 0.1 * np.sin(time))}
    for key, expected in (("lateral_acceleration", None), ("yaw_rate", "0 samples for yaw_rate .yaw_rate has texts instead")):
        mdf = asammdf.MDF(version="4.10")
        mdf.append([asammdf.Signal(one, time, name=name, unit=unit) for name, (unit, one) in moving.items() if name != key])
        mdf.append([asammdf.Signal(np.array([b"error"] * time.size), time, name=key, encoding="utf-8")])
        mdf.save(tmp_path / "drive.mf4", overwrite=True)
        if expected:
            with pytest.raises(CodegenError, match=expected):
                read_drives([tmp_path / "drive.mf4"], names=Names.model_validate({key: {"signal": key, "unit": "rad/s"}}))
            continue
        reading = read_drives([tmp_path / "drive.mf4"], names=Names.model_validate({key: {"signal": key, "unit": "m/s^2"}}))
        assert key not in reading.sources[0]
        assert f"{key} has 0 samples ({key} has texts instead of numbers)" in [finding.text for finding in reading.findings]


def test_an_error_about_a_missing_signal_names_what_was_not_read(tmp_path: Path) -> None:
    path = write_bus(tmp_path / "drive.log", frames())
    text = (tmp_path / "car.dbc").read_text(encoding="utf-8")
    line = next(line for line in text.splitlines() if " VehicleSpeed " in line)
    zero = line[: line.index("(")] + "(0,0)" + line[line.index(")") + 1 :]
    (tmp_path / "car.dbc").write_text(text.replace(line, zero), encoding="utf-8")
    with pytest.raises(
        CodegenError, match=r"no signal is called vx or the like \(car\.dbc: 1 line is left out: its factor is 0"
    ):
        read_drives([path], [tmp_path / "car.dbc"])


def test_a_log_without_frames_is_named_as_such(tmp_path: Path) -> None:
    write_bus(tmp_path / "drive.log", frames())
    (tmp_path / "empty.log").write_text("\n", encoding="ascii")
    with pytest.raises(CodegenError, match="it has no frame that is read; give a log with frames"):
        read_drives([tmp_path / "empty.log"], [tmp_path / "car.dbc"])


def test_one_of_two_channels_of_one_name_can_be_chosen(tmp_path: Path) -> None:
    time = 0.01 * np.arange(200)
    with asammdf.MDF(version="4.10") as mdf:
        for name, unit, values in (
            ("vx", "m/s", 20.0 + time),
            ("yaw_rate", "rad/s", 0.1 * np.sin(time)),
            ("yaw_rate", "rad/s", 0.2 * np.sin(time)),
            ("delta_f", "rad", 0.01 * np.sin(time)),
        ):
            mdf.append([asammdf.Signal(values, time, name=name, unit=unit)])
        mdf.save(tmp_path / "drive.mf4")
    for choice in ({}, {"yaw_rate": SignalChoice(signal="yaw_rate")}):
        with pytest.raises(CodegenError, match=r"yaw_rate#1.*yaw_rate#2"):
            read_drives([tmp_path / "drive.mf4"], names=Names(**choice))
    for number, size in ((1, 0.1), (2, 0.2)):
        found = read_drives([tmp_path / "drive.mf4"], names=Names(yaw_rate=SignalChoice(signal=f"yaw_rate#{number}")))
        assert np.nanmax(found.drives[0].signals["yaw_rate"]) == pytest.approx(size, rel=1e-3)

"""Names of the signals: obvious ones, names.toml, and errors that contain the line to write."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from codegen.errors import CodegenError, ConfigError
from codegen.identify import names as names_module
from codegen.identify.names import Names, SignalChoice, load_names
from codegen.identify.quantities import LOG_QUANTITIES
from codegen.identify.reading import Reading, read_drives
from tests.identify.made import SIGNALS, frames, write_bus

TIME = np.arange(0.0, 4.0, 0.01)
GOOD = {"speed_km_h": 80.0 + TIME, "YawRate [deg/s]": np.sin(TIME), "steering_wheel_angle_deg": 10.0 * np.sin(TIME)}


def read(folder: Path, table: dict[str, np.ndarray], toml: str | None = None) -> Reading:
    pd.DataFrame({"time": TIME, **table}).to_csv(folder / "drive.csv", index=False)
    names = None
    if toml is not None:
        (folder / "names.toml").write_text(toml, encoding="utf-8")
        names = load_names(folder / "names.toml")
    return read_drives([folder / "drive.csv"], names=names)


def without(key: str) -> dict[str, np.ndarray]:
    return {name: values for name, values in GOOD.items() if name != key}


def test_names_has_a_key_for_each_quantity() -> None:
    choices = {key for key, field in Names.model_fields.items() if field.annotation == SignalChoice | None}
    assert choices == set(LOG_QUANTITIES)
    keys = re.findall(r"^    \[(\w+)\]", names_module.__doc__ or "", re.MULTILINE)
    assert set(keys) <= choices


@pytest.mark.parametrize(
    ("key", "name"),
    [
        ("vx", "VehicleSpeed (km/h)"),
        ("vx", "WheelBasedVehicleSpeed [km/h]"),
        ("vx", "vx_m_s"),
        ("vx", "v [mph]"),
        ("yaw_rate", "psi_dot [°/s]"),
        ("lateral_acceleration", "ay_g"),
        ("lateral_acceleration", "LatAcc in m/s^2"),
        ("steering_wheel_angle", "SteeringWheelAngle [deg]"),
        ("delta_f", "delta_f_rad"),
        ("delta_r", "rear_angle_rad"),
        ("delta_r_command", "rear_angle_command_rad"),
        ("sideslip", "beta [deg]"),
    ],
)
def test_obvious_names_and_their_units(key: str, name: str, tmp_path: Path) -> None:
    needed = {"vx": "speed_km_h", "yaw_rate": "YawRate [deg/s]", "steering_wheel_angle": "steering_wheel_angle_deg"}
    reading = read(tmp_path, {**without(needed.get(key, "")), name: 0.1 + 0.01 * np.sin(TIME)})
    source = reading.sources[0][key]
    assert source.channel == name
    assert reading.drives[0].signals[key][0] == pytest.approx(0.1 * LOG_QUANTITIES[key].units[source.unit])


def test_the_printed_names_toml_gives_the_same_reading(tmp_path: Path) -> None:
    path = write_bus(tmp_path / "drive.blf", frames())
    reading = read_drives([path], [tmp_path / "car.dbc"])
    (tmp_path / "names.toml").write_text(reading.names_toml, encoding="utf-8")
    again = read_drives([path], [tmp_path / "car.dbc"], load_names(tmp_path / "names.toml"))
    assert again.drives[0].signals.keys() == SIGNALS.keys()
    for key, values in reading.drives[0].signals.items():
        np.testing.assert_array_equal(values, again.drives[0].signals[key])
    assert all(source.is_given for source in again.sources[0].values())


def test_the_printed_names_toml_fits_drives_with_other_names_and_units(tmp_path: Path) -> None:
    paths = [write_bus(tmp_path / "drive.blf", frames()), tmp_path / "drive.csv"]
    time = np.arange(0.0, 8.0, 0.01)
    table = {
        "time_s": time,
        "speed_m_s": 25.0 + np.sin(time),
        "yaw_rate_rad_s": 0.1 * np.sin(time),
        "delta_f_rad": 0.02 * np.sin(time),
    }
    pd.DataFrame(table).to_csv(paths[1], index=False)
    reading = read_drives(paths, [tmp_path / "car.dbc"])
    (tmp_path / "names.toml").write_text(reading.names_toml, encoding="utf-8")
    again = read_drives(paths, [tmp_path / "car.dbc"], load_names(tmp_path / "names.toml"))
    for before, after in zip(reading.drives, again.drives, strict=True):
        assert before.signals.keys() == after.signals.keys()
        for key, values in before.signals.items():
            np.testing.assert_array_equal(values, after.signals[key])


@pytest.mark.parametrize(
    ("table", "what"),
    [
        (
            {**without("YawRate [deg/s]"), "ESP_YawVel [deg/s]": TIME, "Torque": TIME},
            "no signal is called yaw_rate or the like",
        ),
        ({**GOOD, "IMU.YawRate_deg_s": 2.0 * TIME}, "several signals may be yaw_rate"),
        ({**without("YawRate [deg/s]"), "YawRate": np.sin(TIME)}, "the unit of yaw_rate is not known"),
    ],
)
def test_an_error_lists_candidates_and_the_line_that_solves_it(table: dict[str, np.ndarray], what: str, tmp_path: Path) -> None:
    with pytest.raises(CodegenError) as error:
        read(tmp_path, table)
    assert error.value.what.startswith(what)
    assert "ESP_YawVel [deg/s]" in error.value.what or "ESP_YawVel [deg/s]" not in table
    found = re.search(r"put (?:a line such as )?(yaw_rate = \{.*?\})", error.value.remedy)
    assert found is not None
    line = found[1].replace("UNIT", "deg/s")
    assert tomllib.loads(line)
    assert read(tmp_path, table, line).sources[0]["yaw_rate"].is_given


def test_candidates_with_a_fitting_unit_come_first(tmp_path: Path) -> None:
    table = {**without("steering_wheel_angle_deg"), "steer_torque [Nm]": TIME, "steer_valid": TIME, "steer_pos [deg]": TIME}
    with pytest.raises(CodegenError, match=r'there is steer_pos \[deg\], .*signal = "steer_pos \[deg\]" \}'):
        read(tmp_path, table)


def test_an_optional_quantity_that_is_not_clear_is_left_out(tmp_path: Path) -> None:
    reading = read(tmp_path, {**GOOD, "ay_m_s2": TIME, "lat_acc_m_s2": TIME})
    assert "lateral_acceleration" not in reading.drives[0].signals
    (finding,) = reading.findings
    assert "several signals may be it (ay_m_s2, lat_acc_m_s2)" in finding.text


def test_settings_of_a_signal(tmp_path: Path) -> None:
    toml = """
without = ["steering_wheel_angle"]
[yaw_rate]
signal = ["no such", "gyro"]
unit = "deg/s"
sign = -1
offset = 2.0
[delta_f]
signal = "YawRate"
unit = "deg"
"""
    table = {"vx_m_s": np.full(TIME.size, 1.0), "gyro": np.full(TIME.size, 5.0), "YawRate": TIME, "swa_deg": TIME}
    reading = read(tmp_path, table, toml)
    assert reading.drives[0].signals.keys() == {"vx", "yaw_rate", "delta_f"}
    np.testing.assert_allclose(reading.drives[0].signals["yaw_rate"], np.radians(-3.0), atol=1e-15)


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        ("[yawrate]\nsignal = 'x'", "yawrate: unknown key; did you mean 'yaw_rate'?"),
        ("[vx]\nunit = 'km/h'", "vx.signal is missing; add it"),
        ("[vx]\nsignal = ''", "vx.signal"),
        ("[vx]\nsignal = []", "vx.signal"),
        ("[vx]\nsignal = 3", "vx.signal"),
        ("[vx]\nsignal = 'v'\nunit = 'rad'", "'rad' is no unit for vx; give one of m/s, km/h, mph"),
        ("[vx]\nsignal = 'v'\nsign = 2", "vx.sign"),
        ("[vx]\nsignal = 'v'\nlow = 3.0\nhigh = 3.0", "low = 3 is not below high = 3"),
        ("[vx]\nsignal = 'v'\noffset = nan", "vx.offset: nan is outside"),
        ("[vx]\nsignal = 'v'\nsampling_time_s = 0", "vx.sampling_time_s: 0 is outside 0.0001 to 60 s"),
        ("sampling_time_s = 20", "sampling_time_s: 20 is outside"),
        ("without = ['speed']", "`without` has 'speed', which is no quantity"),
        ("without = ['vx']\n[vx]\nsignal = 'v'", "vx is named, and left out by `without`"),
        ("time_unit = 'min'", "time_unit"),
        ("vx = ", "TOML syntax"),
    ],
)
def test_faults_of_names_toml(toml: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "names.toml"
    path.write_text(toml, encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        load_names(path)
    assert message in str(error.value)
    assert str(error.value).startswith(str(path))


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        (
            "vx = { signal = 'sped_km_h' }",
            "vx: the log has no signal 'sped_km_h'; correct the name in names.toml; did you mean 'speed_km_h'?",
        ),
        ("vx = { signal = 'a' }\nyaw_rate = { signal = 'b' }", "a: the unit of vx is not known"),
        ("vx = { signal = 'YawRate [deg/s]' }", "'deg/s' is no unit for vx"),
        ("without = ['vx']", "no signal is called vx or the like"),
        ("time = 'clock'", "no column 'clock'; `time` is one of time, speed_km_h"),
    ],
)
def test_names_that_do_not_fit_the_log(toml: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(CodegenError) as error:
        read(tmp_path, {**GOOD, "a": TIME, "b": TIME}, toml)
    assert message in str(error.value)


def test_a_signal_that_some_drives_lack(tmp_path: Path) -> None:
    names = Names.model_validate({"delta_r": {"signal": "rear"} | {"unit": "deg"}})
    for name, table in (("one", {**GOOD, "rear": TIME}), ("two", GOOD)):
        pd.DataFrame({"time": TIME, **table}).to_csv(tmp_path / f"{name}.csv", index=False)
    reading = read_drives([tmp_path / "one.csv", tmp_path / "two.csv"], names=names)
    assert ["delta_r" in drive.signals for drive in reading.drives] == [True, False]
    assert [str(finding) for finding in reading.findings] == ["two: delta_r: the log has no signal 'rear'"]
    with pytest.raises(CodegenError, match="delta_r: the log has no signal 'rear'"):
        read_drives([tmp_path / "two.csv"], names=names)


def test_a_signal_with_its_sign_in_another(tmp_path: Path) -> None:
    angle = 10.0 * np.sin(2.0 * TIME) - 1.0
    table = {**GOOD, "steering_wheel_angle_deg": np.abs(angle), "turns right": (angle < 0.0).astype(int)}
    toml = "[steering_wheel_angle]\nsignal = 'steering_wheel_angle_deg'\nsign = 'turns right'\noffset = -1.0\n"
    reading = read(tmp_path, table, toml)
    np.testing.assert_allclose(reading.drives[0].signals["steering_wheel_angle"], np.radians(angle + 1.0), atol=1e-12)
    with pytest.raises(
        CodegenError, match=r"steering_wheel_angle.sign: the log has no signal 'turns left'; .* did you mean 'turns right'"
    ):
        read(tmp_path, table, toml.replace("right", "left"))
    sparse = np.where(np.arange(TIME.size) % 2, np.nan, 0.0)
    with pytest.raises(CodegenError, match=r"turns right: it has other times than the signal whose sign it is"):
        read(tmp_path, {**table, "turns right": sparse}, toml)

"""Faults in logs are found, and their samples have no value; sound drives have no findings."""

from collections.abc import Callable, Mapping
from pathlib import Path

import asammdf
import can
import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from codegen.errors import CodegenError
from codegen.identify.conditioning import clipped, jumps, refuse_alternation
from codegen.identify.cross_checks import cross_check
from codegen.identify.drive import (
    CLOCK,
    CONTRADICTION,
    FROZEN,
    GAP,
    IMPOSSIBLE,
    JUMP,
    OFFSET,
    REMARK,
    RESERVED,
    SATURATED,
    SIGN,
    refuse_contradictions,
)
from codegen.identify.names import Names
from codegen.identify.reading import Reading, read_drives
from codegen.units import KM_H
from tests.identify.drives import Course, Part, drive, true_car
from tests.identify.made import DURATION, SIGNALS, Frames, Wave, frames, kinds, wave, write_bus

TIME = np.arange(0.0, DURATION, 0.01)


def columns(**changes: Wave) -> dict[str, np.ndarray]:
    """Return the samples of SIGNALS at TIME, some of them changed, by column."""
    return {f"{key} [{UNITS[key]}]": one(TIME) for key, one in {**SIGNALS, **changes}.items()}


UNITS = {
    "vx": "m/s",
    "yaw_rate": "rad/s",
    "lateral_acceleration": "m/s^2",
    "steering_wheel_angle": "rad",
    "delta_f": "rad",
    "delta_r": "rad",
    "delta_r_command": "rad",
    "sideslip": "rad",
}


def read(
    folder: Path, table: Mapping[str, np.ndarray], time: np.ndarray = TIME, names: Mapping[str, object] | None = None
) -> Reading:
    pd.DataFrame({"time_s": time, **table}).to_csv(folder / "drive.csv", index=False)
    return read_drives([folder / "drive.csv"], names=None if names is None else Names.model_validate(names))


def read_bus(folder: Path, made: Frames, names: Mapping[str, object] | None = None) -> Reading:
    path = write_bus(folder / "drive.blf", made)
    return read_drives([path], [folder / "car.dbc"], None if names is None else Names.model_validate(names))


def value(reading: Reading, key: str, time: float) -> float:
    """Return the value of a signal at a multiple of the step."""
    return float(reading.drives[0].signals[key][round(time / 0.01)])


# --- sound drives --------------------------------------------------------------------------------------------------------


def single_track(angle: np.ndarray, speed: np.ndarray) -> dict[str, np.ndarray]:
    """Return the signals of a linear car with some noise and the resolution of real sensors."""
    generator = np.random.default_rng(3)
    yaw_rate, target, lateral = np.zeros(angle.size), 0.0, np.zeros(angle.size)
    for k in range(1, angle.size):
        target = speed[k] * angle[k] / (3.0 + 0.006 * speed[k] ** 2)
        yaw_rate[k] = yaw_rate[k - 1] + 0.01 / 0.12 * (target - yaw_rate[k - 1])
        lateral[k] = speed[k] * yaw_rate[k] * 0.97
    noise = lambda size: size * generator.standard_normal(angle.size)  # noqa: E731
    rounded = lambda values, step: step * np.round(values / step)  # noqa: E731
    return {
        "vx [m/s]": rounded(speed + noise(0.02), 0.01),
        "yaw_rate [rad/s]": rounded(yaw_rate + noise(0.001), 0.0005),
        "ay [m/s^2]": rounded(lateral + noise(0.05), 0.01),
        "steering_wheel_angle [rad]": rounded(16.0 * angle, 0.0017),
        "delta_r [rad]": rounded(-0.2 * angle, 1e-4),
    }


SOUND = {
    "step steer that is held": lambda t: 0.02 * np.clip(4.0 * (t - 1.0), 0.0, 1.0),
    "slalom": lambda t: 0.03 * np.sin(2.0 * np.pi * 0.4 * t),
    "straight": lambda t: 0.0 * t,
    "slow ramp": lambda t: 0.003 * t,
    "sine with dwell": lambda t: 0.04 * np.where(t < 2.5, np.sin(np.pi * t), np.where(t < 3.0, -1.0, 0.0)) * (t > 1.0),
}


@pytest.mark.parametrize("noise", ["noise", "no noise"])
@pytest.mark.parametrize("name", SOUND)
def test_a_sound_drive_has_no_findings(name: str, noise: str, tmp_path: Path) -> None:
    time = np.arange(0.0, 12.0, 0.01)
    signals = single_track(SOUND[name](time), np.full(time.size, 22.0) if noise == "no noise" else 22.0 + np.sin(time))
    if noise == "no noise":
        signals["vx [m/s]"] = np.full(time.size, 22.0)
        signals["yaw_rate [rad/s]"] = 5e-4 * np.round(np.convolve(signals["yaw_rate [rad/s]"], np.ones(9) / 9.0, "same") / 5e-4)
    reading = read(tmp_path, signals, time)
    assert reading.findings == ()
    assert all(source.share == 1.0 for source in reading.sources[0].values())


def test_a_car_that_stands_while_the_driver_steers_is_sound(tmp_path: Path) -> None:
    zero = wave(0.0, 0.0)
    reading = read(tmp_path, columns(vx=zero, yaw_rate=zero, lateral_acceleration=zero))
    assert reading.findings == ()


def test_a_coarse_yaw_rate_on_a_straight_road_is_sound(tmp_path: Path) -> None:
    time = np.arange(0.0, 60.0, 0.01)
    generator = np.random.default_rng(1)
    wheel = 0.01 * np.sin(0.7 * time) + 0.01 * np.sin(0.23 * time + 1.0)
    yaw_rate = 0.2 * wheel + 2e-4 * generator.standard_normal(time.size)
    signals = {
        "vx [m/s]": np.full(time.size, 30.0),
        "yaw_rate [rad/s]": 4.26e-3 * np.round(yaw_rate / 4.26e-3),  # 0.244 deg/s
        "ay [m/s^2]": 0.036 * np.round((30.0 * yaw_rate + 0.02 * generator.standard_normal(time.size)) / 0.036),
        "steering_wheel_angle [rad]": wheel,
    }
    assert FROZEN not in [kind for _, kind in kinds(read(tmp_path, signals, time))]


@given(resolution=st.floats(1e-4, 0.2), frequency=st.floats(0.05, 3.0), phase=st.floats(0.0, 6.3), second=st.floats(0.0, 0.3))
def test_smooth_curves_are_not_clipped(resolution: float, frequency: float, phase: float, second: float) -> None:
    angle = 2.0 * np.pi * frequency * np.arange(0.0, 20.0, 0.01) + phase
    curve = np.sin(angle) + second * np.sin(0.7 * angle)
    assert not clipped(resolution * np.round(curve / resolution)).any()


def test_noise_on_a_straight_road_is_sound(tmp_path: Path) -> None:
    generator = np.random.default_rng(5)
    noise = {key: 0.02 * amplitude for key, amplitude in (("yaw_rate", 0.02), ("lateral_acceleration", 2.0))}
    noise |= {"steering_wheel_angle": 0.004, "delta_r": 1e-4}
    table = {f"{key} [{UNITS[key]}]": size * generator.standard_normal(TIME.size) for key, size in noise.items()}
    assert read(tmp_path, {**table, "vx [m/s]": np.full(TIME.size, 30.0)}).findings == ()


def test_small_movements_of_the_steering_wheel_prove_nothing(tmp_path: Path) -> None:
    """The steering wheel moves by 16 % of its range while yaw rate and lateral acceleration are exactly zero."""
    quiet = {
        key: lambda time, one=SIGNALS[key], share=share: np.where(time < 3.0, share, 1.0) * one(time)
        for key, share in (("yaw_rate", 0.0), ("lateral_acceleration", 0.0), ("steering_wheel_angle", 0.08))
    }
    reading = read(tmp_path, columns(**quiet))
    assert FROZEN not in [kind for _, kind in kinds(reading)]


def test_a_speed_of_zero_at_the_lower_limit_of_the_database_is_sound(tmp_path: Path) -> None:
    still = {**SIGNALS, "vx": lambda time: np.where(time < 3.0, 0.0, 5.0 * (time - 3.0))}
    still |= {key: lambda time, one=SIGNALS[key]: np.where(time < 3.0, 0.0, 1.0) * one(time) for key in ("yaw_rate", "delta_r")}
    still["lateral_acceleration"] = lambda time: still["vx"](time) * still["yaw_rate"](time)
    reading = read_bus(tmp_path, frames(still))
    assert reading.findings == ()
    assert value(reading, "vx", 1.0) == 0.0


# --- gaps and clocks -----------------------------------------------------------------------------------------------------


def test_a_gap(tmp_path: Path) -> None:
    lost = [frame for frame in frames() if not (frame.arbitration_id == 290 and 3.0 < frame.timestamp - 1.7e9 < 3.5)]
    reading = read_bus(tmp_path, lost)
    assert kinds(reading) == [("delta_r", GAP)]
    assert reading.findings[0].text == "a gap of 0.52 s at 2.980 s, where 0.02 s are normal"
    assert np.isnan(value(reading, "delta_r", 3.2))
    assert np.isfinite([value(reading, "delta_r", time) for time in (2.95, 3.55)]).all()
    assert np.isfinite(value(reading, "vx", 3.2))


def test_a_pause_of_a_signal_that_is_sent_seldom_is_no_gap(tmp_path: Path) -> None:
    lost = [frame for frame in frames() if not (frame.arbitration_id == 290 and 3.0 < frame.timestamp - 1.7e9 < 3.5)]
    names = {"delta_r": {"signal": "RearAngle", "sampling_time_s": 0.3}}
    assert read_bus(tmp_path, lost, names).findings == ()


@pytest.mark.parametrize("ending", ["blf", "log"])
def test_a_restart_of_the_clock_keeps_the_longest_part(ending: str, tmp_path: Path) -> None:
    made = [can.Message(**_arguments(frame, -5.0 if frame.timestamp - 1.7e9 >= 5.0 else 0.0)) for frame in frames()]
    path = write_bus(tmp_path / f"drive.{ending}", made)
    reading = read_drives([path], [tmp_path / "car.dbc"])
    ((quantity, kind),) = kinds(reading)
    assert (quantity, kind) == ("", CLOCK)
    assert reading.findings[0].lost == sum(frame.timestamp - 1.7e9 >= 5.0 for frame in frames())
    drive = reading.drives[0]
    assert drive.time[-1] == pytest.approx(5.0, abs=0.02)
    # Nothing of the later part is mixed in.
    assert np.nanmax(np.abs(drive.signals["vx"] - SIGNALS["vx"](drive.time))) < 0.01


def _arguments(frame: can.Message, shift: float) -> dict[str, object]:
    keys = ("arbitration_id", "is_extended_id", "data", "is_rx", "channel")
    return {**{key: getattr(frame, key) for key in keys}, "timestamp": frame.timestamp + shift}


def test_times_that_repeat_jump_or_are_missing(tmp_path: Path) -> None:
    time = TIME.copy()
    time[100] = time[99]
    time[200] = 1e6
    time[300] = -50.0
    time[400] = time[398]
    reading = read(tmp_path, columns(), time)
    assert {kind for _, kind in kinds(reading)} == {CLOCK}
    assert {finding.lost for finding in reading.findings} == {4}
    for key, one in SIGNALS.items():
        np.testing.assert_allclose(reading.drives[0].signals[key], one(TIME), atol=1e-3, err_msg=key)


def test_a_wrong_unit_of_the_time_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CodegenError, match=r"samples are 10 s apart; check the unit of its time"):
        read(tmp_path, columns(), 1e3 * TIME)
    assert read(tmp_path, columns(), 1e3 * TIME, {"time_unit": "ms"}).findings == ()


# --- frames --------------------------------------------------------------------------------------------------------------


def test_frames_that_a_gateway_repeats_are_read_once(tmp_path: Path) -> None:
    made = frames()
    copies = [can.Message(**{**_arguments(frame, 0.004), "channel": 1}) for frame in made if frame.arbitration_id == 290][:-3]
    for frame in made:
        frame.channel = 0
    reading = read_bus(tmp_path, sorted([*made, *copies], key=lambda frame: frame.timestamp))
    assert kinds(reading) == [("", REMARK)]
    text = "Rear: 397 frames (channel 2, received) copy those of channel 1, received, 4 ms later"
    assert reading.findings[0].text == text
    assert reading.sources[0]["delta_r"].period == pytest.approx(0.02)
    assert reading.sources[0]["delta_r"].samples == 400


def test_a_node_that_hears_itself_counts_once(tmp_path: Path) -> None:
    made = frames()
    sent = [can.Message(**{**_arguments(frame, 0.0), "is_rx": False}) for frame in made]
    heard = [can.Message(**_arguments(frame, 0.002)) for frame in made]
    reading = read_bus(tmp_path, sorted([*sent, *heard], key=lambda frame: frame.timestamp))
    assert reading.findings == ()
    assert reading.sources[0]["vx"].samples == 800


def test_reserved_values_are_none(tmp_path: Path) -> None:
    made = frames()
    rear = [frame for frame in made if frame.arbitration_id == 290]
    for frame, raw in zip(rear[100:110], [0x800] * 5 + [0x7FF] * 5, strict=True):  # SNA and Init
        frame.data = bytearray([raw >> 4, (raw & 15) << 4, *bytes(6)])
    reading = read_bus(tmp_path, made)
    assert kinds(reading) == [("delta_r", RESERVED)]
    assert reading.findings[0].lost == 10
    first = rear[100].timestamp - 1.7e9
    assert np.isnan(value(reading, "delta_r", round(first + 0.05, 2)))


# --- values --------------------------------------------------------------------------------------------------------------


def test_saturation_at_the_limit_of_the_database(tmp_path: Path) -> None:
    steep = {**SIGNALS, "delta_r": lambda time: np.clip(np.radians(6.0) * np.sin(np.pi * time), *np.radians([-5.0, 5.0]))}
    reading = read_bus(tmp_path, frames(steep))
    assert kinds(reading) == [("delta_r", SATURATED)]
    assert "(-5 to 5 deg)" in reading.findings[0].text
    assert np.isnan(value(reading, "delta_r", 0.5))
    assert np.isfinite(value(reading, "delta_r", 0.2))


def test_limits_of_a_database_that_a_signal_exceeds_are_ignored(tmp_path: Path) -> None:
    reading = read_bus(tmp_path, frames({**SIGNALS, "delta_r": lambda time: np.radians(8.0) * np.sin(np.pi * time)}))
    assert kinds(reading) == [("delta_r", REMARK)]
    assert "exceeds the limits of the database (-5 to 5 deg)" in reading.findings[0].text
    assert np.isfinite(value(reading, "delta_r", 0.5))


def test_limits_of_names_toml(tmp_path: Path) -> None:
    names = {"yaw_rate": {"signal": "yaw_rate [rad/s]", "low": -0.1, "high": 0.15}}
    reading = read(tmp_path, columns(), names=names)
    assert kinds(reading) == [("yaw_rate", SATURATED)]
    has_value = np.isfinite(reading.drives[0].signals["yaw_rate"])
    exact = SIGNALS["yaw_rate"](TIME)
    np.testing.assert_array_equal(has_value, (exact > -0.1) & (exact < 0.15))


def test_a_clipped_response(tmp_path: Path) -> None:
    reading = read(tmp_path, columns(yaw_rate=lambda time: np.clip(SIGNALS["yaw_rate"](time), -0.17, 0.17)))
    assert kinds(reading) == [("yaw_rate", SATURATED)]
    assert "clipped at -0.17 and 0.17 rad/s" in reading.findings[0].text
    exact = SIGNALS["yaw_rate"](TIME)
    lost = np.isnan(reading.drives[0].signals["yaw_rate"])
    np.testing.assert_array_equal(lost, np.abs(exact) >= 0.17)


@pytest.mark.parametrize("command", [{}, {"delta_r_command": SIGNALS["delta_r"]}], ids=["no command", "command"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_saturated_rear_angle(command: dict[str, Wave], side: float, tmp_path: Path) -> None:
    table = columns(delta_r=lambda time: side * np.minimum(side * SIGNALS["delta_r"](time), np.radians(1.0)), **command)
    reading = read(tmp_path, table)
    assert kinds(reading) == [("delta_r", SATURATED)]
    assert f"samples stay at {side:g} deg although" in reading.findings[0].text
    lost = np.isnan(reading.drives[0].signals["delta_r"])
    np.testing.assert_array_equal(lost, side * SIGNALS["delta_r"](TIME) >= np.radians(1.0))


def test_a_noisy_rear_angle_below_its_command(tmp_path: Path) -> None:
    stop = lambda time: np.clip(SIGNALS["delta_r"](time), -0.02, 0.02)  # noqa: E731
    noise = 2e-4 * np.random.default_rng(2).standard_normal(TIME.size)
    reading = read(tmp_path, columns(delta_r=lambda time: stop(time) + noise, delta_r_command=SIGNALS["delta_r"]))
    assert kinds(reading) == [("delta_r", SATURATED)]


@pytest.mark.parametrize("lag", [0.01, 0.05, 0.1])
@pytest.mark.parametrize("frequency", [0.2, 1.0, 3.0])
def test_a_rear_angle_that_follows_its_command_is_sound(lag: float, frequency: float, tmp_path: Path) -> None:
    command = 0.03 * np.where(TIME < 5.0, np.sin(2.0 * np.pi * frequency * TIME), np.where(TIME < 7.0, 1.0, -1.0))
    angle = np.zeros(TIME.size)
    for k in range(1, TIME.size):
        angle[k] = angle[k - 1] - np.expm1(-0.01 / lag) * (command[k - 1] - angle[k - 1])
    rounded = 1e-4 * np.round(angle / 1e-4)
    assert kinds(read(tmp_path, columns(delta_r=lambda _: rounded, delta_r_command=lambda _: command))) == []


def test_impossible_values_are_none_and_many_of_them_a_wrong_unit(tmp_path: Path) -> None:
    table = columns()
    table["yaw_rate [rad/s]"][[50, 51]] = 300.0
    reading = read(tmp_path, table)
    assert kinds(reading) == [("yaw_rate", IMPOSSIBLE)]
    assert reading.findings[0].lost == 2
    assert np.isnan(value(reading, "yaw_rate", 0.5))
    table["yaw_rate [rad/s]"] = np.degrees(SIGNALS["yaw_rate"](TIME))
    with pytest.raises(CodegenError, match=r'yaw_rate goes to 11.46 rad/s, .*; unit = "deg/s" in names.toml would fit'):
        read(tmp_path, table)


def test_samples_of_another_sender_on_the_same_channel_jump_away_and_back(tmp_path: Path) -> None:
    table = columns()
    table["vx [m/s]"][[1, 150, 152]] = 0.0
    reading = read(tmp_path, table)
    assert kinds(reading) == [("vx", JUMP)] and reading.findings[0].lost == 3
    assert np.isnan(value(reading, "vx", 1.5)) and value(reading, "vx", 1.51) == pytest.approx(table["vx [m/s]"][151])


@pytest.mark.parametrize("every", [2, 3])
@pytest.mark.parametrize("key", ["vx", "steering_wheel_angle"])
def test_samples_that_alternate_between_two_courses_are_refused(key: str, every: int, tmp_path: Path) -> None:
    table = columns()
    name = f"{key} [{UNITS[key]}]"
    table[name][::every] += 0.5 * np.abs(table[name]).max()
    with pytest.raises(CodegenError, match="its samples alternate between two courses, as of two senders; log one of them"):
        read(tmp_path, table)


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0), st.integers(1, 50))
def test_noise_steps_and_sweeps_are_no_jumps(seed: int, noise: float, steps: int) -> None:
    """A chirp up to 2.5 Hz in samples of 20 ms, a step, noise and rounding: no sample jumps, and none alternate."""
    time = np.arange(0.0, 20.0, 0.02)
    values = np.sin(2.0 * np.pi * (0.1 * time + 0.06 * time**2)) * (time > 5.0) + (time > 15.0)
    values += noise * np.random.default_rng(seed).normal(size=time.size)
    values = np.round(steps * values) / steps
    refuse_alternation(values, "")
    assert not jumps(time, values, 0.05).any()


@pytest.mark.parametrize("key", ["yaw_rate", "lateral_acceleration"])
def test_a_frozen_response(key: str, tmp_path: Path) -> None:
    def frozen(time: np.ndarray) -> np.ndarray:
        return SIGNALS[key](np.where((time > 3.0) & (time < 4.5), 3.0, time))

    reading = read(tmp_path, columns(**{key: frozen}))
    assert kinds(reading) == [(key, FROZEN)]
    assert reading.findings[0].text.startswith("constant for 1.49 s at 3.000 s although")
    assert np.isnan(reading.drives[0].signals[key][300:450]).all()
    assert np.isfinite(reading.drives[0].signals[key][[299, 450]]).all()


def test_a_rear_angle_that_does_not_follow_its_command(tmp_path: Path) -> None:
    stuck = wave(0.01, 0.0)
    reading = read(tmp_path, columns(delta_r=stuck, delta_r_command=SIGNALS["delta_r"]))
    assert kinds(reading) == [("delta_r", FROZEN)]


def test_a_rear_angle_that_follows_its_command_late_is_sound(tmp_path: Path) -> None:
    def ramp(late: float) -> Wave:
        return lambda time: np.clip(0.1 * (time - 4.0 - late), 0.0, 0.03)

    reading = read(tmp_path, columns(delta_r=ramp(0.1), delta_r_command=ramp(0.0)))
    assert FROZEN not in [kind for _, kind in kinds(reading)]


# --- offsets and signs ---------------------------------------------------------------------------------------------------


def standing(time: np.ndarray, signal: Wave) -> np.ndarray:
    return np.where(time < 2.0, 0.0, signal(time - 2.0))


def straight(time: np.ndarray, signal: Wave) -> np.ndarray:
    return np.where(time < 4.0, 0.0, signal(time - 4.0))


@pytest.mark.parametrize(
    ("key", "offset", "before"),
    [("yaw_rate", 0.01, standing), ("lateral_acceleration", 0.2, standing), ("steering_wheel_angle", 0.05, straight)],
)
@pytest.mark.parametrize("sign", [1, -1])
def test_an_offset_is_reported_with_the_value_that_removes_it(
    key: str, offset: float, before: Callable[[np.ndarray, Wave], np.ndarray], sign: int, tmp_path: Path
) -> None:
    sine = {key: wave(0.0, amplitude) for key, amplitude in (("yaw_rate", 0.2), ("lateral_acceleration", 5.0))}
    sine |= {"steering_wheel_angle": wave(0.0, 0.8), "delta_r": wave(0.0, 0.03)}
    table = {f"{name} [{UNITS[name]}]": before(TIME, one) for name, one in sine.items()}
    table["vx [m/s]"] = np.where(TIME < 2.0, 0.0, 25.0) if before is standing else np.full(TIME.size, 25.0)
    column = f"{key} [{UNITS[key]}]"
    exact = table[column].copy()
    table[column] = sign * table[column] + offset
    names: dict[str, object] = {key: {"signal": column, "sign": sign}}
    reading = read(tmp_path, table, names=names)
    assert kinds(reading) == [(key, OFFSET)]
    assert f"offset = {offset:g} in names.toml" in reading.findings[0].text
    names = {key: {"signal": column, "sign": sign, "offset": offset}}
    again = read(tmp_path, table, names=names)
    assert again.findings == ()
    np.testing.assert_allclose(again.drives[0].signals[key], exact, atol=1e-12)


def test_an_offset_that_is_subtracted_in_part_is_reported_in_full(tmp_path: Path) -> None:
    table = columns(
        vx=lambda time: np.where(time < 2.0, 0.0, 25.0), yaw_rate=lambda time: 0.02 + standing(time, SIGNALS["yaw_rate"])
    )
    for key in ("lateral_acceleration", "steering_wheel_angle", "delta_r"):
        table[f"{key} [{UNITS[key]}]"] = standing(TIME, SIGNALS[key])
    names = {"yaw_rate": {"signal": "yaw_rate [rad/s]", "offset": 0.005}}
    (finding,) = read(tmp_path, table, names=names).findings
    assert finding.text == "an offset of 0.015 rad/s at standstill; offset = 0.02 in names.toml subtracts it"


@pytest.mark.parametrize(
    ("factor", "kind"), [(0.5, SIGN), (2.5, SIGN), (-1.0, CONTRADICTION), (3.6, CONTRADICTION), (1.0 / 3.6, CONTRADICTION)]
)
def test_a_wrong_sign_or_unit_of_the_lateral_acceleration(factor: float, kind: str, tmp_path: Path) -> None:
    wrong = columns(delta_r=lambda time: 0.0 * time)
    wrong["lateral_acceleration [m/s^2]"] *= factor
    reading = read(tmp_path, wrong)
    assert ("lateral_acceleration", kind) in kinds(reading)


def test_moving_sideways_is_no_contradiction(tmp_path: Path) -> None:
    """With rear wheels that follow the front ones, a car has much lateral acceleration for little yaw rate."""
    table = columns(delta_r=lambda time: 0.05 * SIGNALS["steering_wheel_angle"](time))
    table["lateral_acceleration [m/s^2]"] *= 5.0
    assert ("lateral_acceleration", SIGN) in kinds(read(tmp_path, table))


def test_a_rear_angle_with_the_other_sign(tmp_path: Path) -> None:
    angle = SIGNALS["delta_r"]
    reading = read(tmp_path, columns(delta_r=lambda time: -angle(time), delta_r_command=angle))
    assert ("delta_r", SIGN) in kinds(reading)


def test_contradictory_signals_are_refused(tmp_path: Path) -> None:
    wrong = columns(yaw_rate=lambda time: -SIGNALS["yaw_rate"](time), steering_wheel_angle=lambda time: 0.0 * time)
    findings = read(tmp_path, wrong).findings
    with pytest.raises(CodegenError) as error:
        refuse_contradictions(findings)
    assert error.value.where == "drive: lateral_acceleration"
    assert error.value.what == "it is -0.998 times vx * yaw_rate, where about 1 is normal"
    assert error.value.remedy == "check sign and unit of all three in names.toml, for `signals=`"
    refuse_contradictions(each for each in findings if each.kind != CONTRADICTION)


def test_fast_steering_of_the_rear_wheels_is_no_contradiction() -> None:
    """The lateral acceleration and the yaw rate are out of phase: see `SLOPE_FACTOR_MAX`."""
    config, errors = true_car(100)
    one = drive(config, (Course(config).rear_sweep(90.0, 1.4),), 0, errors)
    units = {"delta_f": ("rad", 1, 0.0), "delta_r": ("rad", 1, 0.0), "steering_wheel_angle": ("rad", 1, 0.0)}
    units |= {"yaw_rate": ("rad/s", 1, 0.0), "lateral_acceleration": ("m/s^2", 1, 0.0)}
    refuse_contradictions(cross_check(one, units))


def test_a_sweep_of_the_steering_wheel_is_no_wrong_sign() -> None:
    """At 2.5 Hz the yaw rate follows a quarter of a period late; most of an even sweep is above 1 Hz."""
    config, errors = true_car(3)
    time = np.arange(30_000) * 1e-3
    front = Course(config).angle(120.0 * KM_H, 4.0) * np.sin(2.0 * np.pi * (0.1 + 0.04 * time) * time)
    one = drive(config, (Part(30.0, 120.0 * KM_H, front),), 0, errors)
    units = {"delta_f": ("rad", 1, 0.0), "delta_r": ("rad", 1, 0.0), "steering_wheel_angle": ("rad", 1, 0.0)}
    units |= {"yaw_rate": ("rad/s", 1, 0.0), "lateral_acceleration": ("m/s^2", 1, 0.0)}
    assert [each for each in cross_check(one, units) if each.kind in (SIGN, CONTRADICTION)] == []


def test_a_gap_of_all_signals_is_one_finding(tmp_path: Path) -> None:
    kept = (TIME < 1.0) | (TIME > 1.5)
    reading = read(tmp_path, {key: values[kept] for key, values in columns().items()}, TIME[kept])
    (finding,) = reading.findings
    assert finding.kind == GAP
    assert finding.quantity.split(", ") == list(reading.drives[0].signals)


def test_a_steering_wheel_with_the_other_sign(tmp_path: Path) -> None:
    reading = read(tmp_path, columns(steering_wheel_angle=lambda time: -SIGNALS["steering_wheel_angle"](time)))
    assert kinds(reading) == [("steering_wheel_angle", SIGN)]
    turned = {"steering_wheel_angle": {"signal": "steering_wheel_angle [rad]", "sign": -1}}
    table = columns(steering_wheel_angle=lambda time: -SIGNALS["steering_wheel_angle"](time))
    assert read(tmp_path, table, names=turned).findings == ()


def test_texts_and_invalid_samples_of_a_measurement_are_none(tmp_path: Path) -> None:
    raw = np.round(np.degrees(SIGNALS["delta_r"](TIME)) / 0.01).astype(np.int16)
    raw[100:110] = 4095
    invalid = np.zeros(TIME.size, dtype=bool)
    invalid[200:205] = True
    texts = {"val_0": 4095, "text_0": "SNA", "default_addr": asammdf.blocks.conversion_utils.from_dict({"a": 0.01, "b": 0.0})}
    with asammdf.MDF() as mdf:
        mdf.append(
            [
                asammdf.Signal(25.0 + 0.0 * TIME, TIME, name="vx", unit="m/s"),
                asammdf.Signal(SIGNALS["yaw_rate"](TIME), TIME, name="yaw_rate", unit="rad/s", invalidation_bits=invalid),
                asammdf.Signal(SIGNALS["steering_wheel_angle"](TIME), TIME, name="swa", unit="rad"),
                asammdf.Signal(raw, TIME, name="rear_angle", unit="deg", conversion=texts),
            ]
        )
        mdf.save(tmp_path / "drive.mf4")
    reading = read_drives([tmp_path / "drive.mf4"])
    assert [(finding.quantity, finding.kind, finding.lost) for finding in reading.findings] == [
        ("yaw_rate", GAP, 0),
        ("delta_r", RESERVED, 10),
    ]
    for key, lost in (("yaw_rate", range(200, 205)), ("delta_r", range(100, 110))):
        assert np.flatnonzero(np.isnan(reading.drives[0].signals[key])).tolist() == list(lost)
    exact = SIGNALS["delta_r"](TIME)
    assert np.nanmax(np.abs(reading.drives[0].signals["delta_r"] - exact)) <= np.radians(0.005) + 1e-12

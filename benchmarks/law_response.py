"""Rows of the benchmark `law` on the dry road: error, rise, overshoot, sines, gusts and offsets of the sensors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks import minimal_error
from benchmarks.law_car import HEAVY_UNDERSTEERING, IDEAL, Drives, LawCar, Setting, per_setting, spun
from benchmarks.law_figures import Figure
from codegen.arrays import FloatArray
from codegen.design.family import Member, members
from codegen.design.margins import family_range_km_h, gains_of, loop_margins
from codegen.design.sampled import frequency_grid, sample
from codegen.emit.laws import schedule_of
from codegen.metrics import Runs, StepResponse
from codegen.metrics.runs import paths
from codegen.metrics.sine import SineResponse
from codegen.units import KM_H
from hil_sim.suite.cells import Condition, actuator_lag, relaxation, up_to
from hil_sim.suite.controller_properties import MARGIN_SPEEDS_KM_H

RATIO_MAX = minimal_error.REQUIRED
RISE_MEAN_S, RISE_MAX_S = 0.30, 0.37
PASSIVE_FACTOR, HEAVY_OVERSHOOT_PERCENT = 1.0 / 3.0, 8.0
"""Largest overshoot of a heavy understeering car, of the passive car's, and in percent."""
LAG_FACTOR, LAG_OVERSHOOT_PERCENT = 2.0, 20.0
LONG_RELAXATION_M, RELAXATION_OVERSHOOT_PERCENT = 0.6, 12.0
SHORT_RELAXATION_M = 0.4

SINE_HZ, SINE_PERIODS, SINE_KM_H, SINE_ANGLE_DEG = 2.0, 12, 60.0, 2.5
GAIN_RANGE = (0.8, 1.1)

GUST_SPEEDS_KM_H = (80.0, 90.0, 100.0, 110.0, 120.0, 130.0)
GUST_N, GUST_S, GUST_START_S, GUST_READ_S = 2500.0, 1.5, 2.0, 3.0
"""Side force at the front axle, its duration and its beginning; heading and path are read so many s after its end."""
HEADING_MAX_DEG, PATH_MAX_M, PHASE_MIN_DEG = 0.2, 1.0, 35.0
SLOW_MARGINS = (6.0, 35.0, 2.1)
"""Gain margin in dB, phase margin in deg and sensitivity of cars with twice the lag and relaxation."""
ROUNDING = 1e-6

BIAS_RAD_S, BIAS_M_S2 = math.radians(0.25), 0.1
BEFORE_S, STRAIGHT_S, STRAIGHT_MAX_DEG = 30.0, 7.0, 0.3
STRAIGHT_SPEEDS_KM_H = (60.0, 80.0, 100.0, 120.0)


def minimal_errors(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 2: yaw-rate error over the minimal one, and rise times."""
    if car.letter not in ("P", *HEAVY_UNDERSTEERING):
        return
    step = StepResponse(car.drive(car.steps, plant, [Setting()]))
    rise = step.rise_time_s[car.is_fast]
    title = "t90 at 80 to 120 km/h, mean and largest"
    goal = f"{RISE_MEAN_S:.2f}, {RISE_MAX_S:.2f} s"
    is_met = bool(rise.mean() <= RISE_MEAN_S and rise.max() <= RISE_MAX_S)
    yield Figure(2, title, plant, goal, car.letter, f"{rise.mean():.2f}, {rise.max():.2f}", is_met)
    if plant != IDEAL:
        return  # the plant of the optimum is ideal
    ratios = np.array([minimal_error.compare(car.tested, cell).ratio for cell in minimal_error.chosen(car.cells)])
    title, goal = "rms error over the minimal one, mean and largest of the steps", f"{RATIO_MAX:g}"
    is_met = bool(ratios.max() <= RATIO_MAX)
    yield Figure(2, title, plant, goal, car.letter, f"{ratios.mean():.2f}, {ratios.max():.2f}", is_met)


def overshoots(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 3: overshoot of steps, also with another actuator and other tyres."""
    slow = Condition("lag", "twice the lag", "lag", plant=actuator_lag(LAG_FACTOR))
    settings = [Setting(), Setting(controlled=False), Setting(slow)]
    own, passive, lagged = _overshoots(car, plant, settings)
    fast, text = car.is_fast, f"{own.max():.1f}"
    yield Figure(3, "overshoot of all steps", plant, "", car.letter, text)
    if car.letter in HEAVY_UNDERSTEERING:
        worst, limit = float(own[fast].max()), min(HEAVY_OVERSHOOT_PERCENT, PASSIVE_FACTOR * float(passive[fast].max()))
        title, goal = "overshoot at 80 to 120 km/h (passive), %", "a third of passive, 8"
        yield Figure(3, title, plant, goal, car.letter, f"{worst:.1f} ({passive[fast].max():.1f})", worst <= limit)
    title, worst = "overshoot with twice the lag, %", float(lagged.max())
    yield Figure(3, title, plant, f"{LAG_OVERSHOOT_PERCENT:g}", car.letter, f"{worst:.1f}", worst <= LAG_OVERSHOOT_PERCENT)
    tyres = Condition("relaxation", "relaxation length 0.6 m", "tyre", plant=relaxation(LONG_RELAXATION_M))
    worst = float(_overshoots(car, plant, [Setting(tyres)]).max())
    title, goal = f"overshoot, relaxation {LONG_RELAXATION_M:g} m, %", f"{RELAXATION_OVERSHOOT_PERCENT:g}"
    yield Figure(3, title, plant, goal, car.letter, f"{worst:.1f}", worst <= RELAXATION_OVERSHOOT_PERCENT)


def _overshoots(car: LawCar, plant: str, settings: list[Setting]) -> FloatArray:
    """Return overshoots (settings, cells) in percent; infinite for a controlled car that spins, zero for the passive one."""
    runs = car.drive(car.steps, plant, settings)
    found = np.maximum(per_setting(StepResponse(runs).overshoot_percent, settings), 0.0)
    lost = np.array([[np.inf if each.controlled else 0.0] for each in settings])
    return np.where(spun(runs, settings), lost, found)


def sines(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 4: gain of the yaw rate of a sine over that of the map."""
    duration = SINE_PERIODS / SINE_HZ
    drives = Drives(
        "sine",
        lambda time: np.sin(2.0 * np.pi * SINE_HZ * time) * np.minimum(time, 1.0),
        duration,
        0.0,
        np.array([SINE_KM_H * KM_H]),
        np.array([math.radians(SINE_ANGLE_DEG)]),
    )
    runs = car.drive(drives, plant, [Setting()])
    response = SineResponse(runs, SINE_HZ)
    asked = car.map_yaw_rate(runs.signals["speed_m_s"], runs.signals["front_angle_rad"])
    map_gain = SineResponse(Runs(runs.time, {**runs.signals, "yaw_rate_rad_s": asked}, 0.0), SINE_HZ).yaw_rate_gain_per_s
    gain = float((response.yaw_rate_gain_per_s / map_gain)[0])
    title, goal = f"gain at {SINE_HZ:g} Hz, {SINE_KM_H:g} km/h, over the map's", f"{GAIN_RANGE[0]:g} to {GAIN_RANGE[1]:g}"
    yield Figure(4, title, plant, goal, car.letter, f"{gain:.2f}", GAIN_RANGE[0] <= gain <= GAIN_RANGE[1])


def gusts(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 10: heading and path after a gust, and the phase margin that the feedback leaves."""
    arm = car.config.vehicle.cg_to_front_axle_m
    end = GUST_START_S + GUST_S

    def moment(time: FloatArray) -> FloatArray:
        return np.where((time >= GUST_START_S) & (time < end), GUST_N * arm, 0.0)

    drives = Drives.straight(end + GUST_READ_S + 0.1, GUST_SPEEDS_KM_H, moment=moment, moment_arm=arm)
    settings = [Setting(), Setting(acceleration_bias=math.nan), Setting(controlled=False)]
    runs = car.drive(drives, plant, settings)
    heading, _, left = paths(runs)
    place = int(np.searchsorted(runs.time, end + GUST_READ_S - 1e-9))
    angles, ways = (np.abs(per_setting(values[place], settings)) for values in (np.degrees(heading), left))
    goal = f"{HEADING_MAX_DEG:g} deg, {PATH_MAX_M:g} m"
    texts = [f"{angle.max():.2f}, {way.max():.2f}" for angle, way in zip(angles, ways, strict=True)]
    is_met = bool(angles[0].max() <= HEADING_MAX_DEG and ways[0].max() <= PATH_MAX_M)
    yield Figure(
        10, "gust: heading and path 3 s after its end, measured acceleration", plant, goal, car.letter, texts[0], is_met
    )
    by_speed = "/".join(f"{angle:.2f}" for angle in angles[0])
    yield Figure(10, "gust: heading by speed, measured acceleration", plant, "", car.letter, by_speed)
    yield Figure(10, "gust, no measured acceleration", plant, "", car.letter, texts[1])
    yield Figure(10, "gust, passive", plant, "", car.letter, texts[2])
    if plant == IDEAL:  # the margins are those of linear cars
        yield from _margins(car)


def _margins(car: LawCar) -> Iterator[Figure]:
    """Yield the margins of the configured car and of its family, with twice the lag and relaxation, and without both."""
    config, plant, lag = car.config, "linear", car.config.rear_actuator.lag_s
    alone = Member(LAG_FACTOR * lag, relaxation_length=SHORT_RELAXATION_M)
    worst = _worst(car, [alone])
    title, goal = "phase margin, twice the lag, relaxation 0.4 m", f"{PHASE_MIN_DEG:g} deg"
    yield Figure(10, title, plant, goal, car.letter, f"{worst[1]:.0f}", worst[1] >= PHASE_MIN_DEG)
    family = members(config)
    slow = [each for each in family if each.actuator_lag >= LAG_FACTOR * lag * (1.0 - 1e-9) and each.relaxation_length > 0.0]
    tuning = config.tuning
    asked = (tuning.gain_margin_db, tuning.phase_margin_deg, tuning.sensitivity_max)
    groups = {
        "twice the lag and relaxation": (slow, SLOW_MARGINS),
        "all others": ([each for each in family if each not in slow], asked),
    }
    for title, (chosen, (gain, phase, peak)) in groups.items():
        found = _worst(car, chosen)
        is_met = found[0] >= gain - ROUNDING and found[1] >= phase - ROUNDING and found[2] <= peak + ROUNDING
        goal, text = f"{gain:g} dB, {phase:g} deg, {peak:g}", f"{found[0]:.1f}, {found[1]:.0f}, {found[2]:.2f}"
        yield Figure(10, f"margins of the family, {title}", plant, goal, car.letter, text, is_met)


def _worst(car: LawCar, chosen: Sequence[Member]) -> tuple[float, float, float]:
    """Return the least gain margin in dB and phase margin in deg, and the largest sensitivity, over speed."""
    config = car.config
    speed = np.array(up_to(family_range_km_h(config)[1], MARGIN_SPEEDS_KM_H)) * KM_H
    kp, ki = gains_of(schedule_of(config))(speed)
    frequency = frequency_grid(config.controller.sampling_time_s)
    found = loop_margins(sample(config, tuple(chosen), speed), kp, ki, frequency)
    return float(found.gain_margin_db.min()), float(found.phase_margin_deg.min()), float(found.sensitivity.max())


def offsets(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 11: change of the heading on a straight with offsets of the sensors."""
    settings = [Setting(acceleration_bias=bias, yaw_rate_bias=BIAS_RAD_S) for bias in (math.nan, BIAS_M_S2, -BIAS_M_S2, 0.0)]
    runs = car.drive(Drives.straight(BEFORE_S + STRAIGHT_S + 0.1, STRAIGHT_SPEEDS_KM_H), plant, settings)
    heading, _, _ = paths(runs)
    begin, end = np.searchsorted(runs.time, np.array([BEFORE_S, BEFORE_S + STRAIGHT_S]) - 1e-9)
    changes = per_setting(np.abs(np.degrees(heading[end] - heading[begin])), settings).max(axis=1)
    groups = {"not measured": changes[:1], f"bias {BIAS_M_S2:g} m/s^2": changes[1:3]}
    for title, found in groups.items():
        worst = float(found.max())
        title = f"yaw-rate bias 0.25 deg/s, 7 s straight, acceleration {title}: change of heading"
        goal, is_met = f"{STRAIGHT_MAX_DEG:g} deg", worst <= STRAIGHT_MAX_DEG
        yield Figure(11, title, plant, goal, car.letter, f"{worst:.2f}", is_met)
    yield Figure(11, "the same, measured acceleration without a bias", plant, "", car.letter, f"{changes[3]:.2f}")


ROWS = {2: minimal_errors, 3: overshoots, 4: sines, 10: gusts, 11: offsets}
"""Number of a row -> its figures of a car on a plant."""

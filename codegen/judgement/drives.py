"""The drives of the judgement besides the lane change: steps, sines and sines with dwell, with and without the controller."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.judgement.bench import Bench
from codegen.judgement.passive import PassiveTurns
from codegen.map_file.map import ReferenceMap
from codegen.metrics import Runs, SineWithDwell, StepResponse
from codegen.metrics.runs import METRIC_COLUMNS, largest, spin_times
from codegen.metrics.sine import RATIOS, SineResponse, displacement_min
from codegen.units import KM_H
from hil_sim.scenarios import DEFAULT_SCENARIO, SCENARIOS, Scenario

SPEEDS_KM_H = (60.0, 80.0)
"""Speeds of steps and sines; the last speed of the map follows."""
STEP_SHARES = (0.25, 0.5, 0.8, 0.95)
"""Amplitudes of the steps as fractions of the lateral acceleration that the car can use: the front angle of the passive car."""
OWN_SHARES = (0.5, 0.8, 0.95)
"""Further amplitudes, as fractions of the yaw rate that the map reaches: where the passive car turns more, the steps above end
far from the limit of the controlled car."""
STEER_TIME, STEP_DURATION = 0.2, 6.0
"""Times in s: a step begins, ends. Its last second is the steady state."""

SINE_HZ, SINE_PERIODS = 1.0, 6
SINE_LATERAL_ACCELERATION = 2.0
"""m/s^2 of the passive car in a steady turn at the peak of the steering angle: half of the step of ISO 7401."""

DWELL_KM_H = 80.0
"""Speed of the sine with dwell (49 CFR 571.126, S7.9); that of the scenario."""
DWELL_AMPLITUDES = (5.0, 5.5, 6.0, 6.5)
"""Multiples of the steering angle for 0.3 g: from the first one of which the displacement is required to the last one of the
standard's series (49 CFR 571.126, S5.2.3 and S7.9.4)."""
NOMINAL_AMPLITUDE = DWELL_AMPLITUDES[0]

SWEEP_AMPLITUDES = (5.0, 5.5, 6.0, 6.5, 7.0)
SWEEP_FRICTIONS = (0.7, 0.8, 0.9)
"""Frictions of the road, at most the configured one."""
SWEEP_MASSES = (0.9, 1.0, 1.1, 1.2)
"""Factors; the yaw inertia goes with the mass."""
SWEEP_RUNS = len(SWEEP_AMPLITUDES) * len(SWEEP_FRICTIONS) * len(SWEEP_MASSES)


@dataclass(frozen=True)
class StepFigures:
    """Steps (k,), figures (2, k) of the controlled and the passive car.

    Attributes:
        speed_km_h, front_angle_deg: (k,).
        yaw_rate_deg_s, sideslip_deg: steady.
        overshoot_percent, rise_s: by quantity; inf for a car that spins.
        peaks: see `Peaks`.
    """

    speed_km_h: FloatArray
    front_angle_deg: FloatArray
    yaw_rate_deg_s: FloatArray
    sideslip_deg: FloatArray
    overshoot_percent: dict[str, FloatArray]
    rise_s: dict[str, FloatArray]
    peaks: Peaks


@dataclass(frozen=True)
class SineFigures:
    """Sines at speeds (k,) in km/h: delays (2, k) in s by quantity."""

    speed_km_h: FloatArray
    delay_s: dict[str, FloatArray]


@dataclass(frozen=True)
class DwellFigures:
    """Sines with dwell of DWELL_AMPLITUDES (k,), figures (2, k) of the controlled and the passive car.

    Attributes:
        displacement_m, needed_m: lateral displacement, and the one that the standard requires.
        ratio_percent: yaw-rate ratio by its time after the steering in s; inf for a car that spins.
        peaks: see `Peaks`.
    """

    displacement_m: FloatArray
    needed_m: float
    ratio_percent: dict[float, FloatArray]
    peaks: Peaks


@dataclass(frozen=True)
class SweepFigures:
    """Counts of a sweep of sines with dwell over amplitude, friction and mass.

    Attributes:
        runs: all runs.
        passive: runs in which the passive car reaches the displacement.
        short: of these, runs in which the controlled car does not.
        failed: runs in which the passive car meets all criteria and the controlled one does not.
    """

    runs: int
    passive: int
    short: int
    failed: int


@dataclass(frozen=True)
class Peaks:
    """Largest magnitudes in rad of drives (k,): sideslip angle, front and rear slip angle; (2, k) each."""

    sideslip: FloatArray
    slip_front: FloatArray
    slip_rear: FloatArray

    @classmethod
    def of(cls, runs: Runs) -> Peaks:
        """Return the peaks after the start of steering."""
        names = ("sideslip_rad", "slip_front_rad", "slip_rear_rad")
        return cls(*(_both(largest(runs.signals[name][runs.after])) for name in names))


Kind = TypeVar("Kind", bound=np.generic)

QUANTITIES = ("yaw rate", "lateral acceleration")


def speeds_of(config: Config, speed: FloatArray) -> list[float]:
    """Return the speeds in km/h of steps and sines within the speeds of a map (n,) in m/s, up to the top speed of the car."""
    first, last = speed[0] / KM_H, min(float(speed[-1] / KM_H), config.top_speed_km_h)
    return [*(kmh for kmh in SPEEDS_KM_H if first <= kmh < last * (1.0 - 1e-9)), round(last, 6)]


def drive_steps(bench: Bench, map_speed: FloatArray, reference_map: ReferenceMap | None) -> StepFigures | None:
    """Drive the steps within the speeds (n,) in m/s of a map, first that of the default scenario; None if there are none.

    Without the map, the steps up to what the controlled car can use are left out.
    """
    config = bench.config
    speed, front_angle = _step_cells(config, map_speed, reference_map)
    if not speed.size:
        return None
    time = bench.time(STEP_DURATION)
    profile = bench.profile(np.where(time >= STEER_TIME - 1e-9, config.steering.ratio, 0.0), STEP_DURATION)
    runs = bench.run(profile, STEER_TIME, METRIC_COLUMNS, speed=speed, wheel=front_angle)
    step, spun = StepResponse(runs), ~np.isnan(spin_times(runs))

    def unless_spun(values: FloatArray) -> FloatArray:
        return _both(np.where(spun | np.isnan(values), np.inf, values))

    overshoots = (step.overshoot_percent, step.lateral_acceleration_overshoot_percent)
    rises = (step.rise_time_interpolated_s, step.lateral_acceleration_rise_time_s)
    return StepFigures(
        speed / KM_H,
        np.degrees(front_angle),
        _both(step.yaw_rate_steady_deg_s),
        _both(np.abs(step.sideslip_steady_deg)),
        dict(zip(QUANTITIES, map(unless_spun, overshoots), strict=True)),
        dict(zip(QUANTITIES, map(unless_spun, rises), strict=True)),
        Peaks.of(runs),
    )


def _step_cells(config: Config, map_speed: FloatArray, reference_map: ReferenceMap | None) -> tuple[FloatArray, FloatArray]:
    """Return speeds in m/s and front angles in rad of the steps."""
    speed: FloatArray = np.array(speeds_of(config, map_speed)) * KM_H
    turns = PassiveTurns.of(config, speed)
    usable = np.minimum(turns.largest, config.limits.lateral_acceleration_max_g * config.road.gravity_m_s2)
    angle = turns.front_angle_at(np.outer(usable, STEP_SHARES))
    if reference_map is not None:
        angle = np.hstack([angle, [angles_at(reference_map, each, OWN_SHARES) for each in speed]])
    angle = np.minimum(angle, config.steering.front_angle_stop)
    is_known: BoolArray = np.isfinite(angle) & (angle > 0.0)
    speeds, angles = np.repeat(speed, angle.shape[1])[is_known.ravel()], angle[is_known]
    base = SCENARIOS[DEFAULT_SCENARIO].settings
    assert base.steering_wheel_angle_deg is not None  # the default scenario has one
    if not map_speed[0] <= base.speed <= map_speed[-1]:
        return speeds, angles
    own = math.radians(base.steering_wheel_angle_deg) / config.steering.ratio
    return np.append(base.speed, speeds), np.append(own, angles)


def angles_at(reference_map: ReferenceMap, speed: float, shares: Sequence[float]) -> FloatArray:
    """Return the front angles (k,) in rad at which a map has shares (k,) of its largest yaw rate at a speed; NaN for none."""
    row = int(np.argmin(np.abs(reference_map.speed - speed)))
    known = reference_map.feasible[row]
    if not known.any():
        return np.full(len(shares), np.nan)
    yaw_rate = np.maximum.accumulate(np.append(0.0, reference_map.yaw_rate[row, known]))
    angles = np.append(0.0, reference_map.front_angle[known])
    found: FloatArray = np.interp(np.array(shares) * yaw_rate[-1], yaw_rate, angles)
    return found


def drive_sines(bench: Bench, map_speed: FloatArray) -> SineFigures | None:
    """Drive a sine at speeds within those (n,) in m/s of a map; None without a steady turn of the passive car."""
    config = bench.config
    speed: FloatArray = np.array(speeds_of(config, map_speed)) * KM_H
    angle = PassiveTurns.of(config, speed).front_angle_at(np.full((speed.size, 1), SINE_LATERAL_ACCELERATION))[:, 0]
    is_known: BoolArray = np.isfinite(angle)
    if not is_known.any():
        return None
    time, duration = bench.time(SINE_PERIODS / SINE_HZ), SINE_PERIODS / SINE_HZ
    wave = bench.profile(config.steering.ratio * np.sin(2.0 * np.pi * SINE_HZ * time), duration)
    runs = bench.run(wave, 0.0, METRIC_COLUMNS, speed=speed[is_known], wheel=angle[is_known])
    sine = SineResponse(runs, SINE_HZ)
    delays = (sine.yaw_rate_delay_s, sine.lateral_acceleration_delay_s)
    return SineFigures(speed[is_known] / KM_H, dict(zip(QUANTITIES, map(_both, delays), strict=True)))


def _dwells(bench: Bench, amplitude: FloatArray, **changes: Any) -> tuple[SineWithDwell, Runs]:
    scenario: Scenario = SCENARIOS["sine-with-dwell"]
    # The angle is that of the driven car, in steps of the batch, whose own car may be another with the same parts.
    car = bench.config.unchecked({"plant.sampling_time_s": bench.software.config.plant.sampling_time_s})
    # The inputs of the scenario at 80 km/h are for one run; a run's factor of the speed is one.
    runs = bench.run(
        scenario.inputs(car),
        scenario.steer_time,
        METRIC_COLUMNS,
        speed=np.ones(amplitude.size),
        wheel=amplitude / NOMINAL_AMPLITUDE,
        **changes,
    )
    return SineWithDwell(runs), runs


def drive_dwells(bench: Bench) -> DwellFigures:
    """Drive the sines with dwell. Raises CodegenError for a car that cannot: see `manoeuvres.steering_wheel_angle`."""
    dwell, runs = _dwells(bench, np.array(DWELL_AMPLITUDES))
    spun = ~np.isnan(spin_times(runs))
    ratios = {after: _both(np.where(spun, np.inf, getattr(dwell, name))) for name, (after, _) in RATIOS.items()}
    needed = float(displacement_min(bench.config.vehicle.mass_kg))
    return DwellFigures(_both(dwell.displacement), needed, ratios, Peaks.of(runs))


def drive_sweep(bench: Bench) -> SweepFigures:
    """Drive sines with dwell of cars of other mass on other roads, without an estimate of the friction. Raises as above."""
    amplitude, friction, mass = np.array(list(itertools.product(SWEEP_AMPLITUDES, SWEEP_FRICTIONS, SWEEP_MASSES))).T
    dwell, runs = _dwells(bench, amplitude, friction=np.minimum(friction, bench.config.road.friction), mass=mass)
    far, far_passive = _both(dwell.displacement >= displacement_min(runs.mass))
    met, met_passive = _both(dwell.outcome == 1.0)
    return SweepFigures(
        amplitude.size, int(far_passive.sum()), int((far_passive & ~far).sum()), int((met_passive & ~met).sum())
    )


def _both(values: npt.NDArray[Kind]) -> npt.NDArray[Kind]:
    """Return values (2 k,) of runs of the controlled and the passive car as (2, k)."""
    return values.reshape(2, -1)

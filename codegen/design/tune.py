"""The controller of kind "tracking" for a map: gains by design, the transient from step responses, the trim, and the rate of
the fail-safe.

The fail-safe returns the rear angle to zero after all inputs are lost. The controller no longer sees the driver. If the ramp is
slow and the driver straightens the wheel, the rear wheels are still turned. If it is fast and the driver holds the wheel, the
rear axle loses its lateral support. No rate suits every driver, so each candidate is simulated on the nonlinear plant with the
C, with all drivers, in corners up to the edge of the map.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.configuration.controller import TRIM_MAX_PERCENT
from codegen.design.gains import Design, design
from codegen.design.lead import Response, compile_controller, family_of, tune_response, unit_step, with_response
from codegen.ecu_map.extend import extend
from codegen.ecu_map.model_excess import TRIM_WARNING_FACTOR, Excess, asks_for_more, model_excess
from codegen.map_file.map import ReferenceMap
from codegen.metrics.runs import is_spinning
from codegen.optimum.problem import breakpoints
from codegen.optimum.turns import turns_of
from codegen.sil.batch import NOISES, BatchSoftware, Lanes
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.units import KM_H
from codegen.vehicle.population import require_accepted

Driver = Callable[[FloatArray], FloatArray]
"""Fraction of the front angle as a function of the time since the driver acts, in s, >= 0."""

RATES_DEG_S = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
"""Candidates in addition to the configured rate."""

SPEED_SHARES = (2.0 / 3.0, 0.75, 5.0 / 6.0, 11.0 / 12.0, 1.0)
"""Fractions of the last speed of the map and of the design: 80 to 120 km/h if that is 120 km/h. Slower cars do not spin."""
ANGLE_SHARES = (0.5, 0.75, 1.0)
"""Fractions of the largest feasible front angle."""

STEER_START, STEER_DURATION, LOSS_TIME, DRIVER_TIME, DRIVE_END = 0.3, 0.3, 2.0, 2.2, 6.0
"""Times in s: the driver steers in, all inputs are lost, the driver acts, the drive ends."""


def keep(seconds: FloatArray) -> FloatArray:
    """Hold the wheel where it is."""
    return np.ones_like(seconds)


def straighten(seconds: FloatArray) -> FloatArray:
    """Straighten the wheel within 0.3 s."""
    return np.maximum(0.0, 1.0 - seconds / 0.3)


def straighten_slowly(seconds: FloatArray) -> FloatArray:
    """Hold the wheel for 0.5 s, then straighten it within 1 s."""
    return np.clip(1.5 - seconds, 0.0, 1.0)


def counter_steer(seconds: FloatArray) -> FloatArray:
    """Steer to 0.6 of the angle on the other side within 0.4 s, hold until 0.9 s, then straighten within 0.3 s."""
    return np.where(seconds < 0.9, np.maximum(-0.6, 1.0 - 1.6 * seconds / 0.4), np.minimum(0.0, -0.6 + 2.0 * (seconds - 0.9)))


FAIL_SAFE_DRIVERS: tuple[Driver, ...] = (keep, straighten, straighten_slowly, counter_steer)


@dataclass(frozen=True)
class RateOutcome:
    """Drives with one rate.

    Attributes:
        rate_deg_s: rate of the fail-safe.
        spins, runs: counts for the configured car with all drivers. Spins without any loss do not count.
        family_spins, family_runs: counts for cars of other mass, tyres or lag; None and 0 where they were not driven,
            because the configured car spins more often than with another rate.
        sideslip_max_deg: largest of the configured car, after the loss.
    """

    rate_deg_s: float
    spins: int
    runs: int
    family_spins: int | None
    family_runs: int
    sideslip_max_deg: float

    @property
    def cost(self) -> tuple[float, float, float]:
        """Cost, which the best rate minimises in order: spins of the configured car, of the others, and the sideslip angle."""
        return self.spins, math.inf if self.family_spins is None else self.family_spins, self.sideslip_max_deg


@dataclass(frozen=True)
class FailSafeRate:
    """The chosen rate and all candidates, the configured one first."""

    rate_deg_s: float
    outcomes: tuple[RateOutcome, ...]


def tune_fail_safe(
    reference_map: ReferenceMap,
    config: Config,
    software: BatchSoftware,
    progress: Callable[[int, int], None] | None = None,
    rates_deg_s: Sequence[float] = RATES_DEG_S,
) -> FailSafeRate:
    """Return the rate with the fewest spins. Keep the configured one if no other is better.

    The configured car is driven with every rate, the rest of the family only with the rates at which it spins least.

    Args:
        reference_map: solved for the car of the configuration.
        config: with the tuned controller.
        software: the build of that map for this car; parameters tuned later come from the configuration.
        progress: called with (done, in all).
        rates_deg_s: candidates in addition to the configured rate.
    """
    configured = config.controller.fail_safe.rate_deg_s
    candidates = (configured, *(rate for rate in rates_deg_s if rate != configured))
    family, _ = family_of(config)
    own = _Drives.of(reference_map, config, software, family[:1])
    outcomes = []
    for rate, spins, sideslip in _spins(own, candidates, progress):
        outcomes.append(RateOutcome(rate, int(spins.sum()), spins.size, None, 0, round(sideslip, 1)))
    fewest = min(outcome.spins for outcome in outcomes)
    at = {outcome.rate_deg_s: k for k, outcome in enumerate(outcomes)}
    others = _Drives.of(reference_map, config, software, family[1:])
    for rate, spins, _ in _spins(others, [one.rate_deg_s for one in outcomes if one.spins == fewest], progress):
        outcomes[at[rate]] = replace(outcomes[at[rate]], family_spins=int(spins.sum()), family_runs=spins.size)
    return FailSafeRate(best(outcomes).rate_deg_s, tuple(outcomes))


def _spins(
    drives: _Drives, rates: Sequence[float], progress: Callable[[int, int], None] | None
) -> list[tuple[float, BoolArray, float]]:
    """Return for each rate the spins (drivers, runs) that the loss causes, and the largest sideslip angle in deg."""
    jobs: list[tuple[float | None, Driver]] = [(rate, driver) for rate in (None, *rates) for driver in FAIL_SAFE_DRIVERS]
    found = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # the C runs without the interpreter's lock
        for done, result in enumerate(pool.map(lambda job: drives.drive(*job), jobs), start=1):
            found.append(result)
            if progress is not None:
                progress(done, len(jobs))
    spins, sideslip = (np.array(values).reshape(-1, len(FAIL_SAFE_DRIVERS), drives.runs) for values in zip(*found, strict=True))
    return [(rate, spins[k] & ~spins[0], float(sideslip[k].max())) for k, rate in enumerate(rates, start=1)]


def best(outcomes: Sequence[RateOutcome]) -> RateOutcome:
    """Return the outcome with the least cost, the first of equals."""
    return min(outcomes, key=lambda outcome: outcome.cost)


def tuned_parameters(software: BatchSoftware, config: Config) -> Any:
    """Return the build's parameters, updated with those that `codegen tune` set after the build."""
    tracking = config.controller.tracking
    assert tracking.schedule is not None  # the configuration is tuned
    parameters = software.parameters(fail_safe_rate=math.radians(config.controller.fail_safe.rate_deg_s))
    if tracking.schedule.lead_s is not None:
        parameters.lead_time = tracking.schedule.lead_s
    if tracking.schedule.response_gain_s is not None:
        parameters.response_gain = tracking.schedule.response_gain_s
    parameters.lead_angle_max = math.radians(tracking.lead_max_deg)
    parameters.response_samples = tracking.response_ahead_s / config.controller.sampling_time_s
    parameters.trim_share = tracking.trim_max_percent / 100.0
    return parameters


@dataclass(frozen=True)
class _Drives:
    """Cells of the drives, and the batch that drives them."""

    software: BatchSoftware
    config: Config
    lanes: Lanes

    @classmethod
    def of(cls, reference_map: ReferenceMap, config: Config, software: BatchSoftware, cars: FloatArray) -> _Drives:
        """Return the cells of cars, rows of PLANT_PARAMETERS, on the map."""
        assert reference_map.case is not None  # a solved map has one
        axis, angles = breakpoints(config)
        speed: FloatArray = min(float(axis[-1]), config.top_speed_km_h * KM_H) * np.array(SPEED_SHARES)
        speed = speed[speed >= max(float(axis[0]), config.controller.feedback_speeds_km_h[1] * KM_H)]
        edge = turns_of(config, config.case(reference_map.case)).edge(speed, float(angles[-1])).front_angle
        angle: FloatArray = np.outer(np.minimum(edge, angles[-1]), ANGLE_SHARES)
        lanes = Lanes(
            np.repeat(cars, angle.size, axis=0),
            speed_factor=np.tile(np.repeat(speed, len(ANGLE_SHARES)), len(cars)),
            wheel_factor=np.tile(angle.ravel(), len(cars)) * config.steering.ratio,
            delay_samples=config.designed_delay_samples,
        )
        return cls(software, config, lanes)

    @property
    def runs(self) -> int:
        """Number of runs: cars times cells."""
        return len(self.lanes.cars)

    def drive(self, rate_deg_s: float | None, driver: Driver) -> tuple[BoolArray, FloatArray]:
        """Drive all cars in all cells, with the loss and this rate; None drives without a loss.

        Returns:
            (runs,) whether each spins, and (runs,) its largest sideslip angle after the loss, in deg.
        """
        period = self.config.controller.sampling_time_s
        lost_from, samples = round(LOSS_TIME / period), round(DRIVE_END / period)
        parameters, lanes = tuned_parameters(self.software, self.config), self.lanes
        if rate_deg_s is not None:
            parameters.fail_safe_rate = math.radians(rate_deg_s)
            noise = np.zeros((samples, len(NOISES), self.runs))
            noise[lost_from:, : NOISES.index("yaw_rate") + 1] = math.nan
            lanes = replace(lanes, noise=noise)
        sideslip, slip = self.software.run(self._profile(driver), lanes, parameters, ("sideslip_rad", "slip_rear_rad"))
        spins: BoolArray = np.any(is_spinning(sideslip, slip), axis=0)
        return spins, np.degrees(np.nan_to_num(np.abs(sideslip[lost_from:]), nan=math.pi).max(axis=0))

    def _profile(self, driver: Driver) -> FloatArray:
        """Return the inputs (steps, 7), INPUT_COLUMNS, of a front angle of 1 rad / steering ratio at 1 m/s."""
        profile = unit_step(self.software.config, STEER_START, DRIVE_END)
        time: FloatArray = np.arange(profile.shape[0], dtype=np.float64) * self.software.config.plant.sampling_time_s
        share = np.clip((time - STEER_START) / STEER_DURATION, 0.0, 1.0)
        share[time >= DRIVER_TIME] = driver(time[time >= DRIVER_TIME] - DRIVER_TIME)
        profile[:, INPUT_COLUMNS.index("steering_wheel_command")] = share
        return profile


Progress = Callable[[int, int], None]

TRIM_TIME_MAX_S = 0.3
"""Largest time constant of the trim for a map of the nonlinear tyre; the trim must finish before the car counts as settled."""


@dataclass(frozen=True, eq=False)
class Tuned:
    """A configuration with its tuned controller, and the results of each step.

    Attributes:
        config: kind "tracking", with gain schedule, look ahead, trim and rate of the fail-safe.
        design: design of the gains.
        responses: lead and response gain at each speed of the schedule that was driven; empty for a map that was not solved.
        excess: excess of the reference model over the map with the response gain; None where none is possible.
        fail_safe: rate of the fail-safe, and the candidates; None for a map that was not solved.
        software: the build that was driven, without the parameters tuned on it (see `tuned_parameters`); None for
            a map that was not solved.
    """

    config: Config
    design: Design
    responses: tuple[Response, ...]
    excess: Excess | None
    fail_safe: FailSafeRate | None
    software: BatchSoftware | None

    @property
    def trim_is_enough(self) -> bool:
        """Whether the trim takes back all of the excess."""
        return self.excess is None or self.excess.trim_percent <= TRIM_MAX_PERCENT


def tune(reference_map: ReferenceMap, config: Config, progress: Progress | None = None, where: object = "tuned") -> Tuned:
    """Tune the controller of a configuration for a map; the same input gives the same numbers.

    Args:
        reference_map: solved for the car of the configuration.
        progress: called with (done, in all).
        where: the place that an error names.

    Raises:
        ConfigError: no gains meet the demands, see `design`; the identification of the car is in doubt.
        BuildError: no C compiler.
        MapError: see `model_excess`.
    """
    require_accepted(config)
    made = design(config, progress)
    config = with_tracking(config, {"schedule": made.schedule}, where)
    if not reference_map.solved:
        return Tuned(config, made, (), None, None, None)
    tracking = config.controller.tracking
    if asks_for_more(reference_map, config):
        config = with_tracking(config, {"trim_time_s": min(tracking.trim_time_s, TRIM_TIME_MAX_S)}, where)
    least = tracking.trim_max_percent
    start, _ = _with_trim(reference_map, config, least, where)
    while True:  # the trim is part of the step responses, and their response gain reduces the excess
        software = compile_controller(reference_map, start)
        ahead, responses = tune_response(reference_map, start, made.schedule, software, progress)
        config = with_tracking(start, with_response(start, made.schedule, ahead, responses), where)
        changed, excess = _with_trim(reference_map, config, least, where)
        if changed is config:
            break
        least = changed.controller.tracking.trim_max_percent  # from here on the trim only rises
        start = with_tracking(start, {"trim_max_percent": least}, where)
    fail_safe = tune_fail_safe(reference_map, config, software, progress)
    config = with_controller(config, {"fail_safe": {"rate_deg_s": fail_safe.rate_deg_s}}, where)
    return Tuned(config, made, responses, excess, fail_safe, software)


def _with_trim(reference_map: ReferenceMap, config: Config, least: float, where: object) -> tuple[Config, Excess | None]:
    """Return the configuration with the trim that the map needs, and the model's excess; None where none is possible.

    A trim without a warning is kept, so that the step responses do not change. Another one is `least` percent or more.
    """
    if not asks_for_more(reference_map, config):
        return config, None
    excess = model_excess(reference_map, extend(reference_map, config, config.steering.front_angle_stop), config)
    needed, own = max(excess.trim_percent, 1), config.controller.tracking.trim_max_percent
    trim = min(max(float(needed), least), TRIM_MAX_PERCENT)
    if trim == own or excess.percent <= own <= TRIM_WARNING_FACTOR * needed:
        return config, excess
    return with_tracking(config, {"trim_max_percent": trim}, where), excess


def with_tracking(config: Config, changes: Mapping[str, Any], where: object) -> Config:
    """Return the configuration with kind "tracking" and changed keys of [controller.tracking]."""
    return with_controller(config, {"tracking": changes}, where)


def with_controller(config: Config, changes: Mapping[str, Mapping[str, Any]], where: object) -> Config:
    """Return the configuration with kind "tracking" and changed keys of tables of [controller]."""
    return config.replace({"controller": {"kind": "tracking", **changes}}, where)

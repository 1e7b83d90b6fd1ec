"""Lead and response gain of kind "tracking" over speed, from step responses of the nonlinear plant around the generated C.

Both shape the feedforward alone, so no margin of the loop depends on them. The configured car must keep its limits at each
speed of the schedule and half way to the neighbouring ones. Pairs that meet these limits are compared by the excess of a small
family of cars over its own limits, then by the rise time plus a price on overshoot.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config, Schedule
from codegen.configuration.controller import RESPONSE_GAIN_MAX_S
from codegen.design.family import ELLIPSOID_SHARE, measured_keys
from codegen.emit.build import BuildInputs, BuildOptions, build_code
from codegen.map_file.map import ReferenceMap
from codegen.metrics import Runs, StepResponse
from codegen.metrics.runs import is_spinning
from codegen.optimum.problem import breakpoints
from codegen.optimum.turns import turns_of
from codegen.sil.batch import BatchSoftware, Lanes, compile_batch
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.units import KM_H
from codegen.vehicle.dynamics import PLAY_TIME_CONSTANT
from codegen.vehicle.plant_car import PLANT_PARAMETERS, plant_parameters, varied_cars
from codegen.vehicle.population import Population
from codegen.vehicle.single_track import SingleTrack

_LOOP_GAIN_SHARE = 0.6
"""Share of the gain at which the loop no longer decays: a gain margin of 4.4 dB. Nothing in this loop is uncertain."""
_LOOP_DURATION_S = 4.0
_LOOP_DECAY = 0.05
"""Largest yaw rate at the end of that time, as a fraction of the first one."""
_LOOP_YAW_RATE = 1e-3
"""First yaw rate in rad/s, so small that the tyres are linear."""
_LOOP_BISECTIONS = 8

OVERSHOOT_PERCENT, SETTLING_S = 3.0, 2.0
"""Targets for the configured car."""
OVERSHOOT_MAX_PERCENT, SETTLING_MAX_S = 5.0, 2.5
"""Limits of the configured car where it cannot meet both targets. The settling time ends with the play of the actuator, which
moves the yaw rate by more than 2 %: limits of 1.4 s cost eight random cars up to 4 points of overshoot."""
RISE_MAX_S, RISE_FROM_KM_H = 0.36, 79.0
"""Limit of the rise time of the configured car, and the speed from which it counts."""
DEVIATION_OVERSHOOT_PERCENT, REAR_AXLE_OVERSHOOT_PERCENT, RELAXATION_OVERSHOOT_PERCENT = 3.0, 15.0, 10.0
"""Limits of overshoot in the family: mass or tyres of both axles, tyres of the rear axle alone, or the relaxation length
differ."""
FRONT_GRIP_FACTOR, FRONT_GRIP_OVERSHOOT_PERCENT = 0.75, 10.0
"""Stiffness and peak of other front tyres, and the limit with them: the response gain must not swing with the assumed grip."""
RELAXATION_FACTOR = 1.5
LAG_FACTORS = (0.4, 2.0)
LAG_OVERSHOOT_PERCENT = (5.0, 15.0)
"""Limits of overshoot with another lag, one for each factor; with a measured lag the first."""
LAG_KEY = "rear_actuator.lag_s"
"""Key of `[identified]` whose uncertainty replaces LAG_FACTORS."""
RELAXATION_KEY = "plant.relaxation_length_m"
STIFFNESS_KEYS = frozenset(f"tyre.{axle}.cornering_stiffness_n_per_rad" for axle in ("front", "rear"))
"""Keys of which one at least replaces the deviations of the tyres."""
STATIC_OVERSHOOT_FACTOR = 0.6
"""The limit of a car with another lag is at least this factor times its overshoot without lead and response gain: rear wheels
that follow late leave the beginning of a step to the front wheels."""
OVERSHOOT_PRICE_S = 0.005
"""Cost of one percent of overshoot, in s of t90, for the car of the family with the most overshoot."""

LEAD_ANGLE_SHARES = (0.25, 0.5, 0.75, 1.0)
"""Fractions of the largest feasible front angle."""
LARGER_FROM = LEAD_ANGLE_SHARES.index(0.5)
"""First fraction at which a car must keep its limits if it cannot keep them at every angle. At small angles, where an
understeering car overshoots most, the same percentage is a smaller yaw rate."""
SPEED_MIN_KM_H = 25.0
"""Breakpoints of the schedule below this speed take the pair of the first breakpoint above it. A slow car follows its wheels
without delay, so no pair need be tuned there."""

STEER_TIME, DURATION, STEADY_WINDOW = 0.2, 4.0, 0.5
"""Times in s: a step begins, ends, and is averaged for the steady yaw rate."""

LEADS_S = (-0.02, 0.0, 0.02, 0.04, 0.07, 0.10, 0.14)
"""Leads of the first pairs. Lead amplifies noise: 0.14 s turn 0.01 deg of the front angle into about 0.1 deg of rear angle."""
RESPONSE_GAINS_S = (0.0, 0.06, 0.12, 0.2, 0.35, 0.6, 0.9, 1.2)
"""Response gains of the first pairs, each with each lead."""
DISTANCE_PRICE_S = 0.005
"""Cost of one step of distance between the pairs of neighbouring speeds, in s of rise time. A small distance keeps the pairs
close to each other, because a pair interpolated between distant pairs behaves like neither."""
RISE_PRICE_S = 0.3
"""Rise time that costs as much as an excess of the size of a limit, in s; a good car needs no more at 80 to 120 km/h."""
TIERS = (1e6, 1e4, 1e2, 1.0)
"""Weights of the criteria, in order of priority, in the sum over the speeds."""
STEPS = ((0.015, 0.04), (0.0075, 0.02), (0.00375, 0.01))
"""Refinement in s, s: each speed's best pair is compared with its eight neighbours at these distances. Even speeds move first,
odd ones second, so that a drive half way between two speeds depends on only one that moves."""

STEPS_PER_LAG = 1.5
"""Plant steps in the shortest lag, where a step of the Runge-Kutta method is 0.1 % off. The committed build is tuned with steps
of 3.3 ms, with the same result as at 1 ms."""
STEPS_PER_SAMPLE_MIN = 3

FIGURES = ("overshoot", "settling", "overshoot at larger angles", "settling at larger angles", "rise")
"""Rows of figures, the largest over SHARES: overshoot in percent, the others in s."""

COLUMNS = ("yaw_rate_rad_s", "sideslip_rad", "slip_rear_rad")

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Response:
    """Chosen pair at one speed, and its results over the fractions of the front angle.

    Attributes:
        speed_km_h: speed of the schedule.
        lead_s, response_gain_s: the chosen pair.
        overshoot_percent, settling_s: the largest of the configured car there and half way to the neighbours; inf for a spin.
        rise_s: its largest at this speed.
        family_overshoot_percent: the largest of the mass and tyre deviations of both axles.
    """

    speed_km_h: float
    lead_s: float
    response_gain_s: float
    overshoot_percent: float
    settling_s: float
    rise_s: float
    family_overshoot_percent: float

    @property
    def excess(self) -> float:
        """Worst figure of the configured car, as a fraction of its limit."""
        slowness = self.rise_s / RISE_MAX_S if self.speed_km_h >= RISE_FROM_KM_H else 0.0
        return max(self.overshoot_percent / OVERSHOOT_MAX_PERCENT, self.settling_s / SETTLING_MAX_S, slowness)

    @property
    def is_on_target(self) -> bool:
        """Whether the configured car meets both targets."""
        return self.overshoot_percent <= OVERSHOOT_PERCENT and self.settling_s <= SETTLING_S

    @property
    def is_met(self) -> bool:
        """Whether the configured car keeps its limits."""
        return self.excess <= 1.0


def compile_controller(reference_map: ReferenceMap, config: Config) -> BatchSoftware:
    """Build the map's controller for many cars at once, driven in longer steps. Raises BuildError, MapError, ConfigError."""
    folder = build_code(reference_map, config, BuildOptions("tune"), BuildInputs("tune.npz", "0" * 64, "map"))
    # Not validated: a step of the bench must fit twice into every lag.
    return compile_batch(folder.files, folder.manifest, config.unchecked({"plant.sampling_time_s": _plant_step(config)}))


def _plant_step(config: Config) -> float:
    """Return the longest plant step in s with STEPS_PER_LAG in every lag of the family, a whole fraction of a sample.

    Sideslip and yaw rate of the car are lags too, which shrink with the speed: m v/(C_f + C_r) and I v/(C_f lf^2 + C_r lr^2).
    """
    car, tuning = SingleTrack.from_config(config), config.tuning
    slowest = float(breakpoints(config)[0][0])
    lighter = 1.0 + min(0.0, *tuning.mass_percent) / 100.0
    stiffer = 1.0 + max(0.0, *tuning.stiffness_percent) / 100.0
    yaw_stiffness = car.front_stiffness * car.front_arm**2 + car.rear_stiffness * car.rear_arm**2
    inertias = (car.mass / (car.front_stiffness + car.rear_stiffness), car.yaw_inertia / yaw_stiffness)
    lags = [config.steering.lag_s, config.rear_actuator.lag_s * min(LAG_FACTORS)]
    lags += [inertia * slowest * lighter / stiffer for inertia in inertias]
    plant = config.plant
    if plant.relaxation_length_m:
        lags.append(plant.relaxation_length_m * min(1.0, plant.rear_relaxation_factor) / (config.grid.last_speed_km_h * KM_H))
    if plant.actuator_motor_share:
        lags.append(plant.actuator_motor_share * config.rear_actuator.lag_s * min(LAG_FACTORS))
    if plant.backlash_deg:
        lags.append(STEPS_PER_LAG * PLAY_TIME_CONSTANT)  # one step is enough, and stable
    period = config.controller.sampling_time_s
    steps = max(STEPS_PER_SAMPLE_MIN, math.ceil(period * STEPS_PER_LAG / min(lags)))
    return max(period / steps, config.plant.sampling_time_s)


def tune_response(
    reference_map: ReferenceMap,
    config: Config,
    schedule: Schedule,
    software: BatchSoftware,
    progress: Progress | None = None,
) -> tuple[float, tuple[Response, ...]]:
    """Return the look-ahead in s on the model, and the pair for each speed of the schedule within the map.

    The same input gives the same numbers.

    Args:
        reference_map: solved for the car of the configuration.
        config: with the schedule as its own.
        software: `compile_controller` of both.
        progress: called with (done, in all), from the beginning for each look-ahead that is tried.
    """
    tried: list[tuple[float, tuple[Response, ...]]] = []
    for ahead in config.response_aheads_s:
        search = _Search.of(reference_map, config, schedule, software, ahead)
        tried.append((ahead, _pairs(search, progress)))
        if all(response.is_met for response in tried[-1][1]):
            break
    return min(tried, key=lambda found: sum(map(_price, found[1])))


def _price(response: Response) -> float:
    """Return the price of a pair at one speed where no look-ahead lets the car keep its limits everywhere.

    A long look-ahead reduces overshoot near the limit of grip, and makes the car slow at every angle."""
    return max(response.excess, 1.0) + response.rise_s / RISE_PRICE_S


def _pairs(search: _Search, progress: Progress | None) -> tuple[Response, ...]:
    """Return the pair for each speed, with one look-ahead."""
    around = [(i, j) for i in (0, -1, 1) for j in (0, -1, 1)]
    total = 2 * len(LEADS_S) * len(RESPONSE_GAINS_S) + 2 * len(around) * len(STEPS) + 1
    tell = _counted(progress, total)
    count = len(search.speeds)
    largest = np.array([_largest_response_gain(search.software, speed * KM_H, search.ahead) for speed in search.speeds])
    first: FloatArray = np.array([[(lead, gain)] * count for lead in LEADS_S for gain in RESPONSE_GAINS_S])
    pairs = np.minimum(first, np.stack([np.full(count, LEADS_S[-1]), largest], axis=-1))
    figures = search.drive_all(pairs, search.cells(cars=slice(1)), tell)
    # The other cars, with the pairs that the configured car can choose.
    others = search.cells(cars=slice(1, None)) & search.is_first_choice(figures)[:, np.newaxis]
    figures[:, :, 1:] = search.drive_all(pairs, others, tell)[:, :, 1:]
    best = pairs[search.smooth_best(first, figures), range(count)]
    for step in STEPS:
        for moved in (slice(0, None, 2), slice(1, None, 2)):
            pairs = np.repeat(best[np.newaxis], len(around), axis=0)
            pairs[:, moved] += (np.array(around) * step)[:, np.newaxis]
            pairs = np.clip(pairs, (LEADS_S[0], 0.0), np.stack([np.full(count, LEADS_S[-1]), largest], axis=-1))
            chosen = search.best(search.drive_all(pairs, search.cells(speeds=moved), tell))
            best[moved] = pairs[chosen, range(count)][moved]
    return search.responses(best, search.drive_all(best[np.newaxis], search.cells(), tell)[0])


def _counted(progress: Progress | None, total: int) -> Callable[[], None]:
    """Return a function that counts its calls and reports them."""
    done = 0

    def tell() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total)

    return tell


def with_response(config: Config, schedule: Schedule, ahead: float, found: Sequence[Response]) -> dict[str, Any]:
    """Return changes of [controller.tracking]: lead and response gain of the schedule, look ahead (s), bound of the lead.

    Breakpoints between the tuned speeds have interpolated values, those beyond them the value of the nearest tuned speed. The
    bound is the lead at the largest rate of the steering wheel.
    """
    at = [response.speed_km_h for response in found]
    values = {
        key: [round(float(np.interp(speed, at, [getattr(one, key) for one in found])), 4) for speed in schedule.speed_km_h]
        for key in ("lead_s", "response_gain_s")
    }
    rate = config.steering.wheel_rate_max_deg_s / config.steering.ratio
    largest = max(abs(lead) for lead in values["lead_s"])
    bound = min(max(math.ceil(10.0 * largest * rate) / 10.0, 0.1), 10.0)
    changed = {**schedule.model_dump(mode="json"), **values}
    return {"schedule": changed, "lead_max_deg": bound, "response_ahead_s": ahead}


@dataclass(frozen=True)
class _Search:
    """Cells of the drives, and the batch that drives and evaluates them.

    `ahead` is the look-ahead on the model's yaw rate in s, `limits` are the limits of overshoot in percent, (cars, speeds).
    Figures are (5, cars, speeds), rows as FIGURES. Those of the configured car, the first, include the speeds half way to the
    neighbours, except the rise time.
    """

    software: BatchSoftware
    schedule: Schedule
    ahead: float
    speeds: tuple[float, ...]
    limits: FloatArray
    profile: FloatArray
    lanes: Lanes

    @classmethod
    def of(
        cls, reference_map: ReferenceMap, config: Config, schedule: Schedule, software: BatchSoftware, ahead: float
    ) -> _Search:
        """Return the cells of a car on its map."""
        axis, angles = breakpoints(config)
        reached = [speed for speed in schedule.speed_km_h if axis[0] <= speed * KM_H <= axis[-1] * (1.0 + 1e-9)]
        speeds = tuple([speed for speed in reached if speed >= SPEED_MIN_KM_H] or reached or schedule.speed_km_h[-1:])
        assert reference_map.case is not None  # a solved map has one
        # Every car at the speeds, and the configured one, the first, half way between them too.
        between = 0.5 * (np.array(speeds[1:]) + np.array(speeds[:-1]))
        driven = np.array([*speeds, *between]) * KM_H
        edge = turns_of(config, config.case(reference_map.case)).edge(driven, float(angles[-1])).front_angle
        angle = np.outer(np.minimum(edge, angles[-1]), LEAD_ANGLE_SHARES)
        family, limits = family_of(config)
        lags = family[:, PLANT_PARAMETERS.index("rear_lag")]
        other_lag = lags != lags[0]
        count = len(speeds)
        speed = [*np.tile(driven[:count], len(family)), *driven[count:]]
        lanes = Lanes(
            np.concatenate([np.repeat(family, angle[:count].size, axis=0), np.repeat(family[:1], angle[count:].size, axis=0)]),
            speed_factor=np.repeat(speed, len(LEAD_ANGLE_SHARES)),
            wheel_factor=np.array([*np.tile(angle[:count].ravel(), len(family)), *angle[count:].ravel()])
            * config.steering.ratio,
            delay_samples=config.designed_delay_samples,
        )
        over_speed = np.repeat(limits[:, np.newaxis], count, axis=1)
        search = cls(software, schedule, ahead, speeds, over_speed, unit_step(software.config, STEER_TIME, DURATION), lanes)
        static = search.drive(np.zeros((count, 2)), search.cells())[FIGURES.index("overshoot")]
        least = STATIC_OVERSHOOT_FACTOR * np.where(np.isfinite(static), static, 0.0)  # a car that spins raises no limit
        return replace(search, limits=np.where(other_lag[:, np.newaxis], np.maximum(over_speed, least), over_speed))

    def cells(self, cars: slice = slice(None), speeds: slice = slice(None)) -> BoolArray:
        """Return the cells (cars, speeds) that belong to some cars and speeds."""
        chosen = np.zeros(self.limits.shape, dtype=np.bool_)
        chosen[cars, speeds] = True
        return chosen

    def drive_all(self, pairs: FloatArray, cells: BoolArray, tell: Callable[[], None]) -> FloatArray:
        """Return figures (n, 5, cars, speeds) of pairs (n, speeds, 2) of lead and response gain, in cells as for `drive`, the
        same for all pairs or (n, cars, speeds)."""
        rows = []
        with ThreadPoolExecutor(os.cpu_count()) as pool:  # the C runs without the interpreter's lock
            for figures in pool.map(self.drive, pairs, np.broadcast_to(cells, (len(pairs), *self.limits.shape))):
                rows.append(figures)
                tell()
        return np.array(rows)

    def drive(self, pairs: FloatArray, cells: BoolArray) -> FloatArray:
        """Return figures with a pair (speeds, 2) at each speed, infinite except in the cells (cars, speeds) that are true."""
        count, cars = len(self.speeds), len(self.limits)
        driven = np.full(
            (len(self.lanes.cars) // len(LEAD_ANGLE_SHARES), len(LEAD_ANGLE_SHARES)), cells[0].any()
        )  # with those half way, behind
        driven[: cells.size] = cells.reshape(-1, 1)
        if not driven.any():
            return np.full((len(FIGURES), cars, count), np.inf)
        over = [np.interp(self.schedule.speed_km_h, self.speeds, values).tolist() for values in pairs.T]
        parameters = self.software.parameters()
        parameters.lead_time, parameters.response_gain = over
        parameters.lead_angle_max = 0.5
        parameters.response_samples = self.ahead / self.software.config.controller.sampling_time_s
        yaw_rate, sideslip, slip = self.software.run(self.profile, self.lanes.pick(driven.ravel()), parameters, COLUMNS)
        time = np.arange(len(yaw_rate), dtype=np.float64) * self.software.config.controller.sampling_time_s
        step = StepResponse(Runs(time, {"yaw_rate_rad_s": yaw_rate}, STEER_TIME), STEADY_WINDOW)
        spins = is_spinning(sideslip, slip).any(axis=0) | ~(step.yaw_rate > 0.0)
        each = np.full((3, *driven.shape), np.inf)
        found = np.stack([step.overshoot_percent, step.time_outside_band_s, step.rise_time_interpolated_s])
        each[:, driven] = np.where(spins, np.inf, found)
        largest, larger = each.max(axis=-1), each[:2, :, LARGER_FROM:].max(axis=-1)
        figures = np.concatenate([largest[:2], larger, largest[2:]])
        result: FloatArray = figures[:, : cars * count].reshape(len(FIGURES), cars, count)
        between = figures[:4, cars * count :]
        own = result[:4, 0]
        own[:, 1:], own[:, :-1] = np.maximum(own[:, 1:], between), np.maximum(own[:, :-1], between)
        return result

    def best(self, figures: FloatArray) -> list[int]:
        """Return the index of the best of figures (n, 5, cars, speeds) at each speed."""
        keys = self._keys(figures)
        return [int(np.lexsort(keys[::-1, :, k])[0]) for k in range(len(self.speeds))]

    def is_first_choice(self, figures: FloatArray) -> BoolArray:
        """Return where (n, speeds) no other pair is better for the configured car by the criteria that come first."""
        first = np.tensordot(TIERS[:2], np.minimum(self._keys(figures)[:2], 1e3), axes=1)
        return np.asarray(first <= first.min(axis=0))

    def smooth_best(self, pairs: FloatArray, figures: FloatArray) -> list[int]:
        """Return the best pair of each speed, as places in `pairs` (n, speeds, 2), with a price on the distance from speed to
        speed."""
        axes = zip((LEADS_S, RESPONSE_GAINS_S), pairs[:, 0].T, strict=True)
        places = np.stack([np.interp(values, first, range(len(first))) for first, values in axes], axis=-1)
        apart = DISTANCE_PRICE_S * np.abs(places[:, np.newaxis] - places).sum(axis=-1)
        cost = np.tensordot(TIERS, np.minimum(self._keys(figures), 1e3), axes=1)  # (n, speeds); a spin is infinite
        total, before = cost[:, 0], []
        for column in cost.T[1:]:
            way = apart + total  # (to, from)
            before.append(way.argmin(axis=1))
            total = column + way.min(axis=1)
        chosen = [int(total.argmin())]
        for choice in reversed(before):
            chosen.append(int(choice[chosen[-1]]))
        return chosen[::-1]

    def _keys(self, figures: FloatArray) -> FloatArray:
        """Return sort keys (4, n, speeds) of figures (n, 5, cars, speeds), the most significant first; smaller is better."""
        overshoot, settling, overshoot_larger, settling_larger, rise = (figures[:, k] for k in range(len(FIGURES)))
        slowness = np.where(np.array(self.speeds) >= RISE_FROM_KM_H, rise[:, 0] / RISE_MAX_S, 0.0)
        at_aim = (overshoot[:, 0] <= OVERSHOOT_PERCENT) & (settling[:, 0] <= SETTLING_S) & (slowness <= 1.0)
        excess = np.maximum(np.maximum(overshoot[:, 0] / OVERSHOOT_MAX_PERCENT, settling[:, 0] / SETTLING_MAX_S), slowness)
        larger = np.maximum(overshoot_larger[:, 0] / OVERSHOOT_MAX_PERCENT, settling_larger[:, 0] / SETTLING_MAX_S)
        others = (overshoot[:, 1:] / self.limits[1:]).max(axis=1)
        # In steps of a hundredth: a smaller excess does not justify a slower response.
        larger, own, others = (np.round(np.maximum(values, 1.0), 2) for values in (larger, excess, others))
        own[at_aim] = 0.0
        cost = rise[:, 0] + OVERSHOOT_PRICE_S * overshoot[:, 1:].max(axis=1)
        return np.array([larger, own, others, cost])

    def responses(self, pairs: FloatArray, figures: FloatArray) -> tuple[Response, ...]:
        """Return the responses with a pair (speeds, 2) at each speed."""
        both = self.limits[:, 0] == DEVIATION_OVERSHOOT_PERCENT
        rows = np.concatenate([pairs.T, figures[[0, 1, 4], 0], figures[:1, both].max(axis=1, initial=0.0)])
        return tuple(Response(speed, *(round(float(value), 4) for value in rows[:, k])) for k, speed in enumerate(self.speeds))


def family_of(config: Config) -> tuple[FloatArray, FloatArray]:
    """Return cars (n, k) and their limits of overshoot (n,) in percent: the configured one, then one deviation each.

    Measured deviations replace those of `config.tuning` and LAG_FACTORS, as in `design.family`: of the lag, and of tyres and
    yaw inertia together where a stiffness was measured. They are both ends of each principal axis.
    """
    tuning, measured = config.tuning, set(measured_keys(config))
    masses = sorted({min(tuning.mass_percent), max(tuning.mass_percent)} - {0.0})
    slopes = sorted({min(tuning.stiffness_percent), max(tuning.stiffness_percent)} - {0.0})
    rows, limits = [varied_cars(config)[0]], [OVERSHOOT_PERCENT]

    def add(row: FloatArray, limit: float) -> None:
        rows.append(row)
        limits.append(limit)

    def add_measured(keys: set[str], limit: float) -> None:
        ordered = [key for key in config.identified.keys if key in keys]
        for car in Population.of(config, ordered).axes(ELLIPSOID_SHARE):
            add(plant_parameters(car), limit)

    def add_scaled(parameters: Sequence[str], factor: float, limit: float) -> None:
        add(varied_cars(config)[0], limit)
        rows[-1][[PLANT_PARAMETERS.index(parameter) for parameter in parameters]] *= factor

    for mass in masses:
        add(varied_cars(config, mass=1.0 + mass / 100.0)[0], DEVIATION_OVERSHOOT_PERCENT)
    if measured & STIFFNESS_KEYS:
        add_measured(measured - {LAG_KEY}, DEVIATION_OVERSHOOT_PERCENT)
    else:
        for slope in slopes:
            factor = 1.0 + slope / 100.0
            add(varied_cars(config, front_stiffness=factor, rear_stiffness=factor)[0], DEVIATION_OVERSHOOT_PERCENT)
        if slopes and slopes[0] < 0.0:
            add(varied_cars(config, rear_stiffness=1.0 + slopes[0] / 100.0)[0], REAR_AXLE_OVERSHOOT_PERCENT)
    add_scaled(("front_stiffness_factor", "front_peak_factor"), FRONT_GRIP_FACTOR, FRONT_GRIP_OVERSHOOT_PERCENT)
    if config.plant.relaxation_length_m and RELAXATION_KEY not in measured:
        add_scaled(("relaxation_length",), RELAXATION_FACTOR, RELAXATION_OVERSHOOT_PERCENT)
    if LAG_KEY in measured:
        add_measured({LAG_KEY}, LAG_OVERSHOOT_PERCENT[0])
    else:
        for factor, limit in zip(LAG_FACTORS, LAG_OVERSHOOT_PERCENT, strict=True):
            add_scaled(("rear_lag",), factor, limit)
    return np.array(rows), np.array(limits)


def unit_step(config: Config, begin: float, duration: float) -> FloatArray:
    """Return the inputs (steps, 7), INPUT_COLUMNS, of a step of the steering wheel of 1 rad at 1 m/s; times in s.

    Each run of a batch multiplies it by its own angle and speed.
    """
    step = config.plant.sampling_time_s
    profile = np.zeros((round(duration / step), len(INPUT_COLUMNS)))
    at = {name: profile[:, k] for k, name in enumerate(INPUT_COLUMNS)}
    at["speed"][:], at["friction"][:], at["friction_estimate"][:] = 1.0, config.road.friction, math.nan
    at["steering_wheel_command"][round(begin / step) :] = 1.0
    return profile


def _largest_response_gain(software: BatchSoftware, speed: float, ahead: float) -> float:
    """Return the largest response gain in s with _LOOP_GAIN_SHARE, at a speed in m/s and with a look-ahead in s."""
    low, high = 0.0, RESPONSE_GAIN_MAX_S / _LOOP_GAIN_SHARE
    if _decays(software, speed, ahead, high):
        return RESPONSE_GAIN_MAX_S
    for _ in range(_LOOP_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _decays(software, speed, ahead, middle) else (low, middle)
    return _LOOP_GAIN_SHARE * low


def _decays(software: BatchSoftware, speed: float, ahead: float, gain: float) -> bool:
    """Return whether the yaw rate of the model decays from a small first value, with the front wheels straight."""
    unit, config = software.software, software.config
    model, given = unit.new("reference_model"), unit.new("reference_model_input")
    given.speed, given.front_angle = speed, 0.0
    for name in ("friction", "front_friction", "rear_friction"):
        if hasattr(given, name):
            setattr(given, name, config.road.friction)
    period, step = config.controller.sampling_time_s, unit.function("reference_model_step")
    unit.function("reference_model_start")(model, speed, _LOOP_YAW_RATE, 0.0)
    samples, before = round(_LOOP_DURATION_S / period), model.yaw_rate
    yaw_rates: list[float] = []
    for _ in range(samples):
        expected = model.yaw_rate + ahead / period * (model.yaw_rate - before)
        before, given.rear_angle = model.yaw_rate, gain * expected
        step(model, given)
        yaw_rates.append(abs(model.yaw_rate))
    return max(yaw_rates[-samples // 4 :]) < _LOOP_DECAY * _LOOP_YAW_RATE

"""Rows of the benchmark `law` at the limits of grip: healthy sensors, other tyres and slippery roads."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.law_car import (
    BANK_RISE_TIME,
    BANK_TIME,
    DWELLS,
    FLICKS,
    PLANTS,
    Drives,
    LawCar,
    Setting,
    per_setting,
    road,
    spun,
)
from benchmarks.law_figures import Figure
from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.configuration.signals import Status
from codegen.judgement.passive import usable_slip
from codegen.metrics import StepResponse
from codegen.metrics.runs import Extremes
from codegen.optimum.nonlinear_car import SteadyCar
from codegen.vehicle.tyre import AxleTyres
from hil_sim.suite.cells import Change, Condition, peak, stiffness, together

KINDS = (False, True)
"""Whether a slippery road keeps the stiffness of the tyres."""
FRICTIONS = (0.6, 0.4)
SIDESLIP_MAX_DEG = {0.6: 4.0, 0.4: 5.0}
"""Largest sideslip angle of the runs by friction."""
ESTIMATE_ERROR = 0.2
BIASES_M_S2 = (0.0, 0.3, -0.3)
ICE, ICE_SPINS_MAX = 0.25, 10
HALF = 0.5
DRY_CHANGE_PERCENT = 1.0
"""Largest change of the dry car's yaw rate by a bias, of the map's, that counts as none."""

BANKS_M_S2, BANK_CHANGE_PERCENT = (0.25, 0.59), 5.0
"""Gravity into the turn on roads that bank by 2.5 and 6 %, and by how much that may change the yaw rate."""

NEAR_SHARE = 0.75
BELOW_NEAR_PERCENT, BELOW_FAR_PERCENT = 5.0, 15.0
"""Largest error below the map with other tyres, up to NEAR_SHARE of the edge, and beyond."""
POSSIBLE_SHARE = 0.99
"""Share of what the car can do that counts as all of it."""
GRID = tuple(np.linspace(0.5, 1.0, 101).tolist())
"""Yaw rates of the search for what the car can do, of the map's."""
ANGLE_PARTS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Parts of the front angle in this search."""
ROUNDING = 1e-3
"""Tolerance for the rear angle: the map itself uses all of it."""

TYRES: dict[str, tuple[str, float, bool]] = {
    "front tyres -25 %, stiffness": ("front", -25.0, False),
    "front tyres -25 %, stiffness and peak": ("front", -25.0, True),
    "rear tyres +25 %, stiffness": ("rear", 25.0, False),
    "rear tyres +25 %, stiffness and peak": ("rear", 25.0, True),
}
"""Title -> axle, change in percent, whether the peak changes as well."""


def rejected(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 5: cells in which a healthy sensor is rejected."""
    roads = [Setting(), *(Setting(road(*each)) for each in itertools.product(FRICTIONS, KINDS))]
    for is_noisy, sensors in ((False, "ideal sensors"), (True, "noisy sensors")):
        runs = car.drive(car.steps, plant, [replace(each, is_noisy=is_noisy) for each in roads])
        status = runs.signals["status"][runs.after]
        is_rejected = np.isin(status, (Status.DEGRADED, Status.FAIL_SAFE)).any(axis=0).reshape(len(roads), -1)
        for each, cells in zip(roads, is_rejected, strict=True):
            count = int(cells.sum())
            title = f"{sensors}, {each.condition.title}: cells with a rejected sample"
            yield Figure(5, title, plant, "0", car.letter, f"{count}", count == 0)


def other_tyres(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 6: steady yaw rate below the map with other tyres."""
    settings = [Setting(Condition("tyres", title, "tyre", plant=_tyres(*key))) for title, key in TYRES.items()]
    runs = car.drive(car.steps, plant, settings)
    # A car that spins does not follow the map at all.
    error = np.where(spun(runs, settings), -np.inf, per_setting(StepResponse(runs).map_error_percent, settings))
    is_near = car.shares <= NEAR_SHARE
    for setting, found in zip(settings, error, strict=True):
        best = 100.0 * possible(car, together(PLANTS[plant], setting.condition.plant)(car.config)) - 100.0
        for title, cells, most in (
            (f"up to {100.0 * NEAR_SHARE:g} %", is_near, BELOW_NEAR_PERCENT),
            ("beyond", ~is_near, BELOW_FAR_PERCENT),
        ):
            limit = np.minimum(-most, 100.0 * POSSIBLE_SHARE * (1.0 + best / 100.0) - 100.0)
            worst = int(np.argmin(np.where(cells, found - limit, np.inf)))
            text = "spins" if np.isinf(found[worst]) else f"{found[worst]:.1f} ({best[worst]:.1f})"
            name = f"{setting.condition.title}, {title}: error to the map (possible) in %, worst cell"
            yield Figure(6, name, plant, f"-{most:g}, or possible", car.letter, text, bool(found[worst] >= limit[worst]))


def banked(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 14: change of the yaw rate by a road that banks into the turn."""
    conditions = (
        Condition("dry", "configured tyres", "nominal"),
        *(Condition("tyres", title, "tyre", plant=_tyres(*key)) for title, key in TYRES.items()),
    )
    for condition in conditions:
        settings = [Setting(condition, bank=bank) for bank in (0.0, *BANKS_M_S2)]
        runs = car.drive(car.steps, plant, settings)
        rate = runs.signals["yaw_rate_rad_s"][runs.time >= BANK_TIME + BANK_RISE_TIME].reshape(
            -1, len(settings), car.steps.speed.size
        )
        level_spun, *banked_spun = spun(runs, settings)
        for place, (bank, is_spun) in enumerate(zip(BANKS_M_S2, banked_spun, strict=True), 1):
            spins = int((is_spun & ~level_spun).sum())
            change = float(100.0 * np.abs(rate[:, place] / rate[:, 0] - 1.0)[:, ~(level_spun | is_spun)].max())
            text = f"{spins} spins, {change:.1f} %" if spins else f"{change:.1f} %"
            title, goal = f"{condition.title}, bank of {bank:g} m/s^2: change of the yaw rate", f"{BANK_CHANGE_PERCENT:g} %"
            yield Figure(14, title, plant, goal, car.letter, text, not spins and change <= BANK_CHANGE_PERCENT)


def _tyres(axle: str, percent: float, with_peak: bool) -> Change:
    changed = stiffness(percent, 0.0) if axle == "front" else stiffness(0.0, percent)

    def with_peaks(config: Config) -> Config:
        peak = (1.0 + percent / 100.0) * getattr(config.tyre, axle).peak_factor_p1
        return config.replace({f"tyre.{axle}.peak_factor_p1": peak}, "varied plant")

    return together(changed, with_peaks) if with_peak else changed


def possible(car: LawCar, changed: Config) -> FloatArray:
    """Return the largest steady yaw rates (cells,) of a changed car over those of the map, at most one.

    The rear wheels take any angle of the actuator; each axle may use up to 90 % of the slip of its peak force. A front angle
    beyond that slip loses little, so that smaller front angles count, too.
    """
    tyres = AxleTyres.from_config(changed)
    steady = SteadyCar.from_config(changed, (usable_slip(tyres.front), usable_slip(tyres.rear)))
    speed, angle = car.steps.speed, car.steps.front_angle
    yaw_rate, part, share = car.map_yaw_rate(speed, angle), np.array(ANGLE_PARTS), np.array(GRID)
    places = np.broadcast_arrays(
        speed[:, None, None], angle[:, None, None] * part[:, None], yaw_rate[:, None, None] * share, share
    )
    speeds, angles, rates, shares = (values.ravel() for values in places)
    with np.errstate(all="ignore"):  # turns beyond the grip
        turns = steady.turns(speeds, angles, rates)
    is_there = turns.converged & (np.abs(turns.rear_angle) <= (1.0 + ROUNDING) * changed.rear_actuator.angle_max)
    is_there &= (np.abs(turns.slip_front) <= steady.front.slip_max) & (np.abs(turns.slip_rear) <= steady.rear.slip_max)
    result: FloatArray = np.where(is_there, shares, 0.0).reshape(speed.size, -1).max(axis=1)
    return result


def slippery(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 7: spins and sideslip at the limit on slippery roads, and what the bias does on the dry road."""
    for friction, keeps in itertools.product(FRICTIONS, KINDS):
        surface, most = road(friction, keeps), SIDESLIP_MAX_DEG[friction]
        for estimate in (None, round(friction + ESTIMATE_ERROR, 9)):
            known = "no estimate" if estimate is None else f"estimate {estimate:g}"
            settings = [Setting(replace(surface, estimate=estimate), bias) for bias in BIASES_M_S2]
            spins, largest, title = 0, 0.0, f"{surface.title}, {known}"
            for drives in _manoeuvres(car):
                is_spun, sideslip, text = _limits(car, drives, plant, settings)
                yield Figure(7, f"{title}, {drives.title}", plant, "", car.letter, text)
                spins += int(is_spun.sum())
                largest = max(largest, float(np.where(is_spun, 0.0, sideslip).max()))
            is_met = not spins and largest <= most
            goal = f"0 spins, {most:g} deg"
            yield Figure(7, f"{title}: spins, largest sideslip", plant, goal, car.letter, f"{spins}, {largest:.1f}", is_met)
        for drives in _manoeuvres(car):
            *_, text = _limits(car, drives, plant, [Setting(surface, controlled=False)])
            yield Figure(7, f"{surface.title}, passive, {drives.title}", plant, "", car.letter, text)
    changed = _dry_change(car, plant)
    title = f"dry, bias of the acceleration {BIASES_M_S2[1]:+g} and {BIASES_M_S2[2]:+g} m/s^2: change of the yaw rate"
    goal, is_met = f"{DRY_CHANGE_PERCENT:g} % of the map", changed <= DRY_CHANGE_PERCENT
    yield Figure(7, title, plant, goal, car.letter, f"{changed:.1f} %", is_met)


def _manoeuvres(car: LawCar) -> tuple[Drives, ...]:
    return tuple(each.after(car.straight_s) for each in (car.steps, FLICKS, DWELLS))


def _limits(car: LawCar, drives: Drives, plant: str, settings: Sequence[Setting]) -> tuple[BoolArray, FloatArray, str]:
    """Return whether each run spins and its largest sideslip angle in deg, (settings, drives), and both as text by setting."""
    runs = car.drive(drives, plant, settings)
    is_spun, sideslip = spun(runs, settings), per_setting(Extremes(runs).sideslip_abs_max_deg, settings)
    angles = ("-" if lost.all() else f"{each[~lost].max():.1f}" for lost, each in zip(is_spun, sideslip, strict=True))
    return is_spun, sideslip, f"{'+'.join(str(each.sum()) for each in is_spun)}; {'/'.join(angles)}"


def _dry_change(car: LawCar, plant: str) -> float:
    """Return the largest change of the yaw rate at any time by a bias on the dry road, in percent of the map's."""
    settings = [Setting(acceleration_bias=bias) for bias in BIASES_M_S2]
    runs = car.drive(car.steps.after(car.straight_s), plant, settings)
    rate = runs.signals["yaw_rate_rad_s"].reshape(runs.time.size, len(settings), -1)
    known = np.asarray(runs.map_yaw_rate).reshape(len(settings), -1)[0]
    return float(100.0 * (np.abs(rate[:, 1:] - rate[:, :1]).max(axis=(0, 1)) / known).max())


def ice(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 8: spins at friction 0.25."""
    settings = [Setting(replace(road(ICE, keeps), estimate=estimate)) for estimate in (ICE, None) for keeps in KINDS]
    is_spun = spun(car.drive(car.steps, plant, settings), settings).reshape(2, -1)
    for known, lost, most in zip(("exact estimate", "no estimate"), is_spun, (0, ICE_SPINS_MAX), strict=True):
        count = int(lost.sum())
        title, goal = f"friction {ICE:g}, both roads, {known}: spins in {lost.size} cells a car", f"{most} of all cars"
        yield Figure(8, title, plant, goal, car.letter, f"{count}", value=count, sum_max=most)


def half_grip(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 9: yaw rate at friction 0.5 against the map of the dry road, with an exact estimate and without."""
    for keeps in KINDS:
        surface = road(HALF, keeps)
        settings = [Setting(replace(surface, estimate=estimate)) for estimate in (HALF, None)]
        runs = car.drive(car.steps, plant, settings)
        error, is_spun = per_setting(StepResponse(runs).map_error_percent, settings), spun(runs, settings)
        best = possible(car, _on_road(PLANTS[plant](car.config), keeps))
        is_carried: BoolArray = best > POSSIBLE_SHARE
        parts = []
        for title, cells in (("all cells", np.full(is_carried.shape, True)), ("cells that the road carries", is_carried)):
            with_estimate, without = (
                math.nan if not (cells & ~lost).any() else float(values[cells & ~lost].mean())
                for values, lost in zip(error, is_spun, strict=True)
            )
            parts.append((title, with_estimate, without))
        for title, with_estimate, without in parts:
            text = f"{with_estimate:.1f} against {without:.1f} %"
            is_met = with_estimate >= without - 0.5
            title = f"{surface.title}, {title}: mean error to the dry map, exact estimate against none"
            yield Figure(9, title, plant, "estimate no worse", car.letter, text, is_met)


def _on_road(config: Config, keeps_stiffness: bool) -> Config:
    """Return a car as it is configured for a road of half the grip, for its steady turns."""
    if keeps_stiffness:
        return peak(100.0 * (HALF / config.road.friction - 1.0))(config)
    tyres = AxleTyres.from_config(config)
    kept = {f"tyre.{axle}.stiffness_factor_b_per_rad": getattr(tyres, axle).stiffness_factor for axle in ("front", "rear")}
    none = {f"tyre.{axle}.cornering_stiffness_n_per_rad": None for axle in ("front", "rear")}
    return config.unchecked({**kept, **none, "road.friction": HALF})


ROWS = {5: rejected, 6: other_tyres, 7: slippery, 8: ice, 9: half_grip, 14: banked}
"""Number of a row -> its figures of a car on a plant."""

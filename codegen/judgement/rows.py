"""The criteria of the judgement: each makes rows of the figures.

"Worse" is judged against the same car with straight rear wheels, with the tolerances below.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.judgement.drives import (
    DWELL_AMPLITUDES,
    DWELL_KM_H,
    SINE_HZ,
    DwellFigures,
    SineFigures,
    StepFigures,
    SweepFigures,
)
from codegen.judgement.lane_change import LaneChangeFigures
from codegen.judgement.model import DIGITS, Row, Verdict
from codegen.judgement.steady import (
    CHARACTERISTIC_SPEED,
    HIGH_KM_H,
    HIGH_LATERAL_ACCELERATION_G,
    LOW_KM_H,
    LOW_UP_TO,
    Least,
    SteadyFigures,
)
from codegen.metrics.runs import SPIN_SIDESLIP
from codegen.metrics.sine import RATIOS
from codegen.units import KM_H
from codegen.vehicle.tyre import MagicFormulaTyre, slip_bounds, static_wheel_loads

GRIP_MIN, LOW_MIN, HIGH_MIN = 0.92, 0.98, 0.9
"""Smallest largest lateral acceleration over the usable one, and smallest yaw rate over its measure."""
FLAT_MAX_PERCENT = 1.0
"""Largest share of steps with flat steering; none may fall."""
BETTER_FRACTION = 0.05
"""Smallest gain, as a fraction of the passive car's figure, that counts as better; it must exceed the tolerance too."""
STEP_SIDESLIP_TOLERANCE_DEG = 0.05
OVERSHOOT_TOLERANCE_PERCENT, RISE_TOLERANCE_S, DELAY_TOLERANCE_S = 5.0, 0.1, 0.05
"""How much more overshoot (points), rise time and delay than the passive car's is as good. A driver adapts to a delay that is
0.05 s longer; 5 % of overshoot is the limit of the suites."""
DISPLACEMENT_ENOUGH_M, DISPLACEMENT_SHARE_MIN = 2.1, 0.95
"""A displacement of the sine with dwell that is enough for every car, and the smallest share of the passive car's."""
ENTRY_TOLERANCE_KM_H = 0.0
SIDESLIP_SHARE_MAX = 0.5
"""Largest peak sideslip in the lane change over the passive car's."""
PEAK_SIDESLIP_TOLERANCE_DEG = 0.5
SLIP_MAX_PERCENT = 100.0
"""Largest slip of an axle over that of its peak force: beyond, more slip gives less force."""


ROUNDING = 1e-9
"""Difference to a limit that counts as rounding."""


def _rounded(value: float) -> float | None:
    """Return a value with DIGITS significant digits; None where there is none."""
    return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None


def _row(
    key: str,
    title: str,
    values: tuple[float, float],
    unit: str,
    digits: int,
    limit: float,
    required: str,
    *,
    high: bool = False,
    criterion: float | None = None,
    **more: str,
) -> Row:
    """Return a row of values with and without the controller.

    Args:
        limit: beyond it the car is worse than passive.
        high: whether more is better.
        criterion: beyond it the figure is a miss even where it is not worse than passive.
    """
    sign = 1.0 if high else -1.0
    own, passive = values

    def is_beyond(bound: float | None) -> bool:
        return bound is not None and not (sign * own >= sign * bound - ROUNDING or own == bound)

    verdict: Verdict = "equal"
    if is_beyond(limit):
        verdict = "worse"
    elif is_beyond(criterion):
        verdict = "missed"
    elif _is_better(sign * (own - passive), passive, limit):
        verdict = "better"
    return Row(
        key=key,
        title=title,
        value=_rounded(own),
        passive=_rounded(passive),
        unit=unit,
        digits=digits,
        required=required,
        verdict=verdict,
        **more,
    )


def _is_better(gain: float, passive: float, limit: float) -> bool:
    """Return whether a gain over the passive car's figure exceeds what counts as equal."""
    if math.isinf(passive):
        return math.isinf(gain) and gain > 0.0
    return gain > max(BETTER_FRACTION * abs(passive), abs(limit - passive))


def _place(least: Least) -> str:
    return f"{least.speed_km_h:.0f} km/h, {least.front_angle_deg:.1f} deg"


def steady_rows(figures: SteadyFigures) -> Iterator[Row]:
    """Yield the rows of a map."""
    binds = next((name for name in figures.binding_percent if name != "none"), "")
    remedy = f"what binds in most cells: {binds}" if binds else ""
    usable = figures.available_g
    yield _row(
        "lateral_acceleration",
        "largest lateral acceleration",
        (figures.largest_g, figures.passive_g),
        "g",
        3,
        GRIP_MIN * usable,
        f"at least {100.0 * GRIP_MIN:g} % of the usable {usable:.2f} g",
        high=True,
        at=f"{100.0 * figures.grip:.0f} % of what the car can use",
        remedy=remedy,
    )
    for key, title, dead in (
        ("dead_steering_map", "dead steering in the map", figures.dead),
        ("dead_steering_ecu", "dead steering in the table of the ECU", figures.dead_on_ecu),
    ):
        is_dead = dead.falling_percent > 0.0 or dead.flat_percent > FLAT_MAX_PERCENT
        yield Row(
            key=key,
            title=title,
            value=_rounded(dead.percent),
            unit="% of the steps",
            digits=1,
            at=f"falling {dead.falling_percent:.1f} %, flat below the cap {dead.flat_percent:.1f} %",
            required=f"none that falls, at most {FLAT_MAX_PERCENT:g} % flat",
            verdict="worse" if is_dead else "equal",
            remedy=remedy,
        )
    measures = (
        (
            "yaw_rate_low",
            LOW_KM_H,
            figures.low,
            LOW_MIN,
            "passive",
            f"passive up to {100.0 * LOW_UP_TO:g} % of what the car can use",
        ),
        (
            "yaw_rate_high",
            HIGH_KM_H,
            figures.high,
            HIGH_MIN,
            "measure",
            f"the smaller of passive and a car of {CHARACTERISTIC_SPEED / KM_H:.0f} km/h characteristic speed up to "
            f"{HIGH_LATERAL_ACCELERATION_G:g} g",
        ),
    )
    for key, (first, last), least, smallest, measure, of in measures:
        if math.isnan(least.ratio):
            continue
        yield _row(
            key,
            f"yaw rate at {first:g} to {last:g} km/h",
            (100.0 * least.ratio, 100.0),
            "% of passive" if measure == "passive" else "% of measure",
            1,
            100.0 * smallest,
            f"at least {100.0 * smallest:g} % of {of}",
            high=True,
            at=_place(least),
            remedy=remedy,
        )
    for kmh, least in figures.gains.items():
        if not math.isnan(least.ratio):
            yield Row(
                key=f"yaw_gain_{kmh:.0f}",
                title=f"yaw gain at {kmh:.0f} km/h, smallest up to {HIGH_LATERAL_ACCELERATION_G:g} g",
                value=_rounded(100.0 * least.ratio),
                unit="% of passive",
                digits=1,
                at=f"{least.front_angle_deg:.1f} deg",
            )


def step_rows(figures: StepFigures, base_km_h: float) -> Iterator[Row]:
    """Yield the steady figures of the default step, and the worst value of each transient figure over all steps."""
    if math.isclose(figures.speed_km_h[0], base_km_h):
        at = f"step steer, {figures.speed_km_h[0]:g} km/h, {figures.front_angle_deg[0]:.1f} deg"
        own, passive = map(float, figures.yaw_rate_deg_s[:, 0])
        required = f"at least {100.0 * LOW_MIN:g} % of passive"
        yield _row(
            "step_yaw_rate",
            "steady yaw rate after a step",
            (own, passive),
            "deg/s",
            1,
            LOW_MIN * passive,
            required,
            high=True,
            at=at,
        )
        own, passive = map(float, figures.sideslip_deg[:, 0])
        limit = passive + STEP_SIDESLIP_TOLERANCE_DEG
        required = f"at most {STEP_SIDESLIP_TOLERANCE_DEG:g} deg more than passive"
        yield _row("step_sideslip", "steady sideslip after a step", (own, passive), "deg", 2, limit, required, at=at)
    at_steps = [_step(figures, k) for k in range(figures.speed_km_h.size)]
    for quantity, both in figures.overshoot_percent.items():
        key, title = f"overshoot_{_key(quantity)}", f"overshoot of the {quantity}"
        yield _worst_row(key, title, both, "%", 1, OVERSHOOT_TOLERANCE_PERCENT, at_steps, of_tolerance="points")
    for quantity, both in figures.rise_s.items():
        yield _worst_row(f"rise_{_key(quantity)}", f"rise to 90 % of the {quantity}", both, "s", 2, RISE_TOLERANCE_S, at_steps)


def _worst_row(
    key: str,
    title: str,
    both: FloatArray,
    unit: str,
    digits: int,
    tolerance: float,
    places: Sequence[str],
    of_tolerance: str = "",
) -> Row:
    """Return the row of the worst of k drives, figures (2, k), which may exceed the passive car's by a tolerance."""
    k = _worst(both, tolerance)
    own, passive = map(float, both[:, k])
    required = f"at most {tolerance:g} {of_tolerance or unit} more than passive"
    return _row(key, title, (own, passive), unit, digits, passive + tolerance, required, at=places[k])


def _worst(both: FloatArray, tolerance: float) -> int:
    """Return the index of the run whose figure (2, k) exceeds the passive car's by most; without an excess, the largest."""
    own, passive = np.where(np.isinf(both), 1e9, both)
    excess = own - passive - tolerance
    return int(np.lexsort((own, np.maximum(excess, 0.0)))[-1])


def _key(quantity: str) -> str:
    return quantity.replace(" ", "_")


def _step(figures: StepFigures, k: int) -> str:
    return f"{figures.speed_km_h[k]:.4g} km/h, step of {figures.front_angle_deg[k]:.1f} deg"


def sine_rows(figures: SineFigures) -> Iterator[Row]:
    """Yield the rows of the delays, each at its worst speed."""
    places = [f"{speed:.4g} km/h" for speed in figures.speed_km_h]
    for quantity, both in figures.delay_s.items():
        key, title = f"delay_{_key(quantity)}", f"delay of the {quantity}, {SINE_HZ:g} Hz"
        yield _worst_row(key, title, 1e3 * both, "ms", 0, 1e3 * DELAY_TOLERANCE_S, places)


def dwell_rows(figures: DwellFigures) -> Iterator[Row]:
    """Yield the three criteria of the sine with dwell, with their reserve, each at its worst amplitude."""
    displacement = figures.displacement_m
    limits = np.minimum(DISPLACEMENT_ENOUGH_M, DISPLACEMENT_SHARE_MIN * displacement[1])
    needed = np.maximum(figures.needed_m, np.where(np.isnan(limits), 0.0, limits))
    k = int(np.argmin(np.where(np.isnan(displacement[0]), -np.inf, displacement[0] - needed)))
    own, passive = map(float, displacement[:, k])
    yield _row(
        "dwell_displacement",
        "displacement in the sine with dwell",
        (own, passive),
        "m",
        2,
        float(limits[k]) if math.isfinite(limits[k]) else figures.needed_m,
        f"at least {figures.needed_m:g} m (reserve {own - figures.needed_m:.2f} m), and {DISPLACEMENT_ENOUGH_M:g} m or "
        f"{100.0 * DISPLACEMENT_SHARE_MIN:g} % of passive",
        high=True,
        criterion=figures.needed_m,
        at=_amplitude(k),
    )
    for after, limit in RATIOS.values():
        both = figures.ratio_percent[after]
        k = int(np.argmax(np.where(np.isnan(both[0]), np.inf, both[0])))
        own, passive = map(float, both[:, k])
        yield _row(
            f"dwell_ratio_{after:g}_s",
            f"yaw-rate ratio {after:g} s after sine with dwell",
            (own, passive),
            "%",
            1,
            max(limit, passive),
            f"at most {limit:g} % (reserve {limit - own:.1f})" if math.isfinite(own) else f"at most {limit:g} %",
            criterion=limit,
            at=_amplitude(k),
        )


def _amplitude(k: int) -> str:
    return f"{DWELL_KM_H:g} km/h, {DWELL_AMPLITUDES[k]:g} times the angle of 0.3 g"


def sweep_row(figures: SweepFigures) -> Row:
    """Return the row of the sweep of sines with dwell."""
    misses = max(figures.short, figures.failed)
    return Row(
        key="dwell_sweep",
        title="sines with dwell that only passive meets",
        value=float(misses),
        unit=f"of {figures.runs}",
        digits=0,
        at=f"displacement {figures.short}, all criteria {figures.failed}",
        required="none",
        verdict="worse" if misses else "equal",
    )


def lane_change_rows(figures: LaneChangeFigures) -> Iterator[Row]:
    """Yield the rows of the lane change."""
    yield _row(
        "lane_change_speed",
        "entry speed into the lane change",
        (figures.speed_km_h, figures.passive_speed_km_h),
        "km/h",
        0,
        figures.passive_speed_km_h - ENTRY_TOLERANCE_KM_H,
        "not below passive",
        high=True,
        at=f"ISO 3888-2, best of {figures.drivers} drivers",
    )
    if math.isnan(figures.sideslip_deg):
        return
    passive = figures.passive_sideslip_deg
    yield _row(
        "lane_change_sideslip",
        "peak sideslip in the lane change",
        (figures.sideslip_deg, passive),
        "deg",
        1,
        passive,
        f"at most {100.0 * SIDESLIP_SHARE_MAX:g} % of passive",
        criterion=SIDESLIP_SHARE_MAX * passive,
        at=f"{min(figures.speed_km_h, figures.passive_speed_km_h):.0f} km/h",
    )


def peak_rows(
    config: Config, step: StepFigures | None, dwell: DwellFigures | None, lane_change: LaneChangeFigures
) -> Iterator[Row]:
    """Yield the largest sideslip and slip of all drives. The passive car's figure is that of the same drive."""
    drives: list[tuple[str, FloatArray, FloatArray, FloatArray]] = []
    if step is not None:
        drives += [(_step(step, k), *_columns(step, k)) for k in range(step.speed_km_h.size)]
    if dwell is not None:
        drives += [
            (f"sine with dwell, {DWELL_AMPLITUDES[k]:g} times", *_columns(dwell, k)) for k in range(len(DWELL_AMPLITUDES))
        ]
    if not math.isnan(lane_change.sideslip_deg):
        sideslip = np.radians([lane_change.sideslip_deg, lane_change.passive_sideslip_deg])
        drives.append(("lane change", sideslip, lane_change.slip[0], lane_change.slip[1]))
    if not drives:
        return
    names = [name for name, *_ in drives]
    sideslip, front, rear = (np.array([drive[place] for drive in drives]) for place in (1, 2, 3))
    # How far a car that spins slides depends on where the drive ends.
    front, rear, degrees = (np.where(sideslip > SPIN_SIDESLIP, np.inf, each) for each in (front, rear, np.degrees(sideslip)))
    yield _worst_row("sideslip", "peak sideslip of all drives", degrees.T, "deg", 1, PEAK_SIDESLIP_TOLERANCE_DEG, names)
    for axle, slips, (limit, of) in zip(("front", "rear"), (front, rear), _slip_limits(config), strict=True):
        if not math.isfinite(limit):
            continue
        percent = 100.0 * slips / limit
        k = int(np.argmax(np.where(np.isinf(percent).all(axis=1), 0.0, percent[:, 0])))
        own, passive = map(float, percent[k])
        yield _row(
            f"slip_{axle}",
            f"largest {axle} slip",
            (own, passive),
            f"% of {of}",
            0,
            max(SLIP_MAX_PERCENT, passive),
            f"at most {SLIP_MAX_PERCENT:g} %, or as passive",
            at=names[k],
        )


def _columns(figures: StepFigures | DwellFigures, k: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    peaks = figures.peaks
    return peaks.sideslip[:, k], peaks.slip_front[:, k], peaks.slip_rear[:, k]


def _slip_limits(config: Config) -> list[tuple[float, str]]:
    """Return for each axle the slip in rad that its slip is compared with, and its name."""
    bounds = slip_bounds(config) or (math.inf, math.inf)
    found = []
    for tyre, load, bound in zip((config.tyre.front, config.tyre.rear), static_wheel_loads(config), bounds, strict=True):
        peak = MagicFormulaTyre.from_config(tyre, load, config.road.friction).peak_slip
        found.append((peak, "peak-force slip") if math.isfinite(peak) else (bound, "its bound"))
    return found


__all__ = [
    "dwell_rows",
    "lane_change_rows",
    "peak_rows",
    "sine_rows",
    "steady_rows",
    "step_rows",
    "sweep_row",
]

"""Facts and warnings about a reference map: units, what actuator and limiter can reach, and how much of the tyres it uses."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.emit.limiter_view import LimiterCut, cut_text
from codegen.errors import MapError, parts_of
from codegen.judgement.car_warnings import is_limit_beyond_actuator
from codegen.map_file.map import ReferenceMap
from codegen.optimum.nonlinear import slip_use
from codegen.text import distinct
from codegen.units import GRAVITY, KM_H
from codegen.vehicle.single_track import SingleTrack

GRIP_MAX_G = 1.5
"""Upper estimate of the lateral acceleration that road tyres reach without aerodynamic downforce, with a reserve."""
SLIP_USE_MAX_PERCENT = 101.0
"""Warn when a map uses more than this percentage of a slip bound. Maps solved with the nonlinear tyre stay below it."""
YAW_RATE_FALL = 0.05
"""Warn when the yaw rate of a square map falls by more than this fraction up to the largest front angle. Solved maps fall by
less than 0.01; transposed, by 0.09 to 0.3."""
BEND_MAX = 0.2
"""Warn when the yaw rate of a square map bends by more than this from the first front angle to the second: the logarithm of its
ratio to a yaw rate in proportion to the angle, median of all speeds. Solved maps of 10 x 10 points reach 0.12."""
GAIN_RATIO = (0.25, 4.0)
"""Plausible range of a map's yaw rates over those of the passive linear car, median of all cells. Solved maps have 0.9 to 1.1;
over a steering-wheel angle they have less than 0.1."""
TRANSPOSE = "transpose yaw_rate: its rows are speeds, its columns front angles"


@dataclass(frozen=True)
class MapFacts:
    """Shares of the feasible cells of a map, in percent.

    Attributes:
        reachable_percent: cells whose rear angle the actuator and the limiter reach; None for a map without rear angles.
    """

    reachable_percent: float | None

    @classmethod
    def of_map(cls, reference_map: ReferenceMap, config: Config) -> MapFacts:
        """Return the facts about a map for the actuator and the limiter of a configuration."""
        if reference_map.rear_angle is None:
            return cls(None)
        cut = LimiterCut.of_map(reference_map, config)
        return cls(100.0 * (1.0 - cut.cells / max(cut.of, 1)))

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return {"reachable_percent": None if self.reachable_percent is None else round(self.reachable_percent, 2)}

    def lines(self) -> Iterator[str]:
        """Yield a line for each known fact."""
        if self.reachable_percent is not None:
            yield f"actuator and limiter reach {self.reachable_percent:.4g} % of the feasible cells"


def map_warnings(reference_map: ReferenceMap, config: Config) -> Iterator[str]:
    """Yield warnings about parts of a map that the configured car cannot follow. If the units are wrong, report only that."""
    if units := beyond_grip(reference_map):
        yield units
        return
    yield from axis_warnings(reference_map, config)
    yield from rear_angle_warnings(reference_map, config)
    yield from slip_warnings(reference_map)


def axis_warnings(reference_map: ReferenceMap, config: Config) -> Iterator[str]:
    """Yield a warning if the axes seem to be exchanged or, if they are not, for front angles of another wheel or unit."""
    rates = np.where(reference_map.feasible, reference_map.yaw_rate, np.nan)
    if rates.shape[0] == rates.shape[1] and (falls := _fall_with_angle(rates)) > YAW_RATE_FALL >= _fall_with_angle(rates.T):
        yield (
            f"the yaw rate falls with the front angle, at the median speed by {100.0 * falls:.0f} % up to the largest angle; "
            f"{TRANSPOSE}"
        )
        return
    if rates.shape[0] == rates.shape[1] and _bend(rates, reference_map) > BEND_MAX >= 2.0 * _bend(rates.T, reference_map):
        yield (
            "the yaw rate is not in proportion to small front angles, but would be if rows and columns were exchanged; "
            f"{TRANSPOSE}"
        )
        return
    moving, steered = reference_map.speed > 0.0, reference_map.front_angle > 0.0
    passive = SingleTrack.from_config(config).yaw_gain(reference_map.speed[moving])[:, np.newaxis]
    gain = rates[np.ix_(moving, steered)] / (passive * reference_map.front_angle[steered])
    ratio, (low, high) = float(np.nanmedian(gain)) if np.isfinite(gain).any() else 1.0, GAIN_RATIO
    if ratio and not low <= abs(ratio) <= high:  # a map of zeros is refused for what it is
        yield (
            f"the map's yaw rates are {ratio:.2g} times those of the passive car (median of all cells; {low:g} to {high:g} is "
            f"plausible); delta_f must be the angle of the front wheels, not of the steering wheel, and in rad"
        )


def _fall_with_angle(yaw_rate: FloatArray) -> float:
    """Return by which fraction of its peak the yaw rate (speeds, angles) falls up to the largest angle, at the median speed."""
    peaks = np.fmax.reduce(yaw_rate, axis=1)
    known = np.isfinite(yaw_rate[:, -1]) & (peaks > 0.0)
    return float(np.median(1.0 - yaw_rate[known, -1] / peaks[known])) if known.any() else 0.0


def _bend(yaw_rate: FloatArray, reference_map: ReferenceMap) -> float:
    """Return how far the yaw rate (speeds, angles) is from proportion to the first two angles above zero. See BEND_MAX."""
    angles, positive = reference_map.front_angle, np.flatnonzero(reference_map.front_angle > 0.0)
    if positive.size < 2:
        return 0.0
    first, second = positive[:2]
    with np.errstate(divide="ignore", invalid="ignore"):
        bends = np.abs(np.log(yaw_rate[:, second] / yaw_rate[:, first] / (angles[second] / angles[first])))
    known = np.isfinite(bends)
    return float(np.median(bends[known])) if known.any() else 0.0


def rear_angle_warnings(reference_map: ReferenceMap, config: Config) -> Iterator[str]:
    """Yield a warning for rear angles beyond the actuator's range or, if there are none, for those that the limiter cuts."""
    rear, feasible, limit = reference_map.rear_angle, reference_map.feasible, config.rear_actuator.angle_max_deg
    if rear is None or is_limit_beyond_actuator(config):
        return
    angles = np.degrees(np.abs(np.where(feasible, rear, 0.0)))
    beyond = angles > limit * (1.0 + 1e-9)
    if beyond.any():
        yield (
            f"{100.0 * beyond.sum() / feasible.sum():.1f} % of the map's feasible cells use rear angles up to "
            f"{distinct(float(angles.max()), limit)} deg, beyond the {limit:g} deg of the actuator; "
            "solve it with limits.rear_angle_max_deg at most that"
        )
    elif warning := cut_warning(LimiterCut.of_map(reference_map, config).to_dict(), config):
        yield warning


def cut_warning(found: dict[str, Any], config: Config) -> str:
    """Return a warning about the rear angles that the limiter cuts, from `LimiterCut.to_dict`; "" if it cuts none."""
    if not found["cells"] or is_limit_beyond_actuator(config):
        return ""
    limiter = config.limiter
    acceleration = limiter.opposite_phase_lateral_acceleration_m_s2
    from_car = limiter.opposite_phase_speed_km_h == limiter.opposite_phase_max_deg == "from-car"
    remedy = (
        f"raise limiter.opposite_phase_lateral_acceleration_m_s2 (it is {acceleration:g}), or "
        f"lower limiter.in_phase_from_front_angle_deg (it is {limiter.in_phase_from_front_angle_deg:g})"
        if from_car
        else 'raise its bounds, or set limiter.opposite_phase_speed_km_h = "from-car" and opposite_phase_max_deg = "from-car"'
    )
    return f"the limiter cuts {cut_text(found)}; {remedy}"


def slip_warnings(reference_map: ReferenceMap) -> Iterator[str]:
    """Yield a warning if a steady turn of the map exceeds a slip bound of the car with nonlinear tyres."""
    used = slip_use(reference_map)
    if used is None:
        return
    worst = {axle: float(np.nanmax(percent, initial=0.0)) for axle, percent in (("front", used.front), ("rear", used.rear))}
    if max(worst.values()) <= SLIP_USE_MAX_PERCENT:
        return
    percent = np.fmax(used.front, used.rear)
    row, column = np.unravel_index(int(np.nanargmax(percent)), percent.shape)
    front, rear = (distinct(worst[axle], 100.0, 3) for axle in ("front", "rear"))
    remedy = (
        "the map is not the optimum of its own configuration; solve it again"
        if reference_map.tyre_model == "magic-formula"
        else 'solve with tyre_model = "magic-formula" to keep them'
    )
    yield (
        f"with its nonlinear tyres the car uses {front} % of the front and {rear} % of the rear slip bound in the map's steady "
        f"turns (worst at {reference_map.speed[row] / KM_H:.0f} km/h, "
        f"{math.degrees(reference_map.front_angle[column]):.1f} deg); {remedy}"
    )


def _lateral_acceleration_g(speed: FloatArray, yaw_rate: FloatArray) -> float:
    """Return the largest lateral acceleration, in g, for speeds (n,) in m/s and yaw rates (n, m) in rad/s."""
    return float(np.nanmax(speed[:, np.newaxis] * yaw_rate)) / GRAVITY


def beyond_grip(reference_map: ReferenceMap) -> str:
    """Return a text about wrong units of a map and their likely cause; "" if the units are plausible."""
    speed, rates = reference_map.speed, reference_map.yaw_rate
    largest = _lateral_acceleration_g(speed, rates)
    if largest <= GRIP_MAX_G:
        return ""
    required = distinct(largest, GRIP_MAX_G)
    what = f"the map requires {required} g of lateral acceleration, beyond the {GRIP_MAX_G:g} g that road tyres reach"
    if rates.shape[0] == rates.shape[1] and _lateral_acceleration_g(speed, rates.T) <= GRIP_MAX_G:
        return f"{what}; {TRANSPOSE}"
    if largest * KM_H <= GRIP_MAX_G:
        return f"{what}; is vx in km/h? It must be in m/s, and yaw_rate in rad/s"
    return f"{what}; vx must be in m/s, yaw_rate in rad/s"


def require_grip(reference_map: ReferenceMap, where: object) -> None:
    """Raise MapError for a map that no road car can follow."""
    if text := beyond_grip(reference_map):
        what, remedy = parts_of(text)
        raise MapError(what, where=where, remedy=f"{remedy}; or build with `beyond_grip=True`")

"""Facts and warnings about a reference map: units, what actuator and limiter can reach, and how much of the tyres it uses."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.configuration import KM_H, Config
from codegen.emit.limiter_cut import LimiterCut, cut_text
from codegen.errors import MapError
from codegen.map_file.map import ReferenceMap
from codegen.map_file.tables import binding_text
from codegen.optimum.slip_use import slip_use
from codegen.vehicle.single_track import SingleTrack

FloatArray = npt.NDArray[np.float64]

STANDARD_GRAVITY = 9.81
"""m/s^2"""

GRIP_MAX_G = 1.5
"""Largest lateral acceleration that road tyres reach without aerodynamic downforce, with room."""
SLIP_USE_MAX_PERCENT = 101.0
"""Slip over its bound from which a map is reported; a map of the nonlinear tyre stays below."""
TURNS_LESS_FACTOR = 0.99
"""The controlled car turns less than the passive one where its yaw rate is below this multiple."""


@dataclass(frozen=True)
class MapFacts:
    """Shares of the feasible cells of a solved map, in percent.

    Attributes:
        reachable_percent: cells whose rear angle the actuator and the limiter reach.
        turns_less_percent: cells in which the controlled car turns less than the passive linear one.
        turns_less_by: the same cells by the constraint that is active there; "none" for an optimum inside all of them.
    """

    reachable_percent: float
    turns_less_percent: float
    turns_less_by: dict[str, float]

    @classmethod
    def of_map(cls, reference_map: ReferenceMap, config: Config) -> MapFacts:
        """Return the facts about a map, with the actuator and the limiter of a configuration."""
        cut = LimiterCut.of_map(reference_map, config)
        feasible, cells = reference_map.feasible, max(int(reference_map.feasible.sum()), 1)
        gain = SingleTrack.from_config(config).yaw_gain(np.fmax(reference_map.speed, 1e-9))[:, np.newaxis]
        less = feasible & (reference_map.yaw_rate < TURNS_LESS_FACTOR * gain * reference_map.front_angle) & (gain > 0.0)
        by: dict[str, float] = {}
        if reference_map.active is not None:
            for flags in np.unique(reference_map.active[less]):
                by[binding_text(int(flags))] = 100.0 * float((less & (reference_map.active == flags)).sum()) / cells
        return cls(100.0 * (1.0 - cut.cells / max(cut.of, 1)), 100.0 * float(less.sum()) / cells, by)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        by = {name: round(share, 2) for name, share in self.turns_less_by.items()}
        return {
            "reachable_percent": round(self.reachable_percent, 2),
            "turns_less_percent": round(self.turns_less_percent, 2),
            "turns_less_by": by,
        }

    def lines(self) -> tuple[str, ...]:
        """Return a line for each fact."""
        by = ", ".join(
            f"{'no constraint' if name == 'none' else name} {share:.0f} %"
            for name, share in sorted(self.turns_less_by.items(), key=lambda item: -item[1])
            if share >= 0.5
        )
        active = f"; active there: {by}" if by else ""
        return (
            f"actuator and limiter reach {self.reachable_percent:.4g} % of the feasible cells",
            f"the controlled car turns less than the passive one in {self.turns_less_percent:.0f} % of them{active}",
        )


def map_warnings(reference_map: ReferenceMap, config: Config) -> Iterator[str]:
    """Return a warning for each part of a map that the car of a configuration cannot follow."""
    if grip := beyond_grip(reference_map):
        yield grip
    yield from rear_angle_warnings(reference_map, config)
    yield from slip_warnings(reference_map)


def rear_angle_warnings(reference_map: ReferenceMap, config: Config) -> Iterator[str]:
    """Return a warning for cells beyond the actuator, and for those that the limiter cuts."""
    rear, feasible = reference_map.rear_angle, reference_map.feasible
    if rear is not None:
        beyond = feasible & (np.abs(np.where(feasible, rear, 0.0)) > config.rear_actuator.angle_max * (1.0 + 1e-9))
        if beyond.any():
            yield (
                f"{100.0 * beyond.sum() / feasible.sum():.1f} % of the map's feasible cells use rear angles up to "
                f"{math.degrees(np.abs(rear[beyond]).max()):.2g} deg, beyond the {config.rear_actuator.angle_max_deg:g} deg of "
                "the actuator; solve it with limits.rear_angle_max_deg at most that"
            )
            return
    if warning := cut_warning(LimiterCut.of_map(reference_map, config).to_dict()):
        yield warning


def cut_warning(found: dict[str, Any]) -> str:
    """Return a warning about what the limiter cuts off a map, from `LimiterCut.to_dict`; "" where it cuts nothing."""
    if not found["cells"]:
        return ""
    return (
        f"the limiter cuts {cut_text(found)}; raise its bounds, "
        'or take limiter.opposite_phase_speed_km_h = "from-car" with opposite_phase_max_deg = "from-car"'
    )


def slip_warnings(reference_map: ReferenceMap) -> Iterator[str]:
    """Return a warning where a steady turn of the map exceeds a slip bound on the car with its nonlinear tyres."""
    used = slip_use(reference_map)
    if used is None:
        return
    worst = {axle: float(np.nanmax(percent, initial=0.0)) for axle, percent in (("front", used.front), ("rear", used.rear))}
    if max(worst.values()) <= SLIP_USE_MAX_PERCENT:
        return
    percent = np.fmax(used.front, used.rear)
    row, column = np.unravel_index(int(np.nanargmax(percent)), percent.shape)
    yield (
        f"with its nonlinear tyres the car uses {worst['front']:.0f} % of the front and {worst['rear']:.0f} % of the rear slip "
        f"bound in the map's steady turns (worst at {reference_map.speed[row] / KM_H:.0f} km/h, "
        f'{math.degrees(reference_map.front_angle[column]):.1f} deg); solve with tyre_model = "magic-formula" to keep them'
    )


def _lateral_acceleration_g(speed: FloatArray, yaw_rate: FloatArray) -> float:
    """Return the largest lateral acceleration, in g, for speeds (n,) in m/s and yaw rates (n, m) in rad/s."""
    return float(np.nanmax(speed[:, np.newaxis] * yaw_rate)) / STANDARD_GRAVITY


def beyond_grip(reference_map: ReferenceMap) -> str:
    """Return what is wrong with the units of a map, and the likely cause; "" where nothing is."""
    speed, rates = reference_map.speed, reference_map.yaw_rate
    largest = _lateral_acceleration_g(speed, rates)
    if largest <= GRIP_MAX_G:
        return ""
    what = f"the map asks for {largest:.2g} g of lateral acceleration, beyond the {GRIP_MAX_G:g} g that road tyres can give"
    if rates.shape[0] == rates.shape[1] and _lateral_acceleration_g(speed, rates.T) <= GRIP_MAX_G:
        return f"{what}; transpose yaw_rate: its rows are speeds, its columns front angles"
    if largest / 3.6 <= GRIP_MAX_G:
        return f"{what}; is vx in km/h? It must be in m/s, and yaw_rate in rad/s"
    return f"{what}; vx must be in m/s, yaw_rate in rad/s"


def require_grip(reference_map: ReferenceMap, where: object) -> None:
    """Raise MapError for a map that no road car can follow."""
    if text := beyond_grip(reference_map):
        what, _, remedy = text.partition("; ")
        raise MapError(what, where=where, remedy=f"{remedy}; or build with --beyond-grip")

"""Figures of a map and a run, as rows of text and as plain data. No printing, no plotting."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.map_file.bounds import BOUNDS, binding_text
from codegen.map_file.longitudinal import like_friction
from codegen.map_file.map import ReferenceMap
from codegen.map_file.tables import ACCELERATION_STACK, FRICTION_STACK
from codegen.units import KM_H

if TYPE_CHECKING:
    from hil_sim.metrics import Evaluation

TYRE = "tyre of the optimisation"


def tyre_note(tyre_model: str | None) -> str:
    """Suffix of a name in captions and legends; "" for the linear tyre, and if it is unknown."""
    return "" if tyre_model in (None, "linear") else f" ({tyre_model})"


@dataclass(frozen=True)
class LayerSummary:
    """The map of one friction of the road in figures."""

    friction: float
    feasible_cells: int
    lateral_acceleration_max_m_s2: float


@dataclass(frozen=True)
class AccelerationSummary:
    """One longitudinal acceleration of a stack.

    `like_friction` is the friction that leaves the weaker axle as much lateral grip; None without a configuration.
    """

    acceleration_m_s2: float
    feasible_cells: int
    lateral_acceleration_max_m_s2: float
    like_friction: float | None


@dataclass(frozen=True)
class MapSummary:
    """A map in figures. Ranges are (smallest, largest) over feasible cells, in the units of the names.

    `tyre_model` is that of the optimisation; None for a bare map.
    `friction` is that of the map itself; None without a configuration. `stack` contains the lower ones, rising.
    `tightening` is the table `[tightening]` of its configuration; None where that leaves the limits as they are.
    """

    case: str | None
    tyre_model: str | None
    speed_points: int
    front_angle_points: int
    speed_km_h: tuple[float, float]
    front_angle_deg: tuple[float, float]
    cells: int
    feasible_cells: int
    yaw_rate_deg_s: tuple[float, float]
    lateral_acceleration_max_m_s2: float
    sideslip_deg: tuple[float, float] | None
    rear_angle_deg: tuple[float, float] | None
    binding_cells: dict[str, int] | None
    friction: float | None
    stack: tuple[LayerSummary, ...]
    acceleration_stack: tuple[AccelerationSummary, ...]
    tightening: dict[str, Any] | None

    def to_dict(self) -> dict[str, Any]:
        """Return name -> value, for JSON."""
        facts = asdict(self)
        if not self.acceleration_stack:
            del facts["acceleration_stack"]
        if self.tightening is None:
            del facts["tightening"]
        return facts

    @property
    def headline(self) -> str:
        """Origin, size and feasibility in one line."""
        origin = f"case {self.case}" if self.case else "a bare map"
        lower = ", ".join(f"{layer.friction:g}" for layer in self.stack)
        moving = ", ".join(f"{layer.acceleration_m_s2:g}" for layer in self.acceleration_stack)
        stack = f"; a stack with friction {lower}" if lower else ""
        stack += f"; a stack with longitudinal acceleration {moving} m/s^2" if moving else ""
        return (
            f"{origin}, {self.speed_points} speeds x {self.front_angle_points} front angles, "
            f"{self.feasible_cells} of {self.cells} cells feasible ({100.0 * self.feasible_cells / self.cells:.1f} %){stack}"
        )

    @property
    def tyre_line(self) -> str:
        """Description of the tyre of the optimisation; "" if the map has none."""
        return f"{TYRE}: {self.tyre_model}" if self.tyre_model else ""

    @property
    def tightening_line(self) -> str:
        """Description of the tightened limits; "" if there are none."""
        if self.tightening is None:
            return ""
        used = ", ".join(
            f"{bound.label} {100.0 * fraction:.1f} %"
            for bound in BOUNDS
            if (fraction := self.tightening.get(bound.limit, 1.0)) < 1.0
        )
        line = f"limits tightened to {used or '100 %'}"
        share, cars, lost = (self.tightening[key] for key in ("share", "cars", "lost"))
        return (
            line
            if share is None
            else f"{line}; {lost} of {cars} drawn cars exceed a limit ({100.0 * share:g} % must keep them)"
        )

    @property
    def axis_rows(self) -> list[tuple[str, ...]]:
        """Rows for the axes: name, from, to, unit, number of points."""
        return [
            ("speed", *_span(self.speed_km_h), "km/h", str(self.speed_points)),
            ("front angle", *_span(self.front_angle_deg), "deg", str(self.front_angle_points)),
        ]

    @property
    def value_rows(self) -> list[tuple[str, ...]]:
        """Rows for the values: name, from, to, unit."""
        rows: list[tuple[str, ...]] = [
            ("yaw rate", *_span(self.yaw_rate_deg_s), "deg/s"),
            ("lateral acceleration", "", f"{self.lateral_acceleration_max_m_s2:.4g}", "m/s^2"),
        ]
        for name, span in (("sideslip", self.sideslip_deg), ("rear angle", self.rear_angle_deg)):
            if span is not None:
                rows.append((name, *_span(span), "deg"))
        return rows

    @property
    def binding_rows(self) -> list[tuple[str, ...]]:
        """Rows for the binding constraints: set, cells, share of the feasible ones."""
        counts = self.binding_cells or {}
        return [(name, str(count), f"{100.0 * count / self.feasible_cells:.1f} %") for name, count in counts.items()]

    @property
    def stack_rows(self) -> list[tuple[str, ...]]:
        """Rows for the frictions, rising to that of the map itself: friction, cells, share, m/s^2; [] without a stack."""
        if not self.stack:
            return []

        def row(name: str, cells: int, lateral_acceleration: float) -> tuple[str, ...]:
            return name, str(cells), f"{100.0 * cells / self.cells:.1f} %", f"{lateral_acceleration:.4g}"

        own = "the map itself" if self.friction is None else f"{self.friction:g} (the map itself)"
        return [
            *(row(f"{at.friction:g}", at.feasible_cells, at.lateral_acceleration_max_m_s2) for at in self.stack),
            row(own, self.feasible_cells, self.lateral_acceleration_max_m_s2),
        ]

    @property
    def acceleration_rows(self) -> list[tuple[str, ...]]:
        """Rows for the longitudinal accelerations, rising: m/s^2, cells, share, m/s^2, friction; [] without such a stack."""
        if not self.acceleration_stack:
            return []
        own = AccelerationSummary(0.0, self.feasible_cells, self.lateral_acceleration_max_m_s2, self.friction)
        return [
            (
                f"{at.acceleration_m_s2:g}" if at is not own else "0 (the map itself)",
                str(at.feasible_cells),
                f"{100.0 * at.feasible_cells / self.cells:.1f} %",
                f"{at.lateral_acceleration_max_m_s2:.4g}",
                "-" if at.like_friction is None else f"{at.like_friction:.2f}",
            )
            for at in sorted((*self.acceleration_stack, own), key=lambda at: at.acceleration_m_s2)
        ]


def _span(values: tuple[float, float]) -> tuple[str, str]:
    return f"{values[0]:.4g}", f"{values[1]:.4g}"


def map_summary(reference_map: ReferenceMap) -> MapSummary:
    """Return the summary of a map."""
    feasible = reference_map.feasible

    def span(values: Any, factor: float) -> tuple[float, float]:
        return float(np.min(values[feasible]) * factor), float(np.max(values[feasible]) * factor)

    binding = None
    if reference_map.active is not None:
        counts = Counter(reference_map.active[feasible].tolist())
        binding = {binding_text(flags): count for flags, count in counts.most_common()}
    degrees = math.degrees(1.0)
    return MapSummary(
        case=reference_map.case,
        tyre_model=reference_map.tyre_model,
        speed_points=reference_map.speed.size,
        front_angle_points=reference_map.front_angle.size,
        speed_km_h=(float(reference_map.speed[0] / KM_H), float(reference_map.speed[-1] / KM_H)),
        front_angle_deg=(float(reference_map.front_angle[0] * degrees), float(reference_map.front_angle[-1] * degrees)),
        cells=feasible.size,
        feasible_cells=int(feasible.sum()),
        yaw_rate_deg_s=span(reference_map.yaw_rate, degrees),
        lateral_acceleration_max_m_s2=_lateral_acceleration_max(reference_map),
        sideslip_deg=None if reference_map.sideslip is None else span(reference_map.sideslip, degrees),
        rear_angle_deg=None if reference_map.rear_angle is None else span(reference_map.rear_angle, degrees),
        binding_cells=binding,
        friction=None if reference_map.config is None else reference_map.config.road.friction,
        stack=tuple(
            LayerSummary(layer.value, int(layer.map.feasible.sum()), _lateral_acceleration_max(layer.map))
            for layer in reference_map.layers
            if layer.quantity is FRICTION_STACK
        ),
        acceleration_stack=tuple(
            AccelerationSummary(
                layer.value,
                int(layer.map.feasible.sum()),
                _lateral_acceleration_max(layer.map),
                None if reference_map.config is None else like_friction(reference_map.config, layer.value),
            )
            for layer in reference_map.layers
            if layer.quantity is ACCELERATION_STACK
        ),
        tightening=_tightening(reference_map),
    )


def _tightening(reference_map: ReferenceMap) -> dict[str, Any] | None:
    config = reference_map.config
    return None if config is None or config.with_whole_limits is config else config.tightening.model_dump()


def _lateral_acceleration_max(reference_map: ReferenceMap) -> float:
    return float(np.max((reference_map.speed[:, np.newaxis] * reference_map.yaw_rate)[reference_map.feasible]))


def metric_rows(evaluation: Evaluation) -> list[tuple[str, ...]]:
    """Return the rows of a table of figures: a name with its unit, then a column for each run."""
    return [(f"{title} [{unit}]" if unit else title, *texts) for title, unit, texts in evaluation.rows]

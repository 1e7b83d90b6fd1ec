"""Figures over all cells of one subject under one condition."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from hil_sim.suite.cells import Cell
from hil_sim.suite.runs import CellResult


@dataclass(frozen=True)
class Extreme:
    """A figure and the cell that has it."""

    value: float
    cell: Cell


@dataclass(frozen=True)
class Summary:
    """Figures over the cells in which the car does not spin; None if there is none.

    Attributes:
        subject, condition: names.
        cells: number of cells.
        spins: number of cells in which the car spins.
        unsettled: number of cells in which the yaw rate is not steady at the end; they have no settling time.
        overshoot_mean_percent: mean over the cells; the others are the largest, in magnitude for the error to the map.
    """

    subject: str
    condition: str
    cells: int
    spins: tuple[Cell, ...]
    unsettled: tuple[Cell, ...]
    overshoot_mean_percent: float | None
    overshoot_percent: Extreme | None
    rise_time_s: Extreme | None
    settling_time_s: Extreme | None
    sideslip_max_deg: Extreme | None
    map_error_percent: Extreme | None
    map_overshoot_percent: Extreme | None
    slip_percent: Extreme | None
    sideslip_excess_deg: Extreme | None

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return asdict(self)


def summarise(subject: str, condition: str, results: Sequence[CellResult]) -> Summary:
    """Return the figures of one table."""
    on_road = [result for result in results if not result.spun]
    overshoots = [result.overshoot_percent for result in on_road if result.overshoot_percent is not None]
    return Summary(
        subject=subject,
        condition=condition,
        cells=len(results),
        spins=tuple(result.cell for result in results if result.spun),
        unsettled=tuple(result.cell for result in on_road if not result.settled),
        overshoot_mean_percent=sum(overshoots) / len(overshoots) if overshoots else None,
        overshoot_percent=extreme(on_road, "overshoot_percent"),
        rise_time_s=extreme(on_road, "rise_time_s"),
        settling_time_s=extreme(on_road, "settling_time_s"),
        sideslip_max_deg=extreme(on_road, "sideslip_max_deg"),
        map_error_percent=extreme(on_road, "map_error_percent", functools.partial(max, key=abs)),
        map_overshoot_percent=extreme(on_road, "map_overshoot_percent"),
        slip_percent=extreme(on_road, "slip_percent"),
        sideslip_excess_deg=extreme(on_road, "sideslip_excess_deg"),
    )


def extreme(results: Sequence[CellResult], name: str, choose: Callable[..., float] = max) -> Extreme | None:
    """Return the largest (or smallest) value of a figure with its cell, the first of equals; None if no run has it."""
    values = [value for result in results if (value := getattr(result, name)) is not None]
    if not values:
        return None
    wanted = choose(values)
    return next(Extreme(wanted, result.cell) for result in results if getattr(result, name) == wanted)

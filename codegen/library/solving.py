"""Solve the optimisation of a case."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

from codegen.errors import CodegenError, within
from codegen.judgement.car_warnings import Handling, car_warnings
from codegen.judgement.map_warnings import MapFacts, map_warnings
from codegen.library.configurations import ConfigLike, given_config, name_of
from codegen.library.maps import Map
from codegen.library.result import Progress, Work, public
from codegen.map_file.map import Chosen, ReferenceMap, choose_config
from codegen.optimum.solve import (
    ACCELERATION_ARGUMENT,
    FRICTION_ARGUMENT,
    Method,
    solve_acceleration_stack,
    solve_case,
    solve_stack,
)
from codegen.optimum.uncertain import SHARE_ARGUMENT, UncertainMap, solve_uncertain
from codegen.report.map_difference import map_difference
from codegen.report.summary import map_summary


class SolvedMap(Map):
    """A map that was solved now.

    Attributes:
        source: where its configuration came from: a file name, "preset" or "given".
        nominal: the map with the whole limits, where `share` was given; else None.
    """

    def __init__(self, reference_map: ReferenceMap, chosen: Chosen, uncertain: UncertainMap | None) -> None:
        super().__init__(reference_map)
        config = chosen.config
        self.source, self.notes = chosen.source, chosen.notes
        self.warnings = (*car_warnings(config), *map_warnings(reference_map, config))
        self.nominal = None if uncertain is None else Map(uncertain.nominal)
        self._handling, self._facts = Handling.from_config(config), MapFacts.of_map(reference_map, config)
        self._cost = {} if uncertain is None else _cost(uncertain)

    def lines(self) -> list[str]:
        """Return size and feasibility, handling of the car, and facts about the map."""
        summary = map_summary(self.reference_map)
        lines = [f"{self.path or 'map'}: {summary.headline}", f"car: {self._handling}"]
        lines += [f"map: {line}" for line in self._facts.lines()]
        if self.nominal is not None:
            cost = self._cost
            mean, largest = (f"{cost[key]:.2f} deg/s" for key in ("yaw_rate_mean_deg_s", "yaw_rate_max_deg_s"))
            lines.append(f"map: {summary.tightening_line}")
            lines.append(
                f"{self.nominal.path or 'nominal'}: the map with the whole limits; {cost['lost_percent']:.0f} % of the cars "
                f"exceed one. Its yaw rate is {mean} larger on average, at most {largest} at {cost['at']}, and {cost['cells']} "
                "more cells are feasible"
            )
        return lines

    def to_dict(self) -> dict[str, Any]:
        """Return the same facts, as `codegen solve --json` prints them."""
        origin = {"map": None if self.path is None else str(self.path), "configuration": self.source}
        told = {"notes": list(self.notes), "warnings": list(self.warnings), "handling": self._handling.to_dict()}
        facts = {**origin, **told, **self._facts.to_dict(), **map_summary(self.reference_map).to_dict()}
        if self.nominal is None:
            return facts
        path = self.nominal.path
        return {**facts, "nominal": {"map": None if path is None else str(path), **self._cost}}


def _cost(uncertain: UncertainMap) -> dict[str, Any]:
    """Return what the nominal map has more than the tightened one, as JSON values."""
    found = map_difference(uncertain.nominal, uncertain.map, (None, None))
    return {
        "lost_percent": 100.0 * uncertain.lost_by_nominal,
        "yaw_rate_mean_deg_s": found.mean_deg_s,
        "yaw_rate_max_deg_s": found.largest_deg_s,
        "at": str(found.largest_at),
        "cells": found.only_first - found.only_second,
    }


@public
def solve(
    config: ConfigLike | None = None,
    case: str = "4ws-2",
    *,
    method: Literal["exact", "ipopt"] = "exact",
    friction: Sequence[float] | None = None,
    longitudinal_acceleration: Sequence[float] | None = None,
    share: float | None = None,
    progress: Progress | None = None,
) -> SolvedMap:
    """Solve the optimisation of one case on the configured grid.

    Args:
        config: the car; by default the paper's preset.
        case: fws, 4ws-1, 4ws-2, a case of your own, or for comparison zero-sideslip, variable-wheelbase, envelope.
        method: "exact" solves all points at once, "ipopt" point by point, as a reference.
        friction: solve a map for each friction; the largest is `road.friction`.
        longitudinal_acceleration: solve a map for each, in m/s^2; 0 is the map itself.
        share: tighten the limits until this share of the cars within `[identified]` keeps them, such as 0.99.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: there is no such case, options exclude each other, or no point of the grid is feasible.
    """
    if friction is not None and longitudinal_acceleration is not None:
        raise CodegenError("a map has one stack", where=ACCELERATION_ARGUMENT, remedy=f"leave it or {FRICTION_ARGUMENT} out")
    if share is not None:
        is_given = {
            FRICTION_ARGUMENT: friction is not None,
            ACCELERATION_ARGUMENT: longitudinal_acceleration is not None,
            "`method='ipopt'`": method == "ipopt",
        }
        for argument in (argument for argument, value in is_given.items() if value):
            raise CodegenError(f"cannot be combined with {SHARE_ARGUMENT}", where=argument, remedy="leave one of them out")
    given = given_config(config)
    chosen = choose_config(None, given)
    title = f"solving {case}" + ("" if friction is None else f" for {len(friction)} frictions")
    title += "" if longitudinal_acceleration is None else f" for {len(longitudinal_acceleration)} accelerations"
    title += "" if share is None else f" for {100.0 * share:g} % of the cars"
    place = "the paper's preset" if given is None else name_of(given)
    solver: Method = method
    uncertain = None
    with within(place), Work(progress).stage(title) as tell:
        if friction is not None:
            made = solve_stack(chosen.config, case, friction, solver, tell)
        elif longitudinal_acceleration is not None:
            made = solve_acceleration_stack(chosen.config, case, longitudinal_acceleration, solver, tell)
        elif share is not None:
            uncertain = solve_uncertain(chosen.config, case, share, tell)
            made = uncertain.map
        else:
            made = solve_case(chosen.config, case, solver, tell)
        return SolvedMap(made, chosen, uncertain)

"""Contracts and lemmas of the map."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from codegen.emit.contracts.conditions import Conditions
from codegen.emit.contracts.contract import Claim, Lemma, ProvedFunction
from codegen.emit.laws import REAR_ANGLE_MAX_RAD

MAP_YAW_RATE_MAX_RAD_S = 16.0
"""Bound of the looked-up yaw rate: above the table's, by more than the rounding of two interpolations; a power of two."""


class MapUnits(Conditions):
    """Contracts of the look-ups and of a valid map."""

    def lemmas(self) -> Iterator[Lemma]:
        """Yield the lemmas on searches and cells."""
        if self.has_plain_map:
            unit, searched = self.own("map"), (self.scalar("speed"), self.scalar("front_angle"))
            yield Lemma("lemma_axes", before=("assume_breakpoints();",), unwind=self._rounds())
            yield Lemma("lemma_place", searched, unit, before=("lemma_axes();",))
            yield Lemma("lemma_cell", unit=unit)
            yield Lemma("lemma_grid", unit=unit)
            yield Lemma("lemma_numbers", unit=unit, unwind=self._rounds())

    def units(self) -> Iterator[ProvedFunction]:
        """Yield the contracts."""
        own, unit, view = self.own, self.own("map"), self.map
        names = ("speed", "front_angle", "friction", *(["longitudinal_acceleration"] if view.takes_acceleration else []))
        arguments = tuple(self.scalar(name) for name in names)
        missing: dict[str, Any] = {"open": "the lemmas on maps are for one table of real numbers without a table of grip"}
        yield self._map_valid() if self.has_plain_map else ProvedFunction(own("map_valid"), unit, (), "bool", **missing)
        more: dict[str, Any] = self._look_up() if self.has_plain_map else missing
        bound = Claim("the yaw rate is in range", self.within("result", MAP_YAW_RATE_MAX_RAD_S))
        look_ups = [ProvedFunction(own("map_yaw_rate_on_road"), unit, arguments, self.real, ensures=(bound,), **more)]
        if view.with_rear_angle:
            bounds = (
                Claim("the yaw rate is in range", self.within("result->yaw_rate", MAP_YAW_RATE_MAX_RAD_S)),
                Claim("the rear angle is in range", self.within("result->rear_angle", REAR_ANGLE_MAX_RAD)),
                Claim("the acceleration is in range", self.between("result->lateral_acceleration_max", 0.0, 100.0)),
            )
            look_ups += [
                ProvedFunction(own("map_reference"), unit, arguments, own("map_reference_t"), True, ensures=bounds, **more)
            ]
        yield from look_ups
        if self.has_plain_map:
            yield from map(self._mirrored, look_ups)

    def _mirrored(self, look_up: ProvedFunction) -> ProvedFunction:
        """Return the harness that the look-up is odd in the front angle."""
        more = ", ".join(argument.name for argument in look_up.arguments[2:])
        facts = f"const {look_up.result} mirrored = {look_up.function}(speed, -front_angle, {more});"
        names = [f".{name}" for name in ("yaw_rate", "rear_angle")] if look_up.result_is_struct else [""]
        turns = f"((front_angle < {self.number(0.0)}) || (front_angle > {self.number(0.0)}))"
        claims = (
            Claim(
                f"the mirrored front angle gives the mirrored{name.replace('.', ' ').replace('_', ' ') or ' yaw rate'}",
                f"!{turns} || are_mirrored(result{name}, mirrored{name})",
            )
            for name in names
        )
        alone: dict[str, Any] = {"stand_in": "cell_of_lemma", "replaced": ("magnitude", "interpolate"), "only_claims": True}
        return replace(look_up, part="_mirrored", before=(), facts=(facts,), more=tuple(claims), **alone)

    def _map_valid(self) -> ProvedFunction:
        own, view = self.own, self.map
        inside = f"(any_row < (uint32_t){view.speed.points}) && (any_column < (uint32_t){view.front_angle.points})"
        checks = [
            "are_between",
            "are_increasing",
            *(["are_even"] if view.speed.axis.even or view.front_angle.axis.even else []),
        ]
        return ProvedFunction(
            own("map_valid"),
            own("map"),
            (),
            "bool",
            ensures=self.map_holds(),
            includes=True,
            before=(f"CONTRACT_ASSUME({inside});",),
            stand_in="checks_of_lemma",
            replaced=tuple(checks),
            unwind=self._rounds(),
        )

    def _look_up(self) -> dict[str, Any]:
        """Proof of a look-up in any valid map, which callers have from valid parameters."""
        return {
            "includes": True,
            "before": ("lemma_axes();", "lemma_constants();", "lemma_place(speed, front_angle);"),
            "facts": ("lemma_cap(yaw_rate_of_cell, speed, road_of(friction).lateral_acceleration_max);",),
            "stand_in": "interpolate_of_lemma",
            "replaced": ("interpolate",),
        }

    def _rounds(self) -> int:
        """Loop rounds over the longer axis."""
        return max(self.map.speed.size, self.map.front_angle.size) + 1

"""The contracts of a build: the one table of what its functions require and ensure.

Ranges come from the tables of parameters, signals and laws. Conditions are C over the arguments, `result` and, for the value of
a state before the call, `<argument>_before`; `->` leads from an argument to its members.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from codegen.emit.contracts.chain import ChainUnits
from codegen.emit.contracts.conditions import Conditions
from codegen.emit.contracts.contract import Argument, Bound, Invariant, Lemma, ProvedFunction
from codegen.emit.contracts.control import ControlUnits
from codegen.emit.contracts.frames import FrameUnits
from codegen.emit.contracts.invariants import Invariants
from codegen.emit.contracts.maps import MapUnits

PLACES: Mapping[str, str] = {
    "controller_t": "",
    "law_t": "law.",
    "reference_model_t": "law.model.",
    "grip_t": "grip.",
    "inputs_t": "inputs.",
    "limiter_t": "limiter.",
}
"""Struct -> path to it in the state of the controller."""
REWRITTEN_FIRST = ("yaw_rate_reference", "limiter.speed", "limiter.front_angle")
"""Numbers that a step writes before it reads them, besides those of the sample."""


@dataclass(frozen=True)
class Contracts:
    """All contracts of a build."""

    invariants: dict[str, Invariant]
    lemmas: tuple[Lemma, ...]
    units: tuple[ProvedFunction, ...]

    @property
    def numbers(self) -> tuple[str, ...]:
        """Paths of the real numbers with a bound in the state of the controller, but for those that a step writes first."""
        found = (
            f"{PLACES[struct]}{condition.number.removeprefix('value->')}"
            for ctype, invariant in self.invariants.items()
            if (struct := ctype.partition("_")[2]) in PLACES
            for condition in invariant.claims
            if isinstance(condition, Bound)
        )
        return tuple(name for name in found if not (name.startswith("sample.") or name in REWRITTEN_FIRST))

    def of(self, function: str) -> ProvedFunction:
        """Return the contract of a function."""
        return next(unit for unit in self.units if unit.name == function)


def contracts_of(context: Mapping[str, Any]) -> Contracts:
    """Return the contracts of the build whose templates have this context."""
    maps = MapUnits(context)
    return Contracts(
        {each.ctype: each for each in Invariants(context).invariants()},
        (*_lemmas(Conditions(context)), *maps.lemmas()),
        (*ChainUnits(context).units(), *maps.units(), *ControlUnits(context).units(), *FrameUnits(context).units()),
    )


def _lemmas(build: Conditions) -> Iterator[Lemma]:
    """Yield facts that a solver proves alone but not inside of a function; `lemmas.j2` holds their C."""
    number = {name: build.scalar(name) for name in ("value", "first", "second", "share", "speed", "limit", "scale")}
    yield Lemma("lemma_share", (number["value"], number["first"], number["second"]))
    yield Lemma("lemma_interpolation", (number["first"], number["second"], number["share"]))
    yield Lemma("lemma_cap", (number["value"], number["speed"], number["limit"]))
    yield Lemma("lemma_constants", linked=(build.own("calibration"),))
    limited = (build.argument("parameters", "limiter_parameters_t", "in"), number["speed"])
    yield Lemma("lemma_opposite_phase", limited, unit=build.own("limiter"))
    yield Lemma("lemma_magnitude", (number["value"],), unit=build.own("limiter"))
    bounds = (Argument(name, "int32_t") for name in ("low", "high", "not_available"))
    yield Lemma("lemma_code", (number["value"], number["scale"], *bounds), unit=build.own("can"))
    yield Lemma("lemma_crc", (Argument("byte", "uint32_t"),), unit=build.own("e2e"))
    if build.controller.search_strides:
        scheduled = (build.argument("parameters", "parameters_t", "in"), number["speed"])
        yield Lemma("lemma_gains", scheduled, unit=build.own("law"))
    yield Lemma("lemma_sound", (build.argument("self", "controller_t", "in"),), unit=build.own("controller"))

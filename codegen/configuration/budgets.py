"""The table `[budgets]` of `ars.toml`: what the generated code may take on a Cortex-M4F."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from codegen.configuration.controller import Kind
from codegen.configuration.section import Section
from codegen.configuration.signals import CARRIED

Count = Annotated[int, Field(ge=1, le=100_000_000)]

LOOKUP, SECOND_TABLE = 86, 60
"""Instructions of a lookup over even breakpoints, and what a table for the rear angle adds."""

SEARCH_ROUND, FRICTIONS, FRICTION, GRIP, GRIP_FRICTIONS = 10, 60, 10, 60, 30
"""Instructions that are added by a round of a search over uneven breakpoints, by tables for several frictions, by each of
those, by a table of what slip leaves of the cap, and by that for several frictions."""
CARS, RAW = 20, 15
"""Those of the steering that goes with a capped yaw rate, where the car lies between two frictions; and of what turns the raw
numbers of a table into values."""

GRIP_STACK = 48
"""Bytes of stack for a table of what slip leaves of the cap."""

CARRIED_BYTES = 4 * len(CARRIED)
"""Bytes of state for the signals that the controller only hands on."""

COMMON = {"limiter_instructions_max": 126, "task_stack_bytes_max": 250, "state_bytes_max": 144 + CARRIED_BYTES}
OF_KIND: Mapping[Kind, Mapping[str, int]] = {
    "pi": {"step_instructions_max": 690, "task_instructions_max": 1_650},
    "proportional": {"step_instructions_max": 690, "task_instructions_max": 1_650},
    "feedforward": {"step_instructions_max": 640 + SECOND_TABLE, "task_instructions_max": 1_590 + SECOND_TABLE},
    "tracking": {
        "step_instructions_max": 1_200,
        "task_instructions_max": 2_260,
        "task_stack_bytes_max": 312,
        "state_bytes_max": 188 + CARRIED_BYTES,
    },
}
"""For a map with even breakpoints and one friction."""
WITH_REAR_ANGLE: tuple[Kind, ...] = ("feedforward", "tracking")
"""Kinds whose step looks the rear angle up."""


@dataclass(frozen=True)
class MapShape:
    """What a lookup has to do.

    Attributes:
        search_rounds: of all axes together; an even one needs none.
        frictions: that the map is for.
        with_grip: whether there is a table of what slip leaves of the cap.
        is_raw: whether the tables hold raw numbers.
    """

    search_rounds: int = 0
    frictions: int = 1
    with_grip: bool = False
    is_raw: bool = False

    @property
    def instructions(self) -> int:
        """What that adds to a lookup."""
        stacked = FRICTIONS + FRICTION * self.frictions if self.frictions > 1 else 0
        grip = (GRIP + (GRIP_FRICTIONS if stacked else 0)) if self.with_grip else 0
        return SEARCH_ROUND * self.search_rounds + stacked + grip + (1 + self.with_grip) * self._raw

    @property
    def reference_instructions(self) -> int:
        """The same to one that gives the rear angle too."""
        return self.instructions + (CARS if self.frictions > 1 else 0) + self._raw

    @property
    def _raw(self) -> int:
        """Of one table, of which two layers are looked up where there are more."""
        return RAW * min(self.frictions, 2) if self.is_raw else 0


class Budgets(Section):
    """The most that each part may take; what is not given is what suits the kind of controller and the map.

    Instructions are of the longest call, with what it calls; those of a step without the limiter, which has its own. A
    reference is a lookup that gives the rear angle too. The task is one period: two frames received, the step, one frame sent.
    `state_bytes_max` is the memory of one controller; `flash_bytes_max`, code and constants of all objects together, has no
    default, because the breakpoints of the map decide.
    """

    lookup_instructions_max: Count | None = None
    reference_instructions_max: Count | None = None
    step_instructions_max: Count | None = None
    limiter_instructions_max: Count | None = None
    task_instructions_max: Count | None = None
    task_stack_bytes_max: Count | None = None
    state_bytes_max: Count | None = None
    flash_bytes_max: Count | None = None

    def resolved(self, kind: Kind, shape: MapShape) -> dict[str, int]:
        """Every budget that there is, by its key."""
        more = shape.reference_instructions if kind in WITH_REAR_ANGLE else shape.instructions
        found = {
            "lookup_instructions_max": LOOKUP + shape.instructions,
            "reference_instructions_max": LOOKUP + SECOND_TABLE + shape.reference_instructions,
            **COMMON,
            **OF_KIND[kind],
        }
        found["step_instructions_max"] += more
        found["task_instructions_max"] += more
        found["task_stack_bytes_max"] += GRIP_STACK if shape.with_grip else 0
        return found | {key: value for key, value in self.model_dump().items() if value is not None}

"""The table `[budgets]` of `ars.toml`: limits of the generated code on a Cortex-M4F."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from codegen.configuration.can import FRAME_BYTES
from codegen.configuration.controller import Kind
from codegen.configuration.section import Meaning, Section
from codegen.configuration.signals import CARRIED

Count = Annotated[int, Field(ge=1, le=100_000_000)]

LOOKUP, SECOND_TABLE = 86, 60
"""Instructions of a lookup over even breakpoints, and of a second table for the rear angle."""

SEARCH_ROUND, FRICTIONS, FRICTION, GRIP, GRIP_FRICTIONS = 10, 60, 10, 60, 30
"""Additional instructions, in this order: for each round of a search over uneven breakpoints, for tables of several layers,
for each of these layers, for a grip table, and for grip tables of several layers."""
CARS, RAW = 20, 15
"""Additional instructions for the rear angle of a capped yaw rate between two layers, and for a table of raw numbers."""

FRAME_BYTE = 16
"""Additional instructions of a period for each byte of a frame above the eight of classical CAN: three frames, and about five
instructions for a byte of each."""

GRIP_STACK = 48
"""Bytes of stack for a grip table."""

MOVING_STACK, MOVING_BYTES = 16, 8
"""Bytes of stack and of state for a longitudinal acceleration."""

CARRIED_BYTES = 4 * len(CARRIED)
"""Bytes of state for the signals that the controller only forwards."""

COMMON = {"limiter_instructions_max": 126, "task_stack_bytes_max": 250, "state_bytes_max": 160 + CARRIED_BYTES}
OF_KIND: Mapping[Kind, Mapping[str, int]] = {
    "pi": {"step_instructions_max": 750, "task_instructions_max": 1_890},
    "proportional": {"step_instructions_max": 750, "task_instructions_max": 1_890},
    "feedforward": {"step_instructions_max": 690 + SECOND_TABLE, "task_instructions_max": 1_850 + SECOND_TABLE},
    "tracking": {
        "step_instructions_max": 1_440,
        "task_instructions_max": 2_590,
        "task_stack_bytes_max": 312,
        "state_bytes_max": 220 + CARRIED_BYTES,
    },
}
"""Budgets of each kind for a map with even breakpoints and one friction."""
KEY_OF_FUNCTION: Mapping[str, str] = {
    "map_yaw_rate": "lookup_instructions_max",
    "map_yaw_rate_on_road": "lookup_instructions_max",
    "map_reference": "reference_instructions_max",
    "controller_step": "step_instructions_max",
    "limiter_step": "limiter_instructions_max",
    "cycle": "task_instructions_max",
}
"""Budget of the instructions of each function that has one; a cycle is one period of the task."""
WITH_REAR_ANGLE: tuple[Kind, ...] = ("feedforward", "tracking")
"""Kinds whose step looks up the rear angle."""


@dataclass(frozen=True)
class MapShape:
    """Properties of a map that decide the cost of its lookup.

    Attributes:
        search_rounds: rounds of the search over all axes; an even axis needs none.
        frictions: number of frictions or accelerations of the map.
        with_grip: whether there is a grip table.
        is_raw: whether the tables hold raw numbers.
        moving: whether the stack is over longitudinal acceleration.
    """

    search_rounds: int = 0
    frictions: int = 1
    with_grip: bool = False
    is_raw: bool = False
    moving: bool = False

    @property
    def instructions(self) -> int:
        """Additional instructions of a lookup."""
        stacked = FRICTIONS + FRICTION * self.frictions if self.frictions > 1 else 0
        grip = (GRIP + (GRIP_FRICTIONS if stacked else 0)) if self.with_grip else 0
        return SEARCH_ROUND * self.search_rounds + stacked + grip + (1 + self.with_grip) * self._raw

    @property
    def reference_instructions(self) -> int:
        """Additional instructions of a lookup that returns the rear angle too."""
        return self.instructions + (CARS if self.frictions > 1 else 0) + self._raw

    @property
    def _raw(self) -> int:
        """Instructions for the raw numbers of one table. With several layers, the lookup reads two of them."""
        return RAW * min(self.frictions, 2) if self.is_raw else 0


class Budgets(Section):
    """Limit of each part of the code. The defaults suit the kind of controller and the map.

    Instructions are those of the longest call, callees included. A step is counted without the limiter, which has its own
    limit. A reference is a lookup that returns the rear angle too. The task is one period: two frames received, a step, one
    frame sent. `state_bytes_max` is the memory of one controller. `flash_bytes_max` is the size of code and constants of all
    objects together; it has no default, because it depends on the breakpoints of the map.
    """

    lookup_instructions_max: Annotated[Count | None, Meaning("instructions of `ars_map_yaw_rate_on_road`")] = None
    reference_instructions_max: Annotated[
        Count | None, Meaning("instructions of `ars_map_reference`: a lookup with the rear angle")
    ] = None
    step_instructions_max: Annotated[Count | None, Meaning("instructions of `ars_controller_step`, without the limiter")] = None
    limiter_instructions_max: Annotated[Count | None, Meaning("instructions of `ars_limiter_step`")] = None
    task_instructions_max: Annotated[
        Count | None, Meaning("instructions of one period: two frames received, the step, one frame sent")
    ] = None
    task_stack_bytes_max: Annotated[Count | None, Meaning("largest stack of one period")] = None
    state_bytes_max: Annotated[Count | None, Meaning("memory of one controller")] = None
    flash_bytes_max: Annotated[Count | None, Meaning("code and constants of all objects together")] = None

    def resolved(self, kind: Kind, shape: MapShape, frame_bytes: int = FRAME_BYTES) -> dict[str, int]:
        """Return every budget by its key, for frames of a length."""
        more = shape.reference_instructions if kind in WITH_REAR_ANGLE else shape.instructions
        found = {
            "lookup_instructions_max": LOOKUP + shape.instructions,
            "reference_instructions_max": LOOKUP + SECOND_TABLE + shape.reference_instructions,
            **COMMON,
            **OF_KIND[kind],
        }
        found["step_instructions_max"] += more
        found["task_instructions_max"] += more + FRAME_BYTE * (frame_bytes - FRAME_BYTES)
        found["task_stack_bytes_max"] += (GRIP_STACK if shape.with_grip else 0) + (MOVING_STACK if shape.moving else 0)
        found["state_bytes_max"] += MOVING_BYTES if shape.moving else 0
        return found | {key: value for key, value in self.model_dump().items() if value is not None}

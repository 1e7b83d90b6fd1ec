"""What the functions of a build are called with to be counted: rows of inputs for each of them, made from drives.

A row of a step is a sample and, in its last field, whether the controller starts afresh with it. A row of the task is a cycle:
a sample, a restart, and what the bus does to the frame of each message.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from codegen.configuration import KM_H
from codegen.verify.budgets.counting import CONDITIONS, EVENT, FOREIGN, MOTION, START, TASK, Counter, Rows
from codegen.verify.drives import COLUMNS, Drive, Ground
from hil_sim.e2e import LARGEST_COUNTER

IntArray = npt.NDArray[np.int64]

PLACE_COLUMNS = ("speed", "front_angle", "friction")
STEP_COLUMNS = (*COLUMNS, "restart")
DEMAND_COLUMNS = ("speed", "front_angle", "demand", "restart")
CYCLE_COLUMNS = (*STEP_COLUMNS, "motion", "conditions")
RESULT_COLUMNS = ("rear_angle", "yaw_rate_reference", "status", "diagnostics")

STRANGE = np.array([np.nan, np.inf, -np.inf, 1e9, -1e9, 1e-40, -0.0], dtype=np.float32)
RESTARTS, EXTREMES = 0.02, 0.02
"""Share of the samples with which everything starts afresh, beside the first one of a drive; and of the numbers that are at the
very end of their range."""

CALM_HELD, CALM_LOST = 8, 0.05
"""Samples, some more than the command takes to arrive; and the share of them that are lost, after each of which the law starts
afresh."""

FRAME_BYTES = 8


class Fault(IntEnum):
    """What becomes of a frame, or comes beside it."""

    NONE = 0
    MISSING = 1
    WRONG_CRC = 2
    SAME_COUNTER = 3
    ONE_LOST = 4
    JUMP = 5
    COUNTER_15 = 6
    WRONG_LENGTH = 7
    TWICE = 8
    FOREIGN = 9


IRREGULAR = (Fault.TWICE, Fault.FOREIGN)
"""With these, more than one frame of each message comes in a cycle."""

ADVANCE = {Fault.SAME_COUNTER: 0, Fault.ONE_LOST: 2, Fault.JUMP: 6}
"""Of the counter to a frame, where it is not one."""

FAULTY = (0.0, 0.03, 0.1, 0.3, 0.6, 0.0)
"""Share of faulty frames, for each of the drawn drives and the calm one."""


def with_extremes(drives: Sequence[Drive], ground: Ground, generator: np.random.Generator) -> list[Drive]:
    """The drives with some numbers at either end of the range that the controller accepts, in its precision."""
    inputs = ground.config.controller.inputs
    angles = (inputs.front_angle_max_deg, inputs.yaw_rate_max_deg_s, inputs.rear_angle_max_deg)
    road = (inputs.friction_max, inputs.lateral_acceleration_max_m_s2)
    ends = np.array([inputs.speed_max_km_h * KM_H, *map(math.radians, angles), *road, 1.0], dtype=np.float32)
    found = []
    for drive in drives:
        sign = generator.choice(np.array([-1.0, 1.0], dtype=np.float32), drive.shape)
        unsigned = [COLUMNS.index(name) for name in ("friction", "inhibit")]
        sign[:, unsigned] = np.maximum(sign[:, unsigned], 0.0)
        found.append(np.where(generator.random(drive.shape) < EXTREMES, sign * ends, drive))
    return found


def calm(ground: Ground, samples: int, generator: np.random.Generator) -> Drive:
    """Samples held for a while in which the car turns nearly as it should, (samples, 7): what acts where no limit does, or the
    last of them alone, is reached with small errors only."""
    config = ground.config
    count = -(-samples // CALM_HELD)
    speed = generator.uniform(config.controller.enable_speed_km_h, config.controller.inputs.speed_max_km_h, count) * KM_H
    front_angle = config.steering.front_angle_stop * 10.0 ** generator.uniform(-3.0, 0.0, count)
    yaw_rate = speed * front_angle / config.vehicle.wheelbase
    yaw_rate = np.minimum(yaw_rate, config.limits.lateral_acceleration_max_g * config.road.gravity_m_s2 / speed)
    yaw_rate += generator.choice([-1.0, 1.0], count) * 10.0 ** generator.uniform(-3.0, 0.0, count)
    turn = generator.choice([-1.0, 1.0], count)
    rear_angle = generator.uniform(-1.0, 1.0, count) * config.rear_actuator.angle_max
    rear_angle = np.where(generator.random(count) < 0.5, np.nan, rear_angle)
    friction = np.where(
        generator.random(count) < 0.5, np.nan, generator.uniform(0.0, config.controller.inputs.friction_max, count)
    )
    lateral = np.where(generator.random(count) < 0.3, np.nan, turn * speed * yaw_rate)
    inhibit = generator.random(count) < 0.1
    drive = np.column_stack([speed, turn * front_angle, turn * yaw_rate, rear_angle, friction, lateral, inhibit])
    found = np.repeat(drive, CALM_HELD, axis=0)[:samples]
    found[generator.random(samples) < CALM_LOST, 0] = np.nan
    return found.astype(np.float32)


def places_of(drives: Sequence[Drive], generator: np.random.Generator, strange: float = 0.05) -> list[Rows]:
    """Where to look the map up, (n, 3): as in the drives, and now and then a number that is none."""
    return [_spoilt(drive[:, [COLUMNS.index(name) for name in PLACE_COLUMNS]], generator, strange) for drive in drives]


def steps_of(drives: Sequence[Drive], generator: np.random.Generator, restarts: float = RESTARTS) -> list[Rows]:
    """Steps of the controller, (n, 8)."""
    return [np.column_stack([drive, _restarts(len(drive), generator, restarts)]).astype(np.float32) for drive in drives]


def demands_of(
    drives: Sequence[Drive], ground: Ground, generator: np.random.Generator, strange: float = 0.02, restarts: float = RESTARTS
) -> list[Rows]:
    """Steps of the limiter alone, (n, 4): demands within twice the actuator's angle, not moving, and none at all."""
    found = []
    for drive in drives:
        demand = 2.0 * ground.config.rear_actuator.angle_max * generator.uniform(-1.0, 1.0, len(drive))
        demand = np.where(generator.random(len(drive)) < 0.3, 0.0, demand)
        rows = np.column_stack([drive[:, 0], drive[:, 1], demand])
        rows = np.column_stack([_spoilt(rows, generator, strange), _restarts(len(drive), generator, restarts)])
        found.append(rows.astype(np.float32))
    return found


def cycles_of(steps: Sequence[Rows], generator: np.random.Generator, faulty: Sequence[float] = FAULTY) -> list[Rows]:
    """Cycles of the task, (n, 10)."""
    return [
        np.column_stack([rows, _faults(len(rows), generator, share), _faults(len(rows), generator, share)]).astype(np.float32)
        for rows, share in zip(steps, faulty, strict=True)
    ]


def results_of(ground: Ground, count: int, generator: np.random.Generator) -> Rows:
    """Results to pack into the frame of the command, (n, 4): many of them lie just between two codes, or next to there."""
    message = ground.config.can.rear_steer_command
    columns = []
    for signal in (message.real("rear_angle"), message.real("yaw_rate_reference")):
        code = generator.integers(signal.raw_low - 2, signal.raw_high + 2, count) + generator.choice([-0.5, 0.0, 0.5], count)
        # Small codes, of which more lie exactly between two; and all of them.
        code = np.where(generator.random(count) < 0.5, np.fix(code / 256.0) + 0.5, code)
        value = (code * signal.factor + signal.offset).astype(np.float32)
        value = np.nextafter(value, generator.choice(np.array([-np.inf, 0.0, np.inf], dtype=np.float32), count))
        near = (code * signal.factor + signal.offset).astype(np.float32)
        columns.append(np.where(generator.random(count) < 0.5, near, value))
    rows = _spoilt(np.column_stack(columns), generator, 0.02)
    return np.column_stack([rows, generator.integers(0, 5, count), generator.integers(0, 2**16, count)]).astype(np.float32)


def _faults(count: int, generator: np.random.Generator, share: float) -> IntArray:
    faults = generator.integers(1, len(Fault), count)
    return np.where(generator.random(count) < share, faults, int(Fault.NONE))


def _restarts(count: int, generator: np.random.Generator, share: float) -> npt.NDArray[np.bool_]:
    found = generator.random(count) < share
    found[:1] = True
    return found


def _spoilt(rows: npt.NDArray[np.floating], generator: np.random.Generator, share: float) -> Rows:
    chosen = generator.random(rows.shape) < share
    return np.where(chosen, generator.choice(STRANGE, rows.shape), rows).astype(np.float32)


@dataclass(frozen=True)
class Events:
    """What a task meets.

    Attributes:
        events: (n,) of EVENT.
        row: (n,), the cycle that each belongs to.
        regular: (cycles,), whether at most one frame of each message came, and no other one.
    """

    events: npt.NDArray[np.void]
    row: IntArray
    regular: npt.NDArray[np.bool_]


def events_of(rows: Rows, counter: Counter) -> Events:
    """The events of cycles; the build itself packs and protects the frames."""
    count, faults = len(rows), rows[:, -2:].astype(np.int64)
    advance = np.ones_like(faults)
    for exception, by in ADVANCE.items():
        advance[faults == exception] = by
    counters = np.cumsum(advance, axis=0) % (LARGEST_COUNTER + 1)
    frames = counter.packed(np.column_stack([rows[:, : len(STEP_COLUMNS)], counters]).astype(np.float32))
    # In each cycle: a start, two frames of each message, one that is not ours, the task; taken are those that happen.
    events, happens = np.zeros((count, 7), dtype=EVENT), np.zeros((count, 7), dtype=bool)
    events["length"] = FRAME_BYTES
    for slot, kind in enumerate((START, MOTION, MOTION, CONDITIONS, CONDITIONS, FOREIGN, TASK)):
        events["kind"][:, slot] = kind
    happens[:, 0], happens[:, 6] = rows[:, len(STEP_COLUMNS) - 1] > 0.0, True
    for first, name, column in ((1, "motion", 0), (3, "conditions", 1)):
        fault = faults[:, column]
        data = frames[name].copy()
        data[fault == Fault.WRONG_CRC, 0] ^= 0x55
        data[fault == Fault.COUNTER_15, 1] |= 0x0F
        events["data"][:, first] = events["data"][:, first + 1] = data
        events["length"][fault == Fault.WRONG_LENGTH, first] = FRAME_BYTES - 1
        happens[:, first], happens[:, first + 1] = fault != Fault.MISSING, fault == Fault.TWICE
        happens[:, 5] |= fault == Fault.FOREIGN
    where = np.flatnonzero(happens.reshape(-1))
    irregular = np.isin(faults, IRREGULAR)
    return Events(events.reshape(-1)[where], where // 7, ~(irregular[:, 0] | irregular[:, 1]))

"""Inputs of the functions whose instructions are counted, made from drives.

A row of a step is a sample; its last field restarts the controller. A row of the task is a cycle: a sample, a restart, and the
bus fault of each message's frame.

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

from codegen.arrays import IntArray
from codegen.units import KM_H
from codegen.verify.budgets.counting import CONDITIONS, EVENT, FOREIGN, MOTION, START, TASK, Counter, Rows
from codegen.verify.drives import COLUMNS, Samples, Thresholds
from hil_sim.e2e import LARGEST_COUNTER

PLACE_COLUMNS = ("speed", "front_angle", "friction")
STEP_COLUMNS = (*COLUMNS, "restart")
DEMAND_COLUMNS = ("speed", "front_angle", "demand", "restart")
CYCLE_COLUMNS = (*STEP_COLUMNS, "motion", "conditions")
RESULT_COLUMNS = ("rear_angle", "yaw_rate_reference", "status", "diagnostics")

SPECIAL = np.array([np.nan, np.inf, -np.inf, 1e9, -1e9, 1e-40, -0.0], dtype=np.float32)
RESTARTS, EXTREMES = 0.02, 0.02
"""Fraction of the samples that restart the controller, besides the first of a drive; fraction of the numbers at an end of
their range."""

CALM_HELD, CALM_LOST = 8, 0.05
"""Samples for which a value is held, a few more than the command takes to arrive; fraction of samples that are lost, each
of which restarts the law."""

FRAME_BYTES = 8


class Fault(IntEnum):
    """Fault of a frame."""

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
"""Faults with more than one frame of a message in a cycle."""

ADVANCE = {Fault.SAME_COUNTER: 0, Fault.ONE_LOST: 2, Fault.JUMP: 6}
"""Increment of the counter for faults where it is not one."""

FAULTY = (0.0, 0.03, 0.1, 0.3, 0.6, 0.0)
"""Share of faulty frames, for each of the drawn drives and the calm one."""


def with_extremes(drives: Sequence[Samples], thresholds: Thresholds, generator: np.random.Generator) -> list[Samples]:
    """Replace some numbers by either end of the range that the controller accepts, in its precision."""
    inputs = thresholds.config.controller.inputs
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


def calm(thresholds: Thresholds, samples: int, generator: np.random.Generator) -> Samples:
    """Draw samples, (samples, 7), held for a while, in which the yaw rate is near the reference.

    Code that runs only when no limit acts, or only the last one, requires small errors.
    """
    config = thresholds.config
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


def places_of(drives: Sequence[Samples], generator: np.random.Generator, special_fraction: float = 0.05) -> list[Rows]:
    """Return inputs of the map lookup, (n, 3), from the drives; a fraction `special_fraction` of the numbers is special."""
    return [
        _with_special_numbers(drive[:, [COLUMNS.index(name) for name in PLACE_COLUMNS]], generator, special_fraction)
        for drive in drives
    ]


def steps_of(drives: Sequence[Samples], generator: np.random.Generator, restarts: float = RESTARTS) -> list[Rows]:
    """Return steps of the controller, (n, 8)."""
    return [np.column_stack([drive, _restarts(len(drive), generator, restarts)]).astype(np.float32) for drive in drives]


def demands_of(
    drives: Sequence[Samples],
    thresholds: Thresholds,
    generator: np.random.Generator,
    special_fraction: float = 0.02,
    restarts: float = RESTARTS,
) -> list[Rows]:
    """Return steps of the limiter alone, (n, 4): demands within twice the actuator's range, zero demands and special
    numbers."""
    found = []
    for drive in drives:
        demand = 2.0 * thresholds.config.rear_actuator.angle_max * generator.uniform(-1.0, 1.0, len(drive))
        demand = np.where(generator.random(len(drive)) < 0.3, 0.0, demand)
        rows = np.column_stack([drive[:, 0], drive[:, 1], demand])
        rows = np.column_stack(
            [_with_special_numbers(rows, generator, special_fraction), _restarts(len(drive), generator, restarts)]
        )
        found.append(rows.astype(np.float32))
    return found


def cycles_of(steps: Sequence[Rows], generator: np.random.Generator, faulty: Sequence[float] = FAULTY) -> list[Rows]:
    """Return cycles of the task, (n, 10)."""
    return [
        np.column_stack([rows, _faults(len(rows), generator, share), _faults(len(rows), generator, share)]).astype(np.float32)
        for rows, share in zip(steps, faulty, strict=True)
    ]


def results_of(thresholds: Thresholds, count: int, generator: np.random.Generator) -> Rows:
    """Return results to pack into the command frame, (n, 4). Many lie exactly between two codes or next to it."""
    message = thresholds.config.can.rear_steer_command
    columns = []
    for signal in (message.real("rear_angle"), message.real("yaw_rate_reference")):
        code = generator.integers(signal.raw_low - 2, signal.raw_high + 2, count) + generator.choice([-0.5, 0.0, 0.5], count)
        # Small codes, more of which lie exactly between two, and codes of the whole range.
        code = np.where(generator.random(count) < 0.5, np.fix(code / 256.0) + 0.5, code)
        value = (code * signal.factor + signal.offset).astype(np.float32)
        value = np.nextafter(value, generator.choice(np.array([-np.inf, 0.0, np.inf], dtype=np.float32), count))
        near = (code * signal.factor + signal.offset).astype(np.float32)
        columns.append(np.where(generator.random(count) < 0.5, near, value))
    rows = _with_special_numbers(np.column_stack(columns), generator, 0.02)
    return np.column_stack([rows, generator.integers(0, 5, count), generator.integers(0, 2**16, count)]).astype(np.float32)


def _faults(count: int, generator: np.random.Generator, share: float) -> IntArray:
    faults = generator.integers(1, len(Fault), count)
    return np.where(generator.random(count) < share, faults, int(Fault.NONE))


def _restarts(count: int, generator: np.random.Generator, share: float) -> npt.NDArray[np.bool_]:
    found = generator.random(count) < share
    found[:1] = True
    return found


def _with_special_numbers(rows: npt.NDArray[np.floating], generator: np.random.Generator, share: float) -> Rows:
    chosen = generator.random(rows.shape) < share
    return np.where(chosen, generator.choice(SPECIAL, rows.shape), rows).astype(np.float32)


@dataclass(frozen=True)
class Events:
    """Events of a task.

    Attributes:
        events: (n,) of EVENT.
        row: (n,), cycle of each event.
        regular: (cycles,), whether at most one frame of each message and no foreign frame came.
    """

    events: npt.NDArray[np.void]
    row: IntArray
    regular: npt.NDArray[np.bool_]


def events_of(rows: Rows, counter: Counter) -> Events:
    """Return the events of cycles. The build itself packs and protects the frames."""
    count, faults = len(rows), rows[:, -2:].astype(np.int64)
    advance = np.ones_like(faults)
    for exception, by in ADVANCE.items():
        advance[faults == exception] = by
    counters = np.cumsum(advance, axis=0) % (LARGEST_COUNTER + 1)
    frames = counter.packed(np.column_stack([rows[:, : len(STEP_COLUMNS)], counters]).astype(np.float32))
    # Slots of a cycle: a start, two frames of each message, a foreign frame, the task.
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


@dataclass(frozen=True)
class LongHistory:
    """A state that takes many calls to reach.

    Attributes:
        before: rows that lead to it and are not counted.
        then: rows that are counted.
    """

    before: Rows
    then: Rows


def _sample(thresholds: Thresholds, **changed: float) -> list[float]:
    config = thresholds.config
    speed = 0.5 * (config.controller.enable_speed_km_h + config.controller.inputs.speed_max_km_h) * KM_H
    # A turn so small that the same yaw rate in every sample does not count as frozen.
    values = {"speed": speed, "front_angle": 0.002, "yaw_rate": 0.0, "rear_angle": 0.0, "friction": math.nan}
    values |= {"lateral_acceleration": math.nan, "inhibit": 0.0}
    return [{**values, "restart": 0.0, **changed}[name] for name in STEP_COLUMNS]


def _rows(*pieces: tuple[int, list[float]]) -> Rows:
    return np.concatenate([np.tile(np.array(row, dtype=np.float32), (count, 1)) for count, row in pieces])


PREFIX_MAX = 200
"""Maximum samples of a history that is repeated for each sample after it."""


def histories(thresholds: Thresholds) -> tuple[Rows, ...]:
    """Return histories that lead to states in which a sample takes longer. Each begins with a restart."""
    fail_safe = thresholds.config.controller.fail_safe
    first, lost = (1, _sample(thresholds, restart=1.0)), _lost(thresholds)
    found = (
        _rows((1, _sample(thresholds, speed=0.0, restart=1.0))),
        _rows(first, (2, _sample(thresholds))),
        _rows(first, (1, lost)),
        _rows(first, (1, _wrong(thresholds))),
        _rows(first, (fail_safe.degraded_samples_max + 2, _sample(thresholds, front_angle=math.nan))),
        _rows(first, (fail_safe.degraded_samples_max + 2, lost), (fail_safe.recovery_samples - 1, _sample(thresholds))),
    )
    return tuple(rows for rows in found if len(rows) <= PREFIX_MAX)


def append_to_histories(histories: Sequence[Rows], rows: Rows) -> Rows:
    """Return each row and its mirror image, after each history and after a restart.

    Missing last fields of a history are zero.
    """
    restart, mirrored = len(STEP_COLUMNS) - 1, rows.copy()
    mirrored[:, [COLUMNS.index(name) for name in ("front_angle", "yaw_rate", "rear_angle")]] *= -1.0
    both = np.concatenate([rows, mirrored])
    started, goes_on = both.copy(), both.copy()
    started[:, restart], goes_on[:, restart] = 1.0, 0.0
    pieces = [started]
    for history in histories:
        padded = np.column_stack([history, np.zeros((len(history), rows.shape[1] - history.shape[1]), dtype=np.float32)])
        pieces += [np.concatenate([padded, row[np.newaxis]]) for row in goes_on]
    return np.concatenate(pieces)


def _lost(thresholds: Thresholds) -> list[float]:
    return _sample(thresholds, speed=math.nan, front_angle=math.nan, yaw_rate=math.nan)


def _wrong(thresholds: Thresholds) -> list[float]:
    """Return a sample with an implausible yaw rate."""
    return _sample(thresholds, yaw_rate=-math.radians(thresholds.config.controller.inputs.yaw_rate_tolerance_deg_s))


def long_histories(thresholds: Thresholds) -> tuple[LongHistory, ...]:
    """Return long histories of the controller: counters at their maximum, and recoveries after each kind of loss."""
    controller = thresholds.config.controller
    good, lost, wrong = _sample(thresholds), _lost(thresholds), _wrong(thresholds)
    recovery, patience = controller.fail_safe.recovery_samples, controller.fail_safe.degraded_samples_max + 2
    first = (1, _sample(thresholds, restart=1.0))
    return (
        LongHistory(_rows(first, (patience, lost)), _rows((3, lost))),
        LongHistory(_rows(first, (patience, wrong)), _rows((3, wrong), (2, good))),
        LongHistory(_rows(first, (patience, lost), (recovery - 1, good)), _rows((3, good))),
        LongHistory(_rows(first, (patience, lost), (max(recovery - 2, 1), good)), _rows((1, lost), (2, good))),
    )


def long_task_histories(thresholds: Thresholds) -> tuple[LongHistory, ...]:
    """Return long histories of the task: starts without or with an impossible rear angle, and frames after a silence."""
    recovery, inputs = thresholds.config.controller.fail_safe.recovery_samples, thresholds.config.controller.inputs
    e2e = thresholds.config.can.e2e
    proven = 1 + e2e.min_ok_state_init  # frames of each message until it is valid
    again = 1 + e2e.sync_counter_init + e2e.min_ok_state_invalid
    first, absent = _sample(thresholds, restart=1.0, rear_angle=math.nan), _sample(thresholds, rear_angle=math.nan)
    beyond = [_sample(thresholds, rear_angle=sign * 1.05 * math.radians(inputs.rear_angle_max_deg)) for sign in (1.0, -1.0)]
    start, usual = _sample(thresholds, restart=1.0), _sample(thresholds)
    silent = _cycles(Fault.MISSING, (e2e.max_no_new_or_repeated_data + 4, usual))
    return (
        LongHistory(_faultless((1, first), (proven + max(recovery - 3, 0), absent)), _faultless((4, absent))),
        LongHistory(_faultless((1, first), (proven, absent)), _faultless(*((2, row) for row in beyond), (2, usual))),
        LongHistory(np.concatenate([_faultless((1, start), (proven, usual)), silent]), _faultless((again + 1, usual))),
    )


def flooded() -> npt.NDArray[np.void]:
    """Return more frames of each message than the task's counter holds, without a call of the task."""
    events = np.zeros(2 * 2**8 + 4, dtype=EVENT)
    events["length"] = FRAME_BYTES
    events["kind"] = np.repeat([MOTION, CONDITIONS], len(events) // 2)
    return events


def _cycles(fault: Fault, *pieces: tuple[int, list[float]]) -> Rows:
    rows = _rows(*pieces)
    return np.column_stack([rows, np.full((len(rows), 2), float(fault), dtype=np.float32)])


def _faultless(*pieces: tuple[int, list[float]]) -> Rows:
    return _cycles(Fault.NONE, *pieces)

"""Inputs of the functions whose instructions are counted.

All of them derive from one array of steps: samples for the controller, with a restart in the last field. The recorded
scenarios come first, then drawn drives, and then drives directed into states in which a call takes long.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.arrays import IntArray
from codegen.configuration import Config
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack
from codegen.verify.budgets.counting import EVENT, FRAME_RECEIVED, START, TASK
from codegen.verify.drives import COLUMNS, Samples, Thresholds, drawn
from codegen.verify.traffic import Cycle
from hil_sim.codec import Codec, VehicleConditions, VehicleMotion
from hil_sim.e2e import next_counter, protect
from hil_sim.frames import Frame

Rows = npt.NDArray[np.float32]
"""Inputs of successive calls, (calls, fields)."""

PLACE_COLUMNS = ("speed", "front_angle", "friction")
STEP_COLUMNS = (*COLUMNS, "restart")
DEMAND_COLUMNS = ("speed", "front_angle", "demand", "restart")

SPECIAL = np.array([np.nan, np.inf, -np.inf, 1e9, -1e9, 1e-40, -0.0], dtype=np.float32)
SPECIAL_FRACTION = 0.03
"""Fraction of the numbers of drawn calls that are replaced by special ones."""

LIVES, CHANGES = (40, 12, 5), (0.1, 0.3, 0.4)
"""Samples between two restarts in a contradicting drive, and the probability that a signal changes its relation in one."""


@dataclass(frozen=True)
class Steps:
    """Steps of the controller.

    Attributes:
        rows: (n, 8) by STEP_COLUMNS.
        usual: number of rows at the start from which the means are taken.
    """

    rows: Rows
    usual: int


def steps_of(recorded: Sequence[Samples], thresholds: Thresholds, samples: int, generator: np.random.Generator) -> Steps:
    """Return all steps: recorded drives, drawn ones of `samples` each, and directed ones.

    Without recorded drives, the first drawn one is the usual one.
    """
    wide = drawn(thresholds, samples)
    usual = [_started(drive) for drive in recorded or wide[:1]]
    others = [*map(_started, wide), contradicting(thresholds.config, 3 * samples, generator), *histories(thresholds.config)]
    return Steps(np.concatenate([*usual, *others]), sum(map(len, usual)))


def _started(drive: Samples) -> Rows:
    """Return a drive that begins with a restart."""
    return np.column_stack([drive, np.arange(len(drive)) == 0]).astype(np.float32)


def contradicting(config: Config, samples: int, generator: np.random.Generator) -> Rows:
    """Draw turns, (samples, 8), in which each signal agrees with the turn, contradicts it or is lost, and changes at random.

    The input monitoring takes longest where a signal contradicts the others while another one is missing or returns.
    """
    inputs, agreement = config.controller.inputs, math.radians(config.controller.inputs.yaw_rate_agreement_deg_s)
    piece = -(-samples // len(LIVES))
    life, probability = (np.repeat(each, piece)[:samples] for each in (LIVES, CHANGES))
    starts = np.arange(samples) % piece % life == 0
    turn, count = np.cumsum(starts) - 1, int(starts.sum())
    speed = generator.uniform(config.controller.enable_speed_km_h, inputs.speed_max_km_h, count) * KM_H
    length = np.maximum(config.vehicle.wheelbase + SingleTrack.from_config(config).understeer_coefficient * speed**2, 1.0)
    yaw_rate = speed * config.steering.front_angle_stop * 10.0 ** generator.uniform(-3.0, 0.0, count) / length
    yaw_rate = np.minimum(yaw_rate, config.limits.lateral_acceleration_max_g * config.road.gravity_m_s2 / speed)
    yaw_rate *= generator.choice([-1.0, 1.0], count)
    v, r, angle = speed[turn], yaw_rate[turn], (yaw_rate * length / speed)[turn]
    noise = generator.choice([1e-3, -1e-3, 2e-3], samples)  # a constant yaw rate counts as frozen
    zero, lost, rear = np.zeros(samples), np.full(samples, np.nan), np.full(samples, config.rear_actuator.angle_max)
    choices = (  # the first is that of the turn
        (v, v, v + 0.4, v - 0.4, 1.6 * v, zero, lost),
        (angle, angle, angle + 0.02, angle - 0.02, -angle, zero, zero + 1e-6, zero - 1e-6, lost),
        (r + noise, r + noise, noise - r, noise + 0.5 * r, r + 2.2 * agreement, r - 2.2 * agreement, r + 2.0, lost),
        (zero, rear, -rear, 0.5 * rear, -0.5 * rear, 1.5 * rear, lost),
        (lost, lost, zero, zero + 0.3, zero + 0.8, zero + inputs.friction_max),
        (v * r, v * r, -v * r, v * (r + 2.5 * agreement), v * (r - 1.5 * agreement), zero, lost),
        (zero, zero, zero, zero + 1.0),
    )
    columns = []
    for values in choices:
        changed = np.where(starts | (generator.random(samples) < probability), np.arange(samples), 0)
        picked = np.where(starts, 0, generator.integers(len(values), size=samples))
        columns.append(np.choose(picked[np.maximum.accumulate(changed)], values))
    return np.column_stack([*columns, starts]).astype(np.float32)


def histories(config: Config) -> list[Rows]:
    """Return histories that end where a counter is at its limit, or where a loss has lasted long."""
    inputs, fail_safe, e2e = config.controller.inputs, config.controller.fail_safe, config.can.e2e
    speed = 0.5 * (config.controller.enable_speed_km_h + inputs.speed_max_km_h) * KM_H
    # A turn so small that the same yaw rate in every sample does not count as frozen.
    usual = {"speed": speed, "front_angle": 0.002, "yaw_rate": 0.0, "rear_angle": 0.0, "friction": math.nan}
    usual |= {"lateral_acceleration": math.nan, "inhibit": 0.0, "restart": 0.0}

    def held(samples: int, **changed: float) -> Rows:
        row = {**usual, **changed}
        return np.tile(np.array([row[name] for name in STEP_COLUMNS], dtype=np.float32), (samples, 1))

    def lost(samples: int) -> Rows:
        return held(samples, speed=math.nan, front_angle=math.nan, yaw_rate=math.nan)

    def wrong(samples: int) -> Rows:
        return held(samples, yaw_rate=-math.radians(inputs.yaw_rate_tolerance_deg_s))

    # Longer than the task waits for messages and for a rear angle.
    patience, recovery = fail_safe.degraded_samples_max + 2, fail_safe.recovery_samples
    waits = 1 + e2e.min_ok_state_init + recovery
    beyond = 1.05 * math.radians(inputs.rear_angle_max_deg)
    start, absent = held(1, restart=1.0), {"rear_angle": math.nan}
    return [
        np.concatenate(parts)
        for parts in (
            (start, lost(patience + 3)),
            (start, wrong(patience + 3), held(2)),
            (start, lost(patience), held(recovery + 2)),
            (start, lost(patience), held(max(recovery - 2, 1)), lost(1), held(2)),
            (held(1, restart=1.0, **absent), held(waits + 2, **absent)),
            (held(1, restart=1.0, **absent), held(waits - recovery, **absent), held(2, rear_angle=beyond), held(2)),
            (held(1, restart=1.0, speed=0.0), held(2)),
        )
    ]


def places_of(steps: Steps, generator: np.random.Generator) -> Rows:
    """Return inputs of the map lookup, (n, 3)."""
    columns = [COLUMNS.index(name) for name in PLACE_COLUMNS]
    return _with_special_numbers(steps.rows[:, columns], steps.usual, generator)


def demands_of(steps: Steps, config: Config, generator: np.random.Generator) -> Rows:
    """Return steps of the limiter alone, (n, 4), with demands within twice the actuator's range."""
    demand = 2.0 * config.rear_actuator.angle_max * generator.uniform(-1.0, 1.0, len(steps.rows))
    demand[generator.random(len(demand)) < 0.3] = 0.0
    inputs = _with_special_numbers(np.column_stack([steps.rows[:, :2], demand]), steps.usual, generator)
    return np.column_stack([inputs, steps.rows[:, -1]])


def results_of(config: Config, count: int, generator: np.random.Generator) -> Rows:
    """Return results to pack into the command frame, (n, 4). Packing takes longest exactly between two codes."""
    message, columns = config.can.rear_steer_command, []
    for signal in (message.real("rear_angle"), message.real("yaw_rate_reference")):
        code = generator.integers(signal.raw_low - 2, signal.raw_high + 2, count) + generator.choice([-0.5, 0.0, 0.5], count)
        # Small codes too, because more of them lie exactly between two.
        code = np.where(generator.random(count) < 0.5, np.fix(code / 256.0) + 0.5, code)
        columns.append(code * signal.factor + signal.offset)
    rows = _with_special_numbers(np.column_stack(columns), 0, generator)
    return np.column_stack([rows, generator.integers(0, 5, count), generator.integers(0, 2**16, count)]).astype(np.float32)


def _with_special_numbers(rows: npt.NDArray[np.floating], usual: int, generator: np.random.Generator) -> Rows:
    """Replace some numbers, except in the usual rows at the start."""
    chosen = generator.random(rows.shape) < SPECIAL_FRACTION
    chosen[:usual] = False
    return np.where(chosen, generator.choice(SPECIAL, rows.shape), rows).astype(np.float32)


def cycles_of(config: Config, rows: Rows) -> list[Cycle]:
    """Return the protected frames of each step."""
    can, codec, counter, found = config.can, Codec(config.can), 0, []
    for row in rows.tolist():
        sample = dict(zip(STEP_COLUMNS, row, strict=True))
        motion = VehicleMotion(sample["speed"], sample["front_angle"], sample["yaw_rate"])
        conditions = VehicleConditions(
            sample["rear_angle"], sample["friction"], sample["lateral_acceleration"], sample["inhibit"] > 0.0
        )
        sent = ((can.vehicle_motion, motion), (can.vehicle_conditions, conditions))
        found.append(tuple(Frame(each.id, protect(each.e2e_data_id, counter, codec.encode(payload))) for each, payload in sent))
        counter = next_counter(counter)
    return found


@dataclass(frozen=True)
class Events:
    """Events of a task.

    Attributes:
        events: (n,) of EVENT.
        cycle: (n,), index of the cycle of each event.
        regular: (cycles,), whether at most one frame of each message and no foreign frame came.
    """

    events: npt.NDArray[np.void]
    cycle: IntArray
    regular: npt.NDArray[np.bool_]


def events_of(config: Config, cycles: Sequence[Cycle], restarts: Sequence[int]) -> Events:
    """Return the events of cycles; the task is initialised before some of them."""
    received, before = {config.can.vehicle_motion.id, config.can.vehicle_conditions.id}, set(restarts)
    events, places, regular = [], [], []
    for index, frames in enumerate(cycles):
        found = [(START, 0, 0, b"")] if index in before else []
        found += [(FRAME_RECEIVED, each.id, len(each.data), each.data) for each in frames]
        events += [*found, (TASK, 0, 0, b"")]
        places += [index] * (len(found) + 1)
        ids = {each.id for each in frames}
        regular.append(ids <= received and len(ids) == len(frames))
    return Events(np.array(events, dtype=EVENT), np.array(places), np.array(regular))

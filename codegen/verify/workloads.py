"""Inputs of the functions whose instructions are counted.

All of them derive from one array of steps: samples for the controller, with a restart in the last field. The recorded
scenarios come first, then drawn drives, and then drives directed into states in which a call takes long.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np
import numpy.typing as npt

from codegen.arrays import IntArray
from codegen.configuration import Config
from codegen.units import KM_H
from codegen.verify.drives import DRIVE_COLUMNS, Samples, Thresholds, drawn, measurements_of
from codegen.verify.traffic import Cycle, frames_of
from hil_sim.codec import Codec
from hil_sim.e2e import next_counter

Rows = npt.NDArray[np.float32]
"""Inputs of successive calls, (calls, fields)."""

PLACE_COLUMNS = ("speed", "front_angle", "friction")
STEP_COLUMNS = (*DRIVE_COLUMNS, "restart")
DEMAND_COLUMNS = ("speed", "front_angle", "demand", "restart")

START, TASK, RECEIVED = range(3)
"""Kinds of events, as in `templates/verify/budget.c.j2`."""

Parts = tuple[tuple[int, Mapping[str, float]], ...]
"""Parts of a drive: numbers of samples, and the values that differ from the usual ones in them."""

SPECIAL = np.array([np.nan, np.inf, -np.inf, 1e9, -1e9, 1e-40, -0.0], dtype=np.float32)
SPECIAL_FRACTION = 0.03
"""Fraction of the numbers of drawn calls that are replaced by special ones."""


def steps_of(recorded: Sequence[Samples], thresholds: Thresholds, samples: int) -> tuple[Rows, int]:
    """Return all steps, (n, 8) by STEP_COLUMNS, and the number of usual ones at their start.

    The usual ones are the recorded drives, or without these the first drawn one. `samples` is the length of a drawn drive.
    """
    wide = drawn(thresholds, samples)
    usual = recorded or wide[:1]
    drives = [np.column_stack([drive, np.arange(len(drive)) == 0]) for drive in (*usual, *wide)]
    return np.concatenate([*drives, *histories(thresholds.config)]).astype(np.float32), sum(map(len, usual))


def histories(config: Config) -> Iterator[Rows]:
    """Yield drives into the states in which a step takes long, each from a restart.

    They bring counters to their limits and make losses last long. In others, the lateral acceleration first agrees with the yaw
    rate and then contradicts it, which the input monitoring checks most thoroughly, while another signal is missing or returns.
    """
    inputs, fail_safe, e2e = config.controller.inputs, config.controller.fail_safe, config.can.e2e
    wrong = -math.radians(inputs.yaw_rate_tolerance_deg_s)
    beyond = 1.05 * math.radians(config.rear_angle_valid_max_deg)
    speed = 0.5 * (config.controller.feedback_speeds_km_h[1] + inputs.speed_max_km_h) * KM_H
    # Longer than the task waits for messages and for a rear angle.
    patience, recovery, messages = fail_safe.degraded_samples_max + 2, fail_safe.recovery_samples, 2 + e2e.min_ok_state_init
    start, lost, absent = {"restart": 1.0}, dict.fromkeys(DRIVE_COLUMNS[:3], math.nan), {"rear_angle": math.nan}
    drives: tuple[Parts, ...] = (
        ((1, start), (patience + 3, lost)),
        ((1, start), (patience + 3, {"yaw_rate": wrong}), (2, {})),
        ((1, start), (patience, lost), (recovery + 2, {})),
        ((1, start), (patience, lost), (max(recovery - 2, 1), {}), (1, lost), (2, {})),
        ((1, start | absent), (messages + recovery + 2, absent)),
        ((1, start | absent), (messages, absent), (2, {"rear_angle": beyond}), (2, {})),
        ((1, start | {"speed": 0.0}), (2, {})),
    )
    yield from (_rows({"speed": speed}, parts) for parts in drives)
    # A lateral acceleration of the other side, on a car that turns far more, after two lost samples.
    apart = {
        "speed": 10.0,
        "front_angle": 0.13,
        "yaw_rate": -0.7,
        "rear_angle": math.nan,
        "friction": 0.9 * inputs.friction_max,
    }
    losses: Parts = ((1, start), (6, {}), (1, {"speed": math.nan}), (1, {}), (1, {"yaw_rate": math.nan}), (2, {}))
    yield _rows(apart | {"lateral_acceleration": -0.5}, losses)
    # Straight ahead the offsets are learned up to their bounds, here of an acceleration that contradicts the yaw rate.
    straight = {"speed": 6.0, "front_angle": 0.0005, "yaw_rate": 0.005, "rear_angle": math.nan}
    straight["lateral_acceleration"] = 1.5 * inputs.lateral_acceleration_offset_max_m_s2
    yield _rows(straight, ((1, start), (60, {})))
    acceleration = config.limits.lateral_acceleration_max_g * config.road.gravity_m_s2
    angle_max = config.rear_actuator.angle_max
    for share, side in product((0.6, 0.29, 0.17), (1.0, -1.0)):
        speed = share * inputs.speed_max_km_h * KM_H
        yaw_rate = 0.5 * side * acceleration / speed
        turn = {"speed": speed, "front_angle": -0.02, "yaw_rate": yaw_rate, "friction": 0.0}
        turn["lateral_acceleration"] = yaw_rate * speed
        for rear_angle in (angle_max, math.nan):
            # Close enough not to count as a jump.
            against = {"lateral_acceleration": yaw_rate * speed - 1.9 * side, "rear_angle": rear_angle, "friction": math.nan}
            proof: Parts = ((1, start), (3, {}), (3, against))
            for name in DRIVE_COLUMNS[:3]:
                proof = (*proof, (1, against | {name: math.nan}), (3, against))
            yield _rows(turn, proof)
        steered = {"front_angle": 0.6 * side * config.steering.front_angle_stop, "rear_angle": 0.9 * side * angle_max}
        yield _rows(turn, ((1, start), (1, steered | lost), (2, steered | {"yaw_rate": 2.0 * yaw_rate})))
    yield _rows(turn, (*proof, (patience, against | lost), (recovery + 2, against)))  # the law starts again in such a turn


def _rows(usual: Mapping[str, float], parts: Parts) -> Rows:
    """Return the samples of parts. In a turn the yaw rate changes with each sample, because a constant one counts as frozen."""
    values = {"front_angle": 0.002, "yaw_rate": 0.0, "rear_angle": 0.0, "friction": math.nan, "lateral_acceleration": math.nan}
    values |= {"inhibit": 0.0, "restart": 0.0, **usual}
    rows = [[{**values, **changed}[name] for name in STEP_COLUMNS] for count, changed in parts for _ in range(count)]
    found = np.array(rows, dtype=np.float32)
    if usual.get("yaw_rate"):
        found[:, STEP_COLUMNS.index("yaw_rate")] += np.resize([1e-3, -1e-3, 2e-3], len(rows))
    return found


def places_of(steps: Rows, usual: int, generator: np.random.Generator) -> Rows:
    """Return inputs of the map lookup, (n, 3)."""
    return _with_special_numbers(steps[:, [DRIVE_COLUMNS.index(name) for name in PLACE_COLUMNS]], usual, generator)


def demands_of(steps: Rows, usual: int, config: Config, generator: np.random.Generator) -> Rows:
    """Return steps of the limiter alone, (n, 4), with demands within twice the actuator's range."""
    demand = 2.0 * config.rear_actuator.angle_max * generator.uniform(-1.0, 1.0, len(steps))
    demand[generator.random(len(demand)) < 0.3] = 0.0
    inputs = _with_special_numbers(np.column_stack([steps[:, :2], demand]), usual, generator)
    return np.column_stack([inputs, steps[:, -1]])


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


def cycles_of(config: Config, steps: Rows) -> list[Cycle]:
    """Return the protected frames of each step. After a step without speed, a frame is missing too."""
    can, codec, counter, found = config.can, Codec(config.can), 0, []
    profile = can.e2e.definition
    for sample in measurements_of(steps[:, : len(DRIVE_COLUMNS)]):
        found.append(frames_of(can, codec, counter, sample))
        lost = math.isnan(sample.speed)
        counter = next_counter(next_counter(counter, profile) if lost else counter, profile)
    return found


def events_of(cycles: Sequence[Cycle], restarts: Sequence[int], frame_bytes: int) -> tuple[npt.NDArray[np.void], IntArray]:
    """Return the events of cycles, as `event_t` of the C, and the index of the cycle of each. The task restarts before some."""
    before, events, places = set(restarts), [], []
    for index, frames in enumerate(cycles):
        found = [(START, 0, 0, b"")] if index in before else []
        found += [(RECEIVED, each.id, len(each.data), each.data) for each in frames]
        events += [*found, (TASK, 0, 0, b"")]
        places += [index] * (len(found) + 1)
    kind = np.dtype([("kind", "<u4"), ("id", "<u4"), ("length", "<u4"), ("data", f"S{frame_bytes}")])
    return np.array(events, dtype=kind), np.array(places)

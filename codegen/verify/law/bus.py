"""A course as frames on the bus: with starts of each kind, gaps in either message, and a car that measures its rear angle."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from codegen.configuration import Config
from codegen.emit.text import Precision
from codegen.sil.software import Measurement
from codegen.verify.drives import gaps_of
from codegen.verify.traffic import Cycle
from hil_sim.codec import Codec, VehicleConditions, VehicleMotion
from hil_sim.e2e import next_counter, protect
from hil_sim.frames import Frame

LIFE = 150
"""Cycles between two starts of the task."""
GAP = (0.02, 0.05)
"""Probability that a gap of one message begins with a cycle, and that it ends with one: long enough for the fail-safe."""


def starts(count: int) -> list[int]:
    """Cycles before which the task starts anew."""
    return list(range(0, count, LIFE))


def cycles_of(config: Config, precision: Precision, samples: Sequence[Measurement], seed: int) -> list[Cycle]:
    """The frames of each sample, protected.

    After a start the rear angle is told at once, or not at all for longer than the task waits, or is one that cannot be. Then
    it moves slowly, and is not told where the sample has one: courses seldom do.
    """
    can, codec = config.can, Codec(config.can, precision)
    generator = np.random.default_rng(seed)
    largest = config.rear_actuator.angle_max
    impossible = 1.1 * math.radians(config.controller.inputs.rear_angle_max_deg)
    waits = can.e2e.min_ok_state_init + config.controller.fail_safe.recovery_samples + 1
    gaps = [gaps_of(len(samples), GAP, generator) for _ in range(2)]
    found, counter = [], 0
    for number, sample in enumerate(samples):
        life, age = divmod(number, LIFE)
        angle = 0.5 * largest * math.cos(0.05 * number + life)
        if age <= waits:
            angle = (angle, math.nan, impossible)[life % 3]
        elif math.isfinite(sample.rear_angle):
            angle = math.nan
        motion = VehicleMotion(sample.speed, sample.front_angle, sample.yaw_rate)
        conditions = VehicleConditions(angle, sample.friction, sample.lateral_acceleration, sample.inhibit)
        sent = ((can.vehicle_motion, motion), (can.vehicle_conditions, conditions))
        frames = (Frame(message.id, protect(message.e2e_data_id, counter, codec.encode(told))) for message, told in sent)
        found.append(tuple(frame for frame, gap in zip(frames, gaps, strict=True) if not gap[number] or age <= waits))
        counter = next_counter(counter)
    return found

"""Drive cycle through every regime of a controller, as samples and as frames on the bus."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from codegen.configuration import Config
from codegen.emit.text import Precision
from codegen.sil.software import Measurement
from codegen.verify.drives import NUMBER_ROLES, gaps_of
from codegen.verify.traffic import Cycle, frames_of
from hil_sim.codec import Codec
from hil_sim.e2e import next_counter


def drive(
    rng: np.random.Generator,
    count: int,
    lookup: Callable[..., Any],
    wheelbase: float,
    accelerations: Sequence[float] = (),
    *,
    speed_amplitude: float = 16.0,
    steering_samples: float = 330.0,
) -> list[Measurement]:
    """Return `count` samples through every regime: fast, slow, reverse; faults, gaps and implausible periods of any length.

    The yaw rate mostly lies near the reference, so that the integrator is not always at a limit. The speed (m/s) swings by
    `speed_amplitude` around 14, the steering once in `steering_samples`.

    Args:
        lookup: yaw rate of the map in rad/s, from speeds in m/s and front angles in rad.
        accelerations: longitudinal accelerations of the map's layers, m/s^2.
    """

    def spells(probability: float, longest: int) -> Any:
        active = np.zeros(count, dtype=bool)
        for start in np.flatnonzero(rng.random(count) < probability):
            active[start : start + rng.integers(1, longest + 1)] = True
        return active

    t = np.arange(count)
    speed = 14.0 + speed_amplitude * np.sin(2.0 * np.pi * t / 900.0 + rng.uniform(0.0, 6.0)) + rng.normal(0.0, 0.05, count)
    steered = np.minimum(t, round(0.93 * count))  # the front angle freezes at the end
    front = 0.12 * np.sin(2.0 * np.pi * steered / steering_samples + rng.uniform(0.0, 6.0))
    slow_error = 0.12 * np.sin(2.0 * np.pi * t / 170.0)
    yaw = lookup(speed, front) + slow_error + rng.normal(0.0, 0.01, count)
    yaw = np.where(spells(0.004, 50), (speed * front) / wheelbase + 2.2, yaw)
    rear = np.where(spells(0.01, 100), 0.03 * np.sin(2.0 * np.pi * t / 240.0), math.nan)
    friction = np.where(spells(0.01, 60), rng.choice([0.0, 0.05, 0.3, 0.6, 0.9, 1.2], count), math.nan)
    lateral = np.where(spells(0.01, 300), speed * (yaw + rng.normal(0.0, 0.005, count)), math.nan)
    inhibit = spells(0.01, 20)
    moving = []
    if len(accelerations) > 1:
        swing = 0.7 * np.ptp(accelerations) * np.sin(2.0 * np.pi * t / 210.0)
        moving = [np.where(spells(0.005, 200), math.nan, swing)]
    fields = np.stack([speed, front, yaw, rear, friction, lateral, *moving])
    nonsense = np.array([math.nan, math.inf, -math.inf, 1e9, -1e9])
    for column in np.flatnonzero(spells(0.006, 6)):
        fields[rng.integers(len(fields)), column] = rng.choice(nonsense)
    fields[:3, spells(0.006, 20)] = math.nan
    rows = zip(fields.T.tolist(), inhibit.tolist(), strict=True)
    return [Measurement(**dict(zip(NUMBER_ROLES, row, strict=False)), inhibit=inhibited) for row, inhibited in rows]


LIFE = 150
"""Cycles between two starts of the task."""
GAP = (0.02, 0.05)
"""Probability that a gap of one message begins with a cycle, and that it ends with one: long enough for the fail-safe."""


def cycles_of(config: Config, precision: Precision, samples: Sequence[Measurement], seed: int) -> list[Cycle]:
    """Return the protected frames of each sample.

    After a restart the rear angle is valid at once, missing for longer than the task waits, or impossible. Then it moves
    slowly, and is missing where the sample has one.
    """
    can, codec = config.can, Codec(config.can, precision)
    generator = np.random.default_rng(seed)
    largest = config.rear_actuator.angle_max
    impossible = 1.1 * math.radians(config.rear_angle_valid_max_deg)
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
        frames = frames_of(can, codec, counter, replace(sample, rear_angle=angle))
        found.append(tuple(frame for frame, gap in zip(frames, gaps, strict=True) if not gap[number] or age <= waits))
        counter = next_counter(counter, can.e2e.definition)
    return found

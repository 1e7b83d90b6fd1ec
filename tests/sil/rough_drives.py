"""Drives in which nothing is smooth, with the answers of the second implementation of the law."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from codegen.sil.software import Measurement
from tests.builds import Built
from tests.sil.answers import Drive, answers_of
from tests.sil.checks_kinds import config_of, open_limiter


def rough(built: Built, seed: int, count: int = 3000) -> list[Measurement]:
    """Nothing is smooth: speeds at the breakpoints and beyond them, straight ahead to the bit, yaw rates of either sign and
    none, errors that turn from sample to sample, an actuator anywhere; all of it plausible."""
    rng, config = np.random.default_rng(seed), config_of(built)
    schedule = config.controller.tracking.schedule
    points = [speed / 3.6 for speed in (schedule.speed_km_h if schedule else (20.0, 60.0, 120.0))]
    speeds = np.array([*points, *points, 5.0, 9.0, 17.0, 28.0, 60.0, 95.0, 105.0, 111.0, 111.111115])

    def spells(values: Any, longest: int) -> Any:
        lengths = rng.integers(1, longest + 1, count)
        return np.repeat(values, lengths)[:count]

    speed = spells(rng.choice(speeds[speeds > 4.2], count), 25)
    # Turns of any size: up to a wheel angle that no fast car takes, and up to what the road bears.
    wide = rng.choice([0.0, 1.0, -1.0, 0.3, -0.1], count) * rng.uniform(0.0, 0.12, count)
    front = spells(np.where(rng.random(count) < 0.5, wide, wide * 40.0 / speed**2), 12)
    turn = built.lookup(speed.astype(built.real), front.astype(built.real), math.nan).astype(np.float64)
    share = spells(rng.choice([0.0, 1.0, 0.9, 0.5, -0.3, 1.3], count), 6)
    yaw_rate = turn * share + spells(rng.choice([0.0, 0.0, 0.05, -0.05, 0.3, -0.3], count), 4)
    rear = np.where(spells(rng.random(count) < 0.4, 20), spells(rng.uniform(-0.07, 0.07, count), 8), math.nan)
    friction = spells(rng.choice([math.nan] * 6 + [0.9, 0.5, 0.1, 0.05, 0.0], count), 40)
    inhibit = spells(rng.random(count) < 0.15, 5)
    columns = [np.asarray(column, dtype=np.float64).tolist() for column in (speed, front, yaw_rate, rear, friction)]
    samples = [Measurement(*row) for row in zip(*columns, strict=True)]
    return [replace(sample, inhibit=bool(held)) for sample, held in zip(samples, inhibit, strict=True)]


def rough_changes(built: Built) -> dict[str, dict[str, Any]]:
    """Parameters that leave the law to itself, and others that hem it in."""
    free = {"rear_rate_max": 1000.0, "limiter": open_limiter(built), "yaw_rate_tolerance": 20.0}
    if config_of(built).controller.kind != "tracking":
        return {
            "free": free,
            "strong": {**free, "proportional_gain": 0.3, "integral_gain": 20.0},
            "slow": {"rear_rate_max": 0.1, "rear_angle_error_max": 1.0},
            # The distance to the actuator and the rate now and then give back just what was wanted: limited all the same.
            "slow, and measured": {"rear_rate_max": 0.1, "rear_angle_error_max": 0.097},
        }
    points = len(list(built.software.parameters().schedule_speed))
    rng = np.random.default_rng(8)
    gains = ("proportional_gain", 0.3), ("integral_gain", 30.0)
    odd = {name: rng.uniform(0.0, most, points).tolist() for name, most in gains}
    sensitive = {"grip_shortfall": 0.1, "grip_loss_rate": 50.0, "grip_forgetting": 20.0, "friction_min": 0.01}
    return {
        "free": free,
        "odd gains": {**free, **odd},
        "beyond the schedule": {**free, **odd, "speed_max": 200.0, "schedule_speed": [1.0 + 5.0 * k for k in range(points)]},
        "no authority": {**free, **odd, "yaw_increasing_max": 0.0},
        "wide authority": {**free, **odd, "yaw_increasing_max": 0.04, "rear_angle_error_max": 0.01},
        "sensitive": {**free, **odd, **sensitive},
        "slow": {**odd, "rear_rate_max": 0.1, "limiter": {"rear_rate_max": 0.08}},
        "tight": {**free, **odd, "rear_angle_error_max": 0.002, "trim_share": 0.2, "trim_rate": 20.0},
    }


def answers_of_rough(built: Built, count: int = 3000) -> Iterator[Drive]:
    """The independent model's answers to rough drives, each when it is asked for: one takes seconds."""
    for seed, one in enumerate(rough_changes(built).values()):
        yield answers_of(built, one, rough(built, seed, count))

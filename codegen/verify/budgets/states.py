"""States of the controller and of the task that no draw of samples reaches, or hardly ever: made on purpose, row by row."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.configuration import KM_H
from codegen.verify.budgets.counting import CONDITIONS, EVENT, MOTION, Rows
from codegen.verify.budgets.workloads import FRAME_BYTES, STEP_COLUMNS, Fault
from codegen.verify.drives import COLUMNS, Ground


@dataclass(frozen=True)
class LongWay:
    """A state that only many calls lead to: rows that are not counted, and those behind them that are."""

    before: Rows
    then: Rows


def _sample(ground: Ground, **changed: float) -> list[float]:
    config = ground.config
    speed = 0.5 * (config.controller.enable_speed_km_h + config.controller.inputs.speed_max_km_h) * KM_H
    # A turn so small that the same yaw rate in every sample does not count as frozen.
    values = {"speed": speed, "front_angle": 0.002, "yaw_rate": 0.0, "rear_angle": 0.0, "friction": math.nan}
    values |= {"lateral_acceleration": math.nan, "inhibit": 0.0}
    return [{**values, "restart": 0.0, **changed}[name] for name in STEP_COLUMNS]


def _rows(*pieces: tuple[int, list[float]]) -> Rows:
    return np.concatenate([np.tile(np.array(row, dtype=np.float32), (count, 1)) for count, row in pieces])


PREFIX_MAX = 200
"""Samples: of a history that is made anew for each sample behind it."""


def histories(ground: Ground) -> tuple[Rows, ...]:
    """States of the controller in which a sample makes it do more than otherwise: each with a start in front."""
    fail_safe = ground.config.controller.fail_safe
    first, lost = (1, _sample(ground, restart=1.0)), _lost(ground)
    found = (
        _rows((1, _sample(ground, speed=0.0, restart=1.0))),
        _rows(first, (2, _sample(ground))),
        _rows(first, (1, lost)),
        _rows(first, (1, _wrong(ground))),
        _rows(first, (fail_safe.degraded_samples_max + 2, _sample(ground, front_angle=math.nan))),
        _rows(first, (fail_safe.degraded_samples_max + 2, lost), (fail_safe.recovery_samples - 1, _sample(ground))),
    )
    return tuple(rows for rows in found if len(rows) <= PREFIX_MAX)


def behind(histories: Sequence[Rows], rows: Rows) -> Rows:
    """Each row and its mirror image behind each history, and with a start of its own.

    Histories may lack the last fields of the rows, which are zero then.
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


def _lost(ground: Ground) -> list[float]:
    return _sample(ground, speed=math.nan, front_angle=math.nan, yaw_rate=math.nan)


def _wrong(ground: Ground) -> list[float]:
    """A yaw rate against the turn, of which no car has so much in a sample."""
    return _sample(ground, yaw_rate=-math.radians(ground.config.controller.inputs.yaw_rate_tolerance_deg_s))


def long_ways(ground: Ground) -> tuple[LongWay, ...]:
    """Of the controller: counts at their largest, and a recovery after each kind of loss."""
    controller = ground.config.controller
    good, lost, wrong = _sample(ground), _lost(ground), _wrong(ground)
    recovery, patience = controller.fail_safe.recovery_samples, controller.fail_safe.degraded_samples_max + 2
    first = (1, _sample(ground, restart=1.0))
    return (
        LongWay(_rows(first, (patience, lost)), _rows((3, lost))),
        LongWay(_rows(first, (patience, wrong)), _rows((3, wrong), (2, good))),
        LongWay(_rows(first, (patience, lost), (recovery - 1, good)), _rows((3, good))),
        LongWay(_rows(first, (patience, lost), (max(recovery - 2, 1), good)), _rows((1, lost), (2, good))),
    )


def long_ways_of_task(ground: Ground) -> tuple[LongWay, ...]:
    """Of the task: a start without the rear angle, or with one that cannot be; and frames after a silence."""
    recovery, inputs = ground.config.controller.fail_safe.recovery_samples, ground.config.controller.inputs
    e2e = ground.config.can.e2e
    proven = 1 + e2e.min_ok_state_init  # frames of each message until it is valid
    again = 1 + e2e.sync_counter_init + e2e.min_ok_state_invalid
    first, absent = _sample(ground, restart=1.0, rear_angle=math.nan), _sample(ground, rear_angle=math.nan)
    beyond = [_sample(ground, rear_angle=sign * 1.05 * math.radians(inputs.rear_angle_max_deg)) for sign in (1.0, -1.0)]
    start, usual = _sample(ground, restart=1.0), _sample(ground)
    silent = _cycles(Fault.MISSING, (e2e.max_no_new_or_repeated_data + 4, usual))
    return (
        LongWay(_faultless((1, first), (proven + max(recovery - 3, 0), absent)), _faultless((4, absent))),
        LongWay(_faultless((1, first), (proven, absent)), _faultless(*((2, row) for row in beyond), (2, usual))),
        LongWay(np.concatenate([_faultless((1, start), (proven, usual)), silent]), _faultless((again + 1, usual))),
    )


def flooded() -> npt.NDArray[np.void]:
    """More frames of each message than the task's count of them can hold, without a call of the task."""
    events = np.zeros(2 * 2**8 + 4, dtype=EVENT)
    events["length"] = FRAME_BYTES
    events["kind"] = np.repeat([MOTION, CONDITIONS], len(events) // 2)
    return events


def _cycles(fault: Fault, *pieces: tuple[int, list[float]]) -> Rows:
    rows = _rows(*pieces)
    return np.column_stack([rows, np.full((len(rows), 2), float(fault), dtype=np.float32)])


def _faultless(*pieces: tuple[int, list[float]]) -> Rows:
    return _cycles(Fault.NONE, *pieces)

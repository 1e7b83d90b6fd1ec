"""Inputs that several checks share: recordings of closed loops, drives over the whole input range, lookups, and faults.

The same configuration and seed give the same inputs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen import configuration
from codegen.arrays import FloatArray
from codegen.configuration import Config, Controller
from codegen.configuration.can import E2e
from codegen.configuration.signals import MEASURED
from codegen.emit.inputs_view import inputs_parameters
from codegen.emit.limiter_view import opposite_phase_speeds_km_h
from codegen.emit.text import Precision, numpy_type
from codegen.errors import CodegenError
from codegen.sil.closed_loop import INPUT_COLUMNS, ClosedLoop, LoopOptions
from codegen.sil.software import RECORD_COLUMNS, Measurement, Software
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack
from hil_sim.codec import Frame
from hil_sim.plant_node import PlantNode
from hil_sim.scenarios import SCENARIOS

Samples = npt.NDArray[np.float32]
"""Consecutive samples, (samples, 7) by DRIVE_COLUMNS: the fields of `Measurement` that every build has, `inhibit` as 0 or 1."""

DRIVE_COLUMNS = tuple(each.role for each in MEASURED if each.is_used and not each.is_extra)
NUMBER_ROLES = tuple(each.role for each in MEASURED if each.is_used and each.is_real)
"""Numbers of a measurement that the controller uses, in order."""

DELAY_SAMPLES = 1
"""Computing delay in the recordings: an ECU sends its command one period after sampling."""

GAPS = ((0.0, 1.0), (0.05, 0.5), (0.5, 1.0), (0.3, 0.2), (0.05, 0.04))
"""Probabilities that a gap begins and that it ends with a sample, for each drawn drive: no gaps, short ones, a restart of
the law every other sample, gaps long enough for the fail-safe, and pauses long enough to recover."""

HELD = (1, 25, 25, 4, 25)
"""Samples for which each draw is held, by drive. While held, signals move no faster than those of a car and are accepted."""

YAW_RATE_NOISE = 1e-3
"""Change of the yaw rate between samples, in rad/s. A constant yaw rate in a turn counts as frozen."""


def measurements_of(drive: Samples) -> list[Measurement]:
    """Convert an array to measurements."""
    rows = (dict(zip(DRIVE_COLUMNS, row, strict=True)) for row in drive.tolist())
    return [Measurement(**{**row, "inhibit": bool(row["inhibit"])}) for row in rows]


@dataclass(frozen=True)
class Thresholds:
    """Values at which the C branches (breakpoints and thresholds, SI units, none negative), and the input ranges."""

    config: Config
    speed: FloatArray
    front_angle: FloatArray
    friction: FloatArray

    @classmethod
    def of(cls, manifest: Mapping[str, Any]) -> Thresholds:
        """Return the thresholds of a build."""
        config = configuration.parse(manifest["configuration"], "manifest.json: configuration")
        controller, table = config.controller, manifest["map"]
        schedule = controller.tracking.schedule
        speeds = [
            *controller.feedback_speeds_km_h,
            *opposite_phase_speeds_km_h(config),
            *(schedule.speed_km_h if schedule else ()),
            controller.inputs.speed_max_km_h,
        ]
        return cls(
            config=config,
            speed=np.array([0.0, *table["speed_m_s"], *(KM_H * speed for speed in speeds)]),
            front_angle=np.array(
                [
                    *(0.0, config.steering.front_angle_stop, config.limiter.in_phase_from_front_angle),
                    *table["front_angle_rad"],
                    math.radians(controller.inputs.front_angle_max_deg),
                ]
            ),
            friction=np.array(
                [*(0.0, controller.friction_min, table["friction"]), *table["frictions"], controller.inputs.friction_max]
            ),
        )


def recorded(software: Software) -> tuple[Samples, ...]:
    """Run the built-in scenarios in closed loop and return the measurements of the controller.

    Scenarios that this car cannot drive are omitted.
    """
    drives = []
    for _, inputs in loops(software.config):
        loop = ClosedLoop(software, LoopOptions(delay_samples=DELAY_SAMPLES))
        drives.append(measured(loop.run(inputs), inputs[:: loop.steps_per_sample]))
    return tuple(drives)


def measured(record: FloatArray, inputs: FloatArray) -> Samples:
    """Return what the controller measures, from samples of a run by RECORD_COLUMNS and its inputs by INPUT_COLUMNS."""
    names = ("speed_m_s", "front_angle_rad", "yaw_rate_rad_s", "rear_angle_rad")
    columns = [record[:, RECORD_COLUMNS.index(name)] for name in names]
    columns.append(inputs[:, INPUT_COLUMNS.index("friction_estimate")])
    columns.append(record[:, RECORD_COLUMNS.index("lateral_acceleration_m_s2")])
    columns.append(inputs[:, INPUT_COLUMNS.index("inhibit")])
    return np.column_stack(columns).astype(np.float32)


def drawn(
    thresholds: Thresholds, samples: int, seed: int = 0, gaps: Sequence[tuple[float, float]] = GAPS
) -> tuple[Samples, ...]:
    """Draw drives over the whole range of every input: thresholds and their neighbours, missing signals, and gaps of all
    lengths.

    At most as many drives as HELD has entries.
    """
    generator = np.random.default_rng(seed)

    def drive(gap: tuple[float, float], held: int) -> Samples:
        drawn = np.repeat(_draw(thresholds, -(-samples // held), generator), held, axis=0)[:samples]
        return _with_gaps(drawn if held == 1 else moving(drawn, thresholds.config), gap, generator)

    return tuple(drive(gap, held) for gap, held in zip(gaps, HELD, strict=False))


def moving(drive: Samples, config: Config) -> Samples:
    """Limit the steps of speed, front angle and yaw rate to a little less than the plausibility check accepts."""
    names = ("speed_step", "front_angle_step", "yaw_rate_step")
    largest = {parameter.name: parameter.value for parameter in inputs_parameters(config)}
    steps = 0.9 * np.array([largest[name] for name in names], dtype=np.float32)
    moving = drive.copy()
    for before, row in pairwise(moving):
        row[:3] = before[:3] + np.clip(row[:3] - before[:3], -steps, steps)
    moving[:, 2] += YAW_RATE_NOISE * (np.arange(len(moving)) % 3)
    return moving


def _draw(thresholds: Thresholds, count: int, generator: np.random.Generator) -> Samples:
    config = thresholds.config
    inputs = config.controller.inputs
    speed_max, front_angle_max = inputs.speed_max_km_h * KM_H, math.radians(inputs.front_angle_max_deg)
    speed = _mixed(thresholds.speed, speed_max, count, generator)
    speed *= np.where(generator.random(count) < 0.05, -1.0, 1.0)
    front_angle = _mixed(thresholds.front_angle, front_angle_max, count, generator) * generator.choice([-1.0, 1.0], count)
    # Mostly plausible yaw rates, half of them near the steady turn; see take_yaw_rate in the generated C.
    yaw_rate_max = math.radians(inputs.yaw_rate_max_deg_s)
    understeer = SingleTrack.from_config(config).understeer_coefficient
    turn = speed * front_angle / np.maximum(config.vehicle.wheelbase + understeer * speed**2, 0.25 * config.vehicle.wheelbase)
    bound = inputs.lateral_acceleration_max_m_s2 / np.maximum(np.abs(speed), 1e-3)
    allowed = np.minimum(bound + math.radians(inputs.yaw_rate_tolerance_deg_s), yaw_rate_max)
    anything = generator.uniform(-1.0, 1.0, count)
    near = np.clip(turn + generator.normal(0.0, math.radians(inputs.yaw_rate_agreement_deg_s), count), -allowed, allowed)
    kind = generator.random(count)
    yaw_rate = np.choose(np.searchsorted([0.5, 0.97], kind), [near, anything * allowed, anything * yaw_rate_max])
    steered = generator.uniform(-config.rear_actuator.angle_max, config.rear_actuator.angle_max, count)
    rear_angle = np.where(generator.random(count) < 0.4, np.nan, steered)
    friction = np.where(
        generator.random(count) < 0.3, np.nan, _mixed(thresholds.friction, inputs.friction_max, count, generator)
    )
    # Mostly consistent with the yaw rate or the steady turn, with noise.
    shown = np.where(generator.random(count) < 0.5, yaw_rate, turn)
    lateral = speed * (shown + generator.normal(0.0, math.radians(inputs.yaw_rate_agreement_deg_s), count))
    lateral = np.where(generator.random(count) < 0.3, np.nan, lateral)
    inhibit = generator.random(count) < 0.2
    return np.column_stack([speed, front_angle, yaw_rate, rear_angle, friction, lateral, inhibit]).astype(np.float32)


def _mixed(thresholds: FloatArray, largest: float, count: int, generator: np.random.Generator) -> FloatArray:
    """Draw values from zero to the largest, small values, thresholds, and neighbours of thresholds."""
    threshold = generator.choice(thresholds, count).astype(np.float32)
    neighbour = np.nextafter(threshold, generator.choice(np.array([0.0, thresholds.max()], dtype=np.float32), count))
    found = np.choose(
        generator.integers(5, size=count),
        [
            generator.uniform(0.0, largest, count),
            generator.uniform(0.0, largest, count),
            largest * 10.0 ** generator.uniform(-4.0, 0.0, count),
            threshold.astype(np.float64),
            neighbour.astype(np.float64),
        ],
    )
    # The largest itself is accepted by the C in its own precision.
    result: FloatArray = np.minimum(found, float(np.nextafter(np.float32(largest), np.float32(0.0))))
    return result


def gaps_of(count: int, gap: tuple[float, float], generator: np.random.Generator) -> npt.NDArray[np.bool_]:
    """Return which samples are lost, never the first. `gap`: probabilities that a gap begins and that it ends with a
    sample."""
    begins, ends = gap
    lost = np.zeros(count, dtype=bool)
    random = generator.random(count)
    for sample in range(1, count):
        lost[sample] = random[sample] >= ends if lost[sample - 1] else random[sample] < begins
    return lost


def _with_gaps(drive: Samples, gap: tuple[float, float], generator: np.random.Generator) -> Samples:
    """Return the drive with one signal lost or out of range during gaps."""
    where = np.flatnonzero(gaps_of(len(drive), gap, generator))
    result = drive.copy()
    result[where, generator.integers(3, size=len(where))] = generator.choice(
        np.array([np.nan, np.inf, -np.inf, 1e9], dtype=np.float32), len(where)
    )
    return result


SPECIAL = (0.0, -0.0, 1e-45, -1e-38, 1e-30, 1e30, -3e38, np.inf, -np.inf, np.nan)
"""Values that no sensor sends, and zero."""


def loops(config: Config) -> Iterator[tuple[str, FloatArray]]:
    """Yield name and inputs, (steps, 7) by INPUT_COLUMNS, of every built-in scenario that this car can drive, without
    faults."""
    for name, run in SCENARIOS.items():
        try:
            yield name, run.inputs(config)
        except CodegenError:
            continue


def are_faults_defined_for(config: Config) -> bool:
    """Return whether the outcomes that the catalogue defines hold for these settings.

    They count lost samples and counters as the presets do. The rate of the fail-safe, which `codegen tune` sets, is free.
    """
    controller, defaults = config.controller, Controller()
    return (
        config.can.e2e == E2e()
        and controller.sampling_time_s == defaults.sampling_time_s
        and controller.fail_safe == defaults.fail_safe.model_copy(update={"rate_deg_s": controller.fail_safe.rate_deg_s})
        and controller.inputs == defaults.inputs
    )


def drives_of(thresholds: Thresholds, samples: int) -> tuple[Samples, ...]:
    """Return drives of the given length: plausible ones with gaps of each length, then arbitrary bit patterns."""
    generator = np.random.default_rng(1)
    patterns = generator.integers(0, 2**32, size=(samples, len(DRIVE_COLUMNS)), dtype=np.uint32).view(np.float32)
    patterns[:, -1] = generator.integers(0, 2, size=samples)
    special = generator.choice(np.array(SPECIAL, dtype=np.float32), size=(samples, len(DRIVE_COLUMNS)))
    special[:, -1] = generator.integers(0, 2, size=samples)
    # One wrong field at a time in a plausible drive, so that each signal is replaced by the others and recovers.
    mixed = drawn(thresholds, samples, seed=2)[-1].copy()
    wrong = generator.integers(0, len(DRIVE_COLUMNS) - 1, size=samples)
    few = generator.random(samples) < 0.02
    mixed[few, wrong[few]] = special[few, wrong[few]]
    return (*drawn(thresholds, samples), patterns, special, mixed)


def places(thresholds: Thresholds, samples: int, precision: Precision) -> npt.NDArray[np.float32] | npt.NDArray[np.float64]:
    """Return places of the map lookup, (about samples, 2): speed and front angle.

    They include breakpoints, their neighbours, values between and beyond them, both signs, and arbitrary bit patterns.
    """
    real = numpy_type(precision)
    generator = np.random.default_rng(3)
    columns = []
    for corners in (thresholds.speed, thresholds.front_angle):
        corner = generator.choice(corners, samples).astype(real)
        beside = np.nextafter(corner, generator.choice(np.array([-np.inf, np.inf], dtype=real), samples))
        uniform = generator.uniform(0.0, 1.3 * corners.max(), samples).astype(real)
        bits = generator.integers(0, 256, size=samples * real(0.0).nbytes, dtype=np.uint8).view(real)
        special = generator.choice(np.array(SPECIAL, dtype=real), samples)
        kind = generator.choice(5, size=samples, p=[0.3, 0.3, 0.3, 0.05, 0.05])
        columns.append(np.choose(kind, [corner, beside, uniform, bits, special]))
    sign = generator.choice(np.array([-1.0, 1.0], dtype=real), samples)
    return np.column_stack([columns[0], np.copysign(columns[1], sign)])


def road_frictions(thresholds: Thresholds, precision: Precision) -> tuple[float, ...]:
    """Return friction estimates for the lookup: unknown, that of each layer and its neighbours, and invalid ones."""
    real = numpy_type(precision)
    own = [real(value) for value in np.unique(thresholds.friction)]
    beside = [np.nextafter(value, real(2.0)) for value in own] + [np.nextafter(value, real(-1.0)) for value in own]
    between = [real(0.5) * (low + high) for low, high in pairwise(own)]
    return tuple(dict.fromkeys(float(value) for value in (*SPECIAL, *own, *beside, *between)))


Recording = tuple[list[tuple[Frame, ...]], Samples]
"""Protected frames of each sample of a car without rear steering, and the same samples as a drive."""


def recordings(config: Config, precision: Precision, samples: int) -> Iterator[Recording]:
    """Yield samples of each scenario from the beginning of the driver's action, without bus faults.

    Raises:
        BuildError: the C of the simulated car does not compile here.
    """
    for name, _ in loops(config):
        run = replace(SCENARIOS[name], faults=())
        node = PlantNode(config, run, precision=precision)
        first = min(round(run.steer_time / node.sampling_time), max(node.cycles - samples, 0))
        last = min(first + samples, node.cycles)
        frames, rows = [], []
        for cycle in range(last):
            frames.append(tuple(node.outgoing(cycle)))
            rows.append(node.finish(cycle))
        inputs = run.inputs(config)[:: round(config.controller.sampling_time_s / config.plant.sampling_time_s)]
        yield frames[first:], measured(np.array(rows[first:]), inputs[first:last])

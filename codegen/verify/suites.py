"""Runs that several checks share: scenarios, faults on the bus, drives, lookups, and frames of a car.

Nothing here runs the generated C; each check does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.configuration.can import E2e
from codegen.emit.text import Precision, numpy_type
from codegen.errors import CodegenError
from codegen.verify.drives import COLUMNS, Samples, Thresholds, drawn, measured
from hil_sim.frames import Frame
from hil_sim.plant_node import PlantNode
from hil_sim.scenarios import SCENARIOS

SPECIAL = (0.0, -0.0, 1e-45, -1e-38, 1e-30, 1e30, -3e38, np.inf, -np.inf, np.nan)
"""Values that no sensor sends, and zero."""


def loops(config: Config) -> Iterator[tuple[str, FloatArray]]:
    """Yield name and inputs, (steps, 6) by INPUT_COLUMNS, of every built-in scenario that this car can drive, without
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
    controller, defaults = config.controller, Config().controller
    return (
        config.can.e2e == E2e()
        and controller.sampling_time_s == defaults.sampling_time_s
        and controller.fail_safe == defaults.fail_safe.model_copy(update={"rate_deg_s": controller.fail_safe.rate_deg_s})
        and controller.inputs == defaults.inputs
    )


def drives(thresholds: Thresholds, samples: int) -> tuple[Samples, ...]:
    """Return drives of the given length: plausible ones with gaps of each length, then arbitrary bit patterns."""
    generator = np.random.default_rng(1)
    patterns = generator.integers(0, 2**32, size=(samples, len(COLUMNS)), dtype=np.uint32).view(np.float32)
    patterns[:, -1] = generator.integers(0, 2, size=samples)
    special = generator.choice(np.array(SPECIAL, dtype=np.float32), size=(samples, len(COLUMNS)))
    special[:, -1] = generator.integers(0, 2, size=samples)
    # One wrong field at a time in a plausible drive, so that each signal is replaced by the others and recovers.
    mixed = drawn(thresholds, samples, seed=2)[-1].copy()
    wrong = generator.integers(0, len(COLUMNS) - 1, size=samples)
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


@dataclass(frozen=True)
class Recording:
    """Frames and measurements of a car without rear steering.

    Attributes:
        name: name of the scenario.
        frames: protected frames of each sample, in order.
        measurements: the same samples as a drive.
    """

    name: str
    frames: tuple[tuple[Frame, ...], ...]
    measurements: Samples


def recordings(config: Config, precision: Precision, samples: int) -> tuple[Recording, ...]:
    """Record samples of each scenario from the beginning of the driver's action, without bus faults.

    Raises:
        BuildError: the C of the simulated car does not compile here.
    """
    found = []
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
        found.append(Recording(name, tuple(frames[first:]), measured(np.array(rows[first:]), inputs[first:last])))
    return tuple(found)

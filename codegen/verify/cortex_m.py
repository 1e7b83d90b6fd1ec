"""How many instructions a step of the generated controller takes on a Cortex-M4F, and that it computes there what it does here.

The code is compiled by clang with -O2 and run on an emulated core, its instructions counted exactly. The worst case that is
told is the largest of all steps that were run: a measured maximum, no proof. What is checked for all of the code is that every
loop has a fixed number of rounds (see `bounded_loops`), so that the number of instructions has a bound at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from codegen.sil.software import Measurement, Software, Status, compile_build
from codegen.verify.drives import Ground, crossed, drawn, recorded
from codegen.verify.target.on_target import RESULT, Drive, Steps, Target, measurements_of

__all__ = [
    "Agreement",
    "Drive",
    "InstructionCounts",
    "compare_with_host",
    "count_steps",
    "worst_step",
    "worst_step_instructions",
]

DRAWN_SAMPLES = 3_000
"""Of each of the drawn drives."""

ROUNDS, PARENTS, COPIES, WINDOW = 20, 12, 24, 3
"""Of the search that starts from the longest steps found: how often, from how many, with how many descendants each, of a step
and the ones before it. Three times as many samples and twice as many rounds found nothing longer."""


@dataclass(frozen=True)
class InstructionCounts:
    """Instructions of `<prefix>_controller_step`, its callees included.

    Attributes:
        worst: of all steps that were run.
        mean: of the first drives that were counted.
        steps: how many were run.
        worst_input: the measurements of the longest step, after those of the steps just before it.
        parts: name of the function to its share of the longest step, without its callees. What the compiler put into another
            function counts there.
        worst_by_status: the longest step that ended in each status; what is missing was never reached.
    """

    worst: int
    mean: float
    steps: int
    worst_input: tuple[Measurement, ...]
    parts: Mapping[str, int]
    worst_by_status: Mapping[Status, int]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "worst": self.worst,
            "mean": self.mean,
            "steps": self.steps,
            "parts": dict(self.parts),
            "worst_by_status": {status.name: count for status, count in self.worst_by_status.items()},
        }


@dataclass(frozen=True)
class Agreement:
    """Commands of the target beside those of the host.

    Attributes:
        samples: how many were compared.
        different: place of those that differ in any bit, (drive, sample).
    """

    samples: int
    different: tuple[tuple[int, int], ...]


def count_steps(
    files: Mapping[str, bytes], manifest: Mapping[str, Any], measurements: Sequence[Drive], *, flags: Sequence[str] = ("-O2",)
) -> InstructionCounts:
    """Count the steps of some drives, each from a controller that has just started.

    Args:
        files: of a build, as rendered or read; single precision.
        measurements: at least one drive of at least one sample; see `on_target.drive_of`.
        flags: for the compiler.

    Raises:
        CodegenError: a package of the extra `verify` is missing.
        BuildError: double precision, or C that does not compile.
    """
    tally = _Tally(Target(files, manifest, flags))
    for drive in measurements:
        tally.add(drive)
    return tally.result(sum(map(len, measurements)))


def worst_step(files: Mapping[str, bytes], manifest: Mapping[str, Any], software: Software | None = None) -> InstructionCounts:
    """The longest step that can be found, and the mean over the built-in scenarios in closed loop.

    Run are: the scenarios; drives that reach the whole range of every input, breakpoints and thresholds and every status; and
    descendants of the longest steps among them.

    Args:
        software: the build compiled for the host, where that is at hand.

    Raises:
        CodegenError, BuildError: see `count_steps`, and `compile_build`.
    """
    tally, ground = _Tally(Target(files, manifest)), Ground.of(manifest)
    scenarios = recorded(compile_build(files, manifest) if software is None else software)
    everywhere = drawn(ground, DRAWN_SAMPLES)
    for drive in (*scenarios, *everywhere):
        tally.add(drive)
    generator, pool = np.random.default_rng(0), np.concatenate(everywhere)
    for _ in range(ROUNDS):
        tally.add(crossed(tally.longest(), pool, COPIES, generator))
    return tally.result(sum(map(len, scenarios)))


def worst_step_instructions(files: Mapping[str, bytes], manifest: Mapping[str, Any]) -> int:
    """The longest step of a build; see `worst_step`."""
    return worst_step(files, manifest).worst


def compare_with_host(
    files: Mapping[str, bytes], manifest: Mapping[str, Any], measurements: Sequence[Drive], software: Software | None = None
) -> Agreement:
    """Run drives on the target and on this machine, and compare every bit of every command.

    Raises:
        CodegenError, BuildError: see `count_steps`, and `compile_build`.
    """
    target = Target(files, manifest)
    host = compile_build(files, manifest) if software is None else software
    different: list[tuple[int, int]] = []
    for index, drive in enumerate(measurements):
        here = np.array(
            [
                (command.rear_angle, command.yaw_rate_reference, command.status)
                for command in host.controller().run(measurements_of(drive))
            ],
            dtype=RESULT,
        )
        words = [commands.view("<u4").reshape(-1, 3) for commands in (here, target.run(drive))]
        different += [(index, int(sample)) for sample in np.flatnonzero((words[0] != words[1]).any(axis=1))]
    return Agreement(sum(map(len, measurements)), tuple(different))


@dataclass
class _Tally:
    """What was counted so far."""

    target: Target
    drives: list[Drive] = field(default_factory=list)
    commands: list[Any] = field(default_factory=list)
    steps: list[Steps] = field(default_factory=list)

    def add(self, drive: Drive) -> None:
        commands, steps = self.target.count(drive)
        self.drives.append(drive)
        self.commands.append(commands)
        self.steps.append(steps)

    def longest(self) -> Any:
        """The longest steps with the ones before them, (PARENTS, WINDOW, 6)."""
        total, samples = np.concatenate([steps.total for steps in self.steps]), np.concatenate(self.drives)
        ends = np.argsort(-total, kind="stable")[:PARENTS].clip(WINDOW - 1)
        return np.stack([samples[end - WINDOW + 1 : end + 1] for end in ends])

    def result(self, typical: int) -> InstructionCounts:
        """Figures; the mean over the first `typical` steps."""
        total, parts = (
            np.concatenate([steps.total for steps in self.steps]),
            np.concatenate([steps.parts for steps in self.steps]),
        )
        status = np.concatenate(self.commands)["status"]
        worst = int(total.argmax())
        names = zip(self.target.functions, parts[worst], strict=True)
        return InstructionCounts(
            worst=int(total[worst]),
            mean=float(total[:typical].mean()),
            steps=len(total),
            worst_input=tuple(measurements_of(np.concatenate(self.drives)[max(worst - WINDOW + 1, 0) : worst + 1])),
            parts={name: int(count) for name, count in names if count},
            worst_by_status={each: int(total[status == each].max()) for each in Status if (status == each).any()},
        )

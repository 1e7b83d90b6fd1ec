"""Compare every sample of the C of a build with the second implementation, bit for bit.

The inputs are those of the check `generator`: drives over the whole input range, drive cycles through every regime, both sides
of each speed threshold, recorded closed loops, random parameter sets, frames of a faulty bus, and long drives of every unit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

from codegen.sil.software import Status
from codegen.verify.long_drives import LongDrives
from codegen.verify.on_host import software_of
from codegen.verify.outcomes import Subject
from codegen.verify.unit_drives import SIZE_QUICK, Drive, Size, Stretch, UnitDrives
from hil_sim.codec import Codec
from tests.oracle import parameters, states
from tests.oracle.controller import Road, SecondController
from tests.oracle.kinds import second_controller
from tests.oracle.map_reference import lookup_of
from tests.oracle.pairs import ControllerPair, InputsPair, LimiterPair, Pair, ReceiverPair, TaskPair, compare, text_of
from tests.oracle.task import SecondTask
from tests.oracle.transitions import transition_findings


@dataclass
class Comparison:
    """Result: a line for each difference, samples by status, names of drives that were cut, and samples that repeated."""

    findings: list[str]
    statuses: Counter[Status] = field(default_factory=Counter)
    unsettled: list[str] = field(default_factory=list)
    repeated: int = 0


def check(subject: Subject, size: Size = SIZE_QUICK, *, is_quick: bool = True, with_long_drives: bool = True) -> Comparison:
    """Compare a build with the second implementation of its kind. Raises KeyError: there is none."""
    software = software_of(subject)
    lookup, facts = lookup_of(subject, software), subject.manifest["map"]
    road = Road(facts["friction"], facts["lateral_acceleration_cap_m_s2"])
    codec, period = Codec(software.config.can, software.precision), software.config.controller.sampling_time_s
    drawn = UnitDrives(subject, software, size, with_recordings=not is_quick)
    where = f"src/{subject.prefix}_calibration.c"
    found = Comparison([f"{where}: {line}" for line in parameters.differences(software)])
    found.findings += [*states.initialisation_findings(software), *states.uninitialised_findings(software)]
    found.findings += [*transition_findings(software), *states.soundness_findings(software, drawn.drive_cycle(0))]

    def pair_of(drive: Drive) -> Pair:
        def second(start: float) -> SecondController:
            return second_controller(software.config, drive.parameters, lookup, road, start)

        match drive.unit:
            case "controller":
                return ControllerPair(software, second(drive.start), drive.parameters, drive.start)
            case "inputs":
                return InputsPair(software, drive.parameters)
            case "limiter":
                return LimiterPair(software, drive.parameters, period, drive.start)
            case "receiver":
                return ReceiverPair(software)
            case "task":
                return TaskPair(
                    software, SecondTask(software.config.can, drive.parameters, codec, second), codec, drive.parameters
                )

    def differences(drive: Drive) -> Iterator[str]:
        """Yield the first output that differs; the following ones depend on it."""
        for first, stretches in _lives(drive):
            pair = pair_of(drive)
            result = compare(pair, stretches)
            found.repeated += result.repeated
            found.unsettled += [drive.name] if result.unsettled else []
            if isinstance(pair, ControllerPair):
                found.statuses += pair.statuses
            if result.difference is not None:
                index, sample, got, wanted = result.difference
                place = f"{drive.name}, sample {first + index}"
                yield f"{place}: {pair.text(got)}; by the law {pair.text(wanted)}; after {text_of(sample)}"
                return

    for drive in drawn.drives():
        found.findings += differences(drive)
    for drive in LongDrives(software, drawn.turn, is_quick).drives() if with_long_drives else ():
        found.findings += differences(drive)
    return found


def _lives(drive: Drive) -> Iterator[tuple[int, list[Stretch]]]:
    """Yield the number of the first sample and the stretches from each initialisation to the next."""
    if [*drive.restarts] == [0]:
        yield 0, [*drive.stretches]
        return
    (stretch,) = drive.stretches
    for start, end in pairwise([*drive.restarts, len(stretch.samples)]):
        yield start, [Stretch(stretch.samples[start:end])]

"""Part "gaps": the fault catalogue and gaps of 0.02 to 5 s in a turn near the edge of the map, from reverse to high speed.

The car's frames, the commands, or both are lost, or one side restarts, while the car turns in and in the steady turn. The
sideslip after the gap is compared with that of the intended ramp: the same car on the same course, whose rear wheels go on from
the angle that they hold when the gap ends, at the rate of the fail-safe, and at that of the controller once it follows its
reference again.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from codegen.arrays import FloatArray
from codegen.judgement.drives import angles_at
from codegen.map_file.map import ReferenceMap, load
from codegen.metrics.runs import SPIN_SIDESLIP
from codegen.sil.software import Software, Status
from codegen.sil.software import load as load_software
from codegen.units import KM_H
from codegen.verify.check import Effort, Outcome, Verdict
from hil_sim import bench, manoeuvres
from hil_sim.fault_catalogue import catalogue, run_all
from hil_sim.faults import Fault, FaultKind
from hil_sim.metrics import column
from hil_sim.scenarios import Scenario
from hil_sim.settings import Settings
from tests.evidence.progress import Progress

SHOWS = (
    "at every speed each fault of the catalogue has the status of the supervision's table, and after a gap on the bus the car"
    " slides no more than with the intended ramp from the measured rear angle"
)
SPEEDS_KM_H = (-5.0, 5.0, 30.0, 50.0, 80.0, 110.0)
LENGTHS_S = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
QUICK_SPEEDS_KM_H, QUICK_LENGTHS_S = (30.0, 110.0), (0.02, 0.2, 2.0)
STEER_TIME, STARTS_S, AFTER_S = 0.2, (0.3, 2.5), 3.0
"""Beginning of the turn, beginnings of the gap, and time after its end, in s."""
LOSSES: Mapping[str, FaultKind] = {
    "the car's frames are lost": "drop",
    "the commands are lost": "drop",
    "both are lost": "bus-down",
    "the ECU has no power": "ecu-restart",
    "the car's node has no power": "plant-restart",
}
EDGE = 0.95
"""Share of the largest yaw rate of the map at the speed."""
SPIN_DEG = math.degrees(SPIN_SIDESLIP)
FACTOR, ROUNDING_DEG = 1.1, 0.05
"""Largest sideslip over that of the intended ramp, and what a sample of delay more or less makes."""


@dataclass(frozen=True)
class Gap:
    """One gap: speed, what is lost (a key of LOSSES), beginning and length in s."""

    speed_km_h: float
    loss: str
    start: float
    length: float

    def __str__(self) -> str:
        return f"{self.speed_km_h:g} km/h, {self.loss} for {self.length:g} s from {self.start:g} s on"


@dataclass(frozen=True)
class Slide:
    """Largest sideslip in deg after a gap and with the intended ramp."""

    gap: Gap
    sideslip_deg: float
    intended_deg: float

    @property
    def is_met(self) -> bool:
        """Whether the car slides no more than it should; where the ramp spins, no figure beyond a spin counts."""
        return self.sideslip_deg <= FACTOR * self.intended_deg + ROUNDING_DEG or self.intended_deg > SPIN_DEG


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the part on the build of kind `tracking`. A quick run has fewer speeds and lengths."""
    folder = folders[-1]
    software, reference_map = load_software(folder), load(folder.with_suffix(".npz"))
    speeds = QUICK_SPEEDS_KM_H if effort.quick else SPEEDS_KM_H
    lengths = QUICK_LENGTHS_S if effort.quick else LENGTHS_S
    slides, violations = [], []
    for speed in speeds:
        gaps = [Gap(speed, which, start, length) for which in LOSSES for start in STARTS_S for length in lengths]
        key = f"{speed:g} km/h {effort.quick}"
        found = progress.once(key, partial(_all_sideslips, software, reference_map, gaps))
        slides += [Slide(gap, *pair) for gap, pair in zip(gaps, found, strict=True)]
        violations += progress.once(f"catalogue, {key}", partial(_violations, software, reference_map, speed))
    findings = violations + [
        f"{each.gap}: sideslip {each.sideslip_deg:.2f} deg, intended {each.intended_deg:.2f}"
        for each in slides
        if not each.is_met
    ]
    worst = max(
        (each.sideslip_deg / max(each.intended_deg, ROUNDING_DEG) for each in slides if each.sideslip_deg > 1.0), default=0.0
    )
    spins = sum(each.sideslip_deg > SPIN_DEG >= each.intended_deg for each in slides)
    cases = len(speeds) * len(catalogue(software.config.can, software.config.controller.sampling_time_s))
    figure = f"{cases} faults and {len(slides)} gaps; largest sideslip over that of the intended ramp {worst:.2f}; "
    figure += f"{spins} spins that it avoids"
    return Outcome(
        SHOWS, figure, Verdict.FAILED if findings else Verdict.PASSED, tuple(findings), {"worst": worst, "spins": spins}
    )


def _all_sideslips(software: Software, reference_map: ReferenceMap, gaps: Sequence[Gap]) -> list[tuple[float, float]]:
    return [sideslips(software, reference_map, gap) for gap in gaps]


def _violations(software: Software, reference_map: ReferenceMap, speed_km_h: float) -> list[str]:
    """Return how the outcomes of the catalogue at a speed differ from their specification."""
    (edge,) = angles_at(reference_map, abs(speed_km_h) * KM_H, (EDGE,))
    turn = {"speed_km_h": speed_km_h, "front_angle_deg": math.degrees(edge)}
    outcomes = run_all(software.config, partial(bench.run_through_can, software), **turn)
    return [f"{speed_km_h:g} km/h, {each.case.what}: {text}" for each in outcomes for text in each.violations]


def sideslips(software: Software, reference_map: ReferenceMap, gap: Gap) -> tuple[float, float]:
    """Return the largest sideslip in deg after a gap, and that with the intended ramp."""
    config = software.config
    (edge,) = angles_at(reference_map, abs(gap.speed_km_h) * KM_H, (EDGE,))
    message = config.can.rear_steer_command.name if gap.loss == "the commands are lost" else None
    fault = Fault(LOSSES[gap.loss], gap.start, gap.length, message)
    scenario = Scenario(
        name="gap",
        subject="Gap",
        what=str(gap),
        source="",
        duration=gap.start + gap.length + AFTER_S,
        steer_time=STEER_TIME,
        kind="corner",
        drive=manoeuvres.step(STEER_TIME, front_angle_deg=math.degrees(edge)),
        settings=Settings(speed_km_h=gap.speed_km_h),
        faults=(fault,),
    )
    driven = bench.run_through_can(software, scenario).record
    course = intended(driven, gap, software)
    ramp = replace(scenario, faults=(), rear_angle=lambda time: course[: time.size])
    found = bench.run(software, ramp)
    return sideslip_after(driven, gap), sideslip_after(found, gap)


def intended(driven: FloatArray, gap: Gap, software: Software) -> FloatArray:
    """Return the rear angle commands (samples,) in rad of the intended ramp."""
    parameters, period = software.parameters(), software.config.controller.sampling_time_s
    time, command, measured, status = (
        column(driven, name) for name in ("time_s", "rear_angle_command_rad", "rear_angle_rad", "status")
    )
    course: FloatArray = command.copy()
    end = int(np.searchsorted(time, gap.start + gap.length - 0.5 * period))
    angle = float(measured[end])
    for k in range(end, time.size):
        follows = status[k] <= Status.LIMITED
        target, rate = (command[k], parameters.rear_rate_max) if follows else (0.0, parameters.fail_safe_rate)
        angle += float(np.clip(target - angle, -rate * period, rate * period))
        course[k] = angle
    return course


def sideslip_after(record: FloatArray, gap: Gap) -> float:
    """Return the largest sideslip in deg from the end of the gap on."""
    after = column(record, "time_s") >= gap.start + gap.length
    return float(np.degrees(np.abs(column(record, "sideslip_rad")[after])).max())

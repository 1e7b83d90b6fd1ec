"""Part "gaps": the fault catalogue and gaps of 0.02 to 5 s in a turn near the edge of the map, from reverse to high speed.

Any messages are lost, alone and in pairs, the frames of one are damaged while the commands are lost, or one side restarts:
while the car turns in, in the steady turn, and while the driver steers back to straight ahead, so that the rear wheels hold an
angle that the law no longer commands. The sideslip after the gap is compared with that of the intended ramp: the same car on
the same course, whose rear wheels go on from the angle that they hold when the gap ends, at the rate of the fail-safe, and at
that of the controller once it follows its reference again. With a wrong rear angle sensor in addition, it is compared with
that of the right sensor.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.judgement.drives import angles_at
from codegen.map_file.map import ReferenceMap, load
from codegen.metrics.runs import SPIN_SIDESLIP
from codegen.sil.software import Software, Status
from codegen.sil.software import load as load_software
from codegen.units import KM_H
from codegen.verify.outcomes import Effort, Outcome, Verdict
from hil_sim import bench, manoeuvres
from hil_sim.fault_catalogue import catalogue, run_all
from hil_sim.faults import Fault, FaultKind
from hil_sim.metrics import column
from hil_sim.scenarios import Scenario
from hil_sim.settings import Settings
from tests.evidence.progress import Progress

SHOWS = (
    "at every speed each fault of the catalogue has the status of the supervision's table, and after a gap on the bus the car"
    " slides no more than with the intended ramp from the measured rear angle, and spins with no wrong rear angle sensor"
)
SPEEDS_KM_H = (-5.0, 5.0, 30.0, 50.0, 80.0, 110.0)
LENGTHS_S = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
QUICK_SPEEDS_KM_H, QUICK_LENGTHS_S = (30.0, 110.0), (0.02, 0.2, 2.0)
STEER_TIME, STARTS_S, AFTER_S = 0.2, (0.3, 2.5), 3.0
"""Beginning of the turn, beginnings of the gap, and time after its end, in s."""
STEERS_BACK_AT = 0.5
"""Share of the gap after which the driver steers back."""
MOTION, CONDITIONS, COMMANDS = "vehicle_motion", "vehicle_conditions", "rear_steer_command"
LOSSES: Mapping[str, tuple[tuple[FaultKind, str], ...]] = {
    "the car's frames are lost": (("drop", ""),),
    "the commands are lost": (("drop", COMMANDS),),
    "motion and commands are lost": (("drop", MOTION), ("drop", COMMANDS)),
    "conditions and commands are lost": (("drop", CONDITIONS), ("drop", COMMANDS)),
    "the motion is damaged and the commands are lost": (("corrupt", MOTION), ("drop", COMMANDS)),
    "the conditions are damaged and the commands are lost": (("corrupt", CONDITIONS), ("drop", COMMANDS)),
    "nothing is lost": (),
    "all are lost": (("bus-down", ""),),
    "the ECU has no power": (("ecu-restart", ""),),
    "the car's node has no power": (("plant-restart", ""),),
}
"""Faults of each loss, with the role of the message; "" for all of the car's, or none."""
EDGE = 0.95
"""Share of the largest yaw rate of the map at the speed."""
SPIN_DEG = math.degrees(SPIN_SIDESLIP)
FACTOR, ROUNDING_DEG = 1.1, 0.05
"""Largest sideslip over that of the intended ramp, and what a sample of delay more or less makes."""


SENSORS: Mapping[str, tuple[FaultKind, float]] = {
    "5 deg too large": ("offset", math.radians(5.0)),
    "5 deg too small": ("offset", math.radians(-5.0)),
    "1 deg too large": ("offset", math.radians(1.0)),
    "1 deg too small": ("offset", math.radians(-1.0)),
    "noise of 0.3 deg": ("noise", math.radians(0.3)),
    "standing still": ("stuck-value", 0.0),
    "not available": ("not-a-number", 0.0),
}
"""Faults of the rear angle sensor, from the beginning of the gap on."""
SENSOR_LENGTH_S = 2.0


@dataclass(frozen=True)
class Gap:
    """One gap: speed, what is lost (a key of LOSSES), beginning and length in s, whether the driver steers back in it, and what
    is wrong with the rear angle sensor from its beginning on (a key of SENSORS, or "")."""

    speed_km_h: float
    loss: str
    start: float
    length: float
    steers_back: bool = False
    sensor: str = ""

    def __str__(self) -> str:
        course = ", steered back" if self.steers_back else ""
        course += f", rear angle sensor {self.sensor}" if self.sensor else ""
        return f"{self.speed_km_h:g} km/h, {self.loss} for {self.length:g} s from {self.start:g} s on{course}"


@dataclass(frozen=True)
class Slide:
    """Largest sideslip in deg after a gap, and with the intended ramp or, with a wrong sensor, with the right one."""

    gap: Gap
    sideslip_deg: float
    intended_deg: float

    @property
    def is_met(self) -> bool:
        """Whether the car slides no more than it should; where that is a spin, no figure counts."""
        most = SPIN_DEG if self.gap.sensor else FACTOR * self.intended_deg + ROUNDING_DEG
        return self.sideslip_deg <= most or self.intended_deg > SPIN_DEG


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the part on the build of kind `tracking`. A quick run has fewer speeds and lengths."""
    folder = folders[-1]
    software, reference_map = load_software(folder), load(folder.with_suffix(".npz"))
    speeds = QUICK_SPEEDS_KM_H if effort.quick else SPEEDS_KM_H
    lengths = QUICK_LENGTHS_S if effort.quick else LENGTHS_S
    slides, violations = [], []
    for speed in speeds:
        courses = [(start, False) for start in STARTS_S] + [(STARTS_S[-1], True)]
        gaps = [
            Gap(speed, which, at, length, back)
            for which in LOSSES
            if LOSSES[which]
            for at, back in courses
            for length in lengths
        ]
        if speed == speeds[-1] or not effort.quick:
            gaps += [Gap(speed, which, STARTS_S[-1], SENSOR_LENGTH_S, True, sensor) for which in LOSSES for sensor in SENSORS]
        key = f"{speed:g} km/h {effort.quick}"
        found = progress.once(key, partial(_all_sideslips, software, reference_map, gaps))
        slides += [Slide(gap, *pair) for gap, pair in zip(gaps, found, strict=True)]
        violations += progress.once(f"catalogue, {key}", partial(_violations, software, reference_map, speed))
    findings = violations + [
        f"{each.gap}: sideslip {each.sideslip_deg:.2f} deg, intended {each.intended_deg:.2f}"
        for each in slides
        if not each.is_met
    ]
    right, wrong = ([each for each in slides if bool(each.gap.sensor) is is_wrong] for is_wrong in (False, True))
    worst, with_sensor = (
        max((each.sideslip_deg / max(each.intended_deg, ROUNDING_DEG) for each in some if each.sideslip_deg > 1.0), default=0.0)
        for some in (right, wrong)
    )
    spins = sum(each.sideslip_deg > SPIN_DEG >= each.intended_deg for each in slides)
    unavoidable = sum(each.intended_deg > SPIN_DEG for each in slides)
    cases = len(speeds) * len(catalogue(software.config.can, software.config.controller.sampling_time_s))
    figure = f"{cases} faults and {len(right)} gaps; largest sideslip over that of the intended ramp {worst:.2f}; "
    figure += f"{len(wrong)} with a wrong rear angle sensor: over that of the right one {with_sensor:.2f}; "
    figure += f"{spins} spins that these avoid, {unavoidable} cases spin with ramp and sensor as intended"
    numbers = {"worst": worst, "worst with a wrong sensor": with_sensor, "spins": spins, "unavoidable": unavoidable}
    return Outcome(SHOWS, figure, Verdict.FAILED if findings else Verdict.PASSED, tuple(findings), numbers)


def _all_sideslips(software: Software, reference_map: ReferenceMap, gaps: Sequence[Gap]) -> list[tuple[float, float]]:
    return [sideslips(software, reference_map, gap) for gap in gaps]


def _violations(software: Software, reference_map: ReferenceMap, speed_km_h: float) -> list[str]:
    """Return how the outcomes of the catalogue at a speed differ from their specification."""
    (edge,) = angles_at(reference_map, abs(speed_km_h) * KM_H, (EDGE,))
    turn = {"speed_km_h": speed_km_h, "front_angle_deg": math.degrees(edge)}
    outcomes = run_all(software.config, partial(bench.run_through_can, software), **turn)
    return [f"{speed_km_h:g} km/h, {each.case.what}: {text}" for each in outcomes for text in each.violations]


def sideslips(software: Software, reference_map: ReferenceMap, gap: Gap) -> tuple[float, float]:
    """Return the largest sideslip in deg after a gap, and that with the intended ramp, or with the right sensor."""
    messages = software.config.can.messages()
    (edge,) = angles_at(reference_map, abs(gap.speed_km_h) * KM_H, (EDGE,))
    faults = tuple(Fault(kind, gap.start, gap.length, messages[role].name if role else None) for kind, role in LOSSES[gap.loss])
    if gap.sensor:
        kind, amount = SENSORS[gap.sensor]
        wrong = Fault(kind, gap.start, gap.length + AFTER_S, messages[CONDITIONS].name, "rear_angle", amount=amount)
        faults += (wrong,)
    scenario = Scenario(
        name="gap",
        subject="Gap",
        what=str(gap),
        source="",
        duration=gap.start + gap.length + AFTER_S,
        steer_time=STEER_TIME,
        kind="corner",
        drive=_course(gap, math.degrees(edge)),
        settings=Settings(speed_km_h=gap.speed_km_h),
        faults=faults,
    )
    driven = bench.run_through_can(software, scenario).record
    if gap.sensor:
        return sideslip_after(driven, gap), sideslips(software, reference_map, replace(gap, sensor=""))[0]
    course = intended(driven, gap, software)
    ramp = replace(scenario, faults=(), rear_angle=lambda time: course[: time.size])
    found = bench.run(software, ramp)
    return sideslip_after(driven, gap), sideslip_after(found, gap)


def _course(gap: Gap, front_angle_deg: float) -> manoeuvres.Manoeuvre:
    """Return the step into the turn, and where the driver steers back, that to straight ahead within the gap."""
    turn_in = manoeuvres.step(STEER_TIME, front_angle_deg=front_angle_deg)
    if not gap.steers_back:
        return turn_in

    def drive(config: Config, settings: Settings, time: FloatArray) -> manoeuvres.Columns:
        columns = dict(turn_in(config, settings, time))
        held = time < gap.start + STEERS_BACK_AT * gap.length
        return {**columns, "steering_wheel_command": np.where(held, columns["steering_wheel_command"], 0.0)}

    return drive


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
        follows = status[k] not in (Status.STANDBY, Status.FAIL_SAFE)  # in DEGRADED the command is the law's, no ramp
        target, rate = (command[k], parameters.rear_rate_max) if follows else (0.0, parameters.fail_safe_rate)
        angle += float(np.clip(target - angle, -rate * period, rate * period))
        course[k] = angle
    return course


def sideslip_after(record: FloatArray, gap: Gap) -> float:
    """Return the largest sideslip in deg from the end of the gap on."""
    after = column(record, "time_s") >= gap.start + gap.length
    return float(np.degrees(np.abs(column(record, "sideslip_rad")[after])).max())

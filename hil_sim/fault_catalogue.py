"""Every bus fault in the same turn-in: what was injected, what it caused, and whether that is as specified.

The fault begins while the car turns in and the rear wheels move.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.configuration.can import Can
from codegen.emit.controller_view import controller_parameters
from codegen.emit.laws import law_of
from codegen.emit.supervision import CAUSES, Cause, status_of
from codegen.sil.software import RECORD_COLUMNS, Status
from hil_sim import manoeuvres
from hil_sim.bench import BenchResult
from hil_sim.codec import causes
from hil_sim.faults import Fault, FaultKind
from hil_sim.scenarios import FREE_RUNNING, HALF_RATE, IN_STEP, Clocks, Scenario
from hil_sim.settings import Settings

SPEED_KM_H, FRONT_ANGLE_DEG = 65.0, 4.0
"""Turn of the catalogue in reports."""
STEER_TIME, START, DURATION = 0.2, 0.3, 3.0
"""Start of steering, start of the fault and end of the run, in s."""

SAFE_WITHIN = 0.05
"""Largest time in s from the first lost sample to the fail-safe."""

RATE_TOLERANCE = 1e-9
"""Rounding tolerance as a fraction of the actuator's rate limit."""


@dataclass(frozen=True)
class FaultCase:
    """A fault with its specified outcome.

    Attributes:
        name, what: texts of the table.
        faults: injected faults.
        cause: most urgent cause of the supervision that must be reached; its status is the worst one. None: the ECU is healthy,
            and the actuator, which receives no command, enters its own fail-safe.
        clocks: clocks of car and ECU during the whole run.
    """

    name: str
    what: str
    faults: tuple[Fault, ...]
    cause: Cause | None
    clocks: Clocks = IN_STEP

    @property
    def worst(self) -> Status:
        """Worst status that must be reached, by the table of the supervision; LIMITED includes TRACKING."""
        return Status.FAIL_SAFE if self.cause is None else status_of(CAUSES[self.cause].leads_to, is_limited=True)

    @property
    def end(self) -> float:
        """End of the last fault in s; clocks do not end."""
        return max((fault.start + fault.duration for fault in self.faults), default=DURATION)


@dataclass(frozen=True)
class FaultOutcome:
    """Result of a case. Times in s from its beginning, or from its end for `recovered_after`; None: not reached."""

    case: FaultCase
    seen: tuple[str, ...]
    held_after: float | None
    fail_safe_after: float | None
    rear_angle_max_deg: float
    rear_rate_max_deg_s: float
    command_step_max_deg: float
    command_step_bound_deg: float
    recovered_after: float | None
    worst: Status
    violations: tuple[str, ...]


def scenario(case: FaultCase, speed_km_h: float = SPEED_KM_H, front_angle_deg: float = FRONT_ANGLE_DEG) -> Scenario:
    """Return the cornering scenario with the faults of a case."""
    return Scenario(
        name=f"fault-{case.name}",
        subject="Fault in a corner",
        what=case.what,
        source="ISO 26262-4:2018 (fault injection test)",
        duration=DURATION,
        steer_time=STEER_TIME,
        kind="corner",
        drive=manoeuvres.step(STEER_TIME, front_angle_deg=front_angle_deg),
        settings=Settings(speed_km_h=speed_km_h),
        faults=case.faults,
        clocks=case.clocks,
    )


def catalogue(can: Can, sampling_time: float) -> tuple[FaultCase, ...]:
    """Return all cases for the message names of a configuration. Faults last multiples of `sampling_time` (s)."""
    motion, conditions, command = (message.name for message in can.messages().values())

    def case(name: str, what: str, cause: Cause | None, kind: FaultKind, samples: int, **more: object) -> FaultCase:
        fault = Fault(kind=kind, start=START, duration=sampling_time * samples)
        return FaultCase(name, what, (replace(fault, **more),), cause)  # type: ignore[arg-type]

    missing, lost, replaced, disturbed = (
        Cause.SAMPLE_MISSING,
        Cause.SAMPLE_LOST,
        Cause.SIGNAL_REPLACED,
        Cause.BUS_INTERMITTENT,
    )
    # Of two frames in the wrong order, the first is three counters after the last one of the pair before. A receiver that
    # synchronises the counter waits for frames in sequence.
    is_newer_accepted = not can.e2e.definition.has_synchronisation and can.e2e.max_delta_counter >= 3
    reordered = missing if is_newer_accepted else lost
    return (
        case("drop-1", "1 sample of the car lost", missing, "drop", 1),
        case("drop-3", "3 samples lost: as many as are held", missing, "drop", 3),
        case("drop-4", "4 samples lost: one too many", lost, "drop", 4),
        case("drop-50", "50 samples lost", lost, "drop", 50),
        case("drop-motion", f"50 frames of {motion} lost", lost, "drop", 50, message=motion),
        case("drop-conditions", f"50 frames of {conditions} lost", Cause.CONDITIONS_UNKNOWN, "drop", 50, message=conditions),
        case("drop-command", f"50 frames of {command} lost", None, "drop", 50, message=command),
        case("delay-2", "frames 2 cycles late for 50 samples", disturbed, "delay", 50, cycles=2),
        case("delay-6", "frames 6 cycles late for 50 samples", lost, "delay", 50, cycles=6),
        case("duplicate", "each frame twice for 50 samples", disturbed, "duplicate", 50),
        case("reorder", "each frame after its successor for 50 samples", reordered, "reorder", 50),
        case("burst", "frames two by two: none in a cycle and both in the next, for 50 samples", disturbed, "burst", 50),
        FaultCase(
            "drop-3-of-10",
            "3 of 10 samples lost, for 2 s",
            tuple(Fault("drop", START + 10 * k * sampling_time, 3 * sampling_time) for k in range(20)),
            disturbed,
        ),
        FaultCase("late", "the task called at half the rate", (), Cause.TASK_LATE, HALF_RATE),
        FaultCase("clocks", "two clocks, 100 ppm apart, jitter 0.7 ms", (), missing, FREE_RUNNING),
        case("corrupt-3", "a bit flipped in 3 samples", missing, "corrupt", 3),
        case("corrupt-50", "a bit flipped in 50 samples", lost, "corrupt", 50),
        case("corrupt-command", f"a bit flipped in 50 frames of {command}", None, "corrupt", 50, message=command),
        case("freeze-3", "the counters stand still for 3 samples", missing, "freeze-counter", 3),
        case("freeze-50", "the counters stand still for 50 samples", lost, "freeze-counter", 50),
        case(
            "stuck", "the yaw rate stands still for 50 samples", replaced, "stuck-value", 50, message=motion, signal="yaw_rate"
        ),
        case("nan-3", "NaN into the encoder for 3 samples", missing, "not-a-number", 3, message=motion, signal="yaw_rate"),
        case("nan-50", "NaN into the encoder for 50 samples", replaced, "not-a-number", 50, message=motion, signal="yaw_rate"),
        case("inf-50", "infinity into the encoder for 50 samples", replaced, "infinity", 50, message=motion, signal="speed"),
        case(
            "nan-rear",
            "rear angle not available for 50 samples",
            Cause.NONE,
            "not-a-number",
            50,
            message=conditions,
            signal="rear_angle",
        ),
        FaultCase(
            "stuck-rear",
            "the measured rear angle stands still for 180 samples, from before the turn on",
            (Fault("stuck-value", 0.5 * STEER_TIME, 180 * sampling_time, conditions, "rear_angle"),),
            Cause.ACTUATOR_STUCK,
        ),
        case(
            "offset-rear",
            "the measured rear angle 2 deg too large for 180 samples",
            Cause.ACTUATOR_STUCK,
            "offset",
            180,
            message=conditions,
            signal="rear_angle",
            amount=math.radians(2.0),
        ),
        case(
            "noise-rear",
            "noise of 0.05 deg in the measured rear angle for 50 samples",
            Cause.NONE,
            "noise",
            50,
            message=conditions,
            signal="rear_angle",
            amount=math.radians(0.05),
        ),
        case("foreign", "the bus full of foreign frames for 50 samples", Cause.NONE, "foreign-traffic", 50),
        case("ecu", "the ECU without power for 50 samples", Cause.ANGLE_UNKNOWN, "ecu-restart", 50),
        FaultCase(
            "ecu-angle",
            "the same, and the rear angle not available when it is back",
            (
                Fault("ecu-restart", START, 50 * sampling_time),
                Fault("not-a-number", START, 55 * sampling_time, message=conditions, signal="rear_angle"),
            ),
            Cause.ANGLE_UNKNOWN,
        ),
        FaultCase(
            "ecu-wrong-angle",
            "the same, and the rear angle infinite when it is back",
            (
                Fault("ecu-restart", START, 50 * sampling_time),
                Fault("infinity", START, 70 * sampling_time, message=conditions, signal="rear_angle"),
            ),
            Cause.ANGLE_UNKNOWN,
        ),
        case("plant", "the car's node without power for 50 samples", lost, "plant-restart", 50),
        case("bus-2", "nothing gets through for 2 samples", missing, "bus-down", 2),
        case("bus-50", "nothing gets through for 50 samples", lost, "bus-down", 50),
        case("bus-200", "nothing gets through for 200 samples", lost, "bus-down", 200),
    )


def judge(case: FaultCase, result: BenchResult, config: Config) -> FaultOutcome:
    """Compare a run of a case with its specification."""
    time, status = _column(result, "time_s"), _column(result, "status").astype(int)
    rear, command = _column(result, "rear_angle_rad"), _column(result, "rear_angle_command_rad")
    period = config.controller.sampling_time_s
    after, over = time > START - 0.5 * period, time > case.end - 0.5 * period
    fine = status <= Status.LIMITED
    ended = over.any() and fine[-1]
    troubled = np.flatnonzero(over & ~fine)
    recovered = int(troubled[-1]) + 1 if troubled.size else int(np.argmax(over))
    reached = Status(int(status[after].max()))
    fail_safe = _first(after & (status == Status.FAIL_SAFE))
    outcome = FaultOutcome(
        case=case,
        seen=_seen(result, after),
        held_after=_since(time, _first(after & (status >= Status.DEGRADED)), START),
        fail_safe_after=_since(time, fail_safe, START),
        rear_angle_max_deg=math.degrees(max(np.abs(rear).max(), np.abs(command).max())),
        rear_rate_max_deg_s=math.degrees(np.abs(np.diff(rear)).max() / period),
        command_step_max_deg=math.degrees(np.abs(np.diff(command)).max()),
        command_step_bound_deg=_step_bound_deg(case, result, config),
        recovered_after=round(float(time[recovered]) - case.end, 9) if ended else None,
        worst=reached,
        violations=(),
    )
    stands_still = case.cause is Cause.ACTUATOR_STUCK and case.faults[0].kind == "stuck-value"
    is_noticed = not stands_still or _departs(case, time, command, config)
    return replace(outcome, violations=tuple(_violations(outcome, config, is_noticed)))


def _departs(case: FaultCase, time: FloatArray, command: FloatArray, config: Config) -> bool:
    """Return whether the command is so far from the angle at the beginning of a fault, and for so long, that a rear angle which
    stands still must be noticed: twice the tolerances of the check."""
    parameters = {each.name: np.asarray(each.value) for each in controller_parameters(config)}
    during = (time >= case.faults[0].start) & (time < case.end)
    far = np.abs(command - command[during][0])[during] > 2.0 * parameters["actuator_error_max"]
    return bool(np.count_nonzero(far) > 2 * parameters["actuator_samples_max"])


def _seen(result: BenchResult, after: npt.NDArray[np.bool_]) -> tuple[str, ...]:
    """Return the diagnostics of the ECU and the faults that the car detects in the commands."""
    commands = {"command missing": "cycles_without", "command refused": "refused", "command lost in between": "lost"}
    # Until the car's messages are valid, the ECU has no angle to command.
    at_start = {"cycles_without": int(np.count_nonzero(_column(result, "status")[~after] > Status.LIMITED))}
    noticed = tuple(text for text, count in commands.items() if result.received[count] > at_start.get(count, 0))
    return causes(int(np.bitwise_or.reduce(result.diagnostics[after]))) + noticed


def _step_bound_deg(case: FaultCase, result: BenchResult, config: Config) -> float:
    """Return the largest allowed change of the command in one sample, in deg.

    It follows from the rate limits; without any, from the feedback for the largest error of the run; for a feedforward
    without a rate limit, from its range. If commands are lost, the controller continues meanwhile, up to its distance from
    the measured rear angle. While the wheels do not follow, the command stays near them; when they follow again, it continues
    from the controller's command, at most as far away. If samples are lost too, it predicts for a few of them; the fail-safe
    starts from the measured rear angle.
    """
    controller, code = config.controller, math.degrees(config.can.rear_steer_command.real("rear_angle").factor)
    limits = [rate for rate in (controller.rear_rate_max_deg_s, config.limiter.rear_rate_max_deg_s) if rate != "off"]
    law = law_of(config)
    feedback = law.gains(config)
    if limits:
        bound = min(limits) * controller.sampling_time_s
    elif feedback is None or law.uses_rear_angle:
        bound = 2.0 * config.rear_actuator.angle_max_deg
    else:
        error = np.abs(_column(result, "yaw_rate_reference_rad_s") - _column(result, "yaw_rate_rad_s")).max()
        proportional, integral = feedback(_column(result, "speed_m_s"))
        bound = math.degrees((2.0 * proportional.max() + integral.max() * controller.sampling_time_s) * error)
    if any(fault.kind == "ecu-restart" for fault in case.faults):
        # After a restart the car rejects the first commands of the ECU until their counter is verified.
        bound *= 1 + config.can.e2e.sync_counter_init + config.can.e2e.max_delta_counter_init
    if case.clocks.are_free_running:
        bound *= 2  # a cycle without a command, and two in the next
    if case.cause is Cause.ACTUATOR_STUCK or any(fault.message == config.can.rear_steer_command.name for fault in case.faults):
        bound += controller.rear_angle_error_max_deg
    time = _column(result, "time_s")
    apart = np.degrees(np.abs(_column(result, "rear_angle_command_rad") - _column(result, "rear_angle_rad")))
    predicted_s = (controller.fail_safe.degraded_samples_max + 0.5) * controller.sampling_time_s
    ends = [
        fault.start + (fault.cycles * controller.sampling_time_s if fault.kind == "delay" else fault.duration)
        for fault in case.faults
        if fault.kind in ("drop", "delay") and fault.message is None and fault.duration > predicted_s
    ]
    fails = _column(result, "status") == Status.FAIL_SAFE
    ends += time[1:][fails[1:] & ~fails[:-1]].tolist()
    # The first command after a silence, and the return when control ends, start from the measured angle, which lags behind.
    bound += max((apart[np.abs(time - end) < 2.5 * controller.sampling_time_s].max() for end in ends), default=0.0)
    silent = sum(fault.duration for fault in case.faults if fault.kind in ("bus-down", "plant-restart"))
    predicted = min(round(silent / controller.sampling_time_s), controller.fail_safe.degraded_samples_max)
    # A command is rounded to its code: a step between two of them is off by one code at most.
    return bound * (1 + predicted) + code


def _violations(outcome: FaultOutcome, config: Config, is_noticed: bool) -> Iterable[str]:
    case, actuator = outcome.case, config.rear_actuator
    step = config.can.rear_steer_command.real("rear_angle").factor
    reached = max(outcome.worst, Status.LIMITED)
    if reached != case.worst and is_noticed:
        yield f"reached {Status(reached).name}, defined is {case.worst.name}"
    if case.worst == Status.FAIL_SAFE and (outcome.fail_safe_after is None or outcome.fail_safe_after > SAFE_WITHIN + 1e-9):
        yield f"fail-safe later than {SAFE_WITHIN:g} s"
    # The play of the rear axle leaves the wheels half of it beyond the actuator.
    if outcome.rear_angle_max_deg > actuator.angle_max_deg + 0.5 * config.plant.backlash_deg + math.degrees(step):
        yield f"rear angle beyond {actuator.angle_max_deg:g} deg"
    if outcome.rear_rate_max_deg_s > actuator.rate_max_deg_s * (1.0 + RATE_TOLERANCE):
        yield f"rear angle faster than {actuator.rate_max_deg_s:g} deg/s"
    if outcome.command_step_max_deg > outcome.command_step_bound_deg:
        yield f"the command moves by more than {outcome.command_step_bound_deg:.2f} deg at once"
    if case.faults and outcome.recovered_after is None:
        yield "no recovery"


def run_all(
    config: Config,
    runner: Callable[[Scenario], BenchResult],
    progress: Callable[[int, int], None] | None = None,
    *,
    speed_km_h: float = SPEED_KM_H,
    front_angle_deg: float = FRONT_ANGLE_DEG,
) -> list[FaultOutcome]:
    """Run every case of the catalogue in order.

    Args:
        runner: runs a scenario with its faults.
        progress: called with the counts of finished and of all cases.
        speed_km_h, front_angle_deg: of the turn.
    """
    cases = catalogue(config.can, config.controller.sampling_time_s)
    outcomes = []
    for number, case in enumerate(cases, start=1):
        outcomes.append(judge(case, runner(scenario(case, speed_km_h, front_angle_deg)), config))
        if progress is not None:
            progress(number, len(cases))
    return outcomes


def _column(result: BenchResult, name: str) -> npt.NDArray[np.float64]:
    return result.record[:, RECORD_COLUMNS.index(name)]


def _first(where: npt.NDArray[np.bool_]) -> int | None:
    return int(np.argmax(where)) if where.any() else None


def _since(time: npt.NDArray[np.float64], index: int | None, start: float) -> float | None:
    return None if index is None else round(float(time[index]) - start, 9)

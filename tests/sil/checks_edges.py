"""Checks of the edges of the generated C: memory before the first call, defaults, ranges, counters at their limits.

Each check takes a build of any kind and raises AssertionError if the build fails it.
"""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from codegen.emit.controller_view import INITIALISED
from codegen.emit.laws import law_of
from codegen.sil.software import Measurement, Status
from tests.builds import Built
from tests.sil.checks_kinds import OPEN, STILL, config_of, parameters_of

LOST = Measurement(math.nan, math.nan, math.nan)
FILL_BYTES = (0x00, 0xFF, 0xA5, 0x01)


def values_of(ffi: Any, value: Any) -> Any:
    """Return a C value as nested tuples without padding; NaN as text, so that two compare as equal."""
    if not isinstance(value, ffi.CData):
        return repr(value)
    kind = ffi.typeof(value)
    if kind.kind == "pointer":
        return int(ffi.cast("uintptr_t", value))
    parts = [getattr(value, name) for name, _ in kind.fields] if kind.kind == "struct" else value
    return tuple(values_of(ffi, part) for part in parts)


def check_init_sets_everything(built: Built) -> None:
    """Check that the state after a first call does not depend on the memory before it: no field is forgotten."""
    software, ffi = built.software, built.software.ffi
    parameters = software.parameters()
    firsts: dict[str, Callable[[Any], Any]] = {
        "controller": lambda state: software.function("controller_init")(state, 0.02),
        "law": lambda state: software.function("law_init")(state, 0.02),
        "limiter": lambda state: software.function("limiter_init")(state, 0.02),
        "e2e_receiver": software.function("e2e_receiver_init"),
        "supervision": software.function("supervision_init"),
        "task": lambda state: software.function("task_init")(state, parameters),
    }
    if law_of(config_of(built)).uses_reference_model:
        firsts["reference_model"] = lambda state: software.function("reference_model_start")(state, 20.0, 0.1, 0.02)
        firsts["grip"] = software.function("grip_init")
    for name, first in firsts.items():
        left = []
        for byte in FILL_BYTES:
            state = software.new(name)
            ffi.memmove(state, bytes([byte]) * ffi.sizeof(state[0]), ffi.sizeof(state[0]))
            first(state)
            left.append(values_of(ffi, state[0]))
        assert all(one == left[0] for one in left), name
    task = software.new("task")
    ffi.memmove(task, b"\xff" * ffi.sizeof(task[0]), ffi.sizeof(task[0]))
    software.function("task_init")(task, parameters)
    zero = ("counter", "conditions_close", "has_measured", "samples_without_angle", "cycles", "late_cycles", "early_cycles")
    zero += ("lost_samples", "backlog", "disturbance", "actuator_samples", "inhibited_samples", "expected_angle")
    zero += ("start_angle", "stuck_angle", "deviates", "released", "angle_offset", "waited_samples", "is_stuck")
    assert not any(getattr(task, field) for field in zero)
    assert not task.conditions.inhibit
    for signals, fields in (("motion", ("speed", "front_angle", "yaw_rate")), ("conditions", ("rear_angle", "friction"))):
        assert all(math.isnan(getattr(getattr(task, signals), field)) for field in fields)
    assert task.parameters == parameters
    controller = software.controller(0.0)
    assert values_of(ffi, task.controller) == values_of(ffi, controller.state[0]), "starts without an angle until one is known"


def check_state_after_init(built: Built) -> None:
    """Check the state that the header describes: the angle, standby, zero counts, no reference, no speed."""
    nowhere = built.software.controller(math.nan).state
    assert nowhere.rear_angle == nowhere.limiter.rear_angle == 0.0, "NaN becomes zero"
    most = float(built.real(config_of(built).rear_actuator.angle_max))
    for side in (1.0, -1.0):
        for beyond in (0.9, 3.0):
            assert built.software.controller(side * beyond).state.rear_angle == side * most, "beyond the actuator's limit"
    state = built.software.controller(0.02).state
    assert state.rear_angle == float(built.real(0.02)) == state.limiter.rear_angle
    assert (state.yaw_rate_reference, state.status, state.enabled) == (0.0, Status.STANDBY, False)
    for name in ("speed", "front_angle", "yaw_rate"):
        signal = getattr(state.inputs, name)
        assert (signal.value, signal.missing, signal.good, signal.source) == (0.0, 0, 4_000, 1), "the first sample is trusted"
    assert (state.inputs.expected_yaw_rate, state.inputs.least, state.inputs.friction) == (0.0, 0.0, 2.0)
    inputs = state.inputs
    assert {inputs.least_of_front, inputs.yaw_rate_offset, inputs.beyond_linear, state.sample.lateral_acceleration} == {0.0}
    assert not (inputs.lateral_is_known or inputs.lateral_is_proven)
    assert state.initialised == INITIALISED
    held = state.sample
    assert (held.speed, held.front_angle, held.yaw_rate, held.friction, held.inhibit) == (0.0, 0.0, 0.0, 0.0, True)
    assert (state.limiter.speed, state.limiter.front_angle, state.limiter.speed_known) == (0.0, 0.0, False)
    receiver = built.software.new("e2e_receiver")
    built.software.ffi.memmove(receiver, b"\xff" * 5, 5)
    built.software.function("e2e_receiver_init")(receiver)
    # AUTOSAR FO R20-11, PRS_E2EProtocol, table of E2E_P01CheckStateType: values after initialisation.
    assert (receiver.last_counter, receiver.max_delta_counter, receiver.sync_counter) == (0, 0, 0)
    assert (receiver.no_new_or_repeated_data_counter, receiver.waits_for_first) == (0, True)
    limiter = built.software.new("limiter")
    for start, held in ((1.0, 1.0), (-1.0, -1.0), (built.next(1.0, 2.0), 0.0), (built.next(-1.0, -2.0), 0.0), (math.nan, 0.0)):
        built.software.function("limiter_init")(limiter, start)
        assert limiter.rear_angle == held, start


def check_unsound_memory(built: Built) -> None:
    """Check that uninitialised memory and memory with a NaN start from the measured angle, in the fail-safe."""
    software, ffi = built.software, built.software.ffi
    good, needed = built.turn(0.01, speed=30.0, rear_angle=0.01), software.parameters().inputs.recovery_samples
    assert needed > 1
    sound = software.controller(0.0, parameters_of(built, STILL))
    sound.run([good] * 3)
    before = bytes(ffi.buffer(sound.state))
    numbers = [*numbers_in(ffi, sound.state)]
    spoiled = [(number, value) for number in numbers for value in (math.nan, math.inf, -math.inf, 1.004e6)]
    ffi.memmove(sound.state, before, len(before))
    # In single precision the other squares are below its resolution, so the sum is the bound itself.
    sound.state.yaw_rate_error = 1e6 if built.eps > 1e-9 else 999_999.0
    assert sound.step(good).status is not Status.FAIL_SAFE, "within the bound"
    for case in [*spoiled, 0x00, 0xFF]:
        ffi.memmove(sound.state, before if isinstance(case, tuple) else bytes([case]) * len(before), len(before))
        if isinstance(case, tuple):
            (*structs, name), value = case
            setattr(functools.reduce(getattr, structs, sound.state), name, value)
        commands = sound.run([good] * (needed + 1))
        assert {command.status for command in commands[: needed - 1]} == {Status.FAIL_SAFE}, case
        fallen = sound.parameters.fail_safe_rate * config_of(built).controller.sampling_time_s
        assert abs(commands[0].rear_angle - (0.01 - fallen)) <= built.eps * 0.01, case
        assert commands[-1].status in (Status.TRACKING, Status.LIMITED), case
    # Without a measured angle it starts from the last command, if that is one.
    for name, value, measured, starts_at in (
        ("yaw_rate_error", math.nan, math.nan, 0.01),
        ("yaw_rate_error", math.nan, 10.0, 0.01),
        ("yaw_rate_error", math.nan, -10.0, 0.01),
        ("rear_angle", 1.004e6, math.nan, 0.0),
        ("rear_angle", -1.004e6, math.nan, 0.0),
        ("initialised", 0, math.nan, 0.0),
    ):
        ffi.memmove(sound.state, before, len(before))
        sound.state.rear_angle = sound.state.limiter.rear_angle = 0.01
        setattr(sound.state, name, value)
        found = sound.step(replace(good, rear_angle=measured)).rear_angle
        assert abs(found - max(starts_at - fallen, 0.0)) <= built.eps * 0.01, (name, value, measured)


REWRITTEN = (("yaw_rate_reference",), ("limiter", "speed"), ("limiter", "front_angle"))
"""Numbers that each step writes before it reads them."""


def numbers_in(ffi: Any, struct: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the paths of the numbers in a state, except those that each step recomputes."""
    for name, field in ffi.typeof(struct).fields if path else ffi.typeof(struct).item.fields:
        if field.type.cname in ("float", "double") and (*path, name) not in REWRITTEN:
            yield (*path, name)
        elif field.type.kind == "struct" and name != "sample":
            yield from numbers_in(ffi, getattr(struct, name), (*path, name))


def check_yaw_rate_error(built: Built) -> None:
    """Check the yaw rate error for measurement: reference minus measured yaw rate while control is on, held with the command,
    zero while control is off."""
    real, parameters = built.software.real, parameters_of(built, {"inputs": OPEN})
    controller = built.software.controller(0.0, parameters)
    assert controller.state.yaw_rate_error == 0.0
    for measured in (0.05, -0.03):
        command = controller.step(Measurement(15.0, 0.07, measured))
        assert controller.state.yaw_rate_error == float(real(command.yaw_rate_reference) - real(measured)) != 0.0
    kept = controller.state.yaw_rate_error
    assert controller.step(LOST).status is Status.DEGRADED
    assert controller.state.yaw_rate_error == kept
    while controller.step(LOST).status is not Status.FAIL_SAFE:
        pass
    assert controller.state.yaw_rate_error == 0.0
    slow = built.software.controller(0.0, parameters)
    slow.step(Measurement(15.0, 0.07, 0.05))
    assert slow.state.yaw_rate_error != 0.0
    stopped = slow.step(Measurement(0.0, 0.07, 0.0)).status
    assert (stopped is Status.STANDBY) == config_of(built).controller.waits_for_speed
    assert slow.state.yaw_rate_error == 0.0


def statuses_of(built: Built, parameters: Any, measurements: list[tuple[Measurement, int]], start: float = 0.0) -> Any:
    """Return the status after each sample, (n,), for runs of one measurement each."""
    software, ffi = built.software, built.software.ffi
    controller = software.controller(start, parameters)
    found = []
    for measurement, count in measurements:
        samples, commands = (ffi.new(f"{software.prefix}_{name}_t[]", count) for name in ("measurement", "command"))
        one = software.new("measurement")
        built.software.fill(one, measurement)
        ffi.memmove(samples, ffi.buffer(one)[:] * count, ffi.sizeof(samples))
        software.compiled.lib.loop_controller(controller.state, parameters, samples, commands, count)
        offset, size = ffi.offsetof(ffi.typeof(commands).item, "status"), ffi.sizeof(ffi.typeof(commands).item)
        rows = np.frombuffer(ffi.buffer(commands), dtype=np.uint8).reshape(count, size)
        found.append(rows[:, offset : offset + 4].copy().view(np.int32)[:, 0])
    return np.concatenate(found)


def check_counts(built: Built) -> None:
    """Check that every count acts exactly at its limit, however large, and then stays there."""
    good = Measurement(15.0, 0.0, 0.0)
    for most in (0, 1, 100):
        parameters = parameters_of(built, {"inputs": {"missing_samples_max": most}})
        found = statuses_of(built, parameters, [(good, 1), (LOST, most + 5)])[1:]
        assert (found[:most] == Status.DEGRADED).all(), most
        assert (found[most:] == Status.FAIL_SAFE).all(), most
    for needed in (1, 2, 255, 256, 4_000):
        parameters = parameters_of(built, {"inputs": {"recovery_samples": needed}})
        found = statuses_of(built, parameters, [(LOST, 5), (good, needed + 1)])[5:]
        assert (found[: needed - 1] == Status.FAIL_SAFE).all(), needed
        assert (found[needed - 1 :] <= Status.LIMITED).all(), needed


def check_counts_stay_at_their_end(built: Built) -> None:
    """Check that a count stops one above its limit, so that a long fault clears as fast as a short one."""
    controller = built.software.controller(0.0)
    p, good = controller.parameters, Measurement(15.0, 0.0, 0.0)
    most, signals = p.inputs.missing_samples_max, controller.state.inputs
    controller.run([good] + [LOST] * (3 * most + 5))
    assert signals.speed.missing == signals.front_angle.missing == signals.yaw_rate.missing == most + 1
    controller.run([good] * p.inputs.recovery_samples)
    assert signals.speed.missing == signals.front_angle.missing == signals.yaw_rate.missing == 0
    controller.run([LOST, good])
    assert signals.yaw_rate.missing == 0, "not below zero"
    controller.run([*[LOST] * most, good])
    assert signals.yaw_rate.missing == max(most - 2, 0), "a good sample subtracts two"

"""States of an FMU saved, restored and carried as bytes; several instances; refused calls and their messages."""

from __future__ import annotations

import math
from ctypes import byref, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p, create_string_buffer

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from codegen.export.fmu.standard import Version
from codegen.export.fmu.variables import What
from tests.export.fmus import SAMPLE, STEP, Made, Slave, made

each_version = pytest.mark.parametrize("version", ["2", "3"])
OK, DISCARD, ERROR = 0, 2, 3
"""Of fmi2Status and fmi3Status alike."""

TURN = {"speed_m_s": 25.0, "steering_wheel_command_rad": 0.6}
MIDDLE = 57
"""Plant steps, between two samples of the controller."""


def turning(made: Made, steps: int, name: str = "one") -> Slave:
    slave = Slave(made, name).start(TURN)
    for _ in range(steps):
        slave.step(STEP)
    return slave


def go_on(slave: Slave, steps: int = 400) -> np.ndarray:
    rows = []
    for k in range(steps):
        if k == 100:
            slave.set({"steering_wheel_command_rad": -0.9, "friction": 0.7})
        slave.step(STEP)
        rows.append(slave.row())
    return np.array(rows)


@each_version
def test_a_run_continues_from_a_saved_state_with_the_same_bits(version: Version) -> None:
    """In the same instance, and in another one to which the state goes as bytes."""
    slave = turning(made("loop", version), MIDDLE)
    state, time = slave.state(), slave.time
    content = slave.to_bytes(state)
    first = go_on(slave)
    slave.restore(state, time)
    assert slave.get("time_s") == MIDDLE * STEP
    assert slave.to_bytes(slave.state()) == content == slave.to_bytes(state)
    assert np.array_equal(go_on(slave), first)
    other = Slave(made("loop", version), "other")
    carried = other.from_bytes(content)
    other.restore(carried, time)  # the initialization is behind it with the state
    assert np.array_equal(go_on(other), first)
    other.free_state(carried)
    slave.free_state(state)
    slave.close()
    other.close()


@each_version
@pytest.mark.parametrize("what", ["plant", "controller"])
def test_parts_restore_too(what: What, version: Version) -> None:
    slave = Slave(made(what, version)).start({"speed_m_s": 20.0})
    name = "steering_wheel_command_rad" if what == "plant" else "front_angle_rad"
    outputs = [v.name for v in slave.made.description.modelVariables if v.causality == "output"]

    def drive() -> list[list[float]]:
        rows = []
        for k in range(20):
            slave.set({name: 0.01 * k})
            slave.step(SAMPLE)
            rows.append(slave.row(outputs))
        return rows

    drive()
    state, time = slave.state(), slave.time
    first = drive()
    slave.restore(state, time)
    assert drive() == first
    slave.free_state(state)
    slave.close()


@each_version
def test_a_state_that_is_none_is_refused(version: Version) -> None:
    slave = turning(made("loop", version), MIDDLE)
    state = slave.state()
    content = slave.to_bytes(state)
    before = slave.row()
    plant = Slave(made("plant", version)).start()
    foreign = plant.to_bytes(plant.state())
    bad = [content[:-1], content + b"\0", b"", content[:200] + bytes([content[200] ^ 1]) + content[201:], foreign]
    for damaged in bad:
        with pytest.raises(FMICallException):
            slave.from_bytes(damaged)
        assert "the bytes are no state of this FMU" in slave.messages.pop()
    assert slave.row() == before
    plant.close()
    slave.close()


@each_version
def test_two_instances_know_nothing_of_each_other(version: Version) -> None:
    alone = turning(made("loop", version), 0)
    wanted = go_on(alone)
    one, two = turning(made("loop", version), 0, "one"), Slave(made("loop", version), "two")
    two.start({"speed_m_s": 33.0, "friction": 0.4, "parameters.lead_time": 0.2})
    got = []
    for k in range(len(wanted)):
        if k == 100:
            one.set({"steering_wheel_command_rad": -0.9, "friction": 0.7})
        two.set({"steering_wheel_command_rad": math.sin(0.05 * k), "inhibit": k % 7 == 0})
        two.step(STEP)
        one.step(STEP)
        got.append(one.row())
    assert np.array_equal(got, wanted)
    for slave in (alone, one, two):
        slave.close()


@each_version
def test_after_a_reset_it_is_as_new(version: Version) -> None:
    slave = turning(made("loop", version), 0)
    first = go_on(slave)
    slave.set({"parameters.rear_angle_max": 0.03, "inhibit": True})
    slave.fmu.terminate()
    slave.fmu.reset()
    slave.start(TURN)
    assert np.array_equal(go_on(slave), first)
    slave.close()


@each_version
def test_a_start_that_is_not_zero(version: Version) -> None:
    from_zero = go_on(turning(made("loop", version), 0))
    slave = Slave(made("loop", version)).start(TURN, start=-3.7, stop=-3.3)
    assert np.array_equal(go_on(slave), from_zero)
    with pytest.raises(FMICallException):
        slave.step(STEP)
    assert "after the stop time" in slave.messages[-1]
    slave.close()


NO_MULTIPLE = "no whole multiple of 0.001 s"


@each_version
def test_a_step_that_cannot_be_is_refused_and_not_done(version: Version) -> None:
    slave = Slave(made("loop", version)).start(TURN)
    before = slave.row()
    cases = [(0.0, size, NO_MULTIPLE) for size in (0.0105, 0.0004, 0.0, -0.001, math.nan, math.inf)]
    cases += [(time, STEP, f"the step begins at {time} s, and the time is 0 s") for time in (0.001, -0.001)]
    for time, size, message in [*cases, (math.nan, STEP, "and the time is 0 s")]:
        with pytest.raises(FMICallException):
            slave.fmu.doStep(time, size)
        assert message in slave.messages[-1]
        assert slave.get("time_s") == 0.0
        assert slave.row() == before
    slave.fmu.doStep(0.0, STEP)  # and it goes on
    slave.close()
    controller = Slave(made("controller", version)).start()
    with pytest.raises(FMICallException):
        controller.step(STEP)
    assert controller.messages == ["a step of 0.001 s is no whole multiple of 0.01 s"]
    controller.close()


@each_version
def test_times_that_were_added_up_are_taken(version: Version) -> None:
    slave = Slave(made("plant", version)).start(TURN)
    time = 0.0
    for _ in range(3000):
        slave.fmu.doStep(time, STEP)
        time += STEP
    assert time != 3000 * STEP  # what adding up makes of it
    assert slave.get("time_s") == pytest.approx(3.0, abs=1e-12)
    slave.close()


INVALID = {
    "parameters.rear_angle_max = nan is not a number": {"parameters.rear_angle_max": math.nan},
    "parameters.rear_angle_max = 2 is out of range": {"parameters.rear_angle_max": 2.0},
    "parameters.limiter.opposite_phase_speed[2] = 100 is out of": {"parameters.limiter.opposite_phase_speed[2]": 100.0},
    "_speed = ": {"parameters.disable_speed": 6.0, "parameters.enable_speed": 5.5},
    "parameters.wheelbase = -1 is out of range": {"parameters.trim_share": 0.01, "parameters.wheelbase": -1.0},
    "parameters.recovery_samples = 0 is out of range": {"parameters.recovery_samples": 0},
}


@pytest.mark.parametrize("what", ["controller", "loop"])
@each_version
def test_parameters_that_are_not_valid_stop_the_step(version: Version, what: What) -> None:
    slave = Slave(made(what, version)).start({"speed_m_s": 20.0})
    slave.step(SAMPLE)
    state = slave.state()
    for message, changes in INVALID.items():
        with pytest.raises(FMICallException):
            (slave.set(changes), slave.step(SAMPLE))
        assert message in slave.messages[-1]
        assert "\n" not in slave.messages[-1]
        assert slave.get("time_s") == SAMPLE  # no sample was taken
        slave.restore(state, SAMPLE)
    slave.step(SAMPLE)
    slave.free_state(state)
    slave.close()
    fresh = Slave(made("loop", version))
    with pytest.raises(FMICallException):
        fresh.start({"parameters.friction_min": 0.0})
    assert "parameters.friction_min" in fresh.messages[-1]
    fresh.close()


@each_version
def test_values_that_are_none_are_refused(version: Version) -> None:
    slave = Slave(made("loop", version)).start(TURN)
    cases = {
        "speed_m_s": (math.nan, math.inf, -0.1, 151.0),
        "friction": (math.nan, -0.1, 2.1),
        "friction_estimate": (math.nan, -math.inf),
        "yaw_rate_rad_s": (0.1,),
        "time_s": (1.0,),
        "parameters.recovery_samples": (-1, 65536),
    }
    for name, values in cases.items():
        before = slave.get(name)
        for value in values:
            with pytest.raises(FMICallException):
                slave.set({name: value})
            assert name in slave.messages[-1]
            assert slave.get(name) == before
    slave.close()


@each_version
def test_null_and_wrong_references_are_errors(version: Version) -> None:
    slave = Slave(made("loop", version)).start(TURN)
    me = c_void_p(slave.fmu.component)
    real, whole = ("Real", "Integer") if version == "2" else ("Float64", "Int32")
    sizes = () if version == "2" else (c_size_t(1),)
    value, count = c_double(1.0), c_size_t(1)
    for reference in (len(slave.variables), 2**32 - 1):
        for direction in ("Get", "Set"):
            arguments = (byref(c_uint(reference)), count, byref(value), *sizes)
            assert slave.call(direction + real, me, *arguments) == ERROR
            assert "value reference" in slave.messages[-1]
            assert slave.call(direction + whole, me, byref(c_uint(1)), count, byref(value), *sizes) == ERROR
            assert "speed_m_s is of another type" in slave.messages[-1]
            assert slave.call(direction + real, None, *arguments) == ERROR
            assert slave.call(direction + real, me, None, count, byref(value), *sizes) == ERROR
            assert slave.call(direction + real, me, byref(c_uint(1)), count, None, *sizes) == ERROR
            assert slave.call(direction + real, me, None, c_size_t(0), None, *(c_size_t(0) for _ in sizes)) == OK
            if sizes:
                assert slave.call(direction + real, me, byref(c_uint(1)), count, byref(value), c_size_t(2)) == ERROR
    state = "FMUstate" if version == "2" else "FMUState"
    for name in (f"Get{state}", f"Set{state}"):
        assert slave.call(name, me, None) == ERROR
        assert slave.call(name, None, None) == ERROR
    assert slave.call(f"Serialized{state}Size", me, None, None) == ERROR
    assert slave.call(f"Serialize{state}", me, None, create_string_buffer(4), c_size_t(4)) == ERROR
    assert slave.get("speed_m_s") == TURN["speed_m_s"]
    slave.close()


def test_fmi_2_discards_optional_status_requests() -> None:
    slave = Slave(made("plant", "2")).start(TURN)
    slave.step(SAMPLE)
    me, time, truth, number = c_void_p(slave.fmu.component), c_double(), c_int(7), c_int()
    terminated, last_time, do_step = 3, 2, 0
    assert slave.call("GetRealStatus", me, last_time, byref(time)) == OK
    assert time.value == SAMPLE
    assert slave.call("GetBooleanStatus", me, terminated, byref(truth)) == OK
    assert truth.value == 0
    assert slave.call("GetStatus", me, do_step, byref(number)) == DISCARD
    assert slave.call("GetIntegerStatus", me, do_step, byref(number)) == DISCARD
    assert slave.call("GetStringStatus", me, 1, byref(c_char_p())) == DISCARD
    assert slave.call("GetRealStatus", me, do_step, byref(time)) == DISCARD
    assert slave.call("GetRealStatus", me, last_time, None) == ERROR
    assert slave.call("CancelStep", me) == ERROR
    assert slave.call("SetRealInputDerivatives", me, None, c_size_t(0), None, None) == ERROR
    assert slave.call("GetDirectionalDerivative", me, None, c_size_t(0), None, c_size_t(0), None, None) == ERROR
    slave.close()


@each_version
def test_another_token_or_no_name_makes_no_instance(version: Version) -> None:
    known = made("plant", version)
    slave = Slave(known)
    for attribute, value in (("guid", "0" * 64), ("instanceName", "")):
        good = getattr(slave.fmu, attribute)
        setattr(slave.fmu, attribute, value)
        with pytest.raises(Exception, match="Failed to instantiate"):
            slave.fmu.instantiate()
        setattr(slave.fmu, attribute, good)


@each_version
def test_what_is_called_out_of_turn_is_refused(version: Version) -> None:
    slave = Slave(made("controller", version))
    with pytest.raises(FMICallException):
        slave.step(SAMPLE)
    with pytest.raises(FMICallException):
        slave.fmu.exitInitializationMode()
    with pytest.raises(FMICallException):
        slave.fmu.terminate()
    slave.start({"initial_rear_angle_rad": 0.01})
    assert slave.get("rear_angle_command_rad") == 0.01
    with pytest.raises(FMICallException):
        slave.set({"initial_rear_angle_rad": 0.02})
    with pytest.raises(FMICallException):
        slave.fmu.enterInitializationMode()
    slave.fmu.terminate()
    with pytest.raises(FMICallException):
        slave.step(SAMPLE)
    assert slave.get("rear_angle_command_rad") == 0.01  # the last values stay readable
    assert len(slave.messages) == 6
    slave.close()

"""States of an FMU saved, restored and serialised; several instances; rejected calls and their messages."""

import math
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from fmpy.fmi1 import FMICallException

from codegen.export.fmu.variables import Version, What
from codegen.sil.toolchain import compiler_command
from tests.export.fmus import SAMPLE, STEP, Slave, listed_sources, made

each_version = pytest.mark.parametrize("version", ["2", "3"])
TURN = {"speed_m_s": 25.0, "steering_wheel_command_rad": 0.6}
MIDDLE = 57
"""Plant steps, between two samples of the controller."""


def refused(slave: Slave, call: Callable[..., object], *arguments: object) -> str:
    """Check that a call fails and return the message that it logs."""
    with pytest.raises(FMICallException):
        call(*arguments)
    return slave.messages[-1]


def continue_run(slave: Slave, other: Slave | None = None) -> list[list[float]]:
    rows = []
    for k in range(400):
        if k == 100:
            slave.set({"steering_wheel_command_rad": -0.9, "friction": 0.7})
        if other:
            other.set({"steering_wheel_command_rad": math.sin(0.05 * k), "inhibit": k % 7 == 0})
            other.step(STEP)
        slave.step(STEP)
        rows.append(slave.row())
    return rows


@each_version
@pytest.mark.parametrize(
    ("what", "name"),
    [("loop", "steering_wheel_command_rad"), ("plant", "steering_wheel_command_rad"), ("controller", "front_angle_rad")],
)
def test_a_run_continues_from_a_saved_state_with_the_same_bits(what: What, name: str, version: Version) -> None:
    """The state is restored in the same instance, and serialised into another one."""
    step = SAMPLE if what == "controller" else STEP
    outputs = [v.name for v in made(what, version).description.modelVariables if v.causality == "output"]

    def drive(slave: Slave, steps: int) -> list[list[float]]:
        rows = []
        for k in range(steps):
            slave.set({name: 0.01 * (k % 40)})
            slave.step(step)
            rows.append(slave.row(outputs))
        return rows

    slave = Slave(made(what, version)).start({"speed_m_s": 20.0})
    drive(slave, MIDDLE)
    state, time = slave.fmu.getFMUState(), slave.time
    content = bytes(slave.fmu.serializeFMUState(state))
    first = drive(slave, 150)
    slave.restore(state, time)
    assert slave.get("time_s") == MIDDLE * step
    assert bytes(slave.fmu.serializeFMUState(slave.fmu.getFMUState())) == content
    assert drive(slave, 150) == first
    other = Slave(made(what, version), "other")
    other.restore(other.fmu.deserializeFMUState(content), time)  # the state includes the initialisation
    assert drive(other, 150) == first


@each_version
def test_an_invalid_state_is_rejected(version: Version) -> None:
    slave, plant = (Slave(made(what, version)).start() for what in ("loop", "plant"))
    slave.step(STEP)
    content, foreign = (bytes(each.fmu.serializeFMUState(each.fmu.getFMUState())) for each in (slave, plant))
    before = slave.row()
    bad = [content[:-1], content + b"\0", b"", content[:200] + bytes([content[200] ^ 1]) + content[201:], foreign]
    for damaged in bad:
        assert "the bytes are no state of this FMU" in refused(slave, slave.fmu.deserializeFMUState, damaged)
        slave.messages.clear()
    assert slave.row() == before


@each_version
def test_instances_are_independent_and_reset_completely(version: Version) -> None:
    alone, one, two = (Slave(made("loop", version), name) for name in ("alone", "one", "two"))
    wanted = continue_run(alone.start(TURN))
    one.start(TURN)
    two.start({"speed_m_s": 33.0, "friction": 0.4, "parameters.lead_smoothing": 0.2})
    assert continue_run(one, two) == wanted
    one.set({"parameters.rear_angle_max": 0.03, "inhibit": True})
    one.fmu.terminate()
    one.fmu.reset()
    one.start(TURN, start=-3.7, stop=-3.3)
    assert continue_run(one) == wanted
    assert "after the stop time" in refused(one, one.step, STEP)


NO_MULTIPLE = "no whole multiple of 0.001 s"


@each_version
def test_an_impossible_step_is_rejected_and_not_executed(version: Version) -> None:
    slave = Slave(made("loop", version)).start(TURN)
    before = slave.row()
    cases = [(0.0, size, NO_MULTIPLE) for size in (0.0105, 0.0004, 0.0, -0.001, math.nan, math.inf)]
    cases += [(time, STEP, f"the step begins at {time} s, and the time is 0 s") for time in (0.001, -0.001)]
    for time, size, message in [*cases, (math.nan, STEP, "and the time is 0 s")]:
        assert message in refused(slave, slave.fmu.doStep, time, size)
        assert slave.get("time_s") == 0.0
        assert slave.row() == before
    slave.fmu.doStep(0.0, STEP)  # it still works
    controller = Slave(made("controller", version)).start()
    assert refused(controller, controller.step, STEP) == "a step of 0.001 s is no whole multiple of 0.01 s"


@each_version
def test_accumulated_times_are_accepted(version: Version) -> None:
    slave, time = Slave(made("plant", version)).start(TURN), 0.0
    for _ in range(3000):
        slave.fmu.doStep(time, STEP)
        time += STEP
    assert time != 3000 * STEP  # rounding of the sum
    assert slave.get("time_s") == pytest.approx(3.0, abs=1e-12)


INVALID = {
    "parameters.rear_angle_max = nan is not a number": {"parameters.rear_angle_max": math.nan},
    "parameters.limiter.opposite_phase_speed[2] = 100 is out of": {"parameters.limiter.opposite_phase_speed[2]": 100.0},
    "_speed = ": {"parameters.slow_speed": 8.5},
    "parameters.inputs.recovery_samples = 0 is out of range": {"parameters.inputs.recovery_samples": 0},
}


@pytest.mark.parametrize("what", ["controller", "loop"])
@each_version
def test_parameters_that_are_not_valid_stop_the_step(version: Version, what: What) -> None:
    slave = Slave(made(what, version)).start({"speed_m_s": 20.0})
    state = slave.fmu.getFMUState()
    for message, changes in INVALID.items():
        found = refused(slave, lambda changes=changes: (slave.set(changes), slave.step(SAMPLE)))
        assert message in found and "\n" not in found
        assert slave.get("time_s") == 0.0  # no sample was taken
        slave.restore(state, 0.0)
    slave.step(SAMPLE)
    fresh = Slave(made(what, version))
    assert "parameters.friction_min" in refused(fresh, fresh.start, {"parameters.friction_min": 0.0})


@each_version
def test_invalid_values_are_rejected(version: Version) -> None:
    slave = Slave(made("loop", version)).start(TURN)
    cases = {
        "speed_m_s": (math.nan, math.inf, -0.1, 151.0),
        "friction": (math.nan, -0.1, 2.1),
        "friction_estimate": (math.nan, -math.inf),
        "yaw_rate_rad_s": (0.1,),
        "time_s": (1.0,),
        "parameters.inputs.recovery_samples": (-1, 65536),
    }
    for name, values in cases.items():
        before = slave.get(name)
        for value in values:
            assert name in refused(slave, slave.set, {name: value})
            assert slave.get(name) == before


def misuse(version: Version, folder: Path, *flags: str) -> subprocess.CompletedProcess[str]:
    """Compile and run misuse.c with an FMU's sources; it calls every function with wrong arguments."""
    known, program = made("loop", version), folder / "misuse"
    options = [*flags, "-std=c99", "-Wall", "-Werror", "-I.", f"-DFMI={version}"]
    sources = [*listed_sources(known), Path(__file__).with_name("misuse.c")]
    command = [*compiler_command(), *options, *sources, "-o", program, "-lm"]
    subprocess.run(command, cwd=known.folder / "sources", check=True)
    return subprocess.run([program, known.fmu.token], capture_output=True, text=True, check=False)


@each_version
def test_a_misbehaving_simulator_gets_errors(version: Version, tmp_path: Path) -> None:
    answer = misuse(version, tmp_path)
    assert answer.returncode == 0, answer.stderr


@each_version
def test_calls_out_of_order_are_rejected(version: Version) -> None:
    slave = Slave(made("controller", version))
    for call in (lambda: slave.step(SAMPLE), slave.fmu.exitInitializationMode, slave.fmu.terminate):
        refused(slave, call)
    slave.start({"initial_rear_angle_rad": 0.01})
    refused(slave, slave.set, {"initial_rear_angle_rad": 0.02})
    refused(slave, slave.fmu.enterInitializationMode)
    slave.fmu.terminate()
    refused(slave, slave.step, SAMPLE)
    assert slave.get("rear_angle_command_rad") == 0.01  # the last values stay readable
    assert len(slave.messages) == 6

"""FMUs run in fmpy against the software in the loop: the bits must be the same, so no difference here has a tolerance."""

from __future__ import annotations

from collections.abc import Callable

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from codegen.export.fmu.standard import Version
from codegen.export.fmu.variables import What
from codegen.sil.software import Measurement
from tests.export import fmus
from tests.export.fmus import OUTPUTS, SAMPLE, STEP, STEPS_PER_SAMPLE, Made, Slave, column

Maker = Callable[[str, What, Version], Made]

KINDS = ("pi", "tracking")
VERSIONS: tuple[Version, ...] = ("2", "3")
SCENARIOS = ("step-steer", "sine-with-dwell")
COMMANDS = ("rear_angle_command_rad", "yaw_rate_reference_rad_s", "status")
MOTION = tuple(name for name in OUTPUTS if name not in COMMANDS)

each_version = pytest.mark.parametrize("version", VERSIONS)
each_kind = pytest.mark.parametrize("kind", KINDS)
each_scenario = pytest.mark.parametrize("scenario", SCENARIOS)


def expected(kind: str, scenario: str, names: tuple[str, ...] = OUTPUTS, *, held: bool = False) -> np.ndarray:
    record = fmus.recorded(kind, scenario, held=held)
    return np.stack([column(record, name) for name in names], axis=1)


def table(rows: np.ndarray, interval: float, names: tuple[str, ...]) -> np.ndarray:
    """Inputs as fmpy takes them, a row every `interval`."""
    columns = [("time", np.float64), *((name, np.bool_ if name in BOOLEANS else np.float64) for name in names)]
    given = np.zeros(len(rows), dtype=columns)
    given["time"] = np.arange(len(rows)) * interval
    for k, name in enumerate(names):
        given[name] = rows[:, k]
    return given


BOOLEANS = ("inhibit", "friction_estimate_available", "friction_available", "rear_angle_available")


def simulate(made: Made, given: np.ndarray, interval: float, output: tuple[str, ...]) -> np.ndarray:
    """A whole run by `simulate_fmu`: a row at 0 and one after each step."""
    result = fmpy.simulate_fmu(
        str(made.folder), stop_time=len(given) * interval, output_interval=interval, input=given, output=output
    )
    return np.stack([np.asarray(result[name], dtype=np.float64) for name in output], axis=1)


@pytest.mark.parametrize("what", ["controller", "plant", "loop"])
@each_version
@each_kind
def test_there_is_nothing_to_criticise(made: Maker, kind: str, what: What, version: Version) -> None:
    assert validate_fmu(str(made(kind, what, version).path)) == []


@each_scenario
@each_version
@each_kind
def test_the_loop_is_the_sil_at_the_step_of_the_plant(made: Maker, kind: str, version: Version, scenario: str) -> None:
    slave = Slave(made(kind, "loop", version)).start()
    got = fmus.drive(slave, fmus.inputs(kind, scenario), STEP)
    slave.close()
    wanted = expected(kind, scenario)
    assert np.ptp(wanted[:, OUTPUTS.index("rear_angle_rad")]) > 0.01  # rad: the controller is at work
    assert np.array_equal(got, wanted)


@each_scenario
@each_version
@each_kind
def test_the_loop_holds_its_inputs_over_a_longer_step(made: Maker, kind: str, version: Version, scenario: str) -> None:
    slave = Slave(made(kind, "loop", version)).start()
    got = fmus.drive(slave, fmus.inputs(kind, scenario, held=True), SAMPLE)
    slave.close()
    assert np.array_equal(got, expected(kind, scenario, held=True))


@each_scenario
@each_version
@each_kind
def test_the_loop_as_a_simulator_runs_it(made: Maker, kind: str, version: Version, scenario: str) -> None:
    rows = fmus.inputs(kind, scenario)
    names = ("speed_m_s", "steering_wheel_command_rad", "friction", "yaw_moment_n_m")
    given = table(rows[:, [0, 1, 2, 4]], STEP, names)
    got = simulate(made(kind, "loop", version), given, STEP, OUTPUTS)
    # The columns of these inputs do not jump but for the steering wheel, which no output follows at once.
    assert np.array_equal(got[:-1:STEPS_PER_SAMPLE], expected(kind, scenario))


def measurements(record: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    names = ("speed_m_s", "front_angle_rad", "yaw_rate_rad_s", "rear_angle_rad")
    return np.stack([column(record, name) for name in names], axis=1), names


@each_scenario
@each_version
@each_kind
def test_the_controller_gives_the_commands_of_the_sil(made: Maker, kind: str, version: Version, scenario: str) -> None:
    rows, names = measurements(fmus.recorded(kind, scenario))
    got = simulate(made(kind, "controller", version), table(rows, SAMPLE, names), SAMPLE, COMMANDS)
    assert np.array_equal(got[1:], expected(kind, scenario, COMMANDS))
    assert list(got[0]) == [0.0, 0.0, 2.0]  # before the first sample: STANDBY


@each_scenario
@each_version
@each_kind
def test_the_plant_moves_as_the_car_of_the_sil(made: Maker, kind: str, version: Version, scenario: str) -> None:
    rows = fmus.inputs(kind, scenario)
    commands = np.repeat(column(fmus.recorded(kind, scenario), COMMANDS[0]), STEPS_PER_SAMPLE)
    names = ("speed_m_s", "steering_wheel_command_rad", "friction", "yaw_moment_n_m", "rear_angle_command_rad")
    given = table(np.column_stack([rows[:, [0, 1, 2, 4]], commands]), STEP, names)
    got = simulate(made(kind, "plant", version), given, STEP, MOTION)
    assert np.array_equal(got[:-1:STEPS_PER_SAMPLE], expected(kind, scenario, MOTION))


@each_version
@each_kind
def test_plant_and_controller_wired_together_are_the_loop(made: Maker, kind: str, version: Version) -> None:
    plant = Slave(made(kind, "plant", version)).start()
    controller = Slave(made(kind, "controller", version)).start()
    rows = fmus.inputs(kind, "sine-with-dwell", held=True)[::STEPS_PER_SAMPLE]
    seen = []
    for row in rows:
        driver = {name: value for name, value in fmus.loop_inputs(row).items() if name in plant.variables}
        plant.set({name: value for name, value in driver.items() if name != "inhibit"})
        moved = dict(zip(MOTION, plant.row(MOTION), strict=True))
        names = ("front_angle_rad", "yaw_rate_rad_s", "rear_angle_rad")
        controller.set({"speed_m_s": driver["speed_m_s"], **{name: moved[name] for name in names}})
        controller.step(SAMPLE)  # the command of a sample acts from the time of the sample
        command = dict(zip(COMMANDS, controller.row(COMMANDS), strict=True))
        plant.set({"rear_angle_command_rad": command["rear_angle_command_rad"]})
        plant.step(SAMPLE)
        seen.append([{**moved, **command}[name] for name in OUTPUTS])
    plant.close()
    controller.close()
    loop = Slave(made(kind, "loop", version)).start()
    assert np.array_equal(seen, fmus.drive(loop, fmus.inputs(kind, "sine-with-dwell", held=True), SAMPLE))
    loop.close()


@each_version
def test_a_parameter_that_is_tuned_in_a_run_does_what_it_does_in_the_controller(made: Maker, version: Version) -> None:
    rows, names = measurements(fmus.recorded("pi", "sine-with-dwell"))
    software = fmus.software("pi")
    slave, twin = Slave(made("pi", "controller", version)).start(), software.controller()
    got, wanted = [], []
    for k, row in enumerate(rows):
        if k == len(rows) // 3:
            slave.set({"parameters.integral_gain": 0.5, "parameters.recovery_samples": 7})
            twin.parameters.integral_gain, twin.parameters.recovery_samples = 0.5, 7
        slave.set(dict(zip(names, row, strict=True)))
        slave.step(SAMPLE)
        got.append(slave.row(COMMANDS))
        command = twin.step(Measurement(*row))
        wanted.append([command.rear_angle, command.yaw_rate_reference, float(command.status)])
    slave.close()
    assert np.array_equal(got, wanted)
    assert not np.array_equal(wanted, expected("pi", "sine-with-dwell", COMMANDS))  # the change is seen


@each_version
def test_what_is_not_available_is_nan_to_the_controller(made: Maker, version: Version) -> None:
    slave, twin = Slave(made("tracking", "controller", version)), fmus.software("tracking").controller(0.01)
    slave.start({"initial_rear_angle_rad": 0.01, "friction_available": True, "friction": 0.5, "speed_m_s": 15.0})
    slave.set({"front_angle_rad": 0.03, "rear_angle_available": False, "rear_angle_rad": 0.02})
    for friction in (0.5, float("nan")):
        slave.step(SAMPLE)
        command = twin.step(Measurement(15.0, 0.03, 0.0, friction=friction))
        assert slave.row(COMMANDS) == [command.rear_angle, command.yaw_rate_reference, float(command.status)]
        slave.set({"friction_available": False})
    slave.close()


@each_version
def test_several_samples_in_one_step_hold_the_measurement(made: Maker, version: Version) -> None:
    slave, twin = Slave(made("pi", "controller", version)).start(), fmus.software("pi").controller()
    slave.set({"speed_m_s": 20.0, "front_angle_rad": 0.02, "yaw_rate_rad_s": 0.05})
    slave.step(3 * SAMPLE)
    command = [twin.step(Measurement(20.0, 0.02, 0.05, 0.0)) for _ in range(3)][-1]
    assert slave.get("rear_angle_command_rad") == command.rear_angle
    assert slave.get("time_s") == pytest.approx(0.03, abs=1e-12)  # a sum of three, and a product, of binary fractions
    slave.close()


@each_version
@pytest.mark.parametrize("size", [STEP, SAMPLE])
def test_asking_for_outputs_changes_nothing(made: Maker, version: Version, size: float) -> None:
    rows = fmus.inputs("tracking", "sine-with-dwell", held=True)[:2500]
    asked, silent = (Slave(made("tracking", "loop", version), name).start() for name in ("asked", "silent"))
    wanted = fmus.drive(asked, rows, size)
    fmus.drive(silent, rows, size, ())
    assert asked.row() == silent.row()
    assert np.ptp(wanted) > 0.0
    asked.close()
    silent.close()

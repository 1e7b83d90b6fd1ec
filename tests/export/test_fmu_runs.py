"""FMUs run in fmpy and compared with the software in the loop, bit for bit, without tolerances.

These are one kind and one scenario; tests/evidence/toolchains runs the same tests with the others.
"""

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from codegen.export.fmu.variables import Version
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import Measurement
from tests.export import fmus
from tests.export.fmus import OUTPUTS, SAMPLE, STEP, STEPS_PER_SAMPLE, Slave, column, made

COMMANDS = ("rear_angle_command_rad", "yaw_rate_reference_rad_s", "status")
MOTION = tuple(name for name in OUTPUTS if name not in COMMANDS)
MEASURED = ("speed_m_s", "front_angle_rad", "yaw_rate_rad_s", "rear_angle_rad")
SENSED = ("rear_angle_rad", "lateral_acceleration_m_s2")
"""Outputs of the plant that it also has as its sensors measure them."""
one_run = pytest.mark.parametrize(("kind", "scenario"), [("tracking", "sine-with-dwell")])
each_version = pytest.mark.parametrize("version", ["2", "3"])


def expected(kind: str, scenario: str, names: tuple[str, ...] = OUTPUTS, *, held: bool = False) -> np.ndarray:
    record = fmus.recorded(kind, scenario, held=held)
    return np.stack([column(record, name) for name in names], axis=1)


@each_version
def test_fmpy_validates_the_files(version: Version) -> None:
    for what in ("controller", "plant", "loop"):
        assert validate_fmu(str(made(what, version).path)) == []


@one_run
@each_version
def test_the_loop_in_a_simulator(version: Version, kind: str, scenario: str) -> None:
    rows = fmus.inputs(kind, scenario)
    names = {"speed_m_s": 0, "steering_wheel_command_rad": 1, "friction": 2, "yaw_moment_n_m": 4}
    given = np.zeros(len(rows), dtype=[(name, np.float64) for name in ("time", *names)])
    given["time"] = np.arange(len(rows)) * STEP
    for name, number in names.items():
        given[name] = rows[:, number]
    folder, stop = str(made("loop", version, kind).folder), len(rows) * STEP
    result = fmpy.simulate_fmu(folder, stop_time=stop, output_interval=STEP, input=given, output=OUTPUTS)
    got = np.stack([np.asarray(result[name], dtype=np.float64) for name in OUTPUTS], axis=1)
    # These inputs are continuous except for the steering wheel, on which no output depends directly.
    wanted = expected(kind, scenario)
    assert np.array_equal(got[:-1:STEPS_PER_SAMPLE], wanted)
    assert np.ptp(wanted[:, OUTPUTS.index("rear_angle_rad")]) > 0.01  # rad: the controller is active
    silent = Slave(made("loop", version, kind)).start()
    fmus.drive(silent, rows, STEP, ())
    assert silent.row() == got[-1].tolist()  # reading outputs changes nothing


@one_run
@each_version
@pytest.mark.parametrize("side_by_side", [False, True])
def test_plant_and_controller_connected_equal_the_loop(version: Version, kind: str, scenario: str, side_by_side: bool) -> None:
    """The loop holds its inputs over a longer step, like the SIL with such inputs, and has the delay of its configuration.

    Stepped side by side, the plant gets the command of the last step, which is a delay of one sample; else there is none.
    """
    plant = Slave(made("plant", version, kind)).start()
    controller = Slave(made("controller", version, kind)).start()
    assert controller.row(COMMANDS) == [0.0, 0.0, 2.0]  # before the first sample: STANDBY
    rows = fmus.inputs(kind, scenario, held=True)
    seen = []
    for row in rows[::STEPS_PER_SAMPLE]:
        driver = {name: value for name, value in fmus.loop_inputs(row).items() if name in plant.variables}
        plant.set({name: value for name, value in driver.items() if name != "inhibit"})
        moved = dict(zip(MOTION, plant.row(MOTION), strict=True))
        measured = {name: {**driver, **moved}[name] for name in MEASURED}
        measured |= {name: plant.get(f"measured_{name}") for name in SENSED}
        controller.set({**measured, "lateral_acceleration_available": True})
        acting = controller.get("rear_angle_command_rad")
        controller.step(SAMPLE)  # the command of a sample acts from the time of the sample
        command = dict(zip(COMMANDS, controller.row(COMMANDS), strict=True))
        plant.set({"rear_angle_command_rad": acting if side_by_side else command["rear_angle_command_rad"]})
        plant.step(SAMPLE)
        seen.append([{**moved, **command}[name] for name in OUTPUTS])
    delay = int(side_by_side)
    record = ClosedLoop(fmus.software(kind), LoopOptions(delay_samples=delay)).run(rows)
    assert np.array_equal(seen, np.stack([column(record, name) for name in OUTPUTS], axis=1))
    loop = Slave(made("loop", version, kind)).start()
    got = fmus.drive(loop, rows, SAMPLE)
    assert np.array_equal(got, expected(kind, scenario, held=True))
    assert np.array_equal(seen, got) == (delay == fmus.software(kind).config.plant.command_delay_samples)


@each_version
def test_a_parameter_tuned_during_a_run_acts_as_in_the_controller(version: Version) -> None:
    rows = expected("tracking", "sine-with-dwell", MEASURED)
    software = fmus.software("tracking")
    slave, twin = Slave(made("controller", version)).start(), software.controller()
    got, wanted = [], []
    for k, row in enumerate(rows):
        if k == len(rows) // 3:
            slave.set({"parameters.lead_smoothing": 0.15, "parameters.inputs.recovery_samples": 7})
            twin.parameters.lead_smoothing, twin.parameters.inputs.recovery_samples = 0.15, 7
        slave.set(dict(zip(MEASURED, row, strict=True)))
        slave.step(SAMPLE)
        got.append(slave.row(COMMANDS))
        command = twin.step(Measurement(*row))
        wanted.append([command.rear_angle, command.yaw_rate_reference, float(command.status)])
    assert np.array_equal(got, wanted)
    assert not np.array_equal(wanted, expected("tracking", "sine-with-dwell", COMMANDS))  # the change has an effect


@each_version
def test_a_signal_that_is_not_available_is_nan_to_the_controller(version: Version) -> None:
    slave, twin = Slave(made("controller", version)), fmus.software("tracking").controller(0.01)
    slave.start({"initial_rear_angle_rad": 0.01, "friction_available": True, "friction": 0.5, "speed_m_s": 15.0})
    slave.set({"front_angle_rad": 0.03, "rear_angle_available": False, "rear_angle_rad": 0.02})
    for friction, samples in ((0.5, 1), (float("nan"), 3)):  # several samples in one step hold the measurement
        slave.step(samples * SAMPLE)
        command = [twin.step(Measurement(15.0, 0.03, 0.0, friction=friction)) for _ in range(samples)][-1]
        assert slave.row(COMMANDS) == [command.rear_angle, command.yaw_rate_reference, float(command.status)]
        slave.set({"friction_available": False})
    assert slave.get("time_s") == pytest.approx(0.04, abs=1e-12)  # a sum of binary fractions

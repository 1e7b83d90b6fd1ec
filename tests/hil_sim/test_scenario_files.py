"""The user's own scenarios: recordings and scenario files, and one line for whatever is wrong with them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from codegen import config as configuration
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.errors import CodegenError
from codegen.refmap.solve import solve_case
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.sil.software import Software, compile_build
from hil_sim import scenario_files
from hil_sim.faults import Fault
from hil_sim.metrics import evaluate
from hil_sim.recording import save_csv
from hil_sim.runs import run
from hil_sim.scenarios import find

CONFIG = configuration.preset()


@pytest.fixture(scope="module")
def software() -> Software:
    tables = {"grid": {"speed_points": 21, "front_angle_points": 20}, "controller": {"kind": "pi"}}
    config = configuration.parse(tables, "configuration of the test")
    folder = build(solve_case(config, "4ws-2"), config, BuildOptions("4ws2"), BuildInputs("4ws2.npz", "0" * 64, "map"))
    return compile_build(folder.files, folder.manifest)


def written(folder: Path, text: str, name: str = "mine.csv") -> str:
    path = folder / name
    path.write_text(text, encoding="utf-8", newline="")
    return str(path)


def refusal(name: str) -> str:
    """The one line with which a file is refused."""
    with pytest.raises(CodegenError) as caught:
        find(name, CONFIG).inputs(CONFIG)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2
    assert caught.value.remedy
    return str(caught.value)


# --- recordings --------------------------------------------------------------------------------------------------------


def test_own_recording_comes_out_as_it_went_in(software: Software, tmp_path: Path) -> None:
    first = run(software, find("step-steer"))
    save_csv(first, tmp_path / "run.csv")
    scenario = find(str(tmp_path / "run.csv"))
    again = run(software, scenario)
    assert again.shape == first.shape
    # The front angle passes the steering's lag of 5 ms a second time: behind by that much, 0.1 deg at 22.5 deg/s.
    np.testing.assert_allclose(again[:, 2], first[:, 2], atol=math.radians(0.15))
    np.testing.assert_allclose(again[-100:, 3], first[-100:, 3], rtol=1e-3)
    assert evaluate(scenario, software.config, {"controlled": again}).runs["controlled"]["controlled_percent"] == 100.0


def test_values_between_rows_are_linear_and_flags_are_held(tmp_path: Path) -> None:
    text = (
        "\ufeffnote,time_s,speed_m_s,steering_wheel_angle_rad,friction,friction_estimate,yaw_moment_n_m,inhibit\r\n"
        "a,100.0,10,0.0,0.9,,0,0\r\n"
        'b,100.1,20,1.0,0.5,nan,100,1\r\n"c, d",100.3,20,1.0,0.5,0.6,100,0\r\n\r\n'
    )
    inputs = find(written(tmp_path, text)).inputs(CONFIG)
    speed, wheel, friction, estimate, moment, inhibit = inputs.T
    # Rows at 0, 0.1 and 0.3 s; the last one is held for as long as rows are apart, at most 0.1 s.
    assert len(inputs) == 400
    assert (speed[50], wheel[50], friction[50], moment[50]) == pytest.approx((15.0, 0.5, 0.7, 50.0))
    assert speed[300:].tolist() == [20.0] * 100
    assert (inhibit[:100] == 0.0).all()
    assert (inhibit[100:300] == 1.0).all()
    assert (inhibit[300:] == 0.0).all()
    assert np.isnan(estimate[:300]).all()
    assert estimate[300] == pytest.approx(0.6)


def test_front_angle_is_turned_into_that_of_the_steering_wheel(tmp_path: Path) -> None:
    text = "time_s,speed_m_s,front_angle_rad\n0,10,0.1\n0.2,10,0.1\n"
    inputs = find(written(tmp_path, text)).inputs(CONFIG)
    assert inputs[0, INPUT_COLUMNS.index("steering_wheel_command")] == pytest.approx(0.1 * CONFIG.steering.ratio)
    assert inputs[0, INPUT_COLUMNS.index("friction")] == CONFIG.road.friction
    both = "time_s,speed_m_s,front_angle_rad,steering_wheel_angle_rad\n0,10,0.1,0.7\n0.2,10,0.1,0.7\n"
    assert find(written(tmp_path, both)).inputs(CONFIG)[0, 1] == pytest.approx(0.7)


HEADER = "time_s,speed_m_s,steering_wheel_angle_rad"
ROWS = "0.0,10,0\n0.1,10,0\n0.2,10,0\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "line 1: no column time_s"),
        (f"{HEADER}\n", "mine.csv: 0 rows"),
        (f"{HEADER}\n0,10,0\n", "mine.csv: 1 rows"),
        ("time_s,steering_wheel_angle_rad\n0,0\n", "line 1: no column speed_m_s"),
        ("time_s,speed_kmh,steering_wheel_angle_rad\n0,0,0\n", "is it 'speed_kmh'? units stand in the names"),
        ("time_s,speed_m_s\n0,10\n", "line 1: no column steering_wheel_angle_rad or front_angle_rad"),
        ("time_s,time_s,speed_m_s,front_angle_rad\n0,0,10,0\n", "line 1: two columns time_s"),
        ("time_s;speed_m_s;front_angle_rad\n0;10;0\n", "separate them by commas"),
        (f"{HEADER}\n{ROWS}0.2,10,0\n", "line 5, column time_s: time does not increase: 0.2 after 0.2"),
        (f"{HEADER}\n0.0,10,0\n0.2,10,0\n0.1,10,0\n", "line 4, column time_s: time does not increase"),
        (f"{HEADER}\n0.0,10,0\n0.1,ten,0\n", "line 3, column speed_m_s: not a number: 'ten'"),
        (f"{HEADER}\n0.0,10,0\n0.1,,0\n", "line 3, column speed_m_s: not a number: ''"),
        (f"{HEADER}\n0.0,10,0\n0.1,nan,0\n", "line 3, column speed_m_s: nan is outside"),
        (f"{HEADER}\n0.0,10,0\n0.1,inf,0\n", "column speed_m_s: inf is outside"),
        (f"{HEADER}\n0.0,10,0\n0.1,-1,0\n", "column speed_m_s: -1 is outside 0 to 150 m/s; check the value and its unit"),
        (f"{HEADER}\n0.0,10,0\n0.1,10,90\n", "column steering_wheel_angle_rad: 90 is outside -30 to 30 rad"),
        (f"{HEADER}\n0.0,10,0\n0.1,10\n", "line 3: 2 values, 3 columns"),
        (f"{HEADER},inhibit\n0.0,10,0,0\n0.1,10,0,0.5\n", "column inhibit: 0.5 is neither 0 nor 1"),
        (f'{HEADER}\n0.0,10,"0\n', "not CSV"),
        (f"{HEADER}\n0.0,10,0\n0.01,10,0\n", "column time_s: 0.01 s long"),
        (f"{HEADER}\n0.0,10,0\n3600.1,10,0\n", "column time_s: 3600.1 s long"),
    ],
)
def test_recording_that_cannot_be_used(text: str, told: str, tmp_path: Path) -> None:
    line = refusal(written(tmp_path, text))
    assert "mine.csv" in line
    assert told in line


def test_an_hour_is_taken(tmp_path: Path) -> None:
    scenario = find(written(tmp_path, f"{HEADER}\n0,10,0\n1800,10,0\n3600,10,0\n"))
    assert scenario.duration == pytest.approx(3600.1)


def test_file_that_is_none(tmp_path: Path) -> None:
    assert "cannot be read" in refusal(str(tmp_path / "missing.csv"))
    (tmp_path / "folder.csv").mkdir()
    assert "not a file" in refusal(str(tmp_path / "folder.csv"))
    assert "neither .csv nor .toml" in refusal(str(tmp_path / "run.mf4"))
    (tmp_path / "latin.csv").write_bytes(b"time_s,\xe9\n")
    assert "byte 7: not UTF-8" in refusal(str(tmp_path / "latin.csv"))
    assert "cannot be read" in refusal("a\0b.csv")


def test_a_file_over_the_limit_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "huge.csv").open("wb") as file:
        file.truncate(scenario_files.MAX_FILE_BYTES + 1)
    assert "over 64 MiB" in refusal(str(tmp_path / "huge.csv"))


# --- scenario files ----------------------------------------------------------------------------------------------------


def toml(folder: Path, text: str) -> str:
    return written(folder, text, "mine.toml")


def test_scenario_file_changes_what_it_names(tmp_path: Path) -> None:
    text = """
        name = "wet"
        base = "step-steer"
        speed_km_h = 60
        steering_wheel_angle_deg = -45.0
        friction = 0.6
        friction_estimate = 0.7
        duration_s = 12.0
    """
    scenario = find(toml(tmp_path, text))
    inputs = scenario.inputs(CONFIG)
    assert len(inputs) == 12_000
    assert inputs[-1, :4] == pytest.approx([60.0 / 3.6, math.radians(-45.0), 0.6, 0.7])
    assert scenario.name == "wet"
    assert scenario.title == "wet (step steer): -45 deg at the steering wheel, 60 km/h, friction 0.6, estimated 0.7"
    assert scenario.kind == "step"
    assert not scenario.faults


def test_what_it_does_not_name_stays(tmp_path: Path) -> None:
    same = find(toml(tmp_path, 'name = "same"\nbase = "ecu-loss"\n'))
    np.testing.assert_array_equal(same.inputs(CONFIG), find("ecu-loss").inputs(CONFIG))
    assert same.faults == find("ecu-loss").faults
    assert not find(toml(tmp_path, 'name = "none"\nbase = "ecu-loss"\nfaults = []\n')).faults


def test_faults_of_a_scenario_file(tmp_path: Path) -> None:
    text = """
        name = "faults"
        base = "step-steer"
        [[faults]]
        kind = "drop"
        start_s = 11
        duration_s = 0.5
        [[faults]]
        kind = "delay"
        start_s = 12.0
        duration_s = 0.5
        message = "VehicleMotion"
        cycles = 3
        [[faults]]
        kind = "stuck-value"
        start_s = 13.0
        duration_s = 0.5
        message = "VehicleMotion"
        signal = "yaw_rate"
    """
    assert find(toml(tmp_path, text), CONFIG).faults == (
        Fault("drop", 11.0, 0.5),
        Fault("delay", 12.0, 0.5, "VehicleMotion", None, 3),
        Fault("stuck-value", 13.0, 0.5, "VehicleMotion", "yaw_rate"),
    )


def test_messages_are_those_of_the_configuration(tmp_path: Path) -> None:
    data = CONFIG.model_dump()
    data["can"]["vehicle_motion"]["name"] = "Motion7"
    renamed = configuration.parse(data, "test")
    text = FAULT.format(kind="drop", more='message = "Motion7"')
    assert find(toml(tmp_path, text), renamed).faults[0].message == "Motion7"
    assert "known: VehicleMotion" in refusal(toml(tmp_path, text))


BASE = 'name = "mine"\nbase = "step-steer"\n'
FAULT = BASE + '[[faults]]\nkind = "{kind}"\nstart_s = 11.0\nduration_s = 0.5\n{more}\n'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("name = ", "TOML syntax"),
        ('base = "step-steer"\n', "mine.toml: name: this key is missing; add it"),
        ('name = "a b"\nbase = "step-steer"\n', "mine.toml: name: the name 'a b'"),
        ('name = "a"\nbase = "step-ster"\n', "mine.toml: base: there is no scenario 'step-ster'; did you mean 'step-steer'?"),
        (BASE + "speed_kmh = 3\n", "mine.toml: speed_kmh: unknown key; did you mean 'speed_km_h'?"),
        (BASE + "speed_km_h = 900.0\n", "mine.toml: speed_km_h: 900 is outside 1 to 400 km/h; check the value and its unit"),
        (BASE + 'speed_km_h = "fast"\n', "mine.toml: speed_km_h: a number is needed, not 'fast'"),
        (BASE + "friction = true\n", "mine.toml: friction: a number is needed"),
        (BASE + "friction = nan\n", "mine.toml: friction: nan is outside 0.05 to 1.5"),
        (BASE + "duration_s = 10.0\n", "mine.toml: duration_s: 10 s end before step-steer begins to steer, at 10 s"),
        (BASE + "faults = 3\n", "mine.toml: faults: "),
        ('name = "a"\nbase = "sine-with-dwell"\nduration_s = 9.0\n', "mine.toml: duration_s: sine-with-dwell does not take it"),
        ('name = "a"\nbase = "split-friction"\nfriction = 0.5\n', "mine.toml: friction: split-friction does not take it"),
        ('name = "a"\nbase = "ecu-loss"\nduration_s = 8.0\n', "faults 1: start_s: begins at 9 s, and the run ends at 8 s"),
        (FAULT.format(kind="dropp", more=""), "mine.toml: faults 1: kind: there is no fault 'dropp'; did you mean 'drop'?"),
        (FAULT.format(kind="drop", more="when = 3"), "mine.toml: faults 1: when: unknown key; known here: kind, start_s"),
        (FAULT.format(kind="drop", more="cycles = 2"), "mine.toml: faults 1: cycles: drop does not take it; remove it"),
        (FAULT.format(kind="delay", more=""), "mine.toml: faults 1: cycles: delay needs it; add it"),
        (FAULT.format(kind="delay", more="cycles = 0"), "mine.toml: faults 1: cycles: "),
        (
            FAULT.format(kind="drop", more='message = "Motion"'),
            "faults 1: message: there is no message 'Motion'; known: VehicleMotion",
        ),
        (FAULT.format(kind="infinity", more='message = "VehicleMotion"'), "mine.toml: faults 1: signal: infinity needs it"),
        (
            FAULT.format(kind="infinity", more='message = "VehicleMotion"\nsignal = "Speed"'),
            "faults 1: signal: VehicleMotion has no signal 'Speed'; known: qualifier, speed",
        ),
        (
            FAULT.format(kind="bus-down", more='message = "VehicleMotion"'),
            "mine.toml: faults 1: message: bus-down does not take it",
        ),
        (
            FAULT.format(kind="drop", more="") + '[[faults]]\nkind = "drop"\nstart_s = -1.0\nduration_s = 1.0\n',
            "mine.toml: faults 2: start_s: -1 is outside 0 to 3600 s",
        ),
        (
            FAULT.format(kind="drop", more="") + '[[faults]]\nkind = "drop"\nstart_s = 1.0\n',
            "faults 2: duration_s: this key is missing",
        ),
        (
            FAULT.format(kind="drop", more="").replace("11.0", "15.0"),
            "faults 1: start_s: begins at 15 s, and the run ends at 15 s",
        ),
    ],
)
def test_scenario_file_that_cannot_be_used(text: str, told: str, tmp_path: Path) -> None:
    line = refusal(toml(tmp_path, text))
    assert "mine.toml" in line
    assert told in line


def test_scenario_file_with_faults_needs_a_bus(software: Software, tmp_path: Path) -> None:
    with pytest.raises(CodegenError, match="codegen hil"):
        run(software, find(toml(tmp_path, FAULT.format(kind="drop", more=""))))

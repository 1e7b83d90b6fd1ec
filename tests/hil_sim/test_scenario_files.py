"""User scenarios: recordings and scenario files, and the one-line error for each mistake in them."""

import math
from pathlib import Path

import can
import numpy as np
import pytest

from codegen.errors import CodegenError
from codegen.sil.software import RECORD_COLUMNS, Software
from hil_sim import scenario_files, third_plant
from hil_sim.bench import run, run_in_process, run_through_can
from hil_sim.codec import Codec, Frame, RearSteerCommand
from hil_sim.faults import Fault
from hil_sim.logs import BusLog, save_csv
from hil_sim.plant_node import PlantNode
from hil_sim.scenario_files import find
from hil_sim.scenarios import Scenario
from tests import builds

CONFIG = builds.CONFIG
HEADER = "time_s,speed_m_s,steering_wheel_angle_rad"
BASE = 'name = "mine"\nbase = "step-steer"\n'
MOTION = 'message = "VehicleMotion"'


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def written(text: str, name: str = "mine.csv") -> str:
    Path(name).write_text(text, encoding="utf-8", newline="")
    return name


def toml(text: str, config: object = CONFIG) -> Scenario:
    return find(written(text, "mine.toml"), config)


def refusal(name: str) -> str:
    """Return the one line with which a file is rejected."""
    with pytest.raises(CodegenError) as caught:
        find(name, CONFIG).inputs(CONFIG)
    line = str(caught.value)
    assert "\n" not in line and Path(name.partition("\0")[0]).name in line and caught.value.remedy
    return line


def test_a_user_s_recording_is_reproduced(software: Software) -> None:
    first = run(software, find("step-steer"))
    save_csv(first, Path("run.csv"))
    again = run(software, find("run.csv"))
    assert again.shape == first.shape
    # The front angle passes the steering's lag of 5 ms a second time: 0.1 deg at 22.5 deg/s.
    np.testing.assert_allclose(again[:, 2], first[:, 2], atol=math.radians(0.15))
    np.testing.assert_allclose(again[-100:, 3], first[-100:, 3], rtol=1e-3)


def test_a_rear_angle_replaces_the_command_of_the_controller_in_every_loop(software: Software) -> None:
    rows = [f"{0.01 * k:.2f},25,{0.002 * k},{0.01 if k >= 20 else -0.01}" for k in range(50)]
    scenario = find(written("\n".join([f"{HEADER},rear_angle_override_rad", *rows])))
    expected = np.where(np.arange(50) >= 20, 0.01, -0.01)
    command, angle = (RECORD_COLUMNS.index(f"rear_angle_{name}") for name in ("command_rad", "rad"))
    direct = run(software, scenario)
    assert direct[:, command].tolist() == expected.tolist()
    assert not run(software, scenario, controlled=False)[:, [command, angle]].any()
    for record in (run_through_can(software, scenario).record, third_plant.run(software, software.config, scenario)):
        assert record[:, command] == pytest.approx(expected, abs=1e-6)
    # The log has the command as the actuator receives it.
    node = PlantNode(software.config, scenario)
    with BusLog(Path("run.log")) as log:
        run_in_process(node, software, log=log)
    codec = Codec(software.config.can, "single")
    with can.LogReader("run.log") as frames:
        logged = [codec.decode(frame.arbitration_id, bytes(frame.data)) for frame in frames]
    angles = [each.rear_angle for each in logged if isinstance(each, RearSteerCommand)]
    assert angles == pytest.approx(expected, abs=1e-6)
    damaged = Frame(software.config.can.rear_steer_command.id, bytes(8))
    assert node.bypass(0, damaged) == damaged


def test_values_between_rows_are_linear_and_flags_are_held() -> None:
    text = (
        "\ufeffnote,time_s,speed_m_s,steering_wheel_angle_rad,friction,friction_estimate,yaw_moment_n_m,inhibit\r\n"
        "a,3.0,10,0.0,0.9,,0,0\r\n"
        'b,3.1,20,1.0,0.5,nan,100,1\r\n"c, d",3.3,20,1.0,0.5,0.6,100,0\r\n\r\n'
    )
    speed, wheel, friction, estimate, moment, inhibit, acceleration = find(written(text)).inputs(CONFIG).T
    assert acceleration[50] == pytest.approx(100.0)  # 10 m/s in 0.1 s
    # Rows at 0, slightly over 0.1 (3.1 - 3.0) and 0.3 s; the last one is held for one row interval, at most 0.1 s.
    assert (speed[50], wheel[50], friction[50], moment[50]) == pytest.approx((15.0, 0.5, 0.7, 50.0))
    assert speed[300:].tolist() == [20.0] * 100
    assert inhibit.tolist() == [0.0] * 100 + [1.0] * 200 + [0.0] * 100
    assert np.isnan(estimate[:300]).all()
    assert estimate[300] == pytest.approx(0.6)


def test_a_missing_or_too_long_file() -> None:
    Path("folder.csv").mkdir()
    Path("latin.csv").write_bytes(b"time_s,\xe9\n")
    with Path("huge.csv").open("wb") as file:
        file.truncate(scenario_files.RECORDING_BYTES_MAX + 1)
    for name, words in (
        ("missing.csv", "cannot be read"),
        ("a\0b.csv", "cannot be read"),
        ("folder.csv", "not a file"),
        ("./run.mf4", "neither .csv nor .toml"),
        ("latin.csv", "byte 7: not UTF-8"),
        ("huge.csv", "over 64 MiB"),
    ):
        assert words in refusal(name)


def fault(kind: str, *lines: str) -> str:
    return "\n".join([BASE, "[[faults]]", f'kind = "{kind}"', "start_s = 11.0", "duration_s = 0.5", *lines, ""])


def test_a_scenario_file_changes_only_its_keys() -> None:
    values = "speed_km_h = 60\nsteering_wheel_angle_deg = -45.0\nfriction = 0.6\nfriction_estimate = 0.7\nduration_s = 12.0\n"
    scenario = toml(BASE + values)
    inputs = scenario.inputs(CONFIG)
    assert len(inputs) == 12_000
    assert inputs[-1, :4] == pytest.approx([60.0 / 3.6, math.radians(-45.0), 0.6, 0.7])
    assert scenario.title == "mine (step steer): -45 deg at the steering wheel, 60 km/h, friction 0.6, estimated 0.7"
    assert (scenario.name, scenario.kind, scenario.faults) == ("mine", "step", ())
    same = toml('name = "same"\nbase = "ecu-loss"\n')
    np.testing.assert_array_equal(same.inputs(CONFIG), find("ecu-loss").inputs(CONFIG))
    assert same.faults == find("ecu-loss").faults
    assert not toml('name = "none"\nbase = "ecu-loss"\nfaults = []\n').faults


def test_faults_of_a_scenario_file() -> None:
    for text, expected in (
        (fault("drop"), Fault("drop", 11.0, 0.5)),
        (fault("delay", MOTION, "cycles = 3"), Fault("delay", 11.0, 0.5, "VehicleMotion", None, 3)),
        (fault("stuck-value", MOTION, 'signal = "yaw_rate"'), Fault("stuck-value", 11.0, 0.5, "VehicleMotion", "yaw_rate")),
    ):
        assert toml(text).faults == (expected,)
    renamed = CONFIG.replace({"can": {"vehicle_motion": {"name": "Motion7"}}})
    assert toml(fault("drop", 'message = "Motion7"'), renamed).faults[0].message == "Motion7"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('name = "a b"\nbase = "step-steer"\n', "name: the name 'a b'"),
        ('name = "a"\nbase = "step-ster"\n', "base: there is no scenario 'step-ster'; did you mean 'step-steer'?"),
        (BASE + "speed_kmh = 3\n", "speed_kmh: unknown key; did you mean 'speed_km_h'?"),
        (BASE + "speed_km_h = 900.0\n", "speed_km_h: 900 is outside 1 to 400 km/h; check the value and its unit"),
        (BASE + "duration_s = 10.0\n", "duration_s: 10 s end before step-steer begins to steer, at 10 s"),
        ('name = "a"\nbase = "sine-with-dwell"\nduration_s = 9.0\n', "duration_s: sine-with-dwell does not take it"),
        (fault("dropp"), "faults 1: kind: there is no fault 'dropp'; did you mean 'drop'?"),
        (fault("drop", "cycles = 2"), "faults 1: cycles: drop does not take it; remove it"),
        (fault("delay"), "faults 1: cycles: delay needs it; add it"),
        (fault("drop", 'message = "Motion"'), "faults 1: message: there is no message 'Motion'; known: VehicleMotion"),
        (fault("infinity", MOTION), "faults 1: signal: infinity needs it"),
        (fault("infinity", MOTION, 'signal = "V"'), "signal: VehicleMotion has no signal 'V'; known: qualifier, speed"),
        (fault("drop") + '[[faults]]\nkind = "drop"\nstart_s = 1.0\n', ": faults 2: duration_s is missing; add it"),
        (fault("drop").replace("11.0", "15.0"), "faults 1: start_s: begins at 15 s, and the run ends at 15 s"),
        ("", "line 1: no column time_s"),
        ("time_s,speed_kmh,steering_wheel_angle_rad\n0,0,0\n", "is it 'speed_kmh'? units are in the names"),
        ("time_s,speed_m_s\n0,10\n", "line 1: no column steering_wheel_angle_rad or front_angle_rad"),
        ("time_s;speed_m_s;front_angle_rad\n0;10;0\n", "separate them by commas"),
        (f"{HEADER}\n0,10,0\n0.2,10,0\n0.2,10,0\n", "line 4, column time_s: time does not increase: 0.2 after 0.2"),
        (f"{HEADER}\n0,10,0\n0.1,ten,0\n", "line 3, column speed_m_s: not a number: 'ten'"),
        (f"{HEADER}\n0,10,0\n0.1,nan,0\n", "line 3, column speed_m_s: nan is outside"),
        (f"{HEADER}\n0,10,0\n0.1,-1,0\n", "column speed_m_s: -1 is outside 0 to 150 m/s; check the value and its unit"),
        (f"{HEADER}\n0,10,0\n0.1,10\n", "line 3: 2 values, 3 columns"),
        (f"{HEADER},inhibit\n0,10,0,0\n0.1,10,0,0.5\n", "column inhibit: 0.5 is neither 0 nor 1"),
        (f'{HEADER}\n0,10,"0\n', "not CSV"),
        (f"{HEADER}\n0,10,0\n3600.1,10,0\n", "column time_s: 3600.1 s long"),
    ],
)
def test_file_that_cannot_be_used(text: str, words: str) -> None:
    """Scenario files are recognised by their name; all others are recordings."""
    assert words in refusal(written(text, "mine.toml" if text.startswith("name = ") else "mine.csv"))


def test_a_file_without_a_name_is_named_by_its_path(tmp_path: Path) -> None:
    path = tmp_path / "wet-turn.toml"
    path.write_text('base = "step-steer"\nfriction = 0.5\n', encoding="utf-8")
    assert scenario_files.load(path, CONFIG).name == "wet-turn"
    other = path.rename(tmp_path / "wet turn.toml")
    with pytest.raises(CodegenError, match=r"wet turn\.toml: the name 'wet turn' .* rename the file, or give it a name"):
        scenario_files.load(other, CONFIG)


def test_settings_of_a_built_in_scenario() -> None:
    scenario = scenario_files.with_settings(
        scenario_files.BUILT_IN["step-steer"], {"speed_km_h": 100.0, "steering_wheel_angle_deg": 40.0}
    )
    assert scenario.title == "Step steer: 40 deg at the steering wheel, 100 km/h"
    assert scenario_files.with_settings(scenario, {}) is scenario
    with pytest.raises(CodegenError, match="`steering_wheel_angle_deg=`: slalom does not take it; it takes duration_s"):
        scenario_files.with_settings(scenario_files.BUILT_IN["slalom"], {"steering_wheel_angle_deg": 10.0})

"""What a campaign depends on, and what of a spec and its scenarios cannot be driven."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import casadi
import pytest

from codegen.errors import CodegenError, ConfigError
from codegen.sweep import plan as planning
from codegen.sweep import store
from codegen.sweep.plan import Plan
from tests.sweep.conftest import ROOT, SAMPLES, write_spec

TWO = '["step-steer", "sine-with-dwell"]'


def edited(at: Path, *changes: tuple[str, str], samples: int = 8) -> Path:
    """The spec of the tests with some text in the place of other."""
    path = write_spec(at, samples=samples)
    text = path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return path


def with_own(at: Path, *lines: str, base: str = "step-steer", length: str = "length_s = 3.9") -> Path:
    """A spec whose one scenario is a file of these lines."""
    (at / "own.toml").write_text("\n".join(['name = "own"', f'base = "{base}"', *lines]))
    return edited(at, (TWO, '["own.toml"]'), ("length_s = 3.9", length))


@pytest.mark.parametrize(
    ("base", "one", "other"),
    [
        ("step-steer", "steering_wheel_angle_deg = 60.0", "steering_wheel_angle_deg = 120.0"),
        ("low-friction", "steering_wheel_angle_deg = 60.0", ""),
        ("step-steer", "speed_km_h = 50.0", "speed_km_h = 60.0"),
        ("step-steer", "friction = 0.5", "friction = 0.6"),
        ("step-steer", "duration_s = 13.9", "duration_s = 14.9"),
    ],
)
def test_an_edited_scenario_is_another_campaign(tmp_path: Path, base: str, one: str, other: str) -> None:
    folder, length = tmp_path / "out", ""
    plan = planning.read(with_own(tmp_path, one, base=base, length=length))
    store.prepare(folder)
    store.open_folder(folder, plan)
    changed = planning.read(with_own(tmp_path, other, base=base, length=length))
    for refuse in (store.open_folder, store.check_same):
        with pytest.raises(CodegenError, match="it holds another campaign: scenarios has changed since"):
            refuse(folder, changed)
    store.check_same(folder, planning.read(with_own(tmp_path, one, base=base, length=length)))


def test_a_scenario_file_that_says_what_its_base_has_is_the_same(tmp_path: Path) -> None:
    said = planning.read(with_own(tmp_path, "friction = 0.5", base="low-friction"))
    unsaid = planning.read(with_own(tmp_path, base="low-friction"))
    assert said.profiles[0].digest == unsaid.profiles[0].digest


def test_builds_and_scenario_files_may_move(plan: Plan, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "generated/4ws2", tmp_path / "moved")
    path = edited(tmp_path, (f'{ROOT}/generated/4ws2"', 'moved"'), samples=SAMPLES)
    assert store.facts_text(planning.read(path)) == store.facts_text(plan)


def test_the_order_of_controllers_is_told(plan: Plan, tmp_path: Path) -> None:
    store.prepare(tmp_path / "out")
    store.open_folder(tmp_path / "out", plan)
    passive = 'passive = ""\n'
    path = edited(tmp_path, (passive, ""), ("[controllers]\n", f"[controllers]\n{passive}"), samples=SAMPLES)
    with pytest.raises(CodegenError, match="it holds another campaign: controllers has changed since"):
        store.check_same(tmp_path / "out", planning.read(path))


def test_versions_belong_to_it(plan: Plan) -> None:
    tools = json.loads(store.facts_text(plan))["tools"]
    assert list(tools) == ["codegen", "numpy", "scipy", "casadi"]
    assert tools["casadi"] == casadi.__version__


def test_what_is_driven_is_long_enough_whoever_says_how_long(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        planning.read(with_own(tmp_path, "duration_s = 11.5", length=""))
    assert str(caught.value).endswith(
        "sweep.toml: scenarios: 1.5 s are too short for the figures of own; raise its duration_s by 0.5 s or more"
    )
    with pytest.raises(
        ConfigError, match=r"length_s: own ends 2\.1 s after the driver begins, before 3\.9 s; give 2\.1 s or less"
    ):
        planning.read(with_own(tmp_path, "duration_s = 12.1"))
    planning.read(with_own(tmp_path, "duration_s = 12.1", length="length_s = 2.1"))
    planning.read(with_own(tmp_path, "duration_s = 12.0", length=""))


def test_an_estimate_of_the_scenario_s_does_not_go_with_another_friction(tmp_path: Path) -> None:
    own = (TWO, '["low-friction-estimated"]')
    with pytest.raises(ConfigError) as caught:
        planning.read(edited(tmp_path, own))
    assert str(caught.value).endswith(
        "sweep.toml: factors.friction: low-friction-estimated tells the controller a friction of 0.5, whatever that of the "
        "road is; give friction_estimate_error, 0 for a controller that knows it"
    )
    planning.read(edited(tmp_path, own, ("[factors]", "[factors]\nfriction_estimate_error = 0.0")))
    planning.read(edited(tmp_path, own, ("friction = {", "tyre_peak_percent = {"), ("0.4, 1.0", "-20, 10")))


def test_the_guide_says_from_what_size_a_campaign_has_more_than_one_chunk(tmp_path: Path) -> None:
    assert f"make up to {planning.RUNS_PER_CHUNK} runs" in (ROOT / "docs/sweep.md").read_text(encoding="utf-8")
    runs_per_sample = 6
    most = planning.RUNS_PER_CHUNK // runs_per_sample
    assert planning.read(write_spec(tmp_path, samples=most)).chunk_count == 1
    assert planning.read(write_spec(tmp_path, samples=most + 1)).chunk_count == 2

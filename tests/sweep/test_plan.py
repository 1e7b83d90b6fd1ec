"""Facts that identify a campaign, and specs and scenarios that cannot be run."""

import json
import re
import shutil
from pathlib import Path

import pytest

from codegen.errors import CodegenError, ConfigError
from codegen.sweep import plan as planning
from codegen.sweep import store
from codegen.sweep.plan import Plan
from tests.cli.conftest import edit
from tests.sweep.conftest import ROOT, SAMPLES, write_spec

TWO = '["step-steer", "sine-with-dwell"]'


def edited(at: Path, *changes: tuple[str, str], samples: int = 8) -> Path:
    """Return the spec of the tests with some text replaced."""
    return edit(write_spec(at, samples=samples), *changes)


def with_own(at: Path, *lines: str, base: str = "step-steer", length: str = "length_s = 3.9") -> Path:
    """Return a spec whose only scenario is a file with these lines."""
    (at / "own.toml").write_text("\n".join(['name = "own"', f'base = "{base}"', *lines]))
    return edited(at, (TWO, '["own.toml"]'), ("length_s = 3.9", length))


@pytest.mark.parametrize(
    ("base", "one", "other", "same"),
    [
        ("low-friction", "steering_wheel_angle_deg = 60.0", "", False),
        ("low-friction", "friction = 0.5", "", True),  # the value of its base
        ("step-steer", "speed_km_h = 50.0", "speed_km_h = 60.0", False),
        ("step-steer", "friction = 0.5", "friction = 0.6", False),
        ("step-steer", "duration_s = 13.9", "duration_s = 14.9", False),
    ],
)
def test_an_edited_scenario_is_another_campaign(tmp_path: Path, base: str, one: str, other: str, same: bool) -> None:
    first, second = (planning.read(with_own(tmp_path, line, base=base, length="")) for line in (one, other))
    assert (first.profiles[0].digest == second.profiles[0].digest) == same
    assert (store.facts_text(first) == store.facts_text(second)) == same


def test_builds_may_move_and_the_order_of_controllers_counts(plan: Plan, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "generated/4ws2-paper", tmp_path / "moved")
    moved = edited(tmp_path, (f'{ROOT}/generated/4ws2-paper"', 'moved"'), samples=SAMPLES)
    assert store.facts_text(planning.read(moved)) == store.facts_text(plan)
    assert list(json.loads(store.facts_text(plan))["tools"]) == ["codegen", "numpy", "scipy", "casadi"]
    folder, passive = tmp_path / "out", 'passive = ""\n'
    store.prepare(folder)
    store.open_folder(folder, plan)
    store.check_same(folder, plan)
    other = edited(tmp_path, (passive, ""), ("[controllers]\n", f"[controllers]\n{passive}"), samples=SAMPLES)
    for check in (store.open_folder, store.check_same):
        with pytest.raises(CodegenError, match="it holds another campaign: controllers has changed since"):
            check(folder, planning.read(other))


def test_profiles_must_be_long_enough(tmp_path: Path) -> None:
    for lines, length, message in (
        ("duration_s = 11.5", "", "1.5 s are too short for the figures of own; raise its duration_s by 0.5 s or more"),
        ("duration_s = 12.1", "length_s = 3.9", "ends 2.1 s after the driver begins, before 3.9 s; give 2.1 s or less"),
    ):
        with pytest.raises(ConfigError, match=re.escape(message)):
            planning.read(with_own(tmp_path, lines, length=length))
    planning.read(with_own(tmp_path, "duration_s = 12.1", length="length_s = 2.1"))
    planning.read(with_own(tmp_path, "duration_s = 12.0", length=""))


def test_an_estimate_of_a_scenario_needs_its_own_friction(tmp_path: Path) -> None:
    own = (TWO, '["low-friction-estimated"]')
    with pytest.raises(ConfigError, match=r"factors\.friction: low-friction-estimated .*0\.5 .*set friction_estimate_e"):
        planning.read(edited(tmp_path, own))
    planning.read(edited(tmp_path, own, ("[factors]", "[factors]\nfriction_estimate_error = 0.0")))
    planning.read(edited(tmp_path, own, ("friction = {", "tyre_peak_percent = {"), ("0.4, 1.0", "-20, 10")))

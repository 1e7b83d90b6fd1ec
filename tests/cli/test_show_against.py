"""`codegen show --against`: the figures, the picture, JSON, and what is refused."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen.refmap import map as npz
from tests.cli.conftest import Run

Refused = Callable[..., str]
MAP = Path(__file__).resolve().parents[2] / "generated/4ws2.npz"
SMALL = "\n[grid]\nspeed_points = 21\nfront_angle_min_deg = 0.5\nfront_angle_points = 20\n"


@pytest.fixture
def maps(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """The linear and the nonlinear map of the same small grid, in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "linear.toml").write_text(SMALL)
    case = "\n[cases.4ws-2]\nrear_steering = true\nsideslip_weight_per_s2 = 3000.0\n"
    (tmp_path / "nonlinear.toml").write_text(f'{SMALL}{case}tyre_model = "magic-formula"\n')
    for name in ("linear", "nonlinear"):
        assert run("solve", "--config", f"{name}.toml", "--case", "4ws-2", "-o", f"{name}.npz").code == 0
    return Path("linear.npz"), Path("nonlinear.npz")


def test_figures_of_both_in_the_width_of_a_terminal(run: Run, maps: tuple[Path, Path]) -> None:
    answer = run("show", maps[0], "--against", maps[1])
    assert (answer.code, answer.err) == (0, "")
    lines = answer.out.splitlines()
    assert lines[:2] == ["first:  linear.npz", "second: nonlinear.npz"]
    assert max(len(line) for line in lines) <= 80
    rows = {line[:34].strip(): line[34:].split() for line in lines}
    assert rows["tyre of the optimisation"] == ["linear", "magic-formula"]
    assert rows["front slip above the bound [cells]"][1] == "0"
    assert any(line.startswith("yaw rate, first less second  ") for line in lines)
    assert any(line.startswith("60 km/h, 2.00 deg  ") for line in lines)


def test_a_picture_and_json(run: Run, maps: tuple[Path, Path]) -> None:
    answer = run("show", *maps[:1], "--against", maps[1], "--plot", "difference.png", "--json")
    assert answer.code == 0
    assert Path("difference.png").read_bytes().startswith(b"\x89PNG")
    told = json.loads(answer.out)
    assert (told["map"], told["against"], told["plot"]) == ("linear.npz", "nonlinear.npz", "difference.png")
    assert told["first"]["front_slip"]["largest_percent"] > 110.0
    assert told["second"]["front_slip"]["largest_percent"] == pytest.approx(100.0, abs=1e-4)
    plain = run("show", *maps[:1], "--against", maps[1], "--plot", "difference.png")
    assert plain.out.splitlines()[-1] == "plot: difference.png"


def test_another_car_is_noted(run: Run, maps: tuple[Path, Path]) -> None:
    Path("linear.toml").write_text(f"[vehicle]\nmass_kg = 2000.0\n{SMALL}")
    assert run("solve", "--config", "linear.toml", "--case", "4ws-2", "-o", "heavy.npz").code == 0
    assert "different cars" in run("show", maps[1], "--against", "heavy.npz").err


def test_what_cannot_be_compared_is_refused_in_one_line(refused: Refused, tmp_path: Path) -> None:
    shutil.copy(MAP, tmp_path / "one.npz")
    one = npz.load(MAP)
    fast = replace(one, speed=one.speed + 100.0, yaw_rate=0.1 * one.yaw_rate, config=None, case=None, meta={}, active=None)
    npz.save(replace(fast, sideslip=None, rear_angle=None), tmp_path / "fast.npz")
    (tmp_path / "link.npz").symlink_to("one.npz")
    (tmp_path / "text.npz").write_text("no map")
    np.savez(tmp_path / "other.npz", something=np.zeros(3))
    assert "--against one.npz: is the map itself; name another map" in refused("show", "one.npz", "--against", "one.npz")
    assert "is the map itself" in refused("show", "one.npz", "--against", "link.npz")
    assert "--against: does not go with --flash" in refused("show", "one.npz", "--against", "fast.npz", "--flash")
    assert "add --flash" in refused("show", "one.npz", "--against", "fast.npz", "--config", "ars.toml")
    assert "text.npz" in refused("show", "one.npz", "--against", "text.npz")
    assert "other.npz" in refused("show", "one.npz", "--against", "other.npz")
    assert "none.npz" in refused("show", "one.npz", "--against", "none.npz")
    told = refused("show", "one.npz", "--against", "fast.npz", "--plot", "picture.png")
    assert "one.npz, fast.npz: no operating point in common: 20 to 120 km/h" in told

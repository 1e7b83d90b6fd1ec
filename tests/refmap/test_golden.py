"""The committed reference output: solved again and built again, it is what stands in `generated/`."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from codegen.config import Config, preset
from codegen.design.tune import tune
from codegen.emit.folder import differences, verify_hashes
from codegen.emit.from_files import prepare
from codegen.refmap import map as npz
from codegen.refmap.map import ReferenceMap

GENERATED = Path(__file__).resolve().parents[2] / "generated"
NAMES = ("4ws2", "4ws2-tracking")

TOLERANCE = 1e-9
"""rad/s and rad: far above what another processor or NumPy changes (1e-15), far below what matters to anyone."""


SCHEDULE_TOLERANCE = 2e-3
"""Of a gain: it has four digits, and another machine's linear algebra may move the last of them."""


def map_file(name: str) -> Path:
    return GENERATED / f"{name}.npz"


@pytest.fixture(scope="module", params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def committed(name: str) -> ReferenceMap:
    return npz.load(map_file(name))


@pytest.fixture(scope="module")
def fresh(maps: Mapping[str, ReferenceMap]) -> ReferenceMap:
    return maps["4ws-2"]


@pytest.mark.parametrize("array", ["speed", "front_angle", "yaw_rate", "sideslip", "rear_angle"])
def test_arrays_are_those_of_a_fresh_solution(committed: ReferenceMap, fresh: ReferenceMap, array: str) -> None:
    """NaN stands in the same cells: assert_allclose takes it as equal to itself alone."""
    np.testing.assert_allclose(getattr(committed, array), getattr(fresh, array), rtol=0.0, atol=TOLERANCE, equal_nan=True)


def test_same_cells_are_feasible_and_the_same_constraints_bind(committed: ReferenceMap, fresh: ReferenceMap) -> None:
    np.testing.assert_array_equal(committed.feasible, fresh.feasible)
    np.testing.assert_array_equal(committed.active, fresh.active)
    np.testing.assert_array_equal(np.isnan(committed.yaw_rate), ~fresh.feasible)


def test_they_were_solved_from_the_presets(committed: ReferenceMap, name: str, paper: Config) -> None:
    assert committed.config is not None
    tracking = committed.config.controller.tracking.model_copy(update={"schedule": None})
    controller = committed.config.controller.model_copy(update={"tracking": tracking})
    assert committed.config.model_copy(update={"controller": controller}) == (
        paper if name == "4ws2" else preset("recommended")
    )
    assert committed.case == "4ws-2"
    assert committed.meta["configuration"] == committed.config.model_dump(mode="json")
    assert committed.meta["method"] == "exact"


def test_the_schedule_is_what_tune_designs() -> None:
    config = npz.load(map_file("4ws2-tracking")).config
    assert config is not None
    assert config.controller.tracking.schedule is not None
    stands, fresh = (schedule.model_dump() for schedule in (config.controller.tracking.schedule, tune(preset("recommended"))))
    for key in ("speed_km_h", "proportional_gain_s", "integral_gain"):
        np.testing.assert_allclose(stands[key], fresh[key], rtol=SCHEDULE_TOLERANCE)


def test_saving_it_again_gives_the_same_bytes(committed: ReferenceMap, name: str) -> None:
    assert npz.to_bytes(committed) == map_file(name).read_bytes()


def test_building_it_again_gives_the_same_bytes(name: str) -> None:
    prepared = prepare(map_file(name))
    assert prepared.target == Path("generated") / name
    assert differences(prepared.folder, GENERATED / name) == []
    assert verify_hashes(GENERATED / name) == []


def test_a_changed_byte_would_be_seen(name: str, tmp_path: Path) -> None:
    """In a copy: a file changed, one missing, one too many."""
    copy = tmp_path / name
    shutil.copytree(GENERATED / name, copy)
    folder = prepare(map_file(name)).folder
    assert differences(folder, copy) == []
    changed, removed, *_ = sorted(folder.files)
    (copy / changed).write_bytes((copy / changed).read_bytes()[:-1] + b" ")
    (copy / removed).unlink()
    (copy / "stray.txt").write_bytes(b"")
    assert differences(folder, copy) == [f"{changed}: differs", f"{removed}: missing", "stray.txt: not named by the manifest"]

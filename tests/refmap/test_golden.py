"""The committed reference output: solved again and built again, it is what stands in `generated/`."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from codegen.config import Config
from codegen.emit.folder import differences, verify_hashes
from codegen.emit.from_files import prepare
from codegen.refmap import map as npz
from codegen.refmap.map import ReferenceMap

GENERATED = Path(__file__).resolve().parents[2] / "generated"
MAP = GENERATED / "4ws2.npz"
BUILD = GENERATED / "4ws2"

TOLERANCE = 1e-9
"""rad/s and rad: far above what another processor or NumPy changes (1e-15), far below what matters to anyone."""


@pytest.fixture(scope="module")
def committed() -> ReferenceMap:
    return npz.load(MAP)


@pytest.fixture(scope="module")
def fresh(maps: Mapping[str, ReferenceMap]) -> ReferenceMap:
    return maps["4ws-2"]


@pytest.mark.parametrize("name", ["speed", "front_angle", "yaw_rate", "sideslip", "rear_angle"])
def test_arrays_are_those_of_a_fresh_solution(committed: ReferenceMap, fresh: ReferenceMap, name: str) -> None:
    """NaN stands in the same cells: assert_allclose takes it as equal to itself alone."""
    np.testing.assert_allclose(getattr(committed, name), getattr(fresh, name), rtol=0.0, atol=TOLERANCE, equal_nan=True)


def test_same_cells_are_feasible_and_the_same_constraints_bind(committed: ReferenceMap, fresh: ReferenceMap) -> None:
    np.testing.assert_array_equal(committed.feasible, fresh.feasible)
    np.testing.assert_array_equal(committed.active, fresh.active)
    np.testing.assert_array_equal(np.isnan(committed.yaw_rate), ~fresh.feasible)


def test_it_was_solved_from_the_preset(committed: ReferenceMap, paper: Config) -> None:
    assert committed.config == paper
    assert committed.case == "4ws-2"
    assert committed.meta["configuration"] == paper.model_dump(mode="json")
    assert committed.meta["method"] == "exact"


def test_saving_it_again_gives_the_same_bytes(committed: ReferenceMap) -> None:
    assert npz.to_bytes(committed) == MAP.read_bytes()


def test_building_it_again_gives_the_same_bytes() -> None:
    prepared = prepare(MAP)
    assert prepared.target == Path("generated/4ws2")
    assert differences(prepared.folder, BUILD) == []
    assert verify_hashes(BUILD) == []


def test_a_changed_byte_would_be_seen(tmp_path: Path) -> None:
    """In a copy: a file changed, one missing, one too many."""
    copy = tmp_path / "4ws2"
    shutil.copytree(BUILD, copy)
    folder = prepare(MAP).folder
    assert differences(folder, copy) == []
    changed, removed, *_ = sorted(folder.files)
    (copy / changed).write_bytes((copy / changed).read_bytes()[:-1] + b" ")
    (copy / removed).unlink()
    (copy / "stray.txt").write_bytes(b"")
    assert differences(folder, copy) == [f"{changed}: differs", f"{removed}: missing", "stray.txt: not named by the manifest"]

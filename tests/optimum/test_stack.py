"""A stack of maps for several frictions: the physics of another road, solving, and the file contract."""

import io
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from codegen.errors import ConfigError, MapError
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap
from codegen.optimum import solve
from codegen.optimum.solve import layer_configs, on_road, solve_case, solve_stack
from codegen.vehicle.tyre import AxleTyres
from tests.map_file.test_map import TABLES, Change, cell, drop, put
from tests.optimum.cars import PAPER, changed

Arrays = dict[str, Any]

CONFIG = changed(PAPER, grid={"speed_points": 6, "front_angle_points": 5})
FRICTION = (0.3, 0.5, 0.7, 0.9)
SLIPS = np.linspace(-0.3, 0.3, 61)
STACKED = solve_stack(CONFIG, "4ws-2", FRICTION)


def assert_same_tables(one: ReferenceMap, other: ReferenceMap) -> None:
    """Check that tables are equal bit for bit."""
    for name in TABLES:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize("friction", [0.1, 0.45, 1.2])
def test_the_tyre_of_another_road_is_the_same_tyre(friction: float) -> None:
    nominal, there = AxleTyres.from_config(CONFIG), AxleTyres.from_config(on_road(CONFIG, friction))
    for tyre, other in ((nominal.front, there.front), (nominal.rear, there.rear)):
        assert other.nominal_friction == friction
        assert other.stiffness_factor == tyre.stiffness_factor
        assert other.cornering_stiffness == pytest.approx(friction / 0.9 * tyre.cornering_stiffness, rel=1e-14)
        for load in (None, 2_000.0):
            np.testing.assert_array_equal(other.force(SLIPS, load), tyre.force(SLIPS, load, friction))
    # The slip at which the formula departs from its tangent does not depend on its peak.
    assert (there.front_slip_bound, there.rear_slip_bound) == (nominal.front_slip_bound, nominal.rear_slip_bound)


def test_the_map_has_the_design_friction_and_the_layers_are_below() -> None:
    alone = solve_case(CONFIG, "4ws-2")
    assert_same_tables(STACKED, alone)
    assert [layer.value for layer in STACKED.layers] == [0.3, 0.5, 0.7]
    for layer in STACKED.layers:
        assert layer.map.config is not None and layer.map.config.road.friction == layer.value
        assert layer.map.meta == {**alone.meta, "configuration": layer.map.config.model_dump(mode="json")}
    assert npz.to_bytes(solve_stack(CONFIG, "4ws-2", (0.9, 0.3, 0.7, 0.5))) == npz.to_bytes(STACKED)


@pytest.mark.parametrize(
    ("friction", "fault"),
    [
        ((), "no friction, where two or more"),
        ((0.3, 0.9, 0.9), "0.9 is there twice"),
        ((0.895, 0.9), "too close together"),
        ((0.3, math.nan, 0.9), "nan is outside"),
        ((0.3, 0.9 + 2e-9), "is not the one"),
    ],
)
def test_bad_frictions_are_refused(friction: tuple[float, ...], fault: str) -> None:
    with pytest.raises(ConfigError) as caught:
        solve_stack(CONFIG, "4ws-2", friction)
    assert fault in caught.value.what
    assert caught.value.where == "`friction=`" and caught.value.remedy


def test_a_layer_that_cannot_be_solved_is_refused_with_its_friction() -> None:
    config = changed(CONFIG, grid={"front_angle_min_deg": 6.0, "speed_min_km_h": 40.0})
    with pytest.raises(MapError, match=r"friction 0\.1: \[cases\.4ws-2\]: no operating .* leave this friction out"):
        solve_stack(config, "4ws-2", (0.1, 0.9))


def test_a_stack_that_no_file_can_hold_is_refused_before_it_is_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solve, "solve_case", None)
    config = changed(CONFIG, grid={"speed_points": 1000, "front_angle_points": 1000})
    with pytest.raises(MapError, match=r"over 64 MiB.*fewer breakpoints, or its stack fewer frictions"):
        solve_stack(config, "4ws-2", FRICTION)


def arrays_of(reference_map: ReferenceMap) -> Arrays:
    """Return the content of the file, writable."""
    with np.load(io.BytesIO(npz.to_bytes(reference_map)), allow_pickle=False) as file:
        return {key: np.array(file[key]) for key in file.files}


def test_the_stack_only_adds_keys_to_the_file_and_is_read_again() -> None:
    """All other keys equal those of the map without it, byte for byte."""
    alone, found = arrays_of(replace(STACKED, layers=())), arrays_of(STACKED)
    plain = ["vx", "delta_f", "yaw_rate", "beta", "delta_r", "feasible", "active"]
    assert list(found) == [*plain, "friction", *(f"friction_{key}" for key in plain[2:]), "meta"]
    assert all(found[key].tobytes() == array.tobytes() for key, array in alone.items())
    np.testing.assert_array_equal(found["friction"], [0.3, 0.5, 0.7])
    loaded = npz.from_bytes(npz.to_bytes(STACKED), "test")
    assert npz.to_bytes(loaded) == npz.to_bytes(STACKED)
    for layer, other in zip(loaded.layers, STACKED.layers, strict=True):
        assert_same_tables(layer.map, other.map)
        assert (layer.map.config, layer.map.case, layer.map.meta) == (other.map.config, other.map.case, other.map.meta)


def test_another_configuration_reaches_the_layers() -> None:
    new = changed(CONFIG, limits={"rear_angle_max_deg": 3.0})
    other = replace(STACKED, config=new, meta={**STACKED.meta, "configuration": new.model_dump(mode="json")})
    for layer in npz.from_bytes(npz.to_bytes(other), "test").layers:
        assert layer.map.config == on_road(new, layer.value)
        assert layer.map.meta["configuration"] == on_road(new, layer.value).model_dump(mode="json")


def test_a_bare_map_may_have_a_stack() -> None:
    speed, angle = np.array([5.0, 15.0, 30.0]), np.array([0.02, 0.05, 0.1])
    yaw_rate = np.minimum(np.outer(speed / 3.2, angle), 6.0 / speed[:, np.newaxis])
    stacked = np.stack([yaw_rate / 3.0, yaw_rate / 1.5])
    arrays = {"vx": speed, "delta_f": angle, "yaw_rate": yaw_rate, "friction": [0.3, 0.6], "friction_yaw_rate": stacked}
    loaded = npz.from_arrays(arrays, "test")
    for layer, values in zip(loaded.layers, stacked, strict=True):
        np.testing.assert_array_equal(layer.map.yaw_rate, values)
        assert layer.map.feasible.all() and not layer.map.solved
        assert (layer.map.config, layer.map.sideslip, layer.map.rear_angle, layer.map.active) == (None,) * 4
    assert npz.to_bytes(npz.from_bytes(npz.to_bytes(loaded), "again")) == npz.to_bytes(loaded)
    assert [config.road.friction for config in layer_configs(loaded, CONFIG)] == [0.3, 0.6]
    with pytest.raises(MapError, match=r"friction\[1\]: 0\.6 is not at least 0\.01 below .*road\.friction = 0\.5"):
        layer_configs(loaded, changed(CONFIG, road={"friction": 0.5}))


REFUSED: list[tuple[Change, str, str, str]] = [
    # (change, place, words of the fault, words of the remedy); test_map.py tests the faults of one table
    (drop("friction"), "friction", "missing", "friction_yaw_rate, or leave out friction_yaw_rate, friction_beta"),
    (drop("friction_delta_r"), "friction_delta_r", "missing", "delta_r for each friction"),
    (put("friction", lambda a: 100.0 * a), "friction[0]", "30 is outside 0.05 to 1.5", "such as 0.3"),
    (put("friction", lambda a: a[::-1]), "friction[1]", "0.5 is not at least 0.01 above", "sort"),
    (cell("friction", 2, 0.895), "friction[2]", "below the friction of the map itself (road.friction = 0.9)", "leave"),
    (put("friction_yaw_rate", lambda a: a[:2]), "friction_yaw_rate", "(2, 6, 5), where (3, 6, 5)", "friction"),
    (cell("friction_yaw_rate", (1, 2, 0), math.nan), "friction_yaw_rate[1, 2, 0]", "nan in", "array 'friction_feasible'"),
    (cell("friction_yaw_rate", (1, 5, 0), 9.0), "friction_yaw_rate[1, 5, 0]", "9 rad/s at vx[5] = 33.33 m/s is", "deg/s"),
    (cell("friction_feasible", 1, False), "friction_feasible[1]", "everywhere at friction 0.5", "leave that layer out"),
]


@pytest.mark.parametrize(("change", "place", "fault", "remedy"), REFUSED)
def test_refused_with_place_and_remedy(change: Change, place: str, fault: str, remedy: str) -> None:
    arrays = arrays_of(STACKED)
    change(arrays)
    with pytest.raises(MapError) as caught:
        npz.from_arrays(arrays, "test")
    assert caught.value.where == f"test: {place}"
    assert fault in caught.value.what and remedy in caught.value.remedy and "\n" not in str(caught.value)


def test_a_stack_of_unlike_maps_is_not_saved() -> None:
    one, middle, last = STACKED.layers
    changes: list[dict[str, Any]] = [{"front_angle": 0.5 * middle.map.front_angle}, {"yaw_rate": middle.map.yaw_rate[:-1]}]
    for change in (*changes, {"sideslip": None}):
        unlike = replace(middle, map=replace(middle.map, **change))
        with pytest.raises(MapError, match=r"^the map to save: friction\[1\]: .*axes and the tables of the map"):
            npz.to_bytes(replace(STACKED, layers=(one, unlike, last)))
    with pytest.raises(MapError, match=r"the map to save: friction\[1\]"):
        npz.to_bytes(replace(STACKED, layers=STACKED.layers[::-1]))

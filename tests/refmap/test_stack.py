"""A stack of maps for several frictions: the physics of another road, solving, and the contract of the file."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from codegen import config as configuration
from codegen.config import Config
from codegen.errors import CodegenError, ConfigError, MapError
from codegen.refmap import archive, stack, tables
from codegen.refmap import map as npz
from codegen.refmap.extend import extend
from codegen.refmap.map import FrictionLayer, ReferenceMap
from codegen.refmap.problem import SteadyTurnProblem
from codegen.refmap.solve import solve_case
from codegen.refmap.stack import layer_configs, lower_frictions, on_road, solve_stack
from codegen.vehicle.dynamics import single_track, two_track
from codegen.vehicle.single_track import SingleTrack
from codegen.vehicle.tyre import AxleTyres
from tests.refmap.cars import random_config

Arrays = dict[str, Any]

ROOT = Path(__file__).resolve().parents[2]
COARSE = {"speed_points": 6, "front_angle_points": 5}
FRICTION = (0.3, 0.5, 0.7, 0.9)
TABLES = ("yaw_rate", "feasible", "sideslip", "rear_angle", "active")


def coarse(**changes: Any) -> Config:
    """The published car on a grid of 6 by 5 cells, with other tables changed."""
    data = configuration.preset().model_dump(mode="json")
    data["grid"] |= COARSE
    for section, values in changes.items():
        data[section] |= values
    return configuration.parse(data, "configuration of the test")


CONFIG = coarse()
SLIPS = np.linspace(-0.3, 0.3, 61)


@pytest.fixture(scope="module")
def stacked() -> ReferenceMap:
    return solve_stack(CONFIG, "4ws-2", FRICTION)


def same_tables(one: ReferenceMap, other: ReferenceMap) -> None:
    """Equal, bit for bit."""
    np.testing.assert_array_equal(one.speed, other.speed)
    np.testing.assert_array_equal(one.front_angle, other.front_angle)
    for name in TABLES:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def on_each_road(reference_map: ReferenceMap) -> list[ReferenceMap]:
    return [*(layer.map for layer in reference_map.layers), reference_map]


# --- the same car on another road ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [0.1, 0.3, 0.9, 1.2])
def test_tyre_of_another_road_is_the_same_tyre(friction: float) -> None:
    nominal, there = AxleTyres.from_config(CONFIG), AxleTyres.from_config(on_road(CONFIG, friction))
    for tyre, other in ((nominal.front, there.front), (nominal.rear, there.rear)):
        assert other.nominal_friction == friction
        assert other.stiffness_factor == tyre.stiffness_factor
        for load in (None, 2_000.0, 9_000.0):
            np.testing.assert_array_equal(other.force(SLIPS, load), tyre.force(SLIPS, load, friction))
    # The slip at which the formula leaves its tangent has nothing to do with its height.
    assert (there.front_slip_bound, there.rear_slip_bound) == (nominal.front_slip_bound, nominal.rear_slip_bound)


def test_cornering_stiffness_falls_with_the_friction() -> None:
    nominal, wet = AxleTyres.from_config(CONFIG), AxleTyres.from_config(on_road(CONFIG, 0.45))
    assert nominal.front.cornering_stiffness == pytest.approx(119_540.0, rel=1e-14)
    assert wet.front.cornering_stiffness == pytest.approx(0.5 * 119_540.0, rel=1e-14)
    assert wet.rear.cornering_stiffness == pytest.approx(0.5 * 119_830.0, rel=1e-14)


@pytest.mark.parametrize("seed", range(30))
def test_any_car_is_the_same_car_there(seed: int) -> None:
    rng = np.random.default_rng(seed)
    config = random_config(rng)
    friction = float(rng.uniform(0.05, 1.0)) * config.road.friction
    nominal = AxleTyres.from_config(config)
    if max(nominal.front.stiffness_factor, nominal.rear.stiffness_factor) > 100.0 or friction < 0.05:
        with pytest.raises(ConfigError, match=r"on a road of friction .* is outside"):
            on_road(config, friction)
        return
    there = AxleTyres.from_config(on_road(config, friction))
    np.testing.assert_array_equal(there.front.force(SLIPS), nominal.front.force(SLIPS, friction=friction))
    np.testing.assert_array_equal(there.rear.force(SLIPS), nominal.rear.force(SLIPS, friction=friction))


def test_models_agree_with_their_own_friction_input() -> None:
    there = on_road(CONFIG, 0.4)
    for make in (lambda config: single_track(config, "magic-formula"), two_track):
        one, other = make(CONFIG), make(there)
        x = np.linspace(0.02, 0.05, len(one.states))
        values = {"speed": 20.0, "front_angle": 0.05, "rear_angle": 0.01, "friction": 0.4}
        u = [values.get(name, 0.0) for name in one.inputs]
        np.testing.assert_array_equal(np.array(one.derivative(x, u)), np.array(other.derivative(x, u)))


def test_only_road_and_tyres_change_and_a_file_can_hold_it() -> None:
    there = on_road(CONFIG, 0.4)
    assert there.road.friction == 0.4
    assert there.tyre.front.cornering_stiffness_n_per_rad is None
    assert there.model_copy(update={"road": CONFIG.road, "tyre": CONFIG.tyre}) == CONFIG
    assert configuration.parse(json.loads(there.to_json()), "test") == there


def test_tyre_given_by_its_factor_keeps_it() -> None:
    tyre = {"cornering_stiffness_n_per_rad": None, "stiffness_factor_b_per_rad": 12.5}
    config = coarse(tyre={"front": tyre, "rear": tyre})
    assert on_road(config, 0.4).tyre == config.tyre


@pytest.mark.parametrize("friction", [-0.3, 0.0, 0.04, 1.6, math.nan])
def test_road_that_there_is_not(friction: float) -> None:
    with pytest.raises(ConfigError, match=r"road\.friction") as caught:
        on_road(CONFIG, friction)
    assert caught.value.remedy


# --- solving ------------------------------------------------------------------------------------------------------------


def test_map_is_the_one_of_the_design_friction_and_layers_those_below(stacked: ReferenceMap) -> None:
    alone = solve_case(CONFIG, "4ws-2")
    same_tables(stacked, alone)
    assert (stacked.config, stacked.case, stacked.meta) == (alone.config, alone.case, alone.meta)
    assert [layer.friction for layer in stacked.layers] == [0.3, 0.5, 0.7]
    for layer in stacked.layers:
        assert layer.map.solved
        assert layer.map.layers == ()
        assert layer.map.config is not None
        assert layer.map.config.road.friction == layer.friction
        assert layer.map.case == "4ws-2"
        assert layer.map.meta == {**alone.meta, "configuration": layer.map.config.model_dump(mode="json")}


@pytest.mark.parametrize("case", ["fws", "4ws-1", "4ws-2"])
def test_layer_is_the_map_of_a_car_with_softer_tyres(case: str) -> None:
    """By hand: cornering stiffness in proportion to the friction leaves B where it is."""
    for layer in solve_stack(CONFIG, case, FRICTION).layers:
        share = layer.friction / 0.9
        softer = {
            axle: {"cornering_stiffness_n_per_rad": share * stiffness}
            for axle, stiffness in (("front", 119540.0), ("rear", 119830.0))
        }
        expected = solve_case(coarse(road={"friction": layer.friction}, tyre=softer), case)
        np.testing.assert_array_equal(layer.map.feasible, expected.feasible)
        # B is rounded in another order, and the slip bound with it.
        np.testing.assert_allclose(layer.map.yaw_rate, expected.yaw_rate, rtol=1e-9)
        np.testing.assert_allclose(layer.map.rear_angle, expected.rear_angle, rtol=1e-9, atol=1e-12)


def test_grip_shrinks_in_proportion(stacked: ReferenceMap) -> None:
    """The published car's bound is its slip, whose force goes with the friction."""

    def cap(config: Config | None) -> float:
        assert config is not None
        return SteadyTurnProblem.from_config(config, config.case("4ws-2")).lateral_acceleration_cap

    for layer in stacked.layers:
        assert cap(layer.map.config) == pytest.approx(layer.friction / 0.9 * cap(CONFIG), rel=1e-12)
        used = np.nanmax(layer.map.speed[:, np.newaxis] * layer.map.yaw_rate)
        assert used <= cap(layer.map.config) * (1.0 + 1e-12)
    cells = [int(layer.map.feasible.sum()) for layer in stacked.layers]
    assert cells == sorted(cells)
    assert cells[0] < cells[-1] <= stacked.feasible.sum()


def test_each_layer_extends_by_itself(stacked: ReferenceMap) -> None:
    another_car = coarse(vehicle={"mass_kg": 1_500.0})
    for layer, config in zip(stacked.layers, layer_configs(stacked, another_car), strict=True):
        assert config == layer.map.config
        total = extend(layer.map, CONFIG)
        assert total.friction == layer.friction
        assert np.isfinite(total.yaw_rate).all()


def test_order_of_the_list_is_free(stacked: ReferenceMap) -> None:
    assert npz.to_bytes(solve_stack(CONFIG, "4ws-2", (0.9, 0.3, 0.7, 0.5))) == npz.to_bytes(stacked)


def test_both_methods_agree_and_progress_counts_all_cells(stacked: ReferenceMap) -> None:
    calls: list[tuple[int, int]] = []
    found = solve_stack(CONFIG, "4ws-2", (0.5, 0.9), "ipopt", lambda done, total: calls.append((done, total)))
    assert calls == [(5 * (row + 1), 60) for row in range(12)]
    assert found.layers[0].map.meta["method"] == found.meta["method"] == "ipopt"
    expected = stacked.layers[1].map
    np.testing.assert_array_equal(found.layers[0].map.feasible, expected.feasible)
    np.testing.assert_allclose(
        found.layers[0].map.yaw_rate, expected.yaw_rate, rtol=0.0, atol=1e-6
    )  # the agreement asked of them


@pytest.mark.parametrize("method", ["exact", "ipopt"])
def test_a_passively_safe_case_is_so_on_each_road(method: stack.Method) -> None:
    case = CONFIG.cases["4ws-2"].model_dump()
    config = coarse(cases={"safe": case | {"passive_safe": True}, "plain": case})
    safe, plain = (solve_stack(config, name, (0.4, 0.9), method) for name in ("safe", "plain"))
    passive = solve_stack(config, "fws", (0.4, 0.9))
    for one, other, straight in zip(*(on_each_road(found) for found in (safe, plain, passive)), strict=True):
        np.testing.assert_array_equal(one.feasible, other.feasible & straight.feasible)
        assert one.feasible.sum() < other.feasible.sum()


@pytest.mark.parametrize(
    ("friction", "fault"),
    [
        ((), "no friction, where two or more"),
        ((0.9,), "1 friction, where two or more"),
        ((0.3,), "1 friction, where two or more"),
        ((0.3, 0.3, 0.9), "0.3 is there twice"),
        ((0.3, 0.9, 0.9), "0.9 is there twice"),
        ((0.895, 0.9), "too close together"),
        ((-0.3, 0.9), "-0.3 is outside 0.05 to 1.5"),
        ((0.0, 0.9), "0 is outside"),
        ((0.3, math.nan, 0.9), "nan is outside"),
        ((0.3, math.inf), "inf is outside"),
        ((0.3, 0.8), "the largest friction, 0.8, is not the one"),
        ((0.3, 0.9, 1.1), "the largest friction, 1.1, is not the one"),
        ((0.3, 0.9 + 2e-9), "is not the one"),
        (tuple(np.linspace(0.2, 0.9, 34)), "34 frictions"),
    ],
)
def test_bad_frictions(friction: tuple[float, ...], fault: str) -> None:
    with pytest.raises(ConfigError) as caught:
        solve_stack(CONFIG, "4ws-2", friction)
    assert fault in caught.value.what
    assert caught.value.where == "--friction"
    assert caught.value.remedy


def test_frictions_on_the_limits_are_taken() -> None:
    assert lower_frictions(CONFIG, (0.05, 0.06, 0.88, 0.89, 0.9 + 0.9e-9)) == (0.05, 0.06, 0.88, 0.89)
    assert len(lower_frictions(CONFIG, tuple(np.linspace(0.2, 0.9, 33)))) == 32


def test_layer_without_a_feasible_cell_is_refused_with_its_friction() -> None:
    config = coarse(grid={"front_angle_min_deg": 6.0, "speed_min_km_h": 40.0})
    assert solve_case(config, "4ws-2").feasible.any()
    with pytest.raises(MapError, match=r"friction 0\.1: \[cases\.4ws-2\]: no operating point .* leave this friction out"):
        solve_stack(config, "4ws-2", (0.1, 0.9))


def test_oversteering_car_that_is_unstable_earlier_on_ice() -> None:
    config = coarse(tyre={"rear": {"cornering_stiffness_n_per_rad": 100e3}})
    critical = SingleTrack.from_config(config).critical_speed
    # The understeer coefficient goes with 1/friction, the critical speed with the root of the friction.
    assert SingleTrack.from_config(on_road(config, 0.225)).critical_speed == pytest.approx(0.5 * critical, rel=1e-12)
    config = coarse(tyre={"rear": {"cornering_stiffness_n_per_rad": 100e3}}, grid={"speed_max_km_h": 0.9 * 3.6 * critical})
    solve_case(config, "4ws-2")
    with pytest.raises(ConfigError, match=r"friction 0\.225: grid\.speed_max_km_h: .*unstable.* or leave this friction out"):
        solve_stack(config, "4ws-2", (0.225, 0.9))


def test_stack_that_no_file_can_hold_is_refused_before_it_is_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    def solve(*_: object) -> None:
        pytest.fail("solved")

    monkeypatch.setattr(stack, "solve_case", solve)
    config = coarse(grid={"speed_points": 1000, "front_angle_points": 1000})
    with pytest.raises(MapError, match=r"over 64 MiB.*fewer breakpoints, or its stack fewer frictions"):
        solve_stack(config, "4ws-2", FRICTION)


def test_size_is_judged_before_solving_as_it_is_after(stacked: ReferenceMap) -> None:
    with zipfile.ZipFile(io.BytesIO(npz.to_bytes(stacked))) as packed:
        sizes = {info.filename: info.file_size - archive.NPY_HEADER_BYTES for info in packed.infolist()}
    of_cells = sum(size for name, size in sizes.items() if name not in ("vx.npy", "delta_f.npy", "friction.npy", "meta.npy"))
    assert of_cells == 4 * 30 * stack.CELL_BYTES


# --- the file -----------------------------------------------------------------------------------------------------------


def arrays_of(data: bytes) -> Arrays:
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        return {key: file[key] for key in file.files}


@pytest.fixture
def arrays(stacked: ReferenceMap) -> Arrays:
    """What the file holds, writable."""
    return {key: np.array(array) for key, array in arrays_of(npz.to_bytes(stacked)).items()}


def test_keys_shapes_and_dtypes(arrays: Arrays) -> None:
    plain = ["vx", "delta_f", "yaw_rate", "beta", "delta_r", "feasible", "active"]
    assert list(arrays) == [
        *plain,
        "friction",
        *(f"friction_{key}" for key in ("yaw_rate", "beta", "delta_r", "feasible", "active")),
        "meta",
    ]
    np.testing.assert_array_equal(arrays["friction"], [0.3, 0.5, 0.7])
    for key in plain[2:]:
        assert arrays[f"friction_{key}"].shape == (3, 6, 5)
        assert arrays[f"friction_{key}"].dtype == arrays[key].dtype


def test_round_trip(stacked: ReferenceMap, tmp_path: Path) -> None:
    npz.save(stacked, tmp_path / "stack.npz")
    loaded = npz.load(tmp_path / "stack.npz")
    same_tables(loaded, stacked)
    assert [layer.friction for layer in loaded.layers] == [layer.friction for layer in stacked.layers]
    for one, other in zip(loaded.layers, stacked.layers, strict=True):
        same_tables(one.map, other.map)
        assert (one.map.config, one.map.case, one.map.meta) == (other.map.config, other.map.case, other.map.meta)
        assert one.map.solved
        for name in TABLES:
            with pytest.raises(ValueError, match="read-only"):
                getattr(one.map, name)[...] = 0
    assert npz.to_bytes(loaded) == (tmp_path / "stack.npz").read_bytes() == npz.to_bytes(solve_stack(CONFIG, "4ws-2", FRICTION))


def test_reader_of_the_map_alone_finds_it(stacked: ReferenceMap) -> None:
    """The stack only adds keys: all others are, byte for byte, those of the map without it."""
    alone = arrays_of(npz.to_bytes(replace(stacked, layers=())))
    found = arrays_of(npz.to_bytes(stacked))
    assert set(alone) == {key for key in found if not key.startswith("friction")}
    for key, array in alone.items():
        assert found[key].tobytes() == array.tobytes()


def test_layer_is_a_map_that_can_be_saved_alone(stacked: ReferenceMap) -> None:
    layer = stacked.layers[0].map
    loaded = npz.from_bytes(npz.to_bytes(layer), "test")
    same_tables(loaded, layer)
    assert loaded.config == layer.config
    assert loaded.solved


def test_committed_map_without_a_stack_keeps_its_bytes() -> None:
    path = ROOT / "generated" / "4ws2.npz"
    loaded = npz.load(path)
    assert loaded.layers == ()
    assert npz.to_bytes(loaded) == path.read_bytes()


def test_another_configuration_reaches_the_layers(stacked: ReferenceMap) -> None:
    """Who gives the map new gains, say, gives them to its layers."""
    assert stacked.config is not None
    changed = stacked.config.model_copy(update={"limits": stacked.config.limits.model_copy(update={"rear_angle_max_deg": 3.0})})
    other = replace(stacked, config=changed, meta={**stacked.meta, "configuration": changed.model_dump(mode="json")})
    for layer in other.layers:
        assert layer.map.config == on_road(changed, layer.friction)
        assert layer.map.meta["configuration"] == on_road(changed, layer.friction).model_dump(mode="json")
    reloaded = npz.from_bytes(npz.to_bytes(other), "test")
    assert [layer.map.config for layer in reloaded.layers] == [layer.map.config for layer in other.layers]


def test_a_layer_has_no_stack_of_its_own(stacked: ReferenceMap) -> None:
    nested = replace(stacked, layers=(FrictionLayer(0.5, stacked),))
    assert nested.layers[0].map.layers == ()


def bare_arrays() -> Arrays:
    """As a user's own tool makes them: three required arrays, and a stack of the one table."""
    speed, angle = np.array([5.0, 15.0, 30.0]), np.array([0.02, 0.05, 0.1])
    yaw_rate = np.minimum(np.outer(speed / 3.2, angle), 6.0 / speed[:, np.newaxis])
    return {
        "vx": speed,
        "delta_f": angle,
        "yaw_rate": yaw_rate,
        "friction": np.array([0.3, 0.6]),
        "friction_yaw_rate": np.stack([yaw_rate / 3.0, yaw_rate / 1.5]),
    }


def test_bare_map_may_have_a_stack() -> None:
    loaded = npz.from_arrays(bare_arrays(), "test")
    for layer, share in zip(loaded.layers, (3.0, 1.5), strict=True):
        np.testing.assert_array_equal(layer.map.yaw_rate, bare_arrays()["yaw_rate"] / share)
        assert layer.map.feasible.all()
        assert (layer.map.config, layer.map.sideslip, layer.map.rear_angle, layer.map.active) == (None,) * 4
        assert not layer.map.solved
    assert npz.to_bytes(npz.from_bytes(npz.to_bytes(loaded), "again")) == npz.to_bytes(loaded)
    assert [config.road.friction for config in layer_configs(loaded, CONFIG)] == [0.3, 0.6]


def test_stack_of_a_bare_map_is_held_to_the_friction_of_the_chosen_car() -> None:
    with pytest.raises(MapError, match=r"friction\[1\]: 0\.6 is not at least 0\.01 below .*road\.friction = 0\.5"):
        layer_configs(npz.from_arrays(bare_arrays(), "test"), coarse(road={"friction": 0.5}))


@pytest.mark.parametrize("filling", [0.0, 1e9, math.inf, math.nan])
def test_infeasible_cells_of_a_layer_become_nan_whatever_fills_them(filling: float, arrays: Arrays) -> None:
    for key in ("friction_yaw_rate", "friction_beta", "friction_delta_r"):
        arrays[key][~arrays["friction_feasible"]] = filling
    for layer in npz.from_arrays(arrays, "test").layers:
        for values in (layer.map.yaw_rate, layer.map.sideslip, layer.map.rear_angle):
            np.testing.assert_array_equal(np.isnan(values), ~layer.map.feasible)


# --- what is refused ----------------------------------------------------------------------------------------------------

Change = Callable[[Arrays], None]


def cell(key: str, index: Any, value: float) -> Change:
    return lambda arrays: arrays[key].__setitem__(index, value)


def put(key: str, value: Callable[[Any], Any]) -> Change:
    return lambda arrays: arrays.__setitem__(key, value(arrays[key]))


def drop(*keys: str) -> Change:
    def change(arrays: Arrays) -> None:
        for key in keys:
            del arrays[key]

    return change


def in_turn(*changes: Change) -> Change:
    def change(arrays: Arrays) -> None:
        for one in changes:
            one(arrays)

    return change


REFUSED = {
    # name: (change, place after the file name, words of the fault, words of the remedy)
    "no frictions": (
        drop("friction"),
        "friction",
        "missing",
        "friction_yaw_rate, or leave out friction_yaw_rate, friction_beta",
    ),
    "no yaw rates": (drop("friction_yaw_rate"), "friction_yaw_rate", "missing", "yaw_rate for each friction"),
    "no rear angles": (drop("friction_delta_r"), "friction_delta_r", "missing", "delta_r for each friction"),
    "no sideslip": (drop("friction_beta"), "friction_beta", "missing", "beta for each friction"),
    "no binding constraints": (drop("friction_active"), "friction_active", "missing", "active for each friction"),
    "frictions alone": (
        drop("friction_yaw_rate", "friction_beta", "friction_delta_r", "friction_feasible", "friction_active"),
        "friction_yaw_rate",
        "missing",
        "or leave out friction",
    ),
    "rear angles of the stack alone": (
        drop("delta_r"),
        "friction_delta_r",
        "the map has no delta_r",
        "leave out friction_delta_r",
    ),
    "scalar friction": (put("friction", lambda _: np.array(0.9)), "friction", "one dimension", "ravel"),
    "text friction": (put("friction", lambda a: a.astype(str)), "friction", "text values", "plain numbers"),
    "complex friction": (put("friction", lambda a: a + 0j), "friction", "complex values", "plain numbers"),
    "object friction": (put("friction", lambda a: a.astype(object)), "friction", "object array", "numpy.savez"),
    "object layers": (put("friction_beta", lambda a: a.astype(object)), "friction_beta", "object array", "numpy.savez"),
    "empty friction": (put("friction", lambda a: a[:0]), "friction", "0 frictions", "leave out"),
    "friction in percent": (put("friction", lambda a: 100.0 * a), "friction[0]", "30 is outside 0.05 to 1.5", "such as 0.3"),
    "negative friction": (cell("friction", 0, -0.3), "friction[0]", "-0.3 is outside", "such as 0.3"),
    "NaN friction": (cell("friction", 1, math.nan), "friction[1]", "nan on an axis", "finite"),
    "infinite friction": (cell("friction", 2, math.inf), "friction[2]", "inf on an axis", "finite"),
    "falling frictions": (put("friction", lambda a: a[::-1]), "friction[1]", "0.5 is not at least 0.01 above", "sort"),
    "equal frictions": (cell("friction", 1, 0.3), "friction[1]", "0.3 is not at least 0.01 above", "remove doubles"),
    "frictions too close": (cell("friction", 1, 0.305), "friction[1]", "0.305 is not at least 0.01 above", "remove doubles"),
    "the design friction": (cell("friction", 2, 0.9), "friction[2]", "0.9 is not at least 0.01 below", "leave that layer out"),
    "above the design friction": (cell("friction", 2, 1.1), "friction[2]", "(road.friction = 0.9)", "leave that layer out"),
    "just below the design friction": (cell("friction", 2, 0.895), "friction[2]", "below the friction of the map", "leave"),
    "one layer too few": (
        put("friction_yaw_rate", lambda a: a[:2]),
        "friction_yaw_rate",
        "(2, 6, 5), where (3, 6, 5)",
        "friction",
    ),
    "layers flat": (put("friction_beta", lambda a: a[0]), "friction_beta", "(friction by vx by delta_f)", "each friction"),
    "layers transposed": (put("friction_delta_r", lambda a: a.T), "friction_delta_r", "(5, 6, 3), where", "transpose"),
    "short feasible": (
        put("friction_feasible", lambda a: a[:, :5]),
        "friction_feasible",
        "shape (3, 5, 5)",
        "a row for each vx",
    ),
    "short active": (put("friction_active", lambda a: a[..., :2]), "friction_active", "shape (3, 6, 2)", "a row for each vx"),
    "text layers": (put("friction_yaw_rate", lambda a: a.astype(str)), "friction_yaw_rate", "text values", "plain numbers"),
    "NaN yaw rate": (
        cell("friction_yaw_rate", (1, 2, 0), math.nan),
        "friction_yaw_rate[1, 2, 0]",
        "nan in a feasible cell",
        "in an array 'friction_feasible'",
    ),
    "inf rear angle": (
        cell("friction_delta_r", (2, 0, 0), -math.inf),
        "friction_delta_r[2, 0, 0]",
        "-inf in a feasible",
        "mark",
    ),
    "yaw rate to the right": (
        cell("friction_yaw_rate", (0, 1, 0), -0.1),
        "friction_yaw_rate[0, 1, 0]",
        "-0.1 is outside",
        "sign",
    ),
    "yaw rate in deg/s": (
        cell("friction_yaw_rate", (2, 0, 1), 20.0),
        "friction_yaw_rate[2, 0, 1]",
        "outside 0 to 10 rad/s",
        "pi/180",
    ),
    "yaw rate that no tyre allows": (
        cell("friction_yaw_rate", (1, 5, 0), 9.0),
        "friction_yaw_rate[1, 5, 0]",
        "9 rad/s at vx[5] = 33.33 m/s is 30.6 g",
        "deg/s",
    ),
    "sideslip in degrees": (cell("friction_beta", (0, 0, 0), 2.0), "friction_beta[0, 0, 0]", "2 is outside", "pi/180"),
    "rear angle in degrees": (
        cell("friction_delta_r", (0, 0, 0), 3.5),
        "friction_delta_r[0, 0, 0]",
        "3.5 is outside",
        "pi/180",
    ),
    "feasible of twos": (
        put("friction_feasible", lambda a: a * 2.0),
        "friction_feasible[0, 0, 0]",
        "neither true nor false",
        "booleans",
    ),
    "layer without a feasible cell": (
        cell("friction_feasible", 1, False),
        "friction_feasible[1]",
        "infeasible everywhere at friction 0.5",
        "leave that layer out",
    ),
    "unknown constraint": (cell("friction_active", (2, 1, 1), 32), "friction_active[2, 1, 1]", "32 is no set", "0 to 31"),
    "frictions by the thousand": (
        in_turn(
            put("friction", lambda _: np.linspace(0.1, 0.8, 33)),
            *(put(f"friction_{key}", lambda a: np.repeat(a, 11, axis=0)) for key in tables.TABLES),
        ),
        "friction",
        "33 frictions",
        "1 to 32",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_place_and_remedy(name: str, arrays: Arrays, tmp_path: Path) -> None:
    change, place, fault, remedy = REFUSED[name]
    change(arrays)
    path = tmp_path / "stack.npz"
    np.savez(path, **arrays)
    with pytest.raises(MapError) as caught:
        npz.load(path)
    error = caught.value
    assert error.where == f"{path}: {place}"
    assert fault in error.what
    assert remedy in error.remedy
    assert "\n" not in str(error)


def test_car_that_cannot_stand_for_a_layer_is_refused(arrays: Arrays) -> None:
    """A tyre so stiff that its B is none that a configuration may give."""
    meta = json.loads(arrays["meta"].item())
    meta["configuration"]["tyre"]["front"]["cornering_stiffness_n_per_rad"] = 1.9e6
    with pytest.raises(MapError, match=r"test: on a road of friction 0\.3: tyre\.front\.stiffness_factor_b_per_rad: .*100"):
        npz.from_arrays(arrays | {"meta": np.array(json.dumps(meta))}, "test")


def broken_layers(stacked: ReferenceMap) -> Iterator[tuple[str, ReferenceMap]]:
    layer = stacked.layers[1]
    for name, changed in {
        "other speeds": replace(layer.map, speed=layer.map.speed + 1.0),
        "other front angles": replace(layer.map, front_angle=0.5 * layer.map.front_angle),
        "another shape": replace(layer.map, yaw_rate=layer.map.yaw_rate[:-1]),
        "a table less": replace(layer.map, sideslip=None),
    }.items():
        yield name, replace(stacked, layers=(stacked.layers[0], FrictionLayer(layer.friction, changed), stacked.layers[2]))
    yield "a table more", replace(stacked, sideslip=None, layers=stacked.layers[:2])


def test_stack_of_unlike_maps_is_not_saved(stacked: ReferenceMap) -> None:
    for name, broken in broken_layers(stacked):
        with pytest.raises(MapError, match="axes and the tables of the map") as caught:
            npz.to_bytes(broken)
        assert caught.value.where == f"the map to save: friction[{0 if name == 'a table more' else 1}]", name


def test_layers_out_of_order_are_not_saved(stacked: ReferenceMap) -> None:
    with pytest.raises(MapError, match=r"the map to save: friction\[1\]"):
        npz.to_bytes(replace(stacked, layers=stacked.layers[::-1]))


@settings(deadline=None)
@given(
    st.lists(st.floats(0.0, 2.0), max_size=5),
    st.lists(st.tuples(st.integers(0, 2), st.integers(0, 5), st.integers(0, 4)), max_size=3),
    st.sampled_from(["friction_yaw_rate", "friction_beta", "friction_delta_r", "friction_feasible", "friction_active"]),
    st.floats() | st.sampled_from([0.0, 1.0]),
)
def test_any_stack_is_a_map_that_keeps_its_promises_or_is_refused(
    friction: list[float], cells: list[tuple[int, int, int]], key: str, value: float
) -> None:
    arrays = {name: np.array(array) for name, array in arrays_of(SAVED).items()}
    if friction:
        arrays["friction"] = np.array(friction)
    arrays[key] = arrays[key].astype(np.float64)
    for index in cells:
        arrays[key][index] = value
    try:
        loaded = npz.from_arrays(arrays, "fuzz")
    except CodegenError as error:
        assert isinstance(error, MapError)
        assert error.where.startswith("fuzz: friction")
        assert error.remedy
        return
    below = np.array([layer.friction for layer in loaded.layers] + [0.9])
    assert np.all(np.diff(below) > 0.0099)
    for layer in loaded.layers:
        assert layer.map.feasible.any()
        np.testing.assert_array_equal(np.isnan(layer.map.yaw_rate), ~layer.map.feasible)
    assert npz.to_bytes(npz.from_bytes(npz.to_bytes(loaded), "again")) == npz.to_bytes(loaded)


@settings(deadline=None)
@given(st.lists(st.floats(0.05, 1.5), min_size=1, max_size=6, unique=True))
def test_any_list_becomes_rising_layers_or_is_refused(friction: list[float]) -> None:
    config = coarse(road={"friction": max(friction)})
    try:
        lower = lower_frictions(config, friction)
    except ConfigError as error:
        gaps = np.diff(sorted(friction))
        assert len(friction) < 2 or gaps.min() < tables.FRICTION_STEP_MIN, error
        return
    assert sorted([*lower, max(friction)]) == sorted(friction) == [*lower, max(friction)]


SAVED = npz.to_bytes(solve_stack(CONFIG, "4ws-2", FRICTION))

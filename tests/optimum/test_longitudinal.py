"""The stack over longitudinal acceleration: the friction ellipse and the loads, solving, and the file contract."""

import io
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from codegen.configuration import Config
from codegen.ecu_map.extend import TotalMap, extend
from codegen.errors import ConfigError, MapError
from codegen.map_file import map as npz
from codegen.map_file.longitudinal import like_friction, under_acceleration
from codegen.map_file.map import Layer, ReferenceMap
from codegen.map_file.tables import ACCELERATION_STACK
from codegen.optimum.problem import SteadyTurnProblem
from codegen.optimum.solve import solve_acceleration_stack, solve_case, solve_stack, stack_of
from codegen.report.summary import map_summary
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre
from tests.map_file.test_map import TABLES, Change, cell, drop, put
from tests.optimum.cars import CASE, PAPER, changed, random_config

CONFIG = changed(PAPER, grid={"speed_points": 6, "front_angle_points": 5})
STACKED = solve_acceleration_stack(CONFIG, "4ws-2", (3.0, 0.0, -4.0))


def peak_of_axle(tyre: MagicFormulaTyre, load: float, moved: float, friction: float) -> float:
    """Return the sum of D = mu (p1 + p2 (F / F0 - 1)) F over both wheels, from its definition."""
    loads = (load - moved, load + moved)
    relative = [tyre.peak_factor + tyre.peak_load_sensitivity * (one / tyre.static_load - 1.0) for one in loads]
    return friction * sum(share * one for share, one in zip(relative, loads, strict=True))


@pytest.mark.parametrize("acceleration", [-3.0, -0.5, 2.0])
def test_the_friction_ellipse_of_each_axle(acceleration: float) -> None:
    """Random cars: the axle loads balance, and Fx and the lateral peak lie on the ellipse, for any lateral load transfer."""
    rng, seen = np.random.default_rng(20_261_128), 0
    for _ in range(20):
        config = random_config(rng)
        sensitivity = {"peak_load_sensitivity_p2": float(rng.uniform(-0.3, 0.1))}
        tyre = {axle: {**getattr(config.tyre, axle).model_dump(), **sensitivity} for axle in ("front", "rear")}
        brakes = {"brake_front_share": float(rng.uniform(0.3, 0.8)), "drive_front_share": float(rng.uniform(0.0, 1.0))}
        config = changed(config, tyre=tyre, longitudinal=brakes)
        try:
            moving = under_acceleration(config, acceleration)
        except ConfigError:
            continue  # on its road, an axle has not that much grip, or less than a configuration may have
        vehicle, friction = config.vehicle, config.road.friction
        before, after = AxleTyres.from_config(config), AxleTyres.from_config(moving)
        weight = vehicle.mass_kg * config.road.gravity_m_s2
        arms = (vehicle.cg_to_rear_axle_m, vehicle.cg_to_front_axle_m)
        front = brakes["brake_front_share" if acceleration < 0.0 else "drive_front_share"]
        # Moments about the contact point of the other axle.
        turned = vehicle.mass_kg * acceleration * vehicle.cg_height_m
        loads = [(weight * arms[0] - turned) / vehicle.wheelbase, (weight * arms[1] + turned) / vehicle.wheelbase]
        assert sum(loads) == pytest.approx(weight)
        for own, then, load, share in zip(
            (before.front, before.rear), (after.front, after.rear), loads, (front, 1.0 - front), strict=True
        ):
            force = share * vehicle.mass_kg * acceleration
            whole = peak_of_axle(own, 0.5 * load, 0.0, friction)
            lateral = 2.0 * then.peak(then.static_load, friction)
            assert math.hypot(lateral, force) == pytest.approx(whole, rel=1e-12)
            assert then.stiffness_factor == pytest.approx(own.stiffness_factor, rel=1e-12)
            for moved in (0.1 * own.static_load, 0.4 * own.static_load):
                with_transfer = sum(then.peak(then.static_load + each, friction) for each in (-moved, moved))
                left = math.sqrt(1.0 - (force / whole) ** 2)
                assert with_transfer == pytest.approx(left * peak_of_axle(own, 0.5 * load, moved, friction), rel=1e-12)
        assert (after.front_slip_bound, after.rear_slip_bound) == pytest.approx(
            (before.front_slip_bound, before.rear_slip_bound)
        )
        seen += 1
    assert seen >= 10


def test_grip_in_the_linear_turn() -> None:
    """ay_cap is that of the weaker axle: alpha_max C L / (m l) with the stiffness that is left."""
    at_rest = SteadyTurnProblem.from_config(PAPER, PAPER.case("4ws-2"))
    for acceleration in (-6.0, -4.0, 3.0):
        moving = under_acceleration(PAPER, acceleration)
        problem = SteadyTurnProblem.from_config(moving, moving.case("4ws-2"))
        caps = [
            getattr(moving.tyre, axle).peak_factor_p1
            * getattr(at_rest, f"{axle}_slip_max")
            / getattr(at_rest.car, f"{axle}_slip_per_lateral_acceleration")
            for axle in ("front", "rear")
        ]
        assert problem.lateral_acceleration_cap == pytest.approx(min(caps), rel=1e-9)
        assert like_friction(PAPER, acceleration) == pytest.approx(
            0.9 * min(moving.tyre.front.peak_factor_p1, moving.tyre.rear.peak_factor_p1), rel=1e-12
        )
    assert "longitudinal" not in PAPER.model_dump()  # so that maps without such a stack do not change


@pytest.mark.parametrize("tyre_model", ["linear", "magic-formula"])
def test_a_stack_compared_with_ipopt(tyre_model: str) -> None:
    config = CONFIG.with_tyre_model(tyre_model)
    found, expected = (solve_acceleration_stack(config, "4ws-2", (-4.0, 0.0, 3.0), method) for method in ("exact", "ipopt"))
    for one, other in zip(found.layers, expected.layers, strict=True):
        np.testing.assert_array_equal(one.map.feasible, other.map.feasible)
        np.testing.assert_allclose(one.map.yaw_rate, other.map.yaw_rate, rtol=0.0, atol=1e-6)


def test_the_map_is_for_constant_speed_and_the_layers_are_around() -> None:
    alone = solve_case(CONFIG, "4ws-2")
    for name in TABLES:
        np.testing.assert_array_equal(getattr(STACKED, name), getattr(alone, name))
    assert [layer.value for layer in STACKED.layers] == [-4.0, 3.0]
    for layer in STACKED.layers:
        assert layer.map.config == under_acceleration(CONFIG, layer.value)
        own = solve_case(under_acceleration(CONFIG, layer.value), "4ws-2")
        np.testing.assert_array_equal(layer.map.yaw_rate, own.yaw_rate)
        assert layer.map.feasible.sum() <= STACKED.feasible.sum()
    # Zero changes nothing but how the tyre is given.
    np.testing.assert_allclose(solve_case(under_acceleration(CONFIG, 0.0), "4ws-2").yaw_rate, alone.yaw_rate, rtol=1e-12)
    facts = map_summary(STACKED)
    assert [row[0] for row in facts.acceleration_rows] == ["-4", "0 (the map itself)", "3"]
    assert facts.headline.endswith("; a stack with longitudinal acceleration -4, 3 m/s^2")
    assert "acceleration_stack" not in map_summary(alone).to_dict()


@pytest.mark.parametrize(
    ("acceleration", "fault"),
    [
        ((0.0,), "1 accelerations"),
        ((-4.0, 3.0), "no zero, the acceleration"),
        ((-4.0, -3.9, 0.0), "too close together"),
        ((0.0, 0.2), "too close together"),
        ((-20.0, 0.0), "-20 is outside -15 to 15 m/s^2"),
        ((0.0, math.nan), "nan is outside"),
    ],
)
def test_bad_accelerations_are_refused(acceleration: tuple[float, ...], fault: str) -> None:
    with pytest.raises(ConfigError) as caught:
        solve_acceleration_stack(CONFIG, "4ws-2", acceleration)
    assert fault in caught.value.what
    assert caught.value.where == "`longitudinal_acceleration=`" and caught.value.remedy


@pytest.mark.parametrize(
    ("tables", "acceleration", "words"),
    [
        ({}, -9.0, "at -9 m/s^2: the front wheels need 6830 N each, and have 6406 N of grip; check [longitudinal]"),
        ({"longitudinal": {"drive_front_share": 0.0}}, 6.0, "the rear wheels need 7005 N each"),
        ({"vehicle": {"cg_height_m": 3.0}, "road": {"friction": 1.5}}, -6.0, "the rear wheels lift"),
    ],
)
def test_an_acceleration_without_grip_is_refused(tables: dict[str, Any], acceleration: float, words: str) -> None:
    config = changed(CONFIG, controller={"inputs": {"friction_max": 1.5}}, **tables)
    with pytest.raises(ConfigError) as caught:
        under_acceleration(config, acceleration)
    assert words in str(caught.value)
    with pytest.raises(ConfigError, match=rf"^acceleration {acceleration:g}: at .*, or leave this acceleration out"):
        solve_acceleration_stack(config, "4ws-2", (acceleration, 0.0))


def test_the_layers_of_the_total_map_rise_around_the_map_itself() -> None:
    total = extend(STACKED, CONFIG)
    assert [layer.acceleration for layer in total.stack] == [-4.0, 0.0, 3.0]
    assert total.quantity is ACCELERATION_STACK and total.acceleration == 0.0 and total.axle_shares == (1.0, 1.0)
    for layer in total.layers:
        assert CONFIG.road.friction * min(layer.axle_shares) == like_friction(CONFIG, layer.acceleration)
    assert TotalMap.of_stack(reversed(total.stack)).acceleration == 0.0
    assert [value for value, _, _ in stack_of(STACKED, CONFIG)] == [-4.0, 0.0, 3.0]


# --- the file ---------------------------------------------------------------------------------------------------------


def arrays_of(reference_map: ReferenceMap) -> dict[str, Any]:
    """Return the content of the file, writable."""
    with np.load(io.BytesIO(npz.to_bytes(reference_map)), allow_pickle=False) as file:
        return {key: np.array(file[key]) for key in file.files}


def test_the_stack_only_adds_keys_and_is_read_again() -> None:
    plain = arrays_of(replace(STACKED, layers=()))
    found = arrays_of(STACKED)
    assert all(found[key].tobytes() == array.tobytes() for key, array in plain.items())
    prefix = "longitudinal_acceleration"
    tables = ("yaw_rate", "beta", "delta_r", "feasible", "active")
    assert set(found) - set(plain) == {prefix, *(f"{prefix}_{key}" for key in tables)}
    loaded = npz.from_bytes(npz.to_bytes(STACKED), "test")
    assert npz.to_bytes(loaded) == npz.to_bytes(STACKED) and loaded.quantity is ACCELERATION_STACK
    for layer, other in zip(loaded.layers, STACKED.layers, strict=True):
        np.testing.assert_array_equal(layer.map.yaw_rate, other.map.yaw_rate)
        assert (layer.value, layer.map.config, layer.map.meta) == (other.value, other.map.config, other.map.meta)
    new: Config = changed(CONFIG, longitudinal={"brake_front_share": 0.6})
    meta = {**STACKED.meta, "configuration": new.model_dump(mode="json")}
    other = npz.from_bytes(npz.to_bytes(replace(STACKED, config=new, meta=meta)), "test")
    assert other.layers[0].map.config == under_acceleration(new, -4.0)


REFUSED: list[tuple[Change, str, str, str]] = [
    # (change, place, words of the fault, words of the remedy)
    (drop("longitudinal_acceleration"), "longitudinal_acceleration", "missing", "add it, the acceleration of each layer"),
    (drop("longitudinal_acceleration_beta"), "longitudinal_acceleration_beta", "missing", "beta for each acceleration"),
    (cell("longitudinal_acceleration", 1, 0.2), "longitudinal_acceleration[1]", "0.2 is not at least 0.5 from zero", "leave"),
    (cell("longitudinal_acceleration", 0, -40.0), "longitudinal_acceleration[0]", "outside -15 to 15 m/s^2", "no car"),
    (
        put("longitudinal_acceleration", lambda a: a[::-1]),
        "longitudinal_acceleration[1]",
        "-4 is not at least 0.5 above",
        "sort",
    ),
    (cell("longitudinal_acceleration", 0, -12.0), "at -12 m/s^2", "wheels need", "check [longitudinal]"),
    (cell("longitudinal_acceleration_yaw_rate", (1, 5, 0), 9.0), "yaw_rate[1, 5, 0]", "9 rad/s at vx[5]", "deg/s"),
    (put("friction", lambda _: np.array([0.5])), "friction_yaw_rate", "missing", "for each friction"),
]


@pytest.mark.parametrize(("change", "place", "fault", "remedy"), REFUSED)
def test_refused_with_place_and_remedy(change: Change, place: str, fault: str, remedy: str) -> None:
    arrays = arrays_of(STACKED)
    if "friction" in place:
        arrays["friction"] = np.array([0.5])
    change(arrays)
    with pytest.raises(MapError) as caught:
        npz.from_arrays(arrays, "test")
    message = str(caught.value)
    assert place in str(caught.value.where) and fault in message and remedy in message


def test_two_stacks_are_refused() -> None:
    arrays = arrays_of(STACKED)
    on_roads = arrays_of(solve_stack(CONFIG, "4ws-2", (0.5, 0.9)))
    with pytest.raises(MapError, match=r"longitudinal_acceleration: a map has one stack at most; leave out the keys of one"):
        npz.from_arrays({**arrays, **on_roads}, "test")


def test_a_layer_on_other_axes_cannot_be_saved() -> None:
    other = solve_case(changed(CONFIG, grid={"speed_points": 7}), "4ws-2")
    with pytest.raises(MapError, match=r"longitudinal_acceleration\[0\]"):
        npz.to_bytes(replace(STACKED, layers=(Layer(ACCELERATION_STACK, -4.0, other),)))
    assert CASE  # the random cars have one

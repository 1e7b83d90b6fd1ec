"""The stack over longitudinal acceleration in the C: signal, lookup, monitoring, laws, and drives of a car that brakes."""

import functools
import math
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pytest

from codegen.arrays import FloatArray
from codegen.configuration import Config, Kind, parse
from codegen.ecu_map.extend import extend
from codegen.ecu_map.lookup import Lookup
from codegen.emit.build import with_signals
from codegen.errors import ConfigError
from codegen.export.fmu.variables import variables_of
from codegen.map_file import map as npz
from codegen.map_file.longitudinal import under_acceleration
from codegen.map_file.map import ReferenceMap, on_road
from codegen.optimum.solve import solve_acceleration_stack, solve_case
from codegen.sil.closed_loop import INPUT_COLUMNS, ClosedLoop, LoopOptions
from codegen.sil.software import RECORD_COLUMNS, Measurement, compile_build
from codegen.sil.toolchain import compiler_command
from codegen.units import KM_H
from codegen.vehicle.tyre import slip_bounds
from codegen.verify.unit_drives import Stretch, drive
from hil_sim.codec import Codec, VehicleConditions
from tests import builds
from tests.builds import Built
from tests.emit.rendered import laid_out
from tests.emit.test_contracts import FLAGS
from tests.optimum.cars import changed
from tests.oracle.controller import Road
from tests.oracle.kinds import second_controller
from tests.oracle.pairs import ControllerPair, InputsPair, compare

CASE, ACCELERATIONS = "4ws-2", (-6.0, -4.0, 0.0, 3.0)
KINDS: tuple[Kind, ...] = ("pi", "tracking")
BRAKING = -4.0
COMMITTED = Path(__file__).parents[2] / "generated" / "4ws2.npz"
SETTLED = 150
"""Sample from which the turn is steady: it begins at 0.5 s, and the wheel is held from 1 s on."""
GRID = {"speed_points": 17, "front_angle_points": 14}


@functools.cache
def stacked(kind: Kind) -> ReferenceMap:
    """Return the stack of a kind: "tracking" as tuned in the committed build, the others as in the tests of the C."""
    config = npz.load(COMMITTED).config if kind == "tracking" else builds.CONFIGS[kind]
    assert config is not None
    return solve_acceleration_stack(changed(config, grid=GRID), CASE, ACCELERATIONS)


@functools.cache
def made(kind: Kind) -> Built:
    reference_map = stacked(kind)
    assert reference_map.config is not None
    return builds.make(reference_map, reference_map.config)


# --- lookup -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_the_lookup_equals_its_reference_bit_for_bit(kind: Kind) -> None:
    built, rng = made(kind), np.random.default_rng(0)
    accelerations = (*ACCELERATIONS, *rng.uniform(-9.0, 6.0, 5), math.nan, math.inf, -math.inf, 1e38)
    frictions = (math.nan, 0.9, 0.6, 0.05, 1e-40, 0.0, -1.0, math.inf)
    speed, angle = (rng.uniform(-low, high, 200).astype(np.float32) for low, high in ((5.0, 70.0), (0.8, 0.8)))
    for friction in frictions:
        for acceleration in accelerations:
            found = built.software.map_yaw_rate(speed, angle, friction, acceleration)
            expected = built.lookup(speed, angle, friction, acceleration)
            assert (found.view(np.uint32) == expected.view(np.uint32)).all(), (friction, acceleration)
    assert built.software.selftest()


def test_each_layer_is_its_own_map() -> None:
    """At the acceleration of a layer, the lookup is that of the map solved for it alone; beyond the stack, of its ends."""
    lookup, config = made("pi").lookup, stacked("pi").config
    assert config is not None
    speed, angle = np.meshgrid(np.linspace(3.0, 60.0, 40), np.linspace(0.0, 0.3, 30))
    for acceleration, layer in ((-9.0, -6.0), (math.nan, -6.0), *((value, value) for value in ACCELERATIONS), (9.0, 3.0)):
        car = under_acceleration(config, layer) if layer else config
        alone = Lookup.from_map(extend(solve_case(car, CASE), car, config.steering.front_angle_stop))
        for found, expected in zip(
            lookup.reference(speed, angle, math.nan, acceleration), alone.reference(speed, angle), strict=True
        ):
            # Single precision: the same numbers, interpolated between two layers with a share of zero or one.
            np.testing.assert_allclose(found, expected, rtol=4e-6, atol=1e-7)


def test_a_slippery_road_leaves_less_grip_while_braking() -> None:
    """The bound is that of the car solved for both, which the lookup does not know, within 6 % of it.

    The lookup divides the acceleration by the friction and multiplies the bound. The load transfer does not scale so, and the
    bound is not linear between layers.
    """
    lookup, config = made("pi").lookup, stacked("pi").config
    assert config is not None
    for friction, acceleration in ((0.6, -3.0), (0.5, -2.0), (0.5, -3.0), (0.7, 2.0)):
        car = under_acceleration(on_road(config, friction), acceleration)
        own = extend(solve_case(car, CASE), car).lateral_acceleration_cap
        found = float(lookup.lateral_acceleration(friction, acceleration))
        assert found == pytest.approx(own, rel=0.06), (friction, acceleration)


# --- the signal -------------------------------------------------------------------------------------------------------


def test_the_signal_exists_only_with_the_stack_or_on_request() -> None:
    plain, config = stacked("pi").config, made("pi").software.config
    assert plain is not None and plain.can.vehicle_conditions.longitudinal_acceleration is None
    files = made("pi").folder.files
    assert b"longitudinal" not in b"".join(builds.render(replace(stacked("pi"), layers=()), plain).files.values())
    for path in ("include/ars_inputs.h", "include/ars_can.h", "ars.dbc", "ars.a2l", "README.md"):
        assert b"ongitudinal" in files[path], path
    sent = VehicleConditions(0.01, 0.8, 1.0, True, -3.2)
    data = Codec(config.can).encode(sent)
    read = cantools.database.load_string(files["ars.dbc"].decode()).decode_message("VehicleConditions", data)
    assert read["LongitudinalAcceleration"] == pytest.approx(-3.2)
    names = {each.name for each in variables_of("controller", config)}
    assert {"longitudinal_acceleration_m_s2", "longitudinal_acceleration_available"} <= names
    asked = changed(plain, can={"vehicle_conditions": {"longitudinal_acceleration": {"start_bit": 40}}})
    alone = builds.make(replace(stacked("pi"), layers=()), asked)
    assert alone.software.selftest() and alone.software.measured[-1].role == "longitudinal_acceleration"


def test_a_taken_place_is_reported_in_one_line() -> None:
    config = stacked("pi").config
    assert config is not None
    moved = changed(config, can={"vehicle_conditions": {"friction": {"start_bit": 40}}})
    with pytest.raises(ConfigError, match=r"needs its signal: can.vehicle_conditions: .*share bit 40; move one of them"):
        with_signals(stacked("pi"), moved)


def test_a_lost_acceleration_moves_to_the_strongest_braking() -> None:
    """It is taken at once within its range, and then changes by 2 m/s^3 at most, down to the first layer."""
    controller, period = made("pi").software.controller(), made("pi").software.config.controller.sampling_time_s

    def used(acceleration: float, samples: int = 1) -> float:
        controller.run([Measurement(20.0, 0.0, 0.0, 0.0, longitudinal_acceleration=acceleration)] * samples)
        return float(controller.state.sample.longitudinal_acceleration)

    assert used(math.nan) == ACCELERATIONS[0], "before the first one"
    assert used(2.5) == 2.5
    for bad in (math.nan, math.inf, -12.1, 12.1):
        assert used(2.5) == 2.5
        assert used(bad, 100) == pytest.approx(2.5 - 100 * period * 2.0, abs=1e-4)
    assert used(math.nan, 1_000) == ACCELERATIONS[0]
    assert used(-12.0) == -12.0


# --- laws -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_the_controller_equals_its_second_implementation_bit_for_bit(kind: Kind) -> None:
    built = made(kind)
    software, parameters = built.software, built.software.parameters()
    road = Road(built.total.friction, built.total.lateral_acceleration_cap)
    second = second_controller(software.config, parameters, built.lookup, road, 0.0)
    samples = drive(
        np.random.default_rng(1), 1_500, built.lookup, software.config.vehicle.wheelbase, built.lookup.accelerations.tolist()
    )
    known = [sample.longitudinal_acceleration for sample in samples if math.isfinite(sample.longitudinal_acceleration)]
    assert np.ptp(known) > 9.0
    with np.errstate(all="ignore"):
        for pair in (ControllerPair(software, second, parameters, 0.0), InputsPair(software, parameters)):
            assert compare(pair, [Stretch(samples)]).difference is None


# --- drives -----------------------------------------------------------------------------------------------------------


def inputs_of(config: Config, front_angle_deg: float, acceleration: float) -> FloatArray:
    """Return 5 s of braking from 110 km/h in a turn; `acceleration` is what the sensor says."""
    time = np.arange(5_000) * config.plant.sampling_time_s
    wheel = math.radians(front_angle_deg) * config.steering.ratio * np.clip(2.0 * time - 1.0, 0.0, 1.0)
    columns: dict[str, Any] = {
        "speed": 110.0 * KM_H + BRAKING * time,
        "steering_wheel_command": wheel,
        "friction": config.road.friction,
        "friction_estimate": math.nan,
        "longitudinal_acceleration": acceleration,
    }
    return np.column_stack([np.broadcast_to(columns.get(name, 0.0), time.shape) for name in INPUT_COLUMNS])


def test_braking_in_a_turn_keeps_the_slip_bound_of_the_rear_axle() -> None:
    """The plant is the two-track car with the loads and the grip of braking. Without the stack it spins."""
    built, reference_map = made("tracking"), stacked("tracking")
    config = reference_map.config
    assert config is not None
    car = under_acceleration(config, BRAKING)
    still = builds.render(replace(reference_map, layers=()), config)

    def rear_slip(folder: Any, acceleration: float) -> float:
        software = compile_build(folder.files, folder.manifest, car)
        inputs = inputs_of(config, 4.0, acceleration)
        direct = ClosedLoop(software).run(inputs)
        return float(np.abs(direct[SETTLED:, RECORD_COLUMNS.index("slip_rear_rad")]).max())

    moving, constant, unknown = rear_slip(built.folder, BRAKING), rear_slip(still, 0.0), rear_slip(built.folder, math.nan)
    bounds = slip_bounds(car)
    assert bounds is not None
    assert unknown < moving < bounds[1] < constant


def test_the_signal_arrives_through_the_frames() -> None:
    built = made("tracking")
    loop = ClosedLoop(built.software, LoopOptions(through_can=True))
    inputs = inputs_of(built.software.config, 2.0, BRAKING)[:500]
    loop.run(inputs)
    assert (ClosedLoop(built.software).run(inputs) == ClosedLoop(built.software).run_stepped(inputs)).all()
    assert loop.state.task.controller.sample.longitudinal_acceleration == pytest.approx(BRAKING)
    assert parse(built.software.config.model_dump(mode="json"), "again") == built.software.config


def test_contracts_compile(tmp_path: Path) -> None:
    folder = laid_out(made("tracking").folder, tmp_path / "build")
    proofs = [path for unit in ("map", "law", "inputs", "controller") for path in folder.glob(f"verify/prove_ars_{unit}_*.c")]
    files = [str(path.relative_to(folder)) for path in sorted(proofs)]
    subprocess.run([*compiler_command(), *FLAGS, "verify/every_function.c", *files], cwd=folder, check=True)

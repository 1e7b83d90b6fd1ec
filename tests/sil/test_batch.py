"""Batches of closed loops: the same bits as single runs, independent of the other runs and of the vector instructions."""

import dataclasses
import functools
import json
import math
import platform
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from codegen.arrays import FloatArray
from codegen.configuration import Config, Kind, parse
from codegen.errors import BuildError
from codegen.sil import batch, vector
from codegen.sil.batch import LANES, NOISES, BatchSoftware, Isa, Lanes, compile_batch, load_batch
from codegen.sil.closed_loop import INPUT_COLUMNS, ClosedLoop, LoopOptions
from codegen.sil.compile import DEFAULT_FLAGS
from codegen.sil.software import RECORD_COLUMNS, Measurement, Software, compile_build
from codegen.vehicle.plant_car import OPTIONAL_PARTS, PLANT_PARAMETERS, plant_parameters
from tests import builds

AVAILABLE_ISAS = [isa for isa in vector.ISAS if vector.machine_runs(isa) and vector.compiler_offers(isa)]
VECTORS = [isa for isa in vector.ISAS if isa != "none"]
GENERATED = Path(__file__).resolve().parents[2] / "generated"
SAMPLES, STEPS = 250, 10
SPIN = 0.2
"""Sideslip angle, rad, at which a car spins; small differences grow beyond it."""
SIDESLIP = RECORD_COLUMNS.index("sideslip_rad")
UNOPTIMISED = tuple("-O0" if flag == "-O2" else flag for flag in DEFAULT_FLAGS)
"""Flags that compile faster; the bits are the same."""


@functools.cache
def batch_of(kind: Kind, isa: Isa) -> BatchSoftware:
    folder = builds.of_kind(kind).folder
    return compile_batch(folder.files, folder.manifest, isa=isa)


@pytest.fixture(scope="module")
def best() -> BatchSoftware:
    """Return the paper's build with the widest vectors of this machine."""
    return batch_of("pi", AVAILABLE_ISAS[0])


def profile(speed: float = 20.0, samples: int = SAMPLES, **columns: Any) -> FloatArray:
    values = {"speed": speed, "friction": 0.9, "friction_estimate": math.nan, **columns}
    rows = [np.broadcast_to(np.asarray(values.get(name, 0.0), dtype=float), samples * STEPS) for name in INPUT_COLUMNS]
    return np.ascontiguousarray(np.stack(rows, axis=1))


TIME = np.arange(SAMPLES * STEPS) * 1e-3
DWELL = np.clip(TIME - 0.3 - 0.75 / 0.7, 0.0, 0.5)
"""Time since the beginning of the dwell at the second peak of a 0.7 Hz sine, s, after FMVSS 126, S7.9."""
PROFILES = {
    "step steer": profile(steering_wheel_command=np.where(TIME < 0.5, 0.0, 1.0)),
    "sine with dwell": profile(
        steering_wheel_command=np.where((TIME > 0.3) & (TIME < 2.23), np.sin(2.0 * np.pi * 0.7 * (TIME - 0.3 - DWELL)), 0.0)
    ),
    "all that acts": profile(
        speed=20.0 + 5.0 * np.sin(TIME),
        steering_wheel_command=0.6 * np.sin(2.0 * TIME),
        friction=np.where(TIME < 1.0, 0.9, 0.6),
        yaw_moment=np.where((TIME > 0.2) & (TIME < 0.4), 2000.0, 0.0),
        inhibit=(TIME > 0.8) & (TIME < 1.0),
    ),
}


def random_car(generator: np.random.Generator, base: Config, **plant: float) -> Config:
    """Return a stable car near that of a configuration, different in every plant parameter."""
    data = base.model_dump()
    for key in ("mass_kg", "yaw_inertia_kg_m2", "cg_height_m", "track_m", "front_roll_share"):
        data["vehicle"][key] *= generator.uniform(0.85, 1.15)
    data["vehicle"]["cg_to_front_axle_m"] *= generator.uniform(0.9, 1.0)
    data["vehicle"]["cg_to_rear_axle_m"] *= generator.uniform(1.0, 1.1)
    for axle in ("front", "rear"):
        tyre = data["tyre"][axle]
        tyre["cornering_stiffness_n_per_rad"] *= generator.uniform(0.9, 1.0) if axle == "front" else generator.uniform(1.0, 1.1)
        tyre["shape_factor_c"] = generator.uniform(1.2, 1.5)
        tyre["curvature_factor_e"] = generator.uniform(-1.5, 0.3)
        tyre["peak_load_sensitivity_p2"] = generator.uniform(-0.2, 0.0)
        tyre["horizontal_shift_deg"] = generator.uniform(-0.1, 0.1)
        tyre["vertical_shift_n"] = generator.uniform(-30.0, 30.0)
    data["rear_actuator"]["lag_s"] = generator.uniform(0.02, 0.08)
    data["steering"]["lag_s"] = generator.uniform(0.005, 0.05)
    data["steering"]["ratio"] *= generator.uniform(0.9, 1.1)
    data["plant"].update(plant)
    return Config.model_validate(data)


@functools.cache
def cars(kind: Kind) -> tuple[Config, ...]:
    generator = np.random.default_rng(8)
    return tuple(random_car(generator, builds.CONFIGS[kind]) for _ in range(3))


@functools.cache
def single(kind: Kind, car: str) -> Software:
    """Return the build of a kind with the plant of a car (JSON)."""
    folder = builds.of_kind(kind).folder
    return compile_build(folder.files, folder.manifest, parse(json.loads(car), "test"), flags=UNOPTIMISED)


def single_run(kind: Kind, car: Config, scenario: FloatArray, **options: Any) -> FloatArray:
    return ClosedLoop(single(kind, car.to_json()), LoopOptions(**options)).run(scenario).T


def rows(*configs: Config) -> FloatArray:
    return np.array([plant_parameters(config) for config in configs])


NOMINAL_LANES = rows(builds.CONFIG)


def require_equal(found: FloatArray, wanted: FloatArray, bound: float = batch.DIFFERENCE_MAX) -> None:
    """Check that two recordings (12, samples) agree; status and time bit for bit."""
    assert np.abs(wanted[SIDESLIP]).max() < SPIN, "a spinning car makes the comparison meaningless"
    for name, column, expected in zip(RECORD_COLUMNS, found, wanted, strict=True):
        if name in ("time_s", "status"):
            assert np.array_equal(column, expected), name
        assert np.abs(column - expected).max() <= bound, name


def require_bits(found: FloatArray, wanted: FloatArray) -> None:
    """Check that two arrays are identical. Comparing bytes in an assertion makes pytest spend minutes on the difference."""
    same = found.tobytes() == wanted.tobytes()
    assert same


def check_cars(software: BatchSoftware, kind: Kind, name: str) -> None:
    """Check three different cars in one batch, each with its own delay, one of them passive."""
    delays, controlled = (0, 2, 1), (True, True, False)
    lanes = Lanes(rows(*cars(kind)), delay_samples=np.array(delays), controlled=np.array(controlled))
    record = software.run(PROFILES[name], lanes)
    for index, car in enumerate(cars(kind)):
        options = {"delay_samples": delays[index], "controlled": controlled[index]}
        require_equal(record[:, :, index], single_run(kind, car, PROFILES[name], **options))


def test_each_run_is_the_single_run_of_its_car() -> None:
    """tests/evidence/kinds has the PI, and narrower vectors."""
    for name in PROFILES:
        check_cars(batch_of("tracking", AVAILABLE_ISAS[0]), "tracking", name)


PARTS = {
    "relaxation_length_m": (0.6, 0.25),
    "rear_relaxation_factor": (1.4, 0.9),
    "slippery_stiffness_share": (1.0, 0.3),
    "roll_deg_per_g": (4.0, 2.0),
    "actuator_motor_share": (0.5, 0.3),
    "backlash_deg": (0.1, 0.3),
    "command_delay_samples": (1, 1),
}
"""Parts of the plant for two cars."""


def check_parts(kind: Kind, isa: Isa, keys: Sequence[str]) -> FloatArray:
    """Check two cars with some of PARTS, and return the recording."""
    generator = np.random.default_rng(3)
    both = [random_car(generator, builds.CONFIGS[kind], **{key: PARTS[key][k] for key in keys}) for k in (0, 1)]
    folder = builds.of_kind(kind).folder
    software = compile_batch(folder.files, folder.manifest, both[0], isa=isa)
    record = software.run(PROFILES["all that acts"], Lanes(rows(*both)))
    for index, car in enumerate(both):
        require_equal(record[:, :, index], single_run(kind, car, PROFILES["all that acts"]))
    return record


def test_each_run_is_the_single_run_of_a_car_with_all_parts() -> None:
    """tests/evidence/kinds has each part alone. The controller measures the motor, and what the accelerometer does."""
    record = check_parts("tracking", AVAILABLE_ISAS[0], list(PARTS))
    without = check_parts("tracking", AVAILABLE_ISAS[0], ["relaxation_length_m"])
    assert np.abs(record - without).max() > 0.01


def test_factors_and_friction_are_those_of_another_scenario(best: BatchSoftware) -> None:
    """A constant friction is replaced; a varying one is scaled by the run's friction over the configuration's."""
    lanes = Lanes(rows(builds.CONFIG), speed_factor=1.25, wheel_factor=-0.7, friction=0.75, friction_estimate=0.8)
    for name, of_road in (("step steer", lambda friction: 0.75), ("all that acts", lambda friction: 0.75 * friction / 0.9)):
        scenario = PROFILES[name].copy()
        scenario[:, 0] *= 1.25
        scenario[:, 1] *= -0.7
        scenario[:, 2] = of_road(scenario[:, 2])
        scenario[:, 3] = 0.8
        require_equal(best.run(PROFILES[name], lanes)[:, :, 0], single_run("pi", builds.CONFIG, scenario))


def stepped(scenario: FloatArray, noise: FloatArray) -> FloatArray:
    """Return yaw rate and command for measurement noise (samples, 5), with the loop in Python."""
    software = builds.paper().software
    controller, lib = software.controller(), software.compiled.lib
    plant, acting, output = (software.ffi.new(f"plant_{name}_t *") for name in ("state", "input", "output"))
    found = []
    for index, added in enumerate(noise):
        steps = scenario[index * STEPS : (index + 1) * STEPS]
        speed, wheel, friction, _, moment, *_ = steps[0]
        acting[0] = (speed, wheel, 0.0, friction, moment)
        lib.plant_output(plant, acting, output)
        true = (speed, output.front_angle, plant.yaw_rate, output.measured_rear_angle, output.measured_lateral_acceleration)
        sample = Measurement(**dict(zip(NOISES, (np.array(true) + added).tolist(), strict=True)))
        command = controller.step(sample).rear_angle
        found.append((plant.yaw_rate, command))
        for speed, wheel, friction, _, moment, *_ in steps:
            acting[0] = (speed, wheel, command, friction, moment)
            lib.plant_step(plant, acting, 1e-3)
    return np.array(found).T


def check_noise(software: BatchSoftware) -> None:
    """Check that every lane has its own noise."""
    noise = np.random.default_rng(4).normal(0.0, [[[0.1], [1e-3], [5e-3], [1e-3], [0.1]]], (SAMPLES, 5, LANES + 1))
    lanes = Lanes(np.repeat(rows(builds.CONFIG), LANES + 1, axis=0), noise=noise)
    record = software.run(PROFILES["step steer"], lanes, columns=["yaw_rate_rad_s", "rear_angle_command_rad"])
    for run in (0, 3, LANES):
        wanted = stepped(PROFILES["step steer"], noise[:, :, run])
        assert np.abs(record[:, :, run] - wanted).max() <= batch.DIFFERENCE_MAX


def test_a_side_force_pushes_at_once_and_turns_by_its_arm(best: BatchSoftware) -> None:
    driven = profile(yaw_moment=np.where(TIME >= 0.5, 3000.0, 0.0))
    lanes = Lanes(np.repeat(rows(builds.CONFIG), 2, axis=0), moment_arm=np.array([1.5, math.inf]), controlled=False)
    names = ("lateral_acceleration_m_s2", "yaw_rate_rad_s")
    pushed, turned = best.run(driven, lanes, columns=names)
    onset, mass, inertia = 50, builds.CONFIG.vehicle.mass_kg, builds.CONFIG.vehicle.yaw_inertia_kg_m2
    assert pushed[onset] == pytest.approx([3000.0 / 1.5 / mass, 0.0])
    assert turned[onset + 1] == pytest.approx(0.01 * 3000.0 / inertia, rel=0.1)


def test_a_flipped_rounding_stays_within_its_bound(best: BatchSoftware) -> None:
    """One single-precision unit in the last place is added to front angle and yaw rate of one sample in mid-turn."""
    noise = np.zeros((SAMPLES, 5, 3))
    noise[80, 1, 1] = noise[80, 2, 2] = float(np.spacing(np.float32(0.5)))
    lanes = Lanes(np.repeat(rows(builds.CONFIG), 3, axis=0), wheel_factor=0.2, noise=noise)
    record = best.run(PROFILES["step steer"], lanes)
    for run in (1, 2):
        difference = np.abs(record[1:, :, run] - record[1:, :, 0]).max()
        assert 0.0 < difference <= batch.DIFFERENCE_MAX_FLIPPED


def mixed_lanes(count: int) -> tuple[Lanes, npt.NDArray[np.intp]]:
    """Return runs that differ in everything; some spin, one has no valid numbers."""
    generator = np.random.default_rng(5)
    values = rows(*cars("pi"))[generator.integers(0, 3, count)] * generator.uniform(0.9, 1.1, (count, 1))
    values[:, PLANT_PARAMETERS.index("relaxation_length")] = 0.0
    values[count // 3, PLANT_PARAMETERS.index("mass")] = math.nan
    lanes = Lanes(
        values,
        speed_factor=generator.uniform(0.5, 2.5, count),
        wheel_factor=generator.uniform(-4.0, 4.0, count),
        friction=generator.uniform(0.2, 1.0, count),
        friction_estimate=generator.choice([math.nan, 0.5], count),
        delay_samples=generator.integers(0, 101, count),
        controlled=generator.random(count) < 0.8,
        noise=generator.normal(0.0, 1e-3, (SAMPLES, 5, count)),
        command_factor=generator.uniform(0.5, 2.0, count),
        moment_arm=generator.uniform(0.5, 3.0, count),
    )
    return lanes, np.arange(count)


def selected(lanes: Lanes, index: Any) -> Lanes:
    """Return some runs, reordered."""
    fields = [field.name for field in dataclasses.fields(lanes) if field.name not in ("noise", "drivers")]
    picked: Mapping[str, Any] = {name: np.asarray(getattr(lanes, name))[index] for name in fields}
    assert lanes.noise is not None
    return Lanes(**picked, noise=lanes.noise[:, :, index])


def check_independence(software: BatchSoftware) -> None:
    """Check that a run has the same bits in any batch, including one with runs that spin or have no valid numbers."""
    count = 3 * LANES + 3
    lanes, every = mixed_lanes(count)
    whole = software.run(PROFILES["sine with dwell"], lanes)
    assert np.isnan(whole[3, -1, count // 3]), "the run without a mass has no yaw rate"
    assert np.isfinite(np.delete(whole, count // 3, axis=2)).all(), "and does not affect other runs"
    assert np.nanmax(np.abs(whole[SIDESLIP])) > 2.0 * SPIN, "some spin"
    shuffled = np.random.default_rng(6).permutation(every)
    for index in (every[::-1], shuffled, every[:1], every[5 : 5 + LANES], every[2 : 3 + LANES], every[-7:]):
        part = software.run(PROFILES["sine with dwell"], selected(lanes, index))
        require_bits(part, whole[:, :, index])
    with ThreadPoolExecutor(2) as threads:
        for record in threads.map(lambda _: software.run(PROFILES["sine with dwell"], lanes), range(2)):
            require_bits(record, whole)


def check_columns(software: BatchSoftware) -> None:
    """Check that only the requested columns are returned, in order, also for zero runs and zero samples."""
    lanes, _ = mixed_lanes(LANES + 2)
    whole = software.run(PROFILES["step steer"], lanes)
    for columns in (["status", "slip_rear_rad", "time_s"], [*RECORD_COLUMNS][::-1], []):
        part = software.run(PROFILES["step steer"], lanes, columns=columns)
        assert part.shape == (len(columns), SAMPLES, LANES + 2)
        require_bits(part, whole[[RECORD_COLUMNS.index(name) for name in columns]])
    assert software.run(PROFILES["step steer"], Lanes(NOMINAL_LANES[:0])).shape == (len(RECORD_COLUMNS), SAMPLES, 0)
    assert software.run(profile(samples=0), Lanes(NOMINAL_LANES)).shape == (len(RECORD_COLUMNS), 0, 1)
    parameters = software.parameters(proportional_gain=0.0, integral_gain=0.0)
    angle, yaw_rate = software.run(
        PROFILES["step steer"], Lanes(NOMINAL_LANES), parameters, ["rear_angle_rad", "yaw_rate_rad_s"]
    )
    assert not angle.any() and yaw_rate.any(), "without gains the rear wheels stay straight"


@pytest.mark.parametrize("check", [check_noise, check_independence, check_columns])
def test_noise_independence_and_columns(best: BatchSoftware, check: Callable[[BatchSoftware], None]) -> None:
    check(best)


def with_part(name: str) -> Lanes:
    """Return a car with a part of the plant that the batch is not compiled for."""
    return Lanes(np.where(np.array(PLANT_PARAMETERS) == name, 0.5, NOMINAL_LANES))


@pytest.mark.parametrize(
    ("scenario", "lanes", "text"),
    [
        (profile(speed=math.nan), Lanes(NOMINAL_LANES), "speed must be finite"),
        (profile()[:-1], Lanes(NOMINAL_LANES), "shape"),
        (profile(), Lanes(NOMINAL_LANES[:, 1:]), "cars of shape"),
        (profile(), Lanes(NOMINAL_LANES, speed_factor=-1.0), "factors must be above zero"),
        (profile(), Lanes(NOMINAL_LANES, delay_samples=101), "0 to 100"),
        (profile(), Lanes(NOMINAL_LANES, wheel_factor=np.ones(3)), "broadcast"),
        (profile(), Lanes(NOMINAL_LANES, noise=np.zeros((SAMPLES, 5, 2))), "noise of shape"),
        *((profile(), with_part(name), text) for name, text in OPTIONAL_PARTS.items()),
    ],
)
def test_what_cannot_be_run_is_refused(best: BatchSoftware, scenario: FloatArray, lanes: Lanes, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        best.run(scenario, lanes, columns=["status"])
    with pytest.raises(ValueError, match="no column"):
        best.run(profile(), Lanes(NOMINAL_LANES), columns=["yaw rate"])


# Which vectors are used


@pytest.mark.parametrize("isa", AVAILABLE_ISAS)
def test_the_plant_calls_only_vector_functions(isa: Isa) -> None:
    compiled = batch_of("pi", isa).software.compiled
    assert [other for other in VECTORS if vector.is_vectorised(compiled, other)] == [one for one in VECTORS if one == isa]
    assert (b"\0atan\0" in compiled.path.read_bytes()) == (isa == "none")


if AVAILABLE_ISAS[0] != "none":  # without vectors there is no fallback from them

    @pytest.mark.parametrize("lost", [("-DBATCH_VECTOR_LIBRARY",), ("-fno-builtin-sin", "-fno-builtin-cos")], ids=" ".join)
    def test_a_silent_fallback_is_detected(lost: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
        """Without some of its flags GCC silently calls the function once per number."""
        assert vector.compiler_offers(AVAILABLE_ISAS[0])  # cached before the flags change
        kept = tuple(flag for flag in vector.VECTOR_FLAGS[AVAILABLE_ISAS[0]] if flag not in lost)
        monkeypatch.setitem(vector.VECTOR_FLAGS, AVAILABLE_ISAS[0], kept)
        folder = builds.paper().folder
        with pytest.raises(BuildError, match="did not vectorise"):
            compile_batch(folder.files, folder.manifest, isa=AVAILABLE_ISAS[0])
        assert compile_batch(folder.files, folder.manifest).isa != AVAILABLE_ISAS[0], "without a request, the next one is used"


def test_a_machine_without_vectors_runs_scalar_code(monkeypatch: pytest.MonkeyPatch) -> None:
    assert vector.best_isa() == AVAILABLE_ISAS[0]
    with monkeypatch.context() as patch:
        patch.setattr(platform, "machine", lambda: "aarch64")
        assert vector.best_isa() == "none"
    monkeypatch.setattr(vector, "_processor_flags", lambda: {"sse2", "avx"})
    assert vector.best_isa() == "none"
    folder = builds.paper().folder
    assert compile_batch(folder.files, folder.manifest).isa == "none"
    for isa in VECTORS:
        with pytest.raises(BuildError, match="does not support"):
            compile_batch(folder.files, folder.manifest, isa=isa)


def test_subnormal_numbers_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fast-math flags at link time would make the processor flush subnormals in the whole process."""
    load_batch(GENERATED / "4ws2-paper").run(PROFILES["step steer"], Lanes(NOMINAL_LANES))
    assert np.float64(5e-324) * np.float64(1.0) > 0.0
    assert np.float64(2.3e-308) / np.float64(4.0) > 0.0

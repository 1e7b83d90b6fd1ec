"""Expected results of the independent models, computed once and compared with many builds of the same C.

Each `answers_...` takes a build whose parameters are known to be right and returns what the matching `check_...` needs. The
check raises AssertionError where a build differs. Results are compared bit for bit, except for the sign of a zero that carries
no meaning.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.sil.software import Measurement, Status
from codegen.verify.unit_drives import drive
from tests.builds import Built
from tests.oracle.controller import SecondLimiter
from tests.oracle.tracking import SecondReferenceModel
from tests.sil import checks_limiter
from tests.sil.checks_kinds import OPEN, config_of, model_of, open_limiter, parameters_of
from tests.sil.checks_lookup import all_points, bits
from tests.sil.checks_map_reference import COLUMNS, frictions, road_lateral_acceleration
from tests.sil.checks_reference_model import limits, random_inputs, random_states, wild_inputs
from tests.sil.units import Units

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Drive:
    """Measurements of a drive and the independent model's results: rear angle, reference and status, (n, 3)."""

    parameters: Any
    start: float
    samples: Any
    wanted: Array


def answers_of(built: Built, changes: Mapping[str, Any], measurements: list[Measurement], start: float = 0.0) -> Drive:
    """Return the model's results for a list of measurements."""
    parameters = parameters_of(built, changes)
    model = model_of(built, parameters, start)
    with np.errstate(all="ignore"):
        commands = [model.step(measurement) for measurement in measurements]
    samples = built.software.ffi.new(f"{built.software.prefix}_measurement_t[]", len(measurements))
    for sample, measurement in zip(samples, measurements, strict=True):
        built.software.fill(sample, measurement)
    return Drive(parameters, start, samples, np.array([dataclasses.astuple(command) for command in commands]))


def answers_of_drive(built: Built, changes: Mapping[str, Any], count: int = 2500, seed: int = 1, **course: float) -> Drive:
    """Return the model's results for a drive, which must reach every status; standby only where a law waits for a speed."""
    rng = np.random.default_rng(seed)
    start = float(rng.uniform(-0.08, 0.08))
    measurements = drive(
        rng, count, built.lookup, config_of(built).vehicle.wheelbase, built.lookup.accelerations.tolist(), **course
    )
    known = answers_of(built, changes, measurements, start)
    known_statuses = set(Status) - (set() if config_of(built).controller.waits_for_speed else {Status.STANDBY})
    missed = known_statuses - {Status(status) for status in known.wanted[:, 2]}
    assert not missed, f"the drive does not reach {missed}"
    return known


def check_drive(built: Built, known: Drive) -> None:
    """Check that every sample equals the model's."""
    software, count = built.software, len(known.wanted)
    controller = software.controller(known.start, known.parameters)
    commands = software.ffi.new(f"{software.prefix}_command_t[]", count)
    software.compiled.lib.loop_controller(controller.state, known.parameters, known.samples, commands, count)
    got = np.array([(command.rear_angle, command.yaw_rate_reference, command.status) for command in commands])
    differ = np.flatnonzero((got != known.wanted).any(axis=1))
    assert differ.size == 0, f"sample {differ[0]}: {got[differ[0]]} instead of {known.wanted[differ[0]]}"


def rough(built: Built, seed: int, count: int = 3000) -> list[Measurement]:
    """Return plausible measurements without any smoothness.

    Speeds lie at the breakpoints and beyond them. Front angles are exactly zero at times, yaw rates have either sign or are
    zero, errors change sign from sample to sample, and the actuator is anywhere.
    """
    rng, config = np.random.default_rng(seed), config_of(built)
    schedule = config.controller.tracking.schedule
    points = [speed / 3.6 for speed in (schedule.speed_km_h if schedule else (20.0, 60.0, 120.0))]
    speeds = np.array([*points, *points, 5.0, 9.0, 17.0, 28.0, 60.0, 95.0, 105.0, 111.0, 111.111115])

    def spells(values: Any, longest: int) -> Any:
        lengths = rng.integers(1, longest + 1, count)
        return np.repeat(values, lengths)[:count]

    speed = spells(rng.choice(speeds[speeds > 4.2], count), 25)
    # Turns of any size: up to a wheel angle that is impossible at high speed, and up to the limit of the road.
    wide = rng.choice([0.0, 1.0, -1.0, 0.3, -0.1], count) * rng.uniform(0.0, 0.12, count)
    front = spells(np.where(rng.random(count) < 0.5, wide, wide * 40.0 / speed**2), 12)
    turn = built.lookup(speed.astype(built.real), front.astype(built.real), math.nan).astype(np.float64)
    share = spells(rng.choice([0.0, 1.0, 0.9, 0.5, -0.3, 1.3], count), 6)
    yaw_rate = turn * share + spells(rng.choice([0.0, 0.0, 0.05, -0.05, 0.3, -0.3], count), 4)
    rear = np.where(spells(rng.random(count) < 0.4, 20), spells(rng.uniform(-0.07, 0.07, count), 8), math.nan)
    friction = spells(rng.choice([math.nan] * 6 + [0.9, 0.5, 0.1, 0.05, 0.0], count), 40)
    inhibit = spells(rng.random(count) < 0.15, 5)
    columns = [np.asarray(column, dtype=np.float64).tolist() for column in (speed, front, yaw_rate, rear, friction)]
    samples = [Measurement(*row) for row in zip(*columns, strict=True)]
    return [dataclasses.replace(sample, inhibit=bool(held)) for sample, held in zip(samples, inhibit, strict=True)]


def rough_changes(built: Built) -> dict[str, dict[str, Any]]:
    """Return sets of parameters: some leave the control law unlimited, others limit it tightly."""
    free = {"rear_rate_max": 1000.0, "limiter": open_limiter(built), "inputs": OPEN}
    if config_of(built).controller.kind != "tracking":
        return {
            "free": free,
            "strong": {**free, "proportional_gain": 0.3, "integral_gain": 20.0},
            "slow": {"rear_rate_max": 0.1, "rear_angle_error_max": 1.0, "inputs": OPEN},
            # The bound on the actuator error and the rate sometimes return exactly the demand; this still counts as limited.
            "slow, and measured": {"rear_rate_max": 0.1, "rear_angle_error_max": 0.097, "inputs": OPEN},
        }
    points = len(list(built.software.parameters().schedule_speed))
    rng = np.random.default_rng(8)
    gains = ("proportional_gain", 0.3), ("integral_gain", 20.0)
    odd = {name: rng.uniform(0.0, most, points).tolist() for name, most in gains}
    sensitive = {"grip_shortfall": 0.1, "grip_loss_rate": 50.0, "grip_forgetting": 20.0, "friction_min": 0.02}
    return {
        "free": free,
        "odd gains": {**free, **odd},
        "beyond the schedule": {
            **{**free, **odd, "schedule_speed": [0.1 + 0.05 * k for k in range(points)]},
            "proportional_gain": [2.0, *odd["proportional_gain"][1:]],
            "inputs": {**OPEN, "speed_max": 200.0},
        },
        "no authority": {**free, **odd, "yaw_increasing_max": 0.0},
        "wide authority": {**free, **odd, "yaw_increasing_max": 0.04, "rear_angle_error_max": 0.01},
        "sensitive": {**free, **odd, **sensitive},
        "slow": {**odd, "rear_rate_max": 0.1, "limiter": {"rear_rate_max": 0.08}, "inputs": OPEN},
        "tight": {**free, **odd, "rear_angle_error_max": 0.002, "trim_share": 0.2, "trim_rate": 20.0},
    }


def answers_of_rough(built: Built, count: int = 3000) -> Iterator[Drive]:
    """Yield the model's results for rough drives; lazily, because each takes seconds."""
    for seed, one in enumerate(rough_changes(built).values()):
        yield answers_of(built, one, rough(built, seed, count))


@dataclass(frozen=True)
class LimiterSamples:
    """Inputs of a limiter and the model's angles."""

    parameters: Any
    start: float
    inputs: Array
    wanted: Array


def answers_of_limiter(units: Units, count: int = 4000) -> list[LimiterSamples]:
    """Return the model's angles for every parameter set of `checks_limiter` and every kind of start."""
    known = []
    for changes in checks_limiter.CHANGES.values():
        parameters = checks_limiter.parameters_of(units, changes)
        for seed, start in enumerate((0.0, -0.05, 0.9, 1.0, -1.0, 1.5, math.nan)):
            inputs = checks_limiter.drive(units, parameters, count, seed)
            model = SecondLimiter(parameters, checks_limiter.period(units), units.real, start)
            known.append(
                LimiterSamples(parameters, start, inputs, np.array([model.step(*row) for row in inputs], dtype=units.real))
            )
    return known


def check_limiter(units: Units, known: list[LimiterSamples]) -> None:
    """Check that every step equals the model's and stays within the angle's bound, unless the start was outside it."""
    for one in known:
        assert np.isfinite(one.wanted).all() and np.abs(one.wanted[100:]).max() <= units.real(one.parameters.rear_angle_max)
        got = units.limiter(one.parameters, one.inputs, one.start)
        differ = np.flatnonzero(got != one.wanted)
        assert differ.size == 0, (
            f"step {differ[0]}: {one.inputs[differ[0]]}: {got[differ[0]]} instead of {one.wanted[differ[0]]}"
        )


@dataclass(frozen=True)
class LookupSamples:
    """Map arguments and the bits of the NumPy reference: the yaw rate and, if the map has them, the other columns."""

    speed: Array
    front_angle: Array
    friction: Any
    wanted: Array


def answers_of_map(built: Built, units: Units, every: int = 1) -> list[LookupSamples]:
    """Return the reference at every `every`th point, for each friction of interest."""
    (speed, angle), real = all_points(built), built.software.real
    has_rear_angle = built.total.steering is not None and config_of(built).controller.kind in ("tracking", "feedforward")
    known = []
    for index, friction in enumerate(frictions(units)):
        points = slice(index, None, every * (1 if index == 0 else 13))
        wanted = [built.lookup(speed[points], angle[points], friction)]
        if has_rear_angle:
            yaw_rate, rear_angle = built.lookup.reference(speed[points], angle[points], friction)
            road = np.full(yaw_rate.shape, road_lateral_acceleration(built.total, real, friction))
            wanted = [yaw_rate, rear_angle, road, yaw_rate]
        known.append(LookupSamples(speed[points], angle[points], friction, np.stack(wanted)))
    return known


def check_map(built: Built, units: Units, known: list[LookupSamples]) -> None:
    """Check that every result has the bits of the reference and is finite, for arguments of any bit pattern."""
    for one in known:
        assert np.isfinite(one.wanted).all()
        place = one.speed, one.front_angle, one.friction
        got = units.map_reference(*place) if len(one.wanted) > 1 else built.software.map_yaw_rate(*place)[np.newaxis]
        for name, have, want in zip(COLUMNS, got, one.wanted, strict=False):
            differ = np.flatnonzero(bits(have) != bits(want))
            assert differ.size == 0, f"{name} at {one.speed[differ[0]]}, {one.front_angle[differ[0]]}, friction {one.friction}"


@dataclass(frozen=True)
class ModelSamples:
    """States and inputs of the reference model, the next states, and the start states for the first three inputs."""

    states: Array
    inputs: Array
    after: Array
    starts: Array
    begun: Array


def answers_of_model(units: Units, count: int = 30_000) -> list[ModelSamples]:
    """Return results from all states: with plausible inputs, with inputs of any bit pattern, and from damaged states."""
    model = SecondReferenceModel(units.config, units.real)
    usual, plausible = random_states(units, count, 1), random_inputs(units, count, 2)
    wild, damaged, known = wild_inputs(units, count, 3), wild_inputs(units, count, 4, usual.shape[1]), []
    for states, inputs in ((usual, plausible), (usual, wild), (damaged, plausible)):
        starts = inputs[:, :3].copy()
        with np.errstate(all="ignore"):
            starts[:, 1] *= units.real(4.0)  # the yaw rate reaches farther than the front angle
            after = np.stack(model.step(states.T, inputs.T), axis=1)
            begun = np.stack(model.start(*starts.T), axis=1)
        known.append(ModelSamples(states, inputs, after, starts, begun))
    return known


def check_model(units: Units, known: list[ModelSamples]) -> None:
    """Check that every step and every start equals the model's, is finite and within the bounds of the state."""
    most, _ = limits(units)
    for one in known:
        assert (np.abs(one.after) <= most).all() and (np.abs(one.begun) <= most).all()
        assert np.array_equal(units.model_from(one.states, one.inputs), one.after)
        assert np.array_equal(units.model_start(one.starts), one.begun)

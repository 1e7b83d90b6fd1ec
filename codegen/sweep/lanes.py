"""Samples of a campaign (cars and roads), and their factors as inputs of the batch.

The car of a sample is the configured one, or one that the uncertainty of a measured car leaves possible. A sample depends only
on the spec and its number, so each can be drawn alone. It is the same for all controllers and scenarios. Factors change only
what they name. A change of the tyre peak keeps the slope at zero slip, as in `hil_sim.suite.cells`. All runs share the input
profile of a scenario; each run scales its speed and steering amplitude.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import CodegenError, ConfigError
from codegen.sil.batch import NOISES, Lanes
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.sweep.spec import FACTORS, NOISE, Spec, Values
from codegen.units import KM_H
from codegen.vehicle.plant_car import PLANT_PARAMETERS, varied_cars
from codegen.vehicle.population import Population
from hil_sim.scenarios import Kind, Scenario

Factors = Mapping[str, FloatArray]

MASS_KEY = "vehicle.mass_kg"
DEVIATIONS = ("mass", "yaw_inertia", "tyre_peak", "front_stiffness", "rear_stiffness")
"""Factors in percent that `vehicle.plant_car.deviations` has."""
DELAY_KEY = "plant.command_delay_samples"
"""Key of a measured car that is no parameter of the plant but an input of the batch."""

BLOCK = 1024
"""Samples that share a random stream of a factor. Creating one stream for each sample would take longer than drawing."""
_NOISE_STREAM, _CAR_STREAM = 1_000_000, 2_000_000
"""First stream number for noise, and that of a measured car; the stream number of a factor is its index in FACTORS."""


def draw(spec: Spec, samples: range) -> dict[str, FloatArray]:
    """Return factor -> values (len(samples),) for sample numbers, in the unit of the factor's name.

    Every factor has its own random stream, so adding a factor to the spec does not change the values of others.
    """
    if spec.design == "factorial":
        return _factorial(spec.factors, samples)
    return {
        key: _of_blocks(values, spec, place, samples)
        for place, key in enumerate(FACTORS)
        if (values := spec.factors.get(key)) is not None
    }


def noise(spec: Spec, samples: range, scenario: int, steps: int) -> FloatArray:
    """Return standard normal numbers (steps, 3, len(samples)) for a scenario, given by its index in the spec.

    All controllers get the same numbers. Every sample has its own stream, because a block of samples in a long scenario would
    not fit into memory.
    """
    found = np.empty((len(samples), steps, 3))
    for row, sample in zip(found, samples, strict=True):
        _stream(spec, sample, _NOISE_STREAM + scenario).standard_normal(out=row)
    return np.ascontiguousarray(np.moveaxis(found, 0, -1))


@dataclass(frozen=True, eq=False)
class Drawn:
    """Samples: the values of what varies, and their cars.

    Attributes:
        factors: factor, or key of a measured car -> values (n,), in the unit of its name.
        cars: (n, k), rows of PLANT_PARAMETERS.
    """

    factors: Factors
    cars: FloatArray


def draw_samples(spec: Spec, samples: range, config: Config, population: Population | None = None) -> Drawn:
    """Return the samples of a campaign around the configured car, or around cars of a population.

    A car of the population depends only on the sample's number, the seed and the population.

    Raises:
        ConfigError: hardly any car of the population is possible; see also `cars`.
    """
    factors, count = draw(spec, samples), len(samples)
    if population is None:
        return Drawn(factors, cars(config, factors, count))
    measured = [population.possible_car(_stream(spec, sample, _CAR_STREAM)) for sample in samples]
    values = np.array([population.values(car) for car in measured]).T
    factors |= dict(zip(population.keys, values, strict=True))
    return Drawn(factors, cars(config, factors, count, measured))


def _stream(spec: Spec, block: int, number: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(spec.seed, spawn_key=(block, number)))


def _of_blocks(values: Values, spec: Spec, place: int, samples: range) -> FloatArray:
    """Draw whole blocks, so that the values do not depend on where a chunk begins."""
    first, last = samples.start // BLOCK, (samples.stop - 1) // BLOCK
    drawn = np.concatenate([_random(values, _stream(spec, block, place), BLOCK) for block in range(first, last + 1)])
    return drawn[samples.start - first * BLOCK :][: len(samples)]


def _factorial(factors: Mapping[str, Values], samples: range) -> dict[str, FloatArray]:
    """Return all combinations of levels; the last factor of the spec changes fastest."""
    number = np.arange(samples.start, samples.stop)
    found: dict[str, FloatArray] = {}
    for key, values in reversed(list(factors.items())):
        levels = np.array(values.levels, dtype=np.float64)
        found[key] = levels[number % levels.size]
        number = number // levels.size
    return found


def _random(values: Values, stream: np.random.Generator, count: int) -> FloatArray:
    if values.values is not None:
        return np.array(values.values, dtype=np.float64)[stream.integers(len(values.values), size=count)]
    if values.uniform is not None:
        low, high = values.uniform
        return stream.uniform(low, high, size=count)
    assert values.normal is not None  # checked by the spec, as the next
    assert values.within is not None
    (mean, deviation), (low, high) = values.normal, values.within
    # Inverse of the truncated distribution: exact, and equally fast for a narrow window.
    from scipy.special import ndtr, ndtri

    first, last = ndtr((np.array([low, high]) - mean) / deviation)
    share = stream.uniform(first, last, size=count)
    drawn: FloatArray = np.clip(mean + deviation * ndtri(share), low, high)
    return drawn


REFERENCE_ANGLE_DEG = 90.0
"""Steering-wheel amplitude of every profile, before the factor of a run is applied."""

SPEED, WHEEL = INPUT_COLUMNS.index("speed"), INPUT_COLUMNS.index("steering_wheel_command")


@dataclass(frozen=True, eq=False)
class Profile:
    """One scenario of a campaign.

    Attributes:
        scenario: the scenario.
        inputs: (steps, 7), columns INPUT_COLUMNS, at the scenario's own speed and REFERENCE_ANGLE_DEG.
        steer_time: start of steering in `inputs`, in s.
        speed: in m/s.
        friction: road friction of the scenario.
        estimate: friction estimate for the controller; NaN: none.
    """

    scenario: Scenario
    inputs: FloatArray
    steer_time: float
    speed: float
    friction: float
    estimate: float

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self.scenario.name

    @property
    def kind(self) -> Kind:
        """Kind of the scenario."""
        return self.scenario.kind

    @property
    def digest(self) -> str:
        """SHA-256 of the inputs and of what `amplitudes` and the figures read, in hexadecimal digits."""
        own = self.scenario
        # The inputs are for REFERENCE_ANGLE_DEG. The amplitude of the scenario is in its settings, or follows from the car.
        read = (own.kind, own.steer_time, self.steer_time, own.angle_text, asdict(own.settings))
        found = hashlib.sha256(json.dumps(read).encode())
        found.update(np.ascontiguousarray(self.inputs).tobytes())
        return found.hexdigest()

    def amplitudes(self, config: Config, speeds: FloatArray) -> FloatArray:
        """Return the scenario's own steering-wheel amplitude (n,) in rad for speeds (n,) in m/s and the configured car.

        Raises:
            CodegenError: the car cannot do it at one of them.
        """
        if self.scenario.settings.steering_wheel_angle_deg is not None:
            return np.full(speeds.shape, np.radians(self.scenario.settings.steering_wheel_angle_deg))
        wheel = self.inputs[:, WHEEL]
        at = int(np.abs(wheel).argmax())
        # The same time, counted from the start of the scenario, which begins before the profile.
        time = np.array([at * config.plant.sampling_time_s + self.scenario.steer_time - self.steer_time])
        each, place = np.unique(speeds, return_inverse=True)
        found = np.empty(each.shape)
        for index, speed in enumerate(each):
            settings = replace(self.scenario.settings, speed_km_h=float(speed) / KM_H)
            command = np.broadcast_to(self.scenario.drive(config, settings, time)["steering_wheel_command"], (1,))
            found[index] = float(command[0]) / (wheel[at] / np.radians(REFERENCE_ANGLE_DEG))
        return found[place]


def profile_of(scenario: Scenario, config: Config, lead: float, length: float | None) -> Profile:
    """Return the profile from `lead` s before the start of steering to `length` s after it (None: end of the scenario).

    Raises:
        CodegenError: the car cannot do the scenario, or an input other than the steering changes during it.
    """
    settings = replace(scenario.settings, steering_wheel_angle_deg=REFERENCE_ANGLE_DEG)
    inputs = replace(scenario, settings=settings).inputs(config)
    step, period = config.plant.sampling_time_s, config.controller.sampling_time_s
    per_sample = round(period / step)
    begin = max(round((scenario.steer_time - lead) / period), 0)
    end = inputs.shape[0] // per_sample
    if length is not None:
        end = min(end, round((scenario.steer_time + length) / period))
    inputs = np.ascontiguousarray(inputs[begin * per_sample : end * per_sample])
    held = inputs[:, [column for column in range(inputs.shape[1]) if column != WHEEL]]
    if not inputs.size or not np.array_equal(held, np.broadcast_to(held[0], held.shape), equal_nan=True):
        raise CodegenError(
            "its speed or its road changes on the way",
            where=f"scenario {scenario.name}",
            remedy="take one that only steers, such as step-steer or sine-with-dwell",
        )
    first = dict(zip(INPUT_COLUMNS, inputs[0], strict=True))
    return Profile(
        scenario=scenario,
        inputs=inputs,
        steer_time=scenario.steer_time - begin * period,
        speed=float(first["speed"]),
        friction=float(first["friction"]),
        estimate=float(first["friction_estimate"]),
    )


FRICTION_ESTIMATE_MIN = 0.02
"""Lower bound of the friction estimate after its error is added."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """Conditions of the samples in a scenario, (n,) each, in the units of `sweep.toml`, whether or not a factor varies them."""

    speed_km_h: FloatArray
    steering_wheel_angle_deg: FloatArray
    friction: FloatArray
    friction_estimate: FloatArray


def cars(config: Config, factors: Factors, count: int, base: Sequence[Config] | None = None) -> FloatArray:
    """Return rows (count, k) of PLANT_PARAMETERS: the configured car, or `count` cars `base`, changed by factors.

    Raises:
        ConfigError: a centre of gravity comes too near an axle.
    """

    def factor(key: str) -> FloatArray:
        return 1.0 + _of(factors, key, count) / 100.0

    shift = _of(factors, "cg_shift_m", count)
    shift_max = 0.9 * min(config.vehicle.cg_to_front_axle_m, config.vehicle.cg_to_rear_axle_m)
    if np.any(np.abs(shift) >= shift_max):
        raise ConfigError(
            f"shifts of up to {np.abs(shift).max():g} m bring the centre of gravity to an axle",
            where="factors.cg_shift_m",
            remedy=f"stay below {shift_max:.2f} m",
        )
    given = {name: factor(f"{name}_percent") for name in DEVIATIONS} | {"cg_shift": shift}
    if base is None:
        table = varied_cars(config, **given)
    else:
        each = ({name: values[place] for name, values in given.items()} for place in range(count))
        table = np.concatenate([varied_cars(car, **own) for car, own in zip(base, each, strict=True)])
    if "rear_lag_s" in factors:
        table[:, PLANT_PARAMETERS.index("rear_lag")] = factors["rear_lag_s"]
    return table


def conditions(config: Config, profile: Profile, factors: Factors, count: int) -> Conditions:
    """Return speed, amplitude and road of the samples in one scenario. Raises CodegenError if the car cannot do it."""
    speed = factors.get("speed_km_h", np.full(count, profile.speed / KM_H))
    angle = factors.get("steering_wheel_angle_deg")
    if angle is None:
        angle = np.degrees(profile.amplitudes(config, speed * KM_H)) * _of(factors, "steering_percent", count) / 100.0
    friction = factors.get("friction", np.full(count, profile.friction))
    estimate = np.full(count, profile.estimate)
    if "friction_estimate_error" in factors:
        estimate = np.maximum(friction + factors["friction_estimate_error"], FRICTION_ESTIMATE_MIN)
    return Conditions(speed, angle, friction, estimate)


def lanes(
    spec: Spec,
    samples: range,
    scenario: int,
    profile: Profile,
    config: Config,
    drawn: Drawn,
    driven: Conditions,
) -> Lanes:
    """Return batch inputs for sample numbers in one scenario (index in the spec), for any controller."""
    factors, count = drawn.factors, driven.speed_km_h.size
    delay = factors.get(DELAY_KEY, factors.get("delay_samples", np.full(count, config.driven_delay_samples)))
    period = round(config.controller.sampling_time_s / config.plant.sampling_time_s)
    return Lanes(
        cars=drawn.cars,
        speed_factor=driven.speed_km_h * KM_H / profile.speed,
        wheel_factor=driven.steering_wheel_angle_deg / REFERENCE_ANGLE_DEG,
        friction=driven.friction,
        friction_estimate=driven.friction_estimate,
        delay_samples=np.round(delay).astype(np.int64),
        noise=_noise(spec, samples, scenario, profile.inputs.shape[0] // period, factors),
    )


def only(every: Lanes, places: list[int]) -> Lanes:
    """Return the lanes at the given indices."""
    values = {field.name: getattr(every, field.name) for field in fields(every)}
    noise = values.pop("noise")
    return Lanes(
        **{name: value if np.ndim(value) == 0 else value[places] for name, value in values.items()},
        noise=None if noise is None else noise[:, :, places],
    )


def _of(factors: Factors, key: str, count: int) -> FloatArray:
    default = FACTORS[key].default
    return factors.get(key, np.full(count, np.nan if default is None else default))


def _noise(spec: Spec, samples: range, scenario: int, steps: int, factors: Factors) -> FloatArray | None:
    deviations = np.stack([_of(factors, key, len(samples)) for key in NOISE])
    if not deviations.any():
        return None
    in_si = deviations * np.array([[1.0], [np.pi / 180.0], [np.pi / 180.0]])
    found = np.zeros((steps, len(NOISES), len(samples)))
    found[:, : len(NOISE)] = noise(spec, samples, scenario, steps)
    found[:, : len(NOISE)] *= in_si
    return found

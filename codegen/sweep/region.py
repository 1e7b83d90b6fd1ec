"""Stability region of a controller's loop over speed, friction and mass: from the linearised plant, confirmed by simulation.

`design.sampled` gives gain and phase margin of the loop around the two-track plant, straight ahead and in a turn. Two things
are confirmed straight ahead with the generated C and the nonlinear plant. In every cell, the response to a small steering pulse
must decay if and only if the loop is stable. In every third cell, the plant's rear angle command is multiplied by just less and
just more than the gain margin, which multiplies the gain of the loop exactly, whatever the controller. A build is the only
input.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from codegen import configuration
from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.configuration.controller import SPEED_MAX_LEAST_KM_H
from codegen.design.margins import Margins, loop_margins, margin_range_km_h
from codegen.design.sampled import SampledCar, SteadyTurns, frequency_grid, linearised
from codegen.emit.laws import law_of
from codegen.sil.batch import BatchSoftware, Isa, Lanes, compile_batch
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.sweep.lanes import cars
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack

REGION_SPEEDS_KM_H = tuple(float(speed) for speed in range(20, 381, 20))
REGION_FRICTIONS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
MASSES_PERCENT = (-20.0, 0.0, 20.0)
TURN_SHARE = 0.5
"""Lateral acceleration of the turn, as a fraction of friction times gravity."""

PULSE_DEG, PULSE_FROM, PULSE_TO = 0.05, 0.5, 0.7
"""Steering pulse: deg at the front wheels, beginning and end in s. Tyres and actuator stay in their linear range if the loop
is stable."""
EARLY, LATE = (1.0, 4.0), (7.0, 10.0)
"""Time ranges of the run, in s: an unstable loop swings more in the second than in the first."""
GROWN, WINDOW = 2.0, 1.0
"""A loop is also unstable if its swing in any second is this many times that in the first. Some unstable loops swing less
at the end, because a bounded actuator, or a controller that assumes a stuck actuator, stops further growth."""
QUIET = 1e-5
"""Largest swing at the end, in rad/s, that counts as zero; float32 resolves a yaw rate at rest far better."""
MARGIN_SHARES = (0.9, 1.1)
"""Fractions of the gain margin, as a factor: the loop must be stable with the first and unstable with the second."""
MARGIN_EVERY = 3
"""The gain margin is simulated in every third cell along each axis, so that all speeds, frictions and masses occur, in a few
seconds."""
PLAY_MAX_DEG = 1e-6
"""Largest backlash in the simulations, far below the response to the pulse. A compiled car with backlash cannot have none."""
NEAR = 0.02
"""A loop whose slowest pole moves by less than this fraction in a second is undecided: neither growth nor decay is visible."""


ALONE_UNSTABLE, MODEL_UNSTABLE, UNEXPLAINED = "car alone unstable", "reference model unstable", "unexplained"
"""Explanations of a difference between simulation and linearisation: feedback of bounded authority does not stabilise such a
car."""

REMEDY = "do not rely on the margins there"
"""Remedy of a disagreement at speeds that the controller must accept."""


@dataclass(frozen=True, eq=False)
class Region:
    """One controller. Arrays (masses, frictions, speeds).

    Attributes:
        speeds_km_h, frictions, masses_percent: the grid.
        gain_margin_db, phase_margin_deg: straight ahead; 0 if unstable, inf if no change makes it unstable.
        stable: straight ahead. turn_stable: in the turn, where `turn_found`.
        turn_gain_margin_db, turn_phase_margin_deg: in the turn; NaN where there is none.
        without: whether the car alone, its rear wheels held straight, is stable.
        growth: rate of the slowest pole, 1/s: below zero where the loop is stable.
        gain_limit: straight ahead, the factor of the loop's gain at which it becomes unstable: above 1, or below 1 if less
        gain makes it unstable; NaN if there is none.
        limit_growth: (2, masses, frictions, speeds), `growth` at MARGIN_SHARES of that; NaN where there is none.
        critical_speed_km_h: speed from which the controller's reference model is unstable; inf for a kind without such a model.
        map_last_speed_km_h: last speed of the map; a build rejects a largest speed below it.
        driven: whether the simulation was stable; None without a simulation.
        margin_driven: as `limit_growth`, whether the simulation was stable (1 or 0); NaN if not simulated.
    """

    speeds_km_h: tuple[float, ...]
    frictions: tuple[float, ...]
    masses_percent: tuple[float, ...]
    gain_margin_db: FloatArray
    phase_margin_deg: FloatArray
    stable: BoolArray
    growth: FloatArray
    turn_found: BoolArray
    turn_stable: BoolArray
    turn_gain_margin_db: FloatArray
    turn_phase_margin_deg: FloatArray
    without: BoolArray
    gain_limit: FloatArray
    limit_growth: FloatArray
    critical_speed_km_h: float = math.inf
    map_last_speed_km_h: float = 0.0
    driven: BoolArray | None = None
    margin_driven: FloatArray | None = None

    @property
    def undecided(self) -> BoolArray:
        """Cells too close to the stability boundary for a simulation of a few seconds to decide."""
        near: BoolArray = np.abs(self.growth) < NEAR
        return near

    @property
    def contradicted(self) -> BoolArray:
        """Cells where simulation and linearisation disagree; none without a simulation."""
        if self.driven is None:
            return np.zeros(self.stable.shape, dtype=bool)
        otherwise: BoolArray = (self.driven != self.stable) & ~self.undecided
        return otherwise

    @property
    def margin_sample(self) -> BoolArray:
        """Cells whose gain margin is simulated."""
        place = np.indices(self.stable.shape).sum(axis=0)
        chosen: BoolArray = (place % MARGIN_EVERY == 0) & np.isfinite(self.gain_limit)
        return chosen

    @property
    def margin_undecided(self) -> BoolArray:
        """Cells of the margin sample that change too slowly near their margin for a simulation of a few seconds to decide."""
        near: BoolArray = self.margin_sample & (np.abs(self.limit_growth) < NEAR).any(axis=0)
        return near

    @property
    def margin_contradicted(self) -> BoolArray:
        """Cells whose simulation is not stable just within the computed gain margin and unstable just beyond it."""
        if self.margin_driven is None:
            return np.zeros(self.stable.shape, dtype=bool)
        within, beyond = self.margin_driven
        otherwise: BoolArray = self.margin_sample & ~self.margin_undecided & ~((within == 1.0) & (beyond == 0.0))
        return otherwise

    @property
    def beyond_linear(self) -> BoolArray:
        """Cells in which a disagreement is explained: the car alone, or the reference model, is unstable.

        The linear loop does not include that the feedback is bounded and that the reference comes from a model of the car.
        """
        beyond: BoolArray = ~self.without | (np.array(self.speeds_km_h) >= self.critical_speed_km_h)
        return beyond

    @property
    def disagreeing(self) -> BoolArray:
        """Cells where simulation and linearisation disagree about the loop or its gain margin."""
        cells: BoolArray = self.contradicted | self.margin_contradicted
        return cells

    @property
    def disagreeing_from(self) -> float | None:
        """Lowest speed of such a cell in km/h; None if there is none."""
        found = np.flatnonzero(self.disagreeing.any(axis=(0, 1)))
        return self.speeds_km_h[int(found[0])] if found.size else None

    @property
    def explanations(self) -> dict[str, int]:
        """Number of disagreeing cells for each explanation, the first that applies."""
        cells = self.disagreeing
        model = np.array(self.speeds_km_h) >= self.critical_speed_km_h
        return {
            ALONE_UNSTABLE: int((cells & ~self.without).sum()),
            MODEL_UNSTABLE: int((cells & self.without & model).sum()),
            UNEXPLAINED: int((cells & ~self.beyond_linear).sum()),
        }

    @property
    def disagreement(self) -> str:
        """Warning if computed and simulated stability disagree, with explanations and remedy; "" if they agree."""
        cells = self.disagreeing
        speeds = [self.speeds_km_h[place] for place in np.unique(np.nonzero(cells)[2])]
        if not speeds:
            return ""
        counts = (self.contradicted.sum(), cells.size, self.margin_contradicted.sum(), self.margin_sample.sum())
        where = f"at {speeds[0]:g} km/h" if len(speeds) == 1 else f"between {speeds[0]:g} and {speeds[-1]:g} km/h"
        why = ", ".join(f"{what} in {count}" for what, count in self.explanations.items() if count)
        if self.explanations[UNEXPLAINED] < cells.sum():
            why += " (bounded feedback does not stabilise such a car)"
        # A largest speed below the map's last one is rejected by a build, and one below SPEED_MAX_LEAST_KM_H by the file.
        is_avoidable = speeds[0] > max(self.map_last_speed_km_h, SPEED_MAX_LEAST_KM_H)
        remedy = f"set controller.inputs.speed_max_km_h below {speeds[0]:g}" if is_avoidable else REMEDY
        return (
            "simulations contradict the computed stability in {} of {} cells and {} of {} gain margins".format(*counts)
            + f", {where}; {why}; {remedy}"
        )

    def unstable_from(self, mass: int, friction: int, feedback: bool = True) -> float | None:
        """Return the lowest speed of the grid, in km/h, at which the loop, or the car alone, is unstable; None without one."""
        found = np.flatnonzero(~(self.stable if feedback else self.without)[mass, friction])
        return self.speeds_km_h[int(found[0])] if found.size else None


@dataclass(frozen=True)
class _Car:
    """A car with its sampling time on a grid of speeds, compared by the text that determines its linearisation."""

    text: str
    config: Config = field(compare=False)


@lru_cache(maxsize=4)
def _turns(car: _Car, grip_share: float) -> SteadyTurns:
    """Return the linearised plant on the grid. All controllers of a car share it."""
    mass, friction, speed = (values.ravel() for values in _grid(car.config))
    return linearised(car.config, speed, friction, 1.0 + mass / 100.0, grip_share=grip_share)


def region(config: Config) -> Region | None:
    """Return the linear part of a region; None for a kind without feedback.

    Raises:
        BuildError: the kind lacks what it needs.
    """
    gains = law_of(config).gains(config)
    if gains is None:
        return None
    speed = _grid(config)[2]
    kp, ki = gains(speed.ravel())
    shape, frequency = speed.shape, frequency_grid(config.controller.sampling_time_s)
    car = _Car(f"{config.model_dump_json(exclude={'controller', 'limiter'})} {frequency[-1]} {speeds_of(config)}", config)
    ahead, turn = _turns(car, 0.0), _turns(car, TURN_SHARE)
    straight, turning = (loop_margins(found.sampled, kp, ki, frequency) for found in (ahead, turn))
    limit, limit_growth = _limits(ahead.sampled, kp, ki, straight)
    model = SingleTrack.from_config(config).critical_speed / KM_H if law_of(config).uses_reference_model else math.inf
    return Region(
        speeds_of(config),
        REGION_FRICTIONS,
        MASSES_PERCENT,
        straight.gain_margin_db.reshape(shape),
        straight.phase_margin_deg.reshape(shape),
        straight.stable.reshape(shape),
        ahead.sampled.growth(kp, ki).reshape(shape),
        turn.found.reshape(shape),
        turning.stable.reshape(shape),
        np.where(turn.found, turning.gain_margin_db, np.nan).reshape(shape),
        np.where(turn.found, turning.phase_margin_deg, np.nan).reshape(shape),
        ahead.sampled.open_loop_stable().reshape(shape),
        limit.reshape(shape),
        limit_growth.reshape(-1, *shape),
        model,
        config.grid.last_speed_km_h,
    )


def _limits(car: SampledCar, kp: FloatArray, ki: FloatArray, margins: Margins) -> tuple[FloatArray, FloatArray]:
    """Return `gain_limit` (n,) and `limit_growth` (2, n) of n loops. The poles beyond the margin show its direction."""
    has = margins.stable & np.isfinite(margins.gain_margin_db)
    factor = np.where(has, 10.0 ** (np.where(has, margins.gain_margin_db, 0.0) / 20.0), 1.0)
    beyond = MARGIN_SHARES[1] * factor
    less = (car.growth(kp / beyond, ki / beyond) > 0.0) & ~(car.growth(beyond * kp, beyond * ki) > 0.0)
    limit = np.where(less, 1.0 / factor, factor)
    growth = [car.growth(gain * kp, gain * ki) for gain in _gains_about(limit)]
    return np.where(has, limit, np.nan), np.where(has, growth, np.nan)


def _gains_about(limit: FloatArray) -> list[FloatArray]:
    """Return the gain factors just within and just beyond a limit."""
    return [np.where(limit < 1.0, limit / share, limit * share) for share in MARGIN_SHARES]


def speeds_of(config: Config) -> tuple[float, ...]:
    """Return REGION_SPEEDS_KM_H, cut off at the last speed of `margin_range_km_h`."""
    last = min(margin_range_km_h(config)[1], REGION_SPEEDS_KM_H[-1])
    return (*(speed for speed in REGION_SPEEDS_KM_H if speed < last), last)


def _grid(config: Config) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mass in %, friction and speed in m/s, (masses, frictions, speeds) each."""
    found = np.meshgrid(MASSES_PERCENT, REGION_FRICTIONS, np.array(speeds_of(config)) * KM_H, indexing="ij")
    return found[0], found[1], found[2]


def confirm(linear: Region, files: Mapping[str, bytes], manifest: Mapping[str, Any], isa: Isa | None = None) -> Region:
    """Return a region with the simulation of the generated C in every cell, and near the gain margins of a third of them.

    Args:
        files, manifest: of the build.

    Raises:
        BuildError: the C does not compile.
    """
    config = configuration.parse(manifest["configuration"], "manifest.json: configuration")
    linear = replace(linear, map_last_speed_km_h=manifest["map"]["speed_m_s"][-1] / KM_H)
    return confirm_with(linear, compile_batch(files, manifest, config, isa=isa), config)


def confirm_with(linear: Region, software: BatchSoftware, config: Config, parameters: Any | None = None) -> Region:
    """Return a region with the simulation of a compiled build, with the parameters of a controller tuned after it.

    Args:
        config: configuration with the controller of `linear`.
        parameters: parameters of that controller; None uses the build's.
    """
    mass, friction, speed = (values.ravel() for values in _grid(config))
    driven = _is_stable(software, config, parameters, mass, friction, speed, np.ones(mass.size))
    sample = linear.margin_sample.ravel()
    margin = np.full((len(MARGIN_SHARES), mass.size), np.nan)
    for row, gain in zip(margin, _gains_about(linear.gain_limit.ravel()[sample]), strict=True):
        row[sample] = _is_stable(software, config, parameters, mass[sample], friction[sample], speed[sample], gain)
    shape = linear.stable.shape
    return replace(linear, driven=driven.reshape(shape), margin_driven=margin.reshape(-1, *shape))


def _is_stable(
    software: BatchSoftware,
    config: Config,
    parameters: Any | None,
    mass: FloatArray,
    friction: FloatArray,
    speed: FloatArray,
    gain: FloatArray,
) -> BoolArray:
    """Return (n,) whether each loop, its gain multiplied, swings less late than early and never grows.

    The learned offset of the yaw rate is disabled, because the linear loop does not have it. Neither does it have backlash,
    whose play a small pulse does not leave.
    """
    applied = software.parameters()
    if parameters is not None:
        applied[0] = parameters[0]
    applied.inputs.yaw_rate_offset_max = 0.0
    without_play = config.unchecked({"plant.backlash_deg": min(config.plant.backlash_deg, PLAY_MAX_DEG)})
    lanes = Lanes(
        cars=cars(without_play, {"mass_percent": mass}, mass.size),
        speed_factor=speed,
        # A loop of higher gain responds more, so a smaller pulse keeps actuator and controller in their linear range.
        wheel_factor=1.0 / np.maximum(gain, 1.0),
        friction=friction,
        friction_estimate=np.full(mass.size, np.nan),
        delay_samples=np.full(mass.size, config.designed_delay_samples),
        command_factor=gain,
        controlled=np.full(mass.size, fill_value=True),
        noise=None,
    )
    yaw_rate = software.run(_pulse(software.config), lanes, applied, columns=("yaw_rate_rad_s",))[0]
    time = np.arange(yaw_rate.shape[0]) * config.controller.sampling_time_s

    def swing(window: tuple[float, float]) -> FloatArray:
        inside = yaw_rate[(time >= window[0]) & (time <= window[1])]
        result: FloatArray = np.where(np.isfinite(inside).all(axis=0), np.ptp(inside, axis=0), np.inf)
        return result

    late, first = swing(LATE), swing((EARLY[0], EARLY[0] + WINDOW))
    begins = np.arange(EARLY[0] + WINDOW, LATE[1] - WINDOW + 1e-9, WINDOW)
    largest = np.max([swing((begin, begin + WINDOW)) for begin in begins], axis=0)
    quiet = QUIET * lanes.wheel_factor
    grew = (largest > GROWN * first) & (largest > quiet)
    died: BoolArray = ((late < swing(EARLY)) | (late < quiet)) & ~grew
    return died


def _pulse(config: Config) -> FloatArray:
    """Return inputs (steps, 7), columns INPUT_COLUMNS: a speed of 1 m/s, to be scaled, and a pulse at the steering wheel."""
    step = config.plant.sampling_time_s
    time = (
        np.arange(round(LATE[1] / config.controller.sampling_time_s) * round(config.controller.sampling_time_s / step)) * step
    )
    columns = {
        "speed": 1.0,
        "steering_wheel_command": np.radians(PULSE_DEG) * config.steering.ratio * ((time >= PULSE_FROM) & (time < PULSE_TO)),
        "friction": config.road.friction,
        "friction_estimate": np.nan,
    }
    inputs = np.zeros((time.size, len(INPUT_COLUMNS)))
    for name, values in columns.items():
        inputs[:, INPUT_COLUMNS.index(name)] = values
    return inputs

"""The recommended controller against the control with the smallest yaw-rate error, which IPOPT computes for each step steer.

Both move the same actuator of the ideal plant of the same car, and both are judged against the map at the front angle of each
instant. The optimum is no controller: it knows the ramp of the steering wheel that is still to come. Measures no time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.tables import CountReport, Row
from codegen.arrays import FloatArray
from codegen.errors import CheckFailed
from codegen.sil.plant import Plant, PlantInput
from codegen.sil.software import Software
from codegen.units import KM_H
from codegen.vehicle.dynamics import PLANT_INPUTS, PLANT_OUTPUTS, PLANT_STATES, two_track
from codegen.vehicle.tyre import slip_bounds
from hil_sim.metrics.run import column
from hil_sim.suite.cells import CELL_STEER_TIME, Cell, cells, ideal
from hil_sim.suite.subjects import Subject, recommended

SPEEDS_KM_H, QUICK_SHARES = (80.0, 100.0, 120.0), (0.75,)
AFTER_S = 2.0
"""Time in s from the beginning of the steering over which the error is evaluated and the optimum acts, not before the
driver."""

REQUIRED = 2.5
SLIP_FACTOR = 1.25
"""Factor on the map's bound of the rear slip, where the optimum has to keep to it. The front slip is the driver's: with the
largest angles it begins beyond three times its bound."""

SUBSTEPS = 2
"""Integration steps in one control sample; the replay on the plant takes its own steps of 1 ms."""

REPLAY_TOLERANCE = 0.02
"""Largest relative difference of the error between the optimum's own integration and its replay."""

SMOOTHING_S2 = 1e-8
"""Weight in s^2 of the rear angle's rate squared relative to the error squared; it makes the solution unique."""


OPTIONS: dict[str, Any] = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "print_time": False,
    "ipopt.max_iter": 500,
    "error_on_fail": False,
}


@dataclass(frozen=True)
class Optimum:
    """The best that the actuator can do in one step steer.

    Attributes:
        rms: rad/s, of the yaw rate less the map's, on the plant.
        yaw_rate, rear_angle: (samples,) rad/s and rad, on the plant.
        command: (steps,) rad, for the plant's own steps.
    """

    rms: float
    yaw_rate: FloatArray
    rear_angle: FloatArray
    command: FloatArray


class StepSteer:
    """One cell of the test set: the course of the front angle and of the map, and the error of any yaw rate.

    Args:
        software: with the map, around the ideal plant of its car.
        cell: what the driver does.
    """

    def __init__(self, software: Software, cell: Cell) -> None:
        self.config, self.cell = software.config, cell
        self._speed, self._friction = cell.speed_km_h * KM_H, self.config.road.friction
        step = self.config.plant.sampling_time_s
        self.per_sample = round(self.config.controller.sampling_time_s / step)
        first, last = round(CELL_STEER_TIME / step), round((CELL_STEER_TIME + AFTER_S) / step)
        self._wheel = cell.scenario(self.config).inputs(self.config)[first:last, 1]
        self.samples = len(self._wheel) // self.per_sample
        _, front_angle, _ = self.replay(np.zeros(len(self._wheel)))
        self.front_angle = front_angle  # at every plant step
        self.reference = np.asarray(software.map_yaw_rate(self._speed, front_angle[:: self.per_sample]), dtype=np.float64)

    def replay(self, command: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return yaw rate, front angle and rear angle of the plant, each (steps,), for a rear command (steps,) in rad."""
        plant, rows = Plant(self.config), []
        for wheel, rear in zip(self._wheel.tolist(), command.tolist(), strict=True):
            acting = PlantInput(self._speed, wheel, rear, self._friction)
            sample = plant.sample(acting)
            rows.append((sample.yaw_rate, sample.front_angle, sample.rear_angle))
            plant.advance([acting])
        yaw_rate, front_angle, rear_angle = np.array(rows).T
        return yaw_rate, front_angle, rear_angle

    def rms(self, yaw_rate: FloatArray) -> float:
        """Return the error in rad/s of a yaw rate (samples,)."""
        return float(np.sqrt(np.mean((yaw_rate - self.reference) ** 2)))

    def rise_time(self, yaw_rate: FloatArray) -> float:
        """Return the time in s from the beginning of the steering to 90 % of the map's last value."""
        risen = np.flatnonzero(yaw_rate >= 0.9 * self.reference[-1])
        return float(risen[0]) * self.config.controller.sampling_time_s if risen.size else math.inf

    def optimum(self, rear_slip_max: float = math.inf) -> Optimum:
        """Return the control with the smallest error.

        Direct multiple shooting: in each sample the rear angle has one rate within the actuator's limit. It starts from rest;
        from random states IPOPT finds the same error.

        Args:
            rear_slip_max: rad.

        Raises:
            CheckFailed: IPOPT finds no solution, or the plant differs from it.
        """
        actuator = self.config.rear_actuator
        states, rates = ca.MX.sym("states", 3, self.samples + 1), ca.MX.sym("rates", self.samples)
        at_half_steps = self._front_angles()
        following, rear_slip = self._step().map(self.samples)(states[:, :-1], rates.T, at_half_steps)
        rear = states[2, :].T
        # How fast the first-order actuator can be: towards its stop, and from where the sample leaves it.
        headroom = [
            (actuator.angle_max - sign * rear[k:][: self.samples]) / actuator.lag_s - sign * rates
            for k in (0, 1)
            for sign in (1, -1)
        ]
        constraints = ca.vertcat(ca.vec(following - states[:, 1:]), *headroom, rear_slip.T)
        equal, free = 3 * self.samples, 4 * self.samples
        error = states[1, :-1].T - self.reference
        problem: dict[str, Any] = {
            "x": ca.vertcat(ca.vec(states), rates),
            "f": ca.sumsqr(error) + SMOOTHING_S2 * ca.sumsqr(rates),
            "g": constraints,
        }
        rate_max = math.radians(actuator.rate_max_deg_s)
        largest = np.tile([np.inf, np.inf, actuator.angle_max], self.samples + 1)
        largest[:3] = 0.0
        largest = np.concatenate([largest, np.full(self.samples, rate_max)])
        upper = np.concatenate([np.zeros(equal), np.full(free, np.inf), np.full(self.samples, rear_slip_max)])
        lower = np.concatenate([np.zeros(equal), np.zeros(free), np.full(self.samples, -rear_slip_max)])
        solver = ca.nlpsol("minimal_error", "ipopt", problem, OPTIONS)
        found = solver(x0=0.0, lbx=-largest, ubx=largest, lbg=lower, ubg=upper)
        if not solver.stats()["success"]:
            raise CheckFailed(f"IPOPT finds no optimum: {solver.stats()['return_status']}", where=self.cell.title)
        flat = np.asarray(found["x"]).ravel()
        own, chosen = flat[: 3 * (self.samples + 1)].reshape(-1, 3), flat[3 * (self.samples + 1) :]
        return self._confirmed(self.rms(own[:-1, 1]), own[:-1, 2], chosen)

    def _confirmed(self, own: float, rear_angle: FloatArray, rates: FloatArray) -> Optimum:
        """Replay the rates (samples,) on the plant. Raises CheckFailed if its error differs."""
        lag, step = self.config.rear_actuator.lag_s, self.config.plant.sampling_time_s
        rate = np.repeat(rates, self.per_sample)
        planned = np.repeat(rear_angle, self.per_sample) + rate * step * np.tile(np.arange(self.per_sample), self.samples)
        command = planned + lag * rate
        yaw_rate, _, rear = self.replay(command)
        yaw_rate, rear = yaw_rate[:: self.per_sample], rear[:: self.per_sample]
        found = self.rms(yaw_rate)
        if abs(found / own - 1.0) > REPLAY_TOLERANCE:
            raise CheckFailed(f"the plant's error is {found:.4g} rad/s, the optimum's {own:.4g}", where=self.cell.title)
        return Optimum(found, yaw_rate, rear, command)

    def _front_angles(self) -> FloatArray:
        """Return the front angle in rad at the beginning, middle and end of each integration step: (2 SUBSTEPS + 1,
        samples)."""
        places = np.arange(self.samples)[None, :] + np.linspace(0.0, 1.0, 2 * SUBSTEPS + 1)[:, None]
        result: FloatArray = np.interp(places * self.per_sample, np.arange(len(self.front_angle)), self.front_angle)
        return result

    def _step(self) -> ca.Function:
        """Return a function for one sample: (state, rear angle rate, front angles) to (next state, rear slip).

        The state is lateral speed, yaw rate and rear angle.
        """
        model = two_track(self.config)
        state, rate, front = ca.SX.sym("state", 3), ca.SX.sym("rate"), ca.SX.sym("front", 2 * SUBSTEPS + 1)
        given = {"speed": self._speed, "friction": self._friction}
        inputs = ca.vertcat(*(given.get(name, 0.0) for name in PLANT_INPUTS))

        def car(at: ca.SX, front_angle: ca.SX) -> ca.SX:
            whole = {"lateral_speed": at[0], "yaw_rate": at[1], "rear_angle": at[2]}
            whole["steering_wheel_angle"] = front_angle * self.config.steering.ratio
            return ca.vertcat(*(whole.get(name, 0.0) for name in PLANT_STATES))

        def derivative(at: ca.SX, front_angle: ca.SX) -> ca.SX:
            return ca.vertcat(model.derivative(car(at, front_angle), inputs)[:2], rate)

        step, at = self.config.controller.sampling_time_s / SUBSTEPS, state
        for k in range(SUBSTEPS):
            begin, middle, end = front[2 * k], front[2 * k + 1], front[2 * k + 2]
            k1 = derivative(at, begin)
            k2 = derivative(at + 0.5 * step * k1, middle)
            k3 = derivative(at + 0.5 * step * k2, middle)
            k4 = derivative(at + step * k3, end)
            at = at + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        assert model.output is not None  # the plant has outputs by construction
        rear_slip = model.output(car(state, front[0]), inputs)[PLANT_OUTPUTS.index("slip_rear")]
        return ca.Function("step", [state, rate, front], [at, rear_slip])


def run(quick: bool, say: Callable[[str], None]) -> CountReport:
    """Compare all cells of the test set from 80 km/h on; `quick` takes one amplitude."""
    comparison = recommended().comparison()
    subject = comparison.tested
    rows = []
    for cell in chosen(cells(subject.config, comparison.case)):
        if not quick or cell.share in QUICK_SHARES:
            say(cell.title)
            rows.append(_row(compare(subject, cell)))
    header = (
        *("step", "error, tracking", "optimum", "ratio", f"optimum, rear slip within {SLIP_FACTOR:g} bounds", "ratio"),
        *("t90, tracking", "optimum", "smallest rear angle of the optimum", "required of the first ratio"),
    )
    notes = (
        "Errors in deg/s, rms, against the map at the front angle of each instant, "
        f"over {AFTER_S:g} s from the beginning of the steering; t90 in s; rear angle in deg, below zero where it is opposite.",
        "The plant is the ideal one, without relaxation and roll, with an actuator of first order without backlash.",
        "The build's command acts as late as in the suite; the optimum measures nothing.",
    )
    return CountReport((("Yaw-rate error against the control with the smallest one", header, tuple(rows)),), notes)


@dataclass(frozen=True)
class Comparison:
    """A controller and the optimum in one step steer.

    Attributes:
        step: what the driver does, and the map's yaw rate.
        yaw_rate: (samples,) rad/s, with the controller.
        optimum: without a bound of the rear slip.
    """

    step: StepSteer
    yaw_rate: FloatArray
    optimum: Optimum

    @property
    def ratio(self) -> float:
        """Error of the controller over the minimal one."""
        return self.step.rms(self.yaw_rate) / self.optimum.rms


def chosen(suite: Sequence[Cell]) -> list[Cell]:
    """Return the cells of the suite that are compared."""
    return [cell for cell in suite if cell.speed_km_h in SPEEDS_KM_H]


def compare(subject: Subject, cell: Cell) -> Comparison:
    """Drive a cell with a controller around the ideal plant of its car, and find the optimum.

    Raises:
        CheckFailed: see `StepSteer.optimum`.
    """
    software = subject.around(ideal(subject.config))
    step = StepSteer(software, cell)
    record = subject.loop(software).run(cell.scenario(software.config).inputs(software.config))
    begin = round(CELL_STEER_TIME / software.config.controller.sampling_time_s)
    return Comparison(step, column(record, "yaw_rate_rad_s")[begin : begin + step.samples], step.optimum())


def _row(compared: Comparison) -> Row:
    step, ours, free, ratio = compared.step, compared.yaw_rate, compared.optimum, compared.ratio
    own = step.rms(ours)
    bounds = slip_bounds(step.config)
    assert bounds is not None  # the recommended car has tyres that bend
    try:
        bounded = step.optimum(SLIP_FACTOR * bounds[1])
        within = (f"{math.degrees(bounded.rms):.3f}", f"{own / bounded.rms:.2f}")
    except CheckFailed:
        within = ("none", "-")
    texts = (
        step.cell.title,
        *(f"{math.degrees(own):.3f}", f"{math.degrees(free.rms):.3f}", f"{ratio:.2f}", *within),
        *(f"{step.rise_time(ours):.2f}", f"{step.rise_time(free.yaw_rate):.2f}", f"{math.degrees(free.rear_angle.min()):.2f}"),
    )
    return Row((*texts, f"at most {REQUIRED:g}: {'met' if ratio <= REQUIRED else 'MISSED'}"), ratio <= REQUIRED)

"""Conditions in C that several contracts share, over the tables of a build."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from codegen.configuration.can import RealSignal
from codegen.emit.can_view import CanView, Frame, TaskView
from codegen.emit.constants import Constant
from codegen.emit.contracts.contract import Argument, Bound, Claim, ProvedFunction, Role
from codegen.emit.controller_view import ControllerView
from codegen.emit.dynamics_view import ReferenceModelView
from codegen.emit.inputs_view import FRICTION_UNKNOWN, InputsView
from codegen.emit.laws import REAR_ANGLE_MAX_RAD, Law
from codegen.emit.limiter_view import LimiterView
from codegen.emit.map_view import MapView
from codegen.emit.text import Precision, literal

REFERENCE_MAX_RAD_S = 20.0
"""Bound of the yaw rate that a law follows."""
LATERAL_ACCELERATION_MAX_M_S2 = 8192.0
"""Bound of the lateral acceleration that is computed from checked signals."""
LONGITUDINAL_ACCELERATION_MAX_M_S2 = 32.0
"""Bound of the checked longitudinal acceleration, above every range and every stack."""
SIGNALS_CHECKED = ("speed", "front_angle", "yaw_rate")
"""Signals that the inputs check and replace."""


class Conditions:
    """Numbers, names and conditions of one build; the base of the classes that make its contracts."""

    def __init__(self, context: Mapping[str, Any]) -> None:
        self.precision: Precision = context["precision"]
        self.real: str = context["real"]
        self.prefix, self.upper = context["build"].prefix, context["build"].PREFIX
        self.map: MapView = context["map"]
        self.controller: ControllerView = context["controller"]
        self.inputs: InputsView = context["inputs"]
        self.limiter: LimiterView = context["limiter"]
        self.can: CanView = context["can"]
        self.task: TaskView = context["task"]
        self.model: ReferenceModelView | None = context["model"]
        self.law: Law = context["law"]
        self.constants: tuple[Constant, ...] = context["constants"]

    @property
    def counter_max(self) -> int:
        """Return the largest counter of the E2E profile."""
        return self.can.profile.counter_max

    def frame(self, role: Role) -> Argument:
        """Return the argument `data`, a frame."""
        return Argument("data", "uint8_t", role, self.can.frame_bytes)

    @property
    def received_counter(self) -> str:
        """Return the expression of the counter in a frame."""
        return f"({self.can.e2e.received_counter})"

    def number(self, value: float) -> str:
        """Return a number as a literal in the precision of the build."""
        return literal(value, self.precision)

    def within(self, expression: str, limit: float | str) -> Bound:
        """Return the condition that a number is within +-limit."""
        return Bound(f"lies_within({expression}, {self._text(limit)})", expression)

    def between(self, expression: str, low: float, high: float | str) -> Bound:
        """Return the condition that a number is between two others."""
        return Bound(f"lies_between({expression}, {self.number(low)}, {self._text(high)})", expression)

    def _text(self, value: float | str) -> str:
        return value if isinstance(value, str) else self.number(value)

    def high(self, name: str) -> str:
        """Return the upper bound of a parameter of the inputs."""
        return self.number(next(each.high for each in self.inputs.parameters if each.name == name))

    def is_code(self, expression: str, last: int) -> str:
        """Return the condition that an enumerator is one of the first ones up to `last`."""
        return f"((uint32_t){expression} <= {last}u)"

    def own(self, name: str) -> str:
        """Return the name with the prefix of the build."""
        return f"{self.prefix}_{name}"

    def argument(self, name: str, ctype: str, role: Any) -> Argument:
        """Return an argument whose type has the prefix of the build."""
        return Argument(name, self.own(ctype), role)

    def scalar(self, name: str) -> Argument:
        """Return an argument that is a number."""
        return Argument(name, self.real)

    def step(self, rate: str) -> str:
        """Return the largest change in a sample at a rate."""
        return f"({rate} * {self.number(self.controller.sampling_time)})"

    def validity(self, unit: str, parameters: str, *more_claims: Claim, **more: Any) -> ProvedFunction:
        """Return the contract of a function that checks parameters."""
        holds = f"!result || {self.own(parameters.removesuffix('_t'))}_holds(parameters)"
        argument = self.argument("parameters", parameters, "in")
        claims = (Claim("valid parameters are in range", holds), *more_claims)
        function = self.own(f"{parameters.removesuffix('_t')}_valid")
        return ProvedFunction(function, self.own(unit), (argument,), "bool", ensures=claims, **more)

    # Claims

    def moved(self, angle: str, before: str, limiter: str) -> Iterator[Claim]:
        """Yield the rate limit of the limiter: the code's own expression, which makes it exact."""
        step, largest = self.step(f"{limiter}rear_rate_max"), f"{limiter}rear_angle_max"
        rises = f"({angle} <= ({before} + {step})) || ({angle} == -{largest})"
        falls = f"(({before} - {step}) <= {angle}) || ({angle} == {largest})"
        yield Claim("it rises by at most rear_rate_max, or to -rear_angle_max", rises)
        yield Claim("it falls by at most rear_rate_max, or to rear_angle_max", falls)

    def shrinks(self, angle: str, before: str) -> str:
        """Return the condition that the magnitude of an angle does not grow."""
        return f"(magnitude_of({angle}) <= magnitude_of({before}))"

    def held_by_actuator(self, angle: str) -> str:
        """Return the angle that the actuator holds: within its range, and zero for NaN."""
        return f"held_within({angle}, {self.number(self.controller.actuator_angle_max)})"

    def lower_step(self) -> str:
        """Return the largest change in a sample at the lower rate of law and limiter."""
        own, limiter = "parameters->rear_rate_max", "parameters->limiter.rear_rate_max"
        return self.step(f"(({own} < {limiter}) ? {own} : {limiter})")

    def within_rates(self, angle: str, before: str) -> str:
        """Return the condition that an angle moves by at most the lower of both rates."""
        step = self.lower_step()
        return f"((({before} - {step}) <= {angle}) && ({angle} <= ({before} + {step})))"

    def is_measured(self, signal: str) -> str:
        """Return the condition that a signal is used as measured."""
        return f"({signal}.source == {self.upper}_SIGNAL_MEASURED)"

    def is_available(self, sample: str, name: str, inputs: str) -> str:
        """Return the condition that a signal is in its range; that the grip allows the yaw rate is a condition more."""
        return self.within(f"{sample}{name}", f"parameters->{inputs}{name}_max")

    def checked_sample(self, sample: str) -> Iterator[Claim]:
        """Yield the ranges of a checked sample."""
        bounds = {
            "speed": self.high("speed_max"),
            "front_angle": self.high("front_angle_max"),
            "yaw_rate": self.high("yaw_rate_max"),
            "rear_angle": self.number(REAR_ANGLE_MAX_RAD),
            "lateral_acceleration": self.number(LATERAL_ACCELERATION_MAX_M_S2),
        }
        for name, bound in bounds.items():
            yield Claim(f"{name} is within its range", self.within(f"{sample}{name}", bound))
        yield Claim("friction is within its range", self.between(f"{sample}friction", 0.0, FRICTION_UNKNOWN))
        if self.takes_acceleration:
            name = "longitudinal_acceleration"
            yield Claim(f"{name} is within its range", self.within(f"{sample}{name}", LONGITUDINAL_ACCELERATION_MAX_M_S2))
        yield Claim("inhibit is true or false", f"is_flag({sample}inhibit)")

    @property
    def takes_acceleration(self) -> bool:
        """Return whether the build has the signal of the longitudinal acceleration."""
        return any(each.name == "longitudinal_acceleration_max" for each in self.inputs.parameters)

    def signals_in_range(self, frame: Frame, signals: str) -> Iterator[Claim]:
        """Yield the ranges of unpacked signals, one step wider for the rounding."""
        for signal in frame.reals:
            layout, name = signal.layout, f"{signals}{signal.definition.role}"
            assert isinstance(layout, RealSignal)
            inside = self.between(name, layout.physical_low - layout.factor, layout.physical_high + layout.factor)
            yield Claim(f"{signal.definition.role} is in the range of its frame, or NaN", f"(({name} != {name}) || {inside})")

    @property
    def has_plain_map(self) -> bool:
        """Return whether each quantity of the map is one table of real numbers. Other storage has no lemmas yet."""
        view = self.map
        return not (view.is_raw or view.stacked or view.grip)

    def map_holds(self) -> tuple[Claim, ...]:
        """Return the claims of a valid map. A proof reads one breakpoint and one cell, with any index, so they hold for all."""
        axes = f"{self.map.speed.breakpoints}_hold(any_row) && {self.map.front_angle.breakpoints}_hold(any_column)"
        cell = f"{self.own('map_cell_holds')}(any_row, any_column)"
        return (
            Claim("the axes of a valid map are in range and increasing", f"!result || ({axes})"),
            Claim("the numbers of a valid map are in range", f"!result || {cell}"),
        )

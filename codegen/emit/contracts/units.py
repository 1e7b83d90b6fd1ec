"""The contracts of a build: the one table of what its functions require and ensure.

Ranges come from the tables of parameters, signals and laws. Conditions are C over the arguments, `result` and, for the value of
a state before the call, `<argument>_before`; `->` leads from an argument to its members. The invariants hold for every state
that the code leaves behind. Their bounds leave room for rounding, which makes them provable.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from codegen.configuration.can import RealSignal
from codegen.configuration.signals import STATUSES
from codegen.emit.can_view import CanView, Frame, TaskView
from codegen.emit.constants import Constant
from codegen.emit.contracts.contract import Argument, Claim, Invariant, Lemma, Unit
from codegen.emit.controller_view import ControllerView
from codegen.emit.dynamics_view import ReferenceModelView
from codegen.emit.inputs_view import FRICTION_UNKNOWN, InputsView
from codegen.emit.laws import REAR_ANGLE_MAX_RAD, SAMPLE_RANGES, YAW_RATE_ERROR_MAX_RAD_S
from codegen.emit.limiter_view import LimiterView
from codegen.emit.map_view import MapView
from codegen.emit.parameters import ParameterView
from codegen.emit.text import Precision, literal

MAP_YAW_RATE_MAX_RAD_S = 16.0
"""Bound of the looked-up yaw rate: above the table's, by more than the rounding of two interpolations; a power of two."""
REFERENCE_MAX_RAD_S = 20.0
"""Bound of the yaw rate that a law follows."""
TASK_COUNT_MAX = 64
"""Bound of the counts of disturbances in the task."""
GOOD_SAMPLES_MAX = 10_000
LATERAL_ACCELERATION_MAX_M_S2 = 4096.0
"""Bound of the lateral acceleration that is computed from checked signals."""
E2E_COUNTER_MAX = 14
"""AUTOSAR E2E profile 1: 15 is never sent."""


@dataclass(frozen=True)
class Contracts:
    """All contracts of a build."""

    invariants: dict[str, Invariant]
    lemmas: tuple[Lemma, ...]
    units: tuple[Unit, ...]

    def of(self, function: str) -> Unit:
        """Return the contract of a function."""
        return next(unit for unit in self.units if unit.name == function)


def contracts_of(context: Mapping[str, Any]) -> Contracts:
    """Return the contracts of the build whose templates have this context."""
    table = _Table(context)
    return Contracts({each.ctype: each for each in table.invariants()}, tuple(table.lemmas()), tuple(table.units()))


class _Table:
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
        self.constants: tuple[Constant, ...] = context["constants"]

    # Conditions

    def number(self, value: float) -> str:
        return literal(value, self.precision)

    def within(self, expression: str, limit: float | str) -> str:
        return f"lies_within({expression}, {limit if isinstance(limit, str) else self.number(limit)})"

    def between(self, expression: str, low: float, high: float) -> str:
        return f"lies_between({expression}, {self.number(low)}, {self.number(high)})"

    def high(self, name: str) -> str:
        return next(view.high for view in self.inputs.parameters if view.name == name)

    def is_code(self, expression: str, last: int) -> str:
        return f"((uint32_t){expression} <= {last}u)"

    def own(self, name: str) -> str:
        return f"{self.prefix}_{name}"

    # Invariants

    def invariants(self) -> Iterator[Invariant]:
        own = self.own
        yield self._parameters("limiter_parameters_t", self.limiter.parameters, ())
        yield self._parameters("inputs_parameters_t", self.inputs.parameters, ())
        yield self._parameters("parameters_t", self.controller.parameters, self._parameter_relations())
        yield Invariant(
            own("limiter_t"),
            (
                self.within("value->rear_angle", 1.0),
                self.between("value->speed", 0.0, 200.0),
                self.within("value->front_angle", 1.5),
                "is_flag(value->speed_known)",
            ),
        )
        yield self._inputs()
        if model := self.model:
            bounds = {"sideslip_angle": model.sideslip_max, "yaw_rate": model.yaw_rate_max, "rear_angle": model.rear_angle_max}
            yield Invariant(
                own("reference_model_t"), tuple(self.within(f"value->{name}", each) for name, each in bounds.items())
            )
            yield Invariant(own("grip_t"), self._grip())
        yield Invariant(own("law_t"), tuple(self._law()))
        yield Invariant(own("controller_t"), tuple(self._controller()))
        counters = ("last_counter", "max_delta_counter", "no_new_or_repeated_data_counter")
        receiver = (*(f"(value->{name} <= {E2E_COUNTER_MAX}u)" for name in counters), "(value->sync_counter <= 1u)")
        yield Invariant(own("e2e_receiver_t"), (*receiver, "is_flag(value->waits_for_first)"))
        yield Invariant(own("e2e_supervision_t"), (self.is_code("value->state", 3),))
        states = (f"{own(f'e2e_{name}_holds')}(&value->{name})" for name in ("receiver", "supervision"))
        counts = (f"(value->causes <= {(1 << self.can.reception_bits) - 1}u)", "(value->advance <= 7u)")
        yield Invariant(own("task_input_t"), (*states, *counts, "is_flag(value->disturbed)", "is_flag(value->usable)"))
        yield Invariant(own("task_t"), tuple(self._task()))

    def _parameters(self, ctype: str, views: Iterable[ParameterView], relations: Iterable[str]) -> Invariant:
        """Ranges of the parameters, and the relations between them that proofs use."""
        single, arrays = [], defaultdict(list)
        for view in views:
            if view.points:
                arrays[view.points].append(f"lies_between(value->{view.name}[k], {view.low}, {view.high})")
                if view.increasing:
                    arrays[view.points].append(f"((k == 0u) || (value->{view.name}[k - 1u] < value->{view.name}[k]))")
            elif view.is_count:
                low = [f"(value->{view.name} >= {view.low})"] if view.low != "0u" else []
                single += [*low, f"(value->{view.name} <= {view.high})"]
            else:
                single.append(f"lies_between(value->{view.name}, {view.low}, {view.high})")
        if ctype == "limiter_parameters_t":
            arrays[f"{self.upper}_LIMITER_POINTS"].append("(value->opposite_phase_max[k] <= value->rear_angle_max)")
        return Invariant(self.own(ctype), (*single, *relations), tuple((name, tuple(each)) for name, each in arrays.items()))

    def _parameter_relations(self) -> Iterator[str]:
        yield "(value->rear_angle_max <= value->inputs.rear_angle_max)"
        yield "(value->disable_speed < value->enable_speed)"
        yield "(value->inputs.speed_max <= value->limiter.speed_max)"
        yield "(value->inputs.front_angle_max <= value->limiter.front_angle_max)"
        yield "(value->limiter.rear_angle_max <= value->rear_angle_max)"
        yield f"{self.own('inputs_parameters_holds')}(&value->inputs)"
        yield f"{self.own('limiter_parameters_holds')}(&value->limiter)"

    def _inputs(self) -> Invariant:
        yaw, twice = self.high("yaw_rate_max"), f"({self.number(2.0)} * {self.high('yaw_rate_max')})"
        signals = {"speed": self.high("speed_max"), "front_angle": self.high("front_angle_max"), "yaw_rate": yaw}
        claims = [self.within(f"value->{name}.value", each) for name, each in signals.items()]
        claims += [self.is_code(f"value->{name}.source", 2) for name in signals]
        claims += [f"(value->{name}.good <= {GOOD_SAMPLES_MAX}u)" for name in ("front_angle", "yaw_rate")]
        claims += [self.within(f"value->{name}", yaw) for name in ("expected_yaw_rate", "beyond_linear")]
        claims += [f"lies_between(value->{name}, {self.number(0.0)}, {twice})" for name in ("least", "least_of_front")]
        claims += [self.within("value->yaw_rate_offset", self.high("yaw_rate_offset_max"))]
        claims += [self.between("value->friction", 0.0, FRICTION_UNKNOWN)]
        claims += [f"is_flag(value->{name})" for name in ("lateral_is_known", "lateral_is_proven")]
        return Invariant(self.own("inputs_t"), tuple(claims))

    def _law(self) -> Iterator[str]:
        for field in self.controller.law_state:
            name = f"value->{field.name}"
            if field.kind == "bool":
                yield f"is_flag({name})"
            elif self.model and field.name == "previous_model_yaw_rate":
                yield self.within(name, self.model.yaw_rate_max)
            elif field.kind == "real":
                yield self.within(name, field.bound)
            elif field.name == "model":
                yield f"{self.own('reference_model_holds')}(&{name})"

    def _grip(self) -> tuple[str, ...]:
        constants = {each.name: each.values[0] for each in self.constants}
        friction_min = next(view.low for view in self.controller.parameters if view.name == "friction_min")
        least = 0.5 * float(friction_min.rstrip("f")) / constants["friction_per_grip"]
        available = self.between("value->available", least, constants["grip_max"])
        return self.between("value->reached", 0.0, 4000.0), available

    def _controller(self) -> Iterator[str]:
        own, status = self.own, f"{self.upper}_STATUS"
        yield f"{own('law_holds')}(&value->law)"
        yield f"{own('inputs_holds')}(&value->inputs)"
        yield f"{own('limiter_holds')}(&value->limiter)"
        if self.model:
            yield f"{own('grip_holds')}(&value->grip)"
        yield self.within("value->rear_angle", self.controller.actuator_angle_max)
        yield self.within("value->yaw_rate_reference", REFERENCE_MAX_RAD_S)
        yield self.within("value->yaw_rate_error", 2.0 * REFERENCE_MAX_RAD_S)
        yield f"(value->initialised == 0x{self.controller.initialised:X}u)"
        yield from (claim.condition for claim in self._checked_sample("value->sample."))
        yield self.is_code("value->quality", 3)
        yield self.is_code("value->status", len(STATUSES) - 1)
        yield "is_flag(value->enabled)"
        yield f"((value->status > {status}_LIMITED) || value->enabled)"
        yield f"(((value->status != {status}_STANDBY) && (value->status != {status}_FAIL_SAFE)) || !value->enabled)"
        yield "(value->rear_angle == value->limiter.rear_angle)"

    def _task(self) -> Iterator[str]:
        yield f"{self.own('controller_holds')}(&value->controller)"
        for name in ("motion", "conditions"):
            yield f"{self.own('task_input_holds')}(&value->{name}_input)"
            frame = next(each for each in self.can.messages if each.role == f"vehicle_{name}")
            yield from (claim.condition for claim in self._signals(frame, f"value->{name}."))
        yield f"(value->counter <= {E2E_COUNTER_MAX}u)"
        yield f"((value->backlog <= {TASK_COUNT_MAX}u) && (value->disturbance <= {TASK_COUNT_MAX}u))"
        yield self.within("value->expected_angle", self.high("rear_angle_max"))
        yield from (f"is_flag(value->{name})" for name in ("conditions.inhibit", "conditions_close", "started"))

    def _signals(self, frame: Frame, signals: str) -> Iterator[Claim]:
        """Ranges of unpacked signals, one step wider for the rounding."""
        for signal in frame.reals:
            layout, name = signal.layout, f"{signals}{signal.definition.role}"
            assert isinstance(layout, RealSignal)
            inside = self.between(name, layout.physical_low - layout.factor, layout.physical_high + layout.factor)
            yield Claim(f"{signal.definition.role} is in the range of its frame, or NaN", f"(({name} != {name}) || {inside})")

    def _checked_sample(self, sample: str) -> Iterator[Claim]:
        """Ranges of a checked sample."""
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
        yield Claim("inhibit is true or false", f"is_flag({sample}inhibit)")

    # Lemmas

    def lemmas(self) -> Iterator[Lemma]:
        """Facts that a solver proves alone but not inside of a function; `lemmas.j2` holds their C."""
        number = {name: self.scalar(name) for name in ("value", "first", "second", "share", "speed", "limit", "front_angle")}
        yield Lemma("lemma_share", (number["value"], number["first"], number["second"]))
        yield Lemma("lemma_interpolation", (number["first"], number["second"], number["share"]))
        yield Lemma("lemma_cap", (number["value"], number["speed"], number["limit"]))
        yield Lemma("lemma_constants", linked=(self.own("calibration"),))
        limited = (self.argument("parameters", "limiter_parameters_t", "in"), number["speed"])
        yield Lemma("lemma_opposite_phase", limited, unit=self.own("limiter"))
        yield Lemma("lemma_magnitude", (number["value"],), unit=self.own("limiter"))
        bounds = (Argument(name, "int32_t") for name in ("low", "high"))
        yield Lemma("lemma_code", (number["value"], self.scalar("scale"), *bounds), unit=self.own("can"))
        if self.has_plain_map:
            unit, searched = self.own("map"), (number["speed"], number["front_angle"])
            yield Lemma("lemma_axes", before=("assume_breakpoints();",), unwind=self._rounds())
            yield Lemma("lemma_place", searched, unit, before=("lemma_axes();",))
            yield Lemma("lemma_cell", unit=unit)
            yield Lemma("lemma_numbers", unit=unit, unwind=self._rounds())

    def _rounds(self) -> int:
        """Loop rounds over the longer axis."""
        return max(self.map.speed.size, self.map.front_angle.size) + 1

    @property
    def has_plain_map(self) -> bool:
        """Whether the map has one table a quantity, of real numbers: lemmas on other storage are still missing."""
        view = self.map
        return not (view.is_raw or view.stacked or view.grip)

    # Units

    def units(self) -> Iterator[Unit]:
        yield from self._limiter_units()
        yield from self._inputs_units()
        yield from self._map_units()
        if self.model:
            yield from self._model_units()
            yield from self._grip_units()
        yield from self._law_units()
        yield from self._controller_units()
        yield from self._e2e_units()
        yield from self._can_units()
        yield from self._task_units()

    def argument(self, name: str, ctype: str, role: Any) -> Argument:
        return Argument(name, self.own(ctype), role)

    def scalar(self, name: str) -> Argument:
        return Argument(name, self.real)

    def validity(self, unit: str, parameters: str, *more_claims: Claim, **more: Any) -> Unit:
        holds = f"!result || {self.own(parameters.removesuffix('_t'))}_holds(parameters)"
        argument = self.argument("parameters", parameters, "in")
        claims = (Claim("valid parameters are in range", holds), *more_claims)
        function = self.own(f"{parameters.removesuffix('_t')}_valid")
        return Unit(function, self.own(unit), (argument,), "bool", ensures=claims, **more)

    def _limiter_units(self) -> Iterator[Unit]:
        own, unit, zero, one = self.own, self.own("limiter"), self.number(0.0), self.number(1.0)
        yield self.validity("limiter", "limiter_parameters_t")
        state = self.argument("self", "limiter_t", "new")
        started = f"self->rear_angle == ({self.within('rear_angle', one)} ? rear_angle : {zero})"
        yield Unit(
            own("limiter_init"),
            unit,
            (state, self.scalar("rear_angle")),
            ensures=(Claim("it starts from the angle given; from zero beyond 1 rad and for NaN", started),),
        )
        arguments = (
            self.argument("self", "limiter_t", "state"),
            self.argument("parameters", "limiter_parameters_t", "parameter"),
            self.argument("input", "limiter_input_t", "in"),
        )
        points, angles = "parameters.opposite_phase_speed", "parameters.opposite_phase_max"
        speed, largest, front = "self.speed", "parameters.rear_angle_max", "parameters.in_phase_from_front_angle"
        ratio = f"(magnitude(self.front_angle) / {front})"
        facts = (
            f"for (uint32_t k = 1u; k < (uint32_t){self.upper}_LIMITER_POINTS; k++) {{",
            f"    lemma_share({speed}, {points}[k - 1u], {points}[k]);",
            f"    lemma_interpolation({angles}[k - 1u], {angles}[k],",
            f"        ({speed} - {points}[k - 1u]) / ({points}[k] - {points}[k - 1u]));",
            "}",
            f"lemma_interpolation(opposite_phase_bound(&parameters, {speed}), {largest}, ({ratio} < {one}) ? {ratio} : {one});",
        )
        step = Unit(own("limiter_step"), unit, arguments, self.real, ensures=tuple(self._limited()), facts=facts, includes=True)
        *bounds, passes = self._bounded_over_speed()
        yield replace(step, more=tuple(bounds))
        alone: dict[str, Any] = {"stand_in": "magnitude_of_lemma", "replaced": ("magnitude",)}
        yield replace(step, facts=(), more=(passes,), part="_demand", **alone)

    def _bounded_over_speed(self) -> Iterator[Claim]:
        """Claims that no caller uses: the bound against the front wheels, and that the limiter does nothing of its own."""
        zero, one, largest = self.number(0.0), self.number(1.0), "parameters.rear_angle_max"
        bound, front, before = "opposite_phase_bound(&parameters, self.speed)", "self.front_angle", "self_before.rear_angle"
        slower, faster = (f"({before} {sign} {self.step('parameters.rear_rate_max')})" for sign in "-+")
        words, known = "is within opposite_phase_max, or returns at rear_rate_max", "!self.speed_known"
        left = f"{known} || ({front} < {zero}) || (-{bound} <= result) || ({faster} <= result)"
        right = f"{known} || ({front} > {zero}) || (result <= {bound}) || (result <= {slower})"
        yield Claim(f"to the right of front wheels to the left, it {words}", left)
        yield Claim(f"to the left of front wheels to the right, it {words}", right)
        ratio = f"(magnitude({front}) / parameters.in_phase_from_front_angle)"
        in_phase = f"({bound} + ((({ratio} < {one}) ? {ratio} : {one}) * ({largest} - {bound})))"
        low = f"(({front} < {zero}) ? -{in_phase} : -{bound})"
        high = f"(({front} > {zero}) ? {in_phase} : {bound})"
        free = " && ".join(
            f"({low} <= input.demand) && (input.demand <= {high})" for low, high in ((low, high), (slower, faster))
        )
        demanded = f"{known} || !({free} && {self.within('input.demand', largest)}) || (result == input.demand)"
        yield Claim("it is the demand where all bounds let that through", demanded)

    def _limited(self) -> Iterator[Claim]:
        before, zero = "self_before->rear_angle", self.number(0.0)
        yield Claim("|rear angle| is at most rear_angle_max", self.within("result", "parameters->rear_angle_max"))
        yield Claim("the result is kept", "result == self->rear_angle")
        yield from self._moved("result", before, "parameters->")
        for name in ("speed", "front_angle"):
            given = self.within(f"input->{name}", f"parameters->{name}_max")
            taken = f"magnitude_of(input->{name})" if name == "speed" else f"input->{name}"
            yield Claim(
                f"{name} is the one given where it is available, else the last one",
                f"self->{name} == ({given} ? {taken} : self_before->{name})",
            )
        known = f"({self.within('input->speed', 'parameters->speed_max')} || self_before->speed_known)"
        yield Claim("a speed is known once there was one", f"self->speed_known == {known}")
        ends = (before, "input->demand", zero)
        yield Claim("it is not above its last value, the demand and zero", " || ".join(f"(result <= {each})" for each in ends))
        yield Claim("it is not below its last value, the demand and zero", " || ".join(f"({each} <= result)" for each in ends))
        inside = self.within(before, "parameters->rear_angle_max")
        yield Claim("it is held as long as no speed is known", f"self->speed_known || !{inside} || (result == {before})")

    def step(self, rate: str) -> str:
        return f"({rate} * {self.controller.sampling_time})"

    def _moved(self, angle: str, before: str, limiter: str) -> Iterator[Claim]:
        """The rate limit of the limiter: the code's own expression, which makes it exact."""
        step, largest = self.step(f"{limiter}rear_rate_max"), f"{limiter}rear_angle_max"
        rises = f"({angle} <= ({before} + {step})) || ({angle} == -{largest})"
        falls = f"(({before} - {step}) <= {angle}) || ({angle} == {largest})"
        yield Claim("it rises by at most rear_rate_max, or to -rear_angle_max", rises)
        yield Claim("it falls by at most rear_rate_max, or to rear_angle_max", falls)

    def _within_rates(self, angle: str, before: str) -> str:
        own, limiter = "parameters->rear_rate_max", "parameters->limiter.rear_rate_max"
        step = self.step(f"(({own} < {limiter}) ? {own} : {limiter})")
        return f"((({before} - {step}) <= {angle}) && ({angle} <= ({before} + {step})))"

    def _inputs_units(self) -> Iterator[Unit]:
        unit = self.own("inputs")
        yield self.validity("inputs", "inputs_parameters_t")
        trusted = Argument("is_trusted", "bool")
        yield Unit(self.own("inputs_init"), unit, (self.argument("self", "inputs_t", "new"), trusted))
        arguments = (
            self.argument("self", "inputs_t", "state"),
            self.argument("parameters", "inputs_parameters_t", "parameter"),
            self.argument("measured", "measurement_t", "in"),
            self.scalar("rear_angle"),
            self.argument("checked", "measurement_t", "out"),
        )
        requires = (
            Claim("inhibit is true or false", "is_flag(measured->inhibit)"),
            Claim("rear_angle is within its range", self.within("rear_angle", REAR_ANGLE_MAX_RAD)),
        )
        quality = Claim("the quality is one of its enumerators", self.is_code("result", 3))
        ensures = (*self._checked_sample("checked->"), quality)
        yield Unit(self.own("inputs_step"), unit, arguments, self.own("quality_t"), requires=requires, ensures=ensures)

    def _map_units(self) -> Iterator[Unit]:
        own, unit, view = self.own, self.own("map"), self.map
        arguments = tuple(self.scalar(name) for name in ("speed", "front_angle", "friction"))
        missing: dict[str, Any] = {"open": "the lemmas on maps are for one table of real numbers without a table of grip"}
        yield self._map_valid() if self.has_plain_map else Unit(own("map_valid"), unit, (), "bool", **missing)
        more: dict[str, Any] = self._look_up() if self.has_plain_map else missing
        bound = Claim("the yaw rate is in range", self.within("result", MAP_YAW_RATE_MAX_RAD_S))
        yield Unit(own("map_yaw_rate_on_road"), unit, arguments, self.real, ensures=(bound,), **more)
        if view.with_rear_angle:
            bounds = (
                Claim("the yaw rate is in range", self.within("result->yaw_rate", MAP_YAW_RATE_MAX_RAD_S)),
                Claim("the rear angle is in range", self.within("result->rear_angle", REAR_ANGLE_MAX_RAD)),
                Claim("the acceleration is in range", self.between("result->lateral_acceleration_max", 0.0, 100.0)),
            )
            yield Unit(own("map_reference"), unit, arguments, own("map_reference_t"), True, ensures=bounds, **more)

    def _map_valid(self) -> Unit:
        own, view = self.own, self.map
        inside = f"(any_row < (uint32_t){view.speed.points}) && (any_column < (uint32_t){view.front_angle.points})"
        checks = ["are_between", "are_increasing", *(["are_even"] if view.speed.even or view.front_angle.even else [])]
        return Unit(
            own("map_valid"),
            own("map"),
            (),
            "bool",
            ensures=self._map_holds(),
            includes=True,
            before=(f"CONTRACT_ASSUME({inside});",),
            stand_in="checks_of_lemma",
            replaced=tuple(checks),
            unwind=self._rounds(),
        )

    def _map_holds(self) -> tuple[Claim, ...]:
        """Claims of a valid map: what holds for the breakpoint and the cell that the proof looks at holds for any."""
        axes = f"{self.map.speed.breakpoints}_hold(any_row) && {self.map.front_angle.breakpoints}_hold(any_column)"
        cell = f"{self.own('map_cell_holds')}(any_row, any_column)"
        return (
            Claim("the axes of a valid map are in range and increasing", f"!result || ({axes})"),
            Claim("the numbers of a valid map are in range", f"!result || {cell}"),
        )

    def _look_up(self) -> dict[str, Any]:
        """Proof of a look-up in any valid map, which callers have from valid parameters."""
        return {
            "includes": True,
            "before": ("lemma_axes();", "lemma_constants();", "lemma_place(speed, front_angle);"),
            "facts": ("lemma_cap(yaw_rate_of_cell, speed, road_of(friction).lateral_acceleration_max);",),
            "stand_in": "interpolate_of_lemma",
            "replaced": ("interpolate",),
        }

    def _model_units(self) -> Iterator[Unit]:
        unit = self.own("reference_model")
        numbers = tuple(self.scalar(name) for name in ("speed", "yaw_rate", "rear_angle"))
        yield Unit(self.own("reference_model_start"), unit, (self.argument("self", "reference_model_t", "new"), *numbers))
        arguments = (
            self.argument("self", "reference_model_t", "state"),
            self.argument("input", "reference_model_input_t", "in"),
        )
        yield Unit(self.own("reference_model_step"), unit, arguments)

    def _grip_units(self) -> Iterator[Unit]:
        unit, parameters = self.own("grip"), self.argument("parameters", "parameters_t", "parameter")
        new, state, read = (self.argument("self", "grip_t", role) for role in ("new", "state", "parameter"))
        # The constants of the vehicle are no calibration: the proof takes their values.
        more: dict[str, Any] = {"linked": (self.own("calibration"),)}
        yield Unit(self.own("grip_init"), unit, (new,), **more)
        known = f"(result > {self.number(0.0)}) && (result <= {self.number(FRICTION_UNKNOWN)})"
        positive = Claim("the friction is positive and in range", known)
        arguments: tuple[Argument, ...] = (read, parameters, self.scalar("estimate"))
        yield Unit(self.own("grip_friction"), unit, arguments, self.real, ensures=(positive,), **more)
        arguments = (state, parameters, *(self.scalar(name) for name in ("speed", "yaw_rate_reference", "yaw_rate")))
        reference = Claim("yaw_rate_reference is in range", self.within("yaw_rate_reference", REFERENCE_MAX_RAD_S))
        requires = (*self._ranges("", ("speed", "yaw_rate")), reference)
        yield Unit(self.own("grip_update"), unit, arguments, requires=requires, **more)
        yield Unit(self.own("grip_recover"), unit, (state, parameters), **more)

    def _ranges(self, sample: str, names: Iterable[str]) -> Iterator[Claim]:
        for name in names:
            yield Claim(f"{name} is in range", self.between(f"{sample}{name}", *SAMPLE_RANGES[name]))

    def _law_units(self) -> Iterator[Unit]:
        own, unit = self.own, self.own("law")
        start, step = ((own("reference_model_start"),), (own("reference_model_step"),)) if self.model else ((), ())
        angle = Claim("rear_angle is in range", self.within("rear_angle", REAR_ANGLE_MAX_RAD))
        arguments: tuple[Argument, ...] = (self.argument("self", "law_t", "new"), self.scalar("rear_angle"))
        yield Unit(own("law_init"), unit, arguments, requires=(angle,), callees=start)
        arguments = (
            self.argument("self", "law_t", "state"),
            self.argument("parameters", "parameters_t", "parameter"),
            self.argument("sample", "measurement_t", "in"),
            Argument("phase", own("law_phase_t")),
            *(self.scalar(name) for name in ("friction", "rear_angle", "yaw_rate_error")),
        )
        requires = (
            *self._ranges("sample->", SAMPLE_RANGES),
            Claim("inhibit is true or false", "is_flag(sample->inhibit)"),
            Claim("phase is one of its enumerators", self.is_code("phase", 2)),
            angle,
            Claim("yaw_rate_error is in range", self.within("yaw_rate_error", YAW_RATE_ERROR_MAX_RAD_S)),
        )
        ensures = (
            Claim(
                "the command moves by at most the lower of both rates", self._within_rates("result->rear_angle", "rear_angle")
            ),
            Claim("yaw_rate_reference is in range", self.within("result->yaw_rate_reference", REFERENCE_MAX_RAD_S)),
        )
        lookup = own("map_reference" if self.map.with_rear_angle else "map_yaw_rate_on_road")
        callees = (lookup, *start, *step)
        output = own("law_output_t")
        yield Unit(own("law_step"), unit, arguments, output, True, requires, ensures, callees=callees)

    def _controller_units(self) -> Iterator[Unit]:
        own, unit = self.own, self.own("controller")
        judges = ("inputs_parameters_valid", "limiter_parameters_valid", "map_valid")
        valid_map = self._map_holds() if self.has_plain_map else ()
        yield self.validity("parameters", "parameters_t", *valid_map, callees=tuple(own(each) for each in judges))
        grip = ("init", "friction", "update", "recover") if self.model else ()
        init = tuple(own(each) for each in ("inputs_init", "limiter_init", "law_init", *(f"grip_{name}" for name in grip[:1])))
        bound = self.within("self->rear_angle", self.controller.actuator_angle_max)
        arguments: tuple[Argument, ...] = (self.argument("self", "controller_t", "new"), self.scalar("rear_angle"))
        started = Claim("|rear_angle| is at most the actuator's largest angle", bound)
        yield Unit(own("controller_init"), unit, arguments, ensures=(started,), callees=init)
        arguments = (
            self.argument("self", "controller_t", "state"),
            self.argument("parameters", "parameters_t", "parameter"),
            self.argument("measurement", "measurement_t", "in"),
        )
        inhibit = Claim("inhibit is true or false", "is_flag(measurement->inhibit)")
        steps = tuple(own(each) for each in ("inputs_step", "law_step", "limiter_step", *(f"grip_{name}" for name in grip[1:])))
        command, ensures = own("command_t"), tuple(self._commanded())
        yield Unit(own("controller_step"), unit, arguments, command, True, (inhibit,), ensures, callees=(*init, *steps))

    def _commanded(self) -> Iterator[Claim]:
        status, angle, before = f"{self.upper}_STATUS", "result->rear_angle", "self_before->rear_angle"
        yield Claim("|rear_angle| is at most rear_angle_max", self.within(angle, "parameters->rear_angle_max"))
        yield Claim("yaw_rate_reference is in range", self.within("result->yaw_rate_reference", REFERENCE_MAX_RAD_S))
        yield Claim("status is one of its enumerators", self.is_code("result->status", len(STATUSES) - 1))
        yield from self._moved(angle, before, "parameters->limiter.")
        rates = self._within_rates(angle, before)
        yield Claim(
            "tracking, it moves by at most the lower of both rates", f"(result->status != {status}_TRACKING) || {rates}"
        )
        shrinks = f"(magnitude_of({angle}) <= magnitude_of({before}))"
        yield Claim("in fail-safe |rear_angle| does not grow", f"(result->status != {status}_FAIL_SAFE) || {shrinks}")
        yield Claim("the command and the status are kept", f"({angle} == self->rear_angle) && (result->status == self->status)")

    def _e2e_units(self) -> Iterator[Unit]:
        own, unit = self.own, self.own("e2e")
        identifier, data = Argument("data_id", "uint16_t"), Argument("data", "uint8_t", "bytes in")
        new, state = (self.argument("self", "e2e_receiver_t", role) for role in ("new", "state"))
        status = own("e2e_status_t")
        yield Unit(own("e2e_receiver_init"), unit, (new,))
        damaged = f"(({own('e2e_crc')}(data_id, data) != data[0]) || ((data[1] & 0x0Fu) == 15u))"
        wrong = Claim("a wrong CRC is found", f"(result == {self.upper}_E2E_WRONG_CRC) == {damaged}")
        code = Claim("the result is one of its enumerators", self.is_code("result", 7))
        yield Unit(own("e2e_check"), unit, (state, identifier, data), status, ensures=(code, wrong))
        none = Claim("it returns NO_NEW_DATA", f"result == {self.upper}_E2E_NO_NEW_DATA")
        yield Unit(own("e2e_no_new_data"), unit, (state,), status, ensures=(none,))
        arguments = (identifier, Argument("counter", "uint8_t", "state"), Argument("data", "uint8_t", "bytes out"))
        sent = (
            Claim("the counter for the next frame is at most 14", f"*counter <= {E2E_COUNTER_MAX}u"),
            Claim("the frame carries the counter", "(data[1] & 0x0Fu) == (*counter_before & 0x0Fu)"),
            Claim("the frame has the right CRC", f"{own('e2e_crc')}(data_id, data) == data[0]"),
        )
        yield Unit(own("e2e_protect"), unit, arguments, ensures=sent)
        new, state = (self.argument("self", "e2e_supervision_t", role) for role in ("new", "state"))
        yield Unit(own("e2e_supervision_init"), unit, (new,))
        arguments = (state, Argument("is_good", "bool"), Argument("is_damaged", "bool"))
        kept = Claim("the result is kept", "result == self->state")
        yield Unit(own("e2e_supervise"), unit, arguments, own("e2e_state_t"), ensures=(kept,))

    def _can_units(self) -> Iterator[Unit]:
        unit = self.own("can")
        absent = Claim("it is NaN", "result != result")
        yield Unit(self.own("can_not_available"), unit, (), self.real, ensures=(absent,))
        for frame in self.can.messages:
            signals, ensures = f"{frame.role}_t", self._signals(frame, "signals->")
            data = Argument("data", "uint8_t", "bytes in")
            out = self.argument("signals", signals, "out")
            yield Unit(self.own(f"can_unpack_{frame.role}"), unit, (data, out), ensures=tuple(ensures))
            arguments = (self.argument("signals", signals, "in"), Argument("data", "uint8_t", "bytes out"))
            yield Unit(self.own(f"can_pack_{frame.role}"), unit, arguments, conversions=False)

    def _task_units(self) -> Iterator[Unit]:
        own, unit, init = self.own, self.own("task"), self.own("controller_init")
        new, state = (self.argument("self", "task_t", role) for role in ("new", "state"))
        kept = Claim("the parameters are those given", "self->parameters == parameters")
        frames = (own("e2e"), own("can"))
        more: dict[str, Any] = {"linked": frames, "conversions": False}
        parameters = self.argument("parameters", "parameters_t", "parameter")
        yield Unit(own("task_init"), unit, (new, parameters), ensures=(kept,), callees=(init,), **more)
        more["before"] = (
            f"{own('parameters_t')} parameters;",
            "self.parameters = &parameters;",
            f"CONTRACT_ASSUME({own('parameters_holds')}(&parameters));",
        )
        more["callees"] = (init, own("controller_step"))
        data, length = Argument("data", "uint8_t", "bytes in"), Argument("length", "uint8_t")
        yield Unit(own("task_on_can_frame"), unit, (state, Argument("id", "uint32_t"), data, length), **more)
        identifier = f"result == (uint32_t){self.upper}_CAN_ID_REAR_STEER_COMMAND"
        crc = f"{own('e2e_crc')}((uint16_t){self.upper}_CAN_DATA_ID_REAR_STEER_COMMAND, data) == data[0]"
        before = "(uint32_t)self_before->counter"
        counted = f"((data[1] & 0x0Fu) == {before}) && (self->counter == (({before} + 1u) % {E2E_COUNTER_MAX + 1}u))"
        sent = (
            Claim("it is the frame of the command", identifier),
            Claim("the frame has the counter, and the counter advances", counted),
            Claim("the frame has the right CRC", crc),
        )
        yield Unit(
            own(self.task.function), unit, (state, Argument("data", "uint8_t", "bytes out")), "uint32_t", ensures=sent, **more
        )

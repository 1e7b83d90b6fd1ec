"""Invariants: what holds for every valid parameter set and for every state that the code leaves behind."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator

from codegen.configuration.controller import RECOVERY_SAMPLES_MAX
from codegen.configuration.signals import STATUSES
from codegen.emit.contracts.conditions import (
    LATERAL_ACCELERATION_MAX_M_S2,
    LONGITUDINAL_ACCELERATION_MAX_M_S2,
    REFERENCE_MAX_RAD_S,
    Conditions,
)
from codegen.emit.contracts.contract import Invariant
from codegen.emit.controller_view import TASK_SAMPLES_MAX
from codegen.emit.inputs_view import FRICTION_UNKNOWN
from codegen.emit.parameters import Parameter
from codegen.emit.supervision import STATES, Cause, State

TASK_COUNT_MAX = 80
"""Bound of the counts of disturbances in the task."""
LATERAL_DEVIATION_MAX_RAD_S = 64.0
"""Bound of the difference between yaw rate and the turn by the lateral acceleration."""
MISSING_SAMPLES_MAX = 100
"""Largest missing_samples_max; a count is at most one above it."""


class Invariants(Conditions):
    """The invariants of a build. Their bounds leave room for rounding, which makes them provable."""

    def invariants(self) -> Iterator[Invariant]:
        """Yield the invariants, each after those that it names."""
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
            yield Invariant(
                own("reference_model_t"), tuple(self.within(f"value->{name}", each) for name, each in model.state.items())
            )
            yield Invariant(own("grip_t"), self._grip())
        yield Invariant(own("law_t"), tuple(self._law()))
        yield Invariant(own("controller_t"), tuple(self._controller()))
        yield Invariant(own("e2e_receiver_t"), (*self._receiver(), "is_flag(value->waits_for_first)"))
        yield Invariant(own("e2e_supervision_t"), (self.is_code("value->state", 3),))
        states = (f"{own(f'e2e_{name}_holds')}(&value->{name})" for name in ("receiver", "supervision"))
        counts = (f"(value->causes <= {(1 << self.can.reception_bits) - 1}u)", "(value->advance <= 7u)")
        flags = (f"is_flag(value->{name})" for name in ("out_of_sequence", "disturbed", "usable"))
        yield Invariant(own("task_input_t"), (*states, *counts, *flags))
        codes = {"state": len(State), "cause": len(Cause), "status": len(STATUSES)}
        supervised = [self.is_code(f"value->{name}", count - 1) for name, count in codes.items()]
        silent = [each for each, row in STATES.items() if not row.has_command]
        known = " && ".join(f"(value->state != {self.upper}_SUPERVISION_{each.name})" for each in silent)
        supervised += ["is_flag(value->has_command)", f"(value->has_command == ({known}))"]
        yield Invariant(own("supervision_t"), tuple(supervised))
        yield Invariant(own("task_t"), tuple(self._task()))

    def _receiver(self) -> Iterator[str]:
        """Yield the bounds of the counters of a receiver."""
        yield f"(value->last_counter <= {self.counter_max}u)"
        if self.can.profile.has_synchronisation:
            for name in ("max_delta_counter", "no_new_or_repeated_data_counter"):
                yield f"(value->{name} <= {self.counter_max}u)"
            yield f"(value->sync_counter <= {self.can.settings.sync_counter_init}u)"

    def _parameters(self, ctype: str, parameters: Iterable[Parameter], relations: Iterable[str]) -> Invariant:
        """Ranges of the parameters, and the relations between them that proofs use."""
        single, arrays = [], defaultdict(list)
        for each in parameters:
            low, high, name = self.number(each.low), self.number(each.high), f"value->{each.name}"
            if each.points:
                size = f"{self.upper}_{each.points}"
                arrays[size].append(f"lies_between({name}[k], {low}, {high})")
                if each.increasing:
                    arrays[size].append(f"((k == 0u) || ({name}[k - 1u] < {name}[k]))")
            elif each.is_count:
                single += [*([f"({name} >= {low})"] if each.low else []), f"({name} <= {high})"]
            else:
                single.append(f"lies_between({name}, {low}, {high})")
        if ctype == "limiter_parameters_t":
            arrays[f"{self.upper}_LIMITER_POINTS"].append("(value->opposite_phase_max[k] <= value->rear_angle_max)")
        return Invariant(self.own(ctype), (*single, *relations), tuple((name, tuple(each)) for name, each in arrays.items()))

    def _parameter_relations(self) -> Iterator[str]:
        yield "(value->rear_angle_max <= value->inputs.rear_angle_max)"
        if self.law.waits_for_speed:
            yield "(value->disable_speed < value->enable_speed)"
        yield "(value->inputs.speed_max <= value->limiter.speed_max)"
        yield "(value->inputs.front_angle_max <= value->limiter.front_angle_max)"
        yield "(value->limiter.rear_angle_max <= value->rear_angle_max)"
        yield f"{self.own('inputs_parameters_holds')}(&value->inputs)"
        yield f"{self.own('limiter_parameters_holds')}(&value->limiter)"

    def _inputs(self) -> Invariant:
        yaw, twice = self.high("yaw_rate_max"), f"({self.number(2.0)} * {self.high('yaw_rate_max')})"
        signals = {"speed": self.high("speed_max"), "front_angle": self.high("front_angle_max"), "yaw_rate": yaw}
        claims: list[str] = [self.within(f"value->{name}.value", each) for name, each in signals.items()]
        claims += [self.is_code(f"value->{name}.source", 2) for name in signals]
        claims += [f"(value->{name}.missing <= {MISSING_SAMPLES_MAX + 1}u)" for name in signals]
        claims += [
            f"(!{self.is_measured(f'value->{name}')} || (value->{name}.missing <= {MISSING_SAMPLES_MAX}u))" for name in signals
        ]
        frozen = f"({self.is_measured('value->front_angle')} && (value->front_angle.good <= {3 * RECOVERY_SAMPLES_MAX}u))"
        claims += [f"({frozen} || (value->front_angle.good <= {RECOVERY_SAMPLES_MAX}u))"]
        claims += [f"(value->yaw_rate.good <= {RECOVERY_SAMPLES_MAX}u)"]
        claims += [self.within(f"value->{name}", yaw) for name in ("expected_yaw_rate", "beyond_linear")]
        claims += [self.between(f"value->{name}", 0.0, twice) for name in ("least", "least_of_front")]
        offsets = ("yaw_rate_offset", "lateral_acceleration_offset")
        claims += [self.within(f"value->{name}", self.high(f"{name}_max")) for name in offsets]
        claims += [self.between("value->friction", 0.0, FRICTION_UNKNOWN)]
        if self.takes_acceleration:
            claims += [self.within("value->longitudinal_acceleration", LONGITUDINAL_ACCELERATION_MAX_M_S2)]
        claims += [self.within("value->lateral_acceleration", self.high("lateral_acceleration_max"))]
        claims += [self.between("value->least_of_lateral", 0.0, LATERAL_DEVIATION_MAX_RAD_S)]
        claims += [f"(value->lateral_against <= {5 * RECOVERY_SAMPLES_MAX}u)"]
        flags = ["lateral_is_known", "lateral_is_proven", "lateral_is_wrong", *(["turn_is_confirmed"] if self.model else [])]
        claims += [f"is_flag(value->{name})" for name in flags]
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
        friction_min = next(each.low for each in self.controller.parameters if each.name == "friction_min")
        least = 0.5 * friction_min / constants["friction_per_grip"]
        available = self.between("value->available", least, constants["grip_max"])
        return self.between("value->reached", 0.0, LATERAL_ACCELERATION_MAX_M_S2), available

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
        yield from (claim.condition for claim in self.checked_sample("value->sample."))
        yield self.is_code("value->quality", 3)
        yield self.is_code("value->status", len(STATUSES) - 1)
        yield "is_flag(value->enabled)"
        yield f"((value->status > {status}_LIMITED) || value->enabled)"
        yield f"(((value->status != {status}_STANDBY) && (value->status != {status}_FAIL_SAFE)) || !value->enabled)"
        yield "(value->rear_angle == value->limiter.rear_angle)"
        unused = " && ".join(f"!{self.is_measured(f'value->inputs.{name}')}" for name in ("front_angle", "yaw_rate"))
        fails = f"((value->status == {status}_FAIL_SAFE) && {unused})"
        yield f"((value->quality != {self.upper}_QUALITY_UNUSABLE) || {fails})"

    def _task(self) -> Iterator[str]:
        yield f"{self.own('controller_holds')}(&value->controller)"
        for name in ("motion", "conditions"):
            yield f"{self.own('task_input_holds')}(&value->{name}_input)"
            frame = next(each for each in self.can.messages if each.role == f"vehicle_{name}")
            ranges = [claim.condition for claim in self.signals_in_range(frame, f"value->{name}.")]
            yield from ranges
            stuck = (each.replace("conditions.rear_angle", "stuck_angle") for each in ranges if "conditions.rear_angle" in each)
            yield from stuck
        yield f"(value->counter <= {self.counter_max}u)"
        yield f"((value->backlog <= {TASK_COUNT_MAX}u) && (value->disturbance <= {TASK_COUNT_MAX}u))"
        yield f"(value->inhibited_samples <= {TASK_SAMPLES_MAX + 1}u)"
        yield f"(value->actuator_samples <= ({TASK_SAMPLES_MAX}u + (value->is_stuck ? 1u : 0u)))"
        yield self.within("value->expected_angle", self.high("rear_angle_max"))
        yield self.within("value->measured_angle", self.high("rear_angle_max"))
        yield self.within("value->start_angle", self.controller.actuator_angle_max)
        yield self.within("value->angle_offset", f"(2 * {self.high('rear_angle_max')})")
        yield f"(!(value->controller.enabled || value->released) || (value->angle_offset == {self.number(0.0)}))"
        yield "!(value->controller.enabled && value->released)"
        yield f"(value->waited_samples <= {self.task.wheels_wait_max}u)"
        yield f"{self.own('supervision_holds')}(&value->supervision)"
        flags = ("conditions.inhibit", "conditions_close", "has_measured", "deviates", "released", "is_stuck")
        yield from (f"is_flag(value->{name})" for name in flags)

"""Contracts of the control law, of its model of the car, and of the controller that calls them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from codegen.configuration.signals import STATUSES
from codegen.emit.contracts.conditions import LATERAL_ACCELERATION_MAX_M_S2, REFERENCE_MAX_RAD_S, Conditions
from codegen.emit.contracts.contract import Argument, Claim, ProvedFunction
from codegen.emit.inputs_view import FRICTION_UNKNOWN
from codegen.emit.laws import REAR_ANGLE_MAX_RAD, YAW_RATE_ERROR_MAX_RAD_S


class ControlUnits(Conditions):
    """Contracts of reference model, grip, law and controller."""

    def units(self) -> Iterator[ProvedFunction]:
        """Yield the contracts."""
        if self.model:
            yield from self._model_units()
            yield from self._grip_units()
        yield from self._law_units()
        yield from self._controller_units()

    def _model_units(self) -> Iterator[ProvedFunction]:
        unit = self.own("reference_model")
        numbers = tuple(self.scalar(name) for name in ("speed", "yaw_rate", "rear_angle"))
        yield ProvedFunction(
            self.own("reference_model_start"), unit, (self.argument("self", "reference_model_t", "new"), *numbers)
        )
        arguments = (
            self.argument("self", "reference_model_t", "state"),
            self.argument("input", "reference_model_input_t", "in"),
        )
        yield ProvedFunction(self.own("reference_model_step"), unit, arguments)

    def _grip_units(self) -> Iterator[ProvedFunction]:
        unit, parameters = self.own("grip"), self.argument("parameters", "parameters_t", "parameter")
        new, state, read = (self.argument("self", "grip_t", role) for role in ("new", "state", "parameter"))
        # The constants of the vehicle are no calibration: the proof takes their values.
        more: dict[str, Any] = {"linked": (self.own("calibration"),)}
        yield ProvedFunction(self.own("grip_init"), unit, (new,), **more)
        known = f"(result > {self.number(0.0)}) && (result <= {self.number(FRICTION_UNKNOWN)})"
        positive = Claim("the friction is positive and in range", known)
        arguments: tuple[Argument, ...] = (read, parameters, self.scalar("estimate"))
        yield ProvedFunction(self.own("grip_friction"), unit, arguments, self.real, ensures=(positive,), **more)
        accelerations = ("model_acceleration", "acceleration")
        arguments = (state, parameters, *(self.scalar(name) for name in accelerations))
        requires = tuple(self._acceleration(name) for name in accelerations)
        yield ProvedFunction(self.own("grip_update"), unit, arguments, requires=requires, **more)
        yield ProvedFunction(self.own("grip_recover"), unit, (state, parameters), **more)

    def _ranges(self, sample: str, names: Iterable[str]) -> Iterator[Claim]:
        for name in names:
            yield Claim(f"{name} is in range", self.between(f"{sample}{name}", *self.law.sample_ranges[name]))

    def _acceleration(self, name: str, struct: str = "") -> Claim:
        return Claim(f"{name} is in range", self.within(f"{struct}{name}", LATERAL_ACCELERATION_MAX_M_S2))

    def _law_units(self) -> Iterator[ProvedFunction]:
        own, unit = self.own, self.own("law")
        start, step = ((own("reference_model_start"),), (own("reference_model_step"),)) if self.model else ((), ())
        angle = Claim("rear_angle is in range", self.within("rear_angle", REAR_ANGLE_MAX_RAD))
        arguments: tuple[Argument, ...] = (self.argument("self", "law_t", "new"), self.scalar("rear_angle"))
        yield ProvedFunction(own("law_init"), unit, arguments, requires=(angle,))
        arguments = (
            self.argument("self", "law_t", "state"),
            self.argument("parameters", "parameters_t", "parameter"),
            self.argument("sample", "measurement_t", "in"),
            Argument("phase", own("law_phase_t")),
            *(self.scalar(name) for name in ("friction", "rear_angle", "yaw_rate_error")),
        )
        requires = (
            *self._ranges("sample->", self.law.sample_ranges),
            self._acceleration("lateral_acceleration", "sample->"),
            Claim("inhibit is true or false", "is_flag(sample->inhibit)"),
            Claim("phase is one of its enumerators", self.is_code("phase", 2)),
            angle,
            Claim("yaw_rate_error is in range", self.within("yaw_rate_error", YAW_RATE_ERROR_MAX_RAD_S)),
        )
        ensures = (
            Claim(
                "the command moves by at most the lower of both rates", self.within_rates("result->rear_angle", "rear_angle")
            ),
            Claim("yaw_rate_reference is in range", self.within("result->yaw_rate_reference", REFERENCE_MAX_RAD_S)),
        )
        lookup = own("map_reference" if self.map.with_rear_angle else "map_yaw_rate_on_road")
        callees = (lookup, *start, *step)
        output, linked = own("law_output_t"), (own("calibration"),) if self.model else ()
        yield ProvedFunction(own("law_step"), unit, arguments, output, True, requires, ensures, callees=callees, linked=linked)
        if self.model:
            law, _, sample, _, friction, last, _ = arguments
            yield ProvedFunction(own("law_rest"), unit, (law, sample, friction, last), callees=step)

    def _controller_units(self) -> Iterator[ProvedFunction]:
        own, unit = self.own, self.own("controller")
        judges = ("inputs_parameters_valid", "limiter_parameters_valid", "map_valid")
        valid_map = self.map_holds() if self.has_plain_map else ()
        yield self.validity("parameters", "parameters_t", *valid_map, callees=tuple(own(each) for each in judges))
        grip = ("init", "friction", "update", "recover") if self.model else ()
        init = tuple(own(each) for each in ("inputs_init", "limiter_init", "law_init", *(f"grip_{name}" for name in grip[:1])))
        bound = self.within("self->rear_angle", self.controller.actuator_angle_max)
        placed = (self.argument("self", "controller_t", "state"), self.scalar("rear_angle"))
        arguments: tuple[Argument, ...] = (self.argument("self", "controller_t", "new"), self.scalar("rear_angle"))
        started = (
            Claim("|rear_angle| is at most the actuator's largest angle", bound),
            Claim("it starts from the given angle", f"self->rear_angle == {self.held_by_actuator('rear_angle')}"),
        )
        yield ProvedFunction(own("controller_init"), unit, arguments, ensures=started, callees=init)
        runs = Claim("it neither starts nor ends control", "self->enabled == self_before->enabled")
        yield ProvedFunction(own("controller_place"), unit, placed, ensures=(*started, runs), callees=(own("limiter_init"),))
        arguments = (
            self.argument("self", "controller_t", "state"),
            self.argument("parameters", "parameters_t", "parameter"),
            self.argument("measurement", "measurement_t", "in"),
        )
        yield self._stand_by(arguments[:2], init)
        inhibit = Claim("inhibit is true or false", "is_flag(measurement->inhibit)")
        model = (*(f"grip_{name}" for name in grip[1:]), "law_rest") if self.model else ()
        steps = tuple(own(each) for each in ("inputs_step", "law_step", "limiter_step", *model))
        command, ensures = own("command_t"), tuple(self._commanded())
        sound: dict[str, Any] = {"includes": True, "stand_in": "is_sound_of_lemma", "replaced": ("is_sound",)}
        sound["more"] = tuple(self._behaved())
        yield ProvedFunction(
            own("controller_step"), unit, arguments, command, True, (inhibit,), ensures, callees=(*init, *steps), **sound
        )

    def _stand_by(self, arguments: tuple[Argument, ...], callees: tuple[str, ...]) -> ProvedFunction:
        angle, before = "result->rear_angle", "self_before->rear_angle"
        ensures = (
            *self.moved(angle, before, "parameters->limiter."),
            Claim("|rear_angle| does not grow", self.shrinks(angle, before)),
            Claim("the status is standby", f"result->status == {self.upper}_STATUS_STANDBY"),
            self._kept(angle),
        )
        own, command = self.own, self.own("command_t")
        return ProvedFunction(
            own("controller_stand_by"), own("controller"), arguments, command, True, (), ensures, callees=callees
        )

    def _kept(self, angle: str) -> Claim:
        kept = f"({angle} == self->rear_angle) && (result->status == self->status)"
        return Claim("the command and the status are kept", kept)

    def _commanded(self) -> Iterator[Claim]:
        status, angle, before = f"{self.upper}_STATUS", "result->rear_angle", "self_before->rear_angle"
        yield Claim("|rear_angle| is at most rear_angle_max", self.within(angle, "parameters->rear_angle_max"))
        yield Claim("yaw_rate_reference is in range", self.within("result->yaw_rate_reference", REFERENCE_MAX_RAD_S))
        yield Claim("status is one of its enumerators", self.is_code("result->status", len(STATUSES) - 1))
        yield from self.moved(angle, before, "parameters->limiter.")
        rates = self.within_rates(angle, before)
        yield Claim(
            "tracking, it moves by at most the lower of both rates", f"(result->status != {status}_TRACKING) || {rates}"
        )
        yield Claim("without control |rear_angle| does not grow", f"self->enabled || {self.shrinks(angle, before)}")
        yield self._kept(angle)

    def _behaved(self) -> Iterator[Claim]:
        """Yield the claims on behaviour, which no caller uses."""
        angle, before = "result->rear_angle", "self_before->rear_angle"
        yield from self._status_transitions()
        yield from self._fail_safe_times()
        yield from self._returns(angle, before)
        slower, faster = (f"({before} {sign} {self.lower_step()})" for sign in "-+")
        zero = self.number(0.0)
        words = "under control, from its first sample on, it leaves zero by at most the lower of both rates"
        yield Claim(f"{words}, to the left", f"!self->enabled || ({angle} <= {faster}) || ({angle} <= {zero})")
        yield Claim(f"{words}, to the right", f"!self->enabled || ({slower} <= {angle}) || ({zero} <= {angle})")

    def _status_transitions(self) -> Iterator[Claim]:
        """Every status follows from the quality, the speed and the status before. Each status can follow each other one."""
        was, is_, quality = (
            f"self_before->status == {self.upper}_STATUS",
            f"result->status == {self.upper}_STATUS",
            "self->quality",
        )
        good, replaced, missing, unusable = (
            f"{self.upper}_QUALITY_{name}" for name in ("GOOD", "REPLACED", "MISSING", "UNUSABLE")
        )
        table = {
            "an unusable sample leads to the fail-safe, which stays while a signal is missing": f"({is_}_FAIL_SAFE)"
            f" == (({quality} == {unusable}) || (({was}_FAIL_SAFE) && ({quality} == {missing})))",
            "only a replaced or missing signal leads to degraded": f"!({is_}_DEGRADED) || ({quality} == {replaced})"
            f" || ({quality} == {missing})",
            "only a good sample is followed": f"(result->status > {self.upper}_STATUS_LIMITED) || ({quality} == {good})",
            "without control the reference is zero": f"self->enabled || (result->yaw_rate_reference == {self.number(0.0)})",
        }
        speed, starts = "self->sample.speed", "(self->sample.speed >= parameters->enable_speed)"
        drives = f"({speed} >= parameters->disable_speed)"
        table |= (
            {
                "only a speed below disable_speed, or below enable_speed before control, leads to standby": f"!({is_}_STANDBY)"
                f" || (({quality} <= {replaced}) && !{starts} && (!self_before->enabled || !{drives}))",
                "control starts at enable_speed, with a sample": "self_before->enabled || !self->enabled"
                f" || ({starts} && ({quality} <= {replaced}))",
                "control ends below disable_speed": f"!self->enabled || {drives}",
            }
            if self.law.waits_for_speed
            else {
                "only a speed that is not measured leads to standby or keeps it": f"!({is_}_STANDBY)"
                f" || ({quality} == {missing}) || !{self.is_measured('self->inputs.speed')}",
                "control starts with a sample": f"self_before->enabled || !self->enabled || ({quality} <= {replaced})",
                "control ends only in the fail-safe": f"!self_before->enabled || self->enabled || ({is_}_FAIL_SAFE)",
            }
        )
        yield from (Claim(text, condition) for text, condition in table.items())

    def _fail_safe_times(self) -> Iterator[Claim]:
        """The fail-safe ends and starts with the counts of samples that the inputs keep."""
        status, upper = f"result->status == {self.upper}_STATUS_FAIL_SAFE", self.upper
        recovered, lost = [], []
        for name in ("front_angle", "yaw_rate"):
            used, before = self.is_measured(f"self->inputs.{name}"), f"self_before->inputs.{name}"
            given = self.is_available("measurement->", name, "inputs.")
            recovered.append(f"({used} && {given} && (({before}.good + 1u) >= parameters->inputs.recovery_samples))")
            late = f"({before}.missing >= parameters->inputs.missing_samples_max)"
            lost.append(f"(!{given} && (!{self.is_measured(before)} || {late}))")
        held = f"(self_before->status != {upper}_STATUS_FAIL_SAFE) || (self_before->quality != {upper}_QUALITY_UNUSABLE)"
        words = "front angle or yaw rate is good for recovery_samples"
        yield Claim(f"the fail-safe is left only when {words}", f"{held} || ({status}) || {' || '.join(recovered)}")
        words = "front angle and yaw rate are missing for more than missing_samples_max"
        yield Claim(f"the fail-safe starts no later than when {words}", f"!({' && '.join(lost)}) || ({status})")

    def _returns(self, angle: str, before: str) -> Iterator[Claim]:
        """Yield that the angle returns to zero in the fail-safe, and in standby below a speed, at the rate of the status or of
        the limiter."""
        limiter, zero = self.step("parameters->limiter.rear_rate_max"), self.number(0.0)
        for status in ("standby", "fail_safe") if self.law.waits_for_speed else ("fail_safe",):
            step = self.step(f"parameters->{status}_rate")
            other = f"!self->limiter.speed_known || (result->status != {self.upper}_STATUS_{status.upper()})"
            for side, sign, order in (("left", "-", "{0} <= {1}"), ("right", "+", "{1} <= {0}")):
                ends = (zero, f"({before} {sign} {step})", f"({before} {sign} {limiter})")
                reached = " || ".join(f"({order.format(angle, each)})" for each in ends)
                yield Claim(f"in {status.replace('_', '-')} it returns to zero from the {side}", f"{other} || {reached}")

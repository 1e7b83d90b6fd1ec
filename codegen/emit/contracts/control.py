"""Contracts of the control law, of its model of the car, and of the controller that calls them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from codegen.configuration.signals import STATUSES
from codegen.emit.contracts.conditions import REFERENCE_MAX_RAD_S, Conditions
from codegen.emit.contracts.contract import Argument, Claim, Unit
from codegen.emit.inputs_view import FRICTION_UNKNOWN
from codegen.emit.laws import REAR_ANGLE_MAX_RAD, SAMPLE_RANGES, YAW_RATE_ERROR_MAX_RAD_S


class ControlUnits(Conditions):
    """Contracts of reference model, grip, law and controller."""

    def units(self) -> Iterator[Unit]:
        """Yield the contracts."""
        if self.model:
            yield from self._model_units()
            yield from self._grip_units()
        yield from self._law_units()
        yield from self._controller_units()

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
                "the command moves by at most the lower of both rates", self.within_rates("result->rear_angle", "rear_angle")
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
        valid_map = self.map_holds() if self.has_plain_map else ()
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
        yield from self.moved(angle, before, "parameters->limiter.")
        rates = self.within_rates(angle, before)
        yield Claim(
            "tracking, it moves by at most the lower of both rates", f"(result->status != {status}_TRACKING) || {rates}"
        )
        shrinks = f"(magnitude_of({angle}) <= magnitude_of({before}))"
        yield Claim("in fail-safe |rear_angle| does not grow", f"(result->status != {status}_FAIL_SAFE) || {shrinks}")
        yield Claim("the command and the status are kept", f"({angle} == self->rear_angle) && (result->status == self->status)")

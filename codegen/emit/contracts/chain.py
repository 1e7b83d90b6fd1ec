"""Contracts at both ends of the chain: the checks of the inputs and the safety limiter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from codegen.emit.contracts.conditions import SIGNALS_CHECKED, Conditions
from codegen.emit.contracts.contract import Argument, Claim, ProvedFunction
from codegen.emit.laws import REAR_ANGLE_MAX_RAD


class ChainUnits(Conditions):
    """Contracts of limiter and inputs."""

    def units(self) -> Iterator[ProvedFunction]:
        """Yield the contracts."""
        yield from self._limiter_units()
        yield from self._inputs_units()

    def _limiter_units(self) -> Iterator[ProvedFunction]:
        own, unit, zero, one = self.own, self.own("limiter"), self.number(0.0), self.number(1.0)
        yield self.validity("limiter", "limiter_parameters_t")
        state = self.argument("self", "limiter_t", "new")
        started = f"self->rear_angle == ({self.within('rear_angle', one)} ? rear_angle : {zero})"
        yield ProvedFunction(
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
        step = ProvedFunction(
            own("limiter_step"), unit, arguments, self.real, ensures=tuple(self._limited()), facts=facts, includes=True
        )
        *bounds, passes = self._bounded_over_speed()
        bound = f"lies_between(opposite_phase_bound(&parameters, {speed}), {zero}, {largest} + {one})"
        bounds.append(Claim("the bound is not negative, and close to rear_angle_max at most", bound))
        yield replace(step, more=tuple(bounds))
        alone: dict[str, Any] = {"stand_in": "magnitude_of_lemma", "replaced": ("magnitude",)}
        yield replace(step, facts=(), more=(passes,), part="_demand", **alone)
        yield self._mirrored(step)

    def _mirrored(self, step: ProvedFunction) -> ProvedFunction:
        """Return the harness that a limiter with all angles mirrored gives the mirrored result."""
        signs = {"mirrored": ("self", "rear_angle", "front_angle"), "other": ("input", "demand", "front_angle")}
        odd = ((copy, original, name) for copy, (original, *names) in signs.items() for name in names)
        before = (
            f"{self.own('limiter_t')} mirrored = self;",
            f"{self.own('limiter_input_t')} other = input;",
            *(f"{copy}.{name} = -{original}.{name};" for copy, original, name in odd),
        )
        *_, in_phase = step.facts
        facts = (f"const {self.real} mirrored_result = {step.function}(&mirrored, &parameters, &other);", in_phase)
        mirrored = Claim("the mirrored angles give the mirrored result", "are_mirrored(result, mirrored_result)")
        alone: dict[str, Any] = {"stand_in": "bound_of_lemma", "replaced": ("magnitude", "opposite_phase_bound")}
        return replace(step, part="_mirrored", before=before, facts=facts, more=(mirrored,), only_claims=True, **alone)

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
        yield Claim("the result equals the demand if all bounds allow it", demanded)

    def _limited(self) -> Iterator[Claim]:
        before, zero = "self_before->rear_angle", self.number(0.0)
        yield Claim("|rear angle| is at most rear_angle_max", self.within("result", "parameters->rear_angle_max"))
        yield Claim("the result is kept", "result == self->rear_angle")
        yield from self.moved("result", before, "parameters->")
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
        yield from self._follows("result", before, "input->demand", "parameters->")
        inside = self.within(before, "parameters->rear_angle_max")
        yield Claim("it is held as long as no speed is known", f"self->speed_known || !{inside} || (result == {before})")

    def _follows(self, angle: str, before: str, demand: str, limiter: str) -> Iterator[Claim]:
        """A demand toward zero is reached, as fast as the rate limit lets it."""
        step, zero, known = self.step(f"{limiter}rear_rate_max"), self.number(0.0), "!self->speed_known"
        falls = " || ".join(f"({angle} <= {each})" for each in (demand, zero, f"({before} - {step})"))
        rises = " || ".join(f"({each} <= {angle})" for each in (demand, zero, f"({before} + {step})"))
        words = "follows a demand toward zero as fast as rear_rate_max lets it"
        yield Claim(f"from the left, it {words}", f"{known} || ({demand} != {demand}) || {falls}")
        yield Claim(f"from the right, it {words}", f"{known} || ({demand} != {demand}) || {rises}")

    def _inputs_units(self) -> Iterator[ProvedFunction]:
        unit = self.own("inputs")
        yield self.validity("inputs", "inputs_parameters_t")
        trusted = Argument("is_trusted", "bool")
        yield ProvedFunction(self.own("inputs_init"), unit, (self.argument("self", "inputs_t", "new"), trusted))
        arguments = (
            self.argument("self", "inputs_t", "state"),
            self.argument("parameters", "inputs_parameters_t", "parameter"),
            self.argument("measured", "measurement_t", "in"),
            self.scalar("rear_angle"),
            *((self.argument("model", "reference_model_t", "parameter"),) if self.model else ()),
            self.argument("checked", "measurement_t", "out"),
        )
        requires = (
            Claim("inhibit is true or false", "is_flag(measured->inhibit)"),
            Claim("rear_angle is within its range", self.within("rear_angle", REAR_ANGLE_MAX_RAD)),
        )
        ensures = (*self.checked_sample("checked->"), *self._judged(), *self._signals_counted())
        yield ProvedFunction(
            self.own("inputs_step"), unit, arguments, self.own("quality_t"), requires=requires, ensures=ensures
        )

    def _judged(self) -> Iterator[Claim]:
        """Quality of the sample, by the sources of its signals."""
        quality = f"{self.upper}_QUALITY"
        used = {name: self.is_measured(f"self->{name}") for name in SIGNALS_CHECKED}
        unusable = f"!{used['front_angle']} && !{used['yaw_rate']}"
        missing = " || ".join(f"(self->{name}.missing > 0u)" for name in used)
        yield Claim("the quality is one of its enumerators", self.is_code("result", 3))
        yield Claim(
            "the sample is unusable if neither front angle nor yaw rate is used",
            f"(result == {quality}_UNUSABLE) == ({unusable})",
        )
        yield Claim("a good sample has all signals", f"(result != {quality}_GOOD) || ({' && '.join(used.values())})")
        replaced = " || ".join(f"!{each}" for each in used.values())
        yield Claim("a signal of a replaced sample is not used", f"(result != {quality}_REPLACED) || {replaced}")
        yield Claim("a signal of a missing sample is missing", f"(result != {quality}_MISSING) || {missing}")

    def _signals_counted(self) -> Iterator[Claim]:
        """Counts of good and missing samples, which decide when a signal is used."""
        for name in SIGNALS_CHECKED:
            before, after = f"self_before->{name}", f"self->{name}"
            was, used, available = self.is_measured(before), self.is_measured(after), self.is_available("measured->", name, "")
            back = f"({available} && (({before}.good + 1u) >= parameters->recovery_samples))"
            counted = f"({after}.good == 0u) || ({available} && ({after}.good == ({before}.good + 1u)))"
            missed = f"({after}.missing == ({before}.missing + 1u))"
            kept = f"(!{used} || ({after}.missing <= parameters->missing_samples_max))"
            lost = f"({before}.source == {self.upper}_SIGNAL_LOST)"
            counted += f" || ({lost} && (({after}.good + 1u) == {before}.good))"
            words = "is used again only after recovery_samples good ones, less missing ones"
            yield Claim(f"{name} {words}", f"{was} || !{used} || {back}")
            words = "its count of good samples starts anew, or falls by one if it was lost"
            yield Claim(f"without {name}, {words}", f"{was} || {used} || {counted}")
            yield Claim(f"{name} that is no longer used has no good sample", f"!{was} || {used} || ({after}.good == 0u)")
            yield Claim(
                f"{name} is not used after missing_samples_max missing ones", f"!{was} || {available} || ({missed} && {kept})"
            )

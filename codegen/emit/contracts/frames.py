"""Contracts of the frames: E2E protection, packing, and the task that receives and sends them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from codegen.configuration.can import RealSignal
from codegen.configuration.signals import Status
from codegen.emit.can_view import Frame
from codegen.emit.contracts.conditions import Conditions
from codegen.emit.contracts.contract import Argument, Claim, ProvedFunction
from codegen.emit.supervision import STATES, Cause, Reaction, State, next_state

_ANGLE, _BEFORE = "self->controller.rear_angle", "self_before->controller.rear_angle"
_WHEELS = "(self->conditions.rear_angle - self->angle_offset)"
_MEASURED, _LIMITER = "self->conditions.rear_angle", "self->parameters->limiter."
_ENABLED = "self->controller.enabled"


class FrameUnits(Conditions):
    """Contracts of E2E protection, CAN and task."""

    def units(self) -> Iterator[ProvedFunction]:
        """Yield the contracts. The longest loop may be that over the bytes of a frame."""
        for unit in (*self._e2e_units(), *self._can_units(), *self._supervision_units(), *self._task_units()):
            yield replace(unit, unwind=max(unit.unwind, self.can.frame_bytes + 1))

    def _e2e_units(self) -> Iterator[ProvedFunction]:
        own, unit = self.own, self.own("e2e")
        identifier, data = Argument("data_id", "uint16_t"), self.frame("bytes in")
        new, state = (self.argument("self", "e2e_receiver_t", role) for role in ("new", "state"))
        status = own("e2e_status_t")
        yield ProvedFunction(own("e2e_receiver_init"), unit, (new,))
        code = Claim("the result is one of its enumerators", self.is_code("result", 7))
        yield ProvedFunction(own("e2e_check"), unit, (state, identifier, data), status, ensures=(code, *self._checked()))
        none = Claim("it returns NO_NEW_DATA", f"result == {self.upper}_E2E_NO_NEW_DATA")
        silent = Claim("the accepted advance of the counter grows by one", f"self->max_delta_counter == {self._advance}")
        grows = (silent,) if self.can.profile.has_synchronisation else ()
        yield ProvedFunction(own("e2e_no_new_data"), unit, (state,), status, ensures=(none, *grows))
        arguments = (identifier, Argument("counter", "uint8_t", "state"), self.frame("bytes out"))
        sent = (
            Claim(f"the counter for the next frame is at most {self.counter_max}", f"*counter <= {self.counter_max}u"),
            Claim("the frame carries the counter", f"{self.received_counter} == {self._of_four_bits('*counter_before')}"),
            Claim("the frame has the right CRC", f"{own('e2e_crc')}(data_id, data) == {self.can.e2e.received_crc}"),
            *self._nibble(),
        )
        yield ProvedFunction(own("e2e_protect"), unit, arguments, ensures=sent)
        new, state = (self.argument("self", "e2e_supervision_t", role) for role in ("new", "state"))
        yield ProvedFunction(own("e2e_supervision_init"), unit, (new,))
        arguments = (state, Argument("is_good", "bool"), Argument("is_damaged", "bool"))
        kept = Claim("the result is kept", "result == self->state")
        yield ProvedFunction(own("e2e_supervise"), unit, arguments, own("e2e_state_t"), ensures=(kept, *self._supervised()))

    def _checked(self) -> Iterator[Claim]:
        """Yield the result of a check as AUTOSAR's profile states it, by the advance of the counter."""
        can, result, counter, span = self.can, f"result == {self.upper}_E2E", self.received_counter, self.counter_max + 1
        wrong = [f"({self.own('e2e_crc')}(data_id, data) != {can.e2e.received_crc})"]
        wrong += [f"({counter} == {span}u)"] if can.profile.has_invalid_counter else []
        wrong += ["((data[1] / 16u) != (data_id / 256u))"] if can.profile.nibble_bits else []
        damaged = f"({' || '.join(wrong)})" if len(wrong) > 1 else wrong[0]
        counted = f"(!{damaged} && !self_before->waits_for_first)"
        advance = f"(({counter} + {span}u - self_before->last_counter) % {span}u)"
        intact = {
            "a wrong CRC is found": f"({result}_WRONG_CRC) == {damaged}",
            "only the first intact frame may have any counter": f"({result}_INITIAL)"
            f" == (!{damaged} && self_before->waits_for_first)",
            "the first intact frame ends the wait for it": "self->waits_for_first"
            f" == (({result}_WRONG_CRC) && self_before->waits_for_first)",
            "a repeated counter is found": f"({result}_REPEATED) == ({counted} && ({advance} == 0u))",
        }
        if not can.profile.has_synchronisation:
            most = f"({advance} <= {can.settings.max_delta_counter}u)"
            table = intact | {
                "a counter beyond the window is found": f"({result}_WRONG_SEQUENCE) == ({counted} && !{most})",
                "a frame is accepted if its counter advances by one": f"({result}_OK) == ({counted} && ({advance} == 1u))",
                "after lost frames, one is accepted within the window only": f"({result}_OK_SOME_LOST)"
                f" == ({counted} && ({advance} > 1u) && {most})",
                "the last counter is that of the last intact frame": "self->last_counter"
                f" == ({damaged} ? self_before->last_counter : {counter})",
            }
            yield from (Claim(text, condition) for text, condition in table.items())
            return
        within = f"({advance} <= {self._advance})"
        silence = f"(self_before->no_new_or_repeated_data_counter > {self.can.settings.max_no_new_or_repeated_data}u)"
        in_sequence = f"({counted} && !{silence} && (self_before->sync_counter == 0u))"
        old = f"(({result}_WRONG_CRC) || ({result}_REPEATED))"
        renewed = f"(self->sync_counter == {self.can.settings.sync_counter_init}u)"
        table = intact | {
            "a counter beyond the window is found": f"({result}_WRONG_SEQUENCE)"
            f" == ({counted} && ({advance} > 0u) && !{within})",
            "a frame is accepted if its counter advances by one": f"({result}_OK)"
            f" == ({in_sequence} && ({advance} == 1u) && {within})",
            "after lost frames, one is accepted within the window only": f"({result}_OK_SOME_LOST)"
            f" == ({in_sequence} && ({advance} > 1u) && {within})",
            "the window grows until a new frame": "self->max_delta_counter"
            f" == ({old} ? {self._advance} : {self.can.settings.max_delta_counter_init}u)",
            "the last counter is that of the last new frame": "self->last_counter"
            f" == ({old} ? self_before->last_counter : {counter})",
            "after a jump, frames must be in sequence": f"!({result}_WRONG_SEQUENCE) || {renewed}",
        }
        yield from (Claim(text, condition) for text, condition in table.items())

    @property
    def _advance(self) -> str:
        """Largest accepted advance of the counter in a cycle."""
        before = "self_before->max_delta_counter"
        return f"(({before} < {self.counter_max}u) ? ({before} + 1u) : {self.counter_max}u)"

    def _of_four_bits(self, counter: str) -> str:
        """Return a counter of which the frame carries four bits; one of a byte is unchanged."""
        return f"({counter} & 0x0Fu)" if self.can.profile.counter_length == 4 else counter

    def _nibble(self) -> Iterator[Claim]:
        if self.can.profile.nibble_bits:
            yield Claim("the frame carries four bits of the data id", "(data[1] / 16u) == ((data_id / 256u) % 16u)")

    def _supervised(self) -> Iterator[Claim]:
        """Yield the transitions of AUTOSAR's E2E state machine, with the cycles of the window counted bit by bit."""
        state, can, size = f"{self.upper}_E2E_STATE", self.can, self.can.settings.window_size
        was, is_, mask = f"self_before->state == {state}", f"self->state == {state}", f"0x{(1 << size) - 1:X}u"
        good, damaged = (" + ".join(f"((self->window >> {first + k}u) & 1u)" for k in range(size)) for first in (0, 16))
        started = f"({was}_NO_DATA)"
        first_state = f"(self->state == (is_good ? {state}_INIT : {state}_NO_DATA))"
        yield Claim("the first good frame ends NO_DATA", f"!{started} || {first_state}")
        yield Claim("NO_DATA does not return", f"{started} || !({is_}_NO_DATA)")
        for words, first in (("good", 0), ("damaged", 16)):
            moved = f"((((self_before->window >> {first}u) << 1u) | (is_{words} ? 1u : 0u)) & {mask})"
            kept = f"(((self->window >> {first}u) & {mask}) == {moved})"
            yield Claim(f"the window has the last {words} cycles", f"{started} || {kept}")
        for name in ("INIT", "VALID", "INVALID"):
            least, most = (getattr(can.settings, f"{each}_state_{name.lower()}") for each in ("min_ok", "max_error"))
            few, enough = f"(({damaged}) <= {most}u)", f"(({good}) >= {least}u)"
            decided = f"(({is_}_VALID) == ({enough} && {few}))"
            yield Claim(f"from {name}, the thresholds decide on VALID", f"!({was}_{name}) || {decided}")
            stays = f"(({is_}_INIT) == ({few} && !{enough}))" if name == "INIT" else f"!({is_}_INIT)"
            words = "INIT stays until there are enough good or too many damaged cycles"
            words = words if name == "INIT" else f"from {name}, INIT does not return"
            yield Claim(words, f"!({was}_{name}) || {stays}")

    def _can_units(self) -> Iterator[ProvedFunction]:
        unit = self.own("can")
        absent = Claim("it is NaN", "result != result")
        yield ProvedFunction(self.own("can_not_available"), unit, (), self.real, ensures=(absent,))
        for frame in self.can.messages:
            signals, ensures = f"{frame.role}_t", self.signals_in_range(frame, "signals->")
            data = self.frame("bytes in")
            out = self.argument("signals", signals, "out")
            yield ProvedFunction(self.own(f"can_unpack_{frame.role}"), unit, (data, out), ensures=tuple(ensures))
            arguments = (self.argument("signals", signals, "in"), self.frame("bytes out"))
            received = (f"{self.own(signals)} unpacked;", f"{self.own(f'can_unpack_{frame.role}')}(data, &unpacked);")
            more: dict[str, Any] = {"facts": received, "more": tuple(self._packed(frame)), "includes": True, "unwind": 26}
            more |= {"stand_in": "to_code_of_lemma", "replaced": ("to_code",)}
            pack = ProvedFunction(self.own(f"can_pack_{frame.role}"), unit, arguments, conversions=False, **more)
            yield pack
            # Code that reads the bytes of a number is right for one byte order only. A program of goto-cc has that of the host.
            yield replace(pack, part="_big_endian", big_endian=True, stand_in="", replaced=())

    def _packed(self, frame: Frame) -> Iterator[Claim]:
        """Yield for each signal that its code is in its bits of the frame, and that the receiver gets its value."""
        codes: dict[str, str] = {}
        for signal in frame.reals:
            layout = signal.layout
            assert isinstance(layout, RealSignal)
            limits = f"{layout.raw_low}, {layout.raw_high}, {layout.raw_not_available}"
            codes[signal.definition.role] = f"to_code({signal.value}, {signal.scale}, {limits})"
        for signal in frame.signals:
            role, layout, mask = signal.definition.role, signal.layout, f"0x{signal.mask:X}u"
            place = f"code_in(data, {layout.start_bit}u, {layout.length}u, {str(signal.byte_order == 'motorola').lower()})"
            received = ""
            if isinstance(layout, RealSignal):
                value = f"((({self.real}){codes[role]} {self.can.value_operator} {signal.scale}){signal.offset})"
                code = f"((uint32_t){codes[role]} & {mask})"
                absent = f"({codes[role]} == {layout.raw_not_available})"
                received = f"{absent} ? (unpacked.{role} != unpacked.{role}) : (unpacked.{role} == {value})"
            elif role == "qualifier":
                present = (
                    f"(({codes[each.definition.role]} != {each.layout.raw_not_available}) ? {each.qualifier_bit}u : 0u)"
                    for each in frame.reals
                    if isinstance(each.layout, RealSignal)
                )
                code = f"({' | '.join(present)})"
            elif signal.field_type == "bool":
                code = f"(signals.{role} ? 1u : 0u)"
                received = f"(unpacked.{role} ? 1u : 0u) == {code}"
            else:
                code = f"((uint32_t)signals.{role} & {mask})"
                received = f"(uint32_t)unpacked.{role} == {code}"
            yield Claim(f"the code of {role} is in its bits of the frame", f"{place} == {code}")
            if received:
                yield Claim(f"{role} is received as its code says", received)

    def _supervision_units(self) -> Iterator[ProvedFunction]:
        own, unit, upper = self.own, self.own("supervision"), self.upper
        new, state = (self.argument("self", "supervision_t", role) for role in ("new", "state"))
        cause, status = Argument("cause", own("supervision_cause_t")), Argument("status", own("status_t"))
        codes = (
            Claim("cause is one of its enumerators", self.is_code("cause", len(Cause) - 1)),
            Claim("status is one of its enumerators", self.is_code("status", len(Status) - 1)),
        )
        starts = Claim("it starts without a rear angle", f"self->state == {upper}_SUPERVISION_{State.START.name}")
        yield ProvedFunction(own("supervision_init"), unit, (new,), ensures=(starts,))
        arguments = (state, cause, status)
        step = own("supervision_step")
        yield ProvedFunction(step, unit, arguments, own("status_t"), requires=codes, ensures=tuple(self._transitions()))

    def _transitions(self) -> Iterator[Claim]:
        """Yield the table of the supervision: the next state for each state and cause, and the status of each state."""
        upper = self.upper
        for state in State:
            was = f"(self_before->state == {upper}_SUPERVISION_{state.name})"
            for cause in Cause:
                follows = f"(self->state == {upper}_SUPERVISION_{next_state(state, cause).name})"
                claim = f"!({was} && (cause == {upper}_CAUSE_{cause.name})) || {follows}"
                yield Claim(f"from {state.name}, {cause.name} leads to {next_state(state, cause).name}", claim)
        limited = f"((status == {upper}_STATUS_LIMITED) ? status : {upper}_STATUS_TRACKING)"
        for state, row in STATES.items():
            sent = limited if row.status is Status.TRACKING else f"{upper}_STATUS_{row.status.name}"
            claim = f"(self->state != {upper}_SUPERVISION_{state.name}) || (result == {sent})"
            yield Claim(f"in {state.name} the status is {row.status.name}", claim)
        yield Claim("cause and status are kept", "(self->cause == cause) && (self->status == result)")

    def _task_units(self) -> Iterator[ProvedFunction]:
        own, unit, init = self.own, self.own("task"), self.own("controller_init")
        new, state = (self.argument("self", "task_t", role) for role in ("new", "state"))
        kept = Claim("the parameters are those given", "self->parameters == parameters")
        frames = (own("e2e"), own("can"), own("supervision"))
        more: dict[str, Any] = {"linked": frames, "conversions": False}
        parameters = self.argument("parameters", "parameters_t", "parameter")
        yield ProvedFunction(own("task_init"), unit, (new, parameters), ensures=(kept,), callees=(init,), **more)
        more["before"] = (
            f"{own('parameters_t')} parameters;",
            "self.parameters = &parameters;",
            f"CONTRACT_ASSUME({own('parameters_holds')}(&parameters));",
        )
        more["callees"] = (init, own("controller_place"), own("controller_stand_by"), own("controller_step"))
        data, length = self.frame("bytes in"), Argument("length", "uint8_t")
        last = f"(id != (uint32_t){self.upper}_CAN_ID_VEHICLE_CONDITIONS)"
        closes = "self->conditions_close == (self_before->motion_input.frames > 0u)"
        complete = Claim("the set is complete after the conditions of a cycle with the motion", f"{last} || ({closes})")
        arguments = (state, Argument("id", "uint32_t"), data, length)
        received = (complete, *self._counted_frames())
        yield ProvedFunction(own("task_on_can_frame"), unit, arguments, ensures=received, **more)
        identifier = f"result == (uint32_t){self.upper}_CAN_ID_REAR_STEER_COMMAND"
        crc = f"{own('e2e_crc')}((uint16_t){self.upper}_CAN_DATA_ID_REAR_STEER_COMMAND, data) == {self.can.e2e.received_crc}"
        before = "(uint32_t)self_before->counter"
        counted = f"({self.received_counter} == {before}) && (self->counter == (({before} + 1u) % {self.counter_max + 1}u))"
        sent = (
            Claim("it is the frame of the command", identifier),
            Claim("the frame has the counter, and the counter advances", counted),
            Claim("the frame has the right CRC", crc),
            *self._next_cycle(),
            *self._held(),
        )
        more["unwind"] = 26  # the bits of a signal are read one by one
        cycle = ProvedFunction(
            own(self.task.function), unit, (state, self.frame("bytes out")), "uint32_t", ensures=sent, **more
        )
        yield cycle
        released, runs_on = (f"CONTRACT_ASSUME({case});" for case in ("self.released", "!self.released"))
        no_offset = f"(self->angle_offset == {self.number(0.0)})"
        parts: dict[str, tuple[Iterator[Claim], *tuple[str, ...]]] = {
            "_started": (self._started_command(),),
            "_moved": (self._moved_command(),),
            # The solver needs minutes for these cases at once.
            "_released": (self._reached_command("in the sample after control ended", f"!{no_offset}"), released),
            "_released_apart": (
                self._reached_command("in the sample after control ended, from wheels apart,", no_offset),
                released,
            ),
            "_returned": (self._reached_command("when the conditions return", f"!{self._returns} || !{_ENABLED}"), runs_on),
            "_uncontrolled": (self._reached_command("without control", _ENABLED), runs_on),
            "_held": (self._near_wheels(),),
        }
        for part, (claims, *case) in parts.items():
            local = (replace(each, condition=each.condition.replace("self->parameters->", "parameters->")) for each in claims)
            yield replace(cycle, part=part, before=(*cycle.before, *case), more=tuple(local), only_claims=True)

    def _counted_frames(self) -> Iterator[Claim]:
        """Yield that each frame of a message counts, whatever its length and content, and no other frame."""
        for name in ("motion", "conditions"):
            before = f"(uint32_t)self_before->{name}_input.frames"
            counted = f"(({before} < UINT8_MAX) ? ({before} + 1u) : UINT8_MAX)"
            is_own = f"(id == (uint32_t){self.upper}_CAN_ID_VEHICLE_{name.upper()})"
            claim = f"(uint32_t)self->{name}_input.frames == ({is_own} ? {counted} : {before})"
            yield Claim(f"a frame of the {name} counts, whatever its length and content", claim)

    def _next_cycle(self) -> Iterator[Claim]:
        """Yield that a call begins a new cycle."""
        none = "(self->motion_input.frames == 0u) && (self->conditions_input.frames == 0u)"
        yield Claim("the next cycle begins without frames", none)
        yield Claim("the next cycle begins with an incomplete set", "!self->conditions_close")

    def _held(self) -> Iterator[Claim]:
        """Yield that Inhibit acts over lost frames while the conditions are valid, and is unknown while they are not."""
        valid = f"(self->conditions_input.supervision.state == {self.upper}_E2E_STATE_VALID)"
        cause = f"(uint32_t)self->supervision.cause <= (uint32_t){self.upper}_CAUSE"
        inhibited = f"!{valid} || !self->conditions.inhibit || ({cause}_{Cause.INHIBIT.name})"
        yield Claim("Inhibit acts until the car ends it, over single lost frames too", inhibited)
        unknown = f"{valid} || ({cause}_{Cause.CONDITIONS_UNKNOWN.name})"
        yield Claim("without valid conditions it is unknown whether the car sets Inhibit", unknown)

    def _is_in(self, place: str, states: Iterable[State]) -> str:
        """Return the condition that the supervision is in one of some states."""
        each = (f"({place}->supervision.state == {self.upper}_SUPERVISION_{state.name})" for state in states)
        return f"({' || '.join(each)})"

    @property
    def _restarts(self) -> str:
        """Condition that the rear angle is unknown: at the start and after a silence."""
        silent = [each for each, row in STATES.items() if not row.has_command]
        is_long = "(self_before->silent_calls > self->parameters->inputs.missing_samples_max)"
        inputs = [f"self_before->{name}_input." for name in ("motion", "conditions")]
        heard = f"({' || '.join(f'({each}advance > 0u) || {each}out_of_sequence' for each in inputs)})"
        return f"({self._is_in('self_before', silent)} || ({is_long} && {heard} && self_before->has_measured))"

    def _rated(self, place: str, start: str) -> Iterator[tuple[str, str]]:
        """Yield the rate limit from a start angle, upwards and downwards, in words and as a condition.

        The condition contains two weaker alternatives, no step and a smaller step: with them the solver need not order sums.
        """
        for (order, sign), claim in zip((("<=", "+"), (">=", "-")), self.moved(_ANGLE, start, _LIMITER), strict=True):
            smaller = f"({_ANGLE} {order} ({start} {sign} {self._returning()}))"
            yield f"{place} {claim.text}", f"({claim.condition}) || ({_ANGLE} {order} {start}) || {smaller}"

    def _started_command(self) -> Iterator[Claim]:
        """Yield from where the command starts while the rear angle is not known, and that it is not sent before."""
        waits = f"!{self._restarts} || !self->supervision.has_command"
        for words, condition in self._rated("from the start angle,", "self->expected_angle"):
            yield Claim(words, f"{waits} || {condition}")
        placed = f"(self->expected_angle == {self.held_by_actuator('self->measured_angle')})"
        yield Claim(
            "the start angle is the measured one, or the last measured one", f"{waits} || !self->has_measured || {placed}"
        )
        frame = next(each for each in self.can.messages if each.role == "rear_steer_command")
        signal = next(each for each in frame.reals if each.definition.role == "rear_angle")
        assert isinstance(signal.layout, RealSignal)
        bits = f"{signal.layout.start_bit}u, {signal.layout.length}u, {str(signal.byte_order == 'motorola').lower()}"
        absent = f"(code_in(data, {bits}) == ((uint32_t){signal.layout.raw_not_available} & 0x{signal.mask:X}u))"
        yield Claim("without a known rear angle the frame has no command", f"self->supervision.has_command || {absent}")

    @property
    def _known(self) -> str:
        """Condition that the rear angle is measured in this sample."""
        plausible = f"(magnitude_of({_MEASURED}) <= self->parameters->inputs.rear_angle_max)"
        return f"(self->conditions_input.usable && self->has_measured && {plausible})"

    @property
    def _returns(self) -> str:
        """Condition that the conditions are received again after a loss."""
        valid = f"{self.upper}_E2E_STATE_VALID"
        return f"(self->conditions_input.usable && (self_before->conditions_input.supervision.state != {valid}))"

    def _moved_command(self) -> Iterator[Claim]:
        """Yield how far the command moves in a sample with control, and that without control it moves toward zero."""
        restarts, returns = self._restarts, self._returns
        released = f"({self._known} && (!{_ENABLED} || self_before->released))"
        for words, rated in self._rated("under control, from sample to sample,", _BEFORE):
            yield Claim(words, f"{restarts} || {returns} || {released} || {rated}")
        rests = [each for each, row in STATES.items() if row.reaction in (Reaction.RAMP, Reaction.REST)]
        words = "without control the magnitude of the command does not grow beyond that of the start angle"
        shrinks = f"{self.shrinks(_ANGLE, _BEFORE)} || {self.shrinks(_ANGLE, 'self->start_angle')}"
        yield Claim(words, f"{restarts} || !{self._is_in('self', rests)} || {shrinks}")

    def _reached_command(self, case: str, others: str = "") -> Iterator[Claim]:
        """Yield that in one case the command moves within the rate limit, or to the wheels at most. others: the other cases."""
        held = self.held_by_actuator(_MEASURED)
        ways = zip(("<=", ">="), self._rated(f"{case}, to the wheels at most or", _BEFORE), strict=True)
        for (order, (words, rated)), from_wheels in zip(ways, self.moved(_ANGLE, held, _LIMITER), strict=True):
            reached = (
                f"({self._known} && (({_ANGLE} {order} {held}) || ({_ANGLE} {order} {_WHEELS}) || {from_wheels.condition}))"
            )
            yield Claim(words, " || ".join(each for each in (self._restarts, others, rated, reached) if each))

    def _near_wheels(self) -> Iterator[Claim]:
        """Yield that the command stays near wheels which it does not move; the code's own expressions make it exact."""
        unknown, zero = f"{self._restarts} || !{self._known}", self.number(0.0)
        sides = (f"(({_WHEELS} {order} {zero}) && ({_BEFORE} {order} {zero}))" for order in "><")
        ahead = f"(({' || '.join(sides)}) && (magnitude_of({_WHEELS}) > magnitude_of({_ANGLE})))"
        is_due = "(self->waited_samples > self_before->waited_samples)"
        waits = f"!(!{_ENABLED} && self->deviates && {is_due} && {ahead})"
        held = f"(magnitude_of({_ANGLE}) >= magnitude_of({_BEFORE})) || ({self.shrinks('self->start_angle', _ANGLE)})"
        yield Claim("a return to zero waits for wheels that do not follow", f"{unknown} || {waits} || {held}")
        for words, order in (("left", ">"), ("right", "<")):
            out = " && ".join(f"({_ANGLE} {order} {each})" for each in (zero, _BEFORE, _MEASURED))
            claim = f"{unknown} || !{_ENABLED} || !(self->deviates || self->is_stuck) || !({out})"
            yield Claim(f"wheels that do not follow get no command farther out to the {words} than it was or they are", claim)

    def _returning(self) -> str:
        """Return the largest change in a sample at the lower one of two rates."""
        own, most = (self.step(f"self->parameters->{each}") for each in ("fail_safe_rate", "limiter.rear_rate_max"))
        return f"(({own} < {most}) ? {own} : {most})"

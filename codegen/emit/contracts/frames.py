"""Contracts of the frames: E2E protection, packing, and the task that receives and sends them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from codegen.emit.contracts.conditions import E2E_COUNTER_MAX, Conditions
from codegen.emit.contracts.contract import Argument, Claim, Unit


class FrameUnits(Conditions):
    """Contracts of E2E protection, CAN and task."""

    def units(self) -> Iterator[Unit]:
        """Yield the contracts."""
        yield from self._e2e_units()
        yield from self._can_units()
        yield from self._task_units()

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
            signals, ensures = f"{frame.role}_t", self.signals_in_range(frame, "signals->")
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

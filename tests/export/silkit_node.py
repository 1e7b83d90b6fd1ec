"""An FMU with a CAN bus as a participant of SIL Kit: `python silkit_node.py FMU_FOLDER NAME URI STOP_NS`.

It makes the calls of the SIL Kit FMU Importer in the same order, with received frames set before a step and not in an event.
Reads the inputs of each millisecond as JSON from standard input and writes the frames sent, with their times in ns, to standard
output. It imports only fmpy and SilKit_py, which need not be those of this project's environment.
"""

from __future__ import annotations

import asyncio
import json
import struct
import sys
from typing import Any

import fmpy
import SilKit_py as silkit
from fmpy.fmi3 import FMU3Slave

STEP_NS = 1_000_000
NETWORK = "CanChannel"
TRANSMIT, HEADER, FRAME = 0x10, struct.Struct("<II"), struct.Struct("<IIIBBH")
"""Operation CAN Transmit of FMI-LS-BUS; header of all operations; header of that operation."""


class Participant:
    """One FMU on the bus, and its frames."""

    def __init__(self, folder: str, name: str, inputs: list[dict[str, float]], stop_ns: int) -> None:
        description = fmpy.read_model_description(folder)
        self.name, self.inputs, self.stop_ns = name, inputs, stop_ns
        self.number = {each.name: each for each in description.modelVariables}
        self.clocks = {side: [self.number[f"CanChannel.{side}_Clock"].valueReference] for side in ("Rx", "Tx")}
        self.data = {side: [self.number[f"CanChannel.{side}_Data"].valueReference] for side in ("Rx", "Tx")}
        identifier = description.coSimulation.modelIdentifier
        token = description.instantiationToken
        self.fmu = FMU3Slave(unzipDirectory=folder, modelIdentifier=identifier, instanceName=name, guid=token)
        self.messages: list[str] = []
        self.fmu.instantiate(
            loggingOn=True, eventModeUsed=True, logMessage=lambda *given: self.messages.append(given[-1].decode())
        )
        self.set_inputs(0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.last: int | None = None  # ns, time of the last step
        self.received: list[tuple[int, int, bytes]] = []
        self.sent: list[tuple[int, int, str]] = []

    def run(self, uri: str) -> None:
        """Simulate until the first participant stops."""
        participant = silkit.create_participant(silkit.participant_configuration_from_String("{}"), self.name, uri)
        self.lifecycle = participant.create_lifecycle_service(silkit.LifecycleConfiguration(silkit.OperationMode.Coordinated))
        self.can = participant.create_can_controller(NETWORK, NETWORK)
        self.can.add_frame_handler(self.on_frame, silkit.TransmitDirection.RX)
        self.lifecycle.set_communication_ready_handler(self.can.start)
        self.lifecycle.create_time_sync_service().set_simulation_step_handler(self.on_step, STEP_NS)

        async def finish() -> None:
            await self.lifecycle.start_lifecycle()

        asyncio.run(finish())

    def on_frame(self, _: Any, event: Any) -> None:
        self.received.append((event.timestamp, event.frame.can_id, bytes(event.frame.data)))

    def on_step(self, now: int, duration: int) -> None:
        """Advance from the last step to `now` (ns)."""
        try:
            self.step(now, duration)
        except Exception as error:
            print(f"{self.name} at {now} ns: {error}; {self.messages[-1:]}", file=sys.stderr)
            self.lifecycle.stop("error")
        if now >= self.stop_ns:
            self.lifecycle.stop("end")

    def step(self, now: int, duration: int) -> None:
        if self.last is None:  # the first event, after the initialization
            self.last = now
            self.event(now)
            return
        self.set_inputs(self.last)
        self.apply_frames()
        self.last = now
        needs_event, *_ = self.fmu.doStep((now - duration) * 1e-9, duration * 1e-9)
        if needs_event:
            self.fmu.enterEventMode()
            self.set_inputs(now)
            self.event(now)

    def event(self, now: int) -> None:
        self.send_frames(now)
        self.apply_frames()
        self.fmu.updateDiscreteStates()
        self.send_frames(now)
        self.fmu.enterStepMode()

    def set_inputs(self, now: int) -> None:
        for name, value in self.inputs[min(now // STEP_NS, len(self.inputs) - 1)].items() if self.inputs else ():
            variable = self.number[name]
            if variable.type == "Boolean":
                self.fmu.setBoolean([variable.valueReference], [bool(value)])
            else:
                self.fmu.setFloat64([variable.valueReference], [value])

    def apply_frames(self) -> None:
        """Set the frames that were received up to the last step; of equal identifiers the last one counts."""
        assert self.last is not None
        due = {identifier: data for time, identifier, data in self.received if time <= self.last}
        self.received = [each for each in self.received if each[0] > self.last]
        if due:
            self.fmu.setClock(self.clocks["Rx"], [True])
        for identifier, data in due.items():
            operation = FRAME.pack(TRANSMIT, FRAME.size + len(data), identifier, 0, 0, len(data)) + data
            self.fmu.setBinary(self.data["Rx"], [operation])

    def send_frames(self, now: int) -> None:
        if not self.fmu.getClock(self.clocks["Tx"])[0]:
            return
        content = bytes(self.fmu.getBinary(self.data["Tx"])[0])
        while content:
            code, length = HEADER.unpack_from(content)
            if code == TRANSMIT:
                _, _, identifier, _, _, count = FRAME.unpack_from(content)
                data = content[FRAME.size : FRAME.size + count]
                self.sent.append((now, identifier, data.hex()))
                self.can.send_frame(identifier, data, 0, count)
            content = content[length:]


if __name__ == "__main__":
    folder, name, uri, stop_ns = sys.argv[1:]
    participant = Participant(folder, name, json.load(sys.stdin), int(stop_ns))
    participant.run(uri)
    json.dump(participant.sent, sys.stdout)

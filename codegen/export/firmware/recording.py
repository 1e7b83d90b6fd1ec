"""Frames of a complete run: those of the car and the answers of the software in the loop."""

from __future__ import annotations

from dataclasses import dataclass

from codegen.sil.software import Software
from hil_sim.frames import Frame
from hil_sim.plant_node import PlantNode
from hil_sim.scenarios import Scenario


@dataclass(frozen=True)
class Drive:
    """A drive without faults on the bus.

    Attributes:
        received: for each cycle the frames that came before its task ran.
        sent: for each cycle the frame that its task sent.
    """

    received: tuple[tuple[Frame, ...], ...]
    sent: tuple[Frame, ...]


def record(software: Software, scenario: Scenario) -> Drive:
    """Run the compiled task and the plant in closed loop, as `codegen sil --can` does, and return the frames."""
    node, task = PlantNode(software.config, scenario, precision=software.precision), software.task()
    received, sent = [], []
    for cycle in range(node.cycles):
        frames = tuple(node.outgoing(cycle))
        for frame in frames:
            task.on_can_frame(frame.id, frame.data)
        answer = Frame(*task.run())
        node.receive(answer)
        node.finish(cycle)
        received.append(frames)
        sent.append(answer)
    return Drive(tuple(received), tuple(sent))


def frame_text(frame: Frame) -> str:
    """Return a frame in the format of the firmware and of candump -L: 201#0011223344556677."""
    return f"{frame.id:03X}#{frame.data.hex().upper()}"

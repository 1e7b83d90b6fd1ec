"""FMUs on a CAN bus (FMI-LS-BUS): their frames equal those of the software in the loop, bit for bit."""

from __future__ import annotations

import functools
from collections.abc import Mapping

import pytest
from fmpy.validation import validate_fmu

from hil_sim.bench import run_in_process
from hil_sim.codec import Frame
from hil_sim.plant_node import PlantNode
from hil_sim.scenarios import find
from tests.export import fmus
from tests.export.bus import Bus, Node, simulate
from tests.export.fmus import STEP, Slave, made

SCENARIO = "sine-with-dwell"
ECU_ID, MOTION_ID, CONDITIONS_ID = 0x201, 0x101, 0x102


class Log:
    """Frames of a run, in order."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def write(self, frame: Frame, *, received: bool) -> None:
        self.frames.append(frame)


@functools.cache
def recorded(kind: str, scenario: str, elapsed: float) -> tuple[list[Frame], int]:
    """Return the frames of the SIL, whose command acts `elapsed` (s) after the frames of the car, and its cycles."""
    software, log = fmus.software(kind), Log()
    node = PlantNode(software.config, find(scenario), precision=software.precision)
    node.task_starts = [(elapsed,)] * node.cycles
    run_in_process(node, software, log=log)  # type: ignore[arg-type]
    return log.frames, node.cycles


def driver(kind: str, scenario: str):
    rows = fmus.inputs(kind, scenario)

    def values(time: float) -> Mapping[str, float]:
        return fmus.loop_inputs(rows[min(round(time / STEP - 0.5 + 1e-6), len(rows) - 1)])

    return values


def test_fmpy_validates_the_files() -> None:
    assert validate_fmu(str(made("ecu", "3").path)) == []
    assert validate_fmu(str(made("bus_plant", "3").path)) == []


@pytest.mark.parametrize(("bit_rate", "elapsed", "notifies"), [(None, 0.005, False), (500e3, 0.006, True)])
def test_both_nodes_on_a_bus(bit_rate: float | None, elapsed: float, notifies: bool) -> None:
    wanted, cycles = recorded("tracking", SCENARIO, elapsed)
    given = driver("tracking", SCENARIO)
    start = {"CanChannel.BusNotifications": float(notifies)}
    plant = Node(Slave(made("bus_plant", "3"), event_mode=True)).start({**start, **given(0.0)})
    ecu = Node(Slave(made("ecu", "3"), event_mode=True)).start(start)
    bus = Bus((plant, ecu), bit_rate, notifies=notifies)
    simulate(bus, cycles * 0.01 - STEP, STEP, lambda number, time: given(time) if number == 0 else {})
    assert [(frame.id, frame.data) for frame in bus.frames] == [(frame.id, frame.data) for frame in wanted]
    assert bus.configuration == {(0, 1): 500000, (0, 4): 1, (1, 1): 500000, (1, 4): 1}
    assert (bus.statuses, bus.errors) == ([], [])
    assert ecu.slave.get("lost_samples") <= 2

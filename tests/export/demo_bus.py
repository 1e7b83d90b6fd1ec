"""FMUs of this project with the demo FMUs of FMI-LS-BUS: `python -m tests.export.demo_bus EXAMPLES HEADERS`.

EXAMPLES is a checkout of fmi-ls-bus-examples, HEADERS the folder headers/ of a checkout of fmi-ls-bus. The demo bus simulation
and the demo node are compiled from their sources. It is not a test of `make test`, because those sources are not a part of this
project. Each line printed is a comparison; the exit code is 1 if frames differ.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import fmpy
from fmpy import fmi3

from codegen.emit.from_files import prepare
from codegen.emit.write import write_folder
from codegen.export.fmu.export import make_fmu
from codegen.sil.software import load
from codegen.sil.toolchain import compiler_command
from hil_sim.codec import Frame
from tests.export import fmus
from tests.export.bus import MICROSECOND, TRANSMIT, Bus, Node, frame_of, operations, simulate
from tests.export.fmus import Made, Slave, made
from tests.export.test_fmu_bus import driver, recorded
from tests.whole_car import car_toml

BUS, NODE = "can-bus-simulation", "can-node-triggered-output"
NODE_FRAME, NODE_PERIOD, NODE_BIT_RATE = (1, bytes([1, 2, 3, 4])), 0.3, 100e3
"""Frame, period (s) and bit rate of the demo node, fixed in its source."""
KIND, SCENARIO, ELAPSED = "tracking", "sine-with-dwell", 0.006
"""Build and scenario; time in s from the frames of the car to the command, in whole steps of the plant."""
CHANGED = 2
"""fmi3IntervalChanged"""


class BusFmu:
    """A bus simulation FMU with a terminal for each node and countdown clocks, in place of `Bus`."""

    def __init__(self, nodes: Sequence[Node], slave: Slave, terminals: Sequence[str]) -> None:
        self.nodes, self.slave, self.frames = nodes, slave, list[Frame]()
        self.moving: bool | None = None
        self.free_at = 0  # us
        self._waiting = dict.fromkeys(range(len(nodes)), b"")
        members = ("Rx_Clock", "Rx_Data", "Tx_Clock", "Tx_Data")
        number = {name: each.valueReference for name, each in slave.variables.items()}
        self._numbers = [{member: number[f"{terminal}.{member}"] for member in members} for terminal in terminals]
        slave.start()
        slave.fmu.enterStepMode()

    def accept(self, sender: int, content: bytes) -> None:
        """Accept the operations of a node."""
        self._waiting[sender] += content

    def begin(self, now: int) -> None:
        """Pass the operations to the FMU, which schedules the next transmission."""
        if any(self._waiting.values()):
            self._enter(now)
            for numbers, content in zip(self._numbers, self._waiting.values(), strict=True):
                if content:
                    self.slave.fmu.setClock([numbers["Rx_Clock"]], [True])
                    self.slave.fmu.setBinary([numbers["Rx_Data"]], [content])
            self._waiting = dict.fromkeys(self._waiting, b"")
            self._leave(now)

    def end(self, now: int) -> dict[int, bytes]:
        """Activate the countdown clocks and return the operations for each node."""
        self._enter(now)
        self.moving = None
        for numbers in self._numbers:
            self.slave.fmu.setClock([numbers["Tx_Clock"]], [True])
        found = {k: bytes(self.slave.fmu.getBinary([each["Tx_Data"]])[0]) for k, each in enumerate(self._numbers)}
        self._leave(now)
        sent = {content for each in found.values() for code, content in operations(each) if code == TRANSMIT}
        self.frames += [replace(frame_of(content), time=now * MICROSECOND) for content in sent]
        return found

    def _enter(self, now: int) -> None:
        size = now * MICROSECOND - self.slave.time
        if size > 0.1 * MICROSECOND:
            self.slave.step(size)
        self.slave.fmu.enterEventMode()

    def _leave(self, now: int) -> None:
        self.slave.fmu.updateDiscreteStates()
        counter, resolution, qualifier = (fmi3.fmi3UInt64 * 1)(), (fmi3.fmi3UInt64 * 1)(), (fmi3.fmi3IntervalQualifier * 1)()
        for numbers in self._numbers:
            clock = (fmi3.fmi3ValueReference * 1)(numbers["Tx_Clock"])
            self.slave.fmu.getIntervalFraction(clock, counter, resolution, qualifier)
            if qualifier[0] == CHANGED:
                self.moving, self.free_at = True, now + round(counter[0] / resolution[0] / MICROSECOND)
        self.slave.fmu.enterStepMode()


def compiled(folder: Path, headers: Path, target: Path) -> Made:
    """Compile a demo FMU and return it unpacked."""
    place = target / folder.name
    shutil.copytree(folder / "description", place)
    description = fmpy.read_model_description(str(place), validate=False)
    binaries = place / "binaries" / fmpy.platform_tuple
    binaries.mkdir(parents=True)
    include = Path(fmpy.__file__).parent / "c-code"
    binary = binaries / (description.coSimulation.modelIdentifier + fmpy.sharedLibraryExtension)
    options = (
        "-O2",
        "-w",
        "-fPIC",
        "-shared",
        "-DFMI3_OVERRIDE_FUNCTION_PREFIX",
        "-D_strdup=strdup",
        f"-I{include}",
        f"-I{headers}",
    )
    sources = sorted(str(path) for path in (folder / "src").glob("*.c"))
    subprocess.run([*compiler_command(), *options, *sources, "-o", str(binary)], check=True)
    return Made(None, place, place, description)


def frames_of(frames: Sequence[Frame]) -> list[tuple[int, bytes]]:
    return [(frame.id, frame.data) for frame in frames]


def started(what: Made, values: dict[str, float] | None = None) -> Node:
    return Node(Slave(what, event_mode=True)).start(values)


NOTIFIED = {"CanChannel.BusNotifications": 1.0}


def both_on_demo_bus(bus_fmu: Made) -> tuple[str, bool]:
    """Compare car and ECU on the demo bus with the SIL."""
    wanted, cycles = recorded(KIND, SCENARIO, ELAPSED)
    given = driver(KIND, SCENARIO)
    car = started(made("bus_plant", "3", KIND), {**NOTIFIED, **given(0.0)})
    bus = BusFmu((car, started(made("ecu", "3", KIND), NOTIFIED)), Slave(bus_fmu, event_mode=True), ("Node1", "Node2"))
    simulate(bus, cycles * 0.01 - fmus.STEP, fmus.STEP, lambda number, time: given(time) if number == 0 else {})
    return f"car and ECU on the demo bus: {len(bus.frames)} frames", frames_of(bus.frames) == frames_of(wanted)


def both_beside_demo_node(node: Made) -> tuple[str, bool]:
    """Compare car and ECU with the SIL, on the bus of the tests with the demo node, whose frames come first."""
    wanted, cycles = recorded(KIND, SCENARIO, ELAPSED)
    given = driver(KIND, SCENARIO)
    car = started(made("bus_plant", "3", KIND), {**NOTIFIED, **given(0.0)})
    third = started(node)
    bus = Bus((car, started(made("ecu", "3", KIND), NOTIFIED), third), notifies=True)
    simulate(bus, cycles * 0.01 - fmus.STEP, fmus.STEP, lambda number, time: given(time) if number == 0 else {})
    own = [frame for frame in frames_of(bus.frames) if frame != NODE_FRAME]
    other = len(bus.frames) - len(own)
    received = sum("Received CAN frame" in message for message in third.slave.messages)
    is_whole = other == int((cycles * 0.01 - fmus.STEP) / NODE_PERIOD) and received == len(own)
    what = f"car and ECU beside the demo node: {len(own)} frames, and {other} of the node"
    return what, is_whole and own == frames_of(wanted)


def ecu_and_demo_node(bus_fmu: Made, node: Made, target: Path) -> tuple[str, bool]:
    """Compare an ECU that hears the demo node only, on the demo bus, with its task; it has the bit rate of that node."""
    settings, build = target / "ars.toml", target / "build"
    can = f"[can]\nbitrate_kbit_s = {NODE_BIT_RATE / 1e3}\n"
    settings.write_text(car_toml(f'[controller]\nkind = "pi"\n{can}'), encoding="utf-8")
    write_folder(prepare(fmus.ROOT / "generated" / "4ws2-paper.npz", settings, build).folder, build)
    ecu = started(fmus.unpacked(target / "fmu", "ecu", make_fmu(build, "ecu", "3")), NOTIFIED)
    third = started(node)
    bus = BusFmu((ecu, third), Slave(bus_fmu, event_mode=True), ("Node1", "Node2"))
    duration = 3.0
    simulate(bus, duration, fmus.STEP, lambda number, time: {})
    task = load(build).task()
    own = [frame for frame in frames_of(bus.frames) if frame != NODE_FRAME]
    wanted = [task.run() for _ in own]
    other, received = len(bus.frames) - len(own), sum("Received CAN frame" in message for message in third.slave.messages)
    # A transmission that ends after the end of the simulation is not counted.
    is_whole = len(own) == round(duration / 0.01) and received == len(own) and other == round(duration / NODE_PERIOD) - 1
    return f"ECU and demo node on the demo bus: {len(own)} frames, and {other} of the node", (is_whole and own == wanted)


def main() -> int:
    """Run all comparisons and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("examples", type=Path, metavar="EXAMPLES")
    parser.add_argument("headers", type=Path, metavar="HEADERS")
    given = parser.parse_args()
    for path in (given.examples / BUS / "src", given.examples / NODE / "src", given.headers / "fmi3LsBusCan.h"):
        if not path.exists():
            parser.error(f"{path} is missing; give checkouts of fmi-ls-bus-examples and of fmi-ls-bus")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder)
        bus, node = (compiled(given.examples / name, given.headers, target) for name in (BUS, NODE))
        results = [both_on_demo_bus(bus), both_beside_demo_node(node), ecu_and_demo_node(bus, node, target)]
    for what, is_equal in results:
        print(f"{what}: {'equal' if is_equal else 'NOT EQUAL'}")
    return 0 if all(is_equal for _, is_equal in results) else 1


if __name__ == "__main__":
    sys.exit(main())

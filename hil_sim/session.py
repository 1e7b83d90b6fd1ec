"""One run on the bench: start and stop the ECU, open the bus, and log the run."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from codegen import configuration
from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.emit.folder import verify_hashes
from codegen.emit.manifest import read_build
from codegen.emit.text import Precision
from codegen.errors import CheckFailed, CodegenError
from codegen.sil.software import RECORD_COLUMNS, Status, require_can_side
from hil_sim.bench import BenchResult, Observer, run_in_lock_step, run_in_real_time
from hil_sim.bus import Bus, BusAddress
from hil_sim.ecu_process import EcuProcess, EcuThread, cffi_command
from hil_sim.logs import BusLog
from hil_sim.plant_node import PlantNode
from hil_sim.scenarios import Scenario

EcuKind = Literal["native", "cffi", "external"]


@dataclass(frozen=True)
class Setup:
    """Settings of a run and its bench.

    Attributes:
        config: configuration of car, frames and sensors.
        precision: precision of the controller.
        lock_step: whether time is simulated; otherwise real time.
        sensors: whether to simulate the configured sensors.
        seed: seed of noise and random faults.
        log: path of the bus log.
        dbc: DBC for log formats that can contain it.
    """

    config: Config
    scenario: Scenario
    address: BusAddress
    lock_step: bool = False
    precision: Precision = "single"
    sensors: bool = False
    seed: int = 0
    log: Path | None = None
    dbc: bytes | None = None

    @property
    def clock(self) -> str:
        """Clock mode as text."""
        return "lock-step" if self.lock_step else "real time"

    def describe(self) -> dict[str, str]:
        """Describe the run as texts."""
        sensors = f"seed {self.seed}" if self.sensors else "ideal"
        return {"bus": str(self.address), "clock": self.clock, "scenario": self.scenario.name, "sensors": sensors}

    def node(self) -> PlantNode:
        """Return the car at its start."""
        return PlantNode(self.config, self.scenario, precision=self.precision, sensors=self.sensors, seed=self.seed)


@dataclass(frozen=True)
class BuildFacts:
    """Facts of a build that the bench needs without compiling it."""

    config: Config
    precision: Precision
    dbc: bytes | None
    edited: tuple[str, ...]

    @classmethod
    def read(cls, build: Path) -> BuildFacts:
        """Read the facts from the manifest. Raises BuildError."""
        manifest = read_build(build)
        prefix = manifest["options"]["prefix"]
        config = configuration.parse(manifest["configuration"], "manifest.json: configuration")
        dbc, precision = build / f"{prefix}.dbc", manifest["options"]["precision"]
        require_can_side(manifest, build)
        return cls(config, precision, dbc.read_bytes() if dbc.is_file() else None, tuple(verify_hashes(build)))


def run_plant(setup: Setup, ecu: EcuProcess | EcuThread | None = None, observe: Observer | None = None) -> BenchResult:
    """Run the car on a bus with an ECU that is already there.

    Args:
        ecu: ECU that the scenario's faults stop and restart.
    """
    if ecu is None:
        _refuse_restart(setup.scenario)
    node = setup.node()
    with Bus(setup.address, setup.config.can) as bus, _logged(setup) as log:
        if setup.lock_step:
            return run_in_lock_step(node, bus, log=log, observe=observe)
        return run_in_real_time(node, bus, ecu=ecu, log=log, observe=observe)


@dataclass(frozen=True)
class HilRun:
    """Run with an ECU: the recording, and the counters of the ECU ("" for an external ECU or one that was killed)."""

    result: BenchResult
    ecu_counters: str


def run_hil(setup: Setup, build: Path, kind: EcuKind, observe: Observer | None = None, *, xcp: bool = False) -> HilRun:
    """Run with the ECU of a build, which is started and stopped here, or with one that is already there.

    Args:
        xcp: whether a master can measure and calibrate the ECU while it runs.

    Raises:
        CodegenError: bus or ECU do not start, or the options cannot be combined.
    """
    check_xcp(kind, xcp=xcp)
    if kind == "external":
        if setup.lock_step:
            raise CodegenError(
                "an external ECU has a clock of its own",
                where="`lock_step=True`",
                remedy="use `lock_step=False`, or another `ecu=`",
            )
        return HilRun(run_plant(setup, None, observe), "")
    with ecu_of(build, setup.address, kind, lock_step=setup.lock_step, xcp=xcp) as ecu:
        try:
            result = run_plant(setup, ecu, observe)
        except CodegenError as error:
            raise error if ecu.alive else _ended(ecu) from None
        if not ecu.alive:
            raise _ended(ecu)
        return HilRun(result, ecu.stop())


def _refuse_restart(scenario: Scenario) -> None:
    if any(fault.kind == "ecu-restart" for fault in scenario.faults):
        raise CodegenError(
            "an ECU that was not started here cannot be switched off from here",
            where=f"scenario {scenario.name}",
            remedy="use `ecu='native'` or `ecu='cffi'`, or another scenario",
        )


def _ended(ecu: EcuProcess | EcuThread) -> CodegenError:
    return CheckFailed(f"the ECU ended during the run: {ecu.stop() or 'without a message'}")


def ecu_of(build: Path, address: BusAddress, kind: EcuKind, *, lock_step: bool, xcp: bool = False) -> EcuProcess | EcuThread:
    """Return the ECU of a build, not started yet. Raises CodegenError if this bus does not support it."""
    check_xcp(kind, xcp=xcp)
    if kind == "native":
        check_native(address)
        from hil_sim import ecu_process

        options = {"lock_step": lock_step, "xcp": xcp}
        return EcuProcess(ecu_process.command(build, address.channel, parent=os.getpid(), **options))
    if address.interface == "virtual":
        from codegen.sil.software import load

        return EcuThread(load(build), address, lock_step=lock_step)
    return EcuProcess(cffi_command(build, address, lock_step=lock_step))


def check_xcp(kind: str, *, xcp: bool) -> None:
    """Reject XCP if the ECU has none. Raises CodegenError."""
    if xcp and kind != "native":
        raise CodegenError(f"only the native ECU has XCP, not {kind}", where="`xcp=True`", remedy="use `ecu='native'`")


def check_native(address: BusAddress) -> None:
    """Reject options that the native ECU does not support. Raises CodegenError."""
    if address.interface != "socketcan" or sys.platform != "linux":
        raise CodegenError(
            f"the native ECU speaks SocketCAN on Linux, not {address.interface} on {sys.platform}",
            where="`ecu='native'`",
            remedy="use `bus='socketcan:vcan0'`, or `ecu='cffi'`",
        )


@contextmanager
def _logged(setup: Setup) -> Iterator[BusLog | None]:
    if setup.log is None:
        yield None
        return
    # Simulated time has no wall clock: equal runs give equal logs.
    start = None if setup.lock_step else time.time()
    with BusLog(setup.log, channel=setup.address.channel, start=start, dbc=setup.dbc) as log:
        yield log


def passive(config: Config, scenario: Scenario) -> FloatArray:
    """Return a recording (cycles, 12) of the same car without rear steering, columns RECORD_COLUMNS."""
    node = PlantNode(config, scenario)
    rows = []
    for cycle in range(node.cycles):
        node.outgoing(cycle)
        rows.append(node.finish(cycle))
    record = np.array(rows)
    record[:, RECORD_COLUMNS.index("status")] = Status.STANDBY  # no ECU is missing here
    return record

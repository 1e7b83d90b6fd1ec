"""FMUs under test, and one interface for instances of both versions of the standard."""

from __future__ import annotations

import functools
import weakref
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy import fmi2, fmi3
from fmpy.model_description import ModelDescription

from codegen.export.fmu.export import Fmu, make_fmu
from codegen.export.fmu.variables import Version, What
from codegen.sil.closed_loop import INPUT_COLUMNS, ClosedLoop
from codegen.sil.software import RECORD_COLUMNS, Software, load
from hil_sim.scenario_files import find
from tests import frame_kinds, shared

ROOT = Path(__file__).resolve().parents[2]
BUILDS = {"pi": ROOT / "generated" / "4ws2-paper", "tracking": ROOT / "generated" / "4ws2"}
STEP, SAMPLE, STEPS_PER_SAMPLE = 0.001, 0.01, 10

FROM_SIL = {
    "speed": "speed_m_s",
    "steering_wheel_command": "steering_wheel_command_rad",
    "friction": "friction",
    "yaw_moment": "yaw_moment_n_m",
    "inhibit": "inhibit",
}
"""Columns of a scenario and the FMU inputs they become, except friction_estimate and those of extra signals."""

OUTPUTS = tuple(name for name in RECORD_COLUMNS if name not in ("time_s", "speed_m_s"))
"""Columns of a run that a loop computes."""


def folder_of(kind: str) -> Path:
    """Return a committed build by its kind of controller, or another one by its kind of frames."""
    return BUILDS[kind] if kind in BUILDS else frame_kinds.folder(kind)


@functools.cache
def software(kind: str) -> Software:
    """Return the SIL of a build."""
    return load(folder_of(kind))


@functools.cache
def inputs(kind: str, scenario: str, *, held: bool = False) -> np.ndarray:
    """Return the scenario's rows, one per plant step; `held`: those at the samples, each repeated for a whole sample."""
    rows = find(scenario).inputs(software(kind).config)
    return np.repeat(rows[::STEPS_PER_SAMPLE], STEPS_PER_SAMPLE, axis=0) if held else rows


@functools.cache
def recorded(kind: str, scenario: str, *, held: bool = False) -> np.ndarray:
    """Return the SIL's run, columns RECORD_COLUMNS."""
    return ClosedLoop(software(kind)).run(inputs(kind, scenario, held=held))


def column(record: np.ndarray, name: str) -> np.ndarray:
    return record[:, RECORD_COLUMNS.index(name)]


def loop_inputs(row: Iterable[float]) -> dict[str, float]:
    """Return a row of a scenario as the inputs of a loop."""
    given = dict(zip(INPUT_COLUMNS, row, strict=True))
    estimate = given.pop("friction_estimate")
    known = bool(np.isfinite(estimate))
    named = {FROM_SIL[name]: float(value) for name, value in given.items() if name in FROM_SIL}
    return {**named, "friction_estimate_available": float(known), **({"friction_estimate": estimate} if known else {})}


@dataclass(frozen=True)
class Made:
    """An FMU file and its unpacked content."""

    fmu: Fmu
    path: Path
    folder: Path
    description: ModelDescription

    @property
    def version(self) -> Version:
        return "3" if self.description.fmiVersion.startswith("3") else "2"


@functools.cache
def made(what: What, version: Version, kind: str = "tracking") -> Made:
    """Return the FMU of a build, compiled once for all workers."""
    name = f"{kind}-{what}-{version}"
    with shared.locked(f"unpacked fmu {name}") as folder:
        return unpacked(folder, name, shared.once(f"fmu {name}", lambda: make_fmu(folder_of(kind), what, version)))


def unpacked(folder: Path, name: str, fmu: Fmu) -> Made:
    """Return an FMU in a file of that name, unpacked next to it."""
    path, place = folder / f"{name}.fmu", folder / name
    if not place.exists():
        folder.mkdir(exist_ok=True)
        path.write_bytes(fmu.content)
        fmpy.extract(str(path), str(place))
    return Made(fmu, path, place, fmpy.read_model_description(str(path)))


def text_of(made: Made, path: str) -> str:
    return (made.folder / path).read_text(encoding="utf-8")


def listed_sources(made: Made) -> list[str]:
    """Return the C files that the FMU lists for compilation by a simulator."""
    path, tag = ("modelDescription.xml", "File") if made.version == "2" else ("sources/buildDescription.xml", "SourceFile")
    return [element.attrib["name"] for element in ET.fromstring(text_of(made, path)).iter(tag)]


class Slave:
    """One FMU instance; `messages` holds its log. It is freed with this object."""

    def __init__(self, made: Made, name: str = "one", *, event_mode: bool = False) -> None:
        self.messages: list[str] = []
        messages = self.messages
        self.made = made
        self.time = 0.0
        description = made.description
        self.variables = {variable.name: variable for variable in description.modelVariables}
        given = {
            "unzipDirectory": str(made.folder),
            "modelIdentifier": description.coSimulation.modelIdentifier,
            "instanceName": name,
            "guid": description.guid if made.version == "2" else description.instantiationToken,
        }
        self.fmu: Any
        if made.version == "2":
            self.fmu = fmi2.FMU2Slave(**given)
            callbacks = fmi2.fmi2CallbackFunctions()
            callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(lambda *given: messages.append(given[-1].decode()))
            callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
            callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
            self.fmu.instantiate(callbacks=callbacks)
        else:
            self.fmu = fmi3.FMU3Slave(**given)
            self.fmu.instantiate(
                loggingOn=True, eventModeUsed=event_mode, logMessage=lambda *given: messages.append(given[-1].decode())
            )
        weakref.finalize(self, self.fmu.freeInstance)

    def start(self, values: Mapping[str, float] | None = None, start: float = 0.0, stop: float | None = None) -> Slave:
        """Initialise the instance."""
        self.set(values or {})
        if self.made.version == "2":
            self.fmu.setupExperiment(startTime=start, stopTime=stop)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start, stopTime=stop)
        self.fmu.exitInitializationMode()
        self.time = start
        return self

    def _access(self, direction: str, kind: str) -> Any:
        enumeration = "Integer" if self.made.version == "2" else "Int64"
        return getattr(self.fmu, direction + (enumeration if kind == "Enumeration" else kind))

    def set(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            variable = self.variables[name]
            typed = bool(value) if variable.type == "Boolean" else int(value) if "Int" in variable.type else value
            self._access("set", variable.type)([variable.valueReference], [typed])

    def get(self, name: str) -> float:
        variable = self.variables[name]
        return float(self._access("get", variable.type)([variable.valueReference])[0])

    def row(self, names: Iterable[str] = OUTPUTS) -> list[float]:
        return [self.get(name) for name in names]

    def step(self, size: float) -> None:
        answer = self.fmu.doStep(self.time, size)
        self.has_event = self.made.version == "3" and answer[0]
        self.time += size

    def restore(self, state: Any, time: float) -> None:
        self.fmu.setFMUState(state)
        self.time = time


def drive(slave: Slave, rows: np.ndarray, size: float, names: Iterable[str] = OUTPUTS) -> np.ndarray:
    """Return the outputs at each sample of the controller, with the inputs of that time set, as in the SIL's record."""
    names = tuple(names)
    per_step = round(size / STEP)
    seen = []
    for k in range(0, len(rows), per_step):
        slave.set(loop_inputs(rows[k]))
        if k % STEPS_PER_SAMPLE == 0:
            seen.append(slave.row(names))
        slave.step(size)
    return np.array(seen)

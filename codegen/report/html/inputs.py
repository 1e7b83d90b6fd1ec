"""Input files of a report: recordings of runs, logs of the bus, results of `codegen faults`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from codegen.arrays import FloatArray
from codegen.configuration import Can
from codegen.configuration.section import needed
from codegen.errors import CodegenError, one_line
from codegen.files import distinct_names, read_file, refuse_empty, require_regular
from codegen.importing import child
from codegen.limits import Limits
from codegen.logs.account import findings, open_bus_log
from codegen.logs.databases import Identifiers
from codegen.logs.formats import LOGS
from codegen.report.bus_tables import FaultEntry, FaultFile
from codegen.sil.software import RECORD_COLUMNS
from hil_sim.logs import load_csv

FAULTS_BYTES_MAX = 2**24
RUN_BYTES_MAX = 2**31
VALUE_MAX = 1e9
"""Largest magnitude in a recording, in SI units: far above that of any car, and small enough to compute with."""
KINDS = "a run (.csv, .parquet, .mf4), a log of the bus (.blf, .asc, .log, .mf4) or the JSON of codegen faults"


@dataclass(frozen=True)
class BusTimes:
    """Periods and response times of the frames in a log, in ms.

    Attributes:
        name: name of the log.
        periods: name of a message -> time from each of its frames to the next.
        answers: time from each motion frame to the next command.
        cycle: nominal period.
        findings: findings about the log.
    """

    name: str
    periods: dict[str, FloatArray]
    answers: FloatArray
    cycle: float
    findings: tuple[str, ...] = ()

    @property
    def is_simulated(self) -> bool:
        """Whether every period is the configured one to a microsecond, which no real clock achieves; False without any."""
        return bool(self.periods) and all(bool(np.all(np.abs(values - self.cycle) < 1e-3)) for values in self.periods.values())


def read_log(path: Path, can: Can, name: str, channel: str | None = None) -> BusTimes:
    """Read the times of the frames of a log.

    Args:
        path: `.blf`, `.asc`, `.log` or `.mf4`.
        can: messages of the build, found by their ids.
        name: name in the report.
        channel: the bus that is used, as the log names it; None for all.

    Raises:
        CodegenError: see `open_bus_log`; it contains no frame of the build; or several senders send a message.
    """
    messages = (can.vehicle_motion, can.vehicle_conditions, can.rear_steer_command)
    keys = {message.name: (message.id, can.extended_ids) for message in messages}
    log = open_bus_log(path, Identifiers({key: name for name, key in keys.items()}), channel)
    frames, found = log.frames, log.allotment
    for name, key in keys.items():
        if key in found.conflicts:
            what, remedy = found.conflicts[key]
            raise CodegenError(what, where=f"{path}: {name}", remedy=remedy)
    used = {name: found.keys.get(key, np.array([], dtype=np.intp)) for name, key in keys.items()}
    used = {name: indices[frames.is_fd[indices] == can.is_fd] for name, indices in used.items()}
    if not any(indices.size for indices in used.values()):
        known = ", ".join(f"0x{message.id:x}" for message in messages)
        raise CodegenError(f"no frame with an id of the build ({known})", where=path, remedy="name its build with `build=`")
    stamps = {name: np.sort(frames.time[indices]) for name, indices in used.items()}
    motion, command = stamps[can.vehicle_motion.name], stamps[can.rear_steer_command.name]
    cycle = float(can.vehicle_motion.cycle_time_ms or 10.0)
    # In simulated time the answer has the time of its sample.
    following = np.searchsorted(command, motion, side="left")
    # A motion frame that is answered only after the next one has no answer of its own.
    ends = np.append(motion[1:], np.inf)
    answered = following < command.size
    delay = command[following[answered]] - motion[answered]
    own = command[following[answered]] < ends[answered]
    periods = {key: 1e3 * np.diff(values) for key, values in stamps.items() if values.size > 1}
    return BusTimes(name, periods, 1e3 * delay[own], cycle, tuple(findings(log)))


@dataclass(frozen=True)
class Files:
    """Content of the user's files.

    Attributes:
        runs: name -> recording (samples, 12), columns RECORD_COLUMNS. paths: their files, by name.
        logs: timing of the logs.
        faults: entries of `codegen faults --json`; None if no file contains any.
        notes: findings about the recordings.
    """

    runs: Mapping[str, FloatArray] = field(default_factory=dict)
    paths: Mapping[str, Path] = field(default_factory=dict)
    logs: Sequence[BusTimes] = ()
    faults: Sequence[FaultEntry] | None = None
    notes: Sequence[str] = ()


def named(argument: str) -> tuple[str, Path]:
    """Split `NAME=FILE`; the name is "" for a file alone."""
    name, sign, path = argument.partition("=")
    if sign and name.strip() and path and not Path(argument).exists():
        return name.strip(), Path(path)
    return "", Path(argument)


def read_files(arguments: Sequence[str], can: Can, channel: str | None = None) -> Files:
    """Read all files, each by its format.

    Args:
        arguments: values of `--run`.
        can: messages of the build, for logs.
        channel: see `read_log`.

    Raises:
        CodegenError: a file cannot be read or has another content, or a name is used twice.
    """
    runs: dict[str, FloatArray] = {}
    paths: dict[str, Path] = {}
    logs: list[BusTimes] = []
    faults: Sequence[FaultEntry] | None = None
    notes: list[str] = []
    given = [named(argument) for argument in arguments]
    own = iter(distinct_names([path for name, path in given if not name]))
    for name, path in given:
        name = name or next(own)
        refuse_empty(require_regular(path, RUN_BYTES_MAX, f"give {KINDS}"), path)
        if name in runs or name in {log.name for log in logs}:
            raise CodegenError(f"a second run called {name!r}", where=path, remedy=f"name it, as in `runs='other={path}'`")
        kind = path.suffix.lower()
        if kind == ".json":
            faults = read_faults(path)
        elif kind in RECORDINGS and (found := RECORDINGS[kind](path)) is not None:
            (runs[name], texts), paths[name] = found, path
            notes += [f"{name}: {text}." for text in texts]
        elif kind in LOGS:
            logs.append(read_log(path, can, name, channel))
        else:
            raise CodegenError("not an input of a report", where=path, remedy=f"give {KINDS}")
    return Files(runs, paths, logs, faults, notes)


def read_faults(path: Path) -> list[FaultEntry]:
    """Return the entries of `codegen faults --json`. Raises CodegenError for any other content."""
    content = read_file(path, FAULTS_BYTES_MAX, f"give {KINDS}")
    try:
        return TypeAdapter(FaultFile).validate_json(content)["faults"]
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in fault["loc"]).lstrip(".")
        what = f"not what codegen faults prints as JSON ({needed(fault)})"
        where = f"{path}: {one_line(key)}" if key else path
        raise CodegenError(what, where=where, remedy=f"give {KINDS}") from None


Recording = tuple[FloatArray, Sequence[str]]
"""Samples, and findings about the file."""


def _read_parquet(path: Path) -> Recording:
    limits = Limits.of(path.stat().st_size)
    columns = _in_child(path, "parquet", "read", RECORD_COLUMNS, child.result_bytes(limits), limits=limits)
    return _checked(np.column_stack(columns), path), ()


def _read_mf4(path: Path) -> Recording | None:
    """Return the recording in an MF4 file; None for a log of the bus."""
    limits = Limits.of(path.stat().st_size)
    found = _in_child(path, "mf4", "columns", RECORD_COLUMNS, child.result_bytes(limits), limits=limits)
    return None if found is None else (_checked(np.column_stack(found[0]), path), found[1])


def _in_child(path: Path, module: str, function: str, *arguments: Any, limits: Limits) -> Any:
    """Call a function of a module of `codegen.importing` in a process of its own. Raises CodegenError."""
    try:
        return child.read(path, module, function, *arguments, limits=limits)
    except CodegenError:
        raise
    except Exception as error:  # libraries may raise anything for a damaged file
        raise _no_run(path, error) from None


def _read_csv(path: Path) -> Recording:
    try:
        with Limits.of(path.stat().st_size).enforced(path):
            record = load_csv(path)
    except (OSError, ValueError) as error:
        raise _no_run(path, error) from None
    return _checked(record, path), ()


RECORDINGS = {".csv": _read_csv, ".parquet": _read_parquet, ".mf4": _read_mf4}


def _checked(record: FloatArray, path: Path) -> FloatArray:
    if record.ndim != 2 or record.shape[0] < 2:
        raise CodegenError("fewer than two samples", where=path, remedy="give a recorded run")
    if not np.isfinite(record[:, 0]).all():
        raise CodegenError("time_s is not finite", where=path, remedy="give a recorded run")
    for sample, column in np.argwhere(np.abs(record) > VALUE_MAX)[:1]:  # NaN is no value, and may be in a run
        name = RECORD_COLUMNS[column]
        what = f"{record[sample, column]:g} is beyond {VALUE_MAX:g}, the largest value of a run"
        raise CodegenError(what, where=f"{path}, sample {sample + 1}, column {name}", remedy="correct the value")
    if not np.all(np.diff(record[:, 0]) > 0.0):
        raise CodegenError("time_s does not rise", where=path, remedy="sort its rows, and leave repeated ones out")
    return record


def _no_run(path: Path, error: Exception) -> CodegenError:
    columns, reason = ", ".join(RECORD_COLUMNS), re.sub("'<.*>'", "it", one_line(error))  # asammdf names an object in memory
    return CodegenError(f"not a readable run ({reason})", where=path, remedy=f"its columns are {columns}")

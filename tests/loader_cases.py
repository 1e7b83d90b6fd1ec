"""Damaged files for every loader: seeds, kinds of damage, and the loaders that must read each file or reject it with one
line. Hostile files are in `tests.hostile_files`."""

from __future__ import annotations

import functools
import importlib
import io
import json
import os
import re
import resource
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from codegen import configuration
from codegen.configuration import preset, preset_text
from codegen.emit.manifest import read_build
from codegen.errors import CodegenError, one_line
from codegen.export import runs as exported
from codegen.export.arxml import export
from codegen.export.calibration.build import BuildCalibration
from codegen.export.calibration.images import Image, layout_of_a2l
from codegen.export.calibration.sets import CALIBRATION_READERS, merged
from codegen.export.elf import Elf
from codegen.identify.names import load_names
from codegen.identify.reading import read_drives
from codegen.importing import child
from codegen.importing.maps import Choices, import_map
from codegen.importing.tyre import import_tyres
from codegen.judgement.build_warnings import build_warnings, folder_warnings, margins_line
from codegen.library.identification import reading_as_json
from codegen.limits import MIB, Limits
from codegen.map_file import map as npz
from codegen.report.html.build import manifest_blocks
from codegen.report.html.inputs import read_files
from codegen.sil.software import RECORD_COLUMNS
from codegen.sil.toolchain import compiler_command
from codegen.sweep import spec
from hil_sim import scenario_files
from hil_sim.codec import Frame
from hil_sim.logs import BusLog
from hil_sim.suite import requirements
from tests.calibrations import addressed, records_of
from tests.identify import made

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "generated" / "4ws2-paper"
PAPER = preset()
CAN = PAPER.can
MF4, PARQUET = "codegen.importing.mf4", "codegen.importing.parquet"
CPU_S, MEMORY_BYTES = 20.0, 2_000_000_000
"""Largest processor time and memory for a file of up to 64 MiB."""
HANG_S, BLOCKED_S = 60, 900
"""A loader that takes so much processor time counts as hanging; the slowest case takes 15 s. And by the clock: it waits for
something that never comes."""

WORDS = (b"nan", b"inf", b"-1e308", b"1e400", b"0", b"-1", b"true", b"null", b'""', b"[]", b"{}", b"\x00", b"\xff", b"1" * 5000)
"""Replacements of a number or a word."""
NESTED = (b"[" * 3000, b"{" * 3000, b'{"a":' * 2000, b"a." * 3000)


@dataclass(frozen=True)
class Loader:
    """A loader of one kind of file.

    Attributes:
        name: file name of a damaged file, in a separate folder.
        seed: content of a good file.
        load: reads a path; raises CodegenError if it cannot.
        weight: share of the generated cases; less for slow readers.
        reader: module that reads the file in a process of its own, which takes a second; "" without one.
    """

    name: str
    seed: bytes
    load: Callable[[Path], object]
    weight: float = 1.0
    reader: str = ""


def _written(name: str, write: Callable[[Path], object]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def _run(path: Path) -> None:
    record = np.zeros((40, len(RECORD_COLUMNS)))
    record[:, 0] = 0.01 * np.arange(40)
    exported.save(record, path)


def _log(path: Path) -> None:
    with BusLog(path, start=1.7e9) as log:
        for cycle in range(20):
            for message in (CAN.vehicle_motion, CAN.vehicle_conditions, CAN.rear_steer_command):
                log.write(Frame(message.id, bytes(8), 1.7e9 + 0.01 * cycle), message is CAN.rear_steer_command)


def _table() -> bytes:
    rows = [f"{speed};" + ";".join(f"{0.3 * speed * angle:g}" for angle in (0.01, 0.02, 0.03)) for speed in (5, 10, 20)]
    return ("vx [m/s] \\ delta_f [rad];0.01;0.02;0.03\n" + "\n".join(rows) + "\n").encode()


def _mat() -> bytes:
    buffer = io.BytesIO()
    savemat(buffer, {"vx": [5.0, 10.0], "delta_f": [0.1, 0.2], "yaw_rate": [[0.1, 0.2], [0.2, 0.3]]})
    return buffer.getvalue()


def _faults() -> bytes:
    words = {"name": "frame-loss", "injected": "frames lost", "reached": "held", "defined": "held", "seen": ["DEGRADED"]}
    times = dict.fromkeys(("held_after_s", "fail_safe_after_s", "recovered_after_s"), 0.1)
    sizes = dict.fromkeys(("rear_angle_max_deg", "rear_rate_max_deg_s", "command_step_max_deg"), 1.0)
    entry = {**words, **times, **sizes, "violations": []}
    return json.dumps({"faults": [entry]}).encode()


def _tyre(path: Path) -> object:
    car = path.with_name("ars.toml")
    car.write_text(preset_text(), encoding="utf-8")
    return import_tyres([path], car)


def _report_input(path: Path) -> object:
    return read_files([str(path)], CAN)


def loaders() -> Mapping[str, Loader]:
    """Return all loaders by name, with seeds that they accept."""
    sweep = 'samples = 10\n[controllers]\npi = "build"\n[factors]\nfriction = {uniform = [0.4, 0.9]}\nmass_percent = [0, 20]\n'
    scenario = 'name = "mine"\nbase = "step-steer"\nspeed_km_h = 60.0\nsteering_wheel_angle_deg = 45.0\n'
    steering = "time_s,steering_wheel_angle_rad,speed_m_s\n0,0,20\n1,0.2,20\n2,0.1,20\n"
    manifest, verification = (path.read_bytes() for path in (BUILD / "manifest.json", ROOT / "tests/verify/record.json"))
    tyre = (ROOT / "tests/importing/data/mf61.tir").read_bytes()
    found = {
        "configuration": Loader("ars.toml", preset_text("recommended").encode(), configuration.load),
        "map": Loader("map.npz", (ROOT / "generated/4ws2-paper.npz").read_bytes(), npz.load, 0.3),
        "manifest": Loader("manifest.json", manifest, _manifest, 0.5),
        "verification": Loader("verify.json", verification, _verification, 0.3),
        "campaign": Loader("sweep.toml", sweep.encode(), spec.load),
        "scenario": Loader("mine.toml", scenario.encode(), _scenario),
        "recorded steering": Loader("mine.csv", steering.encode(), _scenario),
        "text table": Loader("table.csv", _table(), _map),
        "tyre": Loader("tyre.tir", tyre, _tyre, 0.5),
        "MATLAB file": Loader("map.mat", _mat(), _map, 0.02, "codegen.importing.matlab"),
        "limits": Loader("limits.toml", b"overshoot_percent = 5.0\ninstructions = 1320\n", requirements.load),
        "faults": Loader("faults.json", _faults(), _report_input),
        "program": Loader("program", _written("program", _program), _objects, 0.5),
    }
    for kind, weight, reader in (("csv", 1.0, ""), ("parquet", 0.02, PARQUET), ("mf4", 0.02, MF4)):
        found[f"run, {kind}"] = Loader(f"run.{kind}", _written(f"run.{kind}", _run), _report_input, weight, reader)
    for kind, module in CALIBRATION_READERS.items():
        own = _calibration()
        found[f"calibration, {kind}"] = Loader(f"set{kind}", module.write(own.values, own.layout, "test"), _calibrated, 0.5)
    a2l = addressed((BUILD / "ars.a2l").read_bytes())
    records = records_of(a2l, _calibration())
    found["addresses"] = Loader("ecu.a2l", a2l, _placed, 0.2)
    found["image, S-record"] = Loader("ecu.s19", records.as_srec().encode(), _image, 0.2)
    found["image, Intel HEX"] = Loader("ecu.hex", records.as_ihex().encode(), _image, 0.2)
    found |= _drive_loaders()
    for kind in ("asc", "log", "blf"):
        found[f"log, {kind}"] = Loader(f"bus.{kind}", _written(f"bus.{kind}", _log), _report_input, 0.5)
    return found


def _drive_loaders() -> dict[str, Loader]:
    frames = made.frames(duration=0.3)
    bus = {kind: _written(f"drive.{kind}", lambda path: made.write_bus(path, frames)) for kind in ("asc", "log", "blf")}
    found = {f"drive, {kind}": Loader(f"drive.{kind}", seed, _drive, 0.3) for kind, seed in bus.items()}
    found["drive, mf4"] = Loader("drive.mf4", _written("drive.mf4", made.write_mf4), _drive, 0.02, MF4)
    table = made.table().head(40)
    found["drive, csv"] = Loader("drive.csv", table.to_csv(index=False).encode(), _drive)
    found["drive, parquet"] = Loader("drive.parquet", _written("drive.parquet", table.to_parquet), _drive, 0.02, PARQUET)
    names = b'time_unit = "s"\nwithout = ["sideslip"]\n[vx]\nsignal = ["Speed"]\nunit = "km/h"\nsign = 1\noffset = 0.1\n'

    def with_database(path: Path) -> object:
        log = path.with_name("drive.log")
        log.write_bytes(bus["log"])
        return read_drives([log], [path])

    found["database"] = Loader("damaged.dbc", made.DBC.encode(), with_database, 0.3)
    found["database, ARXML"] = Loader("damaged.arxml", export(BUILD).folder.files["ars.arxml"], with_database, 0.02)
    found["signals"] = Loader("names.toml", names, load_names)
    return found


def _drive(path: Path) -> object:
    """Read a drive and format it as `codegen identify --check` does."""
    database = path.with_name("car.dbc")
    database.write_text(made.DBC, encoding="ascii")
    reading = read_drives([path], [database])
    return json.dumps(reading_as_json(reading), allow_nan=False), list(map(str, reading.findings)), reading.names_toml


@functools.cache
def _calibration() -> BuildCalibration:
    return BuildCalibration.load(BUILD)


def _calibrated(path: Path) -> object:
    own = _calibration()
    return merged(own, own.values, "build", [path])


def _image(path: Path) -> object:
    a2l, own = path.with_name("good.a2l"), _calibration()
    a2l.write_bytes(addressed((BUILD / "ars.a2l").read_bytes()))
    image = Image.load(path, a2l, BUILD, own.layout)
    return merged(own, image.read(), path.name, ()), image.patched(own.values)


def _placed(path: Path) -> object:
    return layout_of_a2l(path, _calibration().layout)


def _scenario(path: Path) -> object:
    return scenario_files.load(path, PAPER)


def _map(path: Path) -> object:
    return import_map(path, Choices({}, "vx=m/s,delta_f=rad,yaw_rate=rad/s", None))


def _program(path: Path) -> None:
    source = path.with_suffix(".c")
    source.write_text("int counter = 1;\nint main(void) { return counter; }\n", encoding="ascii")
    subprocess.run([*compiler_command(), "-g", "-no-pie", str(source), "-o", str(path)], check=True)


def _objects(path: Path) -> object:
    """Read a program as `codegen a2l` does."""
    return Elf.read(path).instances("ars_task_t")


def _manifest(path: Path) -> object:
    """Read a manifest and format it as `codegen check` and `codegen report` do."""
    manifest = read_build(path.parent)
    return [margins_line(manifest["margins"]), *build_warnings(manifest), *manifest_blocks(path.parent)]


def _verification(path: Path) -> object:
    path.with_name("manifest.json").write_bytes((BUILD / "manifest.json").read_bytes())
    return list(folder_warnings(path.parent))


def damaged(seed: bytes, generator: np.random.Generator) -> bytes:
    """Return a seed with one to three kinds of damage."""
    data = seed
    for _ in range(int(generator.integers(1, 4))):
        data = DAMAGES[int(generator.integers(len(DAMAGES)))](data, generator)
    return data


def _at(data: bytes, generator: np.random.Generator) -> int:
    return int(generator.integers(len(data) + 1))


def _cut(data: bytes, generator: np.random.Generator) -> bytes:
    first, last = sorted((_at(data, generator), _at(data, generator)))
    return data[:first] if generator.random() < 0.5 else data[:first] + data[last:]


def _flip(data: bytes, generator: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for _ in range(int(generator.integers(1, 9)) if changed else 0):
        changed[int(generator.integers(len(changed)))] = int(generator.integers(256))
    return bytes(changed)


def _replace(data: bytes, generator: np.random.Generator) -> bytes:
    """Replace one word or number."""
    words = list(re.finditer(rb'"[^"\n]{0,40}"|[-+\w.]+', data[:200_000]))
    if not words:
        return data
    word = words[int(generator.integers(len(words)))]
    return data[: word.start()] + WORDS[int(generator.integers(len(WORDS)))] + data[word.end() :]


def _repeat(data: bytes, generator: np.random.Generator) -> bytes:
    """Drop, repeat or move a line."""
    lines = data.splitlines(keepends=True)
    if len(lines) < 2:
        return data + data[: _at(data, generator)]
    line = lines.pop(int(generator.integers(len(lines))))
    for _ in range(int(generator.integers(3))):
        lines.insert(int(generator.integers(len(lines) + 1)), line)
    return b"".join(lines)


def _nest(data: bytes, generator: np.random.Generator) -> bytes:
    at = _at(data, generator)
    return data[:at] + NESTED[int(generator.integers(len(NESTED)))] + data[at:]


DAMAGES = (_cut, _flip, _replace, _replace, _replace, _repeat, _nest)


def fault_of(loader: Loader, data: bytes, folder: Path) -> str:
    """Return the fault in a loader's response to a file, or "": an exception of another kind, or not exactly one line."""
    path = folder / loader.name
    path.write_bytes(data)
    return fault_of_file(loader, path)


class HangError(BaseException):
    """No answer in time. Loaders and `logging` catch every Exception."""


def fault_of_file(loader: Loader, path: Path) -> str:
    """Return the fault in a loader's response to the file at `path`; see `fault_of`."""
    before = {each: signal.signal(each, _hung) for each in (signal.SIGVTALRM, signal.SIGALRM)}
    signal.setitimer(signal.ITIMER_VIRTUAL, HANG_S)  # unlike ITIMER_PROF, the loaders do not use it
    signal.alarm(BLOCKED_S)
    try:
        loader.load(path)
    except CodegenError as error:
        text = str(error)
        return "" if text and text.isprintable() else f"not one printable line: {text[:200]!r}"
    except (Exception, HangError) as error:
        return f"{type(error).__name__}: {str(error)[:200]}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.alarm(0)
        for each, handler in before.items():
            signal.signal(each, handler)
    return ""


def _hung(number: int, _frame: object) -> None:
    limit = f"{HANG_S} s of processor time" if number == signal.SIGVTALRM else f"{BLOCKED_S} s"
    raise HangError(f"no answer after {limit}")


@contextmanager
def readers_in_process() -> Iterator[None]:
    """Make the calls of `codegen.importing.child` in this process."""

    def call(module: str, function: str, *arguments: Any, limits: Limits | None = None) -> Any:
        del limits
        try:
            return getattr(importlib.import_module(module), function)(*arguments)
        except MemoryError:
            raise
        except Exception as error:
            raise ValueError(one_line(error) or type(error).__name__) from None

    before, child.call = child.call, call
    try:
        yield
    finally:
        child.call = before


def fault_apart(loader: Loader, data: bytes, folder: Path) -> str:
    """Return the fault in a loader's response to a file in a process of its own; see `fault_of`. A crash is one too, and more
    processor time or memory than a file of its size may take."""
    path = folder / loader.name
    size = path.write_bytes(data)
    del data  # which the new process would have too
    reading, writing = os.pipe()
    process = os.fork()
    if process == 0:
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (2 * HANG_S, 2 * HANG_S))  # C code that does not return to Python
            os.write(writing, fault_of_file(loader, path).encode()[:4000])
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as stream:
        fault = stream.read().decode("utf-8", "replace")
    _, status, usage = os.wait4(process, 0)  # with the processes that it started
    factor = max(1.0, size / (64 * MIB))
    seconds, memory_bytes = usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024
    if os.WIFSIGNALED(status):
        return f"ended by signal {os.WTERMSIG(status)} after {seconds:.0f} s"
    if seconds > CPU_S * factor:
        return f"took {seconds:.0f} s"
    return fault or (f"took {memory_bytes / 1e9:.2f} GB" if memory_bytes > MEMORY_BYTES * factor else "")

"""Batches of calls of the generated C, run by the same C on the host and on an emulated core, with the same words in and out.

A row of a batch is one call, starting from the state that the previous row left. Numbers are passed as words with their bits,
so that nothing converts them on the way. The outputs are all results of the call and every field of the state after it,
without padding and pointers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.configuration.signals import CARRIED, SignalDefinition
from codegen.emit.can_view import task_view
from codegen.emit.render import render
from codegen.emit.text import c_type
from codegen.sil.compile import compile_library
from codegen.sil.software import Software
from codegen.verify.drives import DRIVE_COLUMNS
from codegen.verify.on_host import HOST_FLAGS
from codegen.verify.target import CORTEX_M4F, DATA, DATA_BYTES, Core, Processor, compile_image
from codegen.verify.traffic import FRAMES, Cycle

Word = type[np.uint32] | type[np.uint64]
Real = type[np.float32] | type[np.float64]
Rows = npt.NDArray[Any]
"""Words, (rows, columns), of the width of the build's numbers and in the byte order of this machine."""

WHOLE_FIELDS = frozenset(
    {"restart", "inhibit", "status", "diagnostics", "frames", "wrong_call", "wrong_by"}
    | {each.role for each in CARRIED if each.is_flag}
)
"""Input columns that hold whole numbers, besides those of frames."""

FRAME_WORD_BYTES = 4
"""Bytes of a frame in a word. Every length of CAN FD above seven bytes is a multiple."""
_INPUTS: Mapping[str, tuple[str, ...]] = {
    "controller": ("restart", "start_angle", *DRIVE_COLUMNS),
    "lookup": ("speed", "front_angle", "friction"),
    "limiter": ("restart", "start_angle", "speed", "front_angle", "demand"),
    "model": ("restart", "x", "speed", "front_angle", "rear_angle", "friction"),
    "dynamics": ("wrong_call", "wrong_by", "sideslip_angle", "yaw_rate", "speed", "front_angle", "rear_angle", "friction"),
}
_MESSAGES = ("motion", "conditions", "command")
FRICTION_FIELDS = ("front_friction", "rear_friction")
"""Frictions of a reference model of a car that brakes."""
FOLDER = "frame"
"""Folder of the C around a build."""


@dataclass(frozen=True)
class Column:
    """An output word: its name in messages, "state." and more for a field of the state, and the C expression of its value."""

    name: str
    expression: str

    @property
    def is_number(self) -> bool:
        """Whether it holds the bits of a real number, not a whole number."""
        return self.expression.startswith("bits(")


@dataclass(frozen=True)
class Batch:
    """Calls of one kind, and the columns of an input row and of an output row."""

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[Column, ...]

    @property
    def expressions(self) -> tuple[str, ...]:
        """C expressions of the outputs."""
        return tuple(column.expression for column in self.outputs)


@dataclass(frozen=True)
class Program:
    """C with batches, complete except for the linking. `entries` are other functions that are called.

    Batches are by name, and sources, their content, by path. `word` is the NumPy type of a word.
    """

    prefix: str
    word: Word
    batches: Mapping[str, Batch]
    sources: Mapping[str, bytes]
    entries: tuple[str, ...] = ()


def program_of(software: Software, files: Mapping[str, bytes]) -> Program:
    """Return the program of everything that needs no library: controller, map, limiter, reference model, frames and task.

    `software` is the build compiled for this machine, which provides the fields of every struct.
    """
    prefix = software.prefix
    batches = {batch.name: batch for batch in _batches(software, files)}
    context = {
        **_context(software, batches),
        "with_model": "model" in batches,
        "per_axle": "model" in batches and FRICTION_FIELDS[0] in batches["model"].inputs,
        "with_reference": _has(software, "map_reference_t"),
        "task": task_view(software.config),
    }
    sources = {path: text for path, text in files.items() if path.startswith(("include/", "src/"))}
    del sources[f"src/{prefix}_dynamics.c"]
    for name in ("batches.h", "batches.c"):
        sources[f"{FOLDER}/{name}"] = render(f"verify/{name}.j2", context)
    return Program(prefix, word_of(software), batches, sources, (f"{prefix}_selftest",))


def dynamics_program_of(software: Software, files: Mapping[str, bytes], functions: Sequence[str]) -> Program:
    """Return the program of the vehicle dynamics, which call library functions: batches "dynamics" and "library"."""
    source = f"src/{software.prefix}_dynamics.c"
    outputs = [
        column
        for model in ("linear", "magic_formula")
        for name, kind in ((model, "state"), (f"{model}_jacobian", "jacobian"))
        for column in _columns(software, f"dynamics_{kind}_t", name)
    ]
    batches = {
        "dynamics": Batch("dynamics", _INPUTS["dynamics"], (*outputs, Column("calls", "(verify_word_t)calls"))),
        "library": Batch("library", ("x",), tuple(Column(name, f"bits({name})") for name in functions)),
    }
    included = f"{source.rpartition('/')[2]}.inc"
    context = {
        **_context(software, batches),
        "functions": functions,
        "dynamics": included,
        "signed_word": "int32_t" if software.precision == "single" else "int64_t",
        "tiny": "1.0e-30f" if software.precision == "single" else "1.0e-300",
    }
    sources = {path: text for path, text in files.items() if path.startswith("include/")}
    # Included, not compiled by itself: the library functions that it calls are others.
    sources[f"{FOLDER}/{included}"] = f'#line 1 "{source}"\n'.encode() + files[source]
    sources[f"{FOLDER}/batches.h"] = render("verify/batches.h.j2", context)
    sources[f"{FOLDER}/dynamics.c"] = render("verify/dynamics.c.j2", context)
    return Program(software.prefix, word_of(software), batches, sources)


def word_of(software: Software) -> Word:
    """Return the NumPy type of a word as wide as a number of the build."""
    return np.uint32 if software.precision == "single" else np.uint64


def real_of(word: Word) -> Real:
    """Return the NumPy type of the numbers whose bits are in words."""
    return np.float32 if word is np.uint32 else np.float64


def outside_drives(measured: Iterable[SignalDefinition]) -> tuple[SignalDefinition, ...]:
    """Return the signals of a build that no drive has, which are drawn at random."""
    return tuple(signal for signal in measured if signal.role not in DRIVE_COLUMNS)


def _context(software: Software, batches: Mapping[str, Batch]) -> dict[str, Any]:
    return {
        "build": {"prefix": software.prefix, "PREFIX": software.prefix.upper()},
        "real": c_type(software.precision),
        "word": "uint32_t" if software.precision == "single" else "uint64_t",
        "batches": list(batches.values()),
        "measured": software.measured,
        "takes_acceleration": any(signal.is_extra for signal in software.measured),
        "batch": batches,
    }


def _batches(software: Software, files: Mapping[str, bytes]) -> Iterator[Batch]:
    starts = range(0, software.config.can.frame_bytes, FRAME_WORD_BYTES)
    frame = ("id", "length", *(f"data_{start}" for start in starts))
    beside = tuple(signal.role for signal in outside_drives(software.measured))
    more = tuple(signal.role for signal in software.measured if signal.is_extra)
    inputs = {**_INPUTS, "controller": (*_INPUTS["controller"], *beside), "lookup": (*_INPUTS["lookup"], *more)}
    if f"include/{software.prefix}_reference_model.h" in files and _has_field(
        software, "reference_model_input_t", FRICTION_FIELDS[0]
    ):
        inputs["model"] = (*_INPUTS["model"][:-1], *FRICTION_FIELDS)
    inputs |= {"can": (*DRIVE_COLUMNS, *beside, "status", "diagnostics")}
    inputs |= {"task": ("restart", "frames", *(f"{name}_{number}" for number in range(FRAMES) for name in frame))}

    def batch(name: str, results: Sequence[Column], state: str = "") -> Batch:
        return Batch(name, inputs[name], (*results, *(_columns(software, f"{state}_t", "state") if state else ())))

    def data(name: str) -> list[Column]:
        return [Column(f"{name}[{start}..{start + 3}]", f"bytes(&{name}[{start}])") for start in starts]

    command = _columns(software, "command_t", "command")
    yield batch("controller", command, "controller")
    lookup = [Column("yaw_rate_on_road", "bits(on_road)"), Column("yaw_rate", "bits(yaw_rate)")]
    if _has(software, "map_reference_t"):
        lookup += _columns(software, "map_reference_t", "reference")
    yield batch("lookup", lookup)
    yield batch("limiter", [Column("result", "bits(result)")], "limiter")
    if f"include/{software.prefix}_reference_model.h" in files:
        yield batch("model", [], "reference_model")
    frames = [column for name in _MESSAGES for column in data(f"{name}_data")]
    kinds = ("vehicle_motion_t", "vehicle_conditions_t", "rear_steer_command_t")
    signals = [column for name, kind in zip(_MESSAGES, kinds, strict=True) for column in _columns(software, kind, name)]
    yield batch("can", [*frames, *signals])
    answer = [Column("complete", "(verify_word_t)complete"), Column("id", "(verify_word_t)id"), *data("data")]
    yield batch("task", answer, "task")


def frame_columns(batch: Batch) -> int:
    """Return the input columns of each frame in the batch "task": identifier, length, and words of data."""
    return (len(batch.inputs) - 2) // FRAMES


def _has(software: Software, kind: str) -> bool:
    return f"{software.prefix}_{kind}" in software.ffi.list_types()[0]


def _has_field(software: Software, kind: str, name: str) -> bool:
    return name in {field for field, _ in software.ffi.typeof(f"{software.prefix}_{kind}").fields}


def _columns(software: Software, kind: str, variable: str) -> list[Column]:
    """Return every number in a struct, in order, without pointers."""
    found: list[Column] = []

    def visit(declared: Any, place: str) -> None:
        if declared.kind == "struct":
            for name, field in declared.fields:
                visit(field.type, f"{place}.{name}")
        elif declared.kind == "array":
            for index in range(declared.length):
                visit(declared.item, f"{place}[{index}]")
        elif declared.kind != "pointer":
            is_real = declared.cname in ("float", "double")
            found.append(Column(place, f"bits({place})" if is_real else f"(verify_word_t){place}"))

    visit(software.ffi.typeof(f"{software.prefix}_{kind}"), variable)
    return found


def rows_of_cycles(cycles: Sequence[Cycle], batch: Batch, word: Word, restarts: Iterable[int] = (0,)) -> Rows:
    """Convert cycles to rows of the batch "task"; the task is initialised before some of them.

    A cycle with more than FRAMES frames takes several rows, of which only the last one calls the task.
    """
    starts, parts = frozenset(restarts), []
    for number, cycle in enumerate(cycles):
        split = [cycle[first : first + FRAMES] for first in range(0, max(len(cycle), 1), FRAMES)]
        parts += [((number in starts and place == 0) + 2 * (place < len(split) - 1), part) for place, part in enumerate(split)]
    rows = np.zeros((len(parts), len(batch.inputs)), dtype=word)
    columns = frame_columns(batch)
    for row, (flags, frames) in zip(rows, parts, strict=True):
        row[0] = flags
        row[1] = len(frames)
        for frame, words in zip(frames, row[2:].reshape(FRAMES, columns), strict=False):
            padded = frame.data.ljust(FRAME_WORD_BYTES * (columns - 2), b"\0")
            words[:] = (frame.id, len(frame.data), *np.frombuffer(padded, dtype="<u4"))
    return rows


class OnHost:
    """Runner in this process, compiled by the user's compiler. All runners of one program share its states.

    Raises:
        BuildError: no compiler, or C that does not compile.
    """

    name = "this machine"

    def __init__(self, program: Program) -> None:
        self._program = program
        library = compile_library(
            f"{program.prefix}_batches",
            program.sources,
            [f"{FOLDER}/batches.h"],
            include_folders=("include", FOLDER),
            flags=HOST_FLAGS,
        )
        self._ffi, self._lib = library.ffi, library.lib

    def run(self, batch: Batch, rows: Rows, parameters: int = 0) -> Rows:
        """Run rows (n, inputs) and return rows (n, outputs). `parameters`: address of their struct; 0: the default ones."""
        ffi, word = self._ffi, self._program.word
        if hasattr(self._lib, "verify_parameters"):
            self._lib.verify_parameters = ffi.cast("void *", parameters)
        given = np.ascontiguousarray(rows, dtype=word)
        results = np.empty((len(rows), len(batch.outputs)), dtype=word)
        getattr(self._lib, f"verify_batch_{batch.name}")(
            ffi.cast("verify_word_t *", ffi.from_buffer(given)),
            ffi.cast("verify_word_t *", ffi.from_buffer(results, require_writable=True)),
            len(rows),
        )
        return results


class OnTarget:
    """Runner on an emulated core, `processor`. It compiles the program with additional sources, such as a library.

    Raises:
        CodegenError: a package of the extra is missing.
        BuildError: C that does not compile; in `run`, C that leaves its memory or does not return.
    """

    def __init__(self, program: Program, core: Core = CORTEX_M4F, sources: Mapping[str, bytes] | None = None) -> None:
        entries = [f"verify_batch_{name}" for name in program.batches] + list(program.entries)
        self.name, self._program = core.name, program
        self.processor = Processor(compile_image({**program.sources, **(sources or {})}, entries, ("-O2",), core), core)
        self._word = np.dtype(f"{self.processor.byte_order}u{np.dtype(program.word).itemsize}")

    def run(self, batch: Batch, rows: Rows) -> Rows:
        """Run rows (n, inputs) and return rows (n, outputs)."""
        return np.concatenate([self._chunk(batch, part) for part in self._chunks(batch, rows)])

    def _chunks(self, batch: Batch, rows: Rows) -> Iterator[Rows]:
        size = DATA_BYTES // ((len(batch.inputs) + len(batch.outputs)) * self._word.itemsize)
        for start in range(0, max(len(rows), 1), size):
            yield rows[start : start + size]

    def _chunk(self, batch: Batch, rows: Rows) -> Rows:
        given, results = rows.astype(self._word).tobytes(), len(rows) * len(batch.outputs) * self._word.itemsize
        self.processor.write(DATA, given)
        self.processor.call(f"verify_batch_{batch.name}", DATA, DATA + len(given), len(rows))
        words = np.frombuffer(self.processor.read(DATA + len(given), results), dtype=self._word)
        return words.astype(self._program.word).reshape(len(rows), len(batch.outputs))


Runner = OnHost | OnTarget
"""Runner of batches."""

"""The generated C compiled for a Cortex-M4F so that undefined behaviour traps, and run on the emulated core.

What traps: all that clang's UndefinedBehaviorSanitizer looks for (indices, shifts, signed overflow, null pointers, values that
a bool or an enum cannot have), divisions of numbers by zero, and conversions to an integer that cannot hold the number.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from codegen.sil.software import compile_build
from codegen.verify.check import Effort, Subject
from codegen.verify.on_host import HOST_FLAGS
from codegen.verify.packages import module
from codegen.verify.pil import dynamics_bound
from codegen.verify.pil.batches import Program, dynamics_program_of, program_of
from codegen.verify.pil.check import POINTS, streams
from codegen.verify.pil.runners import OnTarget
from codegen.verify.pil.streams import Stream
from codegen.verify.target.emulator import Stray

FLAGS = (
    "-O1",
    # Separate flags: zig supports only the first of a list.
    "-fsanitize=undefined",
    "-fsanitize=float-divide-by-zero",
    "-fsanitize=float-cast-overflow",
    "-fsanitize-trap=all",
    # Otherwise all traps of a function are merged into one without a line.
    "-fno-sanitize-merge",
    "-mllvm",
    "-enable-tail-merge=false",
    "-gdwarf-4",
)

TRAP_MESSAGE = "__clang_trap_msg$"

REASONS = {"Integer divide or remainder overflowed": "Division by zero, or one whose result does not fit"}
"""Corrections of clang's messages that name only one of several cases."""

STEPS, QUICK_STEPS = 20_000, 5_000


def trapped(subject: Subject, effort: Effort) -> tuple[str, ...]:
    """Run the C of a build in single precision and return a line for each place that traps.

    Raises:
        CodegenError: a package of the extra is missing.
        BuildError: C that does not compile.
    """
    software = compile_build(subject.files, subject.manifest, flags=HOST_FLAGS)
    program = program_of(software, subject.files)
    found = _traps(program, streams(subject, software, program, QUICK_STEPS if effort.quick else STEPS), {})
    dynamics = dynamics_program_of(software, subject.files, subject.manifest["dynamics_library_functions"])
    batch = dynamics.batches["dynamics"]
    points = dynamics_bound.points(dynamics, batch, POINTS, np.random.default_rng(0))
    found |= _traps(dynamics, [Stream("dynamics", "point", batch, points)], dynamics_bound.library(software.precision))
    return tuple(f"{place}, {where}" for place, where in found.items())


def _traps(program: Program, driven: Iterable[Stream], library: Mapping[str, bytes]) -> dict[str, str]:
    """Run streams and return each trap with its first occurrence."""
    found: dict[str, str] = {}
    target = OnTarget(program, sources=library, flags=FLAGS)
    for stream in driven:
        try:
            target.run(stream.batch, stream.rows)
        except Stray as error:
            where = f"on the {target.name}; {stream.name}, {stream.row} {target.row}: {stream.format_row(target.row)}"
            found.setdefault(describe_trap(target.image, error.address), where)
    return found


def describe_trap(image: bytes, address: int) -> str:
    """Return file and line of a trap and its reason from clang's debug information; otherwise its address."""
    debug = module("elftools.elf.elffile", "pyelftools").ELFFile(io.BytesIO(image)).get_dwarf_info()
    for unit in debug.iter_CUs():
        for entry in unit.iter_DIEs():
            # clang stores the message as the name of an inlined function.
            if entry.tag == "DW_TAG_inlined_subroutine" and _holds(entry, address):
                name = entry.get_DIE_from_attribute("DW_AT_abstract_origin").attributes["DW_AT_name"].value.decode()
                if name.startswith(TRAP_MESSAGE):
                    file = _file(debug.line_program_for_CU(unit), entry.attributes["DW_AT_call_file"].value)
                    why = name.rpartition("$")[2]
                    return f"{file}:{entry.attributes['DW_AT_call_line'].value}: {REASONS.get(why, why)}"
    return f"{address:#x}: a trap"


def _holds(entry: Any, address: int) -> bool:
    low, high = (entry.attributes.get(f"DW_AT_{end}_pc") for end in ("low", "high"))
    return low is not None and high is not None and low.value <= address < low.value + high.value


def _file(program: Any, index: int) -> str:
    """Return the name of a source file as passed to the compiler. DWARF 4 counts from one."""
    entry = program.header.file_entry[index - 1]
    folder = program.header.include_directory[entry.dir_index - 1].decode() if entry.dir_index else ""
    return str(PurePosixPath(folder, entry.name.decode()))

"""Compare the C of a build with the generator's own, which is rendered again from the manifest.

Files that are not the generator's own bytes are named. The C of an edited build and the generator's C run side by side in this
process: controller, task with frames of a car and of a faulty bus, look-ups, limiter, reference model, frames and vehicle
dynamics. After every call all results, and the fields of the state that both have, must have the same bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from importlib import metadata
from typing import Any

import numpy as np

from codegen.emit.build import code_again
from codegen.errors import BuildError, CodegenError
from codegen.sil.software import Software
from codegen.sil.toolchain import compiler_command, compiler_identity
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.on_host import MightNotReturn, compiled, require_compiler, software_of
from codegen.verify.pil.batches import OnHost, Program, dynamics_program_of, program_of
from codegen.verify.pil.check import streams
from codegen.verify.pil.dynamics_bound import points
from codegen.verify.pil.streams import Stream, format_word

STEPS, QUICK_STEPS = 100_000, 20_000
POINTS = 1_000
"""Operating points of the vehicle dynamics."""

SHOWS = "The C is the generator's own, or every result of the edited C equals that of the generator's C, bit for bit"
LIMITS = (
    "The generator is the reference: a fault of its own C is in both. The tests of codegen compare that C with a second "
    "implementation of the law.",
    "The comparison of edited C runs drives with the default parameters and is not a proof.",
)
NOT_THIS_VERSION = "made by codegen {made}, and the generator here is of another version; build it again"
NOT_COMPARED = "Not the generator's own bytes, and not C for an ECU, so that only their name is reported: {files}."
EDITED = "Not the generator's own bytes: {files}."


def check(subject: Subject, effort: Effort) -> Outcome:
    """Compare the C of a build with the generator's own. Raises MissingTool: no compiler or package."""
    not_run = partial(Outcome, SHOWS, "", Verdict.NOT_RUN, limits=LIMITS)
    if not subject.is_of_this_version:
        return not_run((NOT_THIS_VERSION.format(made=subject.manifest["version"]),))
    own = code_again(subject.manifest).files
    sources = subject.sources()
    edited = sorted(path for path in own.keys() | sources.keys() if own.get(path) != sources.get(path))
    limits = [*LIMITS]
    if others := sorted(path for path in subject.edited if path not in own):
        limits.append(NOT_COMPARED.format(files=", ".join(others)))
    figures: dict[str, Any] = {"files": len(own), "edited": edited, "other_edited": others}
    if not edited:
        figure = f"all {len(own)} files of the C are the generator's own"
        return Outcome(SHOWS, figure, Verdict.PASSED, (), figures, tuple(limits))
    limits.append(EDITED.format(files=", ".join(edited)))
    require_compiler()
    reference = replace(subject, files={**subject.files, **own}, edited=())
    try:
        calls, findings = _compared(subject, reference, QUICK_STEPS if effort.quick else STEPS)
    except MightNotReturn as error:
        return not_run((str(error), *limits[len(LIMITS) :]), tools=_tools())
    except CodegenError as error:  # the C does not compile, or lacks what the generator's has
        finding = (str(error), *limits[len(LIMITS) :])
        return Outcome(SHOWS, "the C does not run", Verdict.FAILED, finding, figures, tuple(limits), _tools())
    differing = f"first differences in {len(findings)} of them" if findings else "all results are equal"
    return Outcome(
        SHOWS,
        f"{len(edited)} of {len(own)} files of the C are edited; {sum(calls.values()):,} calls in {len(calls)} streams, "
        f"{differing}",
        Verdict.FAILED if findings else Verdict.PASSED,
        tuple(findings),
        {**figures, "calls": calls},
        tuple(limits),
        _tools(),
    )


def _compared(subject: Subject, reference: Subject, steps: int) -> tuple[dict[str, int], list[str]]:
    """Run both programs on the same rows. Return the calls by stream, and the first difference of each stream.

    Raises:
        MightNotReturn: a call of the edited C might not return.
        BuildError: the edited C does not compile.
    """
    edited, own = compiled(subject), software_of(reference)
    calls: dict[str, int] = {}
    findings: list[str] = []
    pairs = ((_whole, _driven), (_dynamics, _points))
    for program, rows in pairs:
        there, here = program(edited, subject), program(own, reference)
        edited_runner, own_runner = OnHost(there), OnHost(here)
        for stream in rows(reference, own, here, steps):
            batch = there.batches[stream.batch.name]
            if batch.inputs != stream.batch.inputs:
                raise BuildError(f"{batch.name} has other inputs than in the generator's C", remedy="restore its structs")
            calls[stream.name] = len(stream.rows)
            wanted, found = own_runner.run(stream.batch, stream.rows), edited_runner.run(batch, stream.rows)
            findings += _difference(stream, wanted, replace(stream, batch=batch), found)
    return calls, findings


def _whole(software: Software, subject: Subject) -> Program:
    return program_of(software, subject.files)


def _dynamics(software: Software, subject: Subject) -> Program:
    return dynamics_program_of(software, subject.files, subject.manifest["dynamics_library_functions"])


def _driven(subject: Subject, software: Software, program: Program, steps: int) -> Iterator[Stream]:
    return streams(subject, software, program, steps)


def _points(subject: Subject, software: Software, program: Program, steps: int) -> Iterator[Stream]:
    del subject, software, steps
    batch = program.batches["dynamics"]
    yield Stream("vehicle dynamics", "point", batch, points(program, batch, POINTS, np.random.default_rng(0)))


def _difference(stream: Stream, wanted: Any, edited: Stream, found: Any) -> Iterator[str]:
    """Yield the first row with an output that differs; the fields of the state that only one of both has are left out."""
    columns = {column.name: index for index, column in enumerate(edited.batch.outputs)}
    common = [(index, columns[each.name]) for index, each in enumerate(stream.batch.outputs) if each.name in columns]
    ours, theirs = (np.array(indices) for indices in zip(*common, strict=True))
    wrong = wanted[:, ours] != found[:, theirs]
    if not wrong.any():
        return
    row = int(wrong.any(axis=1).argmax())
    place = int(wrong[row].argmax())
    output = stream.batch.outputs[ours[place]]
    words = (found[row, theirs[place]], wanted[row, ours[place]])
    values = [format_word(word) if output.is_number else hex(word) for word in words]
    yield (
        f"{stream.name}, {stream.row} {row}: {output.name} is {values[0]}, and {values[1]} by the generator's C; "
        f"{stream.format_row(row)}"
    )


def _tools() -> dict[str, str]:
    return {"C compiler of this machine": compiler_identity(compiler_command(), ())[0], "ziglang": metadata.version("ziglang")}

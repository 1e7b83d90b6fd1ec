"""Compare the C of a build with the generator's own, which is rendered again from its manifest and map.

Files that are not the generator's own bytes are named. The C of an edited build and the generator's C run side by side in this
process: controller, task with frames of a car and of a faulty bus, look-ups, limiter, reference model, frames and vehicle
dynamics; with drawn parameter sets, in drives of an hour, and from damaged states. After every call all results, and the fields
of the state that both have, must have the same bits.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from importlib import metadata
from typing import Any

import numpy as np

from codegen.emit.build import MAP_FILE, code_again
from codegen.errors import BuildError, CodegenError
from codegen.sil.software import Software
from codegen.sil.toolchain import compiler_command, compiler_identity
from codegen.verify import states, unit_drives
from codegen.verify.drives import Thresholds, places, road_frictions
from codegen.verify.dynamics_bound import points
from codegen.verify.emulated_batches import OnHost, Program, dynamics_program_of, program_of
from codegen.verify.emulated_runs import streams
from codegen.verify.emulated_streams import Stream, format_word, streams_of
from codegen.verify.long_drives import LongDrives
from codegen.verify.on_host import MightNotReturn, compiled, require_compiler, software_of
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.unit_drives import SIZE, SIZE_QUICK, Drive, UnitDrives, value_of

STEPS, QUICK_STEPS = 100_000, 20_000
POINTS = 1_000
"""Operating points of the vehicle dynamics."""

SHOWS = "The C is the generator's own, or every result of the edited C equals that of the generator's C, bit for bit"
LIMITS = (
    "The generator is the reference: a fault of its own C is in both. The tests of codegen compare that C with a second "
    "implementation of the law.",
    "The comparison of edited C runs drives and is not a proof: a fault at a few values of a signal can lie between the "
    "samples. The sets that `parameters_valid` rejects are not compared.",
    "The long drives hold single inputs, or short sequences of them. A fault that needs other inputs for hours is not found.",
)
NEVER_OTHER = "In every drawn set these parameters have their default: {names}."
NOT_THIS_VERSION = "made by codegen {made}, and the generator here is of another version; build it again"
NOT_COMPARED = "Not the generator's own bytes, and not C for an ECU, so that only their name is reported: {files}."
EDITED = "Not the generator's own bytes: {files}."


def check(subject: Subject, effort: Effort) -> Outcome:
    """Compare the C of a build with the generator's own. Raises MissingTool: no compiler or package."""
    not_run = partial(Outcome, SHOWS, "", Verdict.NOT_RUN, limits=LIMITS)
    if not subject.is_of_this_version:
        return not_run((NOT_THIS_VERSION.format(made=subject.manifest["version"]),))
    if MAP_FILE in subject.edited:
        return Outcome(SHOWS, "", Verdict.FAILED, (f"{MAP_FILE}: not the map of the build; build again",), limits=LIMITS)
    own = code_again(subject.manifest, subject.files).files
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
        sides = _Sides(subject, reference, is_quick=effort.quick)
        findings = [*sides.findings()]
    except MightNotReturn as error:
        return not_run((str(error), *limits[len(LIMITS) :]), tools=_tools())
    except CodegenError as error:  # the C does not compile, or lacks what the generator's has
        finding = (str(error), *limits[len(LIMITS) :])
        return Outcome(SHOWS, "the C does not run", Verdict.FAILED, finding, figures, tuple(limits), _tools())
    calls, sets = dict(sides.calls), sides.drives.sets
    if unchanged := unit_drives.unchanged(software_of(reference), sets):
        limits.append(NEVER_OTHER.format(names=", ".join(sorted(unchanged))))
    differing = f"{len(findings)} differences" if findings else "all results are equal"
    return Outcome(
        SHOWS,
        f"{len(edited)} of {len(own)} files of the C are edited; {sum(calls.values()):,} calls, {len(sets)} sets of "
        f"parameters, {differing}",
        Verdict.FAILED if findings else Verdict.PASSED,
        tuple(findings),
        {**figures, "calls": calls, "parameter_sets": len(sets)},
        tuple(limits),
        _tools(),
    )


Compare = Callable[..., Iterator[str]]
"""Runs a stream on both sides, with the addresses of their parameters, and yields the first difference."""


class _Sides:
    """The edited C and the generator's C, compared on the same inputs. `calls` are counted by stream."""

    def __init__(self, subject: Subject, reference: Subject, *, is_quick: bool) -> None:
        """Compile both. Raises MightNotReturn, BuildError: see `compiled`."""
        self._subject, self._reference, self._is_quick = subject, reference, is_quick
        self._edited, self._own = compiled(subject), software_of(reference)
        self.drives = UnitDrives(reference, self._own, SIZE_QUICK if is_quick else SIZE, with_recordings=not is_quick)
        self.calls: Counter[str] = Counter()

    def findings(self) -> Iterator[str]:
        """Yield differences: of default parameters and states, then the first one of each stream and drive."""
        yield from self._defaults()
        yield from self._states()
        program, sides = self._programs(lambda software, subject: program_of(software, subject.files))
        steps = QUICK_STEPS if self._is_quick else STEPS
        for stream in (*streams(self._reference, self._own, program, steps), self._places(program, steps // 10)):
            self.calls[stream.name] += len(stream.rows)
            yield from sides(stream)
        long = LongDrives(self._own, self.drives.turn, self._is_quick)
        for drive in (*self.drives.drives(), *long.drives()):
            yield from self._driven(drive, program, sides)
        functions = self._reference.manifest["dynamics_library_functions"]
        program, sides = self._programs(lambda software, subject: dynamics_program_of(software, subject.files, functions))
        batch = program.batches["dynamics"]
        rows = points(program, batch, POINTS, np.random.default_rng(0))
        self.calls["vehicle dynamics"] += len(rows)
        yield from sides(Stream("vehicle dynamics", "point", batch, rows))

    def _programs(self, program_of: Callable[[Software, Subject], Program]) -> tuple[Program, Compare]:
        """Return the program of the generator's C, and the function that runs both and yields the first difference."""
        there, here = program_of(self._edited, self._subject), program_of(self._own, self._reference)
        edited, own = OnHost(there), OnHost(here)

        def compare(stream: Stream, parameters: tuple[int, int] = (0, 0), first: int = 0) -> Iterator[str]:
            batch = there.batches[stream.batch.name]
            if batch.inputs != stream.batch.inputs:
                raise BuildError(f"{batch.name} has other inputs than in the generator's C", remedy="restore its structs")
            found, wanted = edited.run(batch, stream.rows, parameters[0]), own.run(stream.batch, stream.rows, parameters[1])
            return _difference(stream, wanted, replace(stream, batch=batch), found, first)

        return here, compare

    def _driven(self, drive: Drive, program: Program, compare: Compare) -> Iterator[str]:
        """Yield the first difference of a drive."""
        if drive.unit == "receiver":  # the task has one for each message
            return
        theirs, first = self._with_values_of(drive.parameters), 0
        addresses = (_address(self._edited, theirs), _address(self._own, drive.parameters))
        for stream in streams_of(drive, program):
            self.calls[f"drives of the {drive.unit}"] += len(stream.rows)
            if found := [*compare(stream, addresses, first)]:
                yield from found
                return
            first += len(stream.rows)

    def _with_values_of(self, parameters: Any) -> Any:
        """Return a parameter struct of the edited C with the values of one of the generator's C."""
        found = self._edited.parameters()
        for (holder, parameter, _), (own, _, _) in self._parameters(found, parameters):
            setattr(holder, parameter.name, value_of(own, parameter.name))
        return found

    def _defaults(self) -> Iterator[str]:
        """Yield each default parameter that differs."""
        where = f"src/{self._subject.prefix}_calibration.c"
        for (holder, parameter, path), (own, _, _) in self._parameters(self._edited.parameters(), self._own.parameters()):
            found, wanted = value_of(holder, parameter.name), value_of(own, parameter.name)
            if found != wanted:
                yield f"{where}: {path} is {found}, and {wanted} by the generator's C"

    def _parameters(self, theirs: Any, own: Any) -> Iterator[tuple[Any, Any]]:
        config = self._reference.config
        try:
            yield from zip(unit_drives.fields(config, theirs), unit_drives.fields(config, own), strict=True)
        except AttributeError as error:
            raise BuildError(f"a parameter is missing: {error}", remedy="restore the parameter structs") from None

    def _states(self) -> Iterator[str]:
        """Yield each member that differs after an initialisation, and those whose damage has another outcome."""
        edited, own, prefix = self._edited, self._own, self._subject.prefix
        for name in states.initialised_states(own):
            common = self._common(name)
            for theirs, ours in zip(states.initialised(edited, name), states.initialised(own, name), strict=True):
                both = (states.images(edited.ffi, theirs, common), states.images(own.ffi, ours, common))
                wrong = [path for path, *pair in zip(common, *both, strict=True) if len({*pair}) > 1]
                if wrong:
                    yield f"{prefix}_{name}_init: {', '.join(wrong)} not as after that of the generator's C"
                    break
        common = self._common("task")
        for mark in states.DAMAGED_MARKS:
            if states.started_with(edited, mark, common) != states.started_with(own, mark, common):
                yield f"src/{prefix}_task.c: another frame or state than by the generator's C, from {states.MARK} = 0x{mark:X}"
                break
        common, found = self._common("controller"), dict[str, str]()
        samples = self.drives.drive_cycle(0)
        for theirs, ours in zip(states.damages(edited, samples), states.damages(own, samples), strict=True):
            numbers = [path for path in ours.numbers if path in common]
            contents = [*((path, number) for path in numbers for number in states.UNSOUND)]
            contents += [(states.MARK, mark) for mark in states.DAMAGED_MARKS]
            for path, content in contents:
                self.calls["damaged states"] += 1
                if path not in found and theirs.outcomes(numbers, path, content) != ours.outcomes(numbers, path, content):
                    found[path] = f"{path} = {content:g} after {ours.place} samples"
        for text in found.values():
            yield f"src/{prefix}_controller.c: another outcome than by the generator's C of {text}"

    def _common(self, name: str) -> list[str]:
        """Return the members of a state that both have, without pointers."""
        theirs, ours = ({*states.fields(side.ffi, side.new(name)[0])} for side in (self._edited, self._own))
        pointers = {*states.fields(self._own.ffi, self._own.new(name)[0], "pointer")}
        return sorted((theirs & ours) - pointers)

    def _places(self, program: Program, count: int) -> Stream:
        """Return look-ups at the corners of the map, between and beyond them, on every road."""
        thresholds, generator = Thresholds.of(self._reference.manifest), np.random.default_rng(4)
        batch, precision = program.batches["lookup"], self._reference.precision
        accelerations = self._reference.manifest["map"].get("longitudinal_accelerations") or [0.0]
        roads = (road_frictions(thresholds, precision), (*accelerations, 2.0 * min(accelerations), math.nan))
        columns = [generator.choice(np.array(road), count) for road in roads[: len(batch.inputs) - 2]]
        with np.errstate(invalid="ignore"):  # arbitrary bits
            rows = np.column_stack([places(thresholds, count, precision), *columns]).astype(self._own.real).view(program.word)
        return Stream("places of the map", "call", batch, rows)


def _address(software: Software, struct: Any) -> int:
    return int(software.ffi.cast("uintptr_t", struct))


def _difference(stream: Stream, wanted: Any, edited: Stream, found: Any, first: int) -> Iterator[str]:
    """Yield the first row with an output that differs; the fields of the state that only one of both has are left out.

    `first`: number of the first row.
    """
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
        f"{stream.name}, {stream.row} {first + row}: {output.name} is {values[0]}, and {values[1]} by the generator's C; "
        f"{stream.format_row(row)}"
    )


def _tools() -> dict[str, str]:
    return {"C compiler of this machine": compiler_identity(compiler_command(), ())[0], "ziglang": metadata.version("ziglang")}

"""Command-line output of the test suites: tables, pictures, and a verdict."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from codegen import console
from codegen.errors import CheckFailed, CodegenError, suggestion
from codegen.files import resolved

if TYPE_CHECKING:
    from hil_sim.suite.cars import CarsResult
    from hil_sim.suite.requirements import Limits
    from hil_sim.suite.tracking import SuiteResult

SUITES = ("tracking", "cars")
TOLD = 3
"""Number of missed figures in the error message; the tables contain all of them."""


@dataclass(frozen=True)
class SuiteOutputs:
    """Output paths: one overview picture, or a folder for all pictures."""

    plot: Path | None
    folder: Path | None
    as_json: bool

    def check(self) -> None:
        """Reject paths that cannot be written, before anything runs. Raises CodegenError."""
        from codegen.emit.outputs import check_output

        check_output(self.plot, ".png")
        if self.folder is None:
            return
        if self.folder.exists() and not self.folder.is_dir():
            raise CodegenError("not a folder", where=self.folder, remedy="name a folder for the pictures")
        # The folder is created when there is something to write.
        place = self.folder if self.folder.is_dir() else resolved(self.folder).parent
        check_output(place / "overview.png", ".png")

    def draw(self, result: SuiteResult) -> list[Path]:
        """Write the pictures and return their paths."""
        from codegen.files import make_folder
        from codegen.report import suite_plots
        from codegen.report.style import save

        if self.plot is None and self.folder is None:
            return []
        written = []
        if self.plot is not None:
            save(suite_plots.overview_figure(result), self.plot)
            written.append(self.plot)
        if self.folder is not None:
            make_folder(self.folder)
            for name, figure in suite_plots.figures(result).items():
                save(figure, self.folder / f"{name}.png")
                written.append(self.folder / f"{name}.png")
        return written


def check_suite(suite: str) -> None:
    """Raise CodegenError for an unknown suite."""
    if suite not in SUITES:
        raise CodegenError(
            f"there is no suite {suite!r}", where="--suite", remedy=f"known: {', '.join(SUITES)}{suggestion(suite, SUITES)}"
        )


def _limits(path: Path | None) -> Limits:
    """Return the limits of a file, or the defaults. Raises CodegenError."""
    from hil_sim.suite import requirements

    return requirements.Limits() if path is None else requirements.load(path)


def run_cars_command(
    count: int, seed: int | None, build_path: Path | None, outputs: SuiteOutputs, limits_path: Path | None
) -> None:
    """Draw cars, design and simulate a controller for each, print the results, and judge them. `seed` None: development seed.

    Raises:
        CheckFailed: a car misses a limit; everything is printed before.
        CodegenError: an option that this suite does not support.
    """
    from codegen.report.suite_tables import car_failures, car_sections
    from hil_sim.suite.cars import DEVELOPMENT_SEED, run_cars

    if build_path is not None:
        raise CodegenError("the cars of this suite have builds of their own", where="--build", remedy="leave it out")
    if outputs.plot is not None or outputs.folder is not None:
        where = "--output" if outputs.plot is None else "--plot"
        raise CodegenError("this suite draws no pictures", where=where, remedy="leave it out; --json has all figures")
    limits = _limits(limits_path)
    with console.progress(f"{count} cars") as steps:
        result: CarsResult = run_cars(DEVELOPMENT_SEED if seed is None else seed, count, steps, limits)
    if outputs.as_json:
        console.print_json(result.to_dict())
    else:
        _say(f"suite cars: {count} cars of seed {result.seed}", car_sections(result), ())
    missed = car_failures(result)
    if missed:
        more = f"; and {len(missed) - TOLD} more" if len(missed) > TOLD else ""
        raise CheckFailed(
            f"{result.passed} of {count} cars meet all limits: {'; '.join(missed[:TOLD])}{more}", remedy="see the tables"
        )


def run_suite_command(build_path: Path | None, outputs: SuiteOutputs, limits_path: Path | None) -> None:
    """Run the suite "tracking", print and draw the results, and judge them.

    Raises:
        CheckFailed: a requirement is missed; everything is printed and written before.
        CodegenError: solving, tuning, building, compiling or writing fails.
    """
    from codegen.cli.bench_report import note_edited
    from codegen.report.suite_tables import failures, sections
    from hil_sim.suite.full_suite import run_full_suite
    from hil_sim.suite.subjects import of_folder, recommended

    outputs.check()
    limits = _limits(limits_path)
    candidate = recommended() if build_path is None else of_folder(build_path)
    whole = run_full_suite(candidate, instructions_of_step, console.progress, limits)
    result, written = whole.result, outputs.draw(whole.result)
    missed = failures(result.requirements)
    if outputs.as_json:
        facts = {"build": None if build_path is None else str(build_path), "candidate": candidate.title}
        notes = {"edited": list(whole.edited), "notes": list(whole.notes), "pictures": [str(path) for path in written]}
        console.print_json({**facts, **result.to_dict(), **notes})
    else:
        _say(f"suite tracking: {candidate.title}", sections(result), written)
        note_edited(build_path or Path(), whole.edited)
        for text in whole.notes:
            console.note(text)
    if missed:
        more = f"; and {len(missed) - TOLD} more" if len(missed) > TOLD else ""
        told = "1 figure misses its requirement" if len(missed) == 1 else f"{len(missed)} figures miss their requirements"
        what = f"{told}: {'; '.join(missed[:TOLD])}{more}"
        raise CheckFailed(what, where=build_path or "", remedy="see the first table")


def instructions_of_step(files: Mapping[str, bytes], manifest: Mapping[str, Any]) -> int:
    """Count the instructions of the longest step found. Raises CodegenError: see `codegen.verify.budgets.measure`."""
    from codegen.verify.budgets.measure import measure_step
    from codegen.verify.check import Effort, Subject

    count = measure_step(Subject("the tested build", files, manifest), Effort())
    return (count.instructions_with_limiter or count.instructions).max


def _say(title: str, sections: Iterable[tuple[str, str]], written: Sequence[Path]) -> None:
    console.say(title)
    for heading, text in sections:
        console.say(f"\n{heading}\n\n{text}")
    if written:
        console.say("")
    for path in written:
        console.say(f"plot: {path}")

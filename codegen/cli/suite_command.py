"""The whole test set at the command line: tables, pictures, and a verdict."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from codegen import console
from codegen.errors import CheckFailed, CodegenError, suggestion

if TYPE_CHECKING:
    from hil_sim.suite.cars import CarsResult
    from hil_sim.suite.limits import Limits
    from hil_sim.suite.tracking import SuiteResult

SUITES = ("tracking", "cars")
TOLD = 3
"""Missed figures that fit on the line of the error; all of them are in the table."""


@dataclass(frozen=True)
class SuiteOutputs:
    """Output paths: an overview, a folder for all pictures."""

    plot: Path | None
    folder: Path | None
    as_json: bool

    def check(self) -> None:
        """Refuse, before anything runs, what could not be written. Raises CodegenError."""
        from codegen.emit.outputs import check_output

        check_output(self.plot, ".png")
        if self.folder is None:
            return
        if self.folder.exists() and not self.folder.is_dir():
            raise CodegenError("not a folder", where=self.folder, remedy="name a folder for the pictures")
        # It is made when there is something to put into it.
        place = self.folder if self.folder.is_dir() else self.folder.resolve().parent
        check_output(place / "overview.png", ".png")

    def draw(self, result: SuiteResult) -> list[Path]:
        """Write the pictures; returns their paths."""
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
    from hil_sim.suite import limits

    return limits.Limits() if path is None else limits.load(path)


def run_cars_command(
    count: int, seed: int | None, build_path: Path | None, outputs: SuiteOutputs, limits_path: Path | None
) -> None:
    """Draw cars, design and drive each, print, and judge; `seed` None is that of development.

    Raises:
        CheckFailed: a car misses a limit; everything is printed before.
        CodegenError: an option that does not go with this suite.
    """
    from codegen.report.suite_tables import car_failures, car_sections
    from hil_sim.suite.cars import run_cars
    from hil_sim.suite.random_cars import DEVELOPMENT_SEED

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
    """Drive the suite "tracking", print, draw, and judge.

    Raises:
        CheckFailed: a requirement is missed; everything is printed and written before.
        CodegenError: what cannot be solved, tuned, built, compiled or written.
    """
    from codegen.report.suite_tables import failures, sections
    from hil_sim.suite.candidate import of_folder, recommended
    from hil_sim.suite.whole import run_whole

    outputs.check()
    limits = _limits(limits_path)
    candidate = recommended() if build_path is None else of_folder(build_path)
    whole = run_whole(candidate, instructions_of_step, console.progress, limits)
    result, written = whole.result, outputs.draw(whole.result)
    missed = failures(result.requirements)
    if outputs.as_json:
        facts = {"build": None if build_path is None else str(build_path), "candidate": candidate.title}
        notes = {"edited": list(whole.edited), "notes": list(whole.notes), "pictures": [str(path) for path in written]}
        console.print_json({**facts, **result.to_dict(), **notes})
    else:
        _say(f"suite tracking: {candidate.title}", sections(result), written)
        for path in whole.edited:
            console.note(f"{path} was changed after the build; it was tested as it is")
        for text in whole.notes:
            console.note(text)
    if missed:
        more = f"; and {len(missed) - TOLD} more" if len(missed) > TOLD else ""
        told = "1 figure is" if len(missed) == 1 else f"{len(missed)} figures are"
        what = f"{told} not as asked: {'; '.join(missed[:TOLD])}{more}"
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

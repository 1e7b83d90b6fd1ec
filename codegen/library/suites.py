"""Scenarios, and test suites: all cells with the baselines, random cars, and the maps of other references."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge, Interval

from codegen.errors import CheckFailed, CodegenError, suggestion
from codegen.figures import suites as suite_charts
from codegen.figures.draw import draw
from codegen.files import make_folder
from codegen.library.builds import BuildLike, edited_notes, folder_of
from codegen.library.result import PathLike, Progress, Result, Work, drawn, path_of, public
from codegen.library.verification import without_main
from codegen.report.reference_tables import reference_sections
from codegen.report.suite_tables import car_failures, car_sections, failures, sections
from codegen.verify.outcomes import Effort, Subject
from codegen.verify.resource_usage import measure_step
from hil_sim.suite import cars as random_cars
from hil_sim.suite import full_suite, references
from hil_sim.suite.cars import DEVELOPMENT_SEED
from hil_sim.suite.requirements import Limits
from hil_sim.suite.requirements import load as load_limits
from hil_sim.suite.subjects import of_folder, recommended

if TYPE_CHECKING:
    from matplotlib.figure import Figure


from dataclasses import asdict

from hil_sim.scenarios import listing

SUITES = ("tracking", "cars", "references")
NAMED = 3
"""Number of missed figures in the message of a failure; the tables contain all of them."""
CARS = 8
"""Default number of random cars."""


class Suite(Result):
    """Result of a suite.

    Attributes:
        name: "tracking", "cars" or "references".
        passed: whether all requirements are met; None for a suite that judges nothing.
        pictures: files that were written.
    """

    def __init__(
        self,
        name: str,
        title: str,
        result: Any,
        facts: Mapping[str, Any],
        more: Mapping[str, Any] | None = None,
        failure: CheckFailed | None = None,
    ) -> None:
        self.name, self.result, self.failure = name, result, failure
        self.passed = None if name == "references" else failure is None
        self.pictures: list[Path] = []
        self._title, self._facts, self._more = title, facts, more or {}

    def plot(self, path: PathLike | None = None) -> Figure:
        """Draw the overview; write a PNG if there is a path. Raises CodegenError for the suite of cars, which has none."""
        figure = self._figure()
        if figure is None:
            raise CodegenError("this suite draws no pictures", where="plot", remedy="to_dict() has all figures")
        self.pictures += [] if path is None else [Path(path)]
        return drawn(figure, path)

    def plot_all(self, folder: PathLike) -> list[Path]:
        """Write all pictures into a folder, which is created, and return their paths."""
        place = path_of(folder, "a folder")
        overview = {"overview": self.plot()}
        suite = self.result.suite if self.name == "references" else self.result
        written = []
        make_folder(place)
        shown = {name: draw(picture) for name, picture in suite_charts.pictures(suite).items()}
        for name, figure in {**shown, **overview}.items():
            drawn(figure, place / f"{name}.png")
            written.append(place / f"{name}.png")
        self.pictures += written
        return written

    def _figure(self) -> Figure | None:
        if self.name == "cars":
            return None
        if self.name == "references":
            return draw(suite_charts.references_picture(self.result))
        return draw(suite_charts.overview_picture(self.result))

    def _sections(self) -> Iterator[tuple[str, str]]:
        tables = {"tracking": sections, "cars": car_sections, "references": reference_sections}
        yield from tables[self.name](self.result)  # type: ignore[operator]

    def lines(self) -> Iterator[str]:
        """Yield the tables of all figures."""
        yield f"suite {self.name}: {self._title}"
        for heading, text in self._sections():
            yield f"\n{heading}\n\n{text}"
        if self.pictures:
            yield ""
        yield from (f"plot: {path}" for path in self.pictures)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures."""
        pictures = {} if self.name == "cars" else {"pictures": [str(path) for path in self.pictures]}
        return {**self._facts, **self.result.to_dict(), **self._more, **pictures}


@public
def suite(
    build: BuildLike | None,
    name: str = "tracking",
    *,
    cars: Annotated[int, Interval(ge=1, le=1000)] | None = None,
    seed: Annotated[int, Ge(0)] | None = None,
    limits: PathLike | None = None,
    progress: Progress | None = None,
) -> Suite:
    """Run a test suite.

    "tracking" simulates the controller and its baselines in every cell of the test set, and compares the figures with the
    requirements. "references" drives the controller in the same cells on the maps of other references; nothing is judged.
    "cars" draws plausible cars, and solves, tunes and builds a controller for each.

    Args:
        build: a build, or the path of its folder; None takes the recommended preset, and is needed for "cars".
        cars: number of random cars of "cars"; by default 8.
        seed: of the random cars; by default 1, for development. Nothing is tuned on seed 4.
        limits: TOML file of limits that differ from the suite's own.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: there is no such suite, an option belongs to another one, or solving, tuning or building fails.
    """
    if name not in SUITES:
        remedy = f"known: {', '.join(SUITES)}{suggestion(str(name), SUITES)}"
        raise CodegenError(f"there is no suite {name!r}", where="codegen suite", remedy=remedy)
    if cars is not None and name != "cars":
        raise CodegenError("random cars belong to their suite", where="`cars=`", remedy="use the suite 'cars'")
    if name == "cars":
        if build is not None:
            raise CodegenError("the cars of this suite have builds of their own", where="`build=`", remedy="leave it out")
        return _cars(CARS if cars is None else cars, DEVELOPMENT_SEED if seed is None else seed, _limits(limits), progress)
    folder = None if build is None else folder_of(build)
    if name == "tracking":
        return _tracking(folder, _limits(limits), progress)
    if limits is not None:
        raise CodegenError("this suite has no limits", where="`limits=`", remedy="leave it out")
    candidate = recommended() if folder is None else of_folder(folder)
    result = references.run_references(candidate, Work(progress, "tuning", "driving").stage)
    facts = {"build": None if folder is None else str(folder), "configuration": candidate.title}
    return Suite(name, candidate.title.split(",")[0], result, facts)


def _limits(path: PathLike | None) -> Limits:
    """Return the limits of a file, or the defaults. Raises CodegenError."""
    return Limits() if path is None else load_limits(path_of(path, "a file of limits"))


def _cars(count: int, seed: int, limits: Limits, progress: Progress | None) -> Suite:
    with Work(progress).stage(f"{count} cars") as steps, without_main():
        result = random_cars.run_cars(seed, count, steps, limits)
    failure = None
    if missed := car_failures(result):
        what = f"{result.passed} of {count} cars meet all limits: {_shortened(missed)}"
        failure = CheckFailed(what, remedy="see the tables")
    return Suite("cars", f"{count} cars of seed {result.seed}", result, {}, failure=failure)


def _tracking(folder: Path | None, limits: Limits, progress: Progress | None) -> Suite:
    candidate = recommended() if folder is None else of_folder(folder)
    work = Work(progress, "tuning", "driving", "third party's plant and instructions")
    with without_main():
        whole = full_suite.run_full_suite(candidate, instructions_of_step, work.stage, limits)
    failure = None
    if missed := failures(whole.result.requirements):
        count = len(missed)
        told = "1 figure misses its requirement" if count == 1 else f"{count} figures miss their requirements"
        failure = CheckFailed(f"{told}: {_shortened(missed)}", where=folder or "", remedy="see the first table")
    facts = {"build": None if folder is None else str(folder), "candidate": candidate.title}
    more = {"edited": list(whole.edited), "notes": list(whole.notes)}
    made = Suite("tracking", candidate.title, whole.result, facts, more, failure)
    made.notes = (*edited_notes(folder or Path(), whole.edited), *whole.notes)
    return made


def _shortened(missed: Sequence[str]) -> str:
    more = f"; and {len(missed) - NAMED} more" if len(missed) > NAMED else ""
    return f"{'; '.join(missed[:NAMED])}{more}"


def instructions_of_step(files: Mapping[str, bytes], manifest: Mapping[str, Any]) -> int:
    """Count the instructions of the longest step found. Raises CodegenError: see `codegen.verify.resource_usage`."""
    count = measure_step(Subject("the tested build", files, manifest), Effort())
    return (count.instructions_with_limiter or count.instructions).max


class Scenarios(Result):
    """The built-in scenarios; `names` lists them."""

    def __init__(self) -> None:
        self._listed = listing()
        self.names = tuple(each.name for each in self._listed)

    def lines(self) -> list[str]:
        """Return the scenarios with their descriptions, sources and bus faults."""
        lines = []
        for entry in self._listed:
            lines += [f"{entry.name}: {entry.what} ({entry.duration_s:g} s)", f"    {entry.source}"]
            lines += [f"    fault: {fault}" for fault in entry.faults]
        own = "Your own: a recorded .csv, or a .toml with base, changes and [[faults]]; see docs/interface.md."
        return [*lines, f"\n{own}"]

    def to_dict(self) -> Any:
        """Return a list of the same."""
        return [asdict(entry) for entry in self._listed]


@public
def scenarios() -> Scenarios:
    """Return the built-in scenarios."""
    return Scenarios()

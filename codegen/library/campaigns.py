"""Campaigns: thousands of cars, roads and manoeuvres in C."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from contextlib import closing, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge, Interval

from codegen.emit.folder import check_output
from codegen.errors import CodegenError
from codegen.export import runs as exported
from codegen.figures.draw import draw
from codegen.figures.draw import save as save_figure
from codegen.figures.scenarios import scenario_picture
from codegen.files import write_together
from codegen.library.builds import edited_notes
from codegen.library.result import PathLike, Progress, Result, Work, drawn, path_of, public
from codegen.map_file import map as npz
from codegen.report.campaign import again, factors_of, markdown, pictures, sections
from codegen.sil.vector import Isa
from codegen.sweep import chunk
from codegen.sweep import plan as planning
from codegen.sweep.engine import Dask, Threads, run_campaign
from codegen.sweep.plan import Plan
from codegen.sweep.store import WHOLE_COLUMNS, YES_NO, check_same
from codegen.sweep.summary import Summary, summarise
from codegen.text import text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class _Given:
    """Files of a campaign: `sweep.toml`, and the measured car."""

    spec: Path | None
    measured: Path | None

    @classmethod
    def of(cls, spec: PathLike | None, measured: PathLike | None) -> _Given:
        """Return the paths. Raises CodegenError if there is none."""
        if spec is None and measured is None:
            remedy = "give `spec=` or `measured=`"
            raise CodegenError("no factors to vary are given", where="`spec=`", remedy=remedy)
        paths = (None if path is None else path_of(path, "the path of a TOML file") for path in (spec, measured))
        return cls(*paths)

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of the stages of `read`."""
        return () if self.measured is None else ("controller",)

    def read(self, isa: Isa | None, work: Work) -> Plan:
        """Return the plan. Raises CodegenError."""
        if self.measured is None:
            return planning.read(self.spec, isa)
        with work.stage("controller", f"controller for {self.measured}") as tell:
            return planning.read(self.spec, isa, self.measured, tell)

    def command(self, *, with_folders: bool) -> str:
        """Return the beginning of the command that reads these files."""
        named = (("--spec", self.spec), ("--from", self.measured))
        words = [
            word for option, path in named if path is not None for word in (option, str(path) if with_folders else path.name)
        ]
        return f"codegen sweep {shlex.join(words)}"


class Campaign(Result):
    """A finished campaign.

    Attributes:
        folder: where its files are.
        runs_file: Parquet with a row for each run.
        map: file of the map that was made for a measured car; None without one.
        pictures: files of pictures.
        replay: beginning of the command that repeats a run.
        summary: what the runs show, as JSON values.
    """

    def __init__(self, folder: Path, runs_file: Path, plan: Plan, summary: Summary, given: _Given) -> None:
        self.folder, self.runs_file, self._plan, self._summary, self._given = folder, runs_file, plan, summary, given
        self.summary = summary.to_dict()
        self.notes = (
            *(note for each in plan.controllers for note in edited_notes(Path(each.folder), each.edited) if each.controlled),
            *plan.notes,
        )
        named = f"{given.command(with_folders=True)} -o {shlex.quote(str(folder))}"
        self.replay = f"{named} --isa {plan.isa} --replay"
        self.pictures = self._write(f"{given.command(with_folders=False)} --isa {plan.isa} --replay")
        self.map = self._write_map()

    def _write(self, replay: str) -> list[Path]:
        """Write summary.json, summary.md and the pictures. They contain no path or clock, only the name of the spec."""
        facts = (json.dumps(self.summary, indent=1, allow_nan=False) + "\n").encode()
        text = markdown(self._summary, replay).encode()
        write_together({self.folder / "summary.json": facts, self.folder / "summary.md": text})
        written = []
        for name, picture in pictures(self._summary):
            save_figure(draw(picture), self.folder / f"{name}.png")
            written.append(self.folder / f"{name}.png")
        return written

    def _write_map(self) -> Path | None:
        own = [each.own_map for each in self._plan.controllers if each.own_map is not None]
        for made in own[:1]:
            npz.save(made, self.folder / f"{made.case}.npz")
            return self.folder / f"{made.case}.npz"
        return None

    def lines(self) -> list[str]:
        """Return what the runs show, and how to repeat one."""
        plan, car = self._plan, self._plan.measured
        count = f"{self._summary.runs} runs, {plan.spec.sample_count} samples, instruction set {plan.isa}"
        lines = [f"{self.runs_file}: {count}"]
        lines += [] if car is None else [f"cars drawn from {car.name}: {', '.join(car.population.keys)}"]
        lines += [] if self.map is None else [f"controller: that of {self.map}"]
        lines += [f"\n{heading}\n\n{text}" for heading, text in sections(self._summary)]
        return [*lines, f"\n{again(self.replay)}\n", *(f"picture: {one}" for one in self.pictures)]

    def to_dict(self) -> dict[str, Any]:
        """Return the summary, and the files."""
        given, car = self._given, self._plan.measured
        facts: dict[str, Any] = {"spec": None if given.spec is None else str(given.spec)}
        if car is not None:
            facts |= {"from": str(given.measured), "varied_keys": list(car.population.keys), "notes": list(self._plan.notes)}
            facts |= {} if self.map is None else {"map": str(self.map)}
        files = {"runs_file": str(self.runs_file), "replay": self.replay}
        return {**facts, **files, **self.summary, "pictures": [str(one) for one in self.pictures]}


@public
def sweep(
    spec: PathLike | None,
    folder: PathLike,
    *,
    measured: PathLike | None = None,
    scheduler: str | None = None,
    workers: Annotated[int, Interval(ge=1, le=1024)] | None = None,
    isa: Isa | None = None,
    progress: Progress | None = None,
) -> Campaign:
    """Run a Monte Carlo or factorial campaign. An interrupted one resumes in its folder. Same spec and seed: same bytes.

    Args:
        spec: sweep.toml: what varies; None with `measured` for its default campaign.
        folder: for runs.parquet, a summary and pictures.
        measured: draw the cars from the uncertainty that `identify` wrote into this ars.toml.
        scheduler: a Dask scheduler; by default threads of this machine.
        workers: threads; by default one for each core.
        isa: vector instructions of the plant; by default the best of this machine.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: the spec is wrong, the folder is of another campaign, or a package is missing.
    """
    given, place = _Given.of(spec, measured), path_of(folder, "a folder")
    if scheduler is not None and workers is not None:
        raise CodegenError("the cluster has its own workers", where="`workers=`", remedy="leave it out")
    work = Work(progress, *given.stages, "runs", "counting")
    plan = given.read(isa, work)
    engine = nullcontext(Threads(workers)) if scheduler is None else closing(Dask(scheduler))
    with engine as chosen, work.stage("runs") as tell:
        path = run_campaign(plan, place, chosen, tell)
    with work.status("counting"):
        summary = summarise(path, plan)
    return Campaign(place, path, plan, summary, given)


class Replay(Result):
    """One run of a campaign, repeated.

    Attributes:
        row: its values by column.
        written: files by kind that were written.
    """

    def __init__(self, plan: Plan, run: int, found: chunk.Replayed) -> None:
        self._plan, self._run, self._found, self.notes = plan, run, found, plan.notes
        self.row: Mapping[str, float] = {name: value for name, value in found.row.items() if name != "run"}
        self.written: dict[str, Path] = {}

    def save(self, path: PathLike) -> None:
        """Write the run as .mf4, .parquet, .mat or .csv. Raises CodegenError."""
        place, found = path_of(path, "the path of a run"), self._found
        exported.check_formats((place,))
        check_output(place, place.suffix.lower())
        exported.save(found.records[found.controller], place, found.profile.scenario.subject)
        self.written["recording"] = place

    def plot(self, path: PathLike | None = None) -> Figure:
        """Draw the run; write a PNG if there is a path."""
        if path is not None:
            self.written = {"plot": Path(path), **self.written}
        return drawn(self._figure(), path)

    def _figure(self) -> Figure:
        row, scenario = self._found.row, self._found.profile.scenario
        settings = replace(
            scenario.settings,
            speed_km_h=round(row["speed_km_h"], 2),
            steering_wheel_angle_deg=round(row["steering_wheel_angle_deg"], 2),
            friction=round(row["friction"], 3),
            friction_estimate=round(row["friction_estimate"], 3) if "friction_estimate" in row else None,
        )
        shown = replace(scenario, settings=settings, steer_time=self._found.profile.steer_time)
        name = f"run {self._run}, {self._found.controller}"
        return draw(scenario_picture(shown, self._plan.config, self._found.records, name, factors_of(row)))

    def lines(self) -> list[str]:
        """Return the values of the run."""
        rows = [(name, ("no", "yes")[int(value)] if name in YES_NO else f"{value:.6g}") for name, value in self.row.items()]
        first = f"run {self._run}: {self._found.profile.name}, {self._found.controller}"
        return [first, text_table(("", "value"), rows), *(f"{name}: {path}" for name, path in self.written.items())]

    def to_dict(self) -> dict[str, Any]:
        """Return the same values, in the types of their columns."""
        facts = {"run": self._run, "scenario": self._found.profile.name, "controller": self._found.controller}
        row = {
            name: bool(value) if name in YES_NO else int(value) if name in WHOLE_COLUMNS else value
            for name, value in self.row.items()
        }
        return {**facts, **row}


@public
def replay(
    spec: PathLike | None,
    run: Annotated[int, Ge(0)],
    *,
    measured: PathLike | None = None,
    folder: PathLike | None = None,
    isa: Isa | None = None,
    progress: Progress | None = None,
) -> Replay:
    """Repeat one run of a campaign by its number.

    Args:
        spec, measured, isa: as for `sweep`.
        run: its number.
        folder: folder of the campaign, to reject inputs that differ from its own.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: there is no such run, or an input differs.
    """
    given = _Given.of(spec, measured)
    work = Work(progress, *given.stages, "run")
    plan = given.read(isa, work)
    if folder is not None:
        check_same(path_of(folder, "a folder"), plan)
    with work.status("run", f"run {run}"):
        return Replay(plan, run, chunk.replay(plan, run))

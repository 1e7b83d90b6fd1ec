"""The command that runs a campaign."""

from __future__ import annotations

import json
import shlex
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from codegen import console
from codegen.cli.base import cli, example, json_option, note_edited
from codegen.cli.options import configuration_file, folder_to_write, picture_to_write, run_to_write
from codegen.errors import CodegenError
from codegen.files import write_together
from codegen.text_table import text_table

if TYPE_CHECKING:
    from codegen.sil.vector import Isa
    from codegen.sweep.chunk import Replayed
    from codegen.sweep.plan import Plan
    from codegen.sweep.summary import Summary

EXAMPLE = (
    "codegen sweep --spec sweep.toml -o campaign\n  codegen sweep --spec sweep.toml --replay 4711 --plot run.png\n"
    "  codegen sweep --from identified.toml -o campaign"
)


@cli.command(short_help="Simulate thousands of cars, roads and manoeuvres.", epilog=example(EXAMPLE))
@click.option("--spec", "spec_path", type=configuration_file, metavar="TOML", help="What varies; see the guide.")
@click.option(
    "--from",
    "measured_path",
    type=configuration_file,
    metavar="TOML",
    help="Draw the cars from the uncertainty that codegen identify wrote into this file. Without --spec: 1000 cars, step steer "
    "and sine with dwell, with the controller made for this car and without.",
)
@click.option(
    "-o",
    "--output",
    type=folder_to_write,
    metavar="DIR",
    help="Folder of the campaign; an interrupted campaign resumes there. With --replay: reject inputs that differ.",
)
@click.option(
    "--scheduler", metavar="ADDRESS", help="A Dask scheduler, e.g. tcp://host:8786; by default threads of this machine."
)
@click.option("--workers", type=click.IntRange(1, 1024), metavar="N", help="Threads; by default one for each core.")
@click.option(
    "--isa",
    type=click.Choice(["x86-64-v4", "x86-64-v3", "none"]),
    help="Vector instructions of the plant; by default the best of this machine. A cluster needs one that all machines have.",
)
@click.option("--replay", type=click.IntRange(min=0), metavar="RUN", help="Repeat one run of the campaign by its number.")
@click.option("--plot", type=picture_to_write, metavar="PNG", help="With --replay: draw the run.")
@click.option(
    "--run", "run_path", type=run_to_write, metavar="FILE", help="With --replay: write it as .mf4, .parquet, .mat or .csv."
)
@json_option
def sweep(
    spec_path: Path | None,
    measured_path: Path | None,
    output: Path | None,
    scheduler: str | None,
    workers: int | None,
    isa: Isa | None,
    replay: int | None,
    plot: Path | None,
    run_path: Path | None,
    as_json: bool,
) -> None:
    """Run a Monte Carlo or factorial campaign in C, and report overshoot, sideslip and FMVSS 126 results.

    Every sample is simulated with every controller in every scenario. DIR receives runs.parquet with a row for each run, a
    summary and pictures. After Ctrl-C or a kill, the same command resumes. Same spec and seed: same bytes, with any engine.
    """
    if spec_path is None and measured_path is None:
        raise CodegenError(
            "nothing says what varies", where="--spec", remedy="give --spec sweep.toml or --from identified.toml"
        )
    given = Given(spec_path, measured_path)
    if replay is not None:
        _refuse("--replay", {"--scheduler": scheduler, "--workers": workers})
        plan = given.read(isa)
        if output is not None:
            from codegen.sweep.store import check_same

            check_same(output, plan)
        _replay(plan, replay, plot, run_path, given, as_json)
        return
    _refuse("a campaign", {"--plot": plot, "--run": run_path})
    if output is None:
        raise CodegenError("no folder is named", where="-o", remedy="name one for the campaign, or give --replay RUN")
    if scheduler is not None and workers is not None:
        raise CodegenError("the cluster has its own workers", where="--workers", remedy="leave it out")
    _campaign(given.read(isa), output, scheduler, workers, given, as_json)


@dataclass(frozen=True)
class Given:
    """Files of a campaign: `sweep.toml`, and the measured car of --from."""

    spec: Path | None
    measured: Path | None

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that were given."""
        return tuple(path for path in (self.spec, self.measured) if path is not None)

    def read(self, isa: Isa | None) -> Plan:
        """Return the plan. Raises CodegenError."""
        from codegen.sweep import plan as planning

        if self.measured is None:
            return planning.read(self.spec, isa)
        with console.progress(f"controller for {self.measured}") as progress:
            return planning.read(self.spec, isa, self.measured, progress)

    def command(self, *, with_folders: bool) -> str:
        """Return the beginning of the command that reads these files."""
        named = (("--spec", self.spec), ("--from", self.measured))
        words = [
            word for option, path in named if path is not None for word in (option, str(path) if with_folders else path.name)
        ]
        return f"codegen sweep {shlex.join(words)}"


def _refuse(what: str, given: dict[str, Any]) -> None:
    for option, value in given.items():
        if value is not None:
            raise CodegenError(f"it cannot be combined with {what}", where=option, remedy="leave it out")


def _campaign(plan: Plan, folder: Path, scheduler: str | None, workers: int | None, given: Given, as_json: bool) -> None:
    from codegen.sweep.engine import Dask, Threads, run_campaign
    from codegen.sweep.summary import summarise

    for controller in plan.controllers:
        note_edited(Path(controller.folder), controller.edited, quiet=not controller.controlled)
    engine = nullcontext(Threads(workers)) if scheduler is None else closing(Dask(scheduler))
    with engine as chosen, console.progress("runs") as progress:
        path = run_campaign(plan, folder, chosen, progress)
    with console.status("counting"):
        summary = summarise(path, plan)
    replay = f"{given.command(with_folders=True)} -o {shlex.quote(str(folder))} --isa {plan.isa} --replay"
    written = _write(folder, summary, f"{given.command(with_folders=False)} --isa {plan.isa} --replay")
    written_map = _write_map(folder, plan)
    if as_json:
        facts: dict[str, Any] = {"spec": None if given.spec is None else str(given.spec)}
        if plan.measured is not None:
            facts |= {
                "from": str(given.measured),
                "varied_keys": list(plan.measured.population.keys),
                "notes": list(plan.notes),
            }
            facts |= {} if written_map is None else {"map": str(written_map)}
        facts |= {"runs_file": str(path), "replay": replay}
        console.print_json({**facts, **summary.to_dict(), "pictures": [str(one) for one in written]})
        return
    from codegen.report.campaign import again, sections

    console.note(*plan.notes)
    console.say(f"{path}: {summary.runs} runs, {plan.spec.sample_count} samples, instruction set {plan.isa}")
    if plan.measured is not None:
        console.say(f"cars drawn from {plan.measured.name}: {', '.join(plan.measured.population.keys)}")
    if written_map is not None:
        console.say(f"controller: that of {written_map}")
    for heading, text in sections(summary):
        console.say(f"\n{heading}\n\n{text}")
    console.say(f"\n{again(replay)}\n")
    console.say(*(f"picture: {one}" for one in written))


def _write_map(folder: Path, plan: Plan) -> Path | None:
    """Write the map of the controller that was made for the measured car. Return its path; None without one."""
    from codegen.map_file import map as npz

    for controller in plan.controllers:
        if controller.own_map is not None:
            npz.save(controller.own_map, folder / f"{controller.own_map.case}.npz")
            return folder / f"{controller.own_map.case}.npz"
    return None


def _write(folder: Path, summary: Summary, replay: str) -> list[Path]:
    """Write summary.json, summary.md and the pictures. They contain no path or clock, only the name of the spec."""
    from codegen.report.campaign import markdown, pictures
    from codegen.report.style import save

    facts = (json.dumps(summary.to_dict(), indent=1, allow_nan=False) + "\n").encode()
    write_together({folder / "summary.json": facts, folder / "summary.md": markdown(summary, replay).encode()})
    written = []
    for name, picture in pictures(summary):
        save(picture, folder / f"{name}.png")
        written.append(folder / f"{name}.png")
    return written


def _replay(plan: Plan, run: int, plot: Path | None, run_path: Path | None, given: Given, as_json: bool) -> None:
    from codegen.emit.outputs import check_output
    from codegen.export import runs as exported
    from codegen.report.style import save
    from codegen.sweep.chunk import replay

    check_output(plot, ".png", given.files)
    if run_path is not None:
        exported.check_formats((run_path,))
        check_output(run_path, run_path.suffix.lower(), given.files)
    with console.status(f"run {run}"):
        found = replay(plan, run)
    if run_path is not None:
        exported.save(found.records[found.controller], run_path, found.profile.scenario.subject)
    if plot is not None:
        save(_figure(plan, found, run), plot)
    if as_json:
        row = {name: _as_stored(name, value) for name, value in found.row.items() if name != "run"}
        console.print_json({"run": run, "scenario": found.profile.name, "controller": found.controller, **row})
        return
    from codegen.sweep.store import YES_NO

    rows = [
        (name, ("no", "yes")[int(value)] if name in YES_NO else f"{value:.6g}")
        for name, value in found.row.items()
        if name != "run"
    ]
    console.note(*plan.notes)
    console.say(f"run {run}: {found.profile.name}, {found.controller}")
    console.say(text_table(("", "value"), rows))
    for name, path in (("plot", plot), ("recording", run_path)):
        if path is not None:
            console.say(f"{name}: {path}")


def _as_stored(name: str, value: float) -> float | int | bool:
    """Return a figure of a run in the type of its column in the file."""
    from codegen.sweep.store import WHOLE, YES_NO

    return bool(value) if name in YES_NO else int(value) if name in WHOLE else value


def _figure(plan: Plan, found: Replayed, run: int) -> Any:
    from dataclasses import replace

    from codegen.report.campaign import factors_of
    from codegen.report.scenario_plots import scenario_figure

    scenario = found.profile.scenario
    settings = replace(
        scenario.settings,
        speed_km_h=round(found.row["speed_km_h"], 2),
        steering_wheel_angle_deg=round(found.row["steering_wheel_angle_deg"], 2),
        friction=round(found.row["friction"], 3),
        friction_estimate=round(found.row["friction_estimate"], 3) if "friction_estimate" in found.row else None,
    )
    shown = replace(scenario, settings=settings, steer_time=found.profile.steer_time)
    return scenario_figure(shown, plan.config, found.records, f"run {run}, {found.controller}", factors_of(found.row))

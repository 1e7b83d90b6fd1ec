"""The command that runs a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import codegen
from codegen import console
from codegen.cli.base import cli, example, json_option, show
from codegen.cli.options import check_picture, configuration_file, folder_to_write, picture_to_write, run_to_write
from codegen.errors import CodegenError

if TYPE_CHECKING:
    from codegen.sil.vector import Isa

EXAMPLE = (
    "codegen sweep --spec sweep.toml -o campaign\n  codegen sweep --spec sweep.toml --replay 4711 --plot run.png\n"
    "  codegen sweep --from identified.toml -o campaign"
)


@cli.command(short_help="Simulate thousands of cars, roads and manoeuvres.", epilog=example(EXAMPLE))
@click.option("--spec", type=configuration_file, metavar="TOML", help="What varies; see the guide.")
@click.option(
    "--from",
    "measured",
    type=configuration_file,
    metavar="TOML",
    help="Draw the cars from the uncertainty that codegen identify wrote into this file. Without --spec: 1000 cars, step steer "
    "and sine with dwell, with the controller made for this car and without.",
)
@click.option(
    "-o",
    "--output",
    "folder",
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
@click.option(
    "--replay", "run", type=click.IntRange(min=0), metavar="RUN", help="Repeat one run of the campaign by its number."
)
@click.option("--plot", type=picture_to_write, metavar="PNG|SVG", help="With --replay: draw the run.")
@click.option(
    "--run", "run_path", type=run_to_write, metavar="FILE", help="With --replay: write it as .mf4, .parquet, .mat or .csv."
)
@json_option
def sweep(
    spec: Path | None,
    measured: Path | None,
    folder: Path | None,
    scheduler: str | None,
    workers: int | None,
    isa: Isa | None,
    run: int | None,
    plot: Path | None,
    run_path: Path | None,
    as_json: bool,
) -> None:
    """Run a Monte Carlo or factorial campaign in C, and report overshoot, sideslip and FMVSS 126 results.

    Every sample is simulated with every controller in every scenario. DIR receives runs.parquet with a row for each run, a
    summary and pictures. After Ctrl-C or a kill, the same command resumes. Same spec and seed: same bytes, with any engine.
    """
    from codegen.emit.folder import check_output
    from codegen.export.runs import check_formats

    if spec is None and measured is None:
        remedy = "give --spec sweep.toml or --from identified.toml"
        raise CodegenError("no factors to vary are given", where="--spec", remedy=remedy)
    if run is not None:
        _refuse("--replay", {"--scheduler": scheduler, "--workers": workers})
        check_picture(plot, (spec, measured))
        check_output(run_path, "" if run_path is None else run_path.suffix.lower(), (spec, measured))
        if run_path is not None:
            check_formats((run_path,))
        replayed = codegen.replay(spec, run, measured=measured, folder=folder, isa=isa, progress=console.shown)
        if run_path is not None:
            replayed.save(run_path)
        if plot is not None:
            replayed.plot(plot)
        show(replayed, as_json)
        return
    _refuse("a campaign", {"--plot": plot, "--run": run_path})
    if folder is None:
        raise CodegenError("no folder is named", where="-o", remedy="name one for the campaign, or give --replay RUN")
    found = codegen.sweep(
        spec,
        folder,
        measured=measured,
        scheduler=scheduler,
        workers=workers,
        isa=isa,
        progress=console.shown,
    )
    show(found, as_json)


def _refuse(what: str, given: dict[str, Any]) -> None:
    for option, value in given.items():
        if value is not None:
            raise CodegenError(f"it cannot be combined with {what}", where=option, remedy="leave it out")

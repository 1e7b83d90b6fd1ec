"""The command that writes the HTML report."""

from __future__ import annotations

from pathlib import Path

import click

from codegen import console
from codegen.cli.base import example, json_option
from codegen.cli.values import build_folder, map_file, report_to_write, result_names, scenario_names

EXAMPLE = (
    "codegen report --map generated/4ws2.npz --build generated/4ws2 -o report.html\n"
    "  codegen report --map 4ws2.npz --build generated/4ws2 --run C1=c1.csv --run bus=run.blf -o report.html"
)


@click.command(short_help="Write an HTML report of a map, a build and its runs.", epilog=example(EXAMPLE))
@click.option("--map", "map_path", required=True, type=map_file, metavar="MAP.npz")
@click.option(
    "--compare",
    multiple=True,
    type=map_file,
    metavar="MAP.npz",
    help="A map to compare with; may be repeated. By default that of the same car without rear steering.",
)
@click.option("--build", "build_path", type=build_folder, metavar="DIR", help="A folder made by codegen build.")
@click.option(
    "--run",
    "runs",
    multiple=True,
    shell_complete=result_names,
    metavar="[NAME=]FILE",
    help="A recording (.csv, .parquet, .mf4), a log of the bus (.blf, .asc, .log, .mf4), or the JSON of codegen faults; "
    "may be repeated.",
)
@click.option(
    "--scenario",
    shell_complete=scenario_names,
    metavar="NAME|FILE",
    help="Scenario of the recordings, or scenario to simulate.",
)
@click.option("--no-simulation", is_flag=True, help="Simulate nothing; show only the given files.")
@click.option("-o", "--output", required=True, type=report_to_write, metavar="HTML", help="The report to write.")
@json_option
def report(
    map_path: Path,
    compare: tuple[Path, ...],
    build_path: Path | None,
    runs: tuple[str, ...],
    scenario: str | None,
    no_simulation: bool,
    output: Path,
    as_json: bool,
) -> None:
    """Write one self-contained HTML file: maps, curves, runs, margins, faults, timing, verification, manifest.

    With --build, the C is simulated together with other controllers and the passive car, and bus faults are injected, unless
    --run provides the results. The file works offline.
    """
    from codegen.emit.outputs import check_output
    from codegen.files import write_atomically
    from codegen.report.html.gather import Request, gather, read
    from codegen.report.html.inputs import named
    from codegen.report.html.page import charts_of, render, require_plotly
    from codegen.report.html.report import sections

    require_plotly("report")
    check_output(output, ".html", (map_path, *compare, *(named(argument)[1] for argument in runs)))
    found = read(Request(map_path, compare, build_path, runs, scenario, simulate=not no_simulation))
    with console.progress("report") as progress:
        material = gather(found, progress)
        made = list(sections(material))
        content = render(f"{material.map.name}: from the map to the ECU", made)
    write_atomically(output, content)
    charts, notes = [chart.name for chart in charts_of(made)], list(material.notes)
    if as_json:
        told = {"report": str(output), "bytes": len(content), "sections": [section.name for section in made]}
        console.print_json({**told, "charts": charts, "notes": notes})
        return
    for text in notes:
        console.note(text)
    console.say(f"{output}: {len(made)} sections, {len(charts)} charts, {len(content) / 1e6:.1f} MB; open it in a browser")


COMMANDS = (report,)

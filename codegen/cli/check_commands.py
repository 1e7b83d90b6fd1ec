"""Commands that check a configuration, a map, a build, or this machine."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import codegen
from codegen import console
from codegen.cli.base import cli, example, json_option, show
from codegen.cli.options import FileType, build_folder, checked_path, configuration_file
from codegen.errors import CheckFailed

if TYPE_CHECKING:
    from codegen.doctor import Examination, Finding

EXAMPLE = "codegen check ars.toml\n  codegen check 4ws2.npz\n  codegen check generated/4ws2"


@cli.command(short_help="Check a car, a map or a build for plausibility.", epilog=example(EXAMPLE))
@click.argument("subject", metavar="ars.toml|MAP.npz|BUILD", type=checked_path)
@click.option("--config", type=configuration_file, help="For a map: ars.toml; by default the map's own configuration.")
@click.option("--drive", is_flag=True, help="Judge the car afresh, with and without the controller; changes no file.")
@json_option
def check(as_json: bool, **given: Any) -> None:
    """Check a configuration, a map or a build for implausible values and contradictions, and whether the car is better with the
    controller than without.

    The car: yaw inertia, tyre stiffness, understeer gradient. Across sections: limits against the actuator, rates, the actuator
    lag used for tuning. A map, and the build made from it: units, the share of the map that actuator and limiter reach, slip
    bounds, margins, and everything that `codegen build` rejects. A build: the same, edited files, verification results.
    `solve`, `tune` and `build` report the same warnings.

    The judgement of the car compares it with the same car with straight rear wheels: steady turns of the map, steps, sine with
    dwell and lane change. `codegen tune` makes it and stores it in the map. Where it is missing or out of date, --drive makes
    it, which takes seconds; it is printed and not stored. Exits with 1 if there is a warning.
    """
    show(codegen.check(**given, progress=console.shown), as_json)


@cli.command(epilog=example("codegen verify generated/4ws2"))
@click.argument("build", type=build_folder, metavar="DIR")
@click.option("--quick", is_flag=True, help="Run only the checks that finish in half a minute.")
@click.option(
    "--json", "json_file", type=FileType((".json",), to_write=True), metavar="FILE", help="Write the result as JSON too."
)
@click.option(
    "--requirements",
    "requirements_file",
    type=FileType((".csv",), to_write=True),
    metavar="FILE",
    help="Write the requirements with their evidence and results as CSV; with --quick, those of a recorded full run.",
)
def verify(build: Path, quick: bool, json_file: Path | None, requirements_file: Path | None) -> None:
    """Verify the C of a build.

    Compiles it for ECU cores, analyses it, runs it on emulated processors, counts its instructions, proves its bounds, and
    tests it with faults and random bytes. Writes verify.json and verify.md, the safety manual, into the build. Exits with 1
    if a check fails or none can run. A check whose tool is missing is reported as not run.
    """
    from codegen.emit.folder import check_output

    check_output(json_file, ".json", (build,))
    check_output(requirements_file, ".csv", (build,))
    found = codegen.verify(build, quick=quick, progress=console.shown)
    if json_file is not None:
        found.save(json_file)
    if requirements_file is not None:
        found.save_requirements(requirements_file)
    show(found, False)


COLOURS = {"good": "green", "missing": "yellow", "bad": "red"}


@cli.command(short_help="Check the installation and list missing optional tools.", epilog=example("codegen doctor"))
@json_option
def doctor(as_json: bool) -> None:
    """Check the installation: packages, optional tools, extras that are missing, and buses, each tried with a frame.

    Exits with 1 if something that codegen sil needs is missing.
    """
    from codegen.doctor import examine

    with console.status("checking the installation"):
        found = examine()
    if as_json:
        console.print_json(found.to_dict())
    else:
        console.say(*_lines(found))
    if found.stopping:
        names = ", ".join(finding.name for finding in found.stopping)
        raise CheckFailed(f"codegen sil cannot work: {names}", remedy=found.stopping[0].remedy)


def _lines(found: Examination) -> Iterator[str | console.Coloured]:
    names = max(len(finding.name) for section in found.sections for finding in section.findings)
    for number, section in enumerate(found.sections):
        yield from ("", section.title) if number else (section.title,)
        for finding in section.findings:
            yield from _of(finding, names)


def _of(finding: Finding, width: int) -> Iterator[str | console.Coloured]:
    after = f"  {finding.name:<{width}}  {finding.what}"
    yield console.Coloured("  ", f"{finding.state:<7}", after, COLOURS[finding.state])
    margin = " " * (13 + width)
    if finding.state != "good" and finding.serves:
        yield f"{margin}for {finding.serves}"
    if finding.remedy:
        yield f"{margin}-> {finding.remedy}"

"""Command that identifies a car from measured drives."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from codegen import console
from codegen.cli.base import cli, example, json_option
from codegen.cli.options import (
    FileType,
    FiniteRange,
    channel_option,
    configuration_file,
    database_option,
    drive_log,
    folder_to_write,
    report_to_write,
    signals_option,
)
from codegen.errors import CodegenError
from codegen.text_table import text_table

if TYPE_CHECKING:
    from codegen.identify.drive_plan import DrivePlan
    from codegen.identify.outcome import Outcome
    from codegen.identify.reading import Reading

ACCELERATION_DEFAULT, DURATION_DEFAULT = 4.0, 180.0
"""Limits of --plan: m/s^2, the range in which the car is about linear; and s."""


@cli.command(
    short_help="Identify a car from measured drives.",
    epilog=example(
        "codegen identify --log drive1.mf4 --log drive2.blf --dbc car.dbc --signals names.toml --check\n"
        "  codegen identify --config ars.toml --log drive1.mf4 --hold-out drive2.mf4 -o identified.toml --report found.html\n"
        "  codegen identify --config ars.toml --plan plan --lateral-acceleration-max 4 --report plan.html"
    ),
)
@click.option("--config", "config_path", type=configuration_file, help="ars.toml: known values, and a guess of the others.")
@click.option(
    "--log",
    "logs",
    multiple=True,
    type=drive_log,
    metavar="FILE",
    help="A measured drive: .mf4, .blf, .asc, .log (candump), .csv or .parquet; may be repeated.",
)
@click.option(
    "--hold-out",
    "held_out",
    multiple=True,
    type=drive_log,
    metavar="FILE",
    help="A measured drive that is only predicted, to validate the result; may be repeated.",
)
@database_option
@channel_option
@signals_option
@click.option(
    "-o",
    "--output",
    type=FileType((".toml",), to_write=True),
    metavar="TOML",
    help="The ars.toml to write: that of --config with the identified values.",
)
@click.option("--report", "report_path", type=report_to_write, metavar="HTML", help="Also write a report.")
@click.option("--check", "check_only", is_flag=True, help="Only read the drives and report what was found in them.")
@click.option(
    "--plan",
    "plan_path",
    type=folder_to_write,
    metavar="DIR",
    help="Instead of identifying, propose drives, and write them into this folder as scenarios of the bench.",
)
@click.option(
    "--lateral-acceleration-max",
    type=FiniteRange(min=0.5, max=20.0),
    metavar="M/S2",
    help=f"Largest lateral acceleration of the drives of --plan; by default {ACCELERATION_DEFAULT:g}.",
)
@click.option(
    "--duration",
    type=FiniteRange(min=1.0, max=3600.0),
    metavar="S",
    help=f"Largest duration of the drives of --plan together; by default {DURATION_DEFAULT:g}.",
)
@json_option
def identify(
    config_path: Path | None,
    logs: tuple[Path, ...],
    held_out: tuple[Path, ...],
    databases: tuple[Path, ...],
    channel: str | None,
    names_path: Path | None,
    output: Path | None,
    report_path: Path | None,
    check_only: bool,
    plan_path: Path | None,
    lateral_acceleration_max: float | None,
    duration: float | None,
    as_json: bool,
) -> None:
    """Identify tyres, yaw inertia, steering and rear actuator of a car from measured drives.

    The drives are read first: signals, gaps, offsets, faults; --check stops there. Samples of faults have no value in what
    follows. A quantity that the drives do not determine keeps its configured value, and the missing manoeuvre is named.
    Standard deviations and correlations are written into [identified]. The guide describes names.toml.

    With --plan, no drive is read. The drives that determine the configured car best, within a lateral acceleration and a
    duration, are chosen and written as scenarios, and the standard deviations are predicted.
    """
    from codegen.configuration import CONFIG_BYTES_MAX, load
    from codegen.emit.outputs import check_output
    from codegen.errors import ConfigError, within
    from codegen.files import read_text, write_together
    from codegen.identify.names import Names, load_names
    from codegen.identify.reading import read_drives

    _check_options(
        plan_path is not None,
        {
            "--log": logs,
            "--hold-out": held_out,
            "--dbc": databases,
            "--channel": channel,
            "--output": output,
            "--check": check_only,
        },
        {"--lateral-acceleration-max": lateral_acceleration_max, "--duration": duration},
    )
    for option, path in (("--output", output), ("--report", report_path)):
        if check_only and path is not None:
            where = f"codegen identify {option}"
            raise CodegenError("it cannot be combined with --check, which writes no file", where=where, remedy="leave one out")
    if plan_path is not None:
        largest = lateral_acceleration_max or ACCELERATION_DEFAULT, duration or DURATION_DEFAULT
        _plan(plan_path, config_path, largest, names_path, report_path, as_json)
        return
    if not check_only and (config_path is None or output is None):
        missing = "--config" if config_path is None else "--output"
        raise CodegenError("is missing", where=f"codegen identify {missing}", remedy="give --config and -o, or --check")
    inputs = (config_path, names_path, *logs, *held_out, *databases)
    check_output(output, ".toml", inputs)
    check_output(report_path, ".html", inputs)
    if report_path is not None:
        from codegen.report.html.page import require_plotly

        require_plotly("identify")
    names = load_names(names_path) if names_path is not None else Names()
    if channel is not None:
        names = names.model_copy(update={"channel": channel})
    config = None if check_only or config_path is None else load(config_path)
    with console.status(f"reading {', '.join(path.name for path in (*logs, *held_out))}"):
        reading = read_drives([*logs, *held_out], databases, names)
    if config is None or config_path is None or output is None:
        if as_json:
            console.print_json(reading_as_json(reading))
            return
        print_reading(reading)
        if names_path is None:
            of_channel = [] if channel is None else [f'channel = "{channel}"']
            console.say("", "names.toml of these signals:", "", *of_channel, reading.names_toml.rstrip())
        return

    from codegen.identify.findings import refuse_contradictions
    from codegen.identify.outcome import identify_and_predict
    from codegen.identify.result import identified_toml
    from codegen.identify.summary import to_dict

    refuse_contradictions(reading.findings)
    drives, others = reading.drives[: len(logs)], reading.drives[len(logs) :]
    with within(", ".join(map(str, logs))), console.status("identifying"):
        outcome = identify_and_predict(config, drives, others)
    text = read_text(config_path, CONFIG_BYTES_MAX, "name an ars.toml", ConfigError)
    written = identified_toml(outcome.found, text, config_path, outcome.doubts)
    contents = {output: written.encode("utf-8")}
    if report_path is not None:
        with console.status("writing the report"):
            contents[report_path] = _report(written, output, reading, outcome)
    write_together(contents)
    if as_json:
        files = {"output": str(output), "report": None if report_path is None else str(report_path)}
        console.print_json({**reading_as_json(reading), **to_dict(outcome), **files})
        return
    _print_result(reading, outcome, output)
    console.say("", f"written: {output}", *([] if report_path is None else [f"report: {report_path}"]))


def _check_options(is_plan: bool, for_drives: Mapping[str, object], for_plan: Mapping[str, object]) -> None:
    """Reject options of the other use of the command. Raises CodegenError."""
    for option, value in (for_drives if is_plan else for_plan).items():
        if value not in (None, (), False):
            what = "it cannot be combined with --plan" if is_plan else "it belongs to --plan"
            raise CodegenError(what, where=f"codegen identify {option}", remedy="leave it out" if is_plan else "add --plan DIR")
    if not is_plan and not for_drives["--log"]:
        raise CodegenError("is missing", where="codegen identify --log", remedy="name a measured drive, or give --plan DIR")


def _plan(
    folder: Path,
    config_path: Path | None,
    limits: tuple[float, float],
    names_path: Path | None,
    report_path: Path | None,
    as_json: bool,
) -> None:
    """Write a measurement programme. `limits`: lateral acceleration in m/s^2, duration in s."""
    from codegen.configuration import load
    from codegen.emit.folder import Folder
    from codegen.emit.outputs import check_output, refuse_folder
    from codegen.emit.write import check_target, write_folder
    from codegen.errors import within
    from codegen.files import write_atomically
    from codegen.identify.drive_plan import plan_drives, signals_of
    from codegen.identify.names import load_names
    from codegen.identify.plan_output import MANIFEST_WHAT, files_of, to_dict

    if config_path is None:
        raise CodegenError("is missing", where="codegen identify --config", remedy="name the ars.toml of the car")
    check_target(folder, "--plan")
    refuse_folder(folder, MANIFEST_WHAT, "a measurement programme", "--plan")
    check_output(report_path, ".html", (config_path, names_path))
    if report_path is not None:
        from codegen.report.html.page import require_plotly

        require_plotly("identify")
    signals = signals_of(None if names_path is None else load_names(names_path))
    config = load(config_path)
    with within(config_path), console.status("choosing drives"):
        plan = plan_drives(config, *limits, signals)
    facts = to_dict(plan)
    write_folder(Folder(files_of(plan), {"what": MANIFEST_WHAT, "plan": facts}), folder)
    if report_path is not None:
        from codegen.report.html.drive_plan import plan_sections
        from codegen.report.html.page import render

        write_atomically(report_path, render("Measurement programme", plan_sections(plan)))
    if as_json:
        files = {"folder": str(folder), "report": None if report_path is None else str(report_path)}
        console.print_json({**facts, **files})
        return
    _print_plan(plan)
    console.say("", f"written: {folder}", *([] if report_path is None else [f"report: {report_path}"]))
    console.say(f"try a drive: codegen sil --build DIR --scenario {folder / plan.names[0]}.csv")


def _print_plan(plan: DrivePlan) -> None:
    from codegen.identify.plan_output import DRIVE_HEADER, PREDICTED_HEADER, drive_rows, need_lines, predicted_rows

    console.say(text_table(DRIVE_HEADER, drive_rows(plan), left=2), "")
    console.say(text_table(PREDICTED_HEADER, predicted_rows(plan)))
    if lines := need_lines(plan):
        console.say("", "not determined, and what it needs:", *(f"  {line}" for line in lines))
    console.say("", "A tyre curve is determined with its D.")


def _report(
    text: str,
    path: Path,
    reading: Reading,
    outcome: Outcome,
) -> bytes:
    """Return the report of a written `text`, the content of `path`."""
    from codegen.configuration import parse
    from codegen.report.html.identify import data_section, identify_sections
    from codegen.report.html.page import render

    sections = identify_sections(outcome, parse(tomllib.loads(text), path))
    return render("Identification", [*sections, data_section(reading)])


def _print_result(reading: Reading, outcome: Outcome, output: Path) -> None:
    from codegen.identify import summary

    found, validations = outcome.found, outcome.validations
    console.warn(*(str(finding) for finding in reading.findings), *(f"in doubt: {doubt}" for doubt in outcome.doubts))
    if outcome.doubts:
        console.note(
            f"tune, solve --uncertain and sweep --from refuse {output.name} until it has identified.doubts_accepted = true"
        )
    console.note(*found.notes)
    rows = summary.quantity_rows(found)
    console.say(text_table(summary.QUANTITY_HEADER[:-1], [row[:-1] for row in rows]))
    if missing := [(row[0], row[-1]) for row in rows if row[-1]]:
        console.say("", *(f"{name}: {note}" for name, note in missing))
    if together := [direction.text for direction in found.directions if len(direction.components) > 1]:
        console.say("", "not told apart by these drives:", *(f"  {text}" for text in together))
    console.say("", *summary.reached_lines(outcome), "")
    console.say(text_table(summary.VALIDATION_HEADER, summary.validation_rows(validations), left=2))
    console.say(summary.whiteness_line(validations))
    if not outcome.is_held_out:
        console.note("no drive was held out; the errors are those of the drives that were fitted")


def print_reading(reading: Reading) -> None:
    """Print the sources of all signals, and the findings."""
    from codegen.identify.summary import FINDING_HEADER, SIGNAL_HEADER, finding_rows, signal_rows

    for drive in reading.drives:
        duration = float(drive.time[-1] - drive.time[0])
        console.say(f"{drive.name}: {duration:.1f} s, {drive.time.size} steps of {1e3 * (drive.time[1] - drive.time[0]):g} ms")
    console.say("", text_table(SIGNAL_HEADER, signal_rows(reading), left=4), "")
    if not reading.findings:
        console.say("no findings")
        return
    console.say(text_table(FINDING_HEADER, finding_rows(reading), left=5))


def reading_as_json(reading: Reading) -> dict[str, Any]:
    """Return the same facts for JSON."""
    from codegen.logs.account import to_dict

    drives = [
        {
            "name": drive.name,
            "duration_s": float(drive.time[-1] - drive.time[0]),
            "step_s": float(drive.time[1] - drive.time[0]),
            "signals": {key: dataclasses.asdict(source) for key, source in sources.items()},
            "account": to_dict(account),
        }
        for drive, sources, account in zip(reading.drives, reading.sources, reading.accounts, strict=True)
    ]
    return {"drives": drives, "findings": [dataclasses.asdict(each) for each in reading.findings]}

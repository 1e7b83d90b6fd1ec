"""Command that identifies a car from measured drives."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

import codegen
from codegen import console
from codegen.cli.base import cli, example, json_option, show
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


@cli.command(
    short_help="Identify a car from measured drives.",
    epilog=example(
        "codegen identify --log drive1.mf4 --log drive2.blf --dbc car.dbc --signals names.toml --check\n"
        "  codegen identify --config ars.toml --log drive1.mf4 --hold-out drive2.mf4 -o identified.toml --report found.html\n"
        "  codegen identify --config ars.toml --plan plan --lateral-acceleration-max 4 --report plan.html"
    ),
)
@click.option("--config", type=configuration_file, help="ars.toml: known values, and a guess of the others.")
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
    "folder",
    type=folder_to_write,
    metavar="DIR",
    help="Instead of identifying, propose drives, and write them into this folder as scenarios of the bench.",
)
@click.option(
    "--lateral-acceleration-max",
    type=FiniteRange(min=0.5, max=20.0),
    metavar="M/S2",
    help="Largest lateral acceleration of the drives of --plan; by default 4.",
)
@click.option(
    "--duration",
    type=FiniteRange(min=1.0, max=3600.0),
    metavar="S",
    help="Largest duration of the drives of --plan together; by default 180.",
)
@json_option
def identify(
    config: Path | None,
    logs: tuple[Path, ...],
    hold_out: tuple[Path, ...],
    dbc: tuple[Path, ...],
    channel: str | None,
    signals: Path | None,
    output: Path | None,
    report_path: Path | None,
    check_only: bool,
    folder: Path | None,
    lateral_acceleration_max: float | None,
    duration: float | None,
    as_json: bool,
) -> None:
    """Identify tyres, yaw inertia, steering and rear actuator of a car from measured drives.

    The drives are read first: signals, gaps, offsets, faults; --check stops there. Samples with faults are treated as missing.
    A quantity that the drives do not determine keeps its configured value, and the missing manoeuvre is named. Standard
    deviations and correlations are written into [identified]. The guide describes names.toml.

    With --plan, no drive is read. The drives that determine the configured car best, within a lateral acceleration and a
    duration, are chosen and written as scenarios, and the standard deviations are predicted.
    """
    from codegen.emit.folder import check_output
    from codegen.library.identification import refuse_plan_folder, require_report

    _check_options(
        folder is not None,
        {
            "--log": logs,
            "--hold-out": hold_out,
            "--dbc": dbc,
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
    inputs = (config, signals, *logs, *hold_out, *dbc)
    if folder is not None:
        if config is None:
            raise CodegenError("is missing", where="codegen identify --config", remedy="name the ars.toml of the car")
        refuse_plan_folder(folder)
    elif not check_only and (config is None or output is None):
        missing = "--config" if config is None else "--output"
        raise CodegenError("is missing", where=f"codegen identify {missing}", remedy="give --config and -o, or --check")
    check_output(output, ".toml", inputs)
    check_output(report_path, ".html", inputs)
    if report_path is not None:
        require_report()
    if config is None or check_only:
        show(
            codegen.read_drives(logs + hold_out, dbc, channel=channel, signals=signals, progress=console.shown),
            as_json,
        )
        return
    if folder is not None:
        limits = {"lateral_acceleration_max": lateral_acceleration_max, "duration": duration}
        given = {name: value for name, value in limits.items() if value is not None}
        plan = codegen.plan_drives(config, **given, signals=signals, progress=console.shown)
        plan.save(folder, report_path)
        show(plan, as_json)
        return
    assert output is not None
    found = codegen.identify(
        config,
        logs,
        hold_out=hold_out,
        dbc=dbc,
        channel=channel,
        signals=signals,
        progress=console.shown,
    )
    with console.status("writing"):
        found.save(output, report_path)
    show(found, as_json)


def _check_options(is_plan: bool, for_drives: Mapping[str, object], for_plan: Mapping[str, object]) -> None:
    """Reject options of the other use of the command. Raises CodegenError."""
    for option, value in (for_drives if is_plan else for_plan).items():
        if value not in (None, (), False):
            what = "it cannot be combined with --plan" if is_plan else "it belongs to --plan"
            raise CodegenError(what, where=f"codegen identify {option}", remedy="leave it out" if is_plan else "add --plan DIR")
    if not is_plan and not for_drives["--log"]:
        raise CodegenError("is missing", where="codegen identify --log", remedy="name a measured drive, or give --plan DIR")

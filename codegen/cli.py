"""The `codegen` command: parse, call, print. What it calls is imported where it is used, so that `--help` stays quick."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

import click

from codegen import __version__, console
from codegen.errors import CheckFailed, CodegenError, one_line, within

if TYPE_CHECKING:
    from codegen.refmap.map import ReferenceMap

EXIT_BAD_INPUT = 2
EXIT_INTERNAL = 70
EXIT_INTERRUPTED = 130

LATERAL_ACCELERATION_NOTE_G = 1.5
"""Maps that ask for more than this are built, but their user is asked about the units."""

json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
file_type = click.Path(path_type=Path)


def example(text: str) -> str:
    """An epilog that click prints as it is."""
    return f"\b\nExample:\n  {text}"


@click.group(context_settings={"help_option_names": ["-h", "--help"]}, epilog=example("codegen init my-car"))
@click.version_option(__version__, prog_name="codegen")
@click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error.")
def cli() -> None:
    """From vehicle data to checked C for active rear steering."""


@cli.command(short_help="Make DIR/ars.toml to edit.", epilog=example("codegen init my-car && cd my-car"))
@click.argument("folder", metavar="DIR", type=file_type)
def init(folder: Path) -> None:
    """Make DIR/ars.toml, the paper's vehicle with comments and units, to edit."""
    from codegen.config import preset_text
    from codegen.files import make_folder, write_atomically

    path = folder / "ars.toml"
    if path.exists() or path.is_symlink():
        raise CodegenError("already there and left as it is", where=path, remedy="name another folder, or edit that file")
    make_folder(folder)
    write_atomically(path, preset_text().encode("utf-8"))
    console.say(f"{path}: the paper's vehicle, to edit; next: codegen solve --config {path} --case 4ws-2 -o 4ws2.npz")


@cli.command(
    short_help="Solve one case and write the map.", epilog=example("codegen solve --config ars.toml --case 4ws-2 -o 4ws2.npz")
)
@click.option("--config", "config_path", type=file_type, help="ars.toml; by default the paper's preset.")
@click.option("--case", "case", required=True, metavar="NAME", help="fws, 4ws-1, 4ws-2 or a case of your own.")
@click.option("-o", "--output", required=True, type=file_type, metavar="MAP.npz", help="The map to write.")
@click.option(
    "--method",
    type=click.Choice(["exact", "ipopt"]),
    default="exact",
    show_default=True,
    help="Closed form, or IPOPT point by point (the reference).",
)
@json_option
def solve(config_path: Path | None, case: str, output: Path, method: str, as_json: bool) -> None:
    """Solve the optimisation of one case on the configured grid and write the map."""
    from codegen.emit.outputs import check_output
    from codegen.refmap import map as npz
    from codegen.refmap.choose import choose_config
    from codegen.refmap.solve import solve_case
    from codegen.report.summary import map_summary

    check_output(output, ".npz", (config_path,))
    chosen = choose_config(None, config_path)
    with within(config_path or "the paper's preset"), console.progress(f"solving {case}") as progress:
        reference_map = solve_case(chosen.config, case, "ipopt" if method == "ipopt" else "exact", progress)
    npz.save(reference_map, output)
    summary = map_summary(reference_map)
    if as_json:
        console.print_json({"map": str(output), "configuration": chosen.source, **summary.to_dict()})
        return
    for text in chosen.notes:
        console.note(text)
    if config_path is None:
        console.note("no --config: the paper's preset is taken")
    console.say(f"{output}: {summary.headline}")


@cli.command(short_help="Tell what a map holds, and draw it.", epilog=example("codegen show 4ws2.npz --plot map.png"))
@click.argument("map_path", metavar="MAP.npz", type=file_type)
@click.option("--plot", "plot", type=file_type, metavar="PNG", help="Also draw the map.")
@json_option
def show(map_path: Path, plot: Path | None, as_json: bool) -> None:
    """Tell what a map holds: axes, units, ranges, feasibility, what binds where."""
    from codegen.emit.outputs import check_output
    from codegen.refmap import map as npz
    from codegen.report.summary import map_summary, table

    check_output(plot, ".png", (map_path,))
    reference_map = npz.load(map_path)
    summary = map_summary(reference_map)
    if plot is not None:
        from codegen.report import plots

        plots.save(plots.map_figure(reference_map, map_path.stem), plot)
    if as_json:
        console.print_json({"map": str(map_path), **summary.to_dict(), "plot": None if plot is None else str(plot)})
        return
    _note_lateral_acceleration(reference_map)
    console.say(f"{map_path}: {summary.headline}")
    console.say(table(("", "from", "to", "unit", "points"), summary.axis_rows))
    console.say("")
    console.say(table(("", "from", "to", "unit"), summary.value_rows))
    if summary.binding_rows:
        console.say("")
        console.say(table(("what binds", "cells", "share"), summary.binding_rows))
    if plot is not None:
        console.say(f"\nplot: {plot}")


@cli.command(short_help="Generate the C of a map.", epilog=example("codegen build --map 4ws2.npz"))
@click.option("--map", "map_path", required=True, type=file_type, metavar="MAP.npz")
@click.option("--config", "config_path", type=file_type, help="ars.toml; by default the map's own configuration.")
@click.option("-o", "--output", type=file_type, metavar="DIR", help="By default generated/<name of the map>.")
@click.option("--prefix", default="ars", show_default=True, help="Start of all C names.")
@click.option("--precision", type=click.Choice(["single", "double"]), default="single", show_default=True)
@click.option("--check", is_flag=True, help="Write nothing; exit 1 where DIR is not up to date.")
@json_option
def build(
    map_path: Path,
    config_path: Path | None,
    output: Path | None,
    prefix: str,
    precision: str,
    check: bool,
    as_json: bool,
) -> None:
    """Generate the C of a map: controller, lookup, dynamics, CMake, README, manifest."""
    from codegen.emit.folder import differences
    from codegen.emit.from_files import prepare
    from codegen.emit.write import write_folder

    prepared = prepare(map_path, config_path, output, prefix, "double" if precision == "double" else "single")
    if not as_json:
        for text in prepared.chosen.notes:
            console.note(text)
        _note_lateral_acceleration(prepared.reference_map)
    target, files = prepared.target, [*sorted(prepared.folder.files), "manifest.json"]
    if check:
        found = differences(prepared.folder, target)
        if as_json:
            console.print_json({"build": str(target), "up_to_date": not found, "differences": found})
        if found:
            more = f" and {len(found) - 1} more" if len(found) > 1 else ""
            raise CheckFailed(f"not up to date: {found[0]}{more}", where=target, remedy="run the same command without --check")
        if not as_json:
            console.say(f"{target}: up to date")
        return
    changed = write_folder(prepared.folder, target)
    result = {"build": str(target), "changed": changed, "files": files, "configuration": prepared.chosen.source}
    if as_json:
        console.print_json({**result, "notes": list(prepared.chosen.notes)})
        return
    state = "" if changed else " (unchanged)"
    console.say(f"{target}: {len(files)} files{state}; start with {target / 'README.md'}")


@cli.command(
    short_help="Run the generated C in closed loop.",
    epilog=example("codegen sil --build generated/4ws2 --plot run.png --csv run.csv"),
)
@click.option("--build", "build_path", required=True, type=file_type, metavar="DIR", help="A folder made by codegen build.")
@click.option("--map", "map_path", type=file_type, metavar="MAP.npz", help="Take the car of this map instead of the build's.")
@click.option("--scenario", "scenario", default="step-steer", show_default=True, metavar="NAME")
@click.option("--plot", "plot", type=file_type, metavar="PNG", help="Draw the run beside the passive car.")
@click.option("--csv", "csv", type=file_type, metavar="CSV", help="Write the run, units in the column names.")
@json_option
def sil(build_path: Path, map_path: Path | None, scenario: str, plot: Path | None, csv: Path | None, as_json: bool) -> None:
    """Run the generated C in closed loop with the two-track plant, software in the loop."""
    from codegen.emit.outputs import check_output
    from codegen.refmap import map as npz
    from codegen.report import plots
    from codegen.report.summary import step_rows, table
    from codegen.sil.software import load
    from hil_sim.metrics import step_metrics
    from hil_sim.recording import save_csv
    from hil_sim.runs import run
    from hil_sim.scenarios import find

    check_output(plot, ".png", (map_path,))
    check_output(csv, ".csv", (map_path,))
    manoeuvre = find(scenario)
    config = npz.load(map_path).config if map_path is not None else None
    if map_path is not None and config is None:
        console.note(f"{map_path} brings no car; the build's own is taken")
    software = load(build_path, config)
    if not software.selftest():
        raise CheckFailed("the generated self-test fails", where=build_path, remedy="build again with `codegen build`")
    runs = {"controlled": run(software, manoeuvre), "passive": run(software, manoeuvre, controlled=False)}
    metrics = {name: step_metrics(record, manoeuvre.steer_time) for name, record in runs.items()}
    if csv is not None:
        save_csv(runs["controlled"], csv)
    if plot is not None:
        plots.save(plots.run_figure(runs, f"{build_path.resolve().name}: {manoeuvre.title}"), plot)
    if as_json:
        console.print_json(
            {
                "build": str(build_path),
                "scenario": manoeuvre.name,
                "edited": list(software.edited),
                "metrics": {name: values.to_dict() for name, values in metrics.items()},
            }
        )
        return
    for path in software.edited:
        console.note(f"{build_path / path} was changed after the build; this run uses it as it is")
    console.say(f"{build_path}: {manoeuvre.title}")
    console.say(table(("", *metrics), step_rows(tuple(metrics.values()))))
    for title, written in (("plot", plot), ("recording", csv)):
        if written is not None:
            console.say(f"{title}: {written}")


@cli.command(short_help="Reproduce the paper's tables and plots.", epilog=example("codegen paper -o build"))
@click.option("-o", "--output", required=True, type=file_type, metavar="DIR", help="Where maps, C, plots and runs go.")
@json_option
def paper(output: Path, as_json: bool) -> None:
    """Reproduce the paper: solve its three maps, build the C, run C1 and C2, print its tables beside ours."""
    from codegen.report.paper import reproduce

    result = reproduce(output)
    if as_json:
        console.print_json(result.to_dict())
        return
    for line in result.lines():
        console.say(line)


def _note_lateral_acceleration(reference_map: ReferenceMap) -> None:
    import numpy as np

    largest = float(np.nanmax(reference_map.speed[:, np.newaxis] * reference_map.yaw_rate)) / 9.81
    if largest > LATERAL_ACCELERATION_NOTE_G:
        console.note(f"the map asks for up to {largest:.2g} g of lateral acceleration; is vx in m/s and yaw_rate in rad/s?")


def main() -> NoReturn:
    """Entry point: one line for each error, and the exit codes of the interface (0, 1, 2)."""
    # Taken out here, so that it may stand anywhere, and so that an error in the other words is shown in full too.
    arguments = [argument for argument in sys.argv[1:] if argument != "--debug"]
    debug = len(arguments) < len(sys.argv) - 1
    signal.signal(signal.SIGTERM, _terminate)
    try:
        cli.main(arguments, standalone_mode=False)
        if sys.stdout is not None:  # closed by the caller
            sys.stdout.flush()
    except CodegenError as error:
        _fail(f"error: {error}", error.exit_code, debug)
    except click.exceptions.Exit as error:
        raise SystemExit(error.exit_code) from None
    except (click.Abort, KeyboardInterrupt):
        _fail("interrupted; nothing is left half-written", EXIT_INTERRUPTED, debug)
    except click.exceptions.NoArgsIsHelpError as error:
        print(error.format_message(), file=sys.stderr)
        raise SystemExit(EXIT_BAD_INPUT) from None
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        hint = f"; see `{context.command_path} --help`" if context is not None else ""
        _fail(f"error: {one_line(error.format_message()).rstrip('.')}{hint}", EXIT_BAD_INPUT, debug)
    except BrokenPipeError:
        # The reader of our output went away, as `| head` does: no error, and nothing more to say.
        sys.stdout = None
        raise SystemExit(0) from None
    except OSError as error:
        _fail(f"error: {one_line(error)}; check the path, the permissions and the disk", EXIT_BAD_INPUT, debug)
    except Exception as error:
        _fail(f"internal error: {one_line(repr(error))}; run it again with --debug and report it", EXIT_INTERNAL, debug)
    raise SystemExit(0)


def _fail(text: str, code: int, debug: bool) -> NoReturn:
    if debug:
        raise
    print(text, file=sys.stderr)
    raise SystemExit(code)


def _terminate(number: int, frame: FrameType | None) -> None:
    del frame
    # An exception, so that what is under way cleans up after itself.
    raise SystemExit(128 + number)

"""Commands that show a map: as text and picture, as an HTML report, and on a local page to explore its settings."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Iterator
from html import escape
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

import codegen
from codegen import console
from codegen.cli.base import cli, example, in_options, json_option
from codegen.cli.base import show as show_result
from codegen.cli.options import (
    build_folder,
    channel_option,
    check_picture,
    configuration_file,
    folder_to_write,
    map_file,
    picture_to_write,
    report_to_write,
    result_names,
    scenario_names,
)
from codegen.errors import CodegenError
from codegen.files import read_text, resolved

if TYPE_CHECKING:
    from codegen.explore.server import ExploreServer
    from codegen.explore.toml_file import Target


SHOW_EXAMPLE = "codegen show 4ws2.npz --plot map.png\n  codegen show 4ws2.npz --against nonlinear.npz --plot difference.png"


@cli.command(short_help="Print the contents of a map, or plot it.", epilog=example(SHOW_EXAMPLE))
@click.argument("map", metavar="MAP.npz", type=map_file)
@click.option("--plot", type=picture_to_write, metavar="PNG|SVG", help="Draw the map, both maps, or error against flash.")
@click.option(
    "--against", "second", type=map_file, metavar="OTHER.npz", help="Print the changes from this map to another one instead."
)
@click.option(
    "--flash",
    is_flag=True,
    help="Print the flash size of chosen breakpoints for errors from 1 to 0.02 deg/s instead; takes minutes.",
)
@click.option("--config", type=configuration_file, help="With --flash: ars.toml with the kind of controller.")
@json_option
def show(map: Path, plot: Path | None, second: Path | None, flash: bool, config: Path | None, as_json: bool) -> None:
    """Print a map: axes, units, ranges, feasibility and binding constraints, and the judgement of the car."""

    check_picture(plot, (map, config, second))
    if second is not None and flash:
        raise CodegenError("cannot be combined with --flash", where="--against", remedy="leave one of them out")
    if config is not None and not flash:
        raise CodegenError("has no effect here", where="--config", remedy="add --flash, or leave it out")
    found: codegen.Map | codegen.Difference | codegen.FlashSizes
    if flash:
        found = codegen.flash_sizes(map, config, progress=console.shown)
    elif second is not None:
        found = codegen.compare(map, second, progress=console.shown)
    else:
        found = codegen.load_map(map)
    if plot is not None:
        with console.status("drawing"):
            found.plot(plot)
    show_result(found, as_json, plot)


REPORT_EXAMPLE = (
    "codegen report --map generated/4ws2.npz --build generated/4ws2 -o report.html\n"
    "  codegen report --map 4ws2.npz --build generated/4ws2 --run C1=c1.csv --run bus=run.blf -o report.html"
)


@cli.command(short_help="Write an HTML report of a map, a build and its runs.", epilog=example(REPORT_EXAMPLE))
@click.option("--map", required=True, type=map_file, metavar="MAP.npz")
@click.option(
    "--compare",
    multiple=True,
    type=map_file,
    metavar="MAP.npz",
    help="A map to compare with; may be repeated. By default that of the same car without rear steering.",
)
@click.option("--build", type=build_folder, metavar="DIR", help="A folder made by codegen build.")
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
@channel_option
@click.option(
    "--no-simulation", "simulate", flag_value=False, default=True, help="Simulate nothing; show only the given files."
)
@click.option("-o", "--output", "path", required=True, type=report_to_write, metavar="HTML", help="The report to write.")
@json_option
def report(as_json: bool, **given: Any) -> None:
    """Write one self-contained HTML file: maps, curves, runs, margins, faults, timing, verification, manifest.

    With --build, the C is simulated together with other controllers and the passive car, and bus faults are injected, unless
    --run provides the results. The file works offline.
    """
    show_result(codegen.report(**given, progress=console.shown), as_json)


@cli.command(
    short_help="Change settings on a local web page; see map and margins.", epilog=example("codegen explore --map 4ws2.npz")
)
@click.option("--map", required=True, type=map_file, metavar="MAP.npz", help="A map made by codegen solve.")
@click.option("--config", type=configuration_file, help="ars.toml; by default the map's own configuration.")
@click.option(
    "--folder",
    type=folder_to_write,
    metavar="DIR",
    help="Where the page's button writes ars.toml; by default the current folder.",
)
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, show_default=True, help="On 127.0.0.1; 0 selects a free port."
)
@click.option("--no-browser", is_flag=True, help="Only print the address.")
def explore(map: Path, config: Path | None, folder: Path | None, port: int, no_browser: bool) -> None:
    """Serve a page on this computer to change lambda, limits, friction and gains, until interrupted.

    Each change solves the map again and simulates the step response with the generated C. A button writes ars.toml.
    """
    from codegen.explore.explorer import opened
    from codegen.explore.server import ExploreServer
    from codegen.report.html.page import require_plotly

    require_plotly("explore")
    target = _target(folder, config)
    explorer = opened(map, config)
    console.note(*[in_options(note) for note in explorer.notes])
    with ExploreServer(explorer, target, port) as server:
        _serve(server, browser=not no_browser)


def _target(folder: Path | None, config_path: Path | None) -> Target:
    from codegen.configuration import CONFIG_BYTES_MAX
    from codegen.explore.server import CONFIGURATION_FILE
    from codegen.explore.toml_file import Target, preset_bases

    place = folder or Path()
    if not place.is_dir():
        raise CodegenError("there is no such folder", where=place, remedy="create it first, or name another --folder")
    own: tuple[str, ...] = ()
    if config_path is not None and config_path.is_file():
        with contextlib.suppress(CodegenError):  # loading the configuration later reports the error
            own = (read_text(config_path, CONFIG_BYTES_MAX, ""),)
    return Target(resolved(place) / CONFIGURATION_FILE, (*own, *preset_bases()))


def _serve(server: ExploreServer, *, browser: bool) -> None:
    """Serve until SIGINT or SIGTERM."""
    ended = threading.Event()

    def end(number: int, frame: FrameType | None) -> None:
        del number, frame
        ended.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGINT)}
    serving = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
    serving.start()
    try:
        console.say(f"{server.address}\nCtrl-C ends it.")
        sys.stdout.flush()
        with _opened(server.address) if browser else contextlib.nullcontext():
            ended.wait()
    finally:
        server.shutdown()
        serving.join()
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _opened(address: str) -> Iterator[None]:
    """Open an address in the user's browser, through a file that redirects to it and is deleted at the end.

    Every user of the computer can read the arguments of a process, and the address contains the key of the page. Only this user
    can read the file and its folder.
    """
    with contextlib.ExitStack() as stack:
        try:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="ars-explore-", ignore_cleanup_errors=True)))
            shown = _show(_leading_to(address, folder))
        except OSError:
            shown = False  # no space for the file, or no browser; the address is printed
        if not shown:
            console.note("no browser was opened; open the address in a browser on this computer")
        yield


def _leading_to(address: str, folder: Path) -> Path:
    """Write a page that opens the address into the folder, readable only by this user, and return its path."""
    path = folder / "open.html"
    path.touch(mode=0o600)
    link = escape(address)
    path.write_text(
        f'<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={link}">'
        f'<title>Explore</title><a href="{link}">Explore</a>\n',
        encoding="utf-8",
    )
    return path


def _show(page: Path) -> bool:
    """Open the page in a browser and return whether one started. Requires a display: a text browser would take the terminal."""
    import webbrowser

    screen = sys.platform in ("darwin", "win32") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(screen) and webbrowser.open(page.as_uri())

"""The command that serves the explorer."""

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
from typing import TYPE_CHECKING

import click

from codegen import console
from codegen.cli.base import example
from codegen.cli.values import configuration_file, folder_to_write, map_file
from codegen.errors import CodegenError

if TYPE_CHECKING:
    from codegen.explore.server import ExploreServer
    from codegen.explore.toml_file import Target


@click.command(
    short_help="Change settings on a local web page; see map and margins.", epilog=example("codegen explore --map 4ws2.npz")
)
@click.option("--map", "map_path", required=True, type=map_file, metavar="MAP.npz", help="A map made by codegen solve.")
@click.option("--config", "config_path", type=configuration_file, help="ars.toml; by default the map's own configuration.")
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
def explore(map_path: Path, config_path: Path | None, folder: Path | None, port: int, no_browser: bool) -> None:
    """Serve a page on this computer to change lambda, limits, friction and gains, until interrupted.

    Each change solves the map again and simulates the step response with the generated C. A button writes ars.toml.
    """
    from codegen.explore.explorer import opened
    from codegen.explore.server import ExploreServer
    from codegen.report.html.page import require_plotly

    require_plotly("explore")
    target = _target(folder, config_path)
    explorer = opened(map_path, config_path)
    for text in explorer.notes:
        console.note(text)
    with ExploreServer(explorer, target, port) as server:
        _serve(server, browser=not no_browser)


def _target(folder: Path | None, config_path: Path | None) -> Target:
    from codegen.configuration import CONFIG_BYTES_MAX
    from codegen.explore.page import FILE
    from codegen.explore.toml_file import Target, preset_bases
    from codegen.files import read_text, resolved

    place = folder or Path()
    if not place.is_dir():
        raise CodegenError("there is no such folder", where=place, remedy="create it first, or name another --folder")
    own: tuple[str, ...] = ()
    if config_path is not None and config_path.is_file():
        with contextlib.suppress(CodegenError):  # loading the configuration later reports the error
            own = (read_text(config_path, CONFIG_BYTES_MAX, ""),)
    return Target(resolved(place) / FILE, (*own, *preset_bases()))


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


COMMANDS = (explore,)

"""The explorer, from the slider to the picture: its computation against a build made afresh, and all of it in Chromium.

The whole default grid, the recommended controller of the committed map. In the browser the time runs from the slider's input
event until Plotly has drawn all pictures; the peer there is the aim, 200 ms.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import statistics
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from benchmarks.machine import load
from benchmarks.timing import Comparison, Report, Times, interleaved
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.explore.explorer import Explorer, opened
from codegen.explore.server import ExploreServer
from codegen.explore.toml_file import Target
from codegen.optimum.solve import solve_case
from codegen.sil.closed_loop import ClosedLoop
from codegen.sil.software import compile_build
from hil_sim.scenario_files import find

MAP = Path(__file__).resolve().parents[1] / "generated" / "4ws2.npz"
REPEATS, QUICK_REPEATS = 5, 2
MOVES, QUICK_MOVES = 40, 10
AIM_S = 0.2
MOVED = {
    "lambda": ("lambda", 300.0, 3000.0),
    "limit": ("limits.rear_angle_max_deg", 1.0, 3.5),
    "friction": ("road.friction", 0.4, 1.0),
    "gain": ("proportional_percent", 50.0, 150.0),
}
"""Kind of slider -> its setting, and between which values it goes."""

MOVE_AND_WAIT = """([key, places]) => new Promise((done) => {
    const slider = document.querySelector(`[data-key="${key}"] input[type=range]`);
    const taken = [];
    let began = 0;
    const move = () => {
        const share = places[taken.length];
        slider.value = Number(slider.min) + share * (Number(slider.max) - Number(slider.min));
        began = performance.now();
        slider.dispatchEvent(new Event("input"));
    };
    const drawn = (event) => {
        taken.push([performance.now() - began, event.detail.server]);
        if (taken.length < places.length) {
            requestAnimationFrame(() => requestAnimationFrame(move));
        } else {
            document.removeEventListener("explorer-drawn", drawn);
            done(taken);
        }
    };
    document.addEventListener("explorer-drawn", drawn);
    move();
})"""


def run(quick: bool, say: Callable[[str], None]) -> Report:
    """Measure both. Without Chromium and Playwright, the computation alone."""
    with _own_cache():
        explorer = opened(MAP)
        comparisons = []
        for kind, moved in MOVED.items():
            say(f"computing, {kind}")
            comparisons.append(_computing(explorer, kind, moved, QUICK_REPEATS if quick else REPEATS))
        in_browser, note = _in_browser(explorer, QUICK_MOVES if quick else MOVES, say)
    notes = (
        "afresh: solve, render the build, compile it with the plant, drive; the explorer also draws the start and the margins.",
        note,
    )
    return Report("Explorer, 101 x 100 operating points, kind tracking", (*comparisons, *in_browser), notes)


@contextlib.contextmanager
def _own_cache() -> Iterator[None]:
    """Use an empty, temporary cache."""
    before = os.environ.get("ARS_CACHE")
    with tempfile.TemporaryDirectory(prefix="ars-bench-") as folder:
        os.environ["ARS_CACHE"] = folder
        try:
            yield
        finally:
            os.environ.pop("ARS_CACHE")
            if before is not None:
                os.environ["ARS_CACHE"] = before


def _computing(explorer: Explorer, kind: str, moved: tuple[str, float, float], repeats: int) -> Comparison:
    values = _values(moved, 4 * (repeats + 1))

    def ours() -> None:
        explorer.picture(next(values))

    def afresh() -> None:
        config = explorer.configured(next(values))
        reference_map = solve_case(config, explorer.case)
        folder = build(reference_map, config, BuildOptions("afresh"), BuildInputs("map.npz", "0" * 64, "map"))
        ClosedLoop(compile_build(folder.files, folder.manifest)).run(find("step-steer").inputs(config))

    times = interleaved({"afresh": afresh, "explorer": ours}, repeats)
    return Comparison(f"{kind}, computing", times["afresh"], times["explorer"])


def _values(moved: tuple[str, float, float], count: int) -> Iterator[Mapping[str, float]]:
    """Yield distinct settings, none of which has been compiled before."""
    key, low, high = moved
    return iter([{key: low + (high - low) * (number + 0.5) / count} for number in range(count)])


def _in_browser(explorer: Explorer, moves: int, say: Callable[[str], None]) -> tuple[list[Comparison], str]:
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        chromium = None
    if chromium is None:
        return [], "in the browser: not measured, Chromium or Playwright is missing"
    with tempfile.TemporaryDirectory() as folder, _served(explorer, Path(folder)) as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--enable-unsafe-swiftshader"])
        page = browser.new_page(viewport={"width": 1440, "height": 1000})
        page.goto(address)
        page.wait_for_selector("#pictures[data-drawn]")
        taken = {}
        for kind, (key, _, _) in MOVED.items():
            say(f"in Chromium, {kind}")
            taken[kind] = _moved(page, key, moves)
        browser.close()
    computing = statistics.median(server for pairs in taken.values() for _, server in pairs)
    aim = Times("the aim", (AIM_S,))
    comparisons = [
        Comparison(
            f"{kind}, slider to picture", aim, Times("Chromium", tuple(all_ / 1e3 for all_, _ in pairs)), 1.0, paired=False
        )
        for kind, pairs in taken.items()
    ]
    return (
        comparisons,
        f"in the browser: {moves} moves each, {computing:.0f} ms of them computing (median); {load()} at the end",
    )


def _moved(page: Any, key: str, moves: int) -> list[tuple[float, float]]:
    """Return the time of each move until everything is drawn, and the server's share, in ms; the first two moves are not
    counted."""
    places = [0.3 + 0.4 * (number * 0.618034 % 1.0) for number in range(moves + 2)]  # to and fro, never the same
    taken: list[tuple[float, float]] = page.evaluate(MOVE_AND_WAIT, [key, places])
    return taken[2:]


@contextlib.contextmanager
def _served(explorer: Explorer, folder: Path) -> Iterator[str]:
    with ExploreServer(explorer, Target(folder / "ars.toml")) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield server.address
        finally:
            server.shutdown()
            thread.join()

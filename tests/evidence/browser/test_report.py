"""The report in headless Chromium, opened from disk."""

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from codegen.figures.data import Chart
from codegen.map_file import map as npz
from codegen.report.html.gather import Request, gather, read
from codegen.report.html.page import Section, charts_of, render
from codegen.report.html.report import sections
from hil_sim.codec import Frame
from hil_sim.logs import BusLog

from .conftest import PageMonitor

GENERATED = Path(__file__).resolve().parents[3] / "generated"
CUTS = ["cut-over-speed", "cut-over-angle"]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """Write a report with every section; return its path and the ids of its charts."""
    folder = tmp_path_factory.mktemp("report")
    with BusLog(folder / "bus.blf") as log:
        for cycle in range(50):
            for identifier, after in ((0x101, 0.0), (0x102, 1e-4), (0x201, 4e-3)):
                time = 0.01 * cycle + 1e-4 * (cycle % 7) ** 2 + after * (1 + cycle % 3)
                log.write(Frame(identifier, bytes(8), time), received=identifier == 0x201)
    build = GENERATED / "4ws2"
    request = Request(GENERATED / "4ws2.npz", build=build, runs=[str(folder / "bus.blf")])
    made = list(sections(gather(read(request), lambda done, total: None)))
    path = folder / "report.html"
    path.write_bytes(render("A report", made))
    return path, [*CUTS, *(f"chart-{chart.name}" for chart in charts_of(made))]


ALL_DRAWN = "[...document.querySelectorAll('main details')].every(each => each.open && each.dataset.drawn)"


def opened(page: Any, path: Path) -> Any:
    """Return a page with all sections unfolded and drawn."""
    page.goto(path.as_uri())
    page.wait_for_selector("html[data-drawn=yes]")
    page.click("#unfold")
    page.wait_for_function(ALL_DRAWN)
    return page


@pytest.fixture(scope="module")
def page(chromium: Any, report: tuple[Path, list[str]]) -> Any:
    """Open the report at the width of a laptop. Tests restore its state."""
    made = chromium.new_page(viewport={"width": 1440, "height": 900}, color_scheme="light")
    made.watch = PageMonitor(made)
    yield opened(made, report[0])
    made.close()


def test_every_chart_is_drawn_without_errors_or_requests(page: Any, report: tuple[Path, list[str]]) -> None:
    """A chart is drawn if pixels well inside its frame differ in colour from its background."""
    assert len(report[1]) > 20
    for name in report[1]:
        shown = page.locator(f"#{name}")
        assert shown.locator("svg.main-svg").count() > 0, name
        shown.scroll_into_view_if_needed()
        picture = np.asarray(Image.open(io.BytesIO(shown.screenshot())).convert("RGB")).astype(int)
        height, width, _ = picture.shape
        inside = picture[height // 5 : -height // 5, width // 5 : -width // 5]
        assert float(np.mean(np.abs(inside - inside[0, 0]).max(axis=2) > 40)) > 0.001, f"{name} is empty"
    assert page.watch.errors == []
    assert {request.partition(":")[0] for request in page.watch.requests} <= {"file", "blob", "data"}
    assert sum(request.startswith("file:") for request in page.watch.requests) == 1
    assert page.locator(".modebar-btn").count() == 0  # Plotly has buttons that upload a chart


def test_the_verdict_fills_the_first_screen_and_a_link_unfolds_its_section(
    chromium: Any, report: tuple[Path, list[str]]
) -> None:
    """The folded page is at most a third of the 17,000 px of the unfolded one."""
    page = chromium.new_page(viewport={"width": 1440, "height": 900}, color_scheme="light")
    page.goto(report[0].as_uri())
    page.wait_for_selector("html[data-drawn=yes]")
    assert page.evaluate("document.documentElement.scrollHeight") <= 17_000 / 3
    box = page.locator("#verdict").bounding_box()
    assert box["y"] + box["height"] <= 900
    assert page.locator("main details[open]").count() == 1
    page.click("nav a[href='#margins']")
    page.wait_for_function("document.querySelector('#margins details').dataset.drawn === 'yes'")
    assert page.locator("#chart-margins svg.main-svg").count() > 0
    page.close()


@pytest.mark.parametrize(("slider", "moved", "other"), [("cut-speed", *reversed(CUTS)), ("cut-angle", *CUTS)])
def test_a_slider_moves_its_cut_by_keyboard(page: Any, slider: str, moved: str, other: str) -> None:
    values = "id => JSON.stringify(document.getElementById(id).data.map(t => [t.name ?? '', Array.from(t.y ?? []).flat()]))"
    label, table = page.inner_text(f"#{slider}-value"), page.inner_text("#cut-values")
    before, still = page.evaluate(values, moved), page.evaluate(values, other)
    page.focus(f"#{slider}")
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    for name, text in (("cut-values", table), (f"{slider}-value", label)):
        page.wait_for_function("([id, text]) => document.getElementById(id).textContent !== text", arg=[name, text])
    spoken = "id => document.getElementById(id).getAttribute('aria-valuetext')"
    page.wait_for_function(f"id => ({spoken})(id) === document.getElementById(id + '-value').textContent", arg=slider)
    page.wait_for_function(f"([id, old]) => ({values})(id) !== old", arg=[moved, before])
    assert page.evaluate(values, other) == still
    for _ in range(5):
        page.keyboard.press("ArrowLeft")
    page.wait_for_function("([id, text]) => document.getElementById(id).textContent === text", arg=[f"{slider}-value", label])


def test_values_shown_are_those_of_the_map(page: Any) -> None:
    one = npz.load(GENERATED / "4ws2.npz")
    speed, angle = (float(page.inner_text(f"#{name}-value").split()[0]) for name in ("cut-speed", "cut-angle"))
    row = int(np.argmin(np.abs(one.speed * 3.6 - speed)))
    column = int(np.argmin(np.abs(np.degrees(one.front_angle) - angle)))
    cells = page.locator("#cut-values tr").nth(1).locator("td").all_inner_texts()
    # Three digits after the point.
    assert float(cells[0].split()[0]) == pytest.approx(np.degrees(one.yaw_rate[row, column]), abs=6e-4)
    chart = page.locator("#chart-map-yaw-rate")
    chart.scroll_into_view_if_needed()
    box = chart.locator(".nsewdrag").first.bounding_box()
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 0.8 * box["height"])
    label = chart.locator(".hovertext").first
    label.wait_for()
    assert re.search(r"Yaw rate r: \d+\.\d+ deg/s", label.text_content())
    page.mouse.move(0, 0)


def test_names_of_runs_cannot_inject_script(chromium: Any, tmp_path: Path) -> None:
    names = ["constructor", "toString", "@ink"]
    data = [{"type": "scatter", "x": [0, 1], "y": [0, k], "name": name} for k, name in enumerate(names)]
    path = tmp_path / "names.html"
    path.write_bytes(render("names", [Section("s", "s", [Chart("c", {"data": data, "layout": {}}, "c", "c")])]))
    assert opened(chromium.new_page(), path).locator(".legendtext").all_text_contents()[:2] == names[:2]


def test_themes_widths_and_paper(page: Any) -> None:
    ink, ground = "getComputedStyle(document.querySelector('#chart-margins .xtitle')).fill", "document.body"
    light = page.evaluate(ink)
    page.click("#theme")
    page.wait_for_function(f"{ink} !== '{light}'")
    assert page.evaluate(f"getComputedStyle({ground}).backgroundColor") == "rgb(20, 23, 27)"
    page.click("#theme")
    page.wait_for_function(f"{ink} === '{light}'")
    for width in (390, 820, 1440):
        page.set_viewport_size({"width": width, "height": 900})
        # The charts resize after the page.
        page.wait_for_function("width => document.documentElement.scrollWidth <= width", arg=width)
        assert page.evaluate("innerWidth") == width
    page.emulate_media(media="print", color_scheme="dark")
    page.wait_for_function("document.querySelector('#chart-manifest, #chart-margins')._fullLayout.width === 660")
    assert page.evaluate(f"getComputedStyle({ground}).backgroundColor") == "rgb(255, 255, 255)"
    assert page.evaluate("getComputedStyle(document.querySelector('nav')).display") == "none"
    page.emulate_media(media="screen", color_scheme="light")
    page.wait_for_function("document.getElementById('chart-margins')._fullLayout.width > 700")

"""The report as its reader sees it: in headless Chromium, from disk."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from codegen.report.html.gather import Request, gather, read
from codegen.report.html.page import charts_of, render
from codegen.report.html.report import sections
from hil_sim.frames import Frame
from hil_sim.logs import BusLog

from .conftest import Watch

GENERATED = Path(__file__).resolve().parents[2] / "generated"
BUILD = GENERATED / "4ws2-tracking"
WIDTHS = (390, 820, 1440)
CUTS = ["cut-over-speed", "cut-over-angle"]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A report with everything in it, and the ids of its charts."""
    folder = tmp_path_factory.mktemp("report")
    with BusLog(folder / "bus.blf") as log:
        for cycle in range(50):
            for identifier, after in ((0x101, 0.0), (0x102, 1e-4), (0x201, 4e-3)):
                late = 1e-4 * (cycle % 7) ** 2
                log.write(
                    Frame(identifier, bytes(8), 0.01 * cycle + late + after * (1 + cycle % 3)), received=identifier == 0x201
                )
    request = Request(GENERATED / "4ws2-tracking.npz", build=BUILD, runs=[str(folder / "bus.blf")])
    made = list(sections(gather(read(request), lambda done, total: None)))
    path = folder / "report.html"
    path.write_bytes(render("A report", made))
    return path, [*CUTS, *(f"chart-{chart.name}" for chart in charts_of(made))]


def opened(page: Any, path: Path) -> Any:
    page.goto(path.as_uri())
    page.wait_for_selector("html[data-printable=yes]", timeout=120_000)
    return page


@pytest.fixture(scope="module")
def page(chromium: Any, report: tuple[Path, list[str]]) -> Any:
    """The report at a laptop's width. Tests leave it as they find it."""
    made = chromium.new_page(viewport={"width": 1440, "height": 900}, color_scheme="light")
    made.watch = Watch()
    made.watch.follow(made)
    yield opened(made, report[0])
    made.close()


def values(page: Any, chart: str) -> Any:
    """The numbers that a chart draws."""
    script = "id => document.getElementById(id).data.map(t => [t.name ?? '', Array.from(t.y ?? []).flat()])"
    return page.evaluate(script, chart)


def next_frame(page: Any) -> None:
    """Wait until what was asked so far is shown: the page draws once for each frame, however many keys came before it."""
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def test_every_chart_is_drawn(page: Any, report: tuple[Path, list[str]]) -> None:
    """Something of it is seen: pixels of another colour than its ground, well inside its frame."""
    assert len(report[1]) > 20
    for name in report[1]:
        shown = page.locator(f"#{name}")
        assert shown.locator("svg.main-svg").count() > 0, name
        shown.scroll_into_view_if_needed()
        picture = np.asarray(Image.open(io.BytesIO(shown.screenshot())).convert("RGB")).astype(int)
        height, width, _ = picture.shape
        inside = picture[height // 5 : -height // 5, width // 5 : -width // 5]
        share = float(np.mean(np.abs(inside - inside[0, 0]).max(axis=2) > 40))
        assert share > 0.001, f"{name} is empty"


def test_no_button_can_send_a_chart_away(page: Any, report: tuple[Path, list[str]]) -> None:
    """Plotly has buttons for its own cloud."""
    assert page.locator(".modebar-btn").count() == 0
    addresses = page.evaluate("names => names.map(n => document.getElementById(n)._context.plotlyServerURL)", report[1])
    assert set(addresses) == {""}


def test_nothing_is_asked_of_the_network_and_nothing_goes_wrong(page: Any) -> None:
    """Pictures for paper are made of blobs of the page itself."""
    assert page.watch.errors == []
    assert {request.partition(":")[0] for request in page.watch.requests} <= {"file", "blob", "data"}
    assert sum(request.startswith("file:") for request in page.watch.requests) == 1


def test_the_watch_hears_what_goes_wrong(chromium: Any, watch: Watch) -> None:
    page = watch.follow(chromium.new_page())
    page.set_content("<script>console.error('heard'); fetch('http://127.0.0.1:9/seen').catch(() => 0); nosuch();</script>")
    page.wait_for_function("true")
    assert any("heard" in error for error in watch.errors)
    assert any("nosuch" in error for error in watch.errors)
    assert any(request.endswith("/seen") for request in watch.requests)
    page.close()


@pytest.mark.parametrize("slider", ["cut-speed", "cut-angle"])
def test_a_slider_moves_the_cut_by_keyboard(page: Any, slider: str) -> None:
    moved, other = ("cut-over-angle", "cut-over-speed") if slider == "cut-speed" else ("cut-over-speed", "cut-over-angle")
    told, before, still = page.inner_text(f"#{slider}-value"), values(page, moved), values(page, other)
    table = page.inner_text("#cut-values")
    page.focus(f"#{slider}")
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    next_frame(page)
    changed = "([id, text]) => document.getElementById(id).textContent !== text"
    page.wait_for_function(changed, arg=["cut-values", table])
    page.wait_for_function(changed, arg=[f"{slider}-value", told])
    assert page.get_attribute(f"#{slider}", "aria-valuetext") == page.inner_text(f"#{slider}-value")
    page.wait_for_function(
        "([id, old]) => JSON.stringify(document.getElementById(id).data.map(t => [t.name ?? '', Array.from(t.y ?? []).flat()]))"
        " !== JSON.stringify(old)",
        arg=[moved, before],
    )
    assert values(page, other) == still
    for _ in range(5):
        page.keyboard.press("ArrowLeft")
    page.wait_for_function("([id, text]) => document.getElementById(id).textContent === text", arg=[f"{slider}-value", told])


def test_the_cut_reads_the_map(page: Any) -> None:
    """The values beside the sliders are those of the file, at the breakpoints that the sliders name."""
    from codegen.refmap import map as npz

    one = npz.load(GENERATED / "4ws2-tracking.npz")
    speed, angle = (float(page.inner_text(f"#{name}-value").split()[0]) for name in ("cut-speed", "cut-angle"))
    row = int(np.argmin(np.abs(one.speed * 3.6 - speed)))
    column = int(np.argmin(np.abs(np.degrees(one.front_angle) - angle)))
    cells = page.locator("#cut-values tr").nth(1).locator("td").all_inner_texts()
    # Three digits after the point.
    assert float(cells[0].split()[0]) == pytest.approx(np.degrees(one.yaw_rate[row, column]), abs=6e-4)


def test_hovering_reads_a_value(page: Any) -> None:
    chart = page.locator("#chart-map-yaw-rate")
    chart.scroll_into_view_if_needed()
    box = chart.locator(".nsewdrag").first.bounding_box()
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 0.8 * box["height"])
    label = chart.locator(".hovertext").first
    label.wait_for()
    assert re.search(r"Yaw rate r: \d+\.\d+ deg/s", label.text_content())
    page.mouse.move(0, 0)


def test_what_binds_is_told_in_words(page: Any) -> None:
    texts = page.evaluate("document.getElementById('chart-map-binding').data[0].text.flat()")
    assert {"none", "front slip + rear slip", "rear angle"} <= set(texts)


def test_a_name_is_no_word_of_the_script(chromium: Any, tmp_path: Path) -> None:
    from codegen.report.html.blocks import Chart, Section

    names = ["constructor", "toString", "@ink"]
    figure = {
        "data": [{"type": "scatter", "x": [0, 1], "y": [0, k], "name": name} for k, name in enumerate(names)],
        "layout": {},
    }
    path = tmp_path / "names.html"
    path.write_bytes(render("names", [Section("s", "s", [Chart("c", figure, "c", "c")])]))
    page = opened(chromium.new_page(), path)
    shown = page.locator(".legendtext").all_text_contents()
    assert shown[:2] == names[:2]
    page.close()


def test_dark_and_light_change_the_ink(page: Any) -> None:
    ink = "getComputedStyle(document.querySelector('#chart-margins .xtitle')).fill"
    light = page.evaluate(ink)
    page.click("#theme")
    page.wait_for_function(f"{ink} !== '{light}'")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 23, 27)"
    page.click("#theme")
    page.wait_for_function(f"{ink} === '{light}'")


@pytest.mark.parametrize("width", WIDTHS)
def test_no_page_is_wider_than_its_screen(page: Any, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    # The charts follow a moment later.
    page.wait_for_function("width => document.documentElement.scrollWidth <= width", arg=width)
    assert page.evaluate("innerWidth") == width
    page.set_viewport_size({"width": 1440, "height": 900})


def test_paper_gets_light_charts_that_fit_and_pictures_of_surfaces(page: Any) -> None:
    page.emulate_media(media="print", color_scheme="dark")
    page.wait_for_function("document.getElementById('chart-margins').clientWidth <= 1440")
    page.wait_for_function("document.querySelector('#chart-manifest, #chart-margins')._fullLayout.width === 660")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.evaluate("getComputedStyle(document.querySelector('nav')).display") == "none"
    pictures = page.locator("img.print")
    assert pictures.count() == 4
    for k in range(4):
        assert pictures.nth(k).is_visible()
        assert pictures.nth(k).evaluate("each => each.naturalWidth") == 1320
    page.emulate_media(media="screen", color_scheme="light")
    page.wait_for_function("document.getElementById('chart-margins')._fullLayout.width > 700")

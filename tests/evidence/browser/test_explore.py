"""The explorer's page in headless Chromium: charts, sliders, the button that writes a file, and errors."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from codegen import configuration
from codegen.explore.explorer import Explorer
from codegen.explore.server import ExploreServer
from codegen.explore.toml_file import Target, preset_bases
from codegen.figures.data import scale_of
from tests.explore.conftest import KINDS, explorer_of

from .conftest import PageMonitor

CHARTS = ("map", "step", "cut", "margins")
LAMBDA, ACCELERATION = "lambda", "limits.lateral_acceleration_max_g"


class Page:
    """A page of an explorer with its server."""

    def __init__(self, chromium: Any, explorer: Explorer, folder: Path, width: int = 1440) -> None:
        self.explorer, self.folder = explorer, folder
        self.server = ExploreServer(explorer, Target(folder / "ars.toml", preset_bases()))
        self.thread = threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.01})
        self.thread.start()
        self.page = chromium.new_page(viewport={"width": width, "height": 1000}, color_scheme="light")
        self.watch = PageMonitor(self.page)
        self.page.goto(self.server.address)
        self.page.wait_for_selector("#pictures[data-drawn]")

    def end(self) -> None:
        if self.thread.is_alive():
            self.server.shutdown()
            self.thread.join()
            self.server.server_close()

    def drawn(self) -> int:
        """Return how often the charts were drawn."""
        return int(self.page.get_attribute("#pictures", "data-drawn") or 0)

    def after(self, count: int) -> None:
        """Wait until the charts have been drawn more than `count` times."""
        self.page.wait_for_selector(f'#pictures:not([data-drawn="{count}"])')

    def settle(self) -> None:
        """Wait for the newest settings' family of margins, which arrives last."""
        newest = self.page.get_attribute("#pictures", "data-wanted")
        self.page.wait_for_selector(f'#margins[data-family="{newest}"]')

    def chart(self, name: str) -> list[dict[str, Any]]:
        """Return a chart's traces from Plotly."""
        script = """(id) => document.getElementById(id).data.map((trace) => ({
            type: trace.type, name: trace.name ?? "", x: Array.from(trace.x ?? []), y: Array.from(trace.y ?? []),
            z: Array.from(trace.z ?? [], (row) => Array.from(row, String).join()).join(";") }))"""
        return self.page.evaluate(script, name)

    def charts(self) -> dict[str, str]:
        return {name: repr(self.chart(name)) for name in CHARTS}

    def control(self, key: str) -> Any:
        return self.page.locator(f'.control[data-key="{key}"]')

    def number(self, key: str) -> Any:
        return self.control(key).locator("input[type=number]")

    def fill(self, key: str, value: str) -> None:
        """Type a value and wait for its charts."""
        count = self.drawn()
        self.number(key).fill(value)
        self.after(count)

    def status(self) -> str:
        return self.page.inner_text("#status")

    def check_quiet(self, allowed: str = "no error") -> None:
        """Check that the page reports no error and sends no external request."""
        assert [error for error in self.watch.errors if allowed not in error] == []
        origin = f"http://127.0.0.1:{self.server.server_port}/"
        assert [each for each in self.watch.requests if not each.startswith((origin, "data:", "blob:"))] == []
        assert f"{origin}plotly.js" in self.watch.requests


Open = Callable[..., Page]


@pytest.fixture(scope="module")
def explorers() -> dict[str, Explorer]:
    return {kind: explorer_of(kind) for kind in KINDS}


@pytest.fixture
def opened(chromium: Any, explorers: dict[str, Explorer], tmp_path: Path) -> Iterator[Open]:
    """Provide a function that opens an explorer's page (default: the PI's); stop the servers after the test."""
    pages: list[Page] = []

    def open_page(explorer: Explorer | str = "pi", **options: Any) -> Page:
        pages.append(Page(chromium, explorers[explorer] if isinstance(explorer, str) else explorer, tmp_path, **options))
        return pages[-1]

    yield open_page
    for page in pages:
        page.end()


@pytest.mark.parametrize("kind", KINDS)
def test_charts_are_drawn_and_described_at_every_width(opened: Open, kind: str) -> None:
    page = opened(kind)
    page.settle()
    heat, step = page.chart("map"), page.chart("step")
    assert (heat[0]["type"], len(heat[0]["x"]), len(heat[0]["y"])) == ("heatmap", 21, 25)
    assert "phase conversion" in {trace["name"] for trace in heat}
    assert {"these settings", "at the start", "passive car", "reference", "limit"} <= {trace["name"] for trace in step}
    yaw_rate = next(trace for trace in step if trace["name"] == "these settings")
    assert yaw_rate["y"] == page.explorer.picture({})["step"]["runs"]["now"]["yaw_rate_deg_s"]
    assert {trace["name"] for trace in page.chart("margins")} >= {"these settings", "required", "worst of the family"}
    # Plotly draws a line as a path with a shape, a heat map as an image.
    for name, least in (("step", 9), ("cut", 4), ("margins", 6)):
        paths = [path.get_attribute("d") or "" for path in page.page.locator(f"#{name} .scatterlayer path.js-line").all()]
        assert len(paths) >= least and all("L" in path or "C" in path for path in paths), name
    image = page.page.locator("#map .heatmaplayer image")
    assert (image.get_attribute("xlink:href") or image.get_attribute("href") or "").startswith("data:image/png")
    assert page.page.locator("#figures tr").count() == 11
    for name in CHARTS:
        caption = page.page.locator(f"#{page.page.get_attribute(f'#{name}', 'aria-describedby')}")
        assert caption.evaluate("(element) => element.tagName") == "FIGCAPTION" and len(caption.inner_text()) > 20, name
    for control in page.explorer.controls:
        label = f"{control.label} ({control.unit})" if control.unit else control.label
        assert page.page.get_by_role("spinbutton", name=label, exact=True).count() == 1, label
        assert page.page.get_by_role("slider", name=control.label, exact=True).count() == 1, label
    page.check_quiet()
    for width in (390, 820):
        narrow = opened(kind, width=width)
        assert narrow.page.evaluate("document.documentElement.scrollWidth") == width
        for name in CHARTS:
            box = narrow.page.locator(f"#{name} .main-svg").first.bounding_box()
            assert box["x"] >= 0.0 and box["x"] + box["width"] <= width and box["width"] > 250.0


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_every_slider_moves_its_charts_by_keyboard(opened: Open, kind: str) -> None:
    page = opened(kind)
    page.settle()
    begun = page.charts()
    for control in page.explorer.controls:
        before, count = page.charts(), page.drawn()
        slider = page.control(control.key).locator("input[type=range]")
        slider.focus()
        for key in ["Home"] if control.key.startswith(("limits.", "controller.tracking.")) else ["ArrowRight", "ArrowRight"]:
            page.page.keyboard.press(key)
        page.after(count)
        page.page.wait_for_selector("#status:has-text('Up to date')")
        value = page.number(control.key).input_value()
        assert float(value) != pytest.approx(control.value, rel=1e-6), control.key
        assert page.control(control.key).get_attribute("class") == "control changed"
        assert slider.get_attribute("aria-valuetext") == f"{value} {control.unit}"
        page.settle()
        count = page.drawn()
        assert page.charts() != before, control.key
        page.page.click("#reset")
        page.after(count)
        page.settle()
        assert page.page.locator(".control.changed").count() == 0
        assert page.page.is_disabled("#reset")
    assert page.charts() == begun
    page.check_quiet()


def test_a_typed_number_is_used_and_a_wrong_one_gives_one_line(opened: Open) -> None:
    page = opened()
    before = page.charts()
    page.fill(LAMBDA, "123.5")
    page.settle()
    changed, count = page.charts(), page.drawn()
    assert changed["map"] != before["map"]
    for value, expected in (("-5", "Sideslip weight λ: give a number from 0 to 10000000"), ("", "give a number")):
        page.number(LAMBDA).fill(value)
        assert expected in page.status()
    assert (page.charts(), page.drawn()) == (changed, count)
    page.page.click("#reset")
    page.after(count)
    assert page.number(LAMBDA).input_value() == "3000"
    page.check_quiet()


def test_settings_without_a_map_keep_the_last_charts(opened: Open, explorers: dict[str, Explorer]) -> None:
    start = explorers["pi"].start
    grid = start.grid.model_copy(update={"front_angle_min_deg": 4.0, "speed_min_km_h": 60.0})
    page = opened(Explorer(start.model_copy(update={"grid": grid}), "4ws-2", "coarse"))
    page.settle()
    before = page.charts()
    page.number(ACCELERATION).fill("0.05")
    page.page.wait_for_selector("#status.bad")
    assert "no operating point of the grid is feasible" in page.status()
    assert page.charts() == before
    page.fill(ACCELERATION, "0.8")
    assert "Up to date" in page.status()
    page.check_quiet(allowed="422")  # Chromium logs the rejected request to the console


def test_every_table_of_the_map_has_its_colours(opened: Open) -> None:
    page, seen = opened(), set()
    for choice, scale in (("yaw_rate", "viridis"), ("sideslip", "PuOr_r"), ("rear_angle", "RdBu_r"), ("binding", None)):
        page.page.select_option("#quantity", choice)
        seen.add(page.chart("map")[0]["z"])
        colours = page.page.evaluate("document.getElementById('map').data[0].colorscale")
        assert scale is None or colours == scale_of(scale)
    assert len(seen) == 4
    page.page.hover("#map .nsewdrag", position={"x": 40, "y": 200})
    assert "km/h" in (page.page.locator("#map .hoverlayer").text_content() or "")
    page.check_quiet()


def test_the_button_writes_a_file_and_replaces_one_only_on_confirmation(opened: Open) -> None:
    page = opened("tracking")  # the paper's PI is unstable in the family, and the page does not write unstable gains
    path = page.folder / "ars.toml"
    page.fill(LAMBDA, "750")
    page.settle()
    page.page.click("#write")
    page.page.wait_for_selector("#status:has-text('is written')")
    config = configuration.load(path)
    assert config == page.explorer.configured({LAMBDA: 750.0})
    assert "codegen solve --config ars.toml --case 4ws-2 -o small.npz" in page.status()
    path.write_text(configuration.preset_text(), encoding="utf-8")
    before = path.read_bytes()
    for leave in (lambda: page.page.click("#cancel"), lambda: page.page.keyboard.press("Escape")):
        page.page.click("#write")
        page.page.wait_for_selector("#confirm[open]")
        assert "grid.speed_points: 101 → 21" in page.page.inner_text("#confirm")
        leave()
        page.page.wait_for_selector("#status:has-text('is unchanged')")
        assert path.read_bytes() == before
    page.page.click("#write")
    page.page.click("#replace")
    page.page.wait_for_selector("#status:has-text('is written')")
    assert configuration.load(path) == config
    page.check_quiet(allowed="409")

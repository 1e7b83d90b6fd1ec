"""The explorer's page in Chromium: what is drawn, what a slider changes, what the button writes, and what never happens."""

from __future__ import annotations

import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from codegen import config as configuration
from codegen.cli.explore_command import _leading_to
from codegen.explore.explorer import Explorer
from codegen.explore.server import ExploreServer
from codegen.explore.toml_file import Target, preset_bases
from codegen.refmap import map as npz
from codegen.refmap.solve import solve_case
from codegen.report.html.charts import scale_of

from .conftest import Watch

GENERATED = Path(__file__).resolve().parents[2] / "generated"
KINDS = {"pi": "4ws2", "tracking": "4ws2-tracking"}
CASE = "4ws-2"
WIDTHS = (390, 820, 1440)
CHARTS = ("map", "step", "cut", "margins")


def explorer_of(kind: str) -> Explorer:
    """A small grid: the page is the same."""
    config = npz.load(GENERATED / f"{KINDS[kind]}.npz").config
    assert config is not None
    data = config.model_dump(mode="json")
    data["grid"] |= {"speed_points": 21, "front_angle_points": 25}
    return Explorer(configuration.parse(data, "test"), CASE, "small")


@pytest.fixture(scope="module", params=list(KINDS))
def explorer(request: pytest.FixtureRequest) -> Explorer:
    return explorer_of(request.param)


@pytest.fixture(scope="module")
def pi() -> Explorer:
    return explorer_of("pi")


class Served:
    """A server for a page, and its folder."""

    def __init__(self, explorer: Explorer, folder: Path) -> None:
        self.explorer, self.folder = explorer, folder
        self.server = ExploreServer(explorer, Target(folder / "ars.toml", preset_bases()))
        self.thread = threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.01})
        self.thread.start()

    def end(self) -> None:
        self.server.shutdown()
        self.thread.join()
        self.server.server_close()


class Page:
    """The open page, as its user sees it."""

    def __init__(self, page: Any) -> None:
        self.page = page

    def drawn(self) -> int:
        """How often the pictures were drawn."""
        return int(self.page.get_attribute("#pictures", "data-drawn") or 0)

    def after(self, count: int) -> None:
        """Wait until they are drawn again, more than `count` times in all."""
        self.page.wait_for_selector(f'#pictures:not([data-drawn="{count}"])', timeout=60_000)

    def chart(self, name: str) -> list[dict[str, Any]]:
        """What Plotly holds: for each trace its name, and its numbers as text."""
        traces: list[dict[str, Any]] = self.page.evaluate(
            """(id) => document.getElementById(id).data.map((trace) => ({
                type: trace.type, name: trace.name ?? "", x: Array.from(trace.x ?? []), y: Array.from(trace.y ?? []),
                z: Array.from(trace.z ?? [], (row) => Array.from(row, String).join()).join(";") }))""",
            name,
        )
        return traces

    def charts(self) -> dict[str, str]:
        """Chart -> everything that is drawn in it."""
        return {name: repr(self.chart(name)) for name in CHARTS}

    def control(self, key: str) -> Any:
        return self.page.locator(f'.control[data-key="{key}"]')

    def status(self) -> str:
        text: str = self.page.inner_text("#status")
        return text


@pytest.fixture
def served(explorer: Explorer, tmp_path: Path) -> Iterator[Served]:
    server = Served(explorer, tmp_path)
    yield server
    server.end()


@pytest.fixture
def served_pi(pi: Explorer, tmp_path: Path) -> Iterator[Served]:
    server = Served(pi, tmp_path)
    yield server
    server.end()


COUNT_REQUESTS = """
let underWay = 0;
const came = (more) => { document.documentElement.dataset.underWay = String(underWay += more); };
const ask = window.fetch;
window.fetch = async (...what) => {
    came(1);
    const answer = await ask(...what);
    const read = answer.json.bind(answer);
    answer.json = async () => {
        const data = await read();
        // After what waits for this answer has gone on with it.
        const channel = new MessageChannel();
        channel.port1.onmessage = () => came(-1);
        channel.port2.postMessage(null);
        return data;
    };
    return answer;
};
"""


def opened(chromium: Any, watch: Watch, served: Served, width: int = 1440, scheme: str = "light") -> Page:
    page = watch.follow(chromium.new_page(viewport={"width": width, "height": 1000}, color_scheme=scheme))
    page.add_init_script(COUNT_REQUESTS)
    page.goto(served.server.address)
    page.wait_for_selector("#pictures[data-drawn]", timeout=60_000)
    return Page(page)


def quiet(watch: Watch, served: Served) -> None:
    """No error on the page, and no request to anywhere else."""
    assert watch.errors == []
    origin = f"http://127.0.0.1:{served.server.server_port}/"
    assert [address for address in watch.requests if not address.startswith((origin, "data:", "blob:"))] == []
    assert f"{origin}plotly.js" in watch.requests


def test_every_picture_is_drawn_with_its_numbers(chromium: Any, watch: Watch, served: Served) -> None:
    page = opened(chromium, watch, served)
    settle(page)
    heat = page.chart("map")
    assert heat[0]["type"] == "heatmap"
    assert len(heat[0]["x"]) == 21
    assert len(heat[0]["y"]) == 25
    assert "phase conversion" in {trace["name"] for trace in heat}
    shown = served.explorer.picture({})
    step = {trace["name"]: trace for trace in page.chart("step")}
    assert {"these settings", "at the start", "passive car", "reference", "limit"} <= set(step)
    yaw_rate = next(trace for trace in page.chart("step") if trace["name"] == "these settings")
    assert yaw_rate["y"] == shown["step"]["runs"]["now"]["yaw_rate_deg_s"]
    assert {trace["name"] for trace in page.chart("margins")} >= {"these settings", "asked for", "worst of the family"}
    assert len(page.chart("cut")) == 4
    # Plotly draws a line as a path with a shape, a heat map as an image.
    for name, least in (("step", 9), ("cut", 4), ("margins", 6)):
        paths = page.page.locator(f"#{name} .scatterlayer path.js-line").all()
        assert len(paths) >= least, name
        assert all("L" in (path.get_attribute("d") or "") or "C" in (path.get_attribute("d") or "") for path in paths)
    image = page.page.locator("#map .heatmaplayer image")
    assert (image.get_attribute("xlink:href") or image.get_attribute("href") or "").startswith("data:image/png")
    assert page.page.locator("#figures tr").count() == 11
    assert "Up to date" in page.status()
    quiet(watch, served)


# In which charts the numbers must be others after a few steps of the keyboard; some go to the slider's lower end.
MOVES = {
    "lambda": {"map", "cut", "step"},
    "limits.sideslip_max_deg": {"map", "cut"},
    "limits.lateral_acceleration_max_g": {"map", "cut", "step"},
    "limits.rear_angle_max_deg": {"map", "cut", "step"},
    "limits.slip_departure_percent": {"map", "cut", "step"},
    "road.friction": {"map", "cut", "step", "margins"},
    "controller.proportional_gain_s": {"step", "margins"},
    "controller.integral_gain": {"step", "margins"},
    "proportional_percent": {"step", "margins"},
    "integral_percent": {"step", "margins"},
    "controller.tracking.lead_s": {"step"},
    "controller.tracking.yaw_increasing_max_deg": {"step"},
    "controller.tracking.trim_max_percent": {"step"},
    "step.speed_km_h": {"map", "cut", "step"},
    "step.angle_deg": {"map", "step"},
    "step.road_percent": {"step"},
}


def test_every_slider_moves_by_keyboard_and_its_pictures_follow(chromium: Any, watch: Watch, served: Served) -> None:
    page = opened(chromium, watch, served)
    settle(page)
    begun = page.charts()
    for control in served.explorer.controls:
        before, count = page.charts(), page.drawn()
        slider = page.control(control.key).locator("input[type=range]")
        number = page.control(control.key).locator("input[type=number]")
        slider.focus()
        for key in ["Home"] if control.key.startswith(("limits.", "controller.tracking.")) else ["ArrowRight", "ArrowRight"]:
            page.page.keyboard.press(key)
        page.after(count)
        page.page.wait_for_selector("#status:has-text('Up to date')")
        moved = float(number.input_value())
        assert moved != pytest.approx(control.value, rel=1e-6), control.key
        assert page.control(control.key).get_attribute("class") == "control changed"
        assert "was" in page.control(control.key).locator(".was").inner_text()
        assert f"{number.input_value()} {control.unit}" == slider.get_attribute("aria-valuetext")
        settle(page)
        after = page.charts()
        changed = {name for name in CHARTS if before[name] != after[name]}
        assert changed >= MOVES[control.key], control.key
        count = page.drawn()
        page.page.click("#reset")
        page.after(count)
        settle(page)
        assert page.page.locator(".control.changed").count() == 0
        assert page.page.is_disabled("#reset")
    assert page.charts() == begun
    quiet(watch, served)


def settle(page: Page) -> None:
    """Until the last thing to come, the family's margins, is that of the newest settings."""
    newest = page.page.get_attribute("#pictures", "data-wanted")
    page.page.wait_for_selector(f'#margins[data-family="{newest}"]', timeout=60_000)


def test_a_number_typed_is_taken_and_a_wrong_one_is_one_line(chromium: Any, watch: Watch, served_pi: Served) -> None:
    page = opened(chromium, watch, served_pi)
    number = page.control("lambda").locator("input[type=number]")
    count, before = page.drawn(), page.charts()
    number.fill("123.5")
    page.after(count)
    settle(page)
    changed = page.charts()
    assert changed["map"] != before["map"]
    count = page.drawn()
    number.fill("-5")
    assert "Sideslip weight λ: give a number from 0 to 10000000" in page.status()
    number.fill("")
    assert "give a number" in page.status()
    assert page.charts() == changed
    assert page.drawn() == count
    page.page.click("#reset")
    page.after(count)
    assert number.input_value() == "3000"
    quiet(watch, served_pi)


def test_an_emptied_box_is_reset_too(chromium: Any, watch: Watch, served_pi: Served) -> None:
    page = opened(chromium, watch, served_pi)
    number = page.control("limits.rear_angle_max_deg").locator("input[type=number]")
    number.fill("")
    page.page.click("#reset")
    assert number.input_value() == "3.5"
    settle(page)
    quiet(watch, served_pi)


def test_settings_without_a_map_say_so_and_the_last_pictures_stay(
    chromium: Any, watch: Watch, pi: Explorer, tmp_path: Path
) -> None:
    grid = pi.start.grid.model_copy(update={"front_angle_min_deg": 4.0, "speed_min_km_h": 60.0})
    served = Served(Explorer(pi.start.model_copy(update={"grid": grid}), CASE, "coarse"), tmp_path)
    try:
        page = opened(chromium, watch, served)
        settle(page)
        before, families = page.charts(), families_asked(watch)
        page.page.clock.install()  # the page's timers wait for the test
        page.control("limits.lateral_acceleration_max_g").locator("input[type=number]").fill("0.05")
        page.page.wait_for_selector("#status.bad")
        assert "no operating point of the grid is feasible" in page.status()
        assert "Traceback" not in page.page.inner_text("body")
        # A gain alone would have another family of margins; of settings that are refused there is none to show.
        page.control("controller.integral_gain").locator("input[type=number]").fill("0.4")
        answered(page)
        page.page.clock.run_for(10_000)
        answered(page)
        assert families_asked(watch) == families
        assert page.charts() == before
        page.page.clock.resume()
        count = page.drawn()
        page.control("limits.lateral_acceleration_max_g").locator("input[type=number]").fill("0.8")
        page.after(count)
        assert "Up to date" in page.status()
        settle(page)
        assert page.charts()["margins"] != before["margins"]
        # Chromium itself writes the refused request to the console; nothing else is there.
        assert [error for error in watch.errors if "422" not in error] == []
    finally:
        served.end()


def families_asked(watch: Watch) -> int:
    """How often the page has asked for the family's margins."""
    return sum(address.endswith("/api/family") for address in watch.requests)


def answered(page: Page) -> None:
    """Until the page has what it asked for before: its requests go one behind the other."""
    page.page.wait_for_selector('html[data-under-way="0"]', timeout=60_000)


def test_the_last_value_wins_over_those_on_the_way(chromium: Any, watch: Watch, served_pi: Served) -> None:
    page = opened(chromium, watch, served_pi)
    page.page.evaluate(
        """() => {
            const slider = document.querySelector('[data-key="lambda"] input[type=range]');
            for (let place = 0; place <= 200; place++) {
                slider.value = place;
                slider.dispatchEvent(new Event("input"));
            }
        }"""
    )
    value = float(page.control("lambda").locator("input[type=number]").input_value())
    settle(page)
    expected = served_pi.explorer.picture({"lambda": value})["step"]["runs"]["now"]["yaw_rate_deg_s"]
    shown = next(trace for trace in page.chart("step") if trace["name"] == "these settings")
    assert shown["y"] == expected
    # One under way and one behind it, not two hundred.
    assert page.drawn() <= 5
    quiet(watch, served_pi)


def test_what_binds_and_the_other_tables_are_shown_by_choice(chromium: Any, watch: Watch, served_pi: Served) -> None:
    page = opened(chromium, watch, served_pi)
    seen = []
    for choice in ("yaw_rate", "sideslip", "rear_angle", "binding"):
        page.page.select_option("#quantity", choice)
        seen.append(page.chart("map")[0]["z"])
        if choice != "binding":
            scale = page.page.evaluate("document.getElementById('map').data[0].colorscale")
            assert scale == scale_of({"yaw_rate": "viridis", "sideslip": "PuOr_r", "rear_angle": "RdBu_r"}[choice])
    assert len(set(seen)) == 4
    assert "rear angle" in {trace["name"] for trace in page.chart("map")}
    colours = page.page.evaluate(
        """() => Object.fromEntries(document.getElementById("map").data
            .filter((trace) => trace.showlegend).map((trace) => [trace.name, trace.marker.color]))"""
    )
    shown = served_pi.explorer.picture({})["map"]
    assert colours == dict(zip(shown["binding_names"], shown["binding_colours"], strict=True))
    cells = page.page.evaluate("document.getElementById('map').data[0].colorscale.map(([, colour]) => colour)")
    assert cells == [colour for colour in shown["binding_colours"] for _ in range(2)]
    page.page.hover("#map .nsewdrag", position={"x": 40, "y": 200})
    assert "km/h" in (page.page.locator("#map .hoverlayer").text_content() or "")
    quiet(watch, served_pi)


def test_the_button_writes_a_file_that_the_project_takes(chromium: Any, watch: Watch, served: Served) -> None:
    page = opened(chromium, watch, served)
    count = page.drawn()
    page.control("lambda").locator("input[type=number]").fill("750")
    page.after(count)
    page.page.click("#write")
    page.page.wait_for_selector("#status:has-text('is written')")
    path = served.folder / "ars.toml"
    config = configuration.load(path)
    assert config == served.explorer.configured({"lambda": 750.0})
    solve_case(config, CASE)
    assert "codegen solve --config ars.toml --case 4ws-2 -o small.npz" in page.status()
    quiet(watch, served)


def test_a_file_that_is_there_is_replaced_only_after_a_yes(chromium: Any, watch: Watch, served_pi: Served) -> None:
    path = served_pi.folder / "ars.toml"
    path.write_text(configuration.preset_text(), encoding="utf-8")
    before = path.read_bytes()
    page = opened(chromium, watch, served_pi)
    page.page.click("#write")
    page.page.wait_for_selector("#confirm[open]")
    assert "grid.speed_points: 101 → 21" in page.page.inner_text("#confirm")
    page.page.click("#cancel")
    assert "left as it was" in page.status()
    assert path.read_bytes() == before
    page.page.click("#write")
    page.page.wait_for_selector("#confirm[open]")
    page.page.keyboard.press("Escape")
    assert path.read_bytes() == before
    page.page.click("#write")
    page.page.click("#replace")
    page.page.wait_for_selector("#status:has-text('is written')")
    assert tomllib.loads(path.read_text(encoding="utf-8"))["grid"]["speed_points"] == 21
    assert [error for error in watch.errors if "409" not in error] == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_light_and_dark(chromium: Any, watch: Watch, served_pi: Served, scheme: str) -> None:
    def brightness(colour: str) -> float:
        return sum(float(part) for part in colour.strip("rgba()").split(",")[:3]) / 3.0

    page = opened(chromium, watch, served_pi, scheme=scheme)

    def looks() -> tuple[bool, bool]:
        ground = page.page.evaluate("getComputedStyle(document.body).backgroundColor")
        ink = page.page.evaluate("getComputedStyle(document.querySelector('#step .xtick text')).fill")
        return brightness(ground) > 200.0, brightness(ink) < 100.0

    light = scheme == "light"
    assert looks() == (light, light)
    page.page.click("#theme")
    assert looks() == (not light, not light)
    quiet(watch, served_pi)


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_is_cut_off_at_any_width(chromium: Any, watch: Watch, served: Served, width: int) -> None:
    page = opened(chromium, watch, served, width)
    assert page.page.evaluate("document.documentElement.scrollWidth") == width
    for name in CHARTS:
        box = page.page.locator(f"#{name} .main-svg").first.bounding_box()
        assert box is not None
        assert box["x"] >= 0.0
        assert box["x"] + box["width"] <= width
        assert box["width"] > 250.0
    assert page.page.locator("#write").is_visible()
    quiet(watch, served)


def test_every_input_has_a_name_and_can_be_reached_by_keyboard(chromium: Any, watch: Watch, served: Served) -> None:
    page = opened(chromium, watch, served)
    for control in served.explorer.controls:
        name = f"{control.label} ({control.unit})" if control.unit else control.label
        assert page.page.get_by_role("spinbutton", name=name, exact=True).count() == 1, name
        assert page.page.get_by_role("slider", name=control.label, exact=True).count() == 1, name
    page.page.locator("body").press("Tab")
    reached = []
    for _ in range(2 * len(served.explorer.controls) + 12):
        reached.append(
            page.page.evaluate("document.activeElement.closest('[data-key]')?.dataset.key ?? document.activeElement.id")
        )
        page.page.keyboard.press("Tab")
    assert {control.key for control in served.explorer.controls} | {"write", "theme", "quantity"} <= set(reached)
    page.page.locator(".control input").first.focus()
    assert page.page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    assert page.page.get_attribute("#status", "aria-live") == "polite"
    quiet(watch, served)


def test_charts_are_described_and_moves_do_not_talk(chromium: Any, watch: Watch, served_pi: Served) -> None:
    page = opened(chromium, watch, served_pi)
    for name in CHARTS:
        caption = page.page.locator(f"#{page.page.get_attribute(f'#{name}', 'aria-describedby')}")
        assert caption.evaluate("(element) => element.tagName") == "FIGCAPTION"
        assert len(caption.inner_text()) > 20, name
        assert caption.locator(f"xpath=..//*[@id='{name}']").count() == 1
    assert "40 dB and 180 deg: what is more, or has no limit, is drawn there" in page.page.inner_text("#margins-caption")
    said = page.page.evaluate_handle(
        """() => {
            const said = [];
            const text = document.getElementById("status");
            const watching = new MutationObserver(() => said.push(text.textContent));
            watching.observe(text, { childList: true, characterData: true, subtree: true });
            return said;
        }"""
    )
    for value in ("200", "300"):
        count, took = page.drawn(), page.page.inner_text("#took")
        page.control("lambda").locator("input[type=number]").fill(value)
        page.after(count)
        assert "ms" in took
    assert said.json_value() == []
    assert page.page.locator("[aria-live] #took, #took[aria-live], [role=status] #took").count() == 0
    page.control("lambda").locator("input[type=number]").fill("-5")
    assert len(said.json_value()) == 1
    assert page.page.inner_text("#took") == ""
    quiet(watch, served_pi)


def test_a_slider_of_ratios_has_a_stop_at_zero(chromium: Any, watch: Watch, pi: Explorer, tmp_path: Path) -> None:
    data = pi.start.model_dump(mode="json")
    data["cases"][CASE]["sideslip_weight_per_s2"] = 0.0
    served = Served(Explorer(configuration.parse(data, "test"), CASE, "small"), tmp_path)
    try:
        page = opened(chromium, watch, served)
        slider = page.control("lambda").locator("input[type=range]")
        number = page.control("lambda").locator("input[type=number]")
        assert (slider.input_value(), number.input_value()) == ("0", "0")
        seen = []
        slider.focus()
        for key in ("ArrowRight", "ArrowRight", "Home", "End"):
            page.page.keyboard.press(key)
            seen.append(float(number.input_value()))
            if key == "Home":
                assert page.control("lambda").get_attribute("class") == "control"
        # The last stop is the one next to the end: half a step of 2 %.
        assert seen == [10.0, 10.2, 0.0, pytest.approx(1e5, rel=0.01)]
        number.fill("0")
        assert slider.input_value() == "0"
        settle(page)
        quiet(watch, served)
    finally:
        served.end()


def test_the_file_for_the_browser_leads_to_the_page(chromium: Any, watch: Watch, served_pi: Served, tmp_path: Path) -> None:
    page = watch.follow(chromium.new_page())
    page.goto(_leading_to(served_pi.server.address, tmp_path).as_uri())
    page.wait_for_url(served_pi.server.address)
    page.wait_for_selector("#pictures[data-drawn]", timeout=60_000)
    assert watch.errors == []


def test_a_server_that_is_gone_is_told(chromium: Any, watch: Watch, pi: Explorer, tmp_path: Path) -> None:
    served = Served(pi, tmp_path)
    page = opened(chromium, watch, served)
    settle(page)
    served.end()
    page.page.route("**/*", lambda route: route.abort())  # a connection that is still open would be answered
    page.control("lambda").locator("input[type=number]").fill("750")
    page.page.wait_for_selector("#status:has-text('still running')")


def test_a_page_without_its_key_is_refused(chromium: Any, served_pi: Served) -> None:
    page = chromium.new_page()
    answer = page.goto(f"http://127.0.0.1:{served_pi.server.server_port}/")
    assert answer.status == 403
    assert "open the whole address" in page.inner_text("body")

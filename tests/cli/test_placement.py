"""`codegen build --max-error --max-flash --storage` and `codegen show --flash`: what the user gives, gets and is told."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest

from codegen import config as configuration
from codegen.refmap import map as npz
from codegen.refmap import place_sweep
from codegen.refmap.solve import solve_case

from .conftest import Run, everything_in

Refused = Callable[..., str]


@pytest.fixture
def solved(tmp_path: Path) -> Path:
    path = tmp_path / "4ws1.npz"
    path.write_bytes(npz.to_bytes(solve_case(configuration.preset(), "4ws-1")))
    return path


def manifest_of(folder: Path) -> dict[str, object]:
    manifest: dict[str, object] = json.loads((folder / "manifest.json").read_bytes())
    return manifest


def test_the_same_options_give_the_same_folder_and_check_knows(run: Run, solved: Path, tmp_path: Path) -> None:
    options = ("--max-error", "0.5deg/s", "--storage", "int16")
    one, other = tmp_path / "one", tmp_path / "other"
    first = run("build", "--map", solved, *options, "-o", one)
    assert first.code == 0
    assert "breakpoints, " in first.out and "bytes: at most" in first.out
    assert run("build", "--map", solved, *options, "-o", other).code == 0
    assert everything_in(one) == everything_in(other)
    assert run("build", "--map", solved, *options, "-o", one, "--check").code == 0
    assert run("build", "--map", solved, "-o", one, "--check").code == 1
    assert run("build", "--map", solved, "--max-error", "0.5deg/s", "-o", one, "--check").code == 1
    assert "--max-error 0.5deg/s --storage int16 -o DIR" in (one / "README.md").read_text(encoding="ascii")


def test_bytes_and_error_are_kept_and_told(run: Run, solved: Path, tmp_path: Path) -> None:
    answer = run("build", "--map", solved, "--max-error", "0.01rad/s", "--max-flash", "1kB", "-o", tmp_path / "x", "--json")
    assert answer.code == 0
    told = json.loads(answer.out)["placement"]
    assert told["flash_bytes"] <= 1000
    assert told["error_rad_s"] <= told["error_whole_domain_rad_s"] <= 0.01
    manifest = manifest_of(tmp_path / "x")
    assert manifest["options"] == {
        "kind": "pi",
        "max_error_rad_s": 0.01,
        "max_flash_bytes": 1000,
        "precision": "single",
        "prefix": "ars",
        "storage": "float",
    }


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--max-error", "0.05"), "no unit; give a number and deg/s or rad/s"),
        (("--max-error", "0.05m/s"), "is in 'm/s'; give a number and deg/s or rad/s"),
        (("--max-error", "deg/s"), "no number"),
        (("--max-error", "-1deg/s"), "'-1deg/s' must be above zero"),
        (("--max-error", "-.5e-3rad/s"), "must be above zero"),
        (("--max-error", "--1deg/s"), "no number"),
        (("--max-error", "nandeg/s"), "no number"),
        (("--max-error", "0deg/s"), "above zero"),
        (("--max-error", "1e999rad/s"), "above zero"),
        (("--max-error", "1\ndeg/s\n2"), "no number"),
        (("--max-error", ""), "no number"),
        (("--max-flash", "4"), "no unit; give a number and B or kB or KiB or MB or MiB"),
        (("--max-flash", "4kb"), "is in 'kb'"),
        (("--max-flash", "-4KiB"), "'-4KiB' must be above zero"),
        (("--max-flash", "8B"), "the smallest one takes 32 bytes"),
        (("--max-flash", "0.1B"), "the smallest one takes 32 bytes"),
        (("--storage", "int16"), "add --max-error or --max-flash"),
        (("--storage", "int8", "--max-error", "1deg/s"), "int8"),
        (("--max-error", "0.2deg/s", "--max-flash", "64B"), "in 64 bytes"),
    ],
)
def test_what_cannot_be_is_told_in_a_line(refused: Refused, solved: Path, options: tuple[str, ...], told: str) -> None:
    assert told in refused("build", "--map", solved, *options, "-o", solved.parent / "x")


def test_a_folder_of_the_user_is_refused_before_the_search(
    refused: Refused, solved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def search(*_: object) -> None:
        raise AssertionError("searched first")

    monkeypatch.setattr("codegen.emit.build.choose", search)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").write_text("mine", encoding="utf-8")
    assert "holds 'notes.txt'" in refused("build", "--map", solved, "--max-error", "1deg/s", "-o", tmp_path / "mine")


RATES = {"0.05deg/s": math.radians(0.05), " 1e-3 rad/s": 1e-3, ".5deg/s": math.radians(0.5)}


@pytest.mark.parametrize(("written", "value"), RATES.items())
def test_rates_are_read_with_their_unit(written: str, value: float) -> None:
    from codegen.cli.values import yaw_rate_error

    found = yaw_rate_error.convert(written, None, None)
    assert found.value == pytest.approx(value, rel=1e-15)
    assert yaw_rate_error.convert(found.words, None, None) == found


def test_sizes_are_read_with_their_unit() -> None:
    from codegen.cli.values import memory_size

    sizes = {"4KiB": 4096, "4096B": 4096, "4kB": 4000, "2MB": 2000000, "1MiB": 1048576, "0.5 KiB": 512}
    assert {written: memory_size.convert(written, None, None).value for written in sizes} == sizes


def test_error_against_flash_as_table_plot_and_json(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(place_sweep, "BOUNDS", (math.radians(1.0), math.radians(0.5)))
    solved = tmp_path / "fws.npz"
    solved.write_bytes(npz.to_bytes(solve_case(configuration.preset(), "fws")))
    picture = tmp_path / "flash.png"
    answer = run("show", solved, "--flash", "--plot", picture)
    assert answer.code == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    lines = answer.out.splitlines()
    assert "as it is 102 x 102 breakpoints" in lines[0]
    assert [line.split()[0] for line in lines if line[:1].isdigit()] == ["1", "0.5"]
    steps = [line.split(" %, ")[-1] for line in answer.err.splitlines()]
    named = [f"{bound} deg/s, {way}" for bound in ("1", "0.5") for way in ("even", "uneven", "int16")]
    assert steps == [*named, "placing breakpoints: 100 %"]
    told = json.loads(run("show", solved, "--flash", "--json").out)
    assert {point["way"] for point in told["placed"]} == {"even", "uneven", "int16"}
    for point in told["placed"]:
        assert point["error_whole_domain_rad_s"] <= point["max_error_rad_s"]
        assert point["flash_bytes"] < 0.1 * told["grid"]["flash_bytes"]


def test_what_a_way_cannot_hold_is_not_searched_for_again(solved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And the line of progress does not name it."""
    reference_map = npz.load(solved)
    found = place_sweep.Maker.for_error
    asked: list[float] = []

    def for_error(self: place_sweep.Maker, bound: float, spacings: tuple[place_sweep.Spacing, ...]) -> object:
        if spacings == ("even",):
            asked.append(bound)
            return None
        return found(self, bound, spacings)

    monkeypatch.setattr(place_sweep.Maker, "for_error", for_error)
    bounds = (math.radians(1.0), math.radians(0.9))
    steps: list[tuple[int, int, str]] = []
    assert reference_map.config is not None
    made = place_sweep.flash_table(
        reference_map, reference_map.config, 1, bounds=bounds, progress=lambda *step: steps.append(step)
    )
    assert asked == [bounds[0]]
    assert [point.placed is None for point in made.points] == [True, False, False] * 2
    assert steps == [
        *((done, 6, f"1 deg/s, {way}") for done, way in enumerate(("even", "uneven", "int16"))),
        *((done, 6, f"0.9 deg/s, {way}") for done, way in ((4, "uneven"), (5, "int16"))),
        (6, 6, ""),
    ]


def test_a_configuration_goes_with_flash_alone(refused: Refused, solved: Path, tmp_path: Path) -> None:
    config = tmp_path / "ars.toml"
    config.write_text(configuration.preset_text(), encoding="utf-8")
    assert "add --flash" in refused("show", solved, "--config", config)

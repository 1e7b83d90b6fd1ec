"""Tyres from property files of four versions, against the formula written a second time (`book`)."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from codegen import config as configuration
from codegen.importing.magic_formula import read_formula
from codegen.importing.source import Source
from codegen.importing.tir import parse
from codegen.importing.tyre import import_tyres
from codegen.vehicle.tyre import AxleTyres, static_wheel_loads
from tests.cli.conftest import Run
from tests.importing import book

DATA = Path(__file__).parent / "data"
Refused = Callable[..., str]

FILES = {
    "pac2002.tir": ("PAC2002", book.mf5, book.PAC2002, -1.0),
    "mf52.tir": ("MF 5.2", book.mf5, book.MF52, 1.0),
    "mf61.tir": ("MF 6.1", book.mf6, book.MF61, -1.0),
    "mf62.tir": ("MF 6.2", book.mf6, book.MF62, -1.0),
}
"""File -> version, formula and coefficients of `book`, and the sign of the force in the file's axes."""


@pytest.fixture
def car(tmp_path: Path) -> Path:
    path = tmp_path / "ars.toml"
    path.write_text(configuration.preset_text(), encoding="utf-8")
    return path


def edited(folder: Path, name: str, old: str, new: str) -> Path:
    text = (DATA / name).read_text(encoding="utf-8")
    assert old in text
    path = folder / name
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


@pytest.mark.parametrize("name", FILES)
def test_the_stiffness_is_the_slope_of_the_full_formula_at_the_static_loads(name: str, car: Path) -> None:
    version, force, p, sign = FILES[name]
    made = import_tyres([DATA / name], car)
    assert {axle.version for axle in made.axles} == {version}
    config = configuration.parse(tomllib.loads(made.text), "made")
    tyres = AxleTyres.from_config(config)
    for tyre, load in zip((tyres.front, tyres.rear), static_wheel_loads(config), strict=True):
        horizontal, vertical = book.shifts(p, load)
        # Where the shifted curve goes through its own origin: there the formula's slope is B C D.
        zero = brentq(lambda slip, load=load, vertical=vertical: force(p, slip, load) - vertical, -0.1, 0.1, xtol=1e-14)
        assert zero == pytest.approx(-horizontal, abs=1e-6 + 1e-4 * abs(horizontal))  # atan of the shift, not the shift
        step = 1e-5  # rad; the error of the difference is of the order of (B step)^2 = 1e-7, its rounding 1e-10
        slope = sign * (force(p, zero + step, load) - force(p, zero - step, load)) / (2.0 * step)
        assert slope > 0.0
        # Asked for: 0.1 %. The shift in tan(alpha) of 6.1 costs 5e-6, the difference 1e-6.
        assert tyre.cornering_stiffness == pytest.approx(slope, rel=2e-5)
        # The peak of either side, shifts removed, is D: both sides are the same there but for E.
        slips = np.linspace(0.0, 0.6, 6001)
        highest = max(sign * (force(p, float(slip), load) - vertical) for slip in slips)
        assert float(np.max(tyre.force(slips))) == pytest.approx(highest, rel=1e-5)  # a grid of 1e-4 rad near a flat top


@pytest.mark.parametrize("name", FILES)
def test_the_curve_is_that_of_a_left_and_a_right_tyre_together(name: str, car: Path) -> None:
    _, force, p, sign = FILES[name]
    made = import_tyres([DATA / name], car)
    config = configuration.parse(tomllib.loads(made.text), "made")
    tyres = AxleTyres.from_config(config)
    for axle, tyre, bound in zip(
        made.axles, (tyres.front, tyres.rear), (tyres.front_slip_bound, tyres.rear_slip_bound), strict=True
    ):
        without = {**p, "PHY1": 0.0, "PHY2": 0.0, "PVY1": 0.0, "PVY2": 0.0}

        def both(slip: float, load: float = axle.load, p: book.Coefficients = without) -> float:
            return 0.5 * sign * (force(p, slip, load) - force(p, -slip, load))

        slips = np.linspace(0.0, bound, 301)
        difference = np.max(np.abs(tyre.force(slips) - [both(float(slip)) for slip in slips])) / axle.peak
        assert difference == pytest.approx(axle.worst, abs=1e-6)  # another grid of slips
        assert axle.worst < 5e-4  # what is left: one E for two, the slip for its tangent
        assert axle.slip_bound == pytest.approx(bound)
        slips = np.linspace(0.0, math.radians(45.0), 4501)
        highest = slips[np.argmax([both(float(slip)) for slip in slips])]
        assert axle.slip_at_peak == pytest.approx(highest, abs=2e-4)  # the grid's step
        horizontal, vertical = book.shifts(p, axle.load)
        assert (axle.horizontal_shift, axle.vertical_shift) == pytest.approx((horizontal, vertical), rel=1e-9)


def test_the_peak_follows_the_load_as_in_the_file(car: Path) -> None:
    made = import_tyres([DATA / "mf61.tir"], car)
    tyre = AxleTyres.from_config(configuration.parse(tomllib.loads(made.text), "made")).front
    formula = read_formula(parse(Source(DATA / "mf61.tir", (DATA / "mf61.tir").read_bytes())))
    for share in (0.5, 1.0, 1.6):
        load = share * tyre.static_load
        # Nine digits are written of p1 and p2.
        assert tyre.peak(load, tyre.nominal_friction) == pytest.approx(formula.at(load).peak, rel=1e-8)


def test_the_stiffness_beside_the_static_load_is_told(car: Path) -> None:
    axle = import_tyres([DATA / "mf61.tir"], car).axles[0]
    load, step = 1.3 * axle.load, 1e-5
    p = {**book.MF61, "PHY1": 0.0, "PHY2": 0.0, "PVY1": 0.0, "PVY2": 0.0}
    slope = (book.mf6(p, -step, load) - book.mf6(p, step, load)) / (2.0 * step)
    kept = axle.stiffness * 1.3 * (1.0 + 0.3 * axle.values["peak_load_sensitivity_p2"] / axle.values["peak_factor_p1"])
    assert axle.stiffness_heavier == pytest.approx(kept / slope - 1.0, abs=1e-5)


def test_the_road_may_give_the_peak(car: Path) -> None:
    made = import_tyres([DATA / "mf52.tir"], car, "road")
    tyre = AxleTyres.from_config(configuration.parse(tomllib.loads(made.text), "made")).rear
    assert tyre.peak_factor == 1.0
    assert tyre.cornering_stiffness == pytest.approx(made.axles[1].stiffness, rel=1e-8)  # nine digits
    assert any("the road's is taken" in note for note in made.notes)


def test_two_files_are_front_and_rear_and_all_else_stays(run: Run, car: Path, tmp_path: Path) -> None:
    before = car.read_text(encoding="utf-8")
    new = tmp_path / "new.toml"
    answer = run("import", DATA / "mf61.tir", DATA / "pac2002.tir", "--config", car, "-o", new, "--json")
    assert answer.code == 0, answer.err
    told = json.loads(answer.out)
    assert (told["front"]["version"], told["rear"]["version"]) == ("MF 6.1", "PAC2002")
    assert car.read_text(encoding="utf-8") == before
    old_lines, new_lines = before.split("\n"), new.read_text(encoding="utf-8").split("\n")
    assert [line for line in new_lines if not line.startswith("# imported from ")][0:26] == old_lines[0:26]
    changed = [
        (one, other)
        for one, other in zip(old_lines, [line for line in new_lines if not line.startswith("# imported from ")], strict=True)
        if one != other
    ]
    assert len(changed) == 10  # five keys on each axle; the shifts were zero and stay so
    assert all(one.partition("=")[0] == other.partition("=")[0] for one, other in changed)
    assert all(one.partition("#")[2] == other.partition("#")[2] for one, other in changed)
    again = tmp_path / "again.toml"
    assert run("import", DATA / "mf61.tir", DATA / "pac2002.tir", "--config", new, "-o", again).code == 0
    assert again.read_bytes() == new.read_bytes()  # the remark is not written twice


def test_a_stiffness_factor_gives_way_and_missing_tables_are_made(run: Run, tmp_path: Path) -> None:
    car, new = tmp_path / "ars.toml", tmp_path / "new.toml"
    car.write_text(
        "schema_version = 1\n[vehicle]\nmass_kg = 1500.0\ncg_to_front_axle_m = 1.2\ncg_to_rear_axle_m = 1.4\n\n"
        "[tyre.front]\nstiffness_factor_b_per_rad = 12.0 # B\n\n[road] # dry\nfriction = 1.0\n",
        encoding="utf-8",
    )
    answer = run("import", DATA / "mf61.tir", "--config", car, "-o", new)
    assert answer.code == 0, answer.err
    made = configuration.load(new)
    assert made.tyre.front.stiffness_factor_b_per_rad is None
    assert made.tyre.rear.cornering_stiffness_n_per_rad is not None
    text = new.read_text(encoding="utf-8")
    assert "# B\n" in text
    assert "[road] # dry\nfriction = 1.0\n" in text


def test_a_map_is_solved_with_the_new_tyres(run: Run, car: Path, tmp_path: Path) -> None:
    new = tmp_path / "new.toml"
    text = car.read_text(encoding="utf-8").replace("points = 101", "points = 6").replace("points = 100", "points = 5")
    car.write_text(text, encoding="utf-8")
    assert run("import", DATA / "mf52.tir", "--config", car, "-o", new).code == 0
    assert run("solve", "--config", new, "--case", "4ws-2", "-o", tmp_path / "map.npz").code == 0


@pytest.mark.parametrize(
    ("name", "old", "new", "told"),
    [
        ("mf61.tir", "PKY2 =  1.72", "", "PKY2 is missing; add it to [LATERAL_COEFFICIENTS]"),
        ("mf61.tir", "PKY4 =  1.87", "", "PKY4 is missing; add it to [LATERAL_COEFFICIENTS]"),
        ("mf61.tir", "PPY3 = -0.17", "", "PPY3 is missing; add it to [LATERAL_COEFFICIENTS]"),
        ("mf61.tir", "NOMPRES  = 250000", "", "NOMPRES is missing; add it to [OPERATING_CONDITIONS]"),
        ("mf61.tir", "NOMPRES  = 250000", "NOMPRES = 2.5", "INFLPRES 230000 is too far from NOMPRES 2.5"),
        ("mf61.tir", "FNOMIN   = 5000", "", "FNOMIN is missing; add it to [VERTICAL]"),
        ("mf61.tir", "FNOMIN   = 5000", "FNOMIN = 5", "FNOMIN is 5 N, which no tyre is made for; check FORCE in [UNITS]"),
        ("mf61.tir", "PCY1 =  1.27", "PCY1 = 1,27", "line 31: PCY1 = '1,27' is no number"),
        ("mf61.tir", "PCY1 =  1.27", "PCY1 = 1e999", "PCY1 = 1e999 is too large"),
        ("mf61.tir", "PCY1 =  1.27", "PCY1 = 1.27\nPCY1 = 1.3", "line 32: PCY1 is there twice (first in line 31)"),
        ("mf61.tir", "PCY1 =  1.27", "PCY1 = -1.27", "PCY1 = -1.27; give a number above zero"),
        ("mf61.tir", "PKY1 = -24.1", "PKY1 = 0", "PKY1 = 0: a tyre without grip or stiffness"),
        ("mf61.tir", "PKY1 = -24.1", "PKY1 = -0.42", "ANGLE = 'degree' in [UNITS] would fit"),
        ("mf52.tir", "pky1 = 0.36", "pky1 = 20.6", "ANGLE = 'radian' in [UNITS] would fit"),
        ("mf61.tir", "PKY4 =  1.87", "PKY4 = 6", "a cornering stiffness of -"),
        ("mf61.tir", "PDY2 = -0.11", "PDY2 = -11", "a peak force of -"),
        ("mf61.tir", "PCY1 =  1.27", "PCY1 = 4", "tyre.front.shape_factor_c: 4 is outside 0.5 to 2.5"),
        ("mf61.tir", "FZMAX    = 10500", "FZMAX = 4500", "wheel load of 5712 N is outside FZMIN to FZMAX, 100 to 4500 N"),
        ("mf61.tir", "FITTYP   = 61", "FITTYP = 5", "FITTYP 5 is not read; read are PAC2002, and FITTYP 6, 21, 52"),
        ("mf61.tir", "FITTYP   = 61", "", "neither FITTYP nor PROPERTY_FILE_FORMAT"),
        ("mf61.tir", "FITTYP   = 61", "PROPERTY_FILE_FORMAT = 'FTIRE'", "PROPERTY_FILE_FORMAT 'FTIRE': not a format"),
        ("mf61.tir", "ANGLE  = 'radians'", "ANGLE = 'gon'", "line 7: ANGLE = 'gon' is not known; give 'radian' or 'degree'"),
        ("mf61.tir", "FORCE  = 'newton'", "", "[UNITS] says nothing of FORCE"),
    ],
)
def test_what_a_file_lacks_is_one_line(
    refused: Refused, car: Path, tmp_path: Path, name: str, old: str, new: str, told: str
) -> None:
    path = edited(tmp_path, name, old, new)
    line = refused("import", path, "--config", car, "-o", tmp_path / "new.toml")
    assert told in line
    assert name in line


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((), "a tyre needs the car that it is for; name its ars.toml with --config"),
        (("--config", "ars.toml", "--rows", "vx"), "--rows: this option is for a map"),
        (("--config", "none.toml"), "none.toml: cannot be read"),
    ],
)
def test_how_it_is_called(refused: Refused, car: Path, tmp_path: Path, arguments: tuple[str, ...], told: str) -> None:
    assert told in refused("import", DATA / "mf61.tir", *arguments, "-o", tmp_path / "new.toml")


def test_neither_the_car_nor_the_tyre_is_overwritten(refused: Refused, car: Path, tmp_path: Path) -> None:
    assert "it is what this command reads" in refused("import", DATA / "mf61.tir", "--config", car, "-o", car)
    assert "only .toml is written" in refused("import", DATA / "mf61.tir", "--config", car, "-o", tmp_path / "map.npz")
    three = [DATA / name for name in ("mf52.tir", "mf61.tir", "mf62.tir")]
    assert "3 files; give one map, or one or two .tir" in refused(
        "import", *three, "--config", car, "-o", tmp_path / "new.toml"
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[vehicle]\nmass_kg = 1500.0\ncg_to_front_axle_m = 1.2\n", "vehicle.cg_to_rear_axle_m: not given"),
        (
            "[vehicle]\nmass_kg = 1500.0\ncg_to_front_axle_m = 1.2\ncg_to_rear_axle_m = 1.4\n"
            "[tyre]\nfront = { cornering_stiffness_n_per_rad = 80000.0 }\n",
            "[tyre.front] is written in a way that cannot be edited",
        ),
    ],
)
def test_what_the_car_lacks_is_one_line(refused: Refused, tmp_path: Path, text: str, told: str) -> None:
    car = tmp_path / "ars.toml"
    car.write_text(text, encoding="utf-8")
    assert told in refused("import", DATA / "mf61.tir", "--config", car, "-o", tmp_path / "new.toml")


@pytest.mark.parametrize("content", [b"\x00\x01", b"hello\n", b"", b"[MODEL]\n", bytes(range(1, 256)) * 9])
def test_what_is_no_property_file_is_one_line(refused: Refused, car: Path, tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.tir"
    path.write_bytes(content)
    assert "x.tir" in refused("import", path, "--config", car, "-o", tmp_path / "new.toml")

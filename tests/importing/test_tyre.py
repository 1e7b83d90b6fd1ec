"""Tyres from property files of four versions, compared with an independent implementation of the formula (`book`)."""

import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from codegen import configuration
from codegen.errors import CodegenError
from codegen.importing import toml_edit
from codegen.importing.tyre import TyreImport, import_tyres
from codegen.vehicle.tyre import AxleTyres, static_wheel_loads
from tests.cli.conftest import Run
from tests.importing import book

DATA = Path(__file__).parent / "data"

FILES = {
    "pac2002.tir": ("PAC2002", book.mf5, book.PAC2002, -1.0),
    "mf52.tir": ("MF 5.2", book.mf5, book.MF52, 1.0),
    "mf61.tir": ("MF 6.1", book.mf6, book.MF61, -1.0),
    "mf62.tir": ("MF 6.2", book.mf6, book.MF62, -1.0),
}
"""Version, formula and coefficients of `book`, and the sign of the force in the file's axes, by file."""


@pytest.fixture
def car(tmp_path: Path) -> Path:
    path = tmp_path / "ars.toml"
    path.write_text(configuration.preset_text(), encoding="utf-8")
    return path


def peak_factor(p: book.Coefficients) -> float:
    """Return the factor of a file's peak: scaling and inflation pressure."""
    pressure = p["INFLPRES"] / p["NOMPRES"] - 1.0 if "NOMPRES" in p else 0.0
    return p["LMUY"] * (1.0 + p.get("PPY3", 0.0) * pressure + p.get("PPY4", 0.0) * pressure**2)


def tyres_of(made: TyreImport) -> AxleTyres:
    return AxleTyres.from_config(configuration.parse(tomllib.loads(made.text), "made"))


@pytest.mark.parametrize("name", FILES)
def test_curve_and_figures_average_a_left_and_a_right_tyre(name: str, car: Path) -> None:
    version, force, p, sign = FILES[name]
    made = import_tyres([DATA / name], car)
    tyres, loads = tyres_of(made), static_wheel_loads(configuration.parse(tomllib.loads(made.text), "made"))
    without = {**p, "PHY1": 0.0, "PHY2": 0.0, "PVY1": 0.0, "PVY2": 0.0}

    def pair(slips: np.ndarray, load: float) -> np.ndarray:
        return np.array([0.5 * sign * (force(without, slip, load) - force(without, -slip, load)) for slip in slips])

    bounds = (tyres.front_slip_bound, tyres.rear_slip_bound)
    for axle, tyre, bound, load in zip(made.axles, (tyres.front, tyres.rear), bounds, loads, strict=True):
        assert (axle.version, axle.load) == (version, load)
        assert (axle.horizontal_shift, axle.vertical_shift) == pytest.approx(book.shifts(p, load), rel=1e-9)
        # The error of the difference is about (B 1e-5)^2 = 1e-7; the tangent of 6.1 and nine written digits add less.
        assert tyre.cornering_stiffness == pytest.approx(float(pair(np.array([1e-5]), load)[0]) / 1e-5, rel=1e-6)
        for largest, figure in ((bound, axle.worst), (axle.slip_at_peak or math.radians(20.0), axle.worst_to_peak)):
            slips = np.linspace(0.0, largest, 301)
            difference = np.max(np.abs(tyre.force(slips) - pair(slips, load))) / axle.peak
            # This grid is coarser than that of the figure, and the curves differ more up to the peak.
            assert difference == pytest.approx(figure, abs=1e-6 if figure == axle.worst else 1e-4)
        assert axle.worst < 5e-4  # remaining causes: one E for both sides, slip instead of its tangent
        assert axle.slip_bound == pytest.approx(bound)
        slips = np.linspace(0.0, math.radians(45.0), 4501)
        forces = pair(slips, load)
        assert axle.slip_at_peak == pytest.approx(slips[np.argmax(forces)], abs=2e-4)  # the step of the grid
        sensitivity = axle.values["peak_load_sensitivity_p2"] / axle.values["peak_factor_p1"]
        for share, figure in ((0.7, axle.stiffness_lighter), (1.3, axle.stiffness_heavier)):
            other = share * load
            peak = abs(p["PDY1"] + p["PDY2"] * (other / (p["LFZO"] * p["FNOMIN"]) - 1.0)) * other * peak_factor(p)
            assert tyre.peak(other, tyre.nominal_friction) == pytest.approx(peak, rel=1e-8)  # nine digits of p1 and p2
            slope = float(pair(np.array([1e-5]), other)[0]) / 1e-5
            kept = axle.stiffness * share * (1.0 + (share - 1.0) * sensitivity)
            assert figure == pytest.approx(kept / slope - 1.0, abs=1e-5)


def test_the_friction_of_the_road_can_set_the_peak(car: Path) -> None:
    assert any("`peak='road'` takes the road's instead" in note for note in import_tyres([DATA / "mf52.tir"], car).notes)
    made = import_tyres([DATA / "mf52.tir"], car, "road")
    tyre = tyres_of(made).rear
    assert tyre.peak_factor == 1.0
    assert tyre.cornering_stiffness == pytest.approx(made.axles[1].stiffness, rel=1e-8)  # nine digits
    assert any("the road's is taken" in note for note in made.notes)


def test_neither_side_has_a_curvature_factor_above_1(car: Path, tmp_path: Path) -> None:
    text = (DATA / "mf52.tir").read_text(encoding="utf-8")
    (tmp_path / "steep.tir").write_text(text.replace("pey1 = 0.35", "pey1 = 1.0"), encoding="utf-8")
    for axle in import_tyres([tmp_path / "steep.tir"], car).axles:
        # E (1 + 0.3) exceeds 1 there, E (1 - 0.3) does not.
        other = 0.7 * (1.0 - 0.6 * (axle.load / 4600.0 - 1.0))
        assert axle.values["curvature_factor_e"] == pytest.approx(0.5 * (1.0 + other), rel=1e-8)  # nine digits


def test_two_files_are_front_and_rear_and_only_their_keys_change(run: Run, car: Path, tmp_path: Path) -> None:
    before = car.read_text(encoding="utf-8")
    new, again = tmp_path / "new.toml", tmp_path / "again.toml"
    files = (DATA / "mf61.tir", DATA / "pac2002.tir")
    answer = run("import", *files, "--config", car, "-o", new)
    assert answer.code == 0, answer.err
    kept = [line for line in new.read_text(encoding="utf-8").split("\n") if not line.startswith("# imported from ")]
    changed = [(one, other) for one, other in zip(before.split("\n"), kept, strict=True) if one != other]
    assert len(changed) == 10  # five keys for each axle; the shifts stay zero
    for part, mark in ((0, "="), (2, "#")):
        assert all(one.partition(mark)[part] == other.partition(mark)[part] for one, other in changed)
    assert run("import", *files, "--config", new, "-o", again).code == 0
    assert again.read_bytes() == new.read_bytes()  # the comment is not repeated


CAR = """steering = { ratio = 15.0, front_angle_stop_deg = 35.0 }
rear_actuator = { angle_max_deg = 3.5, rate_max_deg_s = 30.0, lag_s = 0.05 }
[vehicle]
mass_kg = 1500.0
yaw_inertia_kg_m2 = 2600.0
cg_height_m = 0.5
track_m = 1.5
cg_to_front_axle_m = 1.2
"""


def test_a_stiffness_factor_is_replaced(car: Path) -> None:
    tyres = "[tyre.front]\nstiffness_factor_b_per_rad = 12.0 # B\n\n[tyre.rear]\nstiffness_factor_b_per_rad = 12.0\n"
    car.write_text(f"{CAR}cg_to_rear_axle_m = 1.4\n\n{tyres}\n[road] # dry\nfriction = 1.0\n", encoding="utf-8")
    text = import_tyres([DATA / "mf61.tir"], car).text
    made = configuration.parse(tomllib.loads(text), "made")
    assert made.tyre.front.stiffness_factor_b_per_rad is None
    assert made.tyre.rear.cornering_stiffness_n_per_rad is not None
    assert "# B\n" in text
    assert "[road] # dry\nfriction = 1.0\n" in text


def test_new_keys_and_tables_keep_comments_with_their_table() -> None:
    text = "[a]\nx = 1.0 # m\nold = 2.0 # s\n\n# of b\n[b]\ny = [1, 2]\n"
    edited = toml_edit.replace_values(text, "a", {"x": 3.0, "new": 4.0, "z": [5.0]}, {"old": "new"}, "made by hand")
    assert edited == "[a]\n# made by hand\nx = 3.0 # m\nnew = 4.0 # s\nz = [5.0]\n\n# of b\n[b]\ny = [1, 2]\n"
    assert toml_edit.replace_values(text, "a.c", {"x": 1}, {}, "made by hand") == f"{text}\n[a.c]\n# made by hand\nx = 1\n"


def test_a_table_with_others_before_its_own_tables_is_edited() -> None:
    text = "[a]\nx = 1\n\n[b]\ny = 2\n\n[a.c]\nz = 3\n"
    edited = toml_edit.replace_values(text, "a", {"x": 4}, {}, "made by hand")
    assert edited == "[a]\n# made by hand\nx = 4\n\n[b]\ny = 2\n\n[a.c]\nz = 3\n"
    assert toml_edit.replace_values(edited, "a.c", {"z": 5}, {}, "made by hand").endswith("[a.c]\n# made by hand\nz = 5\n")


BAD_FILES = [
    ("mf61.tir", "PKY2 =  1.72", "", "PKY2 is missing; add it to [LATERAL_COEFFICIENTS]"),
    ("mf61.tir", "NOMPRES  = 250000", "NOMPRES = 2.5", "INFLPRES 230000 is too far from NOMPRES 2.5"),
    ("mf61.tir", "FNOMIN   = 5000", "FNOMIN = 5", "FNOMIN is 5 N, which no tyre is made for; check FORCE in [UNITS]"),
    ("mf61.tir", "PCY1 =  1.27", "PCY1 = 1,27", "line 31: PCY1 = '1,27' is no number"),
    ("mf61.tir", "PCY1 =  1.27", "PCY1 = 1.27\nPCY1 = 1.3", "line 32: PCY1 is there twice (first in line 31)"),
    ("mf61.tir", "PKY1 = -24.1", "PKY1 = -0.42", "ANGLE = 'degree' in [UNITS] would fit"),
    ("mf52.tir", "pky1 = 0.36", "pky1 = 20.6", "ANGLE = 'radian' in [UNITS] would fit"),
    ("mf61.tir", "PCY1 =  1.27", "PCY1 = 4", "tyre.front.shape_factor_c: 4 is outside 0.5 to 2.5"),
    ("mf61.tir", "FZMAX    = 10500", "FZMAX = 4500", "wheel load of 5712 N is outside FZMIN to FZMAX, 100 to 4500 N"),
    ("mf61.tir", "FITTYP   = 61", "FITTYP = 5", "FITTYP 5 is not read; read are PAC2002, and FITTYP 6, 21, 52"),
    ("mf61.tir", "ANGLE  = 'radians'", "ANGLE = 'gon'", "line 7: ANGLE = 'gon' is not known; give 'radian' or 'degree'"),
]
INLINE = "cg_to_rear_axle_m = 1.4\n[tyre]\n" + "".join(
    f"{axle} = {{ cornering_stiffness_n_per_rad = 80000.0 }}\n" for axle in ("front", "rear")
)
BAD_CARS = {
    CAR: "vehicle.cg_to_rear_axle_m, tyre.front.cornering_stiffness_n_per_rad, tyre.rear.cornering_stiffness_n_per_rad are",
    CAR + INLINE: "[tyre.front] is written in a way that cannot be edited",
}


def message(file: Path, car: Path) -> str:
    """Return the one-line error of an import."""
    with pytest.raises(CodegenError) as error:
        import_tyres([file], car)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_messages_for_bad_files_and_cars(car: Path, tmp_path: Path) -> None:
    for name, old, new, expected in BAD_FILES:
        text = (DATA / name).read_text(encoding="utf-8")
        assert old in text
        (tmp_path / name).write_text(text.replace(old, new, 1), encoding="utf-8")
        line = message(tmp_path / name, car)
        assert expected in line and name in line
    path = tmp_path / "x.tir"
    for content in (b"\x00\x01", b"hello\n", b"", b"[MODEL]\n", bytes(range(1, 256)) * 9):
        path.write_bytes(content)
        assert "x.tir" in message(path, car)
    for text, expected in BAD_CARS.items():
        car.write_text(text, encoding="utf-8")
        assert expected in message(DATA / "mf61.tir", car)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("bad.csv -o stood.npz", "line 5: 'fast' where a number is needed"),
        ("x.csv -o x.csv", "only .npz is written"),
        ("x.xlsx -o x.npz", ".xlsx is not supported; supported are .mat, .csv"),
        ("x.csv --config ars.toml -o x.npz", "--config: this option is for tyres"),
        ("mf61.tir -o new.toml", "tyres need the configuration of a car; name its ars.toml with --config"),
        ("mf61.tir --config ars.toml -o ars.toml", "it is an input of this command"),
    ],
)
def test_a_wrong_command_prints_one_line_and_writes_nothing(
    refused: Callable[..., str], car: Path, arguments: str, expected: str
) -> None:
    table = "vx_m_s,delta_f_rad,yaw_rate_rad_s\n5,0.1,0.1\n5,0.2,0.2\n9,0.1,0.2\n9,0.2,{}\n"
    for name, content in {"x.csv": table.format(0.3), "bad.csv": table.format("fast"), "stood.npz": "an earlier map"}.items():
        car.with_name(name).write_text(content, encoding="utf-8")
    assert expected in refused("import", *(DATA / each if each.endswith(".tir") else each for each in arguments.split()))

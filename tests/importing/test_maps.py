"""Maps from MATLAB files and text tables: round trips, the committed map in every form, and messages for bad files."""

import contextlib
import hashlib
import json
import math
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from codegen.errors import CodegenError
from codegen.importing import maps as importing
from codegen.importing.maps import Choices, import_map
from codegen.importing.source import MIB, ImportFault, Source, read
from codegen.importing.table import read_table
from codegen.map_file import map as npz
from tests.cli.conftest import Run

COMMITTED = Path(__file__).resolve().parents[2] / "generated" / "4ws2-paper.npz"

UNITS, ALL_THREE = "vx=m/s,delta_f=rad,yaw_rate=rad/s", "vx=km/h,delta_f=deg,yaw_rate=deg/s"
GOOD = "vx_m_s,delta_f_rad,yaw_rate_rad_s\n5,0.1,0.1\n5,0.2,0.2\n9,0.1,0.2\n9,0.2,0.3\n"
V = np.array([5.0, 15.0, 30.0])
D = np.array([0.01, 0.05, 0.1, 0.2])
R = V[:, None] * np.tan(D) / (2.8 + 0.006 * V[:, None] ** 2)
R[2, 3] = np.nan


def number_text(value: float) -> str:
    return "" if math.isnan(value) else repr(float(value))


def long_text(v: np.ndarray, d: np.ndarray, r: np.ndarray, head: str) -> str:
    rows = [(v[i], d[j], r[i, j]) for i in range(v.size) for j in range(d.size)]
    return "\n".join([head, *(",".join(map(number_text, row)) for row in rows)]) + "\n"


def matrix_text(v: np.ndarray, d: np.ndarray, r: np.ndarray, corner: str) -> str:
    rows = [[corner, *map(number_text, d)], *([number_text(x), *map(number_text, row)] for x, row in zip(v, r, strict=True))]
    return "\n".join(",".join(row) for row in rows) + "\n"


def decimal_comma(text: str) -> str:
    return text.replace(",", ";").replace(".", ",")


def message(path: Path, units: str | None = None, rows: Any = None, **names: str) -> str:
    """Return the one-line error of an import."""
    with pytest.raises(CodegenError) as error:
        import_map(path, Choices(names, units, rows))
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.fixture
def table(tmp_path: Path) -> Callable[[str], Path]:
    """Return a function that writes a text table and returns its path."""

    def write(text: str) -> Path:
        path = tmp_path / "x.csv"
        path.write_bytes(text.encode("latin-1"))
        return path

    return write


# --- the committed map by MATLAB -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("is_struct", [False, True])
def test_the_committed_map_returns_from_a_matlab_file(tmp_path: Path, is_struct: bool) -> None:
    """The units are km/h, deg and deg/s. The struct's table is transposed, and its names lack one unit."""
    solved, path = npz.load(COMMITTED), tmp_path / "map.mat"
    v, d, r = solved.speed * 3.6, np.degrees(solved.front_angle), np.degrees(solved.yaw_rate)
    if is_struct:
        savemat(path, {"map": {"v": v, "delta_f_deg": d, "r_deg_s": r.T}, "note": "a text"}, do_compression=True)
    else:
        savemat(path, {"v": v, "df": d, "r": r}, format="4")
    made = import_map(path, Choices({}, "vx=km/h" if is_struct else ALL_THREE))
    again = made.reference_map
    # Conversion from SI and back rounds each value twice by 2^-53. Three roundings are allowed.
    for key in ("speed", "front_angle", "yaw_rate"):
        np.testing.assert_allclose(getattr(again, key), getattr(solved, key), rtol=3 * 2.0**-52, atol=0.0, equal_nan=True)
    np.testing.assert_array_equal(again.feasible, solved.feasible)
    source = again.meta["source"]
    assert (source["file"], source["sha256"]) == (path.name, hashlib.sha256(path.read_bytes()).hexdigest())
    assert str(tmp_path) not in json.dumps(dict(again.meta))
    assert any("transposed" in line for line in made.said) == is_struct


def test_the_command_writes_the_map_and_prints_how_it_was_read(run: Run, tmp_path: Path) -> None:
    path, output = tmp_path / "x.csv", tmp_path / "x.npz"
    rows = ["5,0.1,0.1,-1,1,true,9", "5,0.2,0.2,-2,1.5,1,9", "9,0.1,0.2,0.5,2,1,9", "9,0.2,7,7,7,FALSE,9"]
    head = "vx_m_s,delta_f_rad,psidot_rad_s,beta_deg,rear_rad,feasible,extra"
    path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    answer = run("import", path, "--delta-r", "rear_rad", "--units", "delta_r=deg", "-o", output, "--json")
    printed = json.loads(answer.out)
    assert printed["variables"]["delta_r"] == {"name": "rear_rad", "unit": "deg"}
    assert {"columns left out: extra", "rear_rad is taken in deg, as given with --units"} <= set(printed["read"])
    made = npz.load(output)
    assert made.sideslip is not None and made.rear_angle is not None
    np.testing.assert_allclose(made.rear_angle[0], np.radians([1.0, 1.5]), rtol=1e-15)
    np.testing.assert_allclose(made.sideslip[0], np.radians([-1.0, -2.0]), rtol=1e-15)
    np.testing.assert_array_equal(made.feasible, [[True, True], [True, False]])


# --- text tables ---------------------------------------------------------------------------------------------------------


@st.composite
def maps(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    def axis(high: float) -> np.ndarray:
        number = st.floats(0.0, high, allow_subnormal=False)
        return np.array(sorted(draw(st.lists(number, min_size=2, max_size=5, unique=True))))

    v, d = axis(60.0), axis(1.0)
    cells = st.one_of(st.floats(-10.0, 10.0, allow_subnormal=False), st.just(math.nan))
    r = np.array(draw(st.lists(cells, min_size=v.size * d.size, max_size=v.size * d.size))).reshape(v.size, d.size)
    return v, d, r


def separated(text: str, separator: str) -> str:
    if separator == ";":
        return decimal_comma(text)
    empty = text.replace(",,", ",nan,").replace(",,", ",nan,").replace(",\n", ",nan\n")
    return empty.replace(",", separator) if separator != "," else text


@settings(max_examples=80)
@given(maps(), st.sampled_from([",", ";", "\t", "  "]), st.randoms(), st.sampled_from(["list", "rows vx", "rows delta_f"]))
def test_a_list_in_any_order_and_a_matrix_in_both_orientations_are_read(
    case: tuple[np.ndarray, np.ndarray, np.ndarray], separator: str, random: Random, form: str
) -> None:
    v, d, r = case
    rows: Any = None
    if form == "list":
        head, *lines = long_text(*case, "vx_m_s,delta_f_rad,yaw_rate_rad_s").rstrip("\n").split("\n")
        random.shuffle(lines)
        text = "\n".join(["# made by a test", head, *lines]) + "\n"
    else:
        turned, named = form == "rows delta_f", random.random() < 0.5
        rows = None if named else form.removeprefix("rows ")
        corner = (r"delta_f_rad\vx_m_s" if turned else r"vx_m_s\delta_f_rad") if named else ""
        text = matrix_text(d, v, r.T, corner) if turned else matrix_text(v, d, r, corner)
    text = separated(text, separator).replace("\n", random.choice(["\n", "\r\n"]))
    found = read_table(Source(Path("x.csv"), text.encode("latin-1")), {}, rows)
    for key, wanted in zip(("vx", "delta_f", "yaw_rate"), case, strict=True):
        np.testing.assert_array_equal(found.values[key], wanted)
        assert form != "list" or found.names[key].unit is not None


@settings(max_examples=100)
@given(st.one_of(st.binary(max_size=300), st.text(max_size=300).map(str.encode)))
def test_arbitrary_bytes_are_read_or_rejected(data: bytes) -> None:
    with contextlib.suppress(ImportFault):
        read_table(Source(Path("x.csv"), data), {}, None)


SPELLINGS = {
    "# vx_m_s delta_f_rad yaw_rate_rad_s\n5 0.1 0.1\n5 0.2 0.2\n9 0.1 0.2\n9 0.2 0.3\n": UNITS,  # numpy.savetxt
    "m/s\\rad\\rad/s,0.1,0.2\n5,0.1,0.2\n9,0.2,0.3\n": UNITS,
    "v [m/s] \\ df [rad] : r [rad/s],0.1,0.2\n5,0.1,0.2\n9,0.2,0.3\n": None,
    "NaN 0.1 0.2\n5 0.1 0.2\n9 0.2 0.3\n": UNITS,  # writematrix([NaN df; vx' r])
    "% on dry asphalt\nm/s\\rad  .1  .2\n5  0,1  0,2\n9  0,2  0,3\n": UNITS,  # a comma between spaces is a decimal comma
    "\x1c\n;0.1;0.2\n;;\n5;0.1;0.2\n9;0.2;0.3\n;;\n": UNITS,  # a line of unusual white space is empty
    '"sep=,"\nv (m/s; dry),df,r\n5,0.1,0.1\n5,0.2,0.2\n9,0.1,0.2\n9,0.2,0.3\n': UNITS,
    "v;df;r;feasible\nm/s;rad;rad/s;-\n5;0,1;0,1;1\n5;0,2;0,2;1\n9;0,1;0,2;1\n9;0,2;0,3;1\n": None,
    "v {m/s}\tdf in rad\tr (rad/s)\n5\t1d-1\t0.1\n5\t0.2\t0.2\n9\t0.1\t0.2\n9\t0.2\t0.3\n": None,
}


@pytest.mark.parametrize("text", SPELLINGS)
def test_equivalent_spellings_of_one_table(table: Callable[[str], Path], text: str) -> None:
    made = import_map(table(text), Choices({}, SPELLINGS[text])).reference_map
    np.testing.assert_array_equal(made.speed, [5.0, 9.0])
    np.testing.assert_array_equal(made.front_angle, [0.1, 0.2])
    np.testing.assert_array_equal(made.yaw_rate, [[0.1, 0.2], [0.2, 0.3]])


BAD_TABLES = [
    (GOOD.replace("9,0.1,0.2\n", ""), "line 3: a gap in the grid: no point vx = 9, delta_f = 0.1"),
    (GOOD + "5,0.2,0.25\n", "line 6: the point vx = 5, delta_f = 0.2 is there twice (first in line 3)"),
    (GOOD.replace("5,0.2,0.2", "5,0.2,1_0"), "line 3: '1_0' where a number is needed"),
    (GOOD.replace("5,0.2,0.2", "5,0.2"), "line 3: 2 cells, where the first line has 3"),
    (
        GOOD.replace("yaw_rate_rad_s", "gier"),
        "no variable is called yaw_rate or the like; name it with `variables['yaw_rate']=NAME`",
    ),
    (GOOD.replace("vx_m_s", "vx"), "x.csv: vx: the unit of vx is not known; add `units='vx="),
    (GOOD.replace("delta_f_rad", "v_m_s"), "'vx_m_s' and 'v_m_s' may both be vx; name one with `variables['vx']=NAME`"),
    (GOOD.replace("9,0.2,0.3", "9,0.2,-0.3"), "yaw_rate[1, 1]: -0.3 is outside 0 to 10 rad/s"),
    (GOOD.partition("\n")[2], "line 1: the first line has no names"),
    ("\x00", "not a text file"),
    ("m/s\\km/h,0.1,0.2\n5,0.1,0.2\n9,0.2,0.3\n", "the corner names vx twice"),
    ("Wet\n" + GOOD, "line 1: neither names for three columns nor a row of front angles; give a first line such as: vx_km_h"),
    ("vx [m/s],df,r\nkm/h,rad,rad/s\n5,0.1,0.1\n", "line 2: km/h under the name 'vx [m/s]'; give one unit for each column"),
]
CALLS = [
    ({"units": "mass=kg"}, "'mass=kg' is no NAME=UNIT; NAME is one of vx, delta_f, yaw_rate, beta, delta_r"),
    ({"units": "vx=deg"}, "'deg' is no unit for vx; give one of m/s, km/h, mph"),
    ({"rows": "vx"}, "`rows=` is for a matrix"),
    ({"vx": "speed"}, "no variable 'speed'"),
]
"""Arguments of an import of GOOD, and the message."""


def test_messages_for_bad_tables_and_arguments(table: Callable[[str], Path], tmp_path: Path) -> None:
    for text, expected in BAD_TABLES:
        assert expected in message(table(text)), text
    for arguments, expected in CALLS:
        assert expected in message(table(GOOD), **arguments)
    (tmp_path / "large").write_bytes(bytes(MIB + 1))
    with pytest.raises(ImportFault, match="over 1 MiB"):
        read(tmp_path / "large", MIB)


# --- implausible units ---------------------------------------------------------------------------------------------------

DEGREES = 180.0 / math.pi
WHEEL = "or are these angles of the steering wheel? delta_f is at the road wheel"


IMPLAUSIBLE = [
    ((1.0, 1.0, 57.3), UNITS, "yaw_rate goes to 41.98 rad/s", "yaw_rate=deg/s"),
    ((3.6, 1.0, 1.0), UNITS, "g of lateral acceleration, above 2 g", "vx=km/h"),
    ((1.0, 1.0, 1.0), "vx=km/h,delta_f=deg,yaw_rate=rad/s", "delta_f goes to 0.2 deg", "delta_f=rad,vx=m/s"),
    ((1.0, 0.2, 0.057), UNITS, "a wheelbase of 10.2 m (at most 8)", "vx=km/h"),
    ((100.0, 1.0, 1.0), UNITS, "vx goes to 3000 m/s", "check the units of all three"),
    ((3.6, DEGREES, DEGREES), None, "the unit of vx is not known", f"add `units='{ALL_THREE}'` (these would fit the v"),
    ((1.0, 40.0, 1.0), UNITS, "delta_f goes to 8 rad", WHEEL),
]


def test_an_implausible_unit_is_rejected_with_the_likely_one(table: Callable[[str], Path]) -> None:
    for (of_v, of_d, of_r), units, expected, guess in IMPLAUSIBLE:
        line = message(table(long_text(V * of_v, D * of_d, R * of_r, "vx,delta_f,yaw_rate")), units)
        assert expected in line and guess in line


# --- MATLAB --------------------------------------------------------------------------------------------------------------


@pytest.fixture
def matlab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Replace the reader of MATLAB files, which `test_mat` tests: the next import gets these arrays."""

    def file_with(**arrays: Any) -> Path:
        found = importing.Contents({name: np.atleast_2d(array) for name, array in arrays.items()}, ())
        monkeypatch.setattr(importing, "contents", lambda source: found)
        path = tmp_path / "x.mat"
        path.write_bytes(b"stand-in")
        return path

    return file_with


TURNED = "or is it the other way round? `rows='delta_f'` would fit"


def test_a_square_table_that_fits_only_when_turned(table: Callable[[str], Path]) -> None:
    v, d, r = np.array([20.0, 60.0, 90.0]), np.array([1.0, 2.0, 4.0]), np.array([[2, 4, 7.9], [5.1, 10.1, 19], [6, 12, 20]])
    path = table(matrix_text(d, v, r.T, ""))
    assert message(path, ALL_THREE).endswith(TURNED)
    np.testing.assert_allclose(import_map(path, Choices({}, ALL_THREE, "delta_f")).reference_map.yaw_rate, np.radians(r))


def test_a_table_that_fits_both_ways_needs_its_rows(table: Callable[[str], Path]) -> None:
    """Speeds in m/s and angles in deg have the same range of values; a corner that names them decides."""
    v, d = np.array([5.0, 10.0, 15.0, 20.0]), np.array([3.0, 6.0, 9.0])
    r = np.outer(v, d) / (2.9 + 0.004 * v[:, None] ** 2)
    units = "vx=m/s,delta_f=deg,yaw_rate=deg/s"
    assert message(table(matrix_text(v, d, r, "")), units).endswith(
        "speeds and front angles could be either way round; "
        "give `rows='vx'` if it has a row for each speed, else `rows='delta_f'`"
    )
    for rows, text in (("vx", matrix_text(v, d, r, "")), (None, matrix_text(d, v, r.T, r"delta_f [deg] \ vx [m/s]"))):
        found = import_map(table(text), Choices({}, units, rows)).reference_map  # type: ignore[arg-type]
        np.testing.assert_allclose(found.yaw_rate, np.radians(r))


def test_messages_for_bad_matlab_variables(matlab: Callable[..., Path]) -> None:
    good = {"vx": V, "delta_f": D, "yaw_rate": R}
    for changes, rows, expected in (
        ({"yaw_rate": R[:2]}, None, "2 x 4 values, where the axes need 3 x 4"),
        ({}, "delta_f", "3 x 4 values, where the axes need 4 x 3"),
        ({"vx": np.outer(V, D)}, None, "vx: 3 x 4 values, where a vector is needed"),
        ({"vx": V * 1j}, None, "vx: complex numbers"),
        ({"vx": V[::-1]}, None, "vx[1]: 15 is not above the breakpoint before it"),
    ):
        assert expected in message(matlab(**{**good, **changes}), UNITS, rows)


def test_a_square_table_needs_its_rows(tmp_path: Path) -> None:
    """Nothing in the file shows whether its rows are speeds or angles."""
    from scipy.io import savemat

    speed, angle = np.linspace(5.0, 30.0, 6), np.linspace(0.01, 0.06, 6)
    yaw_rate = speed[:, np.newaxis] * angle / (2.9 + 0.004 * speed[:, np.newaxis] ** 2)
    savemat(tmp_path / "map.mat", {"vx": speed, "delta_f": angle, "yaw_rate": yaw_rate.T})
    units = "vx=m/s,delta_f=rad,yaw_rate=rad/s"
    with pytest.raises(
        ImportFault, match=r"as many speeds as front angles, 6: .*; give `rows='vx'` if .*, else `rows='delta_f'`$"
    ):
        import_map(tmp_path / "map.mat", Choices({}, units))
    np.testing.assert_array_equal(
        import_map(tmp_path / "map.mat", Choices({}, units, "delta_f")).reference_map.yaw_rate, yaw_rate
    )


def test_a_sparse_table_is_read(tmp_path: Path) -> None:
    from scipy.io import savemat
    from scipy.sparse import csc_matrix

    speed, angle = np.linspace(5.0, 30.0, 6), np.linspace(0.01, 0.05, 5)
    yaw_rate = speed[:, np.newaxis] * angle / (2.9 + 0.004 * speed[:, np.newaxis] ** 2)
    savemat(tmp_path / "map.mat", {"vx": speed, "delta_f": angle, "yaw_rate": csc_matrix(yaw_rate)})
    made = import_map(tmp_path / "map.mat", Choices({}, "vx=m/s,delta_f=rad,yaw_rate=rad/s"))
    np.testing.assert_array_equal(made.reference_map.yaw_rate, yaw_rate)

"""Maps from MATLAB files and text tables: round trips, what is refused, and the committed map through every form."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from codegen.importing.cells import split
from codegen.importing.maps import Choices, import_map
from codegen.importing.quantities import take_apart
from codegen.importing.source import ImportFault, Source
from codegen.importing.table import read_table
from codegen.refmap import map as npz
from tests.cli.conftest import Run

ROOT = Path(__file__).resolve().parents[2]
COMMITTED = ROOT / "generated" / "4ws2.npz"
Refused = Callable[..., str]
FloatArray = npt.NDArray[np.float64]

UNITS = "vx=m/s,delta_f=rad,yaw_rate=rad/s"

V = np.array([5.0, 15.0, 30.0])
D = np.array([0.01, 0.05, 0.1, 0.2])
R = V[:, None] * np.tan(D) / (2.8 + 0.006 * V[:, None] ** 2)
R[2, 3] = np.nan


def text_of(value: float) -> str:
    return "" if math.isnan(value) else repr(float(value))


def long_text(v: FloatArray, d: FloatArray, r: FloatArray, head: str, separator: str = ",") -> str:
    rows = [(v[i], d[j], r[i, j]) for i in range(v.size) for j in range(d.size)]
    return "\n".join([head, *(separator.join(text_of(x) for x in row) for row in rows)]) + "\n"


def matrix_text(v: FloatArray, d: FloatArray, r: FloatArray, corner: str, separator: str = ",") -> str:
    rows = [[corner, *map(text_of, d)], *([text_of(x), *map(text_of, row)] for x, row in zip(v, r, strict=True))]
    return "\n".join(separator.join(row) for row in rows) + "\n"


def comma(text: str) -> str:
    """Decimal commas, semicolons between."""
    return text.replace(",", ";").replace(".", ",")


# --- the committed map, in every form ------------------------------------------------------------------------------------


def committed_in(folder: Path, form: str) -> tuple[Path, list[str]]:
    """The committed map written by other means in km/h, deg and deg/s, and the options that its form needs."""
    solved = npz.load(COMMITTED)
    v, d, r = solved.speed * 3.6, np.degrees(solved.front_angle), np.degrees(solved.yaw_rate)
    path = folder / f"map.{'mat' if form.startswith('v') else 'csv'}"
    names = {"speed_km_h": v, "delta_f_deg": d, "yaw_rate_deg_s": r}
    if form == "v5":
        savemat(path, names, do_compression=False)
    elif form == "v7":
        savemat(path, names, do_compression=True)
    elif form == "v4":
        savemat(path, {"v": v, "df": d, "r": r}, format="4")
        return path, ["--units", "vx=km/h,delta_f=deg,yaw_rate=deg/s"]
    elif form == "v7-struct-transposed":
        savemat(path, {"map": {"v": v, "delta_f_deg": d, "r_deg_s": r.T}, "note": "a text"}, do_compression=True)
        return path, ["--units", "vx=km/h"]
    elif form == "long":
        path.write_text(long_text(v, d, r, "v (km/h),delta_f [deg],r (deg/s)"), encoding="utf-8")
    elif form == "long-decimal-comma":
        path.write_bytes(comma(long_text(v, d, r, "speed_km_h,delta_f_deg,yaw_rate_deg_s")).encode("utf-8-sig"))
    else:
        path.write_text(matrix_text(v, d, r, r"v [km/h] \ delta_f [deg] : r [deg/s]"), encoding="utf-8")
    return path, []


@pytest.mark.parametrize("form", ["v4", "v5", "v7", "v7-struct-transposed", "long", "long-decimal-comma", "matrix"])
def test_the_committed_map_comes_back(run: Run, tmp_path: Path, form: str) -> None:
    path, options = committed_in(tmp_path, form)
    output = tmp_path / "again.npz"
    answer = run("import", path, *options, "-o", output)
    assert answer.code == 0, answer.err
    assert "101 speeds x 100 front angles, 6582 of 10100 cells feasible" in answer.out
    solved, again = npz.load(COMMITTED), npz.load(output)
    # Out of SI and back are two roundings of 2^-53 for each value, text keeps all digits: three are allowed.
    for found, wanted in (
        (again.speed, solved.speed),
        (again.front_angle, solved.front_angle),
        (again.yaw_rate, solved.yaw_rate),
    ):
        np.testing.assert_allclose(found, wanted, rtol=3 * 2.0**-52, atol=0.0, equal_nan=True)
    np.testing.assert_array_equal(again.feasible, solved.feasible)
    source = again.meta["source"]
    assert (source["file"], source["sha256"]) == (path.name, hashlib.sha256(path.read_bytes()).hexdigest())
    assert str(tmp_path) not in json.dumps(dict(again.meta))
    assert ("transposed" in answer.err) == form.endswith("transposed")


def test_an_imported_map_is_built(run: Run, tmp_path: Path) -> None:
    path, _ = committed_in(tmp_path, "v7")
    output = tmp_path / "again.npz"
    assert run("import", path, "-o", output).code == 0
    built = run("build", "--map", output, "-o", tmp_path / "built")
    assert built.code == 0, built.err
    from_solved = tmp_path / "bare.npz"
    solved = npz.load(COMMITTED)
    bare = npz.from_arrays(
        {"vx": solved.speed, "delta_f": solved.front_angle, "yaw_rate": solved.yaw_rate, "feasible": solved.feasible}, "bare"
    )
    npz.save(bare, from_solved)
    assert run("build", "--map", from_solved, "-o", tmp_path / "direct").code == 0
    # The same table in single precision: a difference in the last bit of a double is gone but in a few literals.
    one, other = ((tmp_path / name / "src" / "ars_map.c").read_text().split() for name in ("built", "direct"))
    assert len(one) == len(other)
    assert sum(a != b for a, b in zip(one, other, strict=True)) <= 5


def test_the_same_file_gives_the_same_bytes(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(long_text(V, D, R, "v_m_s,delta_f_rad,r_rad_s"), encoding="utf-8")
    for name in ("one", "two"):
        assert run("import", tmp_path / "a.csv", "-o", tmp_path / f"{name}.npz").code == 0
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()


def test_a_comma_between_spaces_is_a_decimal_one(run: Run, tmp_path: Path) -> None:
    text = "% on dry asphalt\nvx_km_h\\delta_f_deg  1  2  4\n20  2,0  4,0  7,9\n60  5,1  10,1  NaN\n"
    (tmp_path / "m.txt").write_text(text, encoding="utf-8")
    answer = run("import", tmp_path / "m.txt", "--units", "yaw_rate=deg/s", "-o", tmp_path / "m.npz")
    assert answer.code == 0, answer.err
    found = npz.load(tmp_path / "m.npz")
    np.testing.assert_allclose(np.degrees(found.yaw_rate), [[2.0, 4.0, 7.9], [5.1, 10.1, np.nan]], rtol=1e-12)


# --- text tables ---------------------------------------------------------------------------------------------------------


@st.composite
def maps(draw: st.DrawFn) -> tuple[FloatArray, FloatArray, FloatArray]:
    def axis(high: float) -> FloatArray:
        number = st.floats(0.0, high, allow_subnormal=False)
        return np.array(sorted(draw(st.lists(number, min_size=2, max_size=5, unique=True))))

    v, d = axis(60.0), axis(1.0)
    cells = st.one_of(st.floats(-10.0, 10.0, allow_subnormal=False), st.just(math.nan))
    r = np.array(draw(st.lists(cells, min_size=v.size * d.size, max_size=v.size * d.size))).reshape(v.size, d.size)
    return v, d, r


def written(text: str, separator: str) -> str:
    if separator == ";":
        return comma(text)
    empty = text.replace(",,", ",nan,").replace(",,", ",nan,").replace(",\n", ",nan\n")
    return empty.replace(",", separator) if separator != "," else text


@settings(max_examples=60)
@given(maps(), st.sampled_from([",", ";", "\t", "  "]), st.randoms(use_true_random=False), st.sampled_from(["\n", "\r\n"]))
def test_a_list_comes_back_from_any_order(
    case: tuple[FloatArray, FloatArray, FloatArray], separator: str, random: object, end: str
) -> None:
    v, d, r = case
    head, *rows = long_text(v, d, r, "vx_m_s,delta_f_rad,yaw_rate_rad_s").rstrip("\n").split("\n")
    random.shuffle(rows)  # type: ignore[attr-defined]
    text = "# made by a test\n" + written("\n".join([head, *rows]) + "\n", separator)
    found = read_table(Source(Path("x.csv"), text.replace("\n", end).encode()), {}, None)
    for key, wanted in (("vx", v), ("delta_f", d), ("yaw_rate", r)):
        np.testing.assert_array_equal(found.values[key], wanted)
        assert found.names[key].unit is not None


@settings(max_examples=60)
@given(maps(), st.sampled_from([",", ";", "\t", "  "]), st.booleans(), st.sampled_from(["", "corner"]))
def test_a_matrix_comes_back_either_way_round(
    case: tuple[FloatArray, FloatArray, FloatArray], separator: str, turned: bool, corner: str
) -> None:
    v, d, r = case
    if corner:
        corner = r"delta_f_rad\vx_m_s" if turned else r"vx_m_s\delta_f_rad"
    text = written(matrix_text(d, v, r.T, corner) if turned else matrix_text(v, d, r, corner), separator)
    rows = None if corner else ("delta_f" if turned else "vx")
    found = read_table(Source(Path("x.csv"), text.encode("latin-1")), {}, rows)  # type: ignore[arg-type]
    for key, wanted in (("vx", v), ("delta_f", d), ("yaw_rate", r)):
        np.testing.assert_array_equal(found.values[key], wanted)


@settings(max_examples=200)
@given(st.one_of(st.binary(max_size=300), st.text(max_size=300).map(str.encode)))
def test_no_bytes_make_the_reader_stumble(data: bytes) -> None:
    with contextlib.suppress(ImportFault):
        read_table(Source(Path("x.csv"), data), {}, None)


@pytest.mark.parametrize(
    ("name", "base", "unit"),
    [
        ("speed_km_h", "speed", "km/h"),
        ("Map.Delta_f [deg]", "deltaf", "deg"),
        ("yaw rate (rad/s)", "yawrate", "rad/s"),
        ("yaw_rate_deg_s", "yawrate", "deg/s"),
        ("V [kph]", "v", "km/h"),
        ("delta_f [°]", "deltaf", "deg"),
        ("r", "r", None),
        ("beta_rad", "beta", "rad"),
        ("vx_mph", "vx", "mph"),
        ("v in km/h", "v", "km/h"),
        ("yaw_rate_in_deg_s", "yawrate", "deg/s"),
        ("v{km/h}", "v", "km/h"),
        ("delta_f {deg}", "deltaf", "deg"),
        ("deg", "deg", None),
    ],
)
def test_a_name_is_taken_apart(name: str, base: str, unit: str | None) -> None:
    found = take_apart(name)
    assert (found.base, found.unit) == (base, unit)


@pytest.mark.parametrize(
    "text",
    [
        "# vx_m_s delta_f_rad yaw_rate_rad_s\n5 0.1 0.1\n5 0.2 0.2\n9 0.1 0.2\n9 0.2 0.3\n",  # numpy.savetxt
        "% units in the names\nvx [m/s]  delta_f [rad]  r [rad/s]\n5 0.1 0.1 % first\n5 0.2 0.2\n9 0.1 0.2\n9 0.2 0.3\n",
        '"vx [m/s]";"delta_f [rad]";"r [rad/s]";\n5;0,1;0,1;\n5;0,2;0,2;\n9;0,1;0,2;\n9;0,2;0,3;\n',
        "m/s\\rad\\rad/s,0.1,0.2\n5,0.1,0.2\n9,0.2,0.3\n",
        "NaN 0.1 0.2\n5 0.1 0.2\n9 0.2 0.3\n",  # writematrix([NaN df; vx' r])
        "rad | m/s\t5\t9\n0.1\t0.1\t0.2\n0.2\t0.2\t0.3\n",
        "v in m/s  delta_f in rad  r in rad/s\n5 0.1 0.1\n5 0.2 0.2\n9 0.1 0.2\n9 0.2 0.3\n",
        ";;\nv;df;r;\n;;;\n5;0,1;0,1;\n5;0,2;0,2;\n ; ;\n9;0,1;0,2;\n9;0,2;0,3;\n;;;;;;\n",
        ";0.1;0.2\n;;\n5;0.1;0.2\n9;0.2;0.3\n;;\n",
        "sep=;\nv;df;r\n5;0,1;0,1\n5;0,2;0,2\n9;0,1;0,2\n9;0,2;0,3\n",
        '"sep=,"\nv (m/s; dry),df,r\n5,0.1,0.1\n5,0.2,0.2\n9,0.1,0.2\n9,0.2,0.3\n',
    ],
)
def test_ways_to_write_a_table(tmp_path: Path, text: str) -> None:
    path = tmp_path / "x.txt"
    path.write_text(text, encoding="latin-1")
    made = import_map(path, Choices({}, UNITS)).reference_map
    np.testing.assert_array_equal(made.speed, [5.0, 9.0])
    np.testing.assert_array_equal(made.front_angle, [0.1, 0.2])
    np.testing.assert_array_equal(made.yaw_rate, [[0.1, 0.2], [0.2, 0.3]])


@pytest.mark.parametrize(
    ("head", "names"),
    [
        ("v;df;r;feasible\nkm/h;deg;deg/s;-", ["v [km/h]", "df [deg]", "r [deg/s]"]),
        ("v [km/h];df;r;feasible\n[km/h];(deg);{deg/s};", ["v [km/h]", "df [deg]", "r [deg/s]"]),
        ("v {km/h};df in deg;r (deg/s);feasible", ["v {km/h}", "df in deg", "r (deg/s)"]),
    ],
)
def test_units_of_a_second_line_and_in_other_clothes(tmp_path: Path, head: str, names: list[str]) -> None:
    path = tmp_path / "x.csv"
    path.write_text(f"{head}\n20;1;2;1\n20;2;4;1\n60;1;5,1;1\n60;2;10,1;1\n", encoding="utf-8")
    made = import_map(path, Choices({}))
    assert [made.columns[key] for key in ("vx", "delta_f", "yaw_rate")] == [
        {"name": name, "unit": unit} for name, unit in zip(names, ("km/h", "deg", "deg/s"), strict=True)
    ]
    np.testing.assert_allclose(made.reference_map.speed, [20.0 / 3.6, 60.0 / 3.6], rtol=1e-15)
    np.testing.assert_allclose(made.reference_map.yaw_rate, np.radians([[2.0, 4.0], [5.1, 10.1]]), rtol=1e-15)


def test_sideslip_rear_angle_and_feasible_come_along(run: Run, tmp_path: Path) -> None:
    path, output = tmp_path / "x.csv", tmp_path / "x.npz"
    rows = ["5,0.1,0.1,-1,1,true,9", "5,0.2,0.2,-2,1.5,1,9", "9,0.1,0.2,0.5,2,1,9", "9,0.2,7,7,7,FALSE,9"]
    head = "vx_m_s,delta_f_rad,psidot_rad_s,beta_deg,rear,feasible,extra"
    path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    answer = run("import", path, "--delta-r", "rear", "--units", "delta_r=deg", "-o", output, "--json")
    assert answer.code == 0, answer.err
    told = json.loads(answer.out)
    assert told["variables"]["delta_r"] == {"name": "rear", "unit": "deg"}
    assert "columns left out: extra" in told["read"]
    made = npz.load(output)
    assert made.sideslip is not None
    assert made.rear_angle is not None
    np.testing.assert_allclose(made.rear_angle[0], np.radians([1.0, 1.5]), rtol=1e-15)
    np.testing.assert_array_equal(made.feasible, [[True, True], [True, False]])


TITLE = (
    "neither names for three columns nor a row of front angles; give a first line such as: vx_km_h, delta_f_deg, "
    "yaw_rate_deg_s; put # before a title"
)
GOOD = "vx_m_s,delta_f_rad,yaw_rate_rad_s\n5,0.1,0.1\n5,0.2,0.2\n9,0.1,0.2\n9,0.2,0.3\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (GOOD.replace("9,0.1,0.2\n", ""), "line 3: a gap in the grid: no point vx = 9, delta_f = 0.1"),
        (GOOD.replace("9,0.2,0.3\n", ""), "line 4: a gap in the grid: no point vx = 9, delta_f = 0.2"),
        (GOOD + "5,0.2,0.25\n", "line 6: the point vx = 5, delta_f = 0.2 is there twice (first in line 3)"),
        (GOOD.replace("5,0.2,0.2", "5,0.2,fast"), "line 3: 'fast' where a number is needed"),
        (GOOD.replace("5,0.2,0.2", "5,0.2,1_0"), "line 3: '1_0' where a number is needed"),
        (GOOD.replace("5,0.2,0.2", "5,0.2,1e999"), "line 3: '1e999' is too large"),
        (GOOD.replace("5,0.2,0.2", "5,0.2"), "line 3: 2 cells, where the first line has 3"),
        (GOOD.replace("5,0.2,0.2", ",0.2,0.2"), "line 3: no value for vx"),
        (GOOD.replace("yaw_rate_rad_s", "gier"), "no variable is called yaw_rate or the like; name it with --yaw-rate NAME"),
        (GOOD.replace("vx_m_s", "vx"), "x.csv: vx: nothing says in which unit vx is; add --units vx="),
        (GOOD.replace("vx_m_s", "vx [furlong]"), "'furlong' is no unit for vx"),
        (GOOD.replace("vx_m_s", "vx_rad"), "rad is no unit for vx"),
        (GOOD.replace("delta_f_rad", "v_m_s"), "'vx_m_s' and 'v_m_s' may both be vx; name one with --vx NAME"),
        (GOOD.replace("delta_f_rad", "vx_m_s"), "the column 'vx_m_s' is there twice"),
        (GOOD.replace("9,0.2,0.3", "9,0.2,-0.3"), "yaw_rate[1, 1]: -0.3 is outside 0 to 10 rad/s"),
        (GOOD.partition("\n")[2], "line 1: the first line has no names"),
        ("vx_m_s,delta_f_rad,yaw_rate_rad_s\n", "no table: less than two lines"),
        ("\x00", "not a text file"),
        ("", "empty"),
        ("a b\n1 2\n", "neither names for three columns nor a row of front angles"),
        ("vx\\beta,0.1,0.2\n5,0.1,0.2\n9,0.2,0.3\n", "the corner 'beta' is no name or unit of a map"),
        ("m/s\\km/h,0.1,0.2\n5,0.1,0.2\n9,0.2,0.3\n", "the corner names vx twice"),
        ("m/s\\rad\\rad/s,0.1,\n5,0.1,0.2\n9,0.2,0.3\n", "line 1: no value for delta_f"),
        ("Drive 12, wet\n" + GOOD, f"line 1: {TITLE}"),
        ("Wet\n" + GOOD, f"line 1: {TITLE}"),
        ("2026-05-03 Drive 12;;\nWet;;\n" + GOOD.replace(",", ";"), f"line 1: {TITLE}"),
        ("Three, words, here\n" + GOOD, f"line 1: {TITLE}"),
        ("Drive on a wet road\nvx df r\n5 0.1 0.1\n5 0.2 0.2\n", f"line 1: {TITLE}"),
        ("Drive 12\nvx df r\n5 0.1 0.1\n5 0.2 0.2\n", f"line 1: {TITLE}"),
        ("Drive 12\nNaN 0.1 0.2\n5 0.1 0.1\n5 0.2 0.2\n", f"line 1: {TITLE}"),
        ("Drive 1 2 3\nNaN 0.1 0.2\n5 0.1 0.1\n5 0.2 0.2\n", "the same number of cells, and put # before a title"),
        ("Drive\n;0.1;0.2\n5;0.1;0.2\n9;0.2;0.3\n", f"line 1: {TITLE}"),
        ("vx [m/s],df,r\nkm/h,rad,rad/s\n5,0.1,0.1\n", "line 2: km/h under the name 'vx [m/s]'; give one unit for each column"),
        ("vx,df,r\nkm/h,deg\n5,0.1,0.1\n", "line 2: 2 cells, where the first line has 3"),
        ("vx,df,r\nfurlong,deg,deg/s\n5,0.1,0.1\n", "line 2: 'furlong' where a number is needed"),
        ("sep=;\n", "no table: less than two lines"),
        (",,\n;;\n", "no table: less than two lines"),
    ],
)
def test_a_bad_table_is_one_line(refused: Refused, tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "x.csv"
    path.write_text(text, encoding="utf-8")
    line = refused("import", path, "-o", tmp_path / "x.npz")
    assert told in line


# --- units that cannot be right ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("factors", "units", "told", "guess"),
    [
        ((1.0, 57.3, 1.0), UNITS, "delta_f goes to 11.46 rad", "delta_f=deg"),
        ((1.0, 1.0, 57.3), UNITS, "yaw_rate goes to 41.98 rad/s", "yaw_rate=deg/s"),
        ((3.6, 1.0, 1.0), UNITS, "g of lateral acceleration, above 2 g", "vx=km/h"),
        ((1.0, 1.0, 1.0), "vx=m/s,delta_f=deg,yaw_rate=rad/s", "delta_f goes to 0.2 deg", "delta_f=rad"),
        ((1.0, 1.0, 1.0), "vx=m/s,delta_f=rad,yaw_rate=deg/s", "yaw_rate goes to 0.7327 deg/s", "yaw_rate=rad/s"),
        ((1.0, 1.0, 1.0), "vx=km/h,delta_f=rad,yaw_rate=rad/s", "a wheelbase of 0.819 m (at least 0.9)", "vx=m/s"),
        ((1.0, 1.0, 1.0), "vx=km/h,delta_f=deg,yaw_rate=rad/s", "delta_f goes to 0.2 deg", "delta_f=rad,vx=m/s"),
        ((1.0, 0.2, 0.057), UNITS, "a wheelbase of 10.2 m (at most 8)", "vx=km/h"),
        ((100.0, 1.0, 1.0), UNITS, "vx goes to 3000 m/s", "check the units of all three"),
    ],
)
def test_a_unit_that_cannot_be_right(
    refused: Refused, tmp_path: Path, factors: tuple[float, float, float], units: str, told: str, guess: str
) -> None:
    path = tmp_path / "x.csv"
    path.write_text(long_text(V * factors[0], D * factors[1], R * factors[2], "vx,delta_f,yaw_rate"), encoding="utf-8")
    line = refused("import", path, "--units", units, "-o", tmp_path / "x.npz")
    assert told in line
    assert guess in line


WHEEL = "or are these angles of the steering wheel? delta_f is at the road wheel"


@pytest.mark.parametrize("rate", ["deg/s", "rad/s"])
def test_angles_of_the_steering_wheel_are_not_taken_for_a_wrong_unit(refused: Refused, tmp_path: Path, rate: str) -> None:
    """In m/s there would be no slow turn to judge by; the ratio of the steering is 16."""
    path = tmp_path / "x.csv"
    head = f"v [km/h],steering wheel [deg],r [{rate}]"
    path.write_text(f"{head}\n20,16,2.0\n20,32,4.0\n60,16,5.1\n60,32,10.1\n", encoding="utf-8")
    line = refused("import", path, "--delta-f", "steering wheel", "-o", tmp_path / "x.npz")
    assert "would fit" not in line
    assert "check the units of all three, and which variable is which" in line
    if rate == "deg/s":
        assert "a wheelbase of 45.6 m" in line
        assert line.rstrip().endswith(WHEEL)
    path.write_text("v,steer,r\n20,16,2.0\n20,32,4.0\n60,16,5.1\n60,32,10.1\n", encoding="utf-8")
    assert "would fit" not in refused("import", path, "-o", tmp_path / "x.npz")


def test_a_large_angle_of_the_steering_wheel(refused: Refused, tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text(long_text(V, 40.0 * np.degrees(D), R, "v_m_s,delta_f_deg,r_rad_s"), encoding="utf-8")
    assert refused("import", path, "-o", tmp_path / "x.npz").rstrip().endswith(WHEEL)


def test_units_that_would_fit_are_told(refused: Refused, tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text(long_text(V * 3.6, np.degrees(D), np.degrees(R), "vx,delta_f,yaw_rate"), encoding="utf-8")
    line = refused("import", path, "-o", tmp_path / "x.npz")
    assert "add --units vx=km/h,delta_f=deg,yaw_rate=deg/s (these would fit the values)" in line


@pytest.mark.parametrize(
    ("units", "told"),
    [
        ("vx", "'vx' is no NAME=UNIT"),
        ("mass=kg", "'mass=kg' is no NAME=UNIT; NAME is one of vx, delta_f, yaw_rate, beta, delta_r"),
        ("vx=deg", "'deg' is no unit for vx; give one of m/s, km/h, mph"),
        ("vx=m/s,v=m/s", "vx is there twice"),
        ("beta=deg", "x.csv has no beta"),
    ],
)
def test_bad_units_are_one_line(refused: Refused, tmp_path: Path, units: str, told: str) -> None:
    (tmp_path / "x.csv").write_text(GOOD, encoding="utf-8")
    assert told in refused("import", tmp_path / "x.csv", "--units", units, "-o", tmp_path / "x.npz")


def test_units_overrule_a_name_and_say_so(run: Run, tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text(GOOD.replace("delta_f_rad", "delta_f_deg"), encoding="utf-8")
    answer = run("import", tmp_path / "x.csv", "--units", "delta_f=rad", "-o", tmp_path / "x.npz")
    assert answer.code == 0
    assert "delta_f_deg is taken in rad, as --units says" in answer.err


# --- MATLAB --------------------------------------------------------------------------------------------------------------


def save(folder: Path, **arrays: object) -> Path:
    path = folder / "x.mat"
    savemat(path, arrays)
    return path


def test_a_square_table_needs_no_flag_but_takes_one(run: Run, tmp_path: Path) -> None:
    path = save(tmp_path, vx=V, delta_f=D[:3], yaw_rate=R[:, :3])
    answer = run("import", path, "--units", UNITS, "-o", tmp_path / "a.npz")
    assert "its rows are taken for vx (--rows delta_f for the other way round)" in answer.err
    path = save(tmp_path, vx=V, delta_f=D[:3], yaw_rate=R[:, :3].T)
    assert run("import", path, "--units", UNITS, "--rows", "delta_f", "-o", tmp_path / "b.npz").code == 0
    np.testing.assert_array_equal(npz.load(tmp_path / "a.npz").yaw_rate, npz.load(tmp_path / "b.npz").yaw_rate)


TURNED = "or is it the other way round? --rows delta_f would fit"


def test_a_table_that_fits_the_other_way_round(run: Run, refused: Refused, tmp_path: Path) -> None:
    v, d, r = np.array([20.0, 60.0, 90.0]), np.array([1.0, 2.0, 4.0]), np.array([[2, 4, 7.9], [5.1, 10.1, 19], [6, 12, 20]])
    units = "vx=km/h,delta_f=deg,yaw_rate=deg/s"
    text = tmp_path / "x.csv"
    text.write_text(matrix_text(d, v, r.T, ""), encoding="utf-8")
    for path in (text, save(tmp_path, vx=v, delta_f=d, yaw_rate=r.T)):
        if path == text:
            assert refused("import", path, "--units", units, "-o", tmp_path / "x.npz").rstrip().endswith(TURNED)
        answer = run("import", path, "--units", units, "--rows", "delta_f", "-o", tmp_path / f"{path.suffix}.npz")
        assert answer.code == 0, answer.err
    np.testing.assert_array_equal(npz.load(tmp_path / ".csv.npz").yaw_rate, npz.load(tmp_path / ".mat.npz").yaw_rate)


def test_a_square_matlab_table_that_fits_the_other_way_round(refused: Refused, tmp_path: Path) -> None:
    """At 60 m/s the rates of the largest angle would be 2 g and more the wrong way round."""
    v, d = np.array([3.0, 20.0, 60.0]), np.array([0.01, 0.1, 0.5])
    r = v[:, None] * np.tan(d) / (2.8 + 0.2 * v[:, None] ** 2)
    path = save(tmp_path, vx=v, delta_f=d, yaw_rate=r.T)
    assert refused("import", path, "--units", UNITS, "-o", tmp_path / "x.npz").rstrip().endswith(TURNED)
    line = refused("import", path, "--units", UNITS, "--rows", "vx", "-o", tmp_path / "x.npz")
    assert TURNED not in line
    path = save(tmp_path, vx=v * 10.0, delta_f=d, yaw_rate=r)
    assert TURNED not in refused("import", path, "--units", UNITS, "-o", tmp_path / "x.npz")


@pytest.mark.parametrize("options", [(), ("--vx", "vx")])
def test_structs_inside_structs_are_told(refused: Refused, tmp_path: Path, options: tuple[str, ...]) -> None:
    breakpoints = np.array([[({"Value": V},), ({"Value": D},)]], dtype=[("Value", object)])
    path = save(tmp_path, lut={"Breakpoints": breakpoints, "Table": {"Value": R}})
    line = refused("import", path, *options, "--units", UNITS, "-o", tmp_path / "x.npz")
    assert line.rstrip().endswith("structs inside structs are not read (lut.Breakpoints); save vx, delta_f and yaw_rate")


@pytest.mark.parametrize(
    ("arrays", "options", "told"),
    [
        ({"vx": V, "delta_f": D}, (), "no variable is called yaw_rate or the like"),
        ({"vx": V, "delta_f": D, "yaw_rate": R[:2]}, (), "2 x 4 values, where the axes need 3 x 4"),
        ({"vx": V, "delta_f": D, "yaw_rate": R}, ("--rows", "delta_f"), "3 x 4 values, where the axes need 4 x 3"),
        ({"vx": np.outer(V, D), "delta_f": D, "yaw_rate": R}, (), "vx: 3 x 4 values, where a vector is needed"),
        ({"vx": V * 1j, "delta_f": D, "yaw_rate": R}, (), "vx: complex numbers"),
        ({"vx": V[::-1], "delta_f": D, "yaw_rate": R}, (), "vx[1]: 15 is not above the breakpoint before it"),
        ({"vx": V, "v": V, "delta_f": D, "yaw_rate": R}, (), "'vx' and 'v' may both be vx; name one with --vx"),
        ({"vx": V, "delta_f": D, "yaw_rate": R}, ("--yaw-rate", "gier"), "no variable 'gier'; --yaw-rate takes one of vx"),
        ({"vx": V, "delta_f": D, "yaw_rate": R, "beta": R[0]}, (), "beta: shape (1, 4), where (3, 4) is needed"),
        ({"vx": "a text", "delta_f": D, "yaw_rate": R}, (), "no variable is called vx or the like"),
    ],
)
def test_a_bad_matlab_file_is_one_line(
    refused: Refused, tmp_path: Path, arrays: dict[str, object], options: tuple[str, ...], told: str
) -> None:
    units = UNITS + (",beta=rad" if "beta" in arrays else "")
    assert told in refused("import", save(tmp_path, **arrays), *options, "--units", units, "-o", tmp_path / "x.npz")


def test_version_7_3_is_refused_with_the_remedy(refused: Refused, tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(124) + b"\x00\x02IM"
    path.write_bytes(header.ljust(512, b"\0") + b"\x89HDF\r\n\x1a\n" + bytes(100))
    line = refused("import", path, "-o", tmp_path / "x.npz")
    assert "version 7.3 (HDF5)" in line
    assert "'-v7'" in line


def test_damage_is_one_line(refused: Refused, tmp_path: Path) -> None:
    data = save(tmp_path, vx=V, delta_f=D, yaw_rate=R).read_bytes()
    path = tmp_path / "x.mat"
    for bad in (data[:200], b"hello", data[:128] + bytes(range(256))):
        path.write_bytes(bad)
        assert "x.mat: damaged, or no MAT-file of version 4 to 7.2" in refused("import", path, "-o", tmp_path / "x.npz")


# --- how it is called ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("x.csv", "-o", "x.csv"), "only .npz is written"),
        (("x.csv", "-o", "no/x.npz"), "its folder does not exist"),
        (("x.csv", "x.csv", "-o", "x.npz"), "2 files; give one map"),
        (("x.xlsx", "-o", "x.npz"), ".xlsx is not read; read are .mat, .csv"),
        (("x.npz", "-o", "y.npz"), "is a map already"),
        (("none.csv", "-o", "x.npz"), "none.csv: cannot be read"),
        (("x.csv", "--config", "ars.toml", "-o", "x.npz"), "--config: this option is for tyres"),
        (("x.csv", "--rows", "vx", "-o", "x.npz"), "--rows is for a matrix"),
        (("x.csv", "--vx", "speed", "-o", "x.npz"), "no variable 'speed'"),
        (("x.csv",), "Missing option '-o'"),
        (("-o", "x.npz"), "Missing argument 'FILE...'"),
    ],
)
def test_a_wrong_call_is_one_line(refused: Refused, tmp_path: Path, arguments: tuple[str, ...], told: str) -> None:
    (tmp_path / "x.csv").write_text(GOOD, encoding="utf-8")
    assert told in refused("import", *arguments)


def test_a_failed_import_leaves_what_stood(run: Run, tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text(GOOD.replace("0.3", "fast"), encoding="utf-8")
    (tmp_path / "x.npz").write_bytes(b"what stood")
    assert run("import", tmp_path / "x.csv", "-o", tmp_path / "x.npz").code == 2
    assert (tmp_path / "x.npz").read_bytes() == b"what stood"


def test_the_separator_is_told_by_the_first_line() -> None:
    assert split("a;b;c\n1,5;2;3\n", "x").body[0].cells == ("1,5", "2", "3")
    assert split("a\tb\tc\n1\t\t3\n", "x").body[0].cells == ("1", "", "3")

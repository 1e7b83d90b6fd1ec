"""`ars.toml`: what is accepted, and for everything else one line that names the key and the remedy."""

from __future__ import annotations

import json
import math
import re
import tomllib
import types
import typing
from pathlib import Path
from typing import Any, Literal

import pytest
from pydantic import BaseModel

from codegen import config as configuration
from codegen.config import Case, Config, check_name, load, parse, preset, preset_text
from codegen.errors import CodegenError, ConfigError


def refused(text: str) -> str:
    """Return the message for a TOML text, after the checks that hold for every message."""
    with pytest.raises(ConfigError) as caught:
        parse(tomllib.loads(text), "car.toml")
    return checked(caught.value)


def checked(error: CodegenError) -> str:
    message = str(error)
    assert "\n" not in message
    assert message.isprintable()
    assert len(message) < 950  # three parts of 300 at most
    assert error.what
    assert error.where
    assert error.remedy
    assert error.exit_code == 2
    return message


def table(key: str, value: str) -> str:
    """Return TOML that sets one dotted key."""
    section, _, name = key.rpartition(".")
    return f"[{section}]\n{name} = {value}\n" if section else f"{name} = {value}\n"


# --- defaults and the preset ---------------------------------------------------------------------------------------


def differences(left: Any, right: Any, key: str = "") -> dict[str, tuple[Any, Any]]:
    """Return the leaves that differ, by their dotted key."""
    if isinstance(left, dict) and isinstance(right, dict):
        found: dict[str, tuple[Any, Any]] = {}
        for name in left.keys() | right.keys():
            found |= differences(left.get(name), right.get(name), f"{key}.{name}".lstrip("."))
        return found
    return {} if left == right and type(left) is type(right) else {key: (left, right)}


CYCLE_TIMES = {f"can.{role}.cycle_time_ms": (None, 10.0) for role in preset().can.messages()}
"""A cycle time that is not given is the sampling time."""


def test_defaults_are_the_recommended_preset() -> None:
    found = differences(Config().model_dump(mode="json"), preset("recommended").model_dump(mode="json"))
    assert found == CYCLE_TIMES


def test_the_papers_preset_differs_in_its_controller_alone() -> None:
    """The paper limits no rate and has no limiter; a controller for a car should."""
    found = differences(preset("recommended").model_dump(mode="json"), preset().model_dump(mode="json"))
    assert found == {
        "controller.kind": ("tracking", "pi"),
        "controller.rear_rate_max_deg_s": (25.0, "off"),
        "limiter.rear_rate_max_deg_s": (30.0, "off"),
        "limiter.opposite_phase_max_deg": ("from-car", "off"),
    }


def test_presets_are_files_that_read_back(tmp_path: Path) -> None:
    """An empty file is the default car, and line ends of Windows do not matter."""
    path = tmp_path / "ars.toml"
    path.write_text("")
    assert load(path) == Config()
    path.write_bytes(preset_text().replace("\n", "\r\n").encode())
    assert load(path) == preset()


def test_preset_holds_the_published_numbers() -> None:
    paper = preset()
    assert (paper.vehicle.mass_kg, paper.vehicle.yaw_inertia_kg_m2) == (2335.07, 5376.432)
    assert (paper.vehicle.cg_height_m, paper.vehicle.track_m, paper.vehicle.front_roll_share) == (0.42, 1.627, 0.6)
    assert paper.vehicle.wheelbase == pytest.approx(3.14, rel=1e-15)
    assert paper.tyre.front.cornering_stiffness_n_per_rad == 119_540.0
    assert paper.tyre.rear.cornering_stiffness_n_per_rad == 119_830.0
    assert (paper.road.friction, paper.road.gravity_m_s2) == (0.9, 9.81)
    assert (paper.limits.sideslip_max_deg, paper.limits.rear_angle_max_deg) == (3.0, 3.5)
    assert (paper.limits.lateral_acceleration_max_g, paper.limits.slip_departure_percent) == (0.8, 10.0)
    assert (paper.controller.proportional_gain_s, paper.controller.integral_gain) == (0.01, 1.0)
    assert (paper.controller.sampling_time_s, paper.plant.sampling_time_s) == (0.01, 0.001)
    assert paper.steering.ratio * 6.75 == pytest.approx(90.0, rel=1e-15)
    assert paper.steering.wheel_rate_max_deg_s == 300.0
    assert paper.case("fws") == Case(rear_steering=False, sideslip_weight_per_s2=100.0)
    assert paper.case("4ws-1") == Case(rear_steering=True, sideslip_weight_per_s2=100.0)
    assert paper.case("4ws-2") == Case(rear_steering=True, sideslip_weight_per_s2=3000.0)


def leaves(model: type[BaseModel], key: str = "") -> dict[str, Any]:
    """Return every field that is not a table, by its dotted key, with its annotation."""
    found: dict[str, Any] = {}
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            found |= leaves(kind, f"{key}{name}.")
        elif name != "cases":
            found[f"{key}{name}"] = kind
    return found


LEAVES = leaves(Config)


WRITTEN_BY_TUNE = "controller.tracking.schedule."
OF_THE_RECOMMENDED = ("controller.tracking.", "tuning.")


@pytest.mark.parametrize("name", ["paper", "recommended"])
def test_preset_shows_every_key(name: Literal["paper", "recommended"]) -> None:
    """What a user may set stands in the file that they edit; of two ways to say the same, one."""
    shown = tomllib.loads(preset_text(name))
    for key in LEAVES:
        if key.startswith(WRITTEN_BY_TUNE) or (name == "paper" and key.startswith(OF_THE_RECOMMENDED)):
            continue
        node: Any = shown
        for part in key.split("."):
            node = node.get(part) if isinstance(node, dict) else None
        if node is None:
            assert key.rpartition(".")[2] in preset_text(name), key  # named in a comment


def test_every_number_names_its_unit() -> None:
    units = re.compile(r"_(kg|kg_m2|m|m_s2|n|n_per_rad|per_rad|per_s2|deg|deg_s|km_h|g|percent|s|ms|kbit_s|m_s3|db)\Z")
    # Ratios, friction, gain of an integral of angle: no unit. `b_per_rad` is one by its suffix.
    bare = {"friction", "front_roll_share", "shape_factor_c", "curvature_factor_e", "peak_factor_p1", "ratio", "friction_max"}
    bare |= {"peak_load_sensitivity_p2", "friction_min", "integral_gain"}
    bare |= {"sensitivity_max", "sensitivity"}  # peak of |1/(1 + L)|
    bare |= {"factor", "offset"}  # of a CAN signal, whose unit is that of what it carries
    for key, kind in {**LEAVES, "cases.X.sideslip_weight_per_s2": float}.items():
        name = key.rpartition(".")[2]
        alternatives = typing.get_args(kind) if isinstance(kind, types.UnionType) else (kind,)
        if any(alternative is float or typing.get_origin(alternative) is list for alternative in alternatives):
            assert units.search(name) or name in bare, key


def test_units_are_turned_into_si() -> None:
    config = parse(
        {
            "limits": {"sideslip_max_deg": 2.0, "rear_angle_max_deg": 4.0},
            "steering": {"front_angle_stop_deg": 30.0},
            "rear_actuator": {"angle_max_deg": 5.0},
        },
        "car.toml",
    )
    assert config.limits.sideslip_max == math.radians(2.0)
    assert config.limits.rear_angle_max == math.radians(4.0)
    assert config.steering.front_angle_stop == math.radians(30.0)
    assert config.rear_actuator.angle_max == math.radians(5.0)
    assert pytest.approx(1.0, rel=1e-15) == 3.6 * configuration.KM_H


# --- values --------------------------------------------------------------------------------------------------------

FLOATS = [
    key
    for key, kind in LEAVES.items()
    if any(part is float for part in (typing.get_args(kind) if isinstance(kind, types.UnionType) else (kind,)))
]


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "-1e9", "1e9", "true", '"1.0"', "[1.0]", "{}", "2020-01-01"])
def test_no_number_takes_what_no_car_has(value: str) -> None:
    assert FLOATS
    for key in (*FLOATS, "cases.mine.sideslip_weight_per_s2"):
        assert refused(table(key, value)).startswith(f"car.toml: {key}: ")  # the key as written, no inner path of a checker


# A value in another unit is one that no car can have. The paper's own values, converted.
@pytest.mark.parametrize(
    ("unit", "values"),
    [
        ("kg", {"vehicle.mass_kg": (2.33507, 2335070.0)}),  # t, g
        ("kg m^2", {"vehicle.yaw_inertia_kg_m2": (5.376432,)}),  # t m^2
        ("m", {"vehicle.cg_height_m": (420.0, 42.0), "vehicle.cg_to_front_axle_m": (1574.0,)}),  # mm, cm
        ("m", {"vehicle.track_m": (1627.0,), "vehicle.cg_to_rear_axle_m": (156.6,)}),
        ("", {"vehicle.front_roll_share": (60.0,), "road.friction": (90.0,), "controller.friction_min": (10.0,)}),  # percent
        ("m/s^2", {"road.gravity_m_s2": (981.0,)}),  # cm/s^2
        ("N/rad", {"tyre.front.cornering_stiffness_n_per_rad": (119.54,)}),  # kN/rad
        ("1/rad", {"tyre.rear.stiffness_factor_b_per_rad": (17.9 / 57.3,)}),  # 1/deg
        ("deg", {"tyre.rear.horizontal_shift_deg": (5.0,)}),  # mrad
        ("N", {"tyre.front.vertical_shift_n": (150e3,)}),  # mN
        ("deg", {"limits.sideslip_max_deg": (0.05236,), "limits.rear_angle_max_deg": (0.06109,)}),  # rad
        ("g", {"limits.lateral_acceleration_max_g": (7.848,)}),  # m/s^2
        ("%", {"limits.slip_departure_percent": (0.1,)}),  # a share
        ("km/h", {"grid.speed_max_km_h": (3333.0,), "controller.enable_speed_km_h": (416.7,)}),  # cm/s
        ("deg", {"grid.front_angle_max_deg": (0.17453,), "grid.front_angle_min_deg": (0.00175,)}),  # rad
        ("deg", {"grid.front_angle_breakpoints_deg": ([0.00175, 0.17453],)}),
        ("km/h", {"grid.speed_breakpoints_km_h": ([556.0, 3333.0],)}),  # cm/s
        ("", {"steering.ratio": (0.075,)}),  # its inverse
        ("s", {"steering.lag_s": (5.0,), "rear_actuator.lag_s": (50.0,), "controller.sampling_time_s": (10.0,)}),  # ms
        ("s", {"controller.inputs.implausible_time_s": (300.0,), "plant.sampling_time_s": (1.0,)}),
        ("deg", {"steering.front_angle_stop_deg": (0.61087,), "rear_actuator.angle_max_deg": (0.06109,)}),  # rad
        ("deg", {"controller.rear_angle_error_max_deg": (0.03491,), "controller.inputs.front_angle_max_deg": (0.7854,)}),
        ("deg/s", {"controller.rear_rate_max_deg_s": (0.43633,), "controller.inputs.yaw_rate_max_deg_s": (2.618,)}),  # rad/s
    ],
)
def test_a_wrong_unit_shows_by_its_size(unit: str, values: dict[str, tuple[float | list[float], ...]]) -> None:
    for key, value in ((key, value) for key, several in values.items() for value in several):
        message = refused(table(key, str(value)))
        assert message.startswith(f"car.toml: {key}: ")
        assert f"{value[0] if isinstance(value, list) else value:g} is outside " in message
        assert re.search(rf" to \S+ {re.escape(unit)}" if unit else r" to \S+;", message)
        assert message.endswith("check the value and its unit")


def test_negative_mass() -> None:
    assert refused("[vehicle]\nmass_kg = -2335.07\n") == (
        "car.toml: vehicle.mass_kg: -2335.07 is outside 200 to 60000 kg; check the value and its unit"
    )


def test_text_and_booleans_are_not_numbers() -> None:
    for value, shown in (("true", "True"), ('"2000"', "'2000'")):
        assert f"car.toml: vehicle.mass_kg: a number is needed, not {shown}" in refused(table("vehicle.mass_kg", value))


def test_whole_numbers_are_numbers() -> None:
    """`mass_kg = 2000` is the same car as `mass_kg = 2000.0`, also in its canonical text."""
    texts = {parse({"vehicle": {"mass_kg": mass}}, "car.toml").to_json() for mass in (2000, 2000.0)}
    assert len(texts) == 1


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("grid.speed_points", value) for value in ("1", "2001", "10.0", "true", '"10"', "nan", "1" + 400 * "0")),
        ("controller.fail_safe.degraded_samples_max", "-1"),
        ("plant.command_delay_samples", "101"),
        ("plant.command_delay_samples", "0.5"),
        ("plant.load_transfer", '"half"'),
        ("controller.kind", '"pid"'),
        ("controller.rear_rate_max_deg_s", '"of"'),
        ("controller.rear_rate_max_deg_s", "false"),
        ("cases.mine.rear_steering", "1"),
        ("cases.mine.rear_steering", '"yes"'),
        ("schema_version", "2"),
        ("schema_version", '"1"'),
    ],
)
def test_other_values(key: str, value: str) -> None:
    assert refused(table(key, value)).startswith(f"car.toml: {key}: ")


@pytest.mark.parametrize(("key", "wanted"), [("plant.load_transfer", "moment-balance"), ("controller.kind", "pi")])
def test_choices_are_listed(key: str, wanted: str) -> None:
    assert f"'{wanted}'" in refused(table(key, '"other"'))


@pytest.mark.parametrize("value", ["1.0", '"text"', "[]", "true"])
def test_a_value_where_a_table_belongs(value: str) -> None:
    for section in ("vehicle", "tyre", "tyre.front", "cases", "cases.mine", "controller.inputs"):
        message = refused(f"{section} = {value}\n")
        assert message.startswith(f"car.toml: {section}: ")
        assert "instance of" not in message  # a word of the checker, which the user does not know


# --- keys ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "suggestion"),
    [
        ("vehicel", "vehicle"),
        ("vehicle.mass", "mass_kg"),
        ("tyre.rear.cornering_stiffness_kn_per_rad", "cornering_stiffness_n_per_rad"),
        ("limits.sideslip_max_rad", "sideslip_max_deg"),
        ("cases.mine.sideslip_weight", "sideslip_weight_per_s2"),
        ("controller.fail_safe.recovery", "recovery_samples"),
        ("schema_versoin", "schema_version"),
    ],
)
def test_a_misspelt_key_is_named_with_the_nearest_one(key: str, suggestion: str) -> None:
    assert refused(table(key, "1.0")) == f"car.toml: {key}: unknown key; did you mean '{suggestion}'?"


def test_unknown_keys() -> None:
    assert "unknown key; known here: friction, gravity_m_s2" in refused("[road]\nqqq = 1\n")
    assert "unknown key" in refused('"mass\\u001b[31m\\nkg" = 1\n')  # control characters do not reach the terminal
    # Without its stiffness the tyre is incomplete, but the cause is the misspelt key.
    message = refused("[tyre.front]\ncornering_stifness_n_per_rad = 1e5\n[vehicle]\nmass_kg = -1\n")
    assert message.startswith("car.toml: tyre.front.cornering_stifness_n_per_rad: unknown key")


# --- rules between keys --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[grid]\nspeed_min_km_h = 120.0\n", ("grid", "speed_min_km_h", "speed_max_km_h")),
        ("[grid]\nfront_angle_min_deg = 10.0\n", ("grid", "front_angle_min_deg", "front_angle_max_deg")),
        ("[controller]\nenable_speed_km_h = 12.0\n", ("controller", "disable_speed_km_h", "enable_speed_km_h")),
        ("[controller]\nsampling_time_s = 0.0105\n", ("controller.sampling_time_s", "plant.sampling_time_s")),
        ("[plant]\nsampling_time_s = 0.003\n", ("controller.sampling_time_s", "plant.sampling_time_s")),
        ("[controller]\nsampling_time_s = 0.001\n[plant]\nsampling_time_s = 0.002\n", ("controller.sampling_time_s",)),
        ("[steering]\nfront_angle_stop_deg = 9.9\n", ("steering.front_angle_stop_deg", "grid")),
        ("[grid]\nfront_angle_breakpoints_deg = [1.0, 35.5]\n", ("steering.front_angle_stop_deg", "grid")),
        ("[rear_actuator]\nangle_max_deg = 16.0\n", ("controller.inputs.rear_angle_max_deg", "rear_actuator.angle_max_deg")),
        (
            "[controller.inputs]\nrear_angle_max_deg = 3.4\n",
            ("controller.inputs.rear_angle_max_deg", "rear_actuator.angle_max"),
        ),
        (
            "[controller.inputs]\nfront_angle_max_deg = 34.9\n",
            ("controller.inputs.front_angle_max_deg", "front_angle_stop_deg"),
        ),
        ("[controller.inputs]\nfriction_max = 0.89\n", ("controller.inputs.friction_max", "road.friction")),
        ("[tyre.front]\nshape_factor_c = 1.2\n", ("tyre.front", "exactly one", "cornering_stiffness_n_per_rad")),
        (
            "[tyre.rear]\ncornering_stiffness_n_per_rad = 1e5\nstiffness_factor_b_per_rad = 15.0\n",
            ("tyre.rear", "exactly one", "stiffness_factor_b_per_rad"),
        ),
    ],
)
def test_rules_between_keys(text: str, named: tuple[str, ...]) -> None:
    message = refused(text)
    for part in named:
        assert part in message


@pytest.mark.parametrize(
    "text",
    [
        "[controller]\nsampling_time_s = 0.001\n",  # one plant step a sample
        "[controller]\nsampling_time_s = 0.03\n[plant]\nsampling_time_s = 0.0001\n",  # 300, but for rounding
        "[steering]\nfront_angle_stop_deg = 10.0\n",
        "[grid]\nfront_angle_breakpoints_deg = [1.0, 35.0]\nspeed_breakpoints_km_h = [20, 21.5, 60]\n",
        "[controller.inputs]\nrear_angle_max_deg = 3.5\n",
        "[tyre.front]\nstiffness_factor_b_per_rad = 17.9\n",
        '[controller]\nrear_rate_max_deg_s = "off"\n',
        "[controller]\nrear_rate_max_deg_s = 1.0\n",
        "[cases.mine]\n",
        '[cases."My_car-2.1"]\nsideslip_weight_per_s2 = 0\n',
    ],
)
def test_what_is_just_allowed(text: str) -> None:
    parse(tomllib.loads(text), "car.toml")


# --- breakpoints ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "fragment"),
    [
        ("[5.0, 20.0, 10.0]", "breakpoint 2 (10) is not above the one before it (20); sort the list"),
        ("[5.0, 5.0]", "breakpoint 1 (5) is not above"),
        ("[5.0]", "1 breakpoints; 2 to 2000 are needed"),
        (str([20.0 + 0.01 * k for k in range(2001)]), "2001 breakpoints; 2 to 2000 are needed"),
        ("[5.0, nan]", "nan is outside"),
        ("[-5.0, 5.0]", "-5 is outside"),
        ('[5.0, "10"]', ".1: "),
        ("[5.0, [6.0]]", ".1: "),
        ("5.0", "list"),
        ('"5, 10"', "list"),
    ],
)
def test_breakpoints(values: str, fragment: str) -> None:
    for key in ("grid.speed_breakpoints_km_h", "grid.front_angle_breakpoints_deg"):
        message = refused(table(key, values))
        assert message.startswith(f"car.toml: {key}")
        assert fragment in message


# --- names of cases ------------------------------------------------------------------------------------------------

BAD_NAMES = (
    "a*/",
    'a"b',
    "a'b",
    "a\nb",
    "a\n",
    "a\\",
    "é",
    "４ws",
    "a b",
    "",
    "-a",
    ".a",
    "_a",
    "a/b",
    "a\x00",
    "a\u202eb",
    "x" * 64,
)


@pytest.mark.parametrize("name", BAD_NAMES)
def test_names_that_cannot_stand_in_c(name: str) -> None:
    with pytest.raises(ValueError, match=r"cannot stand in C|has 64 characters"):
        check_name(name)
    with pytest.raises(ConfigError) as caught:
        parse({"cases": {name: {}}}, "car.toml")
    message = checked(caught.value)
    assert message.startswith("car.toml: cases.")
    assert "use 1 to 63 ASCII letters, digits, '.', '_' or '-'" in message


def test_names_that_may() -> None:
    for name in ("a", "4ws-2", "My_car-2.1", "0", "x" * 63):
        assert check_name(name) == name


def test_an_unknown_case_suggests_the_nearest() -> None:
    with pytest.raises(ConfigError) as caught:
        preset().case("4ws2")
    message = checked(caught.value)
    assert message.startswith("[cases]: there is no case '4ws2'; known cases: fws, 4ws-1, 4ws-2; did you mean '4ws-")
    with pytest.raises(ConfigError) as caught:
        preset().case("sport\n\x1b[31m", where="--case")
    message = checked(caught.value)
    assert message.startswith("--case: ")
    assert "did you mean" not in message


def test_own_cases_replace_the_paper_s() -> None:
    config = parse({"cases": {"mine": {"sideslip_weight_per_s2": 10.0}}}, "car.toml")
    assert config.case("mine") == Case(rear_steering=True, sideslip_weight_per_s2=10.0)
    with pytest.raises(ConfigError, match="known cases: mine"):
        config.case("fws")


# --- files ---------------------------------------------------------------------------------------------------------


def refused_file(path: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        load(path)
    message = checked(caught.value)
    assert message.startswith(str(path))
    return message


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("[vehicle]\nmass_kg = \n", 2),
        ("[vehicle\nmass_kg = 1\n", 1),
        ("# a car\n\n[vehicle]\nmass_kg = 2000 kg\n", 4),
        ("[vehicle]\nmass_kg = 2000\nmass_kg = 2000\n", 3),
        ("[vehicle]\nmass_kg = 2000,5\n", 2),
        ('[plant]\nload_transfer = "paper\n', 2),
        ("[road]\n[road]\n", 2),
    ],
)
def test_syntax_errors_name_the_line(tmp_path: Path, text: str, line: int) -> None:
    path = tmp_path / "ars.toml"
    path.write_text(text)
    message = refused_file(path)
    assert "TOML syntax" in message
    assert f"line {line}," in message


@pytest.mark.parametrize(
    ("content", "byte"),
    [(b"# caf\xe9\n", 5), ("# mass\n".encode("utf-16"), 0), (b"\x80", 0)],
)
def test_a_file_that_is_not_utf8(tmp_path: Path, content: bytes, byte: int) -> None:
    path = tmp_path / "ars.toml"
    path.write_bytes(content)
    message = refused_file(path)
    assert f"byte {byte}" in message
    assert "UTF-8" in message


def test_places_of_files(tmp_path: Path) -> None:
    path = tmp_path / "ars.toml"
    assert "No such file" in refused_file(path)
    assert "codegen init" in refused_file(path)
    assert "not a file" in refused_file(tmp_path)
    path.write_text("[vehicle]\nmass_kg = 2.3\n")
    assert refused_file(path).startswith(f"{path}: vehicle.mass_kg: 2.3 is outside")
    with pytest.raises(ConfigError) as caught:
        load(tmp_path / "my\ncar.toml")
    assert "my car.toml" in checked(caught.value)


# --- canonical text ------------------------------------------------------------------------------------------------

EVERYTHING = """
[vehicle]
mass_kg = 1480
front_roll_share = 0.1
[tyre.front]
stiffness_factor_b_per_rad = 17.3
[grid]
speed_breakpoints_km_h = [20, 33.3, 120]
[cases.b]
[cases.a]
rear_steering = false
[controller]
rear_rate_max_deg_s = "off"
"""


@pytest.mark.parametrize("text", ["", EVERYTHING, preset_text()], ids=["defaults", "everything", "preset"])
def test_canonical_text_reads_back(text: str) -> None:
    config = parse(tomllib.loads(text), "car.toml")
    again = parse(json.loads(config.to_json()), "map")
    assert again == config
    assert again.to_json() == config.to_json()
    assert " " not in config.to_json()
    assert config.to_json().isascii()


def test_canonical_text_does_not_depend_on_order() -> None:
    forward = parse({"vehicle": {"mass_kg": 1500.0, "track_m": 1.5}, "cases": {"a": {}, "b": {}}}, "car.toml")
    backward = parse({"cases": {"b": {}, "a": {}}, "vehicle": {"track_m": 1.5, "mass_kg": 1500.0}}, "car.toml")
    assert forward.to_json() == backward.to_json()


def test_canonical_text_changes_with_every_value() -> None:
    texts = {
        parse(tomllib.loads(text), "car.toml").to_json()
        for text in (
            "",
            f"[vehicle]\nmass_kg = {math.nextafter(2335.07, math.inf)!r}\n",  # one unit in the last place
            "[plant]\ncommand_delay_samples = 1\n",
            '[plant]\nload_transfer = "paper"\n',
            "[controller.fail_safe]\nrecovery_samples = 11\n",
            "[cases.fws]\n",
        )
    }
    assert len(texts) == 6

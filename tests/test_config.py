"""`ars.toml`: valid configurations, and for everything else one line that names the key and the remedy."""

from __future__ import annotations

import json
import math
import tomllib
import types
import typing
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from codegen import config as configuration
from codegen.config import Case, Config, check_name, load, parse, preset, preset_text
from codegen.errors import CodegenError, ConfigError


def checked(error: CodegenError) -> str:
    """Return the message of an error, after the checks that hold for every message."""
    message = str(error)
    assert "\n" not in message
    assert message.isprintable()
    assert len(message) < 950  # three parts of 300 at most
    assert error.what and error.where and error.remedy
    assert error.exit_code == 2
    return message


def refused(text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        parse(tomllib.loads(text), "car.toml")
    return checked(caught.value)


def refused_file(path: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        load(path)
    return checked(caught.value)


def table(key: str, value: object) -> str:
    """Return TOML that sets one dotted key."""
    section, _, name = key.rpartition(".")
    return f"[{section}]\n{name} = {value}\n" if section else f"{name} = {value}\n"


# --- presets and fields --------------------------------------------------------------------------------------------


def leaves_of(data: dict[str, Any], key: str = "") -> dict[str, Any]:
    """Return the values of nested tables, by their dotted key."""
    found: dict[str, Any] = {}
    for name, value in data.items():
        found |= leaves_of(value, f"{key}{name}.") if isinstance(value, dict) else {f"{key}{name}": value}
    return found


def differences(left: Config, right: Config) -> dict[str, tuple[Any, Any]]:
    one, other = leaves_of(left.model_dump(mode="json")), leaves_of(right.model_dump(mode="json"))
    return {key: (one.get(key), other.get(key)) for key in one | other if repr(one.get(key)) != repr(other.get(key))}


def test_the_default_is_the_recommended_preset_and_the_papers_differs_in_its_controller(tmp_path: Path) -> None:
    """The paper limits no rate and has no limiter. A cycle time that is not given is the sampling time."""
    recommended, path = preset("recommended"), tmp_path / "ars.toml"
    assert differences(Config(), recommended) == {
        f"can.{role}.cycle_time_ms": (None, 10.0) for role in recommended.can.messages()
    }
    assert differences(recommended, preset()) == {
        "controller.kind": ("tracking", "pi"),
        "controller.rear_rate_max_deg_s": (25.0, "off"),
        "limiter.rear_rate_max_deg_s": (30.0, "off"),
        "limiter.opposite_phase_max_deg": ("from-car", "off"),
    }
    path.write_text("")
    assert load(path) == Config()
    path.write_bytes(preset_text().replace("\n", "\r\n").encode())
    assert load(path) == preset()


def test_preset_holds_the_published_numbers() -> None:
    paper = preset()
    assert (paper.vehicle.mass_kg, paper.vehicle.yaw_inertia_kg_m2) == (2335.07, 5376.432)
    assert (paper.vehicle.cg_height_m, paper.vehicle.track_m, paper.vehicle.front_roll_share) == (0.42, 1.627, 0.6)
    assert paper.vehicle.wheelbase == pytest.approx(3.14, rel=1e-15)
    assert [tyre.cornering_stiffness_n_per_rad for tyre in (paper.tyre.front, paper.tyre.rear)] == [119_540.0, 119_830.0]
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


def fields(model: type[BaseModel], key: str = "") -> dict[str, Any]:
    """Return the annotation of every field that is not a table, by its dotted key."""
    found: dict[str, Any] = {}
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            found |= fields(kind, f"{key}{name}.")
        elif name != "cases":
            found[f"{key}{name}"] = kind
    return found


FIELDS = fields(Config)
ALTERNATIVES = {key: typing.get_args(kind) if isinstance(kind, types.UnionType) else (kind,) for key, kind in FIELDS.items()}
FLOATS = [*(key for key, kinds in ALTERNATIVES.items() if float in kinds), "cases.mine.sideslip_weight_per_s2"]
UNITS = {
    **{"kg": "kg", "kg_m2": "kg m^2", "m": "m", "m_s2": "m/s^2", "m_s3": "m/s^3", "n": "N", "n_per_rad": "N/rad"},
    **{"per_rad": "1/rad", "per_s2": "1/s^2", "deg": "deg", "deg_s": "deg/s", "km_h": "km/h", "g": "g", "percent": "%"},
    **{"s": "s", "ms": "ms", "kbit_s": "kbit/s", "db": "dB"},
}
"""Suffix of a key -> unit in messages."""
BARE = {"friction", "front_roll_share", "shape_factor_c", "curvature_factor_e", "peak_factor_p1", "ratio", "friction_max"}
BARE |= {"peak_load_sensitivity_p2", "friction_min", "integral_gain", "sensitivity_max", "sensitivity"}
BARE |= {"factor", "offset"}  # of a CAN signal, whose unit is that of its quantity


def unit_of(key: str) -> str:
    """Return the unit that a key names by its longest known suffix, "" for a bare number."""
    found = [suffix for suffix in UNITS if key.endswith(f"_{suffix}")]
    assert found or key.rpartition(".")[2] in BARE, key
    return UNITS[max(found, key=len)] if found else ""


@pytest.mark.parametrize("name", ["paper", "recommended"])
def test_preset_shows_every_key(name: Any) -> None:
    """The user edits that file, so it has every setting; of two ways to say the same, one."""
    shown = leaves_of(tomllib.loads(preset_text(name)))
    left_out = ("controller.tracking.schedule.", *(("controller.tracking.", "tuning.") if name == "paper" else ()))
    for key in (key for key in FIELDS if not key.startswith(left_out)):
        assert key in shown or key.rpartition(".")[2] in preset_text(name), key  # else it is named in a comment


def test_units() -> None:
    for key, kinds in ALTERNATIVES.items():
        if any(kind is float or typing.get_origin(kind) is list for kind in kinds):
            unit_of(key)
    data = {"limits": {"sideslip_max_deg": 2.0, "rear_angle_max_deg": 4.0}, "steering": {"front_angle_stop_deg": 30.0}}
    config = parse({**data, "rear_actuator": {"angle_max_deg": 5.0}}, "car.toml")
    assert (config.limits.sideslip_max, config.limits.rear_angle_max) == (math.radians(2.0), math.radians(4.0))
    assert (config.steering.front_angle_stop, config.rear_actuator.angle_max) == (math.radians(30.0), math.radians(5.0))
    assert pytest.approx(1.0, rel=1e-15) == 3.6 * configuration.KM_H


# --- values --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "-1e9", "1e9", "true", '"1.0"', "[1.0]", "{}", "2020-01-01"])
def test_no_number_takes_a_value_of_no_car(value: str) -> None:
    for key in FLOATS:
        assert refused(table(key, value)).startswith(f"car.toml: {key}: ")  # the key as written, no inner path of a checker


# The paper's own values in another unit: no car can have them.
@pytest.mark.parametrize(
    "values",
    [
        {"vehicle.mass_kg": 2.33507, "vehicle.yaw_inertia_kg_m2": 5.376432},  # t, t m^2
        {"vehicle.cg_height_m": 42.0, "vehicle.track_m": 1627.0, "vehicle.cg_to_front_axle_m": 1574.0},  # cm, mm
        {"vehicle.mass_kg": 2335070.0, "vehicle.cg_to_rear_axle_m": 156.6, "road.gravity_m_s2": 981.0},  # g, cm
        {"vehicle.front_roll_share": 60.0, "road.friction": 90.0, "controller.friction_min": 10.0},  # percent
        {"tyre.front.cornering_stiffness_n_per_rad": 119.54, "tyre.rear.stiffness_factor_b_per_rad": 17.9 / 57.3},  # kN, 1/deg
        {"tyre.rear.horizontal_shift_deg": 5.0, "tyre.front.vertical_shift_n": 150e3},  # mrad, mN
        {"limits.sideslip_max_deg": 0.05236, "limits.rear_angle_max_deg": 0.06109},  # rad
        {"limits.lateral_acceleration_max_g": 7.848, "limits.slip_departure_percent": 0.1},  # m/s^2, a share
        {"grid.speed_max_km_h": 3333.0, "controller.enable_speed_km_h": 416.7},  # cm/s
        {"grid.front_angle_max_deg": 0.17453, "grid.front_angle_min_deg": 0.00175},  # rad
        {"grid.speed_breakpoints_km_h": [556.0, 3333.0], "grid.front_angle_breakpoints_deg": [0.00175, 0.17453]},
        {"steering.ratio": 0.075, "steering.front_angle_stop_deg": 0.61087, "rear_actuator.angle_max_deg": 0.06109},  # 1/x, rad
        {"steering.lag_s": 5.0, "rear_actuator.lag_s": 50.0, "controller.sampling_time_s": 10.0},  # ms
        {"controller.inputs.implausible_time_s": 300.0, "plant.sampling_time_s": 1.0},
        {"controller.rear_rate_max_deg_s": 0.43633, "controller.inputs.yaw_rate_max_deg_s": 2.618},  # rad/s
        {"controller.rear_angle_error_max_deg": 0.03491, "controller.inputs.front_angle_max_deg": 0.7854},  # rad
    ],
)
def test_a_wrong_unit_shows_by_its_size(values: dict[str, Any]) -> None:
    for key, value in values.items():
        what, _, remedy = refused(table(key, value)).partition("; ")
        assert what.startswith(f"car.toml: {key}: {value[0] if isinstance(value, list) else value:g} is outside ")
        unit = unit_of(key)
        assert what.split(" to ")[1].partition(" ")[2].startswith(unit) if unit else what.split(" to ")[1].count(" ") == 0
        assert remedy == "check the value and its unit"


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("vehicle.mass_kg", -2335.07, "-2335.07 is outside 200 to 60000 kg; check the value and its unit"),
        ("vehicle.mass_kg", "true", "a number is needed, not True"),
        ("vehicle.mass_kg", '"2000"', "a number is needed, not '2000'"),
        *(("grid.speed_points", value, "") for value in ("1", "2001", "10.0", "true", '"10"', "nan", "1" + 400 * "0")),
        ("controller.fail_safe.degraded_samples_max", -1, ""),
        ("controller.fail_safe.recovery_samples", 0, ""),
        ("plant.command_delay_samples", 101, ""),
        ("plant.command_delay_samples", 0.5, ""),
        ("plant.load_transfer", '"half"', "'moment-balance'"),
        ("controller.kind", '"pid"', "'pi'"),
        ("controller.rear_rate_max_deg_s", '"of"', ""),
        ("controller.rear_rate_max_deg_s", "false", ""),
        ("cases.mine.rear_steering", 1, ""),
        ("cases.mine.rear_steering", '"yes"', ""),
        ("schema_version", 2, ""),
        ("schema_version", '"1"', ""),
        # misspelt keys
        ("vehicel", 1, "unknown key; did you mean 'vehicle'?"),
        ("vehicle.mass", 1, "unknown key; did you mean 'mass_kg'?"),
        ("tyre.rear.cornering_stiffness_kn_per_rad", 1, "unknown key; did you mean 'cornering_stiffness_n_per_rad'?"),
        ("limits.sideslip_max_rad", 1, "unknown key; did you mean 'sideslip_max_deg'?"),
        ("cases.mine.sideslip_weight", 1, "unknown key; did you mean 'sideslip_weight_per_s2'?"),
        ("controller.inputs.speed_max", 1, "unknown key; did you mean 'speed_max_km_h'?"),
        ("schema_versoin", 1, "unknown key; did you mean 'schema_version'?"),
        ("road.qqq", 1, "unknown key; known here: friction, gravity_m_s2"),
        # breakpoints
        ("grid.speed_breakpoints_km_h", [5, 20, 10], "breakpoint 2 (10) is not above the one before it (20); sort the list"),
        ("grid.front_angle_breakpoints_deg", [5.0, 5.0], "breakpoint 1 (5) is not above"),
        ("grid.speed_breakpoints_km_h", [5.0], "1 breakpoints; 2 to 2000 are needed"),
        ("grid.speed_breakpoints_km_h", [20.0 + 0.01 * k for k in range(2001)], "2001 breakpoints; 2 to 2000 are needed"),
        ("grid.speed_breakpoints_km_h", "[5.0, nan]", "nan is outside"),
        ("grid.front_angle_breakpoints_deg", [-5.0, 5.0], "-5 is outside"),
        ("grid.speed_breakpoints_km_h", '[5.0, "10"]', ".1: "),
        ("grid.speed_breakpoints_km_h", "[5.0, [6.0]]", ".1: "),
        ("grid.speed_breakpoints_km_h", '"5, 10"', "list"),
    ],
)
def test_a_value(key: str, value: object, words: str) -> None:
    message = refused(table(key, value))
    assert message.startswith(f"car.toml: {key}")
    assert words in message


@pytest.mark.parametrize("value", ["1.0", '"text"', "[]", "true"])
def test_a_value_where_a_table_belongs(value: str) -> None:
    for section in ("vehicle", "tyre", "tyre.front", "cases", "cases.mine", "controller.inputs"):
        message = refused(f"{section} = {value}\n")
        assert message.startswith(f"car.toml: {section}: ")
        assert "instance of" not in message  # a word of the checker, which the user does not know


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[grid]\nspeed_min_km_h = 120.0\n", "grid speed_min_km_h speed_max_km_h"),
        ("[grid]\nfront_angle_min_deg = 10.0\n", "grid front_angle_min_deg front_angle_max_deg"),
        ("[controller]\nenable_speed_km_h = 12.0\n", "controller disable_speed_km_h enable_speed_km_h"),
        ("[controller]\nsampling_time_s = 0.0105\n", "controller.sampling_time_s plant.sampling_time_s"),
        ("[plant]\nsampling_time_s = 0.003\n", "controller.sampling_time_s plant.sampling_time_s"),
        ("[controller]\nsampling_time_s = 0.001\n[plant]\nsampling_time_s = 0.002\n", "controller.sampling_time_s"),
        ("[steering]\nfront_angle_stop_deg = 9.9\n", "steering.front_angle_stop_deg grid"),
        ("[grid]\nfront_angle_breakpoints_deg = [1.0, 35.5]\n", "steering.front_angle_stop_deg grid"),
        ("[controller.inputs]\nrear_angle_max_deg = 3.4\n", "controller.inputs.rear_angle_max_deg rear_actuator.angle_max_deg"),
        ("[rear_actuator]\nangle_max_deg = 16.0\n", "controller.inputs.rear_angle_max_deg rear_actuator.angle_max_deg"),
        ("[controller.inputs]\nfront_angle_max_deg = 34.9\n", "controller.inputs.front_angle_max_deg front_angle_stop_deg"),
        ("[controller.inputs]\nfriction_max = 0.89\n", "controller.inputs.friction_max road.friction"),
        ("[tyre.front]\nshape_factor_c = 1.2\n", "tyre.front exactly cornering_stiffness_n_per_rad"),
        ("[tyre.rear]\ncornering_stiffness_n_per_rad = 1e5\nstiffness_factor_b_per_rad = 15.0\n", "tyre.rear exactly one"),
        # Without its stiffness the tyre is incomplete, but the cause is the misspelt key.
        ("[tyre.front]\ncornering_stifness_n_per_rad = 1e5\n", "tyre.front.cornering_stifness_n_per_rad: unknown key"),
        ('"mass\\u001b[31m\\nkg" = 1\n', "unknown key"),
    ],
)
def test_rules_between_keys(text: str, words: str) -> None:
    message = refused(text)
    assert words in message or all(part in message for part in words.split())


@pytest.mark.parametrize(
    "text",
    [
        "[controller]\nsampling_time_s = 0.001\n",  # one plant step a sample
        "[controller]\nsampling_time_s = 0.03\n[plant]\nsampling_time_s = 0.0001\n",  # 300, but for rounding
        "[steering]\nfront_angle_stop_deg = 10.0\n",
        "[grid]\nfront_angle_breakpoints_deg = [1.0, 35.0]\nspeed_breakpoints_km_h = [20, 21.5, 60]\n",
        "[controller.inputs]\nrear_angle_max_deg = 3.5\n",
        '[controller]\nrear_rate_max_deg_s = "off"\n[tyre.front]\nstiffness_factor_b_per_rad = 17.9\n[cases.mine]\n',
        '[controller]\nrear_rate_max_deg_s = 1.0\n[cases."My_car-2.1"]\nsideslip_weight_per_s2 = 0\n',
        preset_text(),
        "",
    ],
)
def test_limits_themselves_are_allowed_and_the_canonical_text_reads_back(text: str) -> None:
    config = parse(tomllib.loads(text), "car.toml")
    again = parse(json.loads(config.to_json()), "map")
    assert again == config
    assert again.to_json() == config.to_json()
    assert " " not in config.to_json() and config.to_json().isascii()


def test_canonical_text_depends_on_values_alone() -> None:
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
    forward = {"vehicle": {"mass_kg": 1500.0, "track_m": 1.5}, "cases": {"a": {}, "b": {}}}
    backward = {"cases": {"b": {}, "a": {}}, "vehicle": {"track_m": 1.5, "mass_kg": 1500}}
    assert parse(forward, "car.toml").to_json() == parse(backward, "car.toml").to_json()


# --- cases ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["a*/", 'a"b', "a'b", "a\n", "a\\", "é", "４ws", "a b", "", "-a", ".a", "_a", "a\x00", "x" * 64]
)
def test_names_that_cannot_stand_in_c(name: str) -> None:
    with pytest.raises(ValueError, match=r"cannot stand in C|has 64 characters"):
        check_name(name)
    with pytest.raises(ConfigError) as caught:
        parse({"cases": {name: {}}}, "car.toml")
    message = checked(caught.value)
    assert message.startswith("car.toml: cases.")
    assert "use 1 to 63 ASCII letters, digits, '.', '_' or '-'" in message


def test_cases() -> None:
    for name in ("a", "4ws-2", "My_car-2.1", "0", "x" * 63):
        assert check_name(name) == name
    config = parse({"cases": {"mine": {"sideslip_weight_per_s2": 10.0}}}, "car.toml")
    assert config.case("mine") == Case(rear_steering=True, sideslip_weight_per_s2=10.0)
    for cases, name, where, words in (
        (preset(), "4ws2", "[cases]", "there is no case '4ws2'; known cases: fws, 4ws-1, 4ws-2; did you mean '4ws-"),
        (preset(), "sport\n\x1b[31m", "--case", "known cases: fws, 4ws-1, 4ws-2"),
        (config, "fws", "[cases]", "known cases: mine"),
    ):
        with pytest.raises(ConfigError) as caught:
            cases.case(name, where=where)
        message = checked(caught.value)
        assert message.startswith(f"{where}: ") and words in message
        assert ("did you mean" in message) == (name == "4ws2")


# --- files ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[vehicle]\nmass_kg = \n", "line 2,"),
        (b"[vehicle\nmass_kg = 1\n", "line 1,"),
        (b"# a car\n\n[vehicle]\nmass_kg = 2000 kg\n", "line 4,"),
        (b"[vehicle]\nmass_kg = 2000\nmass_kg = 2000\n", "line 3,"),
        (b'[plant]\nload_transfer = "paper\n', "line 2,"),
        (b"# caf\xe9\n", "byte 5"),
        ("# mass\n".encode("utf-16"), "byte 0"),
        (b"[vehicle]\nmass_kg = 2.3\n", ": vehicle.mass_kg: 2.3 is outside"),
    ],
)
def test_contents_of_files(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "ars.toml"
    path.write_bytes(content)
    message = refused_file(path)
    assert message.startswith(str(path))
    assert words in message
    assert ("TOML syntax" in message, "UTF-8" in message) == (words.startswith("line"), words.startswith("byte"))


def test_places_of_files(tmp_path: Path) -> None:
    message = refused_file(tmp_path / "ars.toml")
    assert "No such file" in message and "codegen init" in message
    assert "not a file" in refused_file(tmp_path)
    assert "my car.toml" in refused_file(tmp_path / "my\ncar.toml")

"""`ars.toml`: valid configurations, and otherwise one line that names the key and the remedy."""

import json
import math
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from codegen.configuration import Case, Config, Limits, Road, check_name, load, parse, preset, preset_text
from codegen.errors import CodegenError, ConfigError
from tests.whole_car import REQUIRED, car, car_toml, with_car


def refused(source: str | Path | dict[str, Any]) -> str:
    """Return the error message of a file, or of a TOML text or data with the paper's car, after general checks of it."""
    with pytest.raises(ConfigError) as caught:
        load(source) if isinstance(source, Path) else parse(
            with_car(tomllib.loads(source) if isinstance(source, str) else source), "car.toml"
        )
    error, message = caught.value, str(caught.value)
    assert message.isprintable() and len(message) < 950  # three parts of 300 at most
    assert error.what and error.where and error.remedy and error.exit_code == 2
    return message


def leaves_of(data: dict[str, Any], key: str = "") -> dict[str, Any]:
    """Return the values of nested tables by their dotted key."""
    found: dict[str, Any] = {}
    for name, value in data.items():
        found |= leaves_of(value, f"{key}{name}.") if isinstance(value, dict) else {f"{key}{name}": value}
    return found


def differences(left: Config, right: Config) -> set[tuple[str, Any, Any]]:
    one, other = leaves_of(left.model_dump(mode="json")), leaves_of(right.model_dump(mode="json"))
    pairs = {key: [tuple(v) if isinstance(v := side.get(key), list) else v for side in (one, other)] for key in one | other}
    return {(key, *pair) for key, pair in pairs.items() if repr(pair[0]) != repr(pair[1])}


def test_the_default_is_the_recommended_preset_but_for_its_limits_and_the_papers_differs(tmp_path: Path) -> None:
    """The paper has no rate limit and no limiter, and both it and the default have the ideal plant. The default cycle time is
    the sampling time."""
    real, path = preset("recommended"), tmp_path / "ars.toml"
    recommended = real.with_ideal_plant()
    assert differences(recommended, real) == {
        ("plant.relaxation_length_m", 0.0, 0.4),
        ("plant.roll_deg_per_g", None, 4.0),
        ("plant.actuator_motor_share", None, 0.5),
        ("plant.backlash_deg", None, 0.03),
        ("plant.command_delay_samples", 0, 1),
        ("sensors.front_angle.bias_deg", None, 0.02),
        ("sensors.rear_angle.bias_deg", None, 0.02),
        ("sensors.yaw_rate.bias_deg_s", None, 0.1),
        ("sensors.lateral_acceleration.bias_m_s2", None, 0.1),
    }
    roles = recommended.can.messages()
    limits = {("limits.grip_use_max", None, 0.98), ("limits.yaw_gain_floor", None, 1.0)}
    assert differences(car(), recommended) == {(f"can.{role}.cycle_time_ms", None, 10.0) for role in roles} | limits
    tyre_models = {(f"cases.{case}.tyre_model", "magic-formula", None) for case in ("fws", "4ws-1", "4ws-2")}
    assert differences(recommended, preset()) == tyre_models | {
        ("limits.grip_use_max", 0.98, None),
        ("limits.yaw_gain_floor", 1.0, None),
        ("controller.kind", "tracking", "pi"),
        ("controller.rear_rate_max_deg_s", 25.0, "off"),
        ("limiter.rear_rate_max_deg_s", 30.0, "off"),
        ("limiter.opposite_phase_max_deg", "from-car", "off"),
        ("tuning.actuator_lag_factor", (0.4, 1.0, 2.0), None),
        ("tuning.actuator_lag_s", None, (0.02, 0.05, 0.1)),
    }
    path.write_text(car_toml())
    assert load(path) == car()
    path.write_bytes(preset_text().replace("\n", "\r\n").encode())
    assert load(path) == preset()


KEYS = {key: value for key, value in leaves_of(car().model_dump()).items() if not key.startswith("cases.")}
SECTIONS = ("vehicle", "tyre", "tyre.front", "cases", "cases.mine", "controller.inputs")
FLOATS = [*(key for key, value in KEYS.items() if isinstance(value, float)), "cases.mine.sideslip_weight_per_s2"]


@pytest.mark.parametrize("name", ["paper", "recommended"])
def test_preset_shows_every_key(name: Any) -> None:
    """The user edits that file, so it has every setting; of two equivalent keys, one."""
    shown = leaves_of(tomllib.loads(preset_text(name)))
    left_out = ("controller.tracking.schedule", "can.xcp_", *(("controller.tracking.", "tuning.") if name == "paper" else ()))
    for key in (key for key in KEYS if not key.startswith(left_out)):
        assert key in shown or key.rpartition(".")[2] in preset_text(name), key  # otherwise it is named in a comment


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "-1e9", "1e9", "true", '"1.0"', "[1.0]", "{}", "2020-01-01"])
def test_no_number_accepts_an_impossible_value(value: str) -> None:
    for key in FLOATS:
        # The key as written, not an internal path of the checker.
        assert refused(f"{key} = {value}").startswith(f"car.toml: {key}: ")


# The paper's values in other units (t, cm, mm, percent, kN, rad, mrad, cm/s, ms, a fraction), impossible for a car.
@pytest.mark.parametrize(
    ("unit", "lines"),
    [
        ("kg", ["vehicle.mass_kg = 2.33507", "vehicle.mass_kg = 2.335e6", "vehicle.mass_kg = -2335.07"]),
        ("kg m^2", ["vehicle.yaw_inertia_kg_m2 = 5.376432"]),
        ("m", ["vehicle.cg_height_m = 42", "vehicle.track_m = 1627", "vehicle.cg_to_front_axle_m = 1574"]),
        ("m/s^2", ["road.gravity_m_s2 = 981"]),
        ("", ["vehicle.front_roll_share = 60", "road.friction = 90", "controller.friction_min = 10", "steering.ratio = 0.075"]),
        ("N/rad", ["tyre.front.cornering_stiffness_n_per_rad = 119.54"]),
        ("1/rad", ["tyre.rear.stiffness_factor_b_per_rad = 0.3124"]),
        ("N", ["tyre.front.vertical_shift_n = 150000"]),
        ("g", ["limits.lateral_acceleration_max_g = 7.848"]),
        ("%", ["limits.slip_departure_percent = 0.1"]),
        ("km/h", ["grid.speed_max_km_h = 3333", "controller.enable_speed_km_h = 416.7"]),
        ("km/h", ["grid.speed_breakpoints_km_h = [556, 3333]", "grid.speed_breakpoints_km_h = [nan, 5.0]"]),
        (
            "deg",
            ["limits.sideslip_max_deg = 0.05236", "limits.rear_angle_max_deg = 0.06109", "grid.front_angle_min_deg = 0.002"],
        ),
        ("deg", ["grid.front_angle_breakpoints_deg = [0.00175, 0.17453]", "tyre.rear.horizontal_shift_deg = 5"]),
        ("deg", ["steering.front_angle_stop_deg = 0.61087", "rear_actuator.angle_max_deg = 0.06109"]),
        ("deg", ["controller.rear_angle_error_max_deg = 0.03491", "controller.inputs.front_angle_max_deg = 0.7854"]),
        ("deg/s", ["controller.rear_rate_max_deg_s = 0.43633", "controller.inputs.yaw_rate_max_deg_s = 2.618"]),
        ("s", ["steering.lag_s = 5", "rear_actuator.lag_s = 50", "controller.sampling_time_s = 10"]),
        ("s", ["controller.inputs.yaw_rate_lag_s = 150", "plant.sampling_time_s = 1"]),
    ],
)
def test_a_wrong_unit_is_found_by_its_magnitude(unit: str, lines: list[str]) -> None:
    for line in lines:
        key, value = re.fullmatch(r"(\S+) = \[?([^],]+).*", line).groups()
        start = re.escape(f"car.toml: {key}: {float(value):g} is outside ")
        end = rf"{unit and f' {re.escape(unit)}'}(| for one tyre); check the value and its unit"
        assert re.fullmatch(rf"{start}\S+ to \S+{end}", refused(line))


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("vehicle.mass_kg", '"2000"', "a number is needed, not '2000'"),
        *(("grid.speed_points", value, "") for value in ("1", "2001", "10.0", "true", '"10"', "nan", "1" + 400 * "0")),
        ("controller.kind", '"pid"', "'pi'"),
        ("controller.rear_rate_max_deg_s", '"of"', ""),
        ("cases.mine.rear_steering", 1, ""),
        ("schema_version", 2, ""),
        ("vehicel", 1, "unknown key; did you mean 'vehicle'?"),
        ("cases.mine.sideslip_weight", 1, "unknown key; did you mean 'sideslip_weight_per_s2'?"),
        ("road.qqq", 1, "unknown key; known here: friction, gravity_m_s2"),
        *((section, value, "") for section in SECTIONS for value in ("1.0", '"text"', "[]", "true")),
        ("grid.speed_breakpoints_km_h", [5, 20, 10], "breakpoint 2 (10) is not above the one before it (20); sort the list"),
        ("grid.speed_breakpoints_km_h", [5.0], "1 breakpoints; 2 to 2000 are needed"),
        ("grid.speed_breakpoints_km_h", [20.0 + 0.01 * k for k in range(2001)], "2001 breakpoints; 2 to 2000 are needed"),
    ],
)
def test_an_invalid_value_is_rejected(key: str, value: object, words: str) -> None:
    message = refused(f"{key} = {value}")
    assert message.startswith(f"car.toml: {key}")
    assert words in message and "instance of" not in message  # the checker's term, unknown to the user


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[grid]\nspeed_min_km_h = 120.0\n", "grid speed_min_km_h speed_max_km_h"),
        ("[controller]\nenable_speed_km_h = 12.0\n", "controller disable_speed_km_h enable_speed_km_h"),
        ("[controller]\nsampling_time_s = 0.0105\n", "controller.sampling_time_s plant.sampling_time_s"),
        ("[grid]\nfront_angle_breakpoints_deg = [1.0, 35.5]\n", "steering.front_angle_stop_deg grid"),
        ("[controller.inputs]\nrear_angle_max_deg = 3.4\n", "controller.inputs.rear_angle_max_deg rear_actuator.angle_max_deg"),
        ("[controller.inputs]\nfront_angle_max_deg = 34.9\n", "controller.inputs.front_angle_max_deg front_angle_stop_deg"),
        ("[controller.inputs]\nfriction_max = 0.89\n", "controller.inputs.friction_max road.friction"),
        (
            "[vehicle]\ntop_speed_km_h = 401.0\n",
            "vehicle.top_speed_km_h is 401; controller.inputs.speed_max_km_h (15 and 400 km/h)",
        ),
        (
            '[vehicle]\ntop_speed_km_h = 20.0\n[controller]\nkind = "pi"\nenable_speed_km_h = 20.0',
            "top_speed_km_h controller.enable_speed_km_h",
        ),
        (
            "[vehicle]\ntop_speed_km_h = 20.0\n[controller]\nslow_speed_km_h = 10.0",
            "top_speed_km_h twice controller.slow_speed_km_h",
        ),
        (
            "[tuning]\nactuator_lag_factor = [1.0]\nactuator_lag_s = [0.05]\n",
            "tuning: exclude each other; remove actuator_lag_s",
        ),
        ("[road]\nfriction = 0.3\n[controller]\nfriction_min = 0.31\n", "controller.friction_min road.friction"),
        ("[tyre.rear]\ncornering_stiffness_n_per_rad = 1e5\nstiffness_factor_b_per_rad = 15.0\n", "tyre.rear exactly one"),
        ("[tyre.front]\ncornering_stifness_n_per_rad = 1e5\n", "tyre.front.cornering_stifness_n_per_rad: unknown key"),
        ('"mass\\u001b[31m\\nkg" = 1\n', "unknown key"),
        *(
            (f"[identified]\n{text}\n", f"identified {words}")
            for text, words in (
                ('keys = ["steering.ratio"]', "standard_deviations has 0 values for 1 keys"),
                ('keys = ["steering.ratio"]\nstandard_deviations = [0.1]', "not a matrix of 1 rows"),
                ('keys = ["steering.ratio"]\nstandard_deviations = [0.1]\ncorrelations = [[0.5]]', "not symmetric with ones"),
                (
                    'keys = ["steering.rat"]\nstandard_deviations = [0.1]\ncorrelations = [[1.0]]',
                    "names steering.rat, which is not",
                ),
                ('keys = ["a", "a"]\nstandard_deviations = [1.0, 1.0]\ncorrelations = []', "names a key twice"),
            )
        ),
    ],
)
def test_inconsistent_keys_are_rejected(text: str, words: str) -> None:
    message = refused(text)
    assert words in message or all(part in message for part in words.split())


def missing(data: dict[str, Any]) -> str:
    """Return the keys that the message about a file with missing keys names, after checks of the rest of it."""
    with pytest.raises(ConfigError) as caught:
        parse(data, "car.toml")
    found = re.fullmatch(
        r"car\.toml: (.+) (?:is missing; add it|are missing; add them); `codegen init DIR` writes a complete file",
        str(caught.value),
    )
    assert found and caught.value.exit_code == 2, caught.value
    return found[1]


def test_data_of_a_car_have_no_defaults() -> None:
    """No figure shows that a value is another car's. Both presets are complete, and so are stored configurations."""
    tables = ("vehicle", "tyre.front", "tyre.rear", "steering", "rear_actuator")
    assert {key.rpartition(".")[0] for key in REQUIRED} == set(tables)
    assert {"vehicle.mass_kg", "vehicle.track_m", "steering.ratio", "rear_actuator.lag_s"} < set(REQUIRED)
    assert not {"vehicle.front_roll_share", "vehicle.top_speed_km_h", "road.friction"} & set(REQUIRED)
    for key in REQUIRED:
        data = with_car({})
        *names, name = key.split(".")
        table = data
        for each in names:
            table = table[each]
        del table[name]
        assert missing(data) == key
    for name in ("paper", "recommended"):
        assert set(REQUIRED) <= set(leaves_of(tomllib.loads(preset_text(name))))  # type: ignore[arg-type]


def test_all_missing_keys_are_in_one_message() -> None:
    assert missing({**with_car({}), "vehicle": {"mass_kg": 2000.0}, "steering": {"ratio": 15.0}}) == (
        "vehicle.yaw_inertia_kg_m2, vehicle.cg_height_m, vehicle.track_m, vehicle.cg_to_front_axle_m, "
        "vehicle.cg_to_rear_axle_m, steering.front_angle_stop_deg"
    )
    assert missing({**with_car({}), "tyre": {"front": {"shape_factor_c": 1.2}}}) == (
        "tyre.front.cornering_stiffness_n_per_rad, tyre.rear.cornering_stiffness_n_per_rad"
    )
    assert missing({}).endswith("tyre.rear.cornering_stiffness_n_per_rad and 5 more")
    # A misspelt key or a wrong table explains what seems missing.
    assert refused({"vehicle": {"mas_kg": 2000.0}}).startswith("car.toml: vehicle.mas_kg: unknown key; did you mean 'mass_kg'?")
    with pytest.raises(ConfigError, match=r"^car\.toml: vehicle: a table is needed, not 1; "):
        parse({"vehicle": 1}, "car.toml")


@pytest.mark.parametrize(
    ("text", "lags"),
    [
        ("", (0.02, 0.05, 0.1)),
        ("[rear_actuator]\nlag_s = 0.09\n", (0.036, 0.09, 0.18)),
        ("[rear_actuator]\nlag_s = 0.09\n[tuning]\nactuator_lag_factor = [0.5]\n", (0.045,)),
        ("[rear_actuator]\nlag_s = 0.09\n[tuning]\nactuator_lag_s = [0.02, 0.1]\n", (0.02, 0.1)),
    ],
)
def test_the_lags_of_the_family_follow_the_car_but_for_older_files(text: str, lags: tuple[float, ...]) -> None:
    """Both ways are stored as they were written, so that older maps and builds stay equal to the byte."""
    config = car(tomllib.loads(text))
    assert config.actuator_lags_s == lags
    key, other = (
        ("actuator_lag_s", "actuator_lag_factor") if "actuator_lag_s" in text else ("actuator_lag_factor", "actuator_lag_s")
    )
    assert key in (stored := config.model_dump(mode="json")["tuning"]) and other not in stored
    assert preset().tuning.model_dump(mode="json")["actuator_lag_s"] == [0.02, 0.05, 0.1]


def test_the_top_speed_is_that_of_the_map_unless_given() -> None:
    assert car().top_speed_km_h == 120.0 and "top_speed_km_h" not in car().to_json()
    assert car({"grid": {"speed_breakpoints_km_h": [20.0, 60.0, 90.0]}}).top_speed_km_h == 90.0
    assert car({"vehicle": {"top_speed_km_h": 180.0}}).top_speed_km_h == 180.0
    assert car({"controller": {"inputs": {"speed_max_km_h": 100.0}}}).top_speed_km_h == 100.0


@pytest.mark.parametrize(
    "text",
    [
        "[controller]\nsampling_time_s = 0.001\n",  # one plant step per sample
        "[controller]\nsampling_time_s = 0.03\n[plant]\nsampling_time_s = 0.0001\n",  # 300 up to rounding
        "[grid]\nfront_angle_breakpoints_deg = [1.0, 35.0]\nspeed_breakpoints_km_h = [20, 21.5, 60]\n",
        "[controller.inputs]\nrear_angle_max_deg = 3.5\n",
        '[controller]\nrear_rate_max_deg_s = "off"\n[tyre.front]\nstiffness_factor_b_per_rad = 17.9\n[cases.mine]\n',
        '[controller]\nrear_rate_max_deg_s = 1.0\n[cases."My_car-2.1"]\nsideslip_weight_per_s2 = 0\n',
        preset_text(),
        "",
    ],
)
def test_values_at_limits_are_allowed_and_the_canonical_text_reads_back(text: str) -> None:
    config = car(tomllib.loads(text))
    again = parse(json.loads(config.to_json()), "map")
    assert again == config
    assert again.to_json() == config.to_json()
    assert " " not in config.to_json() and config.to_json().isascii()


def test_canonical_text_depends_only_on_values() -> None:
    heavier = f"[vehicle]\nmass_kg = {math.nextafter(2335.07, math.inf)!r}\n"  # one unit in the last place
    changes = ("", heavier, "[plant]\ncommand_delay_samples = 1\n", '[plant]\nload_transfer = "paper"\n', "[cases.fws]\n")
    assert len({car(tomllib.loads(text)).to_json() for text in changes}) == len(changes)
    forward = {"vehicle": {"mass_kg": 1500.0, "track_m": 1.5}, "cases": {"a": {}, "b": {}}}
    backward = {"cases": {"b": {}, "a": {}}, "vehicle": {"track_m": 1.5, "mass_kg": 1500}}
    assert car(forward).to_json() == car(backward).to_json()


@pytest.mark.parametrize("name", ["a*/", 'a"b', "a'b", "a\n", "a\\", "é", "４ws", "a b", "", "-a", ".a", "_a", "x" * 64])
def test_names_that_are_invalid_in_c(name: str) -> None:
    with pytest.raises(ValueError, match=r"not allowed in C|has 64 characters"):
        check_name(name)
    message = refused({"cases": {name: {}}})
    assert message.startswith("car.toml: cases.")
    assert "use 1 to 63 ASCII letters, digits, '.', '_' or '-'" in message


@pytest.mark.parametrize(
    ("cases", "expected"),
    [
        ({"a": {}, "b": {}, "none": {"rear_steering": False}}, "b"),
        ({"a": {}, "law": {"reference": "zero-sideslip"}}, "a"),
        ({"one": {"reference": "zero-sideslip"}, "two": {"reference": "zero-sideslip"}}, "two"),
        ({"none": {"rear_steering": False}}, None),
    ],
)
def test_the_case_of_a_car_is_the_last_that_steers_the_rear_wheels(cases: dict[str, Any], expected: str | None) -> None:
    assert car({"cases": cases}).rear_steer_case == expected


def test_names_and_values_of_cases() -> None:
    for name in ("a", "4ws-2", "My_car-2.1", "0", "x" * 63):
        assert check_name(name) == name
    config = car({"cases": {"mine": {"sideslip_weight_per_s2": 10.0}}})
    assert config.case("mine") == Case(rear_steering=True, sideslip_weight_per_s2=10.0)
    known = "known cases: fws, 4ws-1, 4ws-2, zero-sideslip, variable-wheelbase, envelope"
    for name, where, words in (
        ("4ws2", "[cases]", f"there is no case '4ws2'; {known}; did you mean '4ws-"),
        ("sport\n\x1b[31m", "--case", known),
    ):
        with pytest.raises(ConfigError) as caught:
            preset().case(name, where=where)
        message = str(caught.value)
        assert message.startswith(f"{where}: ") and words in message and message.isprintable()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[vehicle]\nmass_kg = \n", "line 2,"),
        (b"[vehicle]\nmass_kg = 2000\nmass_kg = 2000\n", "line 3,"),
        (b"[vehicle]\nmass_kg = 3200,5 # kg\n", "line 2, column 15); write a decimal point: 3200.5"),
        (b"[vehicle]\nmass_kg = 3.200,0\r\n", "line 2, column 16); write a decimal point, and none between thousands: 3200.0"),
        (b"[vehicle]\nmass_kg = 5_376,43\n", "line 2, column 16); write a decimal point: 5376.43"),
        (b"[vehicle]\nmass_kg = 3,2e3\n", "line 2, column 12); write a decimal point: 3.2e3"),
        (
            b"[can.vehicle_motion]\nspeed = { factor = 0,005, length = 16 }\n",
            "line 2, column 25); write a decimal point: 0.005",
        ),
        (b"[vehicle]\nmass_kg = 2\nmass_kg = 2\n[tyre]\n", "line 3, column 12); give each key once"),
        (b"# caf\xe9\n", "byte 5"),
        ("# mass\n".encode("utf-16"), "it is in UTF-16; save it as UTF-8"),
        (b"[vehicle]\nmass_kg = 2.3\n", ": vehicle.mass_kg: 2.3 is outside"),
    ],
)
def test_invalid_files_are_rejected(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "my\ncar.toml"
    path.write_bytes(content)
    message = refused(path)
    assert message.startswith(f"{tmp_path}/my car.toml")
    assert words in message
    assert ("TOML syntax" in message, "UTF-8" in message) == (
        words.startswith("line"),
        words.startswith(("byte", "it is in UTF-16")),
    )
    assert "not a file" in refused(tmp_path)
    message = refused(tmp_path / "ars.toml")
    assert "No such file" in message and "codegen init" in message


@pytest.mark.parametrize(
    ("entries", "remedy"),
    [
        ("[10,5, 20,5]", "write decimal points: speed_breakpoints_km_h = [10.5, 20.5]"),
        ("[\n  10,5, # slow\n  1.000,5,\n  20,\n]", "write decimal points: speed_breakpoints_km_h = [10.5, 1000.5, 20]"),
        ("[10,20,5]", "sort the list"),  # no decimals
        ("[10, 20, 5]", "sort the list"),
    ],
)
def test_decimal_commas_in_a_list_are_named(tmp_path: Path, entries: str, remedy: str) -> None:
    """They divide entries too, so that the file is valid TOML. The lists of the default file are not taken for such ones."""
    path = tmp_path / "ars.toml"
    text = re.sub(r"speed_breakpoints_km_h = .*", "", preset_text())
    path.write_text(text.replace("[grid]\n", f"[grid]\nspeed_breakpoints_km_h = {entries}\n"))
    message = refused(path)
    assert "grid.speed_breakpoints_km_h: breakpoint" in message and message.endswith(f"; {remedy}")


def test_other_values_make_another_configuration() -> None:
    """Dotted keys, tables and sections; the configuration itself does not change."""
    config = preset()
    before = config.to_json()
    made = config.replace(
        {
            "vehicle.mass_kg": 2100.0,
            "tyre": {"rear": {"peak_factor_p1": 0.9}},
            "tyre.rear.shape_factor_c": 1.4,
            "cases": {"a.b": {"sideslip_weight_per_s2": 5.0}, "4ws-2": {"rear_steering": True}},
            "can": config.can,
        }
    )
    assert (made.vehicle.mass_kg, made.value("tyre.rear.shape_factor_c"), made.tyre.rear.peak_factor_p1) == (2100.0, 1.4, 0.9)
    assert made.tyre.front == config.tyre.front and made.vehicle.track_m == config.vehicle.track_m
    assert list(made.cases) == [*config.cases, "a.b"] and made.cases["4ws-2"] == config.cases["4ws-2"]
    assert config.to_json() == before and made.replace({"road.friction": 0.5}).replace({"road.friction": 0.9}) == made
    whole = config.replace({"limits": Limits()})
    assert whole.limits == Limits() and config.replace({}) == config
    array = config.unchecked({"vehicle.mass_kg": [1.0, 2.0], "tyre.front.shape_factor_c": None})
    assert array.vehicle.mass_kg == [1.0, 2.0] and array.tyre.front.shape_factor_c is None  # type: ignore[comparison-overlap]
    assert array.tyre.rear is config.tyre.rear and config.to_json() == before


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"vehicle.mas_kg": 2100.0}, "vehicle.mas_kg: unknown key; did you mean 'mass_kg'?"),
        ({"vehicel.mass_kg": 2100.0}, "vehicel: unknown key; did you mean 'vehicle'?"),
        ({"vehicle.mass_kg": "heavy"}, "vehicle.mass_kg: a number is needed, not 'heavy'"),
        ({"vehicle.mass_kg": 2.1}, "vehicle.mass_kg: 2.1 is outside 200 to 60000 kg; check the value and its unit"),
        ({"vehicle.mass_kg.factor": 2.0}, "vehicle.mass_kg: a number is needed, not {'factor': 2.0}"),
        (
            {"plant.sampling_time_s": 0.002, "rear_actuator.lag_s": 0.002},
            "rear_actuator.lag_s must be at least twice plant.sampling_time_s",
        ),
        (
            {"controller.tracking.yaw_increasing_wide_deg": 0.5},
            "controller.tracking: yaw_increasing_wide_deg is 0.5, below yaw_increasing_max_deg; raise it to at least 1",
        ),
        ({"controller.tracking.grip_recovery_idle_m_s3": 0.4}, "below grip_recovery_m_s3; raise it to at least 0.5"),
        ({"tuning.slow_gain_margin_db": 12.0}, "slow_gain_margin_db is 12, above gain_margin_db; lower it to at most 8"),
        ({"tuning.slow_phase_margin_deg": 46.0}, "above phase_margin_deg; lower it to at most 45"),
        ({"tuning.slow_sensitivity_max": 1.7}, "below sensitivity_max; raise it to at least 1.8"),
        ({"tuning.relaxation_length_m": []}, "tuning.relaxation_length_m: the list is empty; give at least one entry"),
        ({"tuning.actuator_lag_s": []}, "tuning.actuator_lag_s: the list is empty; give at least one entry"),
        (
            {"tuning.relaxation_length_m": [0.0, 0.01]},
            "tuning.relaxation_length_m, entry 2: 0.01 is outside 0.05 to 2 m and not 0",
        ),
        ({"plant.roll_deg_per_g": -1.0}, "plant.roll_deg_per_g: -1 is outside 0.1 to 15 deg/g and not 0;"),
        ({"plant.command_delay_samples": -1}, "plant.command_delay_samples: -1 is below 0, the smallest value;"),
        ({"plant.command_delay_samples": 21}, "plant.command_delay_samples: 21 is above 20, the largest value;"),
        ({"plant.command_delay_samples": 1.5}, "plant.command_delay_samples: a whole number is needed, not 1.5"),
    ],
)
def test_a_wrong_key_or_value_is_named(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(CodegenError) as raised:
        preset().replace(changes)
    assert words in str(raised.value)
    with pytest.raises(ConfigError, match=r"^set 3: "):
        preset().replace(changes, "set 3")


def test_a_file_without_the_looser_keys_keeps_its_own_limits() -> None:
    data = preset().model_dump(mode="json")
    data["controller"]["tracking"] = {"yaw_increasing_max_deg": 5.0, "grip_recovery_m_s3": 9.0}
    data["tuning"] |= {"gain_margin_db": 5.0, "phase_margin_deg": 30.0, "sensitivity_max": 3.0}
    config = parse(data, "older file")
    tracking, tuning = config.controller.tracking, config.tuning
    assert (tracking.yaw_increasing_wide_deg, tracking.grip_recovery_idle_m_s3) == (5.0, 9.0)
    assert (tuning.slow_gain_margin_db, tuning.slow_phase_margin_deg, tuning.slow_sensitivity_max) == (5.0, 30.0, 3.0)


def test_a_section_is_validated_too() -> None:
    with pytest.raises(ConfigError, match=r"^road\.friction: 9 is outside"):
        preset().replace({"road": Road().model_copy(update={"friction": 9.0})})

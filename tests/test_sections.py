"""`[can]` of ars.toml (positions and scales of signals), `[xcp]` and `[budgets]`: values, defaults, messages."""

import re
import tomllib
from typing import Any

import pytest

from codegen.configuration import Kind, Xcp, parse, preset, preset_text
from codegen.configuration.budgets import Budgets, MapShape
from codegen.configuration.can import RealSignal, Signal
from codegen.errors import ConfigError
from tests.test_config import refused
from tests.whole_car import car, with_car


@pytest.mark.parametrize(
    ("byte_order", "start", "length", "bits"),
    [
        ("intel", 14, 5, (14, 15, 16, 17, 18)),
        ("motorola", 20, 3, (18, 19, 20)),
        ("motorola", 23, 16, (*range(24, 32), *range(16, 24))),
        ("intel", 508, 8, None),
    ],
)
def test_bits_are_numbered_as_in_a_dbc(byte_order: str, start: int, length: int, bits: tuple[int, ...] | None) -> None:
    """Intel counts up from the least significant bit, Motorola down from the most significant one."""
    signal = Signal(name="S", start_bit=start, length=length)
    if bits is not None:
        assert signal.bits(byte_order) == bits
        return
    with pytest.raises(ValueError, match="reaches beyond"):
        signal.bits(byte_order)


@pytest.mark.parametrize(
    ("signed", "length", "codes"),
    [(True, 16, (-32767, 32767, -32768)), (False, 8, (0, 254, 255)), (True, 2, (-1, 1, -2)), (False, 2, (0, 2, 3))],
)
def test_one_code_is_kept_for_not_available(signed: bool, length: int, codes: tuple[int, int, int]) -> None:
    signal = RealSignal(name="S", start_bit=0, length=length, factor=0.5, offset=1.0, signed=signed)
    assert (signal.raw_low, signal.raw_high, signal.raw_not_available) == codes
    assert (signal.physical_low, signal.physical_high) == (0.5 * codes[0] + 1.0, 0.5 * codes[1] + 1.0)


@pytest.mark.parametrize(
    ("can", "words"),
    [
        ({"vehicle_motion": {"speed": {"start_bit": 24}}}, ("can.vehicle_motion: Speed and FrontAngle share bit 32",)),
        ({"vehicle_motion": {"yaw_rate": {"start_bit": 49}}}, ("YawRate reaches beyond the 8 bytes",)),
        ({"vehicle_motion": {"qualifier": {"length": 2}}}, ("Motion_Qualifier needs at least 3 bits",)),
        ({"vehicle_motion": {"id": 0x102}}, ("same id 0x102",)),
        ({"vehicle_motion": {"name": "RearSteerCommand"}}, ("two messages are called RearSteerCommand",)),
        ({"vehicle_motion": {"speed": {"name": "FrontAngle"}}}, ("two signals are called FrontAngle",)),
        ({"vehicle_motion": {"name": "RearSteering"}}, ("'RearSteering' is reserved in a DBC",)),
        ({"vehicle_motion": {"yaw_rate": {"signed": False}}}, ("can.vehicle_motion.yaw_rate carries 0 to 13.11", "-2.618 to")),
        ({"vehicle_motion": {"front_angle": {"length": 2, "factor": 1.0}}}, ("in steps of 1, which is too coarse",)),
        ({"vehicle_conditions": {"lateral_acceleration": {"factor": 1e-6}}}, ("0.03277", "but needs -12 to 12; enlarge")),
        ({"vehicle_conditions": {"longitudinal_acceleration": {"factor": 1.0}}}, ("too coarse for -12 to 12",)),
        ({"vehicle_motion": {"sped": {"name": "x"}}}, ("can.vehicle_motion.sped: unknown key", "did you mean 'speed'?")),
        (
            {"rear_steer_command": {"diagnostics": {"length": 15}}},
            ("Diagnostics has 15 bits and needs 16; correct its length",),
        ),
        ({"e2e": {"sync_counter_init": 15}}, ("can.e2e.sync_counter_init",)),
        ({"e2e": {"min_ok_state_valid": 0}}, ("would stay valid for ever; give at least 1",)),
        ({"e2e": {"min_ok_state_init": 1}}, ("min_ok_state_init is below min_ok_state_valid",)),
        ({"e2e": {"min_ok_state_invalid": 7}}, ("min_ok_state_invalid is 7 of 6 cycles",)),
        ({"e2e": {"max_error_state_invalid": 4}}, ("max_error_state_invalid is above max_error_state_valid",)),
        ({"e2e": {"window_size": 17}}, ("can.e2e.window_size",)),
        ({"vehicle_motion": {"cycle_time_ms": 20.0}}, ("can.vehicle_motion.cycle_time_ms must equal", "10 ms")),
        # A signal must be able to carry every value that the controller accepts.
        ({"vehicle_motion": {"speed": {"factor": 0.001}}}, ("can.vehicle_motion.speed carries", "needs -111.1 to 111.1")),
    ],
)
def test_invalid_signals_are_rejected(can: dict[str, Any], words: tuple[str, ...]) -> None:
    message = refused({"can": can})
    assert message.startswith("car.toml: ")
    assert [word for word in words if word not in message] == []


PLAIN = MapShape()
KEYS = tuple(Budgets.model_fields)


# Ten instructions per iteration of the search; a conversion for each table and layer of raw numbers. Between two
# frictions a reference needs more. A step's lookup is that of its law: the PI uses the map, tracking a reference.
@pytest.mark.parametrize(
    ("shape", "lookup", "reference"),
    [
        (MapShape(search_rounds=8), 80, 80),
        (MapShape(search_rounds=8, with_grip=True), 80 + 60, 80 + 60),
        (MapShape(search_rounds=8, frictions=4), 80 + 100, 80 + 100 + 20),
        (MapShape(is_raw=True, frictions=3, with_grip=True), 90 + 60 + 30 + 4 * 15, 90 + 60 + 30 + 20 + 6 * 15),
    ],
)
@pytest.mark.parametrize("kind", ["pi", "tracking"])
def test_a_larger_map_has_a_larger_budget(shape: MapShape, lookup: int, reference: int, kind: Kind) -> None:
    plain, found = Budgets().resolved(kind, PLAIN), Budgets().resolved(kind, shape)
    step = lookup if kind == "pi" else reference
    more = {"lookup": lookup, "reference": reference, "step": step, "task": step, "task_stack_bytes_max": 48 * shape.with_grip}
    assert {key: found[key] - plain[key] for key in plain} == {
        key: more.get(key.removesuffix("_instructions_max"), 0) for key in plain
    }


def test_longer_frames_have_a_larger_budget_for_the_task() -> None:
    plain, found = (Budgets().resolved("pi", PLAIN, frame_bytes) for frame_bytes in (8, 64))
    assert {key: found[key] - plain[key] for key in plain if found[key] != plain[key]} == {"task_instructions_max": 56 * 16}


def test_invalid_budgets_are_rejected() -> None:
    for value in (0, 95.5, True):
        with pytest.raises(ConfigError, match=r"^ars\.toml: budgets\.lookup_instructions_max: "):
            parse(with_car({"budgets": {"lookup_instructions_max": value}}), "ars.toml")


def test_a_configuration_without_budgets_of_its_own_is_written_without_them() -> None:
    """Older maps and builds stay equal to the byte."""
    assert "budgets" not in preset().to_json()
    assert "budgets" not in car().model_dump(mode="json")
    own = car({"budgets": {"step_instructions_max": 321}})
    assert own != car()
    assert parse(own.model_dump(mode="json"), "manifest.json") == own


def test_the_table_in_the_preset_matches_the_code() -> None:
    """Its comment is a table of keys and kinds."""
    text = preset_text()
    header = next(line for line in text.splitlines() if '"tracking"   "pi"' in line)
    columns: list[list[Kind]] = [["tracking"], ["pi", "proportional"], ["feedforward"]]
    assert re.findall(r'"(\w+)"', header) == [kind for kinds in columns for kind in kinds]
    for key in KEYS:
        row = re.search(rf"^#   {key} +(\S+) +(\S+) +(\S+)", text, re.MULTILINE)
        assert row, key
        for stated, kinds in zip(row.groups(), columns, strict=True):
            for kind in kinds:
                value = Budgets().resolved(kind, PLAIN).get(key)
                # A kind without the function has no budget for it.
                assert stated in ("-", "-" if value is None else f"{value:,}"), (key, kind)
                assert (stated == "-") == (value is None or (key.startswith("reference") and kind in ("pi", "proportional")))


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ("[xcp]\nreceive_id = 0x6A1", "xcp: receive_id and transmit_id are the same, 0x6A1"),
        ("[xcp]\ntransmit_id = 0x201", "xcp.transmit_id is the id of RearSteerCommand, 0x201"),
        ("[xcp]\nreceive_id = 0x18DA00F1", "xcp: receive_id is 0x18DA00F1, beyond 11 bits"),
        ("[can]\nxcp_receive_id = 1\n[xcp]\nreceive_id = 2", "can.xcp_receive_id and xcp.receive_id differ"),
        ("[xcp]\nframe_bytes_max = 64", "xcp: frame_bytes_max is 64 without CAN FD"),
        ("[xcp]\ndata_bitrate_kbit_s = 499.0", "xcp.data_bitrate_kbit_s is 499, below the bit rate of 500"),
        ("[xcp]\nmax_dto = 9", "xcp: max_dto is 9, more than frame_bytes_max, 8"),
        ('[xcp]\ncommands = ["SET_MTO"]', "xcp.commands, entry 1: 'SET_MTO' is no command of XCP"),
        ('[xcp]\ncommands = ["CONNECT"]', "xcp.commands, entry 1: every slave has CONNECT"),
        ('[xcp]\ncommands = ["UPLOAD"]', "xcp: commands has UPLOAD, but not SET_MTA"),
        ('[xcp]\ncommands = ["GET_ID", "GET_ID"]', "xcp: commands has GET_ID twice"),
        ('[xcp]\nevent_name = "10 ms\\n"', "xcp.event_name: "),
        ('[xcp]\nseed_and_key_function = "key.dll"', "xcp: seed_and_key_function without the command GET_SEED"),
    ],
)
def test_invalid_options_of_xcp_are_rejected(tables: str, message: str) -> None:
    assert message in refused(tables)


def test_identifiers_of_11_and_29_bits_are_different() -> None:
    both = "extended_ids = true\n"
    assert car(tomllib.loads(f"[xcp]\n{both}transmit_id = 0x201")).xcp.transmit_id == 0x201
    assert car(tomllib.loads(f"[can]\n{both}[xcp]\ntransmit_id = 0x201")).xcp.transmit_id == 0x201
    message = refused(f"[can]\n{both}[xcp]\n{both}transmit_id = 0x201")
    assert "xcp.transmit_id is the id of RearSteerCommand, 0x201" in message


def test_identifiers_of_xcp_are_stored_with_the_bus() -> None:
    """Older maps and builds have them there, and stay equal to the byte."""
    assert "xcp" not in car().model_dump(mode="json")
    older = car({"can": {"xcp_receive_id": 0x700}})
    assert older == car({"xcp": {"receive_id": 0x700}}) != car()
    assert older.model_dump()["can"]["xcp_receive_id"] == 0x700
    assert parse(older.model_dump(mode="json"), "manifest.json") == older


def test_the_preset_shows_every_option_of_xcp() -> None:
    assert not [key for key in Xcp.model_fields if f"{key} = " not in preset_text().partition("[xcp]")[2]]

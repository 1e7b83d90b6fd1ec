"""`[can]` of ars.toml: places and scales of signals, and the messages for what cannot be."""

from typing import Any

import pytest

from codegen.can_sections import Can, RealSignal, Signal
from codegen.config import parse
from codegen.errors import ConfigError


def refused(can: dict[str, Any], **others: Any) -> str:
    with pytest.raises(ConfigError) as caught:
        parse({"can": can, **others}, "car.toml")
    return str(caught.value)


@pytest.mark.parametrize(
    ("byte_order", "start", "length", "bits"),
    [
        ("intel", 14, 5, (14, 15, 16, 17, 18)),
        ("motorola", 20, 3, (18, 19, 20)),
        ("motorola", 17, 5, (29, 30, 31, 16, 17)),  # two bits of byte 2 above the highest three of byte 3
        ("motorola", 23, 16, (*range(24, 32), *range(16, 24))),
        ("intel", 60, 8, None),
        ("motorola", 58, 8, None),
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


def test_defaults() -> None:
    message = Can().vehicle_motion
    speed = parse({"can": {"vehicle_motion": {"speed": {"factor": 0.01}}}}, "x").can.vehicle_motion.speed
    assert speed == message.speed.model_copy(update={"factor": 0.01})
    assert message.e2e_data_id == message.id
    assert message.model_copy(update={"data_id": 0x1234}).e2e_data_id == 0x1234


@pytest.mark.parametrize(
    ("can", "words"),
    [
        ({"vehicle_motion": {"speed": {"start_bit": 24}}}, ("can.vehicle_motion: Speed and FrontAngle share bit 32",)),
        ({"vehicle_motion": {"speed": {"start_bit": 4}}}, ("Motion_Crc and Speed share bit 4",)),
        ({"vehicle_motion": {"yaw_rate": {"start_bit": 49}}}, ("YawRate reaches beyond the 8 bytes",)),
        ({"vehicle_motion": {"qualifier": {"length": 2}}}, ("Motion_Qualifier needs at least 3 bits",)),
        ({"vehicle_motion": {"id": 0x102}}, ("same id 0x102",)),
        ({"vehicle_motion": {"name": "RearSteerCommand"}}, ("two messages are called RearSteerCommand",)),
        ({"vehicle_motion": {"speed": {"name": "FrontAngle"}}}, ("two signals are called FrontAngle",)),
        ({"vehicle_motion": {"name": "RearSteering"}}, ("'RearSteering' has a meaning of its own in a DBC",)),
        ({"vehicle_motion": {"yaw_rate": {"signed": False}}}, ("can.vehicle_motion.yaw_rate carries 0 to 13.11", "-2.618 to")),
        ({"vehicle_motion": {"front_angle": {"length": 2, "factor": 1.0}}}, ("in steps of 1, which is too coarse",)),
        ({"vehicle_motion": {"sped": {"name": "x"}}}, ("can.vehicle_motion.sped: unknown key", "did you mean 'speed'?")),
        ({"vehicle_motion": {"byte_order": "big"}}, ("can.vehicle_motion.byte_order", "'intel' or 'motorola'")),
        ({"rear_steer_command": {"diagnostics": {"length": 15}}}, ("Diagnostics needs 16 bits",)),
        ({"e2e": {"sync_counter_init": 15}}, ("can.e2e.sync_counter_init",)),
        ({"bitrate_kbit_s": 500_000.0}, ("can.bitrate_kbit_s", "kbit/s")),
        ({"vehicle_motion": {"cycle_time_ms": 20.0}}, ("can.vehicle_motion.cycle_time_ms must be", "10")),
        # What the controller accepts must fit into the signal that carries it.
        ({"vehicle_motion": {"speed": {"factor": 0.001}}}, ("can.vehicle_motion.speed carries", "-111.1 to 111.1 is needed")),
        ({"vehicle_conditions": {"friction": {"factor": 0.005}}}, ("can.vehicle_conditions.friction carries",)),
        ({"rear_steer_command": {"rear_angle": {"factor": 1e-6}}}, ("can.rear_steer_command.rear_angle carries",)),
    ],
)
def test_bad_values(can: dict[str, Any], words: tuple[str, ...]) -> None:
    message = refused(can)
    assert message.startswith("car.toml: ")
    assert [word for word in words if word not in message] == []


def test_cycle_times_follow_the_sampling_time() -> None:
    controller = {"sampling_time_s": 0.005}
    assert parse({"controller": controller}, "x").controller.sampling_time_s == 0.005
    message = refused({"vehicle_motion": {"cycle_time_ms": 10.0}}, controller=controller)
    assert "must be that of controller.sampling_time_s, 5" in message

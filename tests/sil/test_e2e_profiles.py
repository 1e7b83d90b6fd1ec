"""The E2E profiles of the C: random frames against independent implementations, the receiver, and a drive in closed loop."""

from typing import Any, get_args

import cantools
import pytest

from codegen.configuration.e2e_profiles import PROFILES, ProfileName
from codegen.verify.traffic import closed_loop
from hil_sim.codec import Codec, RearSteerCommand
from hil_sim.e2e import protect
from tests.sil import answers_frames, e2e_profiles
from tests.test_config import refused

NAMES: tuple[ProfileName, ...] = get_args(ProfileName)
SETTLING = 2
"""Samples until both messages are valid: the first frame, and `min_ok_state_init` - 1 more."""
FRAMES = 2_000
"""`make evidence PART=kinds` compares 10^6 frames of each profile."""


@pytest.mark.parametrize("name", NAMES)
def test_random_frames_are_equal_to_independent_implementations(name: ProfileName) -> None:
    assert e2e_profiles.compare(name, FRAMES) == FRAMES


@pytest.mark.parametrize("name", NAMES)
def test_python_protects_like_independent_implementations(name: ProfileName) -> None:
    profile = PROFILES[name]
    oracle, _ = e2e_profiles.oracle(profile)
    for frame_bytes in (8, 24):
        for data_id, _, counter, contents in e2e_profiles.random_frames(profile, 200, frame_bytes):
            ours = protect(data_id, counter, contents, profile)
            expected = bytearray(ours)
            expected[: profile.crc_bytes] = bytes(profile.crc_bytes)
            oracle(expected, data_id)
            assert ours == bytes(expected)


@pytest.mark.parametrize("name", NAMES)
def test_receiver(name: ProfileName) -> None:
    built = e2e_profiles.built(name)
    answers_frames.check_e2e(built, answers_frames.answers_of_e2e(built, 600, every=False))


@pytest.mark.parametrize("name", NAMES)
def test_closed_loop(name: ProfileName) -> None:
    """After the start, the task accepts every frame of the bench."""
    built = e2e_profiles.built(name)
    assert built.software.function("selftest")()
    scenario, cycles = closed_loop(built.software)
    assert scenario
    task, codec = built.software.task(), Codec(built.software.config.can)
    for frames in cycles:
        for frame in frames:
            task.on_can_frame(frame.id, frame.data)
        answer = codec.decode(*task.run())
        assert isinstance(answer, RearSteerCommand)
    assert task.counters()["lost_samples"] == SETTLING


@pytest.mark.parametrize("name", NAMES)
def test_dbc_has_the_frames_of_the_profile(name: ProfileName) -> None:
    """cantools decodes a protected frame with the DBC."""
    built, profile = e2e_profiles.built(name), PROFILES[name]
    database = cantools.database.load_string(built.folder.files["ars.dbc"].decode())
    for message in built.software.config.can.messages().values():
        data = protect(message.e2e_data_id, 7, bytes(8), profile)
        found = database.decode_message(message.id, data, decode_choices=False)
        assert (found[message.counter_name], found[message.crc_name]) == (
            7,
            int.from_bytes(data[: profile.crc_bytes], "little"),
        )
        assert found.get(message.nibble_name) == (message.id >> 8 if profile.nibble_bits else None)


@pytest.mark.parametrize(
    ("can", "words"),
    [
        ({"e2e": {"profile": "3"}}, ("can.e2e.profile",)),
        ({"e2e": {"profile": "1C"}}, ("DataIdNibble of E2E profile 1, variant 1C and Motion_Qualifier share bit 12", "move")),
        ({"e2e": {"profile": "5"}}, ("Motion_Crc of E2E profile 5 and Motion_Qualifier share bit 12",)),
        ({"e2e": {"profile": "2"}}, ("VehicleMotion needs data_ids with E2E profile 2; give 16 numbers",)),
        ({"vehicle_motion": {"data_ids": [0] * 16}}, ("VehicleMotion has data_ids with E2E profile 1, variant 1A; remove it",)),
        ({**e2e_profiles.can_of("2"), "vehicle_motion": {"data_ids": [1]}}, ("has 1 data_ids; give 16",)),
        ({**e2e_profiles.can_of("1C"), "vehicle_conditions": {"data_id": 0x1102}}, ("data id 0x1102", "up to 0xFFF")),
        ({"vehicle_motion": {"crc_name": "Speed"}}, ("two signals are called Speed",)),
        ({"vehicle_motion": {"qualifier": {"start_bit": 11}}}, ("Motion_Counter of E2E profile 1, variant 1A and Motion_Q",)),
    ],
)
def test_configurations_without_room_or_data_id_are_rejected(can: dict[str, Any], words: tuple[str, ...]) -> None:
    message = refused({"can": can})
    assert [word for word in words if word not in message] == []

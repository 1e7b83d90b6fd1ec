"""The E2E profiles of the C: random frames against independent implementations, the receiver, and a drive in closed loop."""

from collections.abc import Iterator
from typing import Any, get_args

import cantools
import numpy as np
import pytest

from codegen.configuration.can import Can
from codegen.configuration.e2e_profiles import PROFILES, DataId, Profile, ProfileName, shared_counters
from codegen.judgement.car_warnings import car_warnings
from codegen.verify.traffic import closed_loop
from hil_sim.codec import Codec, RearSteerCommand
from hil_sim.e2e import E2eState, E2eStatus, Receiver, Supervision, protect
from tests.sil import answers_frames, e2e_profiles
from tests.test_config import refused
from tests.whole_car import car

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
        assert not profile.nibble_bits or message.nibble_name == message.crc_name.replace("Crc", "DataIdNibble")


@pytest.mark.parametrize("name", NAMES)
def test_a_rest_bus_simulation_that_sends_start_values_passes_the_check(name: ProfileName) -> None:
    """It counts and computes the CRC, or sends all start values as they are."""
    built, (_, check) = e2e_profiles.built(name), e2e_profiles.oracle(PROFILES[name])
    e2e_profiles.check_start_values(built.software.config.can, built.folder.files["ars.dbc"], check)


@pytest.mark.parametrize(
    ("can", "words"),
    [
        ({"e2e": {"profile": "3"}}, ("can.e2e.profile",)),
        (
            {"e2e": {"profile": "1C"}},
            ("Motion_DataIdNibble of E2E profile 1, variant 1C and Motion_Qualifier share bit 12", "move"),
        ),
        ({"e2e": {"profile": "5"}}, ("Motion_Crc of E2E profile 5 and Motion_Qualifier share bit 12",)),
        ({"e2e": {"profile": "2"}}, ("VehicleMotion needs data_ids with E2E profile 2; give 16 numbers",)),
        (
            {"vehicle_motion": {"data_ids": [0] * 16}},
            ("VehicleMotion has data_ids with E2E profile 1, variant 1A; remove them",),
        ),
        ({**e2e_profiles.can_of("2"), "vehicle_motion": {"data_ids": [1]}}, ("has 1 data_ids; give 16",)),
        ({**e2e_profiles.can_of("1C"), "vehicle_conditions": {"data_id": 0x1102}}, ("data id 0x1102", "up to 0xFFF")),
        ({"vehicle_motion": {"crc_name": "Speed"}}, ("two signals are called Speed",)),
        ({"vehicle_motion": {"qualifier": {"start_bit": 11}}}, ("Motion_Counter of E2E profile 1, variant 1A and Motion_Q",)),
    ],
)
def test_configurations_without_room_or_data_id_are_rejected(can: dict[str, Any], words: tuple[str, ...]) -> None:
    message = refused({"can": can})
    assert [word for word in words if word not in message] == []


# --- data ids that the check does not distinguish -----------------------------------------------------------------------


def pairs_of_ids(profile: Profile) -> Iterator[tuple[DataId, DataId]]:
    """Yield pairs of data ids: random ones, ones with a byte in common, and ones whose difference a CRC-8 divides."""
    rng = np.random.default_rng(51)
    if profile.data_id_mode == "list":
        for equal in range(0, 17, 4):
            one = rng.integers(0, 256, 16, dtype=np.uint8)
            other = np.where(rng.permutation(16) < equal, one, one ^ rng.integers(1, 256, 16, dtype=np.uint8))
            yield one.tobytes(), other.astype(np.uint8).tobytes()
        return
    for one in rng.integers(0, profile.data_id_max + 1, 4).tolist():
        # 0x1D01 is divisible by the polynomial of profiles 1 and 11: low byte 1, high byte 0x1D.
        for difference in (0x0001, 0x0100, 0x0101, 0x1D01, 0x3A02, 0x8000, int(rng.integers(1, 0x10000))):
            if (other := one ^ difference) <= profile.data_id_max:
                yield one, other


@pytest.mark.parametrize("name", NAMES)
def test_frames_pass_the_check_of_another_data_id_at_the_shared_counters_only(name: ProfileName) -> None:
    """The bench and `autosar-e2e` check frames with random contents."""
    profile, settings, passes = PROFILES[name], Can.model_validate(e2e_profiles.can_of(name)).e2e, list[int]()
    rng, (_, check) = np.random.default_rng(18), e2e_profiles.oracle(profile)
    for one, other in pairs_of_ids(profile):
        expected = shared_counters(profile, one, other)
        frames = {
            counter: protect(one, counter, rng.integers(0, 256, 8, dtype=np.uint8).tobytes(), profile)
            for counter in range(profile.counter_count)
        }
        bench = [k for k, data in frames.items() if Receiver(settings).check(other, data) == E2eStatus.INITIAL]
        foreign = [k for k, data in frames.items() if check(bytearray(data), other)]
        assert (tuple(bench), tuple(foreign)) == (expected, expected), (one, other)
        passes.append(len(expected))
    # Only these cannot distinguish some data ids.
    assert any(passes) == (name in ("1A", "1B", "2", "11A"))


def with_ids(name: ProfileName, *numbers: DataId) -> dict[str, Any]:
    """Return `[can]` with a profile and the data ids of the first messages."""
    can = e2e_profiles.can_of(name)
    for role, number in zip(("vehicle_motion", "vehicle_conditions", "rear_steer_command"), numbers, strict=False):
        key, value = ("data_id", number) if isinstance(number, int) else ("data_ids", list(number))
        can[role] = {**can.get(role, {}), key: value}
    return can


FIRST, SECOND = e2e_profiles.DATA_IDS[:2]
SHARED = SECOND[:5] + FIRST[5:6] + SECOND[6:]
"""A list that agrees with the first one at the counter 5."""


@pytest.mark.parametrize(
    ("can", "words"),
    [
        (
            with_ids("1A", 0x0101, 0x1C00),
            ("of VehicleMotion pass the check of VehicleConditions", "15 of 15", "0x1C00; change"),
        ),
        (with_ids("11A", 0x0101, 0x1C00), ("15 of 15 counters (0, 1, 2, …): E2E profile 11, variant 11A",)),
        (
            with_ids("1B", 0x0A01, 0x0B01),
            ("8 of 15 counters (0, 2, 4, …)", "0x0A01 and 0x0B01; give", "low byte and in the high"),
        ),
        (with_ids("1B", 0x0A01, 0x0A02), ("7 of 15 counters (1, 3, 5, …)",)),
        ({"e2e": {"profile": "1B"}}, ("0x0101 and 0x0102",)),
        (with_ids("2", FIRST, FIRST[:3] + SECOND[3:4] + FIRST[4:]), ("15 of 16 counters", "their data_ids; give lists that")),
        (with_ids("2", FIRST, SHARED[:9] + FIRST[9:10] + SHARED[10:]), ("2 of 16 counters (5, 9)",)),
        (
            {**with_ids("2", FIRST, SHARED), "e2e": {"profile": "2", "min_ok_state_init": 1, "min_ok_state_valid": 1}},
            ("1 of 16",),
        ),
    ],
)
def test_data_ids_that_the_check_does_not_distinguish_are_rejected(can: dict[str, Any], words: tuple[str, ...]) -> None:
    message = refused({"can": can})
    assert [word for word in words if word not in message] == []


def test_a_number_that_two_lists_share_is_a_warning() -> None:
    """Frames of the other message alone never make the message valid."""
    config = car({"can": with_ids("2", FIRST, SHARED)})
    assert [each for each in car_warnings(config) if "at 1 of 16 counters (5): E2E profile 2 does not distinguish" in each]
    settings, profile = config.can.e2e, PROFILES["2"]
    receiver, supervision, states = Receiver(settings), Supervision(settings), set[E2eState]()
    for cycle in range(64):
        status = receiver.check(SHARED, protect(FIRST, cycle % 16, bytes(8), profile))
        good = status in (E2eStatus.OK, E2eStatus.OK_SOME_LOST, E2eStatus.INITIAL, E2eStatus.SYNC)
        states.add(supervision.step(good, status == E2eStatus.WRONG_CRC))
    assert E2eState.VALID not in states and E2eState.INIT in states

"""Builds with each E2E profile, and independent implementations of the profiles: `autosar-e2e`, and cantools for 2 and 5."""

import functools
from collections.abc import Callable, Iterator
from typing import Any

import cantools
import numpy as np
from cantools.autosar.end_to_end import compute_profile2_crc, compute_profile5_crc
from e2e import p01, p02, p05, p11

from codegen.configuration import Config
from codegen.configuration.can import Can, RealSignal
from codegen.configuration.e2e_profiles import PROFILES, DataId, Profile, ProfileName
from hil_sim.e2e import E2eStatus, Receiver, protect
from tests import builds
from tests.whole_car import car

DATA_IDS = tuple(bytes(11 * k + 16 * message & 0xFF for k in range(16)) for message in range(3))
"""Data ids of profile 2 for each message."""
ALTERNATING_IDS = (0x0141, 0x0242, 0x0383)
"""Data ids of profile 1B for each message. The default identifiers have low or high bytes in common."""


def _short(first: int) -> dict[str, Any]:
    """Return signals with fewer bits, from the bit `first` on, so that more of the frame remains for the protection."""

    def real(start: int, length: int, factor: float) -> dict[str, Any]:
        return {"start_bit": first + start, "length": length, "factor": factor}

    return {
        "vehicle_motion": {
            "qualifier": {"start_bit": first, "length": 3},
            "speed": real(4, 12, 0.08),
            "front_angle": real(16, 12, 8e-4),
            "yaw_rate": real(28, 12, 3e-3),
        },
        "vehicle_conditions": {
            "inhibit": {"start_bit": first},
            "rear_angle": real(4, 12, 1e-3),
            "friction": {"start_bit": first + 16},
            "lateral_acceleration": {"start_bit": first + 24},
        },
        "rear_steer_command": {
            "status": {"start_bit": first, "length": 3},
            "rear_angle": real(3, 11, 1e-3),
            "yaw_rate_reference": real(14, 10, 6e-3),
            "diagnostics": {"start_bit": first + 24},
        },
    }


def can_of(name: ProfileName) -> dict[str, Any]:
    """Return `[can]` of a configuration with a profile: signals that leave room for its header, and its data ids."""
    header = max(PROFILES[name].header_bits) + 1
    can: dict[str, Any] = _short(header) if header > 12 else {}
    roles = ("vehicle_motion", "vehicle_conditions", "rear_steer_command")
    for role, ids, number in zip(roles, DATA_IDS, ALTERNATING_IDS, strict=True):
        match PROFILES[name].data_id_mode:
            case "list":
                can.setdefault(role, {})["data_ids"] = list(ids)
            case "alternating":
                can.setdefault(role, {})["data_id"] = number
    return {**can, "e2e": {"profile": name}}


def config_of(name: ProfileName) -> Config:
    """Return the paper's configuration with a profile."""
    return builds.CONFIG.model_copy(update={"can": car({"can": can_of(name)}).can})


@functools.cache
def built(name: ProfileName) -> builds.Built:
    """Return the paper's build with a profile."""
    return builds.make(builds.paper_map(), config_of(name))


_MODES = {"both": "BOTH", "alternating": "ALT", "nibble": "NIBBLE"}


def oracle(profile: Profile) -> tuple[Callable[[bytearray, Any], None], Callable[[bytearray, Any], bool]]:
    """Return protection of a frame that has its counter, and its check, by `autosar-e2e`."""
    match profile.category:
        case "PROFILE_02":
            return functools.partial(p02.e2e_p02_protect, increment_counter=False), p02.e2e_p02_check
        case "PROFILE_05":
            return functools.partial(p05.e2e_p05_protect, increment_counter=False), p05.e2e_p05_check
    module, number = (p01, "01") if profile.category == "PROFILE_01" else (p11, "11")
    mode = {"data_id_mode": getattr(module, f"E2E_P{number}_DATAID_{_MODES[profile.data_id_mode]}")}
    protect, check = (getattr(module, f"e2e_p{number}_{what}") for what in ("protect", "check"))
    return functools.partial(protect, increment_counter=False, **mode), functools.partial(check, **mode)


def check_start_values(can: Can, dbc: bytes, check: Callable[[bytearray, Any], bool] | None = None) -> None:
    """Check that a frame of the start values in a DBC passes, also `check`, and has no value that counts as measured.

    A frame with another counter only needs another CRC.
    """
    database, profile = cantools.database.load_string(dbc.decode()), can.e2e.definition
    for message in can.messages().values():
        layout, number = database.get_message_by_name(message.name), message.e2e_data_id
        codes = {signal.name: signal.raw_initial for signal in layout.signals}
        start = layout.encode(codes, scaling=False)
        assert Receiver(can.e2e, can.frame_bytes).check(number, start) == E2eStatus.INITIAL
        assert check is None or check(bytearray(start), number)
        later = layout.encode({**codes, message.counter_name: 5}, scaling=False)
        assert protect(number, 5, later, profile)[profile.crc_bytes :] == later[profile.crc_bytes :]
        reals = {signal.name for signal in message.signals().values() if isinstance(signal, RealSignal)}
        assert reals == {name for name, value in layout.decode(start).items() if value == "not available"}


def cantools_crc(profile: Profile, data: bytes, data_id: DataId) -> int | None:
    """Return the CRC of a frame by cantools; None for a profile that it does not have."""
    if isinstance(data_id, bytes):
        return compute_profile2_crc(data, data_id[data[1] & 0xF])
    return compute_profile5_crc(data, data_id) if profile.category == "PROFILE_05" else None


def random_frames(
    profile: Profile, count: int, frame_bytes: int = 8, seed: int = 1
) -> Iterator[tuple[DataId, int, int, bytes]]:
    """Yield data id, its number in the C, counter and contents of frames."""
    rng = np.random.default_rng(seed)
    contents = rng.integers(0, 256, (count, frame_bytes), dtype=np.uint8)
    counters = rng.integers(0, profile.counter_max + 1, count).tolist()
    numbers = rng.integers(0, len(DATA_IDS) if profile.data_id_mode == "list" else profile.data_id_max + 1, count).tolist()
    for row, counter, number in zip(contents, counters, numbers, strict=True):
        yield DATA_IDS[number] if profile.data_id_mode == "list" else number, number, counter, row.tobytes()


def compare(name: ProfileName, count: int) -> int:
    """Protect and check random frames with the C of a build and with `autosar-e2e`; return the number of equal frames.

    A frame is checked as it was protected, and with one byte changed.

    Raises:
        AssertionError: a frame differs.
    """
    software, profile = built(name).software, PROFILES[name]
    protect_c, check_c, init = (software.function(f"e2e_{what}") for what in ("protect", "check", "receiver_init"))
    protect, check = oracle(profile)
    receiver, frame, counter_c = software.new("e2e_receiver"), software.ffi.new("uint8_t[8]"), software.ffi.new("uint8_t *")
    buffer, equal = software.ffi.buffer(frame), 0
    low = (1 << profile.counter_length) - 1
    for data_id, number, counter, contents in random_frames(profile, count):
        buffer[:] = contents
        counter_c[0] = counter
        protect_c(number, counter_c, frame)
        expected = bytearray(contents)
        expected[profile.counter_byte] = expected[profile.counter_byte] & ~low & 0xFF | counter
        protect(expected, data_id)
        sent = bytes(buffer)
        assert sent == bytes(expected), (data_id, counter, contents.hex())
        assert counter_c[0] == (counter + 1) % profile.counter_count
        other = cantools_crc(profile, sent, data_id)
        assert other in (None, int.from_bytes(sent[: profile.crc_bytes], "little"))
        wrong = bytearray(sent)
        wrong[contents[0] % 8] ^= contents[1]
        for received in (sent, bytes(wrong)):
            init(receiver)
            is_accepted = check_c(receiver, number, received) == E2eStatus.INITIAL
            is_counter = received[profile.counter_byte] & low <= profile.counter_max
            assert is_accepted == (check(bytearray(received), data_id) and is_counter), (data_id, received.hex())
        equal += 1
    return equal

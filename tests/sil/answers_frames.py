"""Expected frames of Python's own codec and E2E protection, computed once and compared with many builds of the same C.

`answers` does the same for the models.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.configuration.can import Can, E2e, RealSignal
from codegen.configuration.e2e_profiles import DataId, Profile
from hil_sim.codec import PAYLOADS, Codec
from hil_sim.e2e import E2eStatus, Receiver, Supervision, crc, next_counter, protect
from tests.builds import Built


@dataclass(frozen=True)
class MessageFrames:
    """Contents of a message with their frame, and frames with their contents."""

    role: str
    packed: list[tuple[Any, bytes]]
    unpacked: list[tuple[bytes, Any]]


def _values(signal: RealSignal, real: Any) -> list[float]:
    """Return the limits, codes of every size with their ties and neighbours, and special values."""
    tiny = np.finfo(real)
    values = [math.nan, math.inf, -math.inf, 0.0, -0.0, float(tiny.smallest_subnormal), -float(tiny.tiny), float(tiny.max)]
    low, high = signal.raw_low, signal.raw_high
    codes = {low, high, low + 1, high - 1, 0, 1, 2, 3, -1, -2, *(1 << k for k in range(15)), *(-(1 << k) for k in range(15))}
    codes |= set(range(low, high, 331))
    for code, part in itertools.product(sorted(codes), (-0.5, 0.0, 0.5)):
        middle = real((code + part) * signal.factor + signal.offset)
        values += [float(middle), *(float(np.nextafter(middle, real(side))) for side in (-np.inf, np.inf))]
    return values


def answers_of_can(built: Built) -> list[MessageFrames]:
    """Return frames for every real signal alone and combined, for every bit of the other signals, and for random bits."""
    can, real = built.software.config.can, built.software.real
    codec, rng, known = Codec(can, built.software.precision), np.random.default_rng(4), []
    for role, kind in PAYLOADS.items():
        message = can.messages()[role]
        reals = {name: signal for name, signal in message.signals().items() if isinstance(signal, RealSignal)}
        rest: dict[str, Any] = {"inhibit": (False, True), "status": range(16), "diagnostics": [1 << k for k in range(16)]}
        others = [{name: value} for name, values in rest.items() if name in message.signals() for value in values]
        nothing: dict[str, Any] = dict.fromkeys(reals, math.nan)
        contents = [kind(**nothing | {name: value}) for name, signal in reals.items() for value in _values(signal, real)]
        contents += [kind(**dict.fromkeys(reals, 0.01) | other) for other in others]
        frames = [bytes(rng.integers(0, 256, 8, dtype=np.uint8)) for _ in range(300)]
        frames += [bytes(1 << bit % 8 if byte == bit // 8 else 0 for byte in range(8)) for bit in range(64)]
        frames += [
            bytes((0, 0x70, *(0xFF if (mask >> k) & 1 else 0x80 * ((mask >> k + 3) & 1) for k in range(6))))
            for mask in range(512)
        ]
        known.append(MessageFrames(role, [(content, codec.encode(content)) for content in contents],
                            [(frame, codec.decode(message.id, frame)) for frame in frames]))  # fmt: skip
    return known


def _not_available_bits(built: Built) -> int:
    """Return the bits of the number that means "not available", as the C writes it to memory."""
    software = built.software
    task = software.new("task")
    software.function("task_init")(task, software.parameters())
    return int.from_bytes(
        bytes(software.ffi.buffer(software.ffi.addressof(task, "motion"))[0 : np.dtype(software.real).itemsize]), "little"
    )


def check_can(built: Built, known: list[MessageFrames]) -> None:
    """Check that every frame and its contents equal those of Python's codec.

    A frame is written completely, whatever the memory held, and nothing beyond it changes.
    """
    software = built.software
    # The quiet NaN that IEEE 754-2019 prefers: no payload, and the sign that the C's own arithmetic does not produce.
    assert _not_available_bits(built) == {4: 0x7FC00000, 8: 0x7FF8000000000000}[np.dtype(software.real).itemsize]
    for one in known:
        struct, data = software.new(one.role), software.ffi.new("uint8_t[24]")
        pack, unpack = (software.function(f"can_{way}_{one.role}") for way in ("pack", "unpack"))
        fields = {name for name, _ in software.ffi.typeof(struct[0]).fields}  # without signals that this build does not have
        for content, frame in one.packed:
            for name in fields:
                setattr(struct, name, getattr(content, name))
            software.ffi.buffer(data)[:] = b"\xff" * 24
            pack(struct, data + 8)
            assert bytes(data) == b"\xff" * 8 + frame + b"\xff" * 8, content
        for frame, content in one.unpacked:
            unpack(frame, struct)
            assert all(repr(getattr(struct, name)) == repr(getattr(content, name)) for name in fields), frame.hex()


Events = list[tuple[bytes | None, int]]
"""Frames (None: a cycle without a frame) with the receiver's status."""


@dataclass(frozen=True)
class ReceiverResults:
    """Status sequences of receivers, cycles (good, damaged) with the message's state, and protected frames."""

    profile: Profile
    data_id: DataId
    receptions: list[Events]
    states: list[list[tuple[bool, bool, int]]]
    protected: list[tuple[DataId, int, bytes, bytes]]

    def number_of(self, data_id: DataId) -> int:
        """Return the data id as the C takes it. Lists of data ids: that of the first message is used."""
        return data_id if isinstance(data_id, int) else 0


def answers_of_e2e(built: Built, count: int = 4000, every: bool = True) -> ReceiverResults:
    """Return results for received, missing, repeated, skipped and damaged frames; long runs of each reach every status."""
    can, rng = built.software.config.can, np.random.default_rng(6)
    settings, data_id = can.e2e, can.vehicle_motion.e2e_data_id
    profile = settings.definition
    receiver, counter = Receiver(settings), 0
    events: Events = []
    kinds = ("next",) * 6 + ("silence", "repeat", "jump", "corrupt", "fifteen")[: 5 if profile.has_invalid_counter else 4]
    while len(events) < count:
        kind, length = rng.choice(kinds), int(rng.choice([1, 1, 1, 2, 3, 5, 20]))
        for _ in range(length):
            step = {"next": 1, "repeat": 0, "jump": int(rng.integers(2, 15))}.get(kind, 1)
            counter = (counter + step) % profile.counter_count
            data = protect(data_id, counter, bytes(rng.integers(0, 256, 8, dtype=np.uint8)), profile)
            if kind == "corrupt":
                data = bytes((data[0] ^ 1 << int(rng.integers(8)),)) + data[1:]
            if kind == "fifteen":
                body = bytes((0, data[1] | 0x0F)) + data[2:]
                data = bytes((crc(data_id, body, profile),)) + body[1:]
            if kind == "silence":
                events.append((None, int(receiver.no_new_data())))
            else:
                events.append((data, int(receiver.check(data_id, data))))
    assert not every or {status for _, status in events} == set(map(int, E2eStatus))
    silences = [each for jump in range(1, 15) for each in _silences(can, jump, range(7), (None, 1, 0, 1, 1, 1, 1))]
    long = (*range(1, 18), *range(254, 262), 300)
    silences += [each for jump in (1, 2, 14) for each in _silences(can, jump, long, (1, 1, 1, None, 0, 1, 1, 1))]
    protected = []
    for index in range(600):
        number, body = int(rng.integers(0, 1 << 16)), bytes(rng.integers(0, 256, 8, dtype=np.uint8))
        other, sent = data_id if isinstance(data_id, bytes) else number, index % profile.counter_count
        protected.append((other, sent, body, protect(other, sent, body, profile)))
    return ReceiverResults(
        profile, data_id, [events, *silences], [_states(settings, rng) for _ in range(count // 80)], protected
    )


def _states(settings: E2e, rng: np.random.Generator) -> list[tuple[bool, bool, int]]:
    """Return cycles from the start of the supervision, in spells with any shares of good and damaged frames, including 0 and
    1."""
    supervision, states = Supervision(settings), []
    for length in rng.integers(1, 30, 6):
        good, damaged = rng.choice((0.0, 0.3, 0.5, 1.0), 2, p=(0.1, 0.4, 0.2, 0.3))
        for came in zip((rng.random(length) < good).tolist(), (rng.random(length) < damaged).tolist(), strict=True):
            states.append((*came, int(supervision.step(*came))))
    return states


def _silences(can: Can, jump: int, silences: Sequence[int], steps: Sequence[int | None]) -> Iterator[Events]:
    """Yield frames whose counters advance by these steps (0 means `jump`), with a silence of each length for None."""
    for silent in silences:
        receiver, counter, profile = Receiver(can.e2e), 5, can.e2e.definition
        data_id = can.vehicle_motion.e2e_data_id
        events: Events = []
        for step in steps:
            if step is None:
                events += [(None, int(receiver.no_new_data())) for _ in range(silent)]
                continue
            counter = (counter + (step or jump)) % profile.counter_count
            data = protect(data_id, counter, bytes(8), profile)
            events.append((data, int(receiver.check(data_id, data))))
        yield events


def check_e2e(built: Built, known: ReceiverResults) -> None:
    """Check that every status and every protected frame equals that of the Python receiver."""
    software = built.software
    state = software.new("e2e_receiver")
    check, silent = software.function("e2e_check"), software.function("e2e_no_new_data")
    for events in known.receptions:
        software.function("e2e_receiver_init")(state)
        for index, (data, wanted) in enumerate(events):
            got = silent(state) if data is None else check(state, known.number_of(known.data_id), data)
            assert got == wanted, f"event {index}: {got} instead of {E2eStatus(wanted).name}"
    supervision, supervise = software.new("e2e_supervision"), software.function("e2e_supervise")
    for states in known.states:
        software.function("e2e_supervision_init")(supervision)
        for index, (good, damaged, wanted) in enumerate(states):
            assert supervise(supervision, good, damaged) == wanted, f"cycle {index}"
    for data_id, counter, body, wanted_frame in known.protected:
        buffer, count = software.ffi.new("uint8_t[8]", body), software.ffi.new("uint8_t *", counter)
        number = known.number_of(data_id)
        software.function("e2e_protect")(number, count, buffer)
        assert bytes(buffer) == wanted_frame
        assert count[0] == next_counter(counter, known.profile)
        assert software.function("e2e_crc")(number, body) == crc(data_id, body, known.profile)

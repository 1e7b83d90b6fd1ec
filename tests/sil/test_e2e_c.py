"""The protection of frames in C, against the Python one, the specification's examples and an independent implementation."""

from __future__ import annotations

import functools
from typing import Any

import pytest
from e2e import p01
from hypothesis import given
from hypothesis import strategies as st

from codegen.can_sections import Can, E2e
from codegen.sil.software import Software
from hil_sim.e2e import E2eStatus, Receiver, crc, next_counter, protect
from tests import builds
from tests.builds import Built

FRAMES = st.binary(min_size=8, max_size=8)
IDS = st.integers(0, 0xFFFF)


def c_protect(software: Software, data_id: int, counter: int, data: bytes) -> tuple[bytes, int]:
    """The frame, and the counter of the next one."""
    ffi = software.ffi
    buffer, state = ffi.new("uint8_t[8]", data), ffi.new("uint8_t *", counter)
    software.function("e2e_protect")(data_id, state, buffer)
    return bytes(buffer), state[0]


class CReceiver:
    """The generated receiver."""

    def __init__(self, software: Software) -> None:
        self._state: Any = software.new("e2e_receiver")
        self._check, self._silent = software.function("e2e_check"), software.function("e2e_no_new_data")
        software.function("e2e_receiver_init")(self._state)

    def check(self, data_id: int, data: bytes) -> E2eStatus:
        return E2eStatus(self._check(self._state, data_id, data))

    def no_new_data(self) -> E2eStatus:
        return E2eStatus(self._silent(self._state))


@pytest.mark.parametrize(("counter", "frame"), [(0, "cc00000000000000"), (1, "9101000000000000")])
def test_examples_of_the_specification(paper: Built, counter: int, frame: str) -> None:
    """AUTOSAR FO R20-11, PRS_E2EProtocol, section 6.3.5: data id 0x123, eight bytes of zero."""
    assert c_protect(paper.software, 0x123, counter, bytes(8))[0].hex() == frame


@given(IDS, st.integers(0, 14), FRAMES)
def test_protection_is_that_of_python_and_of_the_independent_one(data_id: int, counter: int, data: bytes) -> None:
    ours, following = c_protect(builds.paper().software, data_id, counter, data)
    assert ours == protect(data_id, counter, data)
    assert following == next_counter(counter)
    theirs = bytearray(ours)
    p01.e2e_p01_protect(theirs, data_id, increment_counter=False)
    assert bytes(theirs) == ours
    assert p01.e2e_p01_check(bytearray(ours), data_id)


@given(IDS, FRAMES)
def test_the_crc_is_that_of_python(data_id: int, data: bytes) -> None:
    assert builds.paper().software.function("e2e_crc")(data_id, data) == crc(data_id, data)


SETTINGS = [E2e(), E2e(max_delta_counter_init=0, max_no_new_or_repeated_data=14, sync_counter_init=0)]
EVENTS = st.lists(
    st.one_of(
        st.just(("next", 1)),
        st.tuples(st.just("next"), st.integers(0, 14)),  # the counter advances by so much
        st.just(("silence", 0)),
        st.just(("corrupt", 0)),
        st.just(("fifteen", 0)),
    ),
    max_size=80,
)


@functools.cache
def software_with(settings: E2e) -> Software:
    """A build whose receivers tolerate other things."""
    return builds.make(builds.paper_map(), builds.CONFIG.model_copy(update={"can": Can(e2e=settings)})).software


@pytest.mark.parametrize("settings", SETTINGS, ids=["default", "strict"])
@given(events=EVENTS)
def test_receivers_go_through_the_same_states(settings: E2e, events: list[tuple[str, int]]) -> None:
    ours, reference, counter = CReceiver(software_with(settings)), Receiver(settings), 3
    for kind, step in events:
        if kind == "silence":
            assert ours.no_new_data() == reference.no_new_data()
            continue
        counter = (counter + step) % 15
        data = protect(0x101, counter, bytes(8))
        if kind == "corrupt":
            data = bytes((data[0] ^ 1,)) + data[1:]
        if kind == "fifteen":
            body = bytes((0, 0x0F)) + bytes(6)
            data = bytes((crc(0x101, body),)) + body[1:]
        assert ours.check(0x101, data) == reference.check(0x101, data), (kind, step)

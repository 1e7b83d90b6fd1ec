"""AUTOSAR E2E profile 1A: the specification's vectors, an independent implementation, error detection, states."""

from __future__ import annotations

import itertools

import pytest
from e2e import p01
from hypothesis import given
from hypothesis import strategies as st

from codegen.can_sections import E2e
from hil_sim.e2e import LARGEST_COUNTER, E2eStatus, Receiver, crc, next_counter, protect

OK, NO_NEW, WRONG_CRC, SYNC = E2eStatus.OK, E2eStatus.NO_NEW_DATA, E2eStatus.WRONG_CRC, E2eStatus.SYNC
INITIAL, REPEATED, LOST, SEQUENCE = E2eStatus.INITIAL, E2eStatus.REPEATED, E2eStatus.OK_SOME_LOST, E2eStatus.WRONG_SEQUENCE

DATA_ID = 0x101
FRAMES = st.binary(min_size=8, max_size=8)
DATA_IDS = st.integers(0, 0xFFFF)
COUNTERS = st.integers(0, LARGEST_COUNTER)


# AUTOSAR FO R20-11, PRS_E2EProtocol (document 849), section 6.3.5, "E2E Profile 1 Protocol Examples", DataIDMode BOTH:
# data id 0x123, eight bytes, all data zero, first and second frame.
@pytest.mark.parametrize(
    ("counter", "frame"),
    [(0, "cc 00 00 00 00 00 00 00"), (1, "91 01 00 00 00 00 00 00")],
)
def test_examples_of_the_specification(counter: int, frame: str) -> None:
    assert protect(0x123, counter, bytes(8)) == bytes.fromhex(frame)


# CRC-8 SAE J1850 of the digits 1 to 9 is 0x4B with start value and XOR 0xFF (AUTOSAR SWS_CRCLibrary, 7.2.1.1); with the
# data id that turns profile 1's zero start into 0xFF, and its XOR undone, the same polynomial shows.
def test_check_value_of_the_polynomial() -> None:
    start = next(data_id for data_id in range(0x100) if crc(data_id << 8, b"\0") == 0xFF)
    assert crc(start << 8, b"\0" + b"123456789") ^ 0xFF == 0x4B


@given(DATA_IDS, COUNTERS, FRAMES)
def test_an_independent_implementation_protects_and_accepts_equally(data_id: int, counter: int, data: bytes) -> None:
    other = bytearray(data)
    other[1] = other[1] & 0xF0 | counter
    p01.e2e_p01_protect(other, data_id, data_id_mode=p01.E2E_P01_DATAID_BOTH, increment_counter=False)
    ours = protect(data_id, counter, data)
    assert ours == bytes(other)
    for frame in (ours, data):
        accepted = p01.e2e_p01_check(bytearray(frame), data_id, data_id_mode=p01.E2E_P01_DATAID_BOTH) and frame[1] & 0xF != 15
        assert (Receiver(E2e()).check(data_id, frame) == INITIAL) == accepted


def _passes(frame: int, errors: int) -> bool:
    return Receiver(E2e()).check(DATA_ID, (frame ^ errors).to_bytes(8, "big")) == INITIAL


def _a_frame() -> int:
    return int.from_bytes(protect(DATA_ID, 5, bytes.fromhex("00b0 12 34 56 78 9a bc")), "big")


def test_every_single_and_double_bit_error_is_found() -> None:
    frame = _a_frame()
    assert _passes(frame, 0)
    for one, other in itertools.combinations_with_replacement(range(64), 2):
        assert not _passes(frame, 1 << one | 1 << other), (one, other)


def test_every_short_burst_is_found() -> None:
    # In the order in which a CAN frame is sent: byte by byte, the highest bit first. A CRC of 8 bits finds every burst of 8
    # where it stands after the data. Profile 1 puts it in front, so five bursts across its end, which are longer than 8 in the
    # order of the CRC, pass; CAN's own CRC finds those. Up to 7 bits there is no exception.
    frame, crc_end = _a_frame(), 56
    for width in range(1, 9):
        inner = range(2 ** max(width - 2, 0))
        for shift, middle in itertools.product(range(64 - width + 1), inner):
            burst = 1 if width == 1 else 1 << (width - 1) | middle << 1 | 1
            if width < 8 or not shift < crc_end < shift + width:
                assert not _passes(frame, burst << shift), (width, shift, middle)


@pytest.mark.parametrize("other", [0x102, 0x001])
def test_a_frame_under_another_data_id_does_not_pass(other: int) -> None:
    frame = protect(other, 3, bytes.fromhex("00 70 01 02 03 04 05 06"))
    assert Receiver(E2e()).check(DATA_ID, frame) == WRONG_CRC


@pytest.mark.parametrize(("counter", "data"), [(15, bytes(8)), (-1, bytes(8)), (0, bytes(7)), (0, b"")])
def test_protect_rejects_bad_counters_and_lengths(counter: int, data: bytes) -> None:
    with pytest.raises(ValueError, match=r"counter|bytes"):
        protect(DATA_ID, counter, data)


def test_the_counter_skips_15() -> None:
    assert [next_counter(counter) for counter in (0, 13, 14)] == [1, 14, 0]


STATUSES = {"o": OK, "-": NO_NEW, "x": WRONG_CRC, "s": SYNC, "i": INITIAL, "r": REPEATED, "l": LOST, "q": SEQUENCE}


def _run(events: list[int | str], settings: E2e) -> list[E2eStatus]:
    """Statuses of a receiver: a number is a good frame with that counter, "-" none in this cycle, "x" a corrupt one."""
    receiver, statuses = Receiver(settings), []
    for event in events:
        if event == "-":
            statuses.append(receiver.no_new_data())
        elif event == "x":
            statuses.append(receiver.check(DATA_ID, bytes((crc(DATA_ID, bytes(8)) ^ 1,)) + bytes(7)))
        else:
            assert isinstance(event, int)
            body = bytes((0, event)) + bytes(6)
            statuses.append(receiver.check(DATA_ID, bytes((crc(DATA_ID, body),)) + body[1:]))
    return statuses


# (max_delta_counter_init, max_no_new_or_repeated_data, sync_counter_init), events as in `_run` with counters in hexadecimal,
# and the status after each, one of STATUSES.
DEFAULT = (1, 3, 1)


@pytest.mark.parametrize(
    ("settings", "events", "expected"),
    [
        pytest.param(DEFAULT, "de01", "iooo", id="starts anywhere, counter goes around"),
        pytest.param(DEFAULT, "001", "iro", id="repeated"),
        pytest.param(DEFAULT, "023", "ilo", id="one lost, unnoticed until then"),
        pytest.param(DEFAULT, "0345", "iqso", id="two lost, unnoticed: out of sequence"),
        pytest.param(DEFAULT, "0xx34", "ixxlo", id="tolerance grows with corrupt frames"),
        pytest.param(DEFAULT, "0--456", "i--loo", id="one more than the empty cycles"),
        pytest.param(DEFAULT, "0--567", "i--qso", id="two more"),
        pytest.param(DEFAULT, "0---45", "i---lo", id="silence that is tolerated"),
        pytest.param(DEFAULT, "0----567", "i----sso", id="silence too long"),
        pytest.param(DEFAULT, "0----abc", "i----qso", id="silence ends by a jump"),
        pytest.param(DEFAULT, "00000123", "irrrrsso", id="repeated too often"),
        pytest.param(DEFAULT, "00-0-345", "ir-r-sso", id="repeated and silent"),
        pytest.param(DEFAULT, "0xxxx56", "ixxxxlo", id="corrupt is not silence"),
        pytest.param(DEFAULT, "--x45", "--xio", id="nothing before the first"),
        pytest.param(DEFAULT, "------4567", "------isso", id="long silence before the first"),
        pytest.param(DEFAULT, "354678", "ilqsoo", id="two frames swapped"),
        pytest.param(DEFAULT, "9a012", "ioqso", id="sender restarted"),
        pytest.param(DEFAULT, "0" + 20 * "-" + "01", "i" + 20 * "-" + "rs", id="silence, same counter by chance"),
        pytest.param(DEFAULT, "0" + 20 * "-" + "e01", "i" + 20 * "-" + "sso", id="tolerance ends at 14"),
        pytest.param(DEFAULT, "0f2", "ixl", id="counter 15 is invalid, though its CRC is right"),
        pytest.param(DEFAULT, "ff3", "xxi", id="nor is it a first one"),
        pytest.param((1, 3, 3), "0789ab", "iqssso", id="sync of 3"),
        pytest.param((1, 3, 3), "078cd", "iqsqs", id="sync broken"),
        pytest.param((1, 3, 0), "05678", "iqqqq", id="no sync: the counter runs ahead of the tolerance"),
        pytest.param((1, 3, 0), "05---67", "iq---lo", id="no sync: the tolerance reaches the counter"),
        pytest.param((1, 3, 0), "0----56", "i----so", id="silence, no sync"),
        pytest.param((4, 3, 1), "05bc", "ilqs", id="larger tolerance"),
        pytest.param((0, 3, 1), "0134", "ioqs", id="no tolerance"),
        pytest.param((1, 14, 1), "0" + 20 * "-" + "12", "i" + 20 * "-" + "oo", id="any silence"),
        pytest.param((1, 0, 1), "0-234", "i-sso", id="no silence"),
    ],
)
def test_receiver(settings: tuple[int, int, int], events: str, expected: str) -> None:
    delta, silence, sync = settings
    e2e = E2e(max_delta_counter_init=delta, max_no_new_or_repeated_data=silence, sync_counter_init=sync)
    statuses = _run([event if event in "-x" else int(event, 16) for event in events], e2e)
    assert statuses == [STATUSES[letter] for letter in expected]


def test_a_frame_of_another_length_is_a_wrong_input() -> None:
    receiver = Receiver(E2e())
    assert receiver.check(DATA_ID, b"") == WRONG_CRC
    assert receiver.check(DATA_ID, protect(DATA_ID, 0, bytes(8))[:7]) == WRONG_CRC
    assert receiver.check(DATA_ID, protect(DATA_ID, 0, bytes(8))) == INITIAL


SETTINGS = st.builds(
    E2e,
    max_delta_counter_init=st.integers(0, 14),
    max_no_new_or_repeated_data=st.integers(0, 14),
    sync_counter_init=st.integers(0, 14),
)
EVENTS = st.lists(st.one_of(st.integers(0, 15), st.sampled_from(["-", "x"])), max_size=60)


@given(SETTINGS, EVENTS, COUNTERS)
def test_after_anything_good_frames_lead_back_to_ok(settings: E2e, events: list[int | str], first: int) -> None:
    good = [(first + index) % 15 for index in range(3 * 15 + 16)]
    assert _run([*events, *good], settings)[-1] == OK

"""AUTOSAR E2E profile 1A: an independent implementation, error detection, states. tests/sil compares the C with this one."""

import itertools

import pytest
from e2e import p01
from hypothesis import given
from hypothesis import strategies as st

from codegen.configuration.can import E2e
from hil_sim.e2e import LARGEST_COUNTER, E2eStatus, Receiver, Supervision, crc, protect

DATA_ID = 0x101


@given(st.integers(0, 0xFFFF), st.integers(0, LARGEST_COUNTER), st.binary(min_size=8, max_size=8))
def test_an_independent_implementation_protects_and_accepts_equally(data_id: int, counter: int, data: bytes) -> None:
    other = bytearray(data)
    other[1] = other[1] & 0xF0 | counter
    p01.e2e_p01_protect(other, data_id, data_id_mode=p01.E2E_P01_DATAID_BOTH, increment_counter=False)
    ours = protect(data_id, counter, data)
    assert ours == bytes(other)
    for frame in (ours, data):
        accepted = p01.e2e_p01_check(bytearray(frame), data_id, data_id_mode=p01.E2E_P01_DATAID_BOTH) and frame[1] & 0xF != 15
        assert (Receiver(E2e()).check(data_id, frame) == E2eStatus.INITIAL) == accepted


def test_every_single_and_double_bit_error_is_found() -> None:
    frame = int.from_bytes(protect(DATA_ID, 5, bytes.fromhex("00b0 12 34 56 78 9a bc")))
    for one, other in itertools.combinations_with_replacement(range(64), 2):
        received = (frame ^ (1 << one | 1 << other)).to_bytes(8)
        assert Receiver(E2e()).check(DATA_ID, received) == E2eStatus.WRONG_CRC, (one, other)


NAMES = "OK NO_NEW_DATA WRONG_CRC SYNC INITIAL REPEATED OK_SOME_LOST WRONG_SEQUENCE"
STATUSES = {letter: E2eStatus[name] for letter, name in zip("o-xsirlq", NAMES.split(), strict=True)}
DEFAULT = (1, 3, 1)


# (max_delta_counter_init, max_no_new_or_repeated_data, sync_counter_init); in each cycle a good frame with that counter
# (hexadecimal), "-" none, "x" a corrupt or "~" a short one; the status after each, one of STATUSES.
@pytest.mark.parametrize(
    ("settings", "events", "expected"),
    [
        pytest.param(DEFAULT, "de01", "iooo", id="starts anywhere, counter goes around"),
        pytest.param(DEFAULT, "001", "iro", id="repeated"),
        pytest.param(DEFAULT, "023", "ilo", id="one lost, unnoticed until then"),
        pytest.param(DEFAULT, "0xx34", "ixxlo", id="tolerance grows with corrupt frames"),
        pytest.param(DEFAULT, "0~~34", "ixxlo", id="a short frame is a corrupt one"),
        pytest.param(DEFAULT, "0--456", "i--loo", id="one more than the empty cycles"),
        pytest.param(DEFAULT, "0----567", "i----sso", id="silence too long"),
        pytest.param(DEFAULT, "00000123", "irrrrsso", id="repeated too often"),
        pytest.param(DEFAULT, "0" + 20 * "-" + "01", "i" + 20 * "-" + "rs", id="silence, same counter by chance"),
        pytest.param(DEFAULT, "0" + 20 * "-" + "e01", "i" + 20 * "-" + "sso", id="tolerance ends at 14"),
        pytest.param(DEFAULT, "0f2", "ixl", id="counter 15 is invalid, though its CRC is right"),
        pytest.param((1, 3, 3), "078cd", "iqsqs", id="sync broken"),
        pytest.param((1, 3, 0), "05---67", "iq---lo", id="no sync: the tolerance reaches the counter"),
        pytest.param((4, 3, 1), "05bc", "ilqs", id="larger tolerance"),
        pytest.param((1, 0, 1), "0-234", "i-sso", id="no silence"),
    ],
)
def test_receiver(settings: tuple[int, int, int], events: str, expected: str) -> None:
    names = ("max_delta_counter_init", "max_no_new_or_repeated_data", "sync_counter_init")
    receiver, statuses = Receiver(E2e(**dict(zip(names, settings, strict=True)))), []
    broken = {"x": bytes((crc(DATA_ID, bytes(8)) ^ 1,)) + bytes(7), "~": protect(DATA_ID, 0, bytes(8))[:7]}
    for event in events:
        if event == "-":
            statuses.append(receiver.no_new_data())
            continue
        body = bytes((0, int(event, 16) if event not in broken else 0)) + bytes(6)
        statuses.append(receiver.check(DATA_ID, broken.get(event, bytes((crc(DATA_ID, body),)) + body[1:])))
    assert statuses == [STATUSES[letter] for letter in expected]


def states(events: str, **settings: int) -> str:
    """Return the first letter of the state after each cycle, "x" for INVALID; "o" is a good frame, "d" a damaged one, "b"
    both."""
    supervision = Supervision(E2e(**settings))
    return "".join("nivx"[supervision.step(event in "ob", event in "db")] for event in events)


# Worked out from PRS_E2EProtocol, figure of E2E_SMCheck. The default window has 6 cycles: VALID needs 2 good ones and
# at most 3 damaged ones; to become VALID again, 3 good ones and at most 2 damaged ones.
@pytest.mark.parametrize(
    ("events", "expected"),
    [
        pytest.param("-d-ooo", "nnniiv", id="valid with the third frame"),
        pytest.param("ooo------ooo", "iivvvvvxxxxv", id="silence, and three good ones after it"),
        pytest.param("ooodddd", "iivvvvx", id="more than three damaged ones"),
        pytest.param("ooobbbb", "iivvvvx", id="damaged ones beside good ones"),
        pytest.param("oddd", "iiix", id="damaged ones at the start"),
        pytest.param("odddooooo", "iiixxxxvv", id="which leave the window first"),
        pytest.param("ooo" + "-o" * 9, "iiv" + "v" * 18, id="two clocks: every other cycle"),
    ],
)
def test_state_machine(events: str, expected: str) -> None:
    assert states(events) == expected


def test_any_pattern_of_loss_ends_the_valid_state_within_the_window() -> None:
    settings = E2e()
    size, least = settings.window_size, settings.min_ok_state_valid
    for bits in range(1 << size):
        pattern = "".join("-o"[bits >> k & 1] for k in range(size))
        after = states("o" * 20 + 5 * pattern)[20:]
        if pattern.count("o") < least:
            assert "v" not in after[size - 1 :], pattern
        else:  # every window of such a pattern has as many good ones
            assert set(after) == {"v"}, pattern
    # Three of four lost: 60 ms with a cycle of 10 ms.
    assert states("ooo" + "---o" * 5)[3:].index("x") == settings.window_size - 1

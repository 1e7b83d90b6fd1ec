"""Inputs that repeat: a difference is found at its sample, however late, and a law that does not settle is reported."""

import numpy as np
import pytest

from codegen.verify.unit_drives import Stretch
from tests.oracle import pairs
from tests.oracle.pairs import Pair, Result, compare, state_of


class Counters(Pair):
    """The law counts ones up to a limit, and a zero resets it. The C counts on, and is wrong in one sample."""

    def __init__(self, limit: int, wrong: int) -> None:
        self._limit, self._wrong, self._sample = limit, wrong, 0
        self._count = self._c_count = self.second_samples = 0

    def second(self, sample: int) -> int:
        self.second_samples += 1
        self._count = min(self._count + 1, self._limit) if sample else 0
        return self._count

    def compiled(self, sample: int) -> int:
        self._c_count = self._c_count + 1 if sample else 0
        self._sample += 1
        return min(self._c_count, self._limit) + (self._sample - 1 == self._wrong)

    def state(self) -> int:
        return self._count


def test_equal_outputs_for_an_hour_take_the_second_implementation_a_few_samples() -> None:
    pair = Counters(limit=12, wrong=-1)
    result = compare(pair, [Stretch([1], 360_000), Stretch([0]), Stretch([1, 1, 0], 50_000)])
    assert result == Result(None, compared=13 + 1 + 6, repeated=360_000 - 13 + 150_000 - 6)
    assert pair.second_samples == result.compared


@pytest.mark.parametrize("wrong", [0, 11, 12, 13, 39_999, 359_999, 360_000, 360_001, 360_010])
def test_a_difference_is_found_at_its_sample(wrong: int) -> None:
    result = compare(Counters(12, wrong), [Stretch([1], 360_000), Stretch([0]), Stretch([1, 1, 0], 50_000)])
    assert result.difference is not None
    index, sample, got, wanted = result.difference
    assert (index, got) == (wrong, wanted + 1)
    assert sample == (0 if wrong == 360_000 else 1)


def test_a_law_that_does_not_settle_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pairs, "SETTLING_MAX", 100)
    assert compare(Counters(500, -1), [Stretch([1], 1_000)]) == Result(None, compared=100, unsettled=1)


def test_states_are_equal_only_if_their_bits_are() -> None:
    for one, other in (
        (0.0, -0.0),
        (np.float32(0.0), np.float32(-0.0)),
        ([1, 2], [1, 3]),
        ({"a": 1.0}, {"a": 2.0}),
        ({1}, {2}),
    ):
        assert state_of(one) != state_of(other)
    assert state_of((np.float32("nan"), float("nan"), None)) == state_of((np.float32("nan"), float("nan"), None))

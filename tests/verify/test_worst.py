"""The search for the longest call."""

from __future__ import annotations

import numpy as np
import pytest

from codegen.verify.budgets.counting import Rows
from codegen.verify.budgets.worst import PARENTS, WINDOW, Figures, Search, Spread, described, spread_of


def drives(count: int, seed: int = 0) -> list[Rows]:
    generator = np.random.default_rng(seed)
    return [generator.uniform(-1.0, 1.0, (count, 4)).astype(np.float32) for _ in range(2)]


def hidden(rows: Rows) -> Figures:
    """Long where each of four inputs is near its own value: no draw has all of them, one after the other is found."""
    goal = np.array([0.3, -0.7, 0.1, 0.9])
    return {"instructions": 100 + 10 * (np.abs(rows - goal) < 0.05).sum(axis=1), "other": np.arange(len(rows))}


def test_the_search_puts_together_what_it_finds_apart() -> None:
    search = Search(hidden, "instructions")
    search.run(drives(2_000))
    assert search.spread("instructions", 1).largest < 140
    search.improve(12, np.random.default_rng(1))
    assert search.spread("instructions", 1).largest == 140
    assert search.largest("instructions")[1]["instructions"] == 140
    assert np.allclose(search.worst_input(), [0.3, -0.7, 0.1, 0.9], atol=0.05)


def test_what_is_kept_of_the_calls() -> None:
    search, made = Search(hidden, "instructions", "other"), drives(50)
    search.run(made)
    assert search.calls == 100
    found = search.longest()
    assert found.shape == (PARENTS, WINDOW, 4)
    # Half of the parents by each figure.
    assert np.array_equal(found[PARENTS // 2, -1], made[0][-1])
    row, figures = search.largest("other")
    assert np.array_equal(row, made[0][-1])
    assert figures == {"instructions": hidden(made[0])["instructions"][-1], "other": 49}
    spread = search.spread("other", 1)
    assert spread == Spread(0, 24.5, 49)
    assert spread.to_dict() == {"min": 0, "mean": 24.5, "max": 49}


def test_the_longest_are_put_into_other_states() -> None:
    """What is long only in a state that no drive is in."""

    def count(rows: Rows) -> Figures:
        return {"instructions": (100.0 + 10.0 * rows[:, 0] + np.where(rows[:, 1] > 5.0, 50.0, 0.0)).astype(np.int64)}

    def moved(rows: Rows) -> Rows:
        return np.column_stack([rows[:, 0], np.full(len(rows), 9.0), rows[:, 2:]]).astype(np.float32)

    search = Search(count, "instructions")
    search.run(drives(100))
    search.improve(1, np.random.default_rng(0), moved)
    assert search.spread("instructions", 1).largest >= 100 + 9 + 50


def test_the_same_seed_gives_the_same_calls() -> None:
    worst = []
    for _ in range(2):
        search = Search(hidden, "instructions")
        search.run(drives(200))
        search.improve(3, np.random.default_rng(7))
        worst.append(search.worst_input().tolist())
    assert worst[0] == worst[1]


def test_calls_that_do_not_count() -> None:
    assert spread_of(np.array([5, -1, 7]), np.array([-1, 6, 8])) == Spread(5, 7.0, 7)


@pytest.mark.parametrize(("value", "text"), [(np.nan, "nan"), (14.444444, "14.4444"), (-np.inf, "-inf")])
def test_inputs_in_words(value: float, text: str) -> None:
    assert described(np.array([value, 0.0], dtype=np.float32), ("speed", "inhibit")) == f"speed {text}, inhibit 0"

"""The search for the longest call."""

import numpy as np

from codegen.verify.budgets.counting import Rows
from codegen.verify.budgets.worst import PARENTS, WINDOW, Figures, Search, Spread, described, spread_of


def drives(count: int) -> list[Rows]:
    generator = np.random.default_rng(0)
    return [generator.uniform(-1.0, 1.0, (count, 4)).astype(np.float32) for _ in range(2)]


def hidden(rows: Rows) -> Figures:
    """Return long calls where each of four inputs is near its own value. No drawn row has all four."""
    goal = np.array([0.3, -0.7, 0.1, 0.9])
    return {"instructions": 100 + 10 * (np.abs(rows - goal) < 0.05).sum(axis=1), "other": np.arange(len(rows))}


def test_the_search_combines_what_it_finds_apart() -> None:
    search = Search(hidden, "instructions")
    search.run(drives(2_000))
    assert search.spread("instructions", 1).largest < 140
    search.improve(12, np.random.default_rng(1))
    assert search.largest("instructions")[1]["instructions"] == search.spread("instructions", 1).largest == 140
    assert np.allclose(search.worst_input(), [0.3, -0.7, 0.1, 0.9], atol=0.05)


def test_the_search_keeps_the_longest_calls_of_each_figure() -> None:
    search, made = Search(hidden, "instructions", "other"), drives(50)
    search.run(made)
    assert search.calls == 100
    found = search.longest()
    assert found.shape == (PARENTS, WINDOW, 4)
    assert np.array_equal(found[PARENTS // 2, -1], made[0][-1])  # half of the parents by each figure
    row, figures = search.largest("other")
    assert np.array_equal(row, made[0][-1])
    assert figures["other"] == 49
    assert search.spread("other", 1).to_dict() == {"min": 0, "mean": 24.5, "max": 49}


def test_the_longest_calls_are_repeated_in_other_states() -> None:
    """Some calls are long only in a state that no drive reaches."""

    def count(rows: Rows) -> Figures:
        return {"instructions": (100.0 + 10.0 * rows[:, 0] + np.where(rows[:, 1] > 5.0, 50.0, 0.0)).astype(np.int64)}

    def moved(rows: Rows) -> Rows:
        return np.column_stack([rows[:, 0], np.full(len(rows), 9.0), rows[:, 2:]]).astype(np.float32)

    search = Search(count, "instructions")
    search.run(drives(100))
    search.improve(1, np.random.default_rng(0), moved)
    assert search.spread("instructions", 1).largest >= 100 + 9 + 50


def test_calls_that_do_not_count_and_inputs_in_words() -> None:
    assert spread_of(np.array([5, -1, 7]), np.array([-1, 6, 8])) == Spread(5, 7.0, 7)
    row = np.array([np.nan, 14.444444, -np.inf, 0.0], dtype=np.float32)
    assert described(row, ("a", "b", "c", "inhibit")) == "a nan, b 14.4444, c -inf, inhibit 0"

"""The choice of lead and response gain from given figures."""

import numpy as np
import pytest

from codegen.design import lead
from codegen.design.lead import FIGURES, LEADS_S, RESPONSE_GAINS_S, _Search

OWN = {"overshoot": 1.0, "settling": 0.8, "overshoot at larger angles": 1.0, "settling at larger angles": 0.8, "rise": 0.3}
"""Figures of a configured car at its targets."""


def search(speeds: int = 1) -> _Search:
    """Return a search with relevant limits and number of speeds only: the configured car and one other."""
    limits = np.repeat([[3.0], [15.0]], speeds, axis=1)
    names = {"software": None, "schedule": None, "ahead": 0.06, "profile": None, "lanes": None}
    return _Search(**names, speeds=tuple(60.0 + 20.0 * k for k in range(speeds)), limits=limits)  # type: ignore[arg-type]


def figures(*rows: dict[str, float], other: float = 2.0) -> np.ndarray:
    """Return figures (n, 5, 2, 1): OWN with the rows' differences, and the overshoot of the other car."""
    result = np.zeros((len(rows), len(FIGURES), 2, 1))
    for k, row in enumerate(rows):
        result[k, :, 0, 0] = [{**OWN, **row}[name] for name in FIGURES]
        result[k, 0, 1, 0] = row.get("other", other)
    return result


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        pytest.param({"rise": 0.5}, {"rise": 0.2, "overshoot": 5.0}, id="the aim before the rise time"),
        pytest.param({"rise": 0.5, "overshoot": 5.9}, {"rise": 0.2, "overshoot": 6.4}, id="the limit before the rise time"),
        pytest.param(
            {"overshoot": 9.0, "overshoot at larger angles": 5.6},
            {"overshoot": 7.0, "overshoot at larger angles": 7.0},
            id="the larger angles before all",
        ),
        pytest.param({"rise": 0.5}, {"rise": 0.2, "other": 16.0}, id="the limit of other cars before the rise time"),
        pytest.param({"rise": 0.44}, {"rise": 0.4, "other": 14.0}, id="overshoot of other cars has its price"),
        pytest.param({"rise": 0.4}, {"rise": 0.3, "settling": np.inf, "overshoot": np.inf}, id="no spin"),
    ],
)
def test_priorities_of_the_choice(better: dict[str, float], worse: dict[str, float]) -> None:
    assert search().best(figures(worse, better)) == [1]
    assert search().best(figures(better, worse)) == [0]


def test_pairs_of_neighbouring_speeds_stay_near_each_other_unless_it_costs_more() -> None:
    """At the middle of three speeds a distant pair is slightly faster than the one next to the best of the others."""
    pairs = np.array([[(lead, gain)] * 3 for lead in LEADS_S[:2] for gain in RESPONSE_GAINS_S])
    near, far = 0, len(pairs) - 1
    found = np.repeat(figures(*[{"rise": 0.6}] * len(pairs)), 3, axis=-1)
    rise = found[:, FIGURES.index("rise"), 0]
    rise[near] = 0.3, 0.31, 0.3
    steps = 1 + len(RESPONSE_GAINS_S) - 1
    for gain, chosen in ((0.5, near), (1.5, far)):  # in units of the cost of moving there and back
        rise[far, 1] = 0.31 - gain * 2.0 * steps * lead.DISTANCE_PRICE_S
        assert search(3).smooth_best(pairs, found) == [near, chosen, near]
    assert search(3).best(found)[1] == far

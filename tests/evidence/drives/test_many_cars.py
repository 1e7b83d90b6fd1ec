"""Cars and scenarios that `make test` takes a part of: no warning for a plausible car, no event for a healthy one."""

import pytest

from hil_sim.scenarios import SCENARIOS
from tests.hil_sim.test_task_events import LAGS, check_healthy_car
from tests.judgement.test_plausibility import check_plausible_car


@pytest.mark.long
@pytest.mark.parametrize("number", range(10, 40))
def test_a_plausible_car_has_no_warning(number: int) -> None:
    check_plausible_car(number)


@pytest.mark.long
@pytest.mark.parametrize("half", [0, 1])
def test_a_healthy_car_shows_none(half: int) -> None:
    check_healthy_car(LAGS[half], list(SCENARIOS)[1 - half :: 2])

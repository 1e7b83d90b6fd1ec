"""The family: all combinations, each once, the configured car among them."""

import itertools

import pytest

from codegen.config import Config
from codegen.design.family import MEMBERS_MAX, Member, members, nominal
from codegen.errors import ConfigError

from .conftest import small_config


def test_the_default_family_is_all_combinations() -> None:
    expected = set(itertools.product((0.02, 0.05, 0.1), (0.8, 1.0, 1.2), (0.8, 1.0, 1.15), (0.8, 1.0, 1.15), (0.0, 0.3, 0.6)))
    family = members(Config())
    assert len(family) == len(set(family)) == len(expected) == 243
    found = [
        (m.actuator_lag, m.mass_factor, m.front_stiffness_factor, m.rear_stiffness_factor, m.relaxation_length) for m in family
    ]
    # The factors come from percents, with one rounding.
    assert sorted(found) == [pytest.approx(values, rel=1e-15) for values in sorted(expected)]
    assert family.count(nominal(Config())) == 1


def test_the_configured_car_is_a_member_where_no_combination_gives_it() -> None:
    config = small_config({"plant": {"relaxation_length_m": 0.25}}, mass_percent=[0.0, 0.0])
    own = nominal(config)
    assert own == Member(actuator_lag=0.05, relaxation_length=0.25)
    assert len(members(config)) == 9 and members(config).count(own) == 1


def test_empty_and_too_long_lists_are_refused() -> None:
    for key in ("actuator_lag_s", "mass_percent", "stiffness_percent", "relaxation_length_m"):
        with pytest.raises(ConfigError, match=rf"^tuning\.{key}: an empty list; list at least one"):
            members(small_config(**{key: []}))
    # A million combinations of each stiffness: made before the check, they would fill the memory.
    with pytest.raises(ConfigError, match=f"at most {MEMBERS_MAX} are taken; list fewer"):
        members(small_config(stiffness_percent=[0.01 * k for k in range(1000)]))

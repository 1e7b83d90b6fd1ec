"""Which compiled builds a process keeps, and that a run does not depend on what else is driven."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from codegen.sweep import chunk as chunks
from codegen.sweep.chunk import replay, software
from codegen.sweep.plan import Plan
from hil_sim.suite import plants


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What was compiled: nothing, but noted."""
    found: list[Any] = []

    def note(*given: Any, **options: Any) -> object:
        found.append(given)
        return object()

    monkeypatch.setattr(chunks, "_COMPILED", {})
    monkeypatch.setattr(chunks, "compile_batch", note)
    return found


def test_one_build_with_another_car_is_compiled_anew(plan: Plan, compiled: list[Any]) -> None:
    pi = plan.controllers[0]
    first = software(plan, pi)
    assert software(plan, pi) is first
    other = replace(plan, config=plants.actuator_lag(0.1)(plan.config))
    assert software(other, pi) is not first
    assert software(plan, pi) is first
    assert [given[2] for given in compiled] == [plan.config, other.config]


def test_only_those_used_last_are_kept(plan: Plan, compiled: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chunks, "COMPILED_MAX", 2)
    one, two, three = (replace(plan.controllers[0], digest=digest) for digest in ("1", "2", "3"))
    kept = software(plan, one)
    software(plan, two)
    assert software(plan, one) is kept
    software(plan, three)
    assert len(chunks._COMPILED) == 2
    assert software(plan, one) is kept
    assert len(compiled) == 3
    software(plan, two)
    assert len(compiled) == 4


def test_another_controller_in_the_spec_leaves_cars_roads_and_noise_as_they_were(plan: Plan) -> None:
    fewer = replace(plan, controllers=plan.controllers[:1])
    assert fewer.samples_per_chunk > plan.samples_per_chunk
    sample = plan.samples_per_chunk + 3
    one, other = replay(plan, 6 * sample).row, replay(fewer, 2 * sample).row
    assert {**one, "run": 0.0} == {**other, "run": 0.0}

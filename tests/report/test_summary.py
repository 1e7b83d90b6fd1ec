"""The figures of a map and of its stack, against the arrays."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from codegen import config as configuration
from codegen.refmap.map import ReferenceMap
from codegen.refmap.stack import solve_stack
from codegen.report.summary import LayerSummary, map_summary

CONFIG = configuration.parse({"grid": {"speed_points": 11, "front_angle_points": 10}}, "configuration of the test")


@pytest.fixture(scope="module")
def stacked() -> ReferenceMap:
    return solve_stack(CONFIG, "4ws-2", (0.3, 0.5, 0.9))


def largest(reference_map: ReferenceMap) -> float:
    """m/s^2, cell by cell."""
    rows = zip(reference_map.speed, reference_map.yaw_rate, strict=True)
    return max(float(speed * yaw_rate) for speed, row in rows for yaw_rate in row if not np.isnan(yaw_rate))


def test_stack_is_summed_up_layer_by_layer(stacked: ReferenceMap) -> None:
    summary = map_summary(stacked)
    assert summary.friction == 0.9
    assert summary.stack == tuple(
        LayerSummary(layer.friction, int(np.isfinite(layer.map.yaw_rate).sum()), largest(layer.map)) for layer in stacked.layers
    )
    assert summary.lateral_acceleration_max_m_s2 == largest(stacked)
    assert summary.headline.endswith("; a stack with friction 0.3, 0.5")


def test_rows_rise_to_the_map_itself(stacked: ReferenceMap) -> None:
    rows = map_summary(stacked).stack_rows
    assert [row[0] for row in rows] == ["0.3", "0.5", "0.9 (the map itself)"]
    maps = [*(layer.map for layer in stacked.layers), stacked]
    assert [int(row[1]) for row in rows] == [int(one.feasible.sum()) for one in maps]
    assert rows[-1][2] == f"{100.0 * stacked.feasible.mean():.1f} %"
    assert [float(row[3]) for row in rows] == pytest.approx([largest(one) for one in maps], rel=1e-3)  # four digits are shown


def test_map_without_a_stack_is_told_as_ever(stacked: ReferenceMap) -> None:
    summary = map_summary(replace(stacked, layers=()))
    assert (summary.stack, summary.stack_rows) == ((), [])
    assert "stack" not in summary.headline
    assert replace(map_summary(stacked), stack=()) == summary


def test_bare_map_knows_no_friction_of_its_own(stacked: ReferenceMap) -> None:
    summary = map_summary(replace(stacked, config=None, case=None, meta={}))
    assert summary.friction is None
    assert summary.stack_rows[-1][0] == "the map itself"


def test_json_has_the_stack(stacked: ReferenceMap) -> None:
    data = json.loads(json.dumps(map_summary(stacked).to_dict(), allow_nan=False))
    assert [layer["friction"] for layer in data["stack"]] == [0.3, 0.5]
    assert set(data["stack"][0]) == {"friction", "feasible_cells", "lateral_acceleration_max_m_s2"}

"""The committed maps and builds: solved and built again, they are what stands in `generated/`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from codegen.config import preset
from codegen.design.tune import tune
from codegen.emit.folder import differences, verify_hashes
from codegen.emit.from_files import prepare
from codegen.refmap import map as npz
from tests import shared
from tests.refmap.cars import PAPER, paper_map

GENERATED = Path(__file__).resolve().parents[2] / "generated"

TOLERANCE = 1e-9
"""rad/s and rad: far above what another processor or NumPy changes (1e-15), far below any difference that matters."""

SCHEDULE_TOLERANCE = 2e-3
"""Relative: a gain has four digits, and another machine's linear algebra may change the last one."""


@pytest.mark.parametrize("name", ["4ws2", "4ws2-tracking"])
def test_a_committed_map_is_what_its_configuration_gives(name: str) -> None:
    path = GENERATED / f"{name}.npz"
    committed, fresh = npz.load(path), paper_map()
    for array in ("speed", "front_angle", "yaw_rate", "sideslip", "rear_angle"):  # NaN equals NaN alone
        np.testing.assert_allclose(getattr(committed, array), getattr(fresh, array), rtol=0.0, atol=TOLERANCE)
    np.testing.assert_array_equal(committed.feasible, fresh.feasible)
    np.testing.assert_array_equal(committed.active, fresh.active)
    assert committed.config is not None and committed.layers == ()
    tracking = committed.config.controller.tracking.model_copy(update={"schedule": None})
    controller = committed.config.controller.model_copy(update={"tracking": tracking})
    expected = PAPER if name == "4ws2" else preset("recommended")
    assert committed.config.model_copy(update={"controller": controller}) == expected
    assert (committed.case, committed.meta["method"]) == ("4ws-2", "exact")
    assert committed.meta["configuration"] == committed.config.model_dump(mode="json")
    assert npz.to_bytes(committed) == path.read_bytes()


def test_the_committed_schedule_is_what_tune_designs() -> None:
    config = npz.load(GENERATED / "4ws2-tracking.npz").config
    assert config is not None and config.controller.tracking.schedule is not None
    committed = config.controller.tracking.schedule.model_dump()
    fresh = shared.once("schedule of the recommended preset", lambda: tune(preset("recommended"))).model_dump()
    for key in ("speed_km_h", "proportional_gain_s", "integral_gain"):
        np.testing.assert_allclose(committed[key], fresh[key], rtol=SCHEDULE_TOLERANCE)


@pytest.mark.parametrize("name", ["4ws2", "4ws2-tracking"])
def test_building_a_committed_map_gives_the_committed_bytes(name: str) -> None:
    prepared = prepare(GENERATED / f"{name}.npz")
    assert prepared.target == Path("generated") / name
    assert differences(prepared.folder, GENERATED / name) == []
    assert verify_hashes(GENERATED / name) == []

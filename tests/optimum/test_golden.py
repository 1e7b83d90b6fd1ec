"""The committed maps and builds: solving and building them again gives the content of `generated/`."""

from pathlib import Path

import numpy as np
import pytest

from codegen.configuration import preset
from codegen.emit.folder import differences, verify_hashes
from codegen.emit.from_files import prepare
from codegen.map_file import map as npz
from codegen.optimum.solve import solve_case
from tests.optimum.cars import PAPER

GENERATED = Path(__file__).resolve().parents[2] / "generated"

TOLERANCE = 1e-9
"""rad/s and rad: far above the effect of another processor or NumPy (1e-15), far below any relevant difference."""


@pytest.mark.parametrize("name", ["4ws2-paper", "4ws2"])
def test_a_committed_map_follows_from_its_configuration(name: str) -> None:
    path = GENERATED / f"{name}.npz"
    expected = PAPER if name == "4ws2-paper" else preset("recommended")
    committed, fresh = npz.load(path), solve_case(expected, "4ws-2")
    for array in ("speed", "front_angle", "yaw_rate", "sideslip", "rear_angle"):  # NaN equals only NaN
        np.testing.assert_allclose(getattr(committed, array), getattr(fresh, array), rtol=0.0, atol=TOLERANCE)
    np.testing.assert_array_equal(committed.feasible, fresh.feasible)
    np.testing.assert_array_equal(committed.active, fresh.active)
    assert committed.config is not None and committed.layers == ()
    own = expected.controller.tracking
    names = ("schedule", "lead_max_deg", "response_ahead_s", "trim_max_percent", "trim_time_s")
    tuned = {name: getattr(own, name) for name in names}
    tracking = committed.config.controller.tracking.model_copy(update=tuned)
    update = {"tracking": tracking, "fail_safe": expected.controller.fail_safe}  # `codegen tune` determines these
    controller = committed.config.controller.model_copy(update=update)
    assert committed.config.model_copy(update={"controller": controller}) == expected
    if name == "4ws2-paper":
        assert committed.meta == fresh.meta | {"tools": committed.meta["tools"]}
    assert npz.to_bytes(committed) == path.read_bytes()


@pytest.mark.parametrize("name", ["4ws2-paper", "4ws2"])
def test_building_a_committed_map_gives_the_committed_bytes(name: str) -> None:
    prepared = prepare(GENERATED / f"{name}.npz")
    assert differences(prepared.folder, GENERATED / name) == []
    assert verify_hashes(GENERATED / name) == []

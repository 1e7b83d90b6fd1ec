"""The kinds of controller: each is complete, accepts every valid configuration, and reports missing settings."""

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.configuration import Config, Kind
from codegen.emit.controller_view import ControllerView, parameters_by_path
from codegen.emit.folder import Folder
from codegen.emit.laws import LAWS, law_of, schedule_of
from codegen.emit.text import Precision
from codegen.errors import BuildError
from codegen.optimum.solve import solve_case
from codegen.sil.toolchain import compiler_command
from codegen.units import UNITS
from tests import builds
from tests.emit.rendered import laid_out
from tests.optimum.cars import PAPER, changed


def tracking(**keys: Any) -> Config:
    """Return the configuration of kind "tracking" with some keys of [controller.tracking] changed."""
    data = builds.TRACKING_CONFIG.model_dump()
    data["controller"]["tracking"].update(keys)
    return Config.model_validate(data)


def selftest_passes(files: Folder, at: Path) -> bool:
    """Return whether the self-test of a build passes, compiled without optimisation; it checks each parameter's range."""
    folder = laid_out(files, at / "build")
    (at / "main.c").write_text('#include "ars_controller.h"\nint main(void) { return ars_selftest() ? 0 : 1; }\n')
    command = [*compiler_command(), "-std=c99", "-ffp-contract=off", f"-I{folder / 'include'}", str(at / "main.c")]
    command += [*map(str, (folder / "src").iterdir()), "-o", str(at / "program"), "-lm"]
    subprocess.run(command, check=True)
    return subprocess.run([at / "program"], check=False).returncode == 0


LIMIT_VALUES: dict[str, tuple[float, float]] = {
    "lead_s": (-0.2, 0.2),
    "lead_max_deg": (0.0, 10.0),
    "response_ahead_s": (0.0, 1.0),
    "yaw_increasing_max_deg": (0.0, 20.0),
    "yaw_increasing_wide_deg": (0.0, 20.0),
    "trim_max_percent": (0.0, 20.0),
    "trim_time_s": (0.05, 60.0),
    "grip_shortfall_m_s2": (0.1, 20.0),
    "grip_loss_time_s": (0.02, 10.0),
    "grip_recovery_m_s3": (0.01, 100.0),
    "grip_recovery_idle_m_s3": (0.01, 100.0),
}


@pytest.mark.parametrize(
    ("end", "precision", "limits"),
    [
        (0, "single", ([1.0, 1.5, 2.0], [0.0, 0.0, 0.0], 1.0, 0.05)),
        (1, "single", ([60.0, 499.0, 500.0], [20.0, 20.0, 20.0], 500.0, 20.0)),
        (1, "double", ([60.0, 120.0], "off", "off", 1.0)),
    ],
)
def test_the_limits_of_a_configuration_are_valid_parameters(
    tmp_path: Path, end: int, precision: Precision, limits: tuple[Any, ...]
) -> None:
    """All limits are used together: neither unit conversion nor rounding to the target's precision may leave the range."""
    speeds = ([1.0, 1.1], [400.0, 500.0])[end]
    schedule = {"speed_km_h": speeds, "proportional_gain_s": [(0.0, 2.0)[end]] * 2, "integral_gain": [(0.01, 20.0)[end]] * 2}
    data = tracking(schedule=schedule, **{name: ends[end] for name, ends in LIMIT_VALUES.items()}).model_dump()
    data["controller"] |= {"rear_angle_error_max_deg": (0.1, 20.0)[end], "friction_min": (0.02, 0.5)[end]}
    keys = ("opposite_phase_speed_km_h", "opposite_phase_max_deg", "rear_rate_max_deg_s", "in_phase_from_front_angle_deg")
    data["limiter"] = dict(zip(keys, limits, strict=True))
    config = Config.model_validate(data)
    assert selftest_passes(builds.render(builds.paper_map(), config, precision), tmp_path)


def test_tracking_without_a_schedule_is_refused_with_the_remedy() -> None:
    config = tracking(schedule=None)
    for call in (law_of, schedule_of, lambda bare: builds.render(builds.paper_map(), bare)):
        with pytest.raises(BuildError) as caught:
            call(config)
        assert caught.value.where == "controller.tracking.schedule"
        assert "tune the map" in str(caught.value.remedy)


def test_the_gains_for_the_margins_are_those_of_the_c() -> None:
    """They are interpolated between the breakpoints and held beyond them, like the generated law."""
    speed = np.array([1.0, 7.0, 9.0, 20.0, 33.0, 60.0])
    gains = LAWS["tracking"].gains(builds.TRACKING_CONFIG)
    assert gains is not None
    proportional, integral = gains(speed)
    schedule = builds.SCHEDULE
    assert proportional == pytest.approx(np.interp(speed * 3.6, schedule["speed_km_h"], schedule["proportional_gain_s"]))
    assert integral == pytest.approx(np.interp(speed * 3.6, schedule["speed_km_h"], schedule["integral_gain"]))
    gains = LAWS["pi"].gains(builds.CONFIG)
    assert gains is not None
    assert [values.tolist() for values in gains(speed[:2])] == [[0.01, 0.01], [1.0, 1.0]]
    for kind in ("feedforward", "proportional"):
        assert LAWS[kind].gains(builds.CONFIGS[kind]) is None


@pytest.mark.parametrize(
    ("controller", "words"),
    [
        (
            {"enable_speed_km_h": 45.1},
            r"controller\.enable_speed_km_h: 45\.1 km/h is more than half of the map's last speed, 90 km/h",
        ),
        (
            {"inputs": {"speed_max_km_h": 89.9}},
            r"controller\.inputs\.speed_max_km_h: 89\.9 km/h is below the map's last speed, 90 km/h",
        ),
        (
            {"inputs": {"yaw_rate_max_deg_s": 25.0}},
            r"controller\.inputs\.yaw_rate_max_deg_s: 25 deg/s is below the map's largest",
        ),
    ],
)
def test_a_controller_that_would_reject_the_map_as_a_fault_is_refused(controller: dict[str, Any], words: str) -> None:
    config = changed(PAPER, grid={"speed_max_km_h": 90.0}, controller=controller)
    with pytest.raises(BuildError, match=words):
        builds.render(solve_case(config, "4ws-2"), config)


@pytest.mark.parametrize("kind", LAWS)
def test_every_meaning_is_short_and_has_no_unit(kind: Kind) -> None:
    config = builds.CONFIGS[kind]
    view = ControllerView(config, ())
    members = [*parameters_by_path(config).values(), *view.state, *view.law_state, *view.grip_state]
    for each in members:
        assert 0 < len(each.meaning.split()) <= 12, each.meaning
        assert not any(each.meaning.startswith((f"{unit},", f"{unit} ")) for unit in UNITS if unit), each.meaning

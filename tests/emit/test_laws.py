"""The kinds of controller: each is complete, accepts what a configuration may hold, and reports what it lacks."""

import re
import subprocess
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from codegen.config import Config, Kind
from codegen.emit.folder import Folder
from codegen.emit.laws import LAWS, law_of, schedule_of
from codegen.emit.limiter_view import limiter_parameters
from codegen.emit.parameters import Parameter
from codegen.emit.text import Precision
from codegen.errors import BuildError
from codegen.sil.toolchain import compiler_command
from tests import builds
from tests.emit.rendered import KINDS, laid_out, rendered


def changed(kind: Kind, **controller: Any) -> Config:
    """A configuration of a kind with some keys of its controller changed."""
    data = builds.CONFIGS[kind].model_dump()
    data["controller"].update(controller)
    return Config.model_validate(data)


def tracking(**keys: Any) -> Config:
    """The same with keys of [controller.tracking]."""
    return changed("tracking", tracking={**builds.TRACKING_CONFIG.controller.tracking.model_dump(), **keys})


def numbers(parameter: Parameter) -> tuple[float, ...]:
    """Its values, one or many."""
    return parameter.value if isinstance(parameter.value, tuple) else (parameter.value,)


def test_every_kind_that_a_configuration_may_name_is_there_once() -> None:
    assert set(LAWS) == set(KINDS) == set(get_args(Kind))
    assert all(law.kind == kind for kind, law in LAWS.items())
    assert len({law.title for law in LAWS.values()}) == len(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_a_build_has_just_the_units_and_state_that_its_law_uses(kind: Kind) -> None:
    law, files = LAWS[kind], rendered(kind).files
    assert ("src/ars_reference_model.c" in files) == ("include/ars_reference_model.h" in files) == law.uses_reference_model
    assert ("ars_map_reference(" in files["include/ars_map.h"].decode("ascii")) == law.uses_rear_angle
    controller = files["src/ars_controller.c"].decode("ascii")
    assert ("ars_map_reference(" in controller) == law.uses_rear_angle
    assert ("ars_reference_model_step(" in controller) == law.uses_reference_model
    assert f'Control law "{kind}"' in controller
    header = files["include/ars_controller.h"].decode("ascii")
    state = header[: header.index("} ars_controller_t;")].rpartition("typedef struct {")[2]
    fields = set(re.findall(r"(\w+);", state))
    assert {*(field.name for field in law.state), "limiter", "status", "rear_angle"} <= fields
    assert ("model" in fields) == law.uses_reference_model


def test_the_step_interface_is_that_of_every_kind() -> None:
    def interface(kind: Kind) -> str:
        header = rendered(kind).files["include/ars_controller.h"].decode("ascii")
        first, rest = header.split("/* What the last step did.")[1].split("/* Everything that calibration may change", 1)
        functions = rest.split("/* The parameters that this build was made with.")[1]
        enums = re.sub(r"enum \{ ARS_SCHEDULE_POINTS = \d+ \};\s*", "", first)
        return enums.strip() + re.sub(r"about\s+\*\s+\d+ table look-ups", "about so many table look-ups", functions)

    assert len({interface(kind) for kind in KINDS}) == 1


def selftest_passes(files: Folder, at: Path) -> bool:
    """Whether the self-test of a build, compiled without optimisation, passes: it checks each parameter's range."""
    folder = laid_out(files, at / "build")
    (at / "main.c").write_text('#include "ars_controller.h"\nint main(void) { return ars_selftest() ? 0 : 1; }\n')
    command = [*compiler_command(), "-std=c99", "-ffp-contract=off", f"-I{folder / 'include'}", str(at / "main.c")]
    command += [*map(str, (folder / "src").iterdir()), "-o", str(at / "program"), "-lm"]
    subprocess.run(command, check=True)
    return subprocess.run([at / "program"], check=False).returncode == 0


ENDS: dict[str, tuple[float, float]] = {
    "lead_s": (0.0, 0.2),
    "lead_max_deg": (0.0, 10.0),
    "yaw_increasing_max_deg": (0.0, 20.0),
    "trim_max_percent": (0.0, 20.0),
    "trim_time_s": (0.05, 60.0),
    "grip_shortfall_m_s2": (0.1, 20.0),
    "grip_loss_time_s": (0.02, 10.0),
    "grip_recovery_m_s3": (0.01, 100.0),
}


@pytest.mark.parametrize(
    ("end", "precision", "limits"),
    [
        (0, "single", ([1.0, 1.5, 2.0], [0.0, 0.0, 0.0], 1.0, 0.05)),
        (1, "single", ([60.0, 499.0, 500.0], [20.0, 20.0, 20.0], 500.0, 20.0)),
        (1, "double", ([60.0, 120.0], "off", "off", 1.0)),
    ],
)
def test_the_ends_of_what_a_configuration_takes_are_valid_parameters(
    tmp_path: Path, end: int, precision: Precision, limits: tuple[Any, ...]
) -> None:
    """All at one end together: neither the units' factors nor the rounding to the target may lead outside."""
    speeds = ([1.0, 1.1], [400.0, 500.0])[end]
    schedule = {"speed_km_h": speeds, "proportional_gain_s": [(0.0, 10.0)[end]] * 2, "integral_gain": [(0.0, 100.0)[end]] * 2}
    data = tracking(schedule=schedule, **{name: ends[end] for name, ends in ENDS.items()}).model_dump()
    data["controller"] |= {"rear_angle_error_max_deg": (0.1, 20.0)[end], "friction_min": (0.02, 1.0)[end]}
    keys = ("opposite_phase_speed_km_h", "opposite_phase_max_deg", "rear_rate_max_deg_s", "in_phase_from_front_angle_deg")
    data["limiter"] = dict(zip(keys, limits, strict=True))
    config = Config.model_validate(data)
    assert selftest_passes(builds.render(builds.paper_map(), config, precision), tmp_path)
    limiter = {parameter.name: parameter for parameter in limiter_parameters(config)}
    assert max(numbers(limiter["opposite_phase_max"])) <= max(numbers(limiter["rear_angle_max"]))


def test_tracking_without_a_schedule_is_refused_with_the_remedy() -> None:
    config = tracking(schedule=None)
    for call in (law_of, schedule_of, lambda bare: builds.render(builds.paper_map(), bare)):
        with pytest.raises(BuildError) as caught:
            call(config)
        assert caught.value.where == "controller.tracking.schedule"
        assert "codegen tune" in str(caught.value.remedy)
    for kind in KINDS:
        if kind != "tracking":
            law_of(changed(kind, tracking={**builds.TRACKING_CONFIG.controller.tracking.model_dump(), "schedule": None}))


def test_the_gains_for_the_margins_are_those_of_the_c() -> None:
    """Interpolated between the breakpoints and held beyond them, as the generated law does."""
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

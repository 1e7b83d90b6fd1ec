"""The kinds of controller: each is whole, takes what a configuration may hold, and says what it lacks."""

from __future__ import annotations

import math
import re
from typing import Any, get_args

import numpy as np
import pytest

from codegen.config import Config, Kind
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.laws import LAWS, law_of, schedule_of
from codegen.emit.limiter_view import limiter_view
from codegen.emit.parameters import Parameter
from codegen.errors import BuildError
from codegen.vehicle.single_track import SingleTrack
from tests import builds

KINDS: tuple[Kind, ...] = get_args(Kind)


def changed(kind: Kind, **controller: Any) -> Config:
    """A configuration of a kind with some keys of its controller changed."""
    data = builds.CONFIGS[kind].model_dump()
    data["controller"].update(controller)
    return Config.model_validate(data)


def tracking(**keys: Any) -> Config:
    """The same with keys of [controller.tracking]."""
    return changed("tracking", tracking={**builds.TRACKING_CONFIG.controller.tracking.model_dump(), **keys})


def by_name(config: Config) -> dict[str, Parameter]:
    """The law's own parameters."""
    return {parameter.name: parameter for parameter in law_of(config).parameters(config)}


def numbers(parameter: Parameter) -> tuple[float, ...]:
    """Its values, one or many."""
    return parameter.value if isinstance(parameter.value, tuple) else (parameter.value,)


def test_every_kind_that_a_configuration_may_name_is_there_once() -> None:
    assert set(LAWS) == set(KINDS)
    assert all(law.kind == kind for kind, law in LAWS.items())
    assert len({law.title for law in LAWS.values()}) == len(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_each_has_its_template_with_both_functions(kind: Kind) -> None:
    text = builds.of_kind(kind).folder.files["src/ars_controller.c"].decode("ascii")
    for function in ("void law_init", "bool law_step"):
        assert len(re.findall(rf"^ARS_SECTION_CODE static {function}\(", text, flags=re.MULTILINE)) == 1
    assert f'Control law "{kind}"' in text


@pytest.mark.parametrize("kind", KINDS)
def test_a_build_has_just_the_units_that_its_law_uses(kind: Kind) -> None:
    law, files = LAWS[kind], builds.of_kind(kind).folder.files
    assert ("src/ars_reference_model.c" in files) == ("include/ars_reference_model.h" in files) == law.uses_reference_model
    assert ("ars_map_reference(" in files["include/ars_map.h"].decode("ascii")) == law.uses_rear_angle
    assert "src/ars_limiter.c" in files
    controller = files["src/ars_controller.c"].decode("ascii")
    assert ("ars_map_reference(" in controller) == law.uses_rear_angle
    assert ("ars_reference_model_step(" in controller) == law.uses_reference_model


@pytest.mark.parametrize("kind", KINDS)
def test_the_step_interface_is_that_of_every_kind(kind: Kind) -> None:
    def interface(which: Kind) -> str:
        header = builds.of_kind(which).folder.files["include/ars_controller.h"].decode("ascii")
        start, end = (
            header.index("/* What the last step did."),
            header.index("/* Everything that calibration may change beside the map."),
        )
        enums = re.sub(r"enum \{ ARS_SCHEDULE_POINTS = \d+ \};\s*", "", header[start:end])
        functions = header[header.index("/* The parameters that this build was made with.") :]
        return enums.strip() + re.sub(r"about\s+\*\s+\d+ table look-ups", "about so many table look-ups", functions)

    assert interface(kind) == interface("pi")


@pytest.mark.parametrize("kind", KINDS)
def test_every_field_of_the_state_is_in_the_c(kind: Kind) -> None:
    software = builds.of_kind(kind).software
    fields = set(dir(software.new("controller")))
    assert {field.name for field in LAWS[kind].state} <= fields
    assert ("model" in fields) == LAWS[kind].uses_reference_model
    assert {"limiter", "status", "rear_angle"} <= fields


@pytest.mark.parametrize("kind", KINDS)
def test_every_default_is_inside_its_range_in_both_precisions(kind: Kind) -> None:
    for precision in builds.PRECISIONS:
        assert builds.of_kind(kind, precision).software.selftest()
    for parameter in by_name(builds.CONFIGS[kind]).values():
        if parameter.low is not None and parameter.high is not None:
            assert all(parameter.low <= value <= parameter.high for value in numbers(parameter)), parameter.name


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


@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize("precision", ["single", "double"])
def test_the_ends_of_what_a_configuration_takes_are_valid_parameters(end: int, precision: Any) -> None:
    """All at one end together: neither the units' factors nor the rounding to the target may lead outside."""
    speeds = ([1.0, 1.1], [400.0, 500.0])[end]
    schedule = {"speed_km_h": speeds, "proportional_gain_s": [(0.0, 10.0)[end]] * 2, "integral_gain": [(0.0, 100.0)[end]] * 2}
    config = tracking(schedule=schedule, **{name: ends[end] for name, ends in ENDS.items()})
    config = config.model_copy(
        update={
            "controller": config.controller.model_copy(
                update={"rear_angle_error_max_deg": (0.1, 20.0)[end], "friction_min": (0.02, 1.0)[end]}
            )
        }
    )
    assert builds.make(builds.paper_map(), config, precision).software.selftest()


def test_the_limiter_takes_the_ends_of_its_configuration() -> None:
    for speeds, angles, rate, free in (
        ([1.0, 1.5, 2.0], [0.0, 0.0, 0.0], 1.0, 0.05),
        ([60.0, 499.0, 500.0], [20.0, 20.0, 20.0], 500.0, 20.0),
        ([60.0, 120.0], "off", "off", 1.0),
    ):
        data = builds.FEEDFORWARD_CONFIG.model_dump()
        data["limiter"] = {
            "rear_rate_max_deg_s": rate,
            "opposite_phase_speed_km_h": speeds,
            "opposite_phase_max_deg": angles,
            "in_phase_from_front_angle_deg": free,
        }
        config = Config.model_validate(data)
        assert limiter_view(config, "ars", "single", "float").points == len(speeds)
        built = builds.make(builds.paper_map(), config)
        assert built.software.selftest()
        parameters = built.software.parameters()
        assert max(parameters.limiter.opposite_phase_max) <= parameters.limiter.rear_angle_max


def test_tracking_without_a_schedule_is_told_with_the_remedy() -> None:
    config = tracking(schedule=None)
    for ask in (
        law_of,
        schedule_of,
        lambda bare: build(builds.paper_map(), bare, BuildOptions("x"), BuildInputs("x", "0", "preset")),
    ):
        with pytest.raises(BuildError) as caught:
            ask(config)
        assert caught.value.where == "controller.tracking.schedule"
        assert "codegen tune" in str(caught.value.remedy)
    for kind in KINDS:
        if kind != "tracking":
            law_of(changed(kind, tracking={**builds.TRACKING_CONFIG.controller.tracking.model_dump(), "schedule": None}))


def test_parameters_are_the_configuration_s_in_si_units() -> None:
    config = tracking(lead_s=0.03, lead_max_deg=2.0, trim_max_percent=3.0, trim_time_s=4.0, grip_loss_time_s=0.5)
    found = by_name(config)
    assert found["lead_time"].value == 0.03
    assert found["lead_angle_max"].value == pytest.approx(math.radians(2.0))
    assert found["trim_share"].value == pytest.approx(0.03)
    assert found["trim_rate"].value == pytest.approx(0.25)
    assert found["grip_loss_rate"].value == pytest.approx(2.0)
    assert found["yaw_increasing_max"].value == pytest.approx(math.radians(0.5))
    assert numbers(found["schedule_speed"]) == pytest.approx([speed / 3.6 for speed in builds.SCHEDULE["speed_km_h"]])
    assert list(numbers(found["proportional_gain"])) == builds.SCHEDULE["proportional_gain_s"]
    assert list(numbers(found["integral_gain"])) == builds.SCHEDULE["integral_gain"]
    pi = by_name(changed("pi", proportional_gain_s=0.02, integral_gain=3.0))
    assert (pi["proportional_gain"].value, pi["integral_gain"].value) == (0.02, 3.0)
    car = SingleTrack.from_config(builds.CONFIG)
    proportional = by_name(builds.CONFIGS["proportional"])
    assert proportional["rear_arm"].value == car.rear_arm
    assert proportional["understeer_coefficient"].value == car.understeer_coefficient


def test_arrays_have_the_size_that_the_c_knows() -> None:
    for kind in KINDS:
        config = builds.CONFIGS[kind]
        sizes = dict(LAWS[kind].points(config, "ars"))
        arrays = [parameter for parameter in by_name(config).values() if isinstance(parameter.value, tuple)]
        assert bool(arrays) == bool(sizes)
        for parameter in arrays:
            assert sizes[parameter.points.format(PREFIX="ARS")] == len(numbers(parameter))
        assert all("points" not in parameter.points for parameter in arrays)


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


@pytest.mark.parametrize("prefix", ["ars", "axle2"])
def test_no_name_of_another_prefix_is_left(prefix: str) -> None:
    folder = build(
        builds.paper_map(), builds.TRACKING_CONFIG, BuildOptions("x", prefix), BuildInputs("x.npz", "0" * 64, "preset")
    )
    other = {"ars": "axle2", "axle2": "ars"}[prefix]
    for path, content in folder.files.items():
        if path.startswith(("include/", "src/")):
            assert not re.search(rf"\b{other}_|\b{other.upper()}_", content.decode("ascii")), path

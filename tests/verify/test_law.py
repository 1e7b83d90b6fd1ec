"""The control law: the C of every kind is its second implementation, and what is planted in it is found and told."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import re

import numpy as np
import pytest

from codegen import config as configuration
from codegen.config import Kind
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder
from codegen.refmap.place import Request
from codegen.refmap.solve import solve_case
from codegen.sil.software import Command, Measurement, Status
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.drives import recorded
from codegen.verify.law import check as law
from codegen.verify.law import controller, kinds, parameters
from codegen.verify.packages import MissingTool
from tests.verify import builds, planted

PI = builds.made("pi")
TRACKING = builds.made("tracking")


FEW = law.Size(drive=60, course=300, sets=3, cycles=200)
"""Enough for what is planted here; what is right is driven as much as `codegen verify --quick` does."""


def checked(subject: Subject) -> Outcome:
    return law.check(subject, Effort(quick=True))


@functools.cache
def clean() -> Outcome:
    """Of the PI."""
    return checked(planted.subject_of(PI))


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(law, "SIZE_QUICK", FEW)


def changed(folder: Folder, name: str, old: str, new: str) -> Subject:
    """The build with one place of src/NAME.c changed."""
    return Subject("planted", builds.with_text(folder, f"src/{name}.c", old, new), folder.manifest)


# --- what is right -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", builds.KINDS)
def test_every_kind_is_its_law(kind: Kind) -> None:
    found = clean() if kind == "pi" else checked(planted.subject_of(builds.made(kind)))
    assert (found.findings, found.verdict) == ((), Verdict.PASSED)
    assert found.limits == law.LIMITS, "every status is reached, and every parameter has other values than its default"
    assert min(found.figures["statuses"].values()) > 0
    assert set(found.figures["statuses"]) == {status.name for status in Status}
    assert found.figures["parameter_sets"] == law.SIZE_QUICK.sets
    assert found.figures["task_cycles"] > law.SIZE_QUICK.cycles + 3 * law.SIZE_QUICK.course, "and a whole scenario"
    assert found.figures["samples"] == sum(found.figures["statuses"].values())


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("precision", ["single", "double"])
def test_so_it_is_on_uneven_axes_for_several_frictions(precision: builds.Precision) -> None:
    found = checked(planted.subject_of(builds.made("tracking", "uneven", layers=True, precision=precision)))
    assert (found.findings, found.verdict) == ((), Verdict.PASSED)


@pytest.mark.usefixtures("few")
def test_so_it_is_with_another_prefix_stored_in_sixteen_bits() -> None:
    config = builds.config_of("tracking")
    request = Request(math.radians(0.5), None, "int16", "--max-error 0.5deg/s --storage int16")
    options = BuildOptions("sample", prefix="rear2", request=request)
    folder = build(solve_case(config, builds.CASE), config, options, BuildInputs("s.npz", "0" * 64, "preset"))
    found = checked(planted.subject_of(folder))
    assert (found.findings, found.verdict) == ((), Verdict.PASSED)


@pytest.mark.usefixtures("few")
def test_the_car_of_another_map_steers_as_the_c_says() -> None:
    """The manifest's car is not the map's: which car turns the rear wheels where grip ends stands in the C alone."""
    config = builds.config_of("tracking")
    heavier = configuration.parse(
        {**config.model_dump(mode="json"), "vehicle": {**config.vehicle.model_dump(mode="json"), "mass_kg": 2400.0}}, "test"
    )
    folder = build(solve_case(config, builds.CASE), heavier, BuildOptions("sample"), BuildInputs("s.npz", "0" * 64, "ars.toml"))
    found = checked(planted.subject_of(folder))
    assert (found.findings, found.verdict) == ((), Verdict.PASSED)


def test_everything_that_is_told_is_the_same_each_time() -> None:
    one, other = clean(), checked(planted.subject_of(PI))
    assert one == other
    assert json.dumps(one.figures)
    assert one.figure == (
        f"0 findings in {one.figures['samples']:,} samples of {one.figures['drives']} drives, {law.SIZE_QUICK.sets} of them "
        f"with other parameters, and {one.figures['task_cycles']:,} cycles of the task"
    )


def test_without_haste_the_recordings_are_driven_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(law, "SIZE", FEW)
    monkeypatch.setattr(law, "recorded", lambda software: recorded(software)[:2])
    found = law.check(planted.subject_of(PI), Effort())
    assert found.verdict is Verdict.PASSED
    assert found.figures["drives"] == clean().figures["drives"] - law.SIZE_QUICK.sets + FEW.sets + 2


# --- what is planted -----------------------------------------------------------------------------------------------------

FAULTS = {
    "a gain of the wrong sign": (
        *(PI, "ars_controller", "const float proportional = parameters->proportional_gain * error;"),
        *("const float proportional = -(parameters->proportional_gain * error);", "drive 0, sample "),
    ),
    "a feedback of the wrong sign": (
        *(TRACKING, "ars_controller", "demand = map.rear_angle + feedback;", "demand = map.rear_angle - feedback;"),
        "",
    ),
    "a limiter on the wrong side": (
        *(TRACKING, "ars_limiter", "(self->front_angle < 0.0f) ? -in_phase", "(self->front_angle > 0.0f) ? -in_phase"),
        "",
    ),
    "a step of the reference model that is too long": (
        *(TRACKING, "ars_reference_model", "const float step = 0.01f;", "const float step = 0.010001f;"),
        "",
    ),
    "a default that is not the configuration's": (
        *(PI, "ars_calibration", ".integral_gain = 1.0f,", ".integral_gain = 1.5f,"),
        "src/ars_calibration.c: integral_gain is 1.5, not the configuration's 1",
    ),
    "a constant in the place of a parameter": (
        *(PI, "ars_controller", "parameters->proportional_gain * error", "0.01f * error"),
        "parameter set ",
    ),
}
"""Build, source, text, what takes its place, and how the finding begins."""


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize(("folder", "name", "old", "new", "told"), FAULTS.values(), ids=FAULTS)
def test_what_is_not_the_law_is_told(folder: Folder, name: str, old: str, new: str, told: str) -> None:
    found = checked(changed(folder, name, old, new))
    assert found.verdict is Verdict.FAILED
    assert found.findings[0].startswith(told)
    assert not found.figure.startswith("0 findings")


@pytest.mark.usefixtures("few")
def test_the_first_sample_that_differs_is_told_with_what_the_law_says() -> None:
    planted_in = "    const float half_turn = 0.5f * (measurement->speed * measurement->front_angle);"
    found = checked(changed(PI, "ars_controller", planted_in, planted_in.replace("0.5f", "0.4f")))
    (first, *_) = found.findings
    assert first.startswith("drive 0, sample ")
    assert "; by the law " in first
    assert first.endswith((")", ", inhibited)"))
    assert len([line for line in found.findings if line.startswith("drive 0, ")]) == 1, "what follows a difference differs too"


IN_THE_TASK = {
    "front angle of the other side": ("measurement.front_angle = self", "measurement.front_angle = -self"),
    "inhibit lost": ("measurement.inhibit = self->conditions.inhibit;", "measurement.inhibit = false;"),
    "rear angle not measured": ("measurement.rear_angle = self->conditions.rear_angle;", "measurement.rear_angle = 0.0f;"),
    "start on the other side": ("(&self->controller, rear_angle);", "(&self->controller, -rear_angle);"),
    "a sample too long without an angle": ("self->samples_without_angle >", "self->samples_without_angle >="),
    "speed only of a whole sample": (".speed = motion_good ?", ".speed = good ?"),
    "conditions not needed": ("good = motion_good && self->conditions_input.good;", "good = motion_good;"),
    "nothing diagnosed": ("signals.diagnostics = (uint16_t)diagnostics;", "signals.diagnostics = 0u;"),
}
"""Texts of the task, and what takes their place."""


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize(("old", "new"), IN_THE_TASK.values(), ids=IN_THE_TASK)
def test_what_the_task_makes_of_frames_is_seen(monkeypatch: pytest.MonkeyPatch, old: str, new: str) -> None:
    """The bare controller is right."""
    monkeypatch.setattr(law.suites, "drives", lambda ground, samples: ())
    text = planted.source(PI, "ars_task")
    assert old in text
    found = checked(planted.subject_of(PI, ars_task=text.replace(old, new, 1)))
    assert found.verdict is Verdict.FAILED
    assert found.findings
    assert all(": it sends 0x" in line and "; by the law 0x" in line for line in found.findings)


@pytest.mark.usefixtures("few")
def test_a_frame_with_another_scale_is_seen() -> None:
    text = planted.source(PI, "ars_can")
    scale = re.search(r"rear_angle[^;]*?(\d+\.\d+f)", text)
    assert scale is not None
    assert checked(planted.subject_of(PI, ars_can=text.replace(scale[1], "2000.0f"))).verdict is Verdict.FAILED


@pytest.mark.usefixtures("few")
def test_a_limit_that_rounding_alone_makes_act_is_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the actuator's end feedforward plus feedback may round to one unit beyond it: both tell the limit."""
    steps: list[Status] = []
    step = controller.SecondController.step

    def noted(self: controller.SecondController, sample: Measurement) -> Command:
        command = step(self, sample)
        steps.append(command.status)
        return command

    monkeypatch.setattr(controller.SecondController, "step", noted)
    monkeypatch.setattr(law.suites, "drives", lambda ground, samples: ())
    assert checked(planted.subject_of(TRACKING)).verdict is Verdict.PASSED
    assert Status.LIMITED in steps


@pytest.mark.usefixtures("few")
def test_a_status_that_is_none_is_a_finding() -> None:
    text = planted.source(PI, "ars_controller")
    nothing = text.replace("command.status = self->status;", "command.status = (ars_status_t)7;")
    assert nothing != text
    found = checked(planted.subject_of(PI, ars_controller=nothing))
    assert found.verdict is Verdict.FAILED
    assert "a status is none: 7 is not a valid Status" in found.findings[0]


@pytest.mark.usefixtures("few")
def test_parameters_that_the_c_refuses_are_told() -> None:
    signature = "bool ars_parameters_valid(const ars_parameters_t *parameters)"
    body = "    (void)parameters;\n    return false;"
    refusing = planted.wrapped(PI, "ars_controller", "ars_parameters_valid", signature, body)
    assert "src/ars_calibration.c: the C refuses its own default parameters" in checked(refusing).findings


# --- what is drawn -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", builds.KINDS)
def test_every_parameter_is_drawn_and_every_set_is_valid(kind: Kind) -> None:
    software = builds.compiled(kind)
    names: set[str] = set()
    default = dict(_values(software.parameters()))
    for seed in range(40):
        drawn = parameters.drawn(software, np.random.default_rng(seed))
        assert software.function("parameters_valid")(drawn)
        names |= {name for name, value in _values(drawn) if value != default[name]}
    assert names == set(default)


def _values(struct: object, before: str = "") -> list[tuple[str, object]]:
    found: list[tuple[str, object]] = []
    for name in dir(struct):
        value = getattr(struct, name)
        if name == "limiter":
            found += _values(value, "limiter.")
        else:
            found.append((before + name, value if isinstance(value, float | int) else list(value)))
    return found


# --- what keeps it from running ------------------------------------------------------------------------------------------


def not_run(subject: Subject) -> str:
    found = checked(subject)
    assert found.verdict is Verdict.NOT_RUN
    (why,) = found.findings
    return why


def test_a_build_of_another_version_is_not_judged() -> None:
    folder = dataclasses.replace(PI, manifest={**PI.manifest, "version": "0.0.9"})
    assert not_run(planted.subject_of(folder)) == (
        "made by codegen 0.0.9: the law that is known here is that of this one; build it again"
    )


def test_a_kind_that_nobody_wrote_a_second_time_is_not_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(law, "SECOND", {kind: make for kind, make in kinds.SECOND.items() if kind != "pi"})
    assert not_run(planted.subject_of(PI)) == "nobody has written the kind pi a second time: codegen/verify/law/kinds.py"


def test_code_that_might_never_return_is_not_run() -> None:
    old = "    self->rear_angle = clamp(target, -parameters->rear_angle_max, parameters->rear_angle_max);"
    why = not_run(changed(PI, "ars_limiter", old, f"    while (target > 1.0f) {{ target = 2.0f * target; }}\n{old}"))
    assert why.startswith("it might never return: src/ars_limiter.c:")


def test_without_a_compiler_it_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(MissingTool, match=r"^CC: the compiler 'no-such-compiler' does not exist"):
        checked(planted.subject_of(PI))


def test_c_that_does_not_compile_is_a_finding() -> None:
    found = checked(planted.subject_of(PI, ars_limiter="this is no C;\n"))
    assert (found.verdict, found.figure) == (Verdict.FAILED, "the C does not run")


@pytest.mark.usefixtures("few")
def test_code_that_cannot_be_read_is_not_run() -> None:
    """The compiler takes it; whether its loops end, nobody can say."""
    old = "    self->rear_angle = clamp(target, -parameters->rear_angle_max, parameters->rear_angle_max);"
    why = not_run(changed(PI, "ars_limiter", old, f"    target = __extension__ ({{ target; }});\n{old}"))
    assert why.startswith("it cannot be read, and so it might never return: ")


def test_c_without_a_table_is_a_finding() -> None:
    found = checked(changed(PI, "ars_map", "lateral_acceleration_cap = 5.", "cap_of_the_road = 5."))
    assert found.verdict is Verdict.FAILED

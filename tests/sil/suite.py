"""Which of the project's tests judge which unit of a build, in what order: first those that tell most in least time.

A judge is a test or a check as it stands in tests/, asked of a case. It raises where the C is wrong. Each unit's judges are
those that are about it, which is less than all: what they see, all of the tests see.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from tests.sil import (
    answers,
    answers_frames,
    checks_calibration,
    checks_control,
    checks_edges,
    checks_edges_law,
    checks_edges_units,
    checks_kinds,
    checks_limiter,
    checks_lookup,
    checks_map_reference,
    checks_parameters,
    checks_reference,
    checks_reference_model,
    checks_supervision,
    checks_tracking,
    test_closed_loop,
    test_controller,
    test_edges_task,
    test_faults_in_the_loop,
    test_supervision,
    test_task,
)
from tests.sil.calibrated import Calibrated
from tests.sil.case import Case
from tests.sil.suite_dynamics import check_dynamics
from tests.sil.suite_memory import check_memory
from tests.sil.suite_selftest import check_selftest
from tests.sil.test_controller import CHANGES
from tests.sil.tests_of import each_test


@dataclass(frozen=True)
class Judge:
    """A test or check with its name."""

    name: str
    run: Callable[[Case], object]


def worked_out(case: Case, name: str, make: Callable[[], Any]) -> Any:
    """What is worked out once for a build."""
    if name not in case.known:
        case.known[name] = make()
    return case.known[name]


def checks_in(module: ModuleType, but: tuple[str, ...] = ()) -> Iterable[tuple[str, Callable[..., object]]]:
    """Name and function of the checks that a module itself holds."""
    for name, value in vars(module).items():
        if name.startswith("check_") and value.__module__ == module.__name__ and name not in but:
            yield name, value


def _of_build(check: Callable[..., object]) -> Callable[[Case], object]:
    return lambda case: check(case.built)


def _of_units(check: Callable[..., object]) -> Callable[[Case], object]:
    return lambda case: check(case.units)


def _drives(case: Case) -> list[Judge]:
    """The independent model, with parameters that bring out each limit."""
    points = _points(case)
    changes: dict[str, dict[str, Any]] = {"as built": {}}
    if case.kind == "pi":
        plain: Any = CHANGES
        changes |= plain
        acts = {"rear_rate_max": 0.2, "opposite_phase_max": [0.03] * (points[1] // 2) + [0.01] * (points[1] - points[1] // 2)}
        changes["a limiter that acts"] = {"limiter": acts}
    if case.kind == "tracking":
        changes |= {name: _resized(one, points) for name, one in checks_tracking.MODEL_CHANGES.items()}
        changes["strict supervision"] = {"degraded_samples_max": 0, "recovery_samples": 1, "implausible_samples_max": 0}
    drives = [Judge(f"model: {name}", _drive(name, one, index)) for index, (name, one) in enumerate(changes.items())]
    return [*drives, Judge("model: rough drives", _rough)]


def _rough(case: Case) -> None:
    for known in worked_out(case, "rough", lambda: list(checks_edges_law.answers_of_rough(case.built))):
        answers.check_drive(case.built, known)


def _drive(name: str, changes: dict[str, Any], index: int) -> Callable[[Case], object]:
    course = {"speed_amplitude": 24.0, "steering_samples": 45.0} if index % 2 else {}

    def judge(case: Case) -> None:
        def make() -> answers.Drive:
            return answers.answers_of_drive(case.built, changes, 2500, index + 1, **course)

        answers.check_drive(case.built, worked_out(case, f"drive {name}", make))

    return judge


def _points(case: Case) -> tuple[int, int]:
    """Of the schedule of the gains, 0 for none, and of the limiter."""
    parameters = case.built.software.parameters()
    schedule = len(parameters.schedule_speed) if hasattr(parameters, "schedule_speed") else 0
    return schedule, len(parameters.limiter.opposite_phase_speed)


def _resized(changes: dict[str, Any], points: tuple[int, int]) -> dict[str, Any]:
    """Lists of as many elements as the build has: the last one is repeated."""

    def fit(values: Any, count: int) -> Any:
        return [*values, *([values[-1]] * count)][:count] if isinstance(values, list) else values

    plain = {name: fit(value, points[0]) for name, value in changes.items() if name != "limiter"}
    limiter = {name: fit(value, points[1]) for name, value in changes.get("limiter", {}).items()}
    return plain | ({"limiter": limiter} if limiter else {})


def _controller(case: Case) -> list[Judge]:
    judges = _drives(case)
    modules = (checks_edges, checks_parameters)
    edges = [Judge(name, _of_build(check)) for module in modules for name, check in checks_in(module)]
    guard = checks_calibration.check_parameters_judge_the_map_too
    edges.append(Judge(guard.__name__, _calibrated(guard)))
    if case.kind == "pi":
        own = [checks_supervision, checks_control]
        named = [Judge(name, _of_build(check)) for module in own for name, check in checks_in(module)]
        rest = each_test(test_supervision, test_controller, but=(*NOT_OF_ONE_BUILD, "test_every_sample_is_that"))
        return [*judges, *edges, *named, *(Judge(name, _of_build(test)) for name, test in rest)]
    named = [Judge(name, _of_build(check)) for name, check in checks_in(checks_kinds, ("check_kind_same_as_model",))]
    for module in (checks_tracking, checks_reference):
        named += [Judge(name, _of_build(check)) for name, check in checks_in(module, OF_THE_TESTS_OWN_SCHEDULE)]
    named += [Judge(check.__name__, _of_build(check)) for check in checks_edges_law.OF_TRACKING]
    named += [Judge(name, _of_build(check)) for name, check in checks_in(checks_supervision, OF_THE_PAPER_S_COMMANDS)]
    return [*judges, *edges, *named]


NOT_OF_ONE_BUILD = (
    "another_period",
    "bumpless",
    "each_is_taken_to_the_ends",
    "every_element_of_an_array",
    "every_number_has_a_range",
    "of_every_kind",
    "plain_shared_library",
    "planted",
    "single_and_double",
    "the_default_rate_limit",
    "the_name_follows",
    "the_schedule_rises",
)
"""Tests that build others, or compare builds; what they ask of one build is asked by a check beside them."""

OF_THE_TESTS_OWN_SCHEDULE = (
    "check_gain_schedule",
    "check_tracking_anti_windup",
    "check_tracking_bumpless",
    "check_tracking_inhibit",
    "check_tracking_same_as_model",
)
"""Checks that know the gains that the tests build with: here the models' answers stand for them."""


OF_THE_PAPER_S_COMMANDS = ("check_always_bounded", "check_fail_safe_hold", "check_gap", "check_last_speed", "check_recovery")
"""Checks of what every kind has in common that know how the paper's law goes on."""


OF_THE_PAPER_S_LAW = ("the_inhibit_bit_holds", "friction_of_a_frame", "measured_angle_of_a_frame")
"""Tests of the task that know how far the paper's gains move the command in a sample."""


def _limiter(case: Case) -> list[Judge]:
    def known(case: Case) -> None:
        answers.check_limiter(case.units, worked_out(case, "limiter", lambda: answers.answers_of_limiter(case.units)))

    checks = checks_in(checks_limiter, ("check_limiter_same_as_model",))
    named = [
        Judge(name, _of_units(check)) for name, check in (*((one.__name__, one) for one in checks_edges_units.CHECKS), *checks)
    ]
    return [Judge("model of the limiter", known), *_inits(), *named]


def _map(case: Case) -> list[Judge]:
    def known(case: Case) -> None:
        answers.check_map(
            case.built, case.units, worked_out(case, "map", lambda: answers.answers_of_map(case.built, case.units))
        )

    judges = [Judge("reference of the map", known)]
    but = ("check_same_bits", "check_checksum") if case.kind == "tracking" else ("check_same_bits",)
    judges += [Judge(name, _of_build(check)) for name, check in checks_in(checks_lookup, but)]
    judges += [Judge(name, _of_build(check)) for name, check in (("map_functions", check_map_functions),)]
    judges += [Judge(check.__name__, _calibrated(check)) for check in checks_calibration.CHECKS]
    if case.kind == "tracking":
        checks = checks_in(checks_map_reference, ("check_same_bits_as_reference",))
        judges += [Judge(name, _of_units(check)) for name, check in checks]
    return judges


def _calibration(case: Case) -> list[Judge]:
    """The numbers themselves: parameters as configured, and the map as it was solved."""
    checks = [("check_defaults", checks_parameters.check_defaults), ("map_functions", check_map_functions)]
    return [Judge(name, _of_build(check)) for name, check in checks]


def _calibrated(check: Callable[[Calibrated], None]) -> Callable[[Case], object]:
    """A check that writes into the calibration, and leaves it as it was."""

    def judge(case: Case) -> None:
        calibrated = Calibrated.over(case.built.software.compiled, case.built.total)
        try:
            check(calibrated.restored())
        finally:
            calibrated.restored()

    return judge


def check_map_functions(built: Any) -> None:
    """The function without friction, and the checksum that the self-test compares."""
    for speed, angle in ((12.0, 0.03), (33.0, -0.3), (90.0, 0.6), (0.0, 0.1), (20.0, 0.0)):
        wanted = built.lookup(speed, angle)
        assert built.software.function("map_yaw_rate")(speed, angle) == wanted
    assert built.software.function("map_checksum")() == built.software.function("map_expected_checksum")
    assert built.software.selftest()


def _reference_model(case: Case) -> list[Judge]:
    def known(case: Case) -> None:
        answers.check_model(case.units, worked_out(case, "model", lambda: answers.answers_of_model(case.units)))

    checks = checks_in(checks_reference_model, ("check_model_same_bits", "check_model_same_bits_over_time"))
    ends = [Judge(check.__name__, _of_units(check)) for check in checks_edges_units.OF_THE_MODEL]
    return [Judge("model of the car", known), *ends, *(Judge(name, _of_units(check)) for name, check in checks)]


def _can(case: Case) -> list[Judge]:
    def known(case: Case) -> None:
        answers_frames.check_can(case.built, worked_out(case, "can", lambda: answers_frames.answers_of_can(case.built)))

    return [Judge("Python's frames", known)]


def _e2e(case: Case) -> list[Judge]:
    def known(case: Case) -> None:
        answers_frames.check_e2e(case.built, worked_out(case, "e2e", lambda: answers_frames.answers_of_e2e(case.built)))

    return [Judge("Python's receiver", known), *_inits()]


def _inits() -> list[Judge]:
    return [Judge(name, _of_build(check)) for name, check in checks_in(checks_edges) if "init" in name]


def _task(case: Case) -> list[Judge]:
    but = (*NOT_OF_ONE_BUILD, *(OF_THE_PAPER_S_LAW if case.kind == "tracking" else ()))
    tests = [Judge(name, _of_build(test)) for name, test in each_test(test_task, test_edges_task, but=but)]
    return [*tests, *_inits()]


def _loops(case: Case) -> list[Judge]:
    tests = each_test(test_closed_loop, test_faults_in_the_loop, but=NOT_OF_ONE_BUILD)
    return [Judge(name, _of_build(test)) for name, test in tests]


UNITS: dict[str, Callable[[Case], list[Judge]]] = {
    "calibration": _calibration,
    "controller": _controller,
    "limiter": _limiter,
    "map": _map,
    "reference_model": _reference_model,
    "can": _can,
    "e2e": _e2e,
    "task": _task,
    "selftest": lambda _: [Judge("stand-ins", check_selftest)],
    "dynamics": lambda _: [Judge("machine", check_dynamics)],
}
"""By the name of the unit."""


MEMORY = "sanitized program"


def judges_of(case: Case, path: str) -> list[Judge]:
    """The judges of a unit, given by the path of its source."""
    unit = path.removeprefix(f"src/{case.built.software.prefix}_").removesuffix(".c")
    return [*UNITS[unit](case), Judge(MEMORY, check_memory)]


def whole(case: Case) -> list[Judge]:
    """Every judge of every unit of a case, and the closed loop and its faults around them."""
    found = {judge.name: judge for path in case.tree.units for judge in judges_of(case, path)}
    del found[MEMORY]  # a program of its own, which counts nothing here
    return [*found.values(), *_loops(case)]

"""Which checks judge which unit of a build, by kind of controller, those that find most in least time first.

`make test` runs each judge on the build as it is; the mutation campaign runs them on mutants. So the tests of the C and their
power to fail are one list.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

from codegen.config import Kind
from tests.builds import Built
from tests.sil import (
    answers,
    answers_frames,
    answers_task,
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
    checks_task,
    checks_tracking,
)
from tests.sil.calibrated import Calibrated
from tests.sil.case import Case
from tests.sil.suite_dynamics import check_dynamics
from tests.sil.suite_memory import check_memory
from tests.sil.suite_selftest import check_selftest


@dataclass(frozen=True)
class Judge:
    """A check of a unit, called with a case; it raises an exception if the case fails it.

    Attributes:
        of_single: whether it writes or compares numbers of single precision, so that it cannot judge a build in double.
        of_one_layer: whether it knows the cap of a map for one friction only.
    """

    name: str
    run: Callable[[Case], object]
    of_single: bool = False
    of_one_layer: bool = False


def _of_built(*checks: Callable[[Built], object]) -> list[Judge]:
    return [Judge(check.__name__, lambda case, check=check: check(case.built)) for check in checks]  # type: ignore[misc]


def _of_units(*checks: Callable[[Any], object]) -> list[Judge]:
    return [Judge(check.__name__, lambda case, check=check: check(case.units)) for check in checks]  # type: ignore[misc]


def _of_calibration(*checks: Callable[[Calibrated], None]) -> list[Judge]:
    """Judges that write into the calibration and leave it as it was."""

    def run(case: Case, check: Callable[[Calibrated], None]) -> None:
        calibrated = Calibrated.over(case.built.software.compiled, case.built.total)
        try:
            check(calibrated.restored())
        finally:
            calibrated.restored()

    return [Judge(check.__name__, lambda case, check=check: run(case, check), of_single=True) for check in checks]  # type: ignore[misc]


def _in(module: ModuleType, *but: Callable[..., object]) -> Iterable[Callable[..., Any]]:
    """Return the checks that a module itself defines, in the order of the source."""
    for name, value in vars(module).items():
        if name.startswith("check_") and value.__module__ == module.__name__ and value not in but:
            yield value


def _known(case: Case, name: str, make: Callable[[], Any]) -> Any:
    """Return what is computed once for a build."""
    if name not in case.known:
        case.known[name] = make()
    return case.known[name]


STRICT = {"degraded_samples_max": 0, "recovery_samples": 1, "implausible_samples_max": 0}
DRIVES: dict[Kind, dict[str, dict[str, Any]]] = {
    "pi": {
        "as built": {},
        "rate limit": {"rear_rate_max": checks_control.RATE_LIMIT},
        "slow actuator": {"rear_rate_max": 0.07, "rear_angle_error_max": 0.005},
        "strict supervision": STRICT,
        "high gains": {"proportional_gain": 0.2, "integral_gain": 8.0},
        "a limiter that acts": {"limiter": {"rear_rate_max": 0.2, "opposite_phase_max": [0.03, 0.01]}},
    },
    "tracking": {**checks_tracking.MODEL_CHANGES, "strict supervision": STRICT},
    "feedforward": {"as built": {}, "slow": {"rear_rate_max": 0.03, "limiter": {"rear_rate_max": 0.02}}},
    "proportional": {"as built": {}, "slow": {"rear_rate_max": 0.03, "limiter": {"rear_rate_max": 0.02}}},
}
"""Parameters that bring out each limit of a law."""


def _drives(kind: Kind) -> list[Judge]:
    """Judges against the independent model of the law, bit for bit."""

    def drive(case: Case, name: str, changes: dict[str, Any], index: int) -> None:
        course = {"speed_amplitude": 24.0, "steering_samples": 45.0} if index % 2 else {}

        def make() -> answers.Drive:
            count = case.samples(2500, least=1000)
            return answers.answers_of_drive(case.built, _resized(case, changes), count, index + 1, **course)

        answers.check_drive(case.built, _known(case, f"drive {name}", make))

    def rough(case: Case) -> None:
        for one in _known(case, "rough", lambda: list(checks_edges_law.answers_of_rough(case.built, case.samples(3000)))):
            answers.check_drive(case.built, one)

    judges = []
    for index, (name, changes) in enumerate(DRIVES[kind].items()):
        judges.append(Judge(f"model: {name}", lambda case, a=name, b=changes, c=index: drive(case, a, b, c)))  # type: ignore[misc]
    return [*judges, Judge("model: rough drives", rough)] if kind in ("pi", "tracking") else judges


def _resized(case: Case, changes: dict[str, Any]) -> dict[str, Any]:
    """Return the changes with arrays of as many elements as the build has: the last one is repeated."""
    parameters = case.built.software.parameters()

    def fit(name: str, value: Any, of: Any) -> Any:
        if isinstance(value, dict):
            return {inner: fit(inner, values, getattr(of, name)) for inner, values in value.items()}
        count = len(getattr(of, name)) if isinstance(value, list) else 0
        return [*value, *([value[-1]] * count)][:count] if isinstance(value, list) else value

    return {name: fit(name, value, parameters) for name, value in changes.items()}


OF_EVERY_KIND = (
    checks_supervision.check_inputs,
    checks_supervision.check_signalling_nan,
    checks_supervision.check_plausibility_limit,
    checks_supervision.check_plausibility_time,
    checks_supervision.check_limiter_in_a_gap,
    checks_supervision.check_start_at_no_angle,
    checks_supervision.check_fail_safe_ramp,
    checks_supervision.check_gap_from_the_first_sample,
    checks_supervision.check_gap_in_standby,
    checks_supervision.check_standby,
)
"""Checks of the supervision that do not depend on the law."""

OF_THE_TESTS_OWN_SCHEDULE = (
    checks_tracking.check_gain_schedule,
    checks_tracking.check_tracking_anti_windup,
    checks_tracking.check_tracking_bumpless,
    checks_tracking.check_tracking_inhibit,
)
"""Checks that know the gains of `tests.builds`; a designed schedule is compared with the model only."""


def _controller(kind: Kind) -> list[Judge]:
    judges = [
        *_drives(kind),
        *_of_built(*_in(checks_edges), *_in(checks_parameters)),
        *_of_calibration(checks_calibration.check_parameters_judge_the_map_too),
    ]
    if kind == "pi":
        return [*judges, *_of_built(*_in(checks_supervision), *_in(checks_control))]
    judges += _of_built(*OF_EVERY_KIND, checks_kinds.check_kind_always_bounded)
    if kind == "tracking":
        judges += _of_built(checks_supervision.check_fail_safe_at_the_hold_speed)
        checks = (*_in(checks_tracking), *_in(checks_reference), *checks_edges_law.OF_TRACKING)
        judges += _of_built(*(check for check in checks if check not in OF_THE_TESTS_OWN_SCHEDULE))
    return judges


def _limiter(kind: Kind) -> list[Judge]:
    def model(case: Case) -> None:
        answers.check_limiter(
            case.units, _known(case, "limiter", lambda: answers.answers_of_limiter(case.units, case.samples(4000)))
        )

    checks = _of_units(*checks_edges_units.CHECKS, *_in(checks_limiter))
    return [Judge("model of the limiter", model), *_inits(kind), *checks]


def _map(kind: Kind) -> list[Judge]:
    def reference(case: Case) -> None:
        known = _known(case, "map", lambda: answers.answers_of_map(case.built, case.units, 30_000 // case.samples(30_000)))
        answers.check_map(case.built, case.units, known)

    has_rear_angle = kind in ("tracking", "feedforward")
    but = (checks_lookup.check_checksum,)
    # These know the table and the cap of one friction.
    capped = (checks_lookup.check_cap, checks_lookup.check_cap_is_reached, checks_lookup.check_error_bound)
    capped += () if has_rear_angle else (checks_lookup.check_checksum,)
    judges = [Judge("reference of the map", reference), *_of_built(*_in(checks_lookup, *but, *capped), check_map_functions)]
    judges += [replace(judge, of_one_layer=True) for judge in _of_built(*capped)]
    judges += _of_calibration(*checks_calibration.CHECKS)
    return [*judges, *_of_units(*_in(checks_map_reference))] if has_rear_angle else judges


def check_map_functions(built: Built) -> None:
    """The function without friction, and the checksum that the self-test compares."""
    for speed, angle in ((12.0, 0.03), (33.0, -0.3), (90.0, 0.6), (0.0, 0.1), (20.0, 0.0)):
        wanted = built.lookup(speed, angle)
        assert built.software.function("map_yaw_rate")(speed, angle) == wanted
    assert built.software.function("map_checksum")() == built.software.function("map_expected_checksum")
    assert built.software.selftest()


def _reference_model(_: Kind) -> list[Judge]:
    def model(case: Case) -> None:
        answers.check_model(
            case.units, _known(case, "model", lambda: answers.answers_of_model(case.units, case.samples(30_000)))
        )

    return [Judge("model of the car", model), *_of_units(*checks_edges_units.OF_THE_MODEL, *_in(checks_reference_model))]


def _can(_: Kind) -> list[Judge]:
    def frames(case: Case) -> None:
        answers_frames.check_can(case.built, _known(case, "can", lambda: answers_frames.answers_of_can(case.built)))

    return [Judge("Python's frames", frames)]


def _e2e(kind: Kind) -> list[Judge]:
    def receiver(case: Case) -> None:
        answers_frames.check_e2e(case.built, _known(case, "e2e", lambda: answers_frames.answers_of_e2e(case.built)))

    return [Judge("Python's receiver", receiver), *_inits(kind)]


def _inits(_: Kind) -> list[Judge]:
    return _of_built(checks_edges.check_init_sets_everything, checks_edges.check_state_after_init)


def _task(kind: Kind) -> list[Judge]:
    def task(case: Case) -> None:
        lives = case.samples(answers_task.LIVES, least=12)
        answers_task.check_task(case.built, _known(case, "task", lambda: answers_task.answers_of_task(case.built, lives)))

    return [Judge("second task", task), *_of_built(*_in(checks_task)), *_inits(kind)]


UNITS: dict[str, Callable[[Kind], list[Judge]]] = {
    "calibration": lambda _: _of_built(checks_parameters.check_defaults, check_map_functions),
    "controller": _controller,
    "limiter": _limiter,
    "map": _map,
    "reference_model": _reference_model,
    "can": _can,
    "e2e": _e2e,
    "task": _task,
    "selftest": lambda _: [Judge("stand-ins", check_selftest, of_single=True)],
    "dynamics": lambda _: [Judge("machine", check_dynamics)],
}
"""Judges of a kind, by the name of the unit."""


SANITIZED = Judge("sanitized program", check_memory)


def judges_of(kind: Kind, path: str) -> list[Judge]:
    """Return the judges of a unit, given by the path of its source; the sanitized program comes last."""
    return [*UNITS[path.removeprefix("src/ars_").removesuffix(".c")](kind), SANITIZED]


def whole(kind: Kind, units: Iterable[str] = UNITS) -> list[Judge]:
    """Return every judge of units of a kind, each once, without the sanitized program."""
    own = [name for name in units if name != "reference_model" or kind == "tracking"]
    return list({judge.name: judge for name in own for judge in UNITS[name](kind)}.values())

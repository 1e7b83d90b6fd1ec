"""Checks of each unit of a build, by kind of controller; those that find the most faults in the least time come first.

`make test` runs each judge on the original build, the mutation campaign on mutants. One list thus covers the tests of the C and
their sensitivity.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

from codegen.configuration import Kind
from codegen.emit.build import OF_REFERENCE_MODEL
from tests.builds import Built
from tests.sil import (
    answers,
    answers_frames,
    answers_task,
    checks_calibration,
    checks_edges,
    checks_inputs,
    checks_kinds,
    checks_limiter,
    checks_lookup,
    checks_map_reference,
    checks_parameters,
    checks_reference_model,
    checks_supervision,
    checks_tracking,
)
from tests.sil.case import Case
from tests.sil.checks_selftest import check_selftest
from tests.sil.suite_dynamics import check_dynamics
from tests.sil.suite_memory import check_memory


@dataclass(frozen=True)
class Judge:
    """A check of a unit, called with a case; it raises an exception if the case fails it.

    `of_single` judges write or compare single-precision numbers and cannot judge a double-precision build. `of_one_layer`
    judges know the cap of a map for one friction only.
    """

    name: str
    run: Callable[[Case], object]
    of_single: bool = False
    of_one_layer: bool = False


def _of_built(*checks: Callable[[Built], object]) -> list[Judge]:
    return [Judge(check.__name__, lambda case, check=check: check(case.built)) for check in checks]  # type: ignore[misc]


def _of_units(*checks: Callable[[Any], object]) -> list[Judge]:
    return [Judge(check.__name__, lambda case, check=check: check(case.units)) for check in checks]  # type: ignore[misc]


def _of_calibration(*checks: Callable[[checks_calibration.Calibrated], None]) -> list[Judge]:
    """Return judges that write to the calibration and restore it."""

    def run(case: Case, check: Callable[[checks_calibration.Calibrated], None]) -> None:
        calibrated = checks_calibration.Calibrated.over(case.built.software.compiled, case.built.total)
        try:
            check(calibrated.restored())
        finally:
            calibrated.restored()

    return [Judge(check.__name__, lambda case, check=check: run(case, check), of_single=True) for check in checks]  # type: ignore[misc]


def _in(module: ModuleType) -> Iterable[Callable[..., Any]]:
    """Return the checks defined in a module, in source order."""
    for name, value in vars(module).items():
        if name.startswith("check_") and value.__module__ == module.__name__:
            yield value


def _cached(case: Case, name: str, make: Callable[[], Any]) -> Any:
    """Return a value computed once per build."""
    if name not in case.known:
        case.known[name] = make()
    return case.known[name]


def _comparing(name: str, make: Callable[[Case], Any], check: Callable[[Case, Any], None]) -> Judge:
    """Return the judge that compares a build with expected results computed once."""
    return Judge(name, lambda case: check(case, _cached(case, name, lambda: make(case))))


STRICT = {"inputs": {"missing_samples_max": 0, "recovery_samples": 1}}
SLOW = {"rear_rate_max": 0.03, "limiter": {"rear_rate_max": 0.02}, "inputs": checks_kinds.OPEN}
SMALL = {"rear_angle_max": 0.02}
DRIVES: dict[Kind, dict[str, dict[str, Any]]] = {
    "pi": {
        "as built": {},
        "rate limit": {"rear_rate_max": math.radians(25.0)},
        "slow actuator": {"rear_rate_max": 0.07, "rear_angle_error_max": 0.005},
        "strict supervision": STRICT,
        "high gains": {"proportional_gain": 0.2, "integral_gain": 8.0},
        "a limiter that acts": {"limiter": {"rear_rate_max": 0.2, "opposite_phase_max": [0.03, 0.01]}},
    },
    "tracking": {**checks_tracking.MODEL_CHANGES, "strict supervision": STRICT},
    "feedforward": {"as built": {}, "slow": SLOW, "small angle": {**SMALL, "limiter": {**SMALL, "opposite_phase_max": [0.02]}}},
}
"""Parameters that reach each limit of a law, where those of SIMPLE_DRIVES do not."""
SIMPLE_DRIVES: dict[str, dict[str, Any]] = {"as built": {}, "slow": SLOW}


def _drives(kind: Kind) -> list[Judge]:
    """Return judges that compare drives with the independent model of the law, bit for bit."""

    def drive(case: Case, changes: dict[str, Any], index: int) -> answers.Drive:
        course = {"speed_amplitude": 24.0, "steering_samples": 90.0} if index % 2 else {}
        return answers.answers_of_drive(
            case.built, _resized(case, changes), case.samples(2500, least=1200), index + 1, **course
        )

    def check(case: Case, known: Iterable[answers.Drive]) -> None:
        for one in known:
            answers.check_drive(case.built, one)

    judges = [_comparing(f"model: {name}", lambda case, a=changes, b=index: [drive(case, a, b)], check)  # type: ignore[misc]
              for index, (name, changes) in enumerate(DRIVES.get(kind, SIMPLE_DRIVES).items())]  # fmt: skip
    if kind in ("pi", "tracking"):
        rough = answers.answers_of_rough
        judges.append(_comparing("model: rough drives", lambda case: list(rough(case.built, case.samples(3000))), check))
    return judges


def _resized(case: Case, changes: dict[str, Any]) -> dict[str, Any]:
    """Return the changes with arrays resized for the build by repeating the last element."""
    parameters = case.built.software.parameters()

    def fit(name: str, value: Any, of: Any) -> Any:
        if isinstance(value, dict):
            return {inner: fit(inner, values, getattr(of, name)) for inner, values in value.items()}
        count = len(getattr(of, name)) if isinstance(value, list) else 0
        return [*value, *([value[-1]] * count)][:count] if isinstance(value, list) else value

    return {name: fit(name, value, parameters) for name, value in changes.items()}


def _controller(kind: Kind) -> list[Judge]:
    own = _in(checks_tracking) if kind == "tracking" else ()
    return [
        *_drives(kind),
        *_of_built(*_in(checks_edges), *_in(checks_parameters), *_in(checks_inputs)),
        *_of_calibration(checks_calibration.check_parameters_judge_the_map_too),
        *_of_built(*_in(checks_supervision), checks_kinds.check_kind_always_bounded, *own),
    ]


def _limiter(kind: Kind) -> list[Judge]:
    model = _comparing("model of the limiter", lambda case: answers.answers_of_limiter(case.units, case.samples(4000)),
                      lambda case, known: answers.check_limiter(case.units, known))  # fmt: skip
    return [model, *_inits(kind), *_of_units(*_in(checks_limiter))]


def _map(kind: Kind) -> list[Judge]:
    reference = _comparing(
        "reference of the map",
        lambda case: answers.answers_of_map(case.built, case.units, 30_000 // case.samples(30_000)),
        lambda case, known: answers.check_map(case.built, case.units, known),
    )
    (cap,) = _of_built(checks_lookup.check_cap)  # for one friction only
    judges = [reference, *_of_built(checks_lookup.check_map_functions), replace(cap, of_one_layer=True)]
    return [*judges, *_of_units(*_in(checks_map_reference))] if kind in ("tracking", "feedforward") else judges


def _reference_model(_: Kind) -> list[Judge]:
    model = _comparing("model of the car", lambda case: answers.answers_of_model(case.units, case.samples(30_000)),
                      lambda case, known: answers.check_model(case.units, known))  # fmt: skip
    return [model, *_of_units(*_in(checks_reference_model)), *_of_built(checks_lookup.check_map_functions)]


def _inits(_: Kind) -> list[Judge]:
    return _of_built(checks_edges.check_init_sets_everything, checks_edges.check_state_after_init)


FRAMES = _comparing("Python's frames", lambda case: answers_frames.answers_of_can(case.built),
                   lambda case, known: answers_frames.check_can(case.built, known))  # fmt: skip
RECEIVER = _comparing("Python's receiver", lambda case: answers_frames.answers_of_e2e(case.built),
                     lambda case, known: answers_frames.check_e2e(case.built, known))  # fmt: skip
TASK = _comparing(
    "second task",
    lambda case: answers_task.answers_of_task(case.built, case.samples(answers_task.STARTS, least=12)),
    lambda case, known: answers_task.check_task(case.built, known),
)
UNITS: dict[str, Callable[[Kind], list[Judge]]] = {
    "calibration": lambda kind: [
        *_of_built(checks_parameters.check_defaults),
        *_map(kind),
        *([*_reference_model(kind), *_of_built(*_in(checks_tracking))] if kind == "tracking" else ()),
    ],
    "checksum": lambda _: _of_built(checks_lookup.check_map_functions),
    "controller": _controller,
    "law": _controller,
    "grip": lambda kind: [*_drives(kind), *_of_built(*_in(checks_tracking)), *_inits(kind)],
    "parameters": lambda _: [
        *_of_built(*_in(checks_parameters), checks_lookup.check_map_functions),
        *_of_calibration(checks_calibration.check_parameters_judge_the_map_too),
    ],
    "inputs": lambda kind: [
        *_drives(kind),
        *_of_built(
            *_in(checks_inputs), *_in(checks_supervision), checks_parameters.check_ranges, checks_edges.check_unsound_memory
        ),
        *_inits(kind),
    ],
    "limiter": _limiter,
    "map": lambda kind: [*_map(kind), *_of_calibration(*_in(checks_calibration))],
    "reference_model": _reference_model,
    "can": lambda _: [FRAMES],
    "e2e": lambda kind: [RECEIVER, *_inits(kind)],
    "supervision": lambda kind: [*_of_built(answers_task.check_supervision), TASK, *_inits(kind)],
    "task": lambda kind: [
        TASK,
        *_of_built(
            answers_task.check_backlog,
            answers_task.check_zeroed_task,
            answers_task.check_silence,
            answers_task.check_inhibit_for_good,
            answers_task.check_stuck_wheels_come_free,
            answers_task.check_damaged_state,
            answers_task.check_actuator_is_followed,
            answers_task.check_command_stays_near_wheels,
            answers_task.check_start_of_the_return,
            answers_task.check_wheels_that_follow_again,
            answers_task.check_command_goes_out_to_wheels,
            answers_task.check_replaced_in_standby,
            answers_task.check_rear_angle_never_measured,
            answers_task.check_rear_angle_lost_in_a_broken_bus,
        ),
        *_inits(kind),
    ],
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
    own = [name for name in units if name not in OF_REFERENCE_MODEL or kind == "tracking"]
    return list({judge.name: judge for name in own for judge in UNITS[name](kind)}.values())

"""Every check of the generated C: once for each kind of controller in single precision, and in double precision."""

from typing import Any

import pytest

from codegen.configuration import Kind
from codegen.configuration.can import Can, E2e
from tests import builds
from tests.sil import answers_frames
from tests.sil.case import RELAXATIONS_M, case
from tests.sil.suite import SANITIZED, UNITS, Judge, whole

KINDS: dict[str, Kind] = {
    "4ws2-paper": "pi",
    "4ws2": "tracking",
    "feedforward single": "feedforward",
    "proportional single": "proportional",
    "tracking double": "tracking",
}
"""Kind of the controller by the name of the case; the first two are the committed builds. The evidence has "pi double"."""

OF_THE_KIND = ("calibration", "controller", "task")
"""Units that depend on the control law. The others are the same C in every kind of one precision; two kinds cover them."""

MODEL = ("reference_model",)
"""Units that depend on the tyres' relaxation length."""

MAPS: dict[str, Kind] = {
    "pi uneven": "pi",
    "pi rough": "pi",
    "tracking rough stack": "tracking",
    "feedforward stack": "feedforward",
    "pi rough with int16": "pi",
    "feedforward rough stack with grip": "feedforward",
}
"""Maps with other axes and stacks, with chosen breakpoints and with a nonlinear tyre: the lookup has different C for each."""


def _judged() -> list[Any]:
    found: list[tuple[str, Judge]] = []
    for name, kind in KINDS.items():
        judges = whole(kind, OF_THE_KIND if kind in ("feedforward", "proportional") else UNITS)
        found += [(name, judge) for judge in judges if not (judge.of_single and "double" in name)]
    for name, kind in MAPS.items():
        judges = whole(kind, ("map",))
        judges = [
            judge for judge in judges if not (judge.of_single and "with" in name)
        ]  # these judges cannot write such a calibration
        found += [(name, judge) for judge in judges if not (judge.of_one_layer and "stack" in name)]
    for feature in RELAXATIONS_M:
        found += [
            (f"tracking {each} with {feature}", judge) for each in builds.PRECISIONS for judge in whole("tracking", MODEL)
        ]
    found += [(name, SANITIZED) for name in ("4ws2-paper", "4ws2", "tracking rough stack")]
    return [pytest.param(name, judge, id=f"{name}: {judge.name}") for name, judge in found]


@pytest.mark.parametrize(("name", "judge"), _judged())
def test_unit(name: str, judge: Judge) -> None:
    judge.run(case(name))


def test_receivers_with_other_settings() -> None:
    """E2E protection with limits at the ends of their configuration ranges."""
    window = {"window_size": 16, "min_ok_state_init": 5, "min_ok_state_valid": 4, "min_ok_state_invalid": 9}
    window |= {"max_error_state_init": 1, "max_error_state_valid": 7, "max_error_state_invalid": 4}
    strict = Can(e2e=E2e(max_delta_counter_init=0, max_no_new_or_repeated_data=14, sync_counter_init=0, **window))
    built = builds.make(builds.paper_map(), builds.CONFIG.model_copy(update={"can": strict}))
    answers_frames.check_e2e(built, answers_frames.answers_of_e2e(built, every=False))

"""The edges of the generated C, in every kind and both precisions; and its answers to what is known of it."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from codegen.config import Kind
from codegen.emit.text import Precision
from tests import builds
from tests.builds import Built
from tests.sil import answers, answers_frames, checks_edges, checks_parameters, units

CHECKS: tuple[Callable[[Built], None], ...] = (
    checks_edges.check_init_sets_everything,
    checks_edges.check_state_after_init,
    checks_edges.check_counts,
    checks_edges.check_counts_of_one_another,
    checks_edges.check_counts_stay_at_their_end,
    checks_parameters.check_defaults,
    checks_parameters.check_ranges,
    checks_edges.check_yaw_rate_error,
)
CONTROLLER_C, CALIBRATION_C, TASK_C, CAN_C, E2E_C = (
    f"src/ars_{name}.c" for name in ("controller", "calibration", "task", "can", "e2e")
)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("precision", builds.PRECISIONS)
@pytest.mark.parametrize("kind", builds.CONFIGS)
def test_an_edge(kind: Kind, precision: Precision, check: Callable[[Built], None]) -> None:
    check(builds.of_kind(kind, precision))


@pytest.mark.parametrize(
    ("check", "path", "old", "new"),
    [
        (CHECKS[0], TASK_C, "    self->cycles = 0u;\n", ""),
        (CHECKS[1], CONTROLLER_C, "    self->speed = speed_unknown;\n", "    self->speed = 0.0f;\n"),
        (CHECKS[5], CALIBRATION_C, ".enable_speed = 4.16", ".enable_speed = 4.17"),
        (CHECKS[6], CONTROLLER_C, "parameters->yaw_rate_max, 0.01f, 20.0f", "parameters->yaw_rate_max, 0.01f, 20.5f"),
        (CHECKS[2], CONTROLLER_C, "self->bad_samples < UINT16_MAX", "self->bad_samples < 200u"),
        (CHECKS[4], CONTROLLER_C, "if (self->bad_samples < UINT16_MAX) {", "if (true) {"),
        (CHECKS[7], CONTROLLER_C, "self->yaw_rate_reference - measurement->yaw_rate;", "measurement->yaw_rate;"),
        (CHECKS[3], CONTROLLER_C, "    self->good_samples = 0u;\n    if ((self", "    if ((self"),
    ],
)
def test_a_fault_at_an_edge_is_seen(check: Callable[[Built], None], path: str, old: str, new: str) -> None:
    with pytest.raises(AssertionError):
        check(builds.altered(path, old, new))


def test_a_build_gives_the_answers_of_the_independent_models() -> None:
    for kind in ("pi", "tracking"):
        built = builds.of_kind(kind)
        answers.check_drive(built, answers.answers_of_drive(built, {}, 1000, 2))
    own = units.tracking()
    answers.check_limiter(own, answers.answers_of_limiter(own, 300))
    answers.check_model(own, answers.answers_of_model(own, 2000))
    for known in (builds.paper(), builds.of_kind("tracking")):
        answers.check_map(known, own, answers.answers_of_map(known, own, 50))


@pytest.mark.parametrize("precision", builds.PRECISIONS)
def test_a_build_gives_the_answers_of_python_s_frames(precision: Precision) -> None:
    built = builds.paper(precision)
    answers_frames.check_can(built, answers_frames.answers_of_can(built))
    answers_frames.check_e2e(built, answers_frames.answers_of_e2e(built))


def test_a_fault_in_a_frame_is_seen() -> None:
    last = "data[7] |= (uint8_t)((code >> 8u) & 0xFFu);\n}\n\nARS_SECTION_CODE void ars_can_unpack_vehicle_motion"
    wrong = builds.altered(CAN_C, last, last.partition("\n")[2])
    with pytest.raises(AssertionError):
        answers_frames.check_can(wrong, answers_frames.answers_of_can(wrong))
    wrong = builds.altered(E2E_C, "self->waits_for_first = false;", "")
    with pytest.raises(AssertionError):
        answers_frames.check_e2e(wrong, answers_frames.answers_of_e2e(wrong))


def test_a_fault_in_a_law_is_seen() -> None:
    wrong = builds.altered(CONTROLLER_C, "    command.status = self->status;\n", "    command.status = ARS_STATUS_STANDBY;\n")
    with pytest.raises(AssertionError):
        answers.check_drive(wrong, answers.answers_of_drive(wrong, {}))

"""The contracts in ACSL: EVA, as an interpreter of a drive without unknown values, confirms what they state about it."""

import pytest

from codegen.emit.contracts import files as contract_files
from codegen.verify import memory
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from tests.verify import builds

BUILD = builds.made("pi", "uneven")
HEADER, DRIVE = "verify/ars_acsl.h", "verify/every_function.c"
QUANTIFIED = 3
"""Clauses with a quantifier, which EVA does not decide: the parameters of three functions are within their invariant."""

TEXT = b"""
#include "ars_task.h"

int main(void)
{
    ars_controller_t controller;
    ars_e2e_receiver_t receiver;
    ars_vehicle_motion_t motion = {15.0f, 0.05f, 0.1f};
    uint8_t frame[8], counter = 14u;

    ars_limiter_init(&controller.limiter, 2.0f);
    ars_controller_init(&controller, 0.01f);
    for (int k = 0; k < 6; k++) {
        const ars_measurement_t sample = {(k < 4) ? 15.0f : 0.2f, 0.03f, 0.1f, 0.01f, 0.9f, 1.0f, false};

        (void)ars_controller_step(&controller, &ars_parameters_default, &sample);
    }
    ars_e2e_receiver_init(&receiver);
    for (int k = 0; k < 3; k++) {
        ars_can_pack_vehicle_motion(&motion, frame);
        ars_e2e_protect(0x101u, &counter, frame);
        frame[3] ^= (k == 1) ? 1u : 0u;
        (void)ars_e2e_check(&receiver, 0x101u, frame);
        ars_can_unpack_vehicle_motion(frame, &motion);
    }
    return 0;
}
"""

BROKEN = {
    "a negated comparison": (r"\le_float(\result, (float)(", r"\gt_float(\result, (float)("),
    "another sign": (r"\old(self->rear_angle) + (float)(", r"\old(self->rear_angle) - (float)("),
    "the value after the call": (r"\old(*counter) & 0x0Fu", "*counter & 0x0Fu"),
    "the other case": ("!lies_within(input->speed, ", "lies_within(input->speed, "),
}


def driven(old: str = "", new: str = "") -> Outcome:
    """Run EVA on the drive with one text of the contracts replaced."""
    header = BUILD.files[HEADER].decode("ascii")
    assert old in header
    files = {**BUILD.files, HEADER: header.replace(old, new).encode("ascii"), DRIVE: TEXT}
    with pytest.MonkeyPatch.context() as patch:
        # EVA keeps up to 1000 states apart: each sample is one.
        patch.setattr(contract_files, "EVA", f"{contract_files.EVA} -eva-slevel 1000")
        return memory.check(Subject("sample", files, BUILD.manifest), Effort())


def test_the_contracts_hold_in_a_drive() -> None:
    clauses = driven().figures["clauses"]
    assert clauses["number"] - clauses["confirmed"] == QUANTIFIED, clauses
    assert clauses["number"] > 100


@pytest.mark.parametrize("name", BROKEN)
def test_a_wrong_contract_does_not_hold_in_a_drive(name: str) -> None:
    outcome = driven(*BROKEN[name])
    clauses = outcome.figures["clauses"]
    assert outcome.verdict is Verdict.FAILED or clauses["number"] - clauses["confirmed"] > QUANTIFIED


@pytest.mark.parametrize("quick", [True, False])
def test_contracts_that_do_not_parse_fail_with_the_location(quick: bool) -> None:
    header = BUILD.files[HEADER].replace(rb"\result == self->state", rb"\result == self->status")
    outcome = memory.check(Subject("sample", {**BUILD.files, HEADER: header}, BUILD.manifest), Effort(quick=quick))
    assert (outcome.verdict, len(outcome.findings)) == (Verdict.FAILED, 1)
    assert outcome.findings[0].startswith(f"{HEADER}:") and "status" in outcome.findings[0]

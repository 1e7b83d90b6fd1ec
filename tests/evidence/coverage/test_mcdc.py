"""MC/DC with clang: a condition that no judge decides is a finding. Run by name; needs clang-19 and llvm-19."""

import pytest

from codegen.verify.check import Verdict
from codegen.verify.packages import MissingTool
from tests.evidence.coverage import mcdc
from tests.harness.test_coverage import PI, partial


def test_conditions_that_are_not_decided_are_findings() -> None:
    try:
        conditions = mcdc.measured(PI, partial)
    except MissingTool as error:
        pytest.skip(str(error))
    missed = {text for place, text, is_covered in conditions if place.startswith("4ws2/src/ars_e2e.c:") and not is_covered}
    assert "(counter > counter_max)" in missed
    frames = [one for one in conditions if one[0].startswith("4ws2/src/ars_can.c:")]
    assert frames
    assert mcdc.outcome_of(frames).verdict is Verdict.PASSED

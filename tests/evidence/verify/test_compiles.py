"""Check `compiles`: a build compiles cleanly and needs no function besides those of its manifest."""

import pytest

from codegen.configuration import Kind
from codegen.emit.text import Precision
from codegen.verify import compilers
from codegen.verify import compilers as compiles
from codegen.verify.outcomes import Effort, Verdict
from tests.verify import builds, planted


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "grid", "precision"),
    [("tracking", "even", "single"), ("pi", "uneven", "double")],
)
def test_a_build_compiles_cleanly(kind: Kind, grid: str, precision: Precision) -> None:
    subject = planted.subject_of(builds.made(kind, grid, precision=precision))
    outcome = compiles.check(subject, Effort(quick=True))
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    figures, pairs = outcome.figures, outcome.figures["mixtures"]
    for names in figures["needed_of_others"].values():
        needed = {name for name in names if not name.startswith(("mem", "__aeabi_"))}
        assert needed == set(subject.manifest["dynamics_library_functions"])
    assert figures["mixtures_refused"] == pairs == len(compilers.mixtures(subject))
    assert outcome.figure == f"0 findings in {len(figures['compilations'])} compilations and {pairs} mixtures of builds"

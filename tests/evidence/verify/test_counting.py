"""Tests of `counting` that take seconds each."""

from __future__ import annotations

from codegen.verify.budgets.cycles import REFILL
from tests.verify.test_counting import NOPS, counter, nops, started, steps


def test_more_instructions_are_counted_exactly() -> None:
    """A nop is one instruction and one cycle. A jump refills the pipeline. The limiter has a share of its own."""
    before = steps(counter())
    jump = '    __asm__ volatile ("b 1f; nop; 1:");\n'
    for function, jumps, in_limiter in (("ars_limiter_step", 0, NOPS), ("ars_controller_step", 1, 0)):
        after = steps(started(function, nops() + jump * jumps))
        assert (after.instructions - before.instructions).tolist() == [NOPS + jumps] * 4
        assert (after.cycles - before.cycles).tolist() == [NOPS + jumps * (1 + REFILL)] * 4
        assert (after.limiter - before.limiter).tolist() == [in_limiter] * 4

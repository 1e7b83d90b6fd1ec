"""A sample of random packets to the slave under AddressSanitizer and UndefinedBehaviorSanitizer.

The long run, with faults that it finds, is tests/evidence/drives/test_xcp_random.py.
"""

from pathlib import Path

import pytest

from tests.xcp.checks import run_random_packets
from tests.xcp.slave import COMMANDS, ERRORS, Objects


def test_no_crash_no_write_outside_and_nothing_invalid(program: Path) -> None:
    """Every error occurs, every command but three rare ones succeeds, and lists of measurements run."""
    seen, measured = run_random_packets(program, 2_000)
    assert {*COMMANDS, *ERRORS.values()} - set(seen) <= {"SYNCH", "GET_CAL_PAGE", "SHORT_UPLOAD"}
    assert measured > 100


def test_a_fault_is_found(objects: Objects) -> None:
    """The slave no longer checks that the calibration is valid after a download."""
    faulty = objects.program("faulty", (" && !self->setup.is_valid()) {", " && false) {"))
    with pytest.raises(AssertionError, match="the controller would run with what is not valid"):
        run_random_packets(faulty, 2_000)

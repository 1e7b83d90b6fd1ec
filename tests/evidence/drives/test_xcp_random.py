"""10,000 random packets to the XCP slave under sanitizers, and faults of the slave that they find."""

import pytest

from tests.xcp.checks import run_random_packets
from tests.xcp.slave import COMMANDS, ERRORS, Objects


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> Objects:
    return Objects(tmp_path_factory.mktemp("xcp"))


def test_no_crash_no_write_outside_and_nothing_invalid(objects: Objects) -> None:
    """Every command succeeds, every error occurs, and lists of measurements run."""
    seen, measured = run_random_packets(objects.program())
    assert {*COMMANDS, *ERRORS.values()} - {"SYNCH"} - set(seen) == set()
    assert seen["DOWNLOAD"] > 200 and seen["PAGE_NOT_VALID"] > 50 and measured > 200


@pytest.mark.long
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("return (address >= base) && (size <= base_size) && ", "return (address >= base) && "),
        ("(size > (uint8_t)ARS_XCP_UPLOAD_MAX)", "(size > 200u)"),
        ("return (index < self->daq_count) ? &self->daqs[index] : NULL;", "return &self->daqs[index];"),
        ("(uint32_t)count) > (uint32_t)ARS_XCP_ODT_MAX) {", "(uint32_t)count) > 5000u) {"),
        ("((size_of(odt) + stamp) <= (uint32_t)ARS_XCP_ENTRY_MAX)", "(stamp <= 2u)"),
        ("complete = complete && (odt->entries[n].from != NULL);", ""),
        ("(void)memcpy(to, before, size);", ""),
        ("is_calibration(self, self->address, size)\n            && ", ""),
        ("page_of(self, (uint8_t)ARS_XCP_PAGE_WORKING);\n", "&self->setup.working[1];\n"),
    ],
)
def test_a_fault_is_found(objects: Objects, old: str, new: str) -> None:
    with pytest.raises(AssertionError):
        run_random_packets(objects.program("faulty", (old, new)))

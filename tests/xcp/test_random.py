"""10,000 random packets to the slave under AddressSanitizer and UndefinedBehaviorSanitizer, and faults that they find."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.xcp.checks import run_random_packets
from tests.xcp.slave import COMMANDS, ERRORS, Objects


def test_no_crash_no_write_outside_and_nothing_invalid(program: Path) -> None:
    """And they are worth it: each command did its work, each error was given, lists of measurements ran."""
    seen, measured = run_random_packets(program)
    assert {*COMMANDS, *ERRORS.values()} - {"SYNCH"} - set(seen) == set()
    assert seen["DOWNLOAD"] > 200
    assert seen["ERR_PAGE_NOT_VALID"] > 50
    assert measured > 200


FAULTS = {
    "bound of an address": ("return (address >= base) && (size <= base_size) && ", "return (address >= base) && "),
    "bound of an upload": ("(size > (uint8_t)ARS_XCP_UPLOAD_MAX)", "(size > 200u)"),
    "length of a packet": ("(length <= (uint8_t)ARS_XCP_LENGTH_MAX)", "(length <= 200u)"),
    "bound of a list": ("return (index < self->daq_count) ? &self->daqs[index] : NULL;", "return &self->daqs[index];"),
    "bound of the lists": ("if (count > (uint16_t)ARS_XCP_DAQ_MAX) {", "if (count > 5000u) {"),
    "bound of the packets": ("(uint32_t)count) > (uint32_t)ARS_XCP_ODT_MAX) {", "(uint32_t)count) > 5000u) {"),
    "bound of the entries": ("if (count > (uint8_t)ARS_XCP_ENTRY_MAX) {", "if (count > 200u) {"),
    "room for the timestamp": ("((size_of(odt) + stamp) <= (uint32_t)ARS_XCP_ENTRY_MAX)", "(stamp <= 2u)"),
    "an entry that was not written": ("complete = complete && (odt->entries[n].from != NULL);", ""),
    "validity of a download": (" && !self->setup.is_valid()) {", " && false) {"),
    "taking back": ("(void)memcpy(to, before, size);", ""),
    "validity of a page": ("if (setup->is_valid()) {", "if (true) {"),
    "the page that was": (
        "(void)memcpy(setup->calibration, setup->reference, setup->calibration_size);\n            result",
        "result",
    ),
    "where it may write": ("is_calibration(self, self->address, size)\n            && ", ""),
    "which page it may write": (
        "page_of(self, (uint8_t)ARS_XCP_PAGE_WORKING)[offset]",
        "page_of(self, (uint8_t)ARS_XCP_PAGE_REFERENCE)[offset]",
    ),
    "which page a copy may write": (
        "page_of(self, (uint8_t)ARS_XCP_PAGE_WORKING);\n",
        "&self->setup.working[1];\n",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_seen(objects: Objects, name: str) -> None:
    faulty = objects.program(f"faulty_{list(FAULTS).index(name)}", FAULTS[name])
    with pytest.raises(AssertionError):
        run_random_packets(faulty)

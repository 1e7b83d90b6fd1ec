"""10,000 random packets to the XCP slave under sanitizers, and faults of the slave that they or the command tests find."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.xcp import test_commands as commands
from tests.xcp.checks import run_random_packets
from tests.xcp.slave import COMMANDS, ERRORS, Objects, Slave


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> Objects:
    return Objects(tmp_path_factory.mktemp("xcp"))


def test_no_crash_no_write_outside_and_nothing_invalid(objects: Objects) -> None:
    """Every command succeeds, every error occurs, and lists of measurements run."""
    seen, measured = run_random_packets(objects.program())
    assert {*COMMANDS, *ERRORS.values()} - {"SYNCH"} - set(seen) == set()
    assert seen["DOWNLOAD"] > 200
    assert seen["PAGE_NOT_VALID"] > 50
    assert measured > 200


def by(check: Callable[[Slave], None]) -> Callable[[Path], None]:
    """Run a test of the commands on a program."""

    def run(program: Path) -> None:
        with Slave(program) as slave:
            slave.positive("CONNECT", 0)
            check(slave)

    return run


RANDOM = [
    ("return (address >= base) && (size <= base_size) && ", "return (address >= base) && "),
    ("(size > (uint8_t)ARS_XCP_UPLOAD_MAX)", "(size > 200u)"),
    ("(length <= (uint8_t)ARS_XCP_LENGTH_MAX)", "(length <= 200u)"),
    ("return (index < self->daq_count) ? &self->daqs[index] : NULL;", "return &self->daqs[index];"),
    ("if (count > (uint16_t)ARS_XCP_DAQ_MAX) {", "if (count > 5000u) {"),
    ("(uint32_t)count) > (uint32_t)ARS_XCP_ODT_MAX) {", "(uint32_t)count) > 5000u) {"),
    ("if (count > (uint8_t)ARS_XCP_ENTRY_MAX) {", "if (count > 200u) {"),
    ("((size_of(odt) + stamp) <= (uint32_t)ARS_XCP_ENTRY_MAX)", "(stamp <= 2u)"),
    ("complete = complete && (odt->entries[n].from != NULL);", ""),
    (" && !self->setup.is_valid()) {", " && false) {"),
    ("(void)memcpy(to, before, size);", ""),
    ("if (setup->is_valid()) {", "if (true) {"),
    ("(void)memcpy(setup->calibration, setup->reference, setup->calibration_size);\n            result", "result"),
    ("is_calibration(self, self->address, size)\n            && ", ""),
    ("page_of(self, (uint8_t)ARS_XCP_PAGE_WORKING)[offset]", "page_of(self, (uint8_t)ARS_XCP_PAGE_REFERENCE)[offset]"),
    ("page_of(self, (uint8_t)ARS_XCP_PAGE_WORKING);\n", "&self->setup.working[1];\n"),
]
BY_COMMANDS = [
    (commands.test_switching, "&& (self->master_page == (uint8_t)ARS_XCP_PAGE_WORKING)) {", ") {"),
    (
        commands.test_copying_and_a_page_that_is_not_valid,
        "if (in->data[4] != (uint8_t)ARS_XCP_PAGE_WORKING) {",
        "if (false) {",
    ),
    (commands.test_a_list_is_sampled_with_each_run, "daq->waiting = daq->prescaler;", "daq->waiting = 1u;"),
    (commands.test_checksum, "0xEDB88320u", "0xEDB88321u"),
    (commands.test_reading, "(uint8_t)(size + 1u);\n    self->address += size;", "(uint8_t)(size + 1u);"),
    (commands.test_frames_may_be_padded_and_must_not_be_short, "(in->length >= commands[k].length)", "true"),
    (commands.test_other_commands_are_unknown, "result = (uint8_t)ERR_CMD_UNKNOWN;", "result = (uint8_t)DONE;"),
    (
        commands.test_the_active_page_is_measured,
        "result = &self->setup.calibration[address - self->setup.calibration_address];",
        "",
    ),
]
FAULTS = [*((run_random_packets, *change) for change in RANDOM), *((by(check), *change) for check, *change in BY_COMMANDS)]


@pytest.mark.long
@pytest.mark.parametrize(("check", "old", "new"), FAULTS)
def test_a_fault_is_found(objects: Objects, check: Callable[[Path], object], old: str, new: str) -> None:
    faulty = objects.program("faulty", (old, new))
    with pytest.raises(AssertionError):
        check(faulty)

"""10,000 random packets to the XCP slave under sanitizers, and faults of the slave that they or the command tests find."""

import inspect
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
    assert seen["DOWNLOAD"] > 200 and seen["PAGE_NOT_VALID"] > 50 and measured > 200


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
    ("&& (self->master_page == (uint8_t)ARS_XCP_PAGE_WORKING)) {", ") {"),
    ("if (in->data[4] != (uint8_t)ARS_XCP_PAGE_WORKING) {", "if (false) {"),
    ("daq->waiting = daq->prescaler;", "daq->waiting = 1u;"),
    ("0xEDB88320u", "0xEDB88321u"),
    ("(uint8_t)(size + 1u);\n    self->address += size;", "(uint8_t)(size + 1u);"),
    ("(in->length >= commands[k].length)", "true"),
    ("result = (uint8_t)ERR_CMD_UNKNOWN;", "result = (uint8_t)DONE;"),
    ("result = &self->setup.calibration[address - self->setup.calibration_address];", ""),
]


def run_command_tests(program: Path) -> None:
    for name, check in vars(commands).items():
        if name.startswith("test_") and [*inspect.signature(check).parameters] == ["slave"]:
            with Slave(program) as slave:
                slave.positive("CONNECT", 0)
                check(slave)


@pytest.mark.long
@pytest.mark.parametrize(
    ("check", "fault"),
    [*((run_random_packets, fault) for fault in RANDOM), *((run_command_tests, fault) for fault in BY_COMMANDS)],
)
def test_a_fault_is_found(objects: Objects, check: Callable[[Path], object], fault: tuple[str, str]) -> None:
    faulty = objects.program("faulty", fault)
    with pytest.raises(AssertionError):
        check(faulty)

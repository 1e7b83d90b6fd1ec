"""Checks of the generated self-test in isolation: stubs that can return wrong results replace everything it calls.

It is linked separately, because the case contains the real functions.
"""

import ctypes
import math
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from codegen.sil.compile import derive_cdef, parsed_ffi
from tests.sil.case import Case
from tests.sil.library import Compiler

PATH = "src/ars_selftest.c"
ROW = re.compile(r"\{ (\S+)f, (\S+)f, (\S+)f, (\S+)f \}")
TOLERANCE = 1e-5
"""rad/s, from the self-test's comment."""

HEADER = """
#include "ars_controller.h"
#include "ars_e2e.h"
#include "ars_map.h"

enum { STUB_ROWS_MAX = 64 };

/* Results of the stubs: parts of the checksum, the validity of the parameters, errors in the CRC of frames whose second byte is
 * 0 and 1, and the lookup's points with their results. */
typedef struct {
    uint32_t map_crc;
    uint32_t parameters_crc; /* XOR with the start value; that of the curves is zero */
    bool valid;
    uint8_t crc_error[2];
    uint8_t crc_error_of; /* last byte of frames whose second byte is 1: zero for none */
    uint32_t rows;
    uint32_t asked;
    float known[STUB_ROWS_MAX][4];
} stub_t;

extern stub_t stub;
void stub_clear(void);
void stub_expect(uint32_t checksum);
"""
SOURCE = """
#include "stub.h"

#include <math.h>
#include <string.h>

stub_t stub;
const ars_parameters_t ars_parameters_default = { 0 };

void stub_clear(void)
{
    memset(&stub, 0, sizeof(stub));
}

uint32_t ars_map_crc(uint32_t start)
{
    return (start == 0xFFFFFFFFu) ? stub.map_crc : 0u;
}

uint32_t ars_parameters_crc(uint32_t start)
{
    return start ^ stub.parameters_crc;
}

uint32_t ars_reference_model_crc(uint32_t start);
uint32_t ars_reference_model_crc(uint32_t start)
{
    return start;
}

bool ars_parameters_valid(const ars_parameters_t *parameters)
{
    return (parameters == &ars_parameters_default) && stub.valid;
}

/* Bit by bit, as in the specification. */
uint8_t ars_e2e_crc(uint16_t data_id, const uint8_t data[8])
{
    uint8_t bytes[9] = { (uint8_t)(data_id & 0xFFu), (uint8_t)(data_id >> 8u) };
    unsigned int crc = 0u;

    memcpy(&bytes[2], &data[1], 7u);
    for (unsigned int k = 0u; k < 9u; k++) {
        crc ^= bytes[k];
        for (unsigned int bit = 0u; bit < 8u; bit++) {
            crc = ((crc & 0x80u) != 0u) ? ((crc << 1u) ^ 0x1Du) : (crc << 1u);
        }
    }
    if ((stub.crc_error_of != 0u) && (data[1] == 1u) && (data[7] == stub.crc_error_of)) {
        crc ^= 1u;
    }
    return (uint8_t)(crc ^ ((data[1] < 2u) ? stub.crc_error[data[1]] : 0u));
}

float ars_map_yaw_rate_on_road(float speed, float front_angle, float friction)
{
    stub.asked++;
    for (uint32_t k = 0u; k < stub.rows; k++) {
        if ((stub.known[k][0] == speed) && (stub.known[k][1] == front_angle) && (stub.known[k][2] == friction)) {
            return stub.known[k][3];
        }
    }
    return NAN;
}
"""
EXPECTED = """
#include <stdint.h>

/* Calibration: constant for the code under test, changed here for each check. */
uint32_t ars_calibration_expected_checksum = 0u;
void stub_expect(uint32_t checksum);

void stub_expect(uint32_t checksum)
{
    ars_calibration_expected_checksum = checksum;
}
"""
STUBS = {"stub/stub.h": HEADER, "stub/stub.c": SOURCE, "stub/expected.c": EXPECTED}
EXPECTED_CHECKSUM = 0x5AC3F00D
"""Expected checksum of the whole calibration."""
FROZEN = 0x12345678
"""Checksum of a map other than the build's own."""


@dataclass(frozen=True)
class IsolatedSelftest:
    """Self-test linked with its stubs, the points it looks up (speed, front angle, friction, yaw rate), and the checksum of the
    build's own map."""

    lib: Any
    rows: list[tuple[float, ...]]
    checksum: int


def passes_with(
    selftest: IsolatedSelftest, rows: list[tuple[float, ...]], map_checksum: int | None = None, **wrong: Any
) -> bool:
    """Return the self-test's verdict with everything right except `wrong`; the map is the build's own unless a checksum is
    given."""
    stub, map_checksum = selftest.lib.stub, selftest.checksum if map_checksum is None else map_checksum
    selftest.lib.stub_clear()
    selftest.lib.stub_expect(EXPECTED_CHECKSUM)
    stub.map_crc, stub.valid, stub.rows = map_checksum ^ 0xFFFFFFFF, True, len(rows)
    stub.parameters_crc = map_checksum ^ EXPECTED_CHECKSUM
    for k, row in enumerate(rows):
        stub.known[k] = row
    for name, value in wrong.items():
        setattr(stub, name, value)
    return bool(selftest.lib.ars_selftest())


def _passes(selftest: IsolatedSelftest) -> None:
    """Check that it passes when everything is right, and looks up every point."""
    assert len(selftest.rows) >= 10
    assert passes_with(selftest, selftest.rows)
    assert selftest.lib.stub.asked == len(selftest.rows)
    assert selftest.lib.ars_calibration_checksum() == EXPECTED_CHECKSUM


def _detects_each_fault(selftest: IsolatedSelftest) -> None:
    """Check that each fault alone makes it fail."""
    right = selftest.checksum ^ EXPECTED_CHECKSUM
    of_parameters = [right ^ 1, right ^ 0x80000000, right ^ 0xFFFFFFFF]
    of_map = [number ^ 0xFFFFFFFF for number in (selftest.checksum ^ 1, selftest.checksum ^ 0x80000000, 0, 0xFFFFFFFF)]
    crc_errors = [[first << bit, second << bit] for bit in range(8) for first, second in ((1, 0), (0, 1), (1, 1))]
    bytes_of_table = [1, 2, 127, 128, 254, 255]
    faults = {"parameters_crc": of_parameters, "map_crc": of_map, "valid": [False]}
    faults |= {"crc_error": crc_errors, "crc_error_of": bytes_of_table}
    for name, values in faults.items():
        assert not any(passes_with(selftest, selftest.rows, **{name: value}) for value in values), name


def _detects_each_wrong_point(selftest: IsolatedSelftest) -> None:
    """Check each point on both sides of the tolerance; where the result is zero, to the last bit."""
    tolerance = float(np.float32(TOLERANCE))
    for k, (*place, yaw_rate) in enumerate(selftest.rows):
        exact = yaw_rate == 0.0
        inside, beyond = (0.98 * tolerance, 1.02 * tolerance) if not exact else (
            tolerance, float(np.nextafter(np.float32(tolerance), np.float32(1.0)))
        )  # fmt: skip
        for side in (1.0, -1.0):
            for off, passes in ((inside, True), (beyond, False), (math.nan, False), (math.inf, False)):
                changed = [*selftest.rows[:k], (*place, float(np.float32(yaw_rate + side * off))), *selftest.rows[k + 1 :]]
                assert passes_with(selftest, changed) == passes, (k, side * off)


def _accepts_another_calibration(selftest: IsolatedSelftest) -> None:
    """Check that a recalibrated map with a frozen checksum is not compared with the build's own values; everything else is
    still checked."""
    nothing = [(*place, math.nan) for *place, _ in selftest.rows]
    assert passes_with(selftest, nothing, FROZEN)
    assert selftest.lib.stub.asked == 0
    for wrong in ({"parameters_crc": 0}, {"valid": False}, {"crc_error": [1, 0]}):
        assert not passes_with(selftest, nothing, FROZEN, **wrong)


NUMBER = r"-?[0-9][0-9.e+-]*f"
DAMAGED = (
    ("src/ars_calibration.c", rf"(\.(?:proportional_gain|standby_rate) = (?:\{{\s*)?){NUMBER}", r"\g<1>1.1f"),
    ("src/ars_calibration.c", r"(\.missing_samples_max = )\d+u", r"\g<1>7u"),
    ("src/ars_calibration.c", rf"(\.in_phase_from_front_angle = ){NUMBER}", r"\g<1>0.123f"),
    ("src/ars_calibration.c", rf"(_yaw_rate_table.*=\s*\{{[^}}]*?0\.0f, ){NUMBER}", r"\g<1>0.0123f"),
    ("src/ars_reference_model.c", rf"(front_values\[.*\{{\s+0\.0f, ){NUMBER}", r"\g<1>0.0123f"),
    ("src/ars_reference_model.c", rf"(rear_compression = ){NUMBER}", r"\g<1>3.0f"),
)
"""Unit, pattern and replacement of one of its numbers: a gain, a count, a limiter parameter, the map, the tyre curves.

Every replacement is within its range.
"""


def _detects_damage(case: Case) -> None:
    """Check that a damaged but valid number fails the self-test of the whole build."""
    root, tree, files = case.tree.root, case.tree, case.built.folder.files
    with tempfile.TemporaryDirectory(dir=root) as scratch:
        for index, (path, number, other) in enumerate(DAMAGED):
            if path not in files:
                continue
            text, count = re.subn(number, other, files[path].decode("ascii"), count=1)
            assert count == 1, number
            assert text.encode("ascii") != files[path], number
            changed = Path(scratch) / f"{index}.c"
            changed.write_text(text, encoding="ascii")
            case.compiler.compile(root, str(changed.relative_to(root)), changed.with_suffix(".o"))
            objects = [changed.with_suffix(".o") if unit == path else tree.object(unit) for unit in tree.units]
            case.compiler.link(objects, changed.with_suffix(".so"))
            library = ctypes.CDLL(str(changed.with_suffix(".so")))
            library.ars_selftest.restype = ctypes.c_bool
            library.ars_parameters_valid.restype = ctypes.c_bool
            assert library.ars_parameters_valid(ctypes.byref(ctypes.c_byte.in_dll(library, "ars_parameters_default"))), number
            assert not library.ars_selftest(), number


def check_selftest(case: Case) -> None:
    """Run all checks of the self-test; with the rest of the build it must pass."""
    assert case.built.software.selftest()
    if case.mutated is None:
        _detects_damage(case)
    root, compiler, text = case.tree.root, case.compiler, case.built.folder.files[PATH].decode("ascii")
    if "stubs" not in case.kept:
        case.kept["stubs"] = _compile_stubs(root, compiler)
    (checksum,) = re.findall(r"~map_crc\)? [=!]= 0x([0-9A-F]{8})u", text)
    rows = [tuple(float(np.float32(number)) for number in found) for found in ROW.findall(text)]
    with tempfile.TemporaryDirectory(dir=root) as scratch:
        path, ffi = Path(scratch) / "selftest.so", case.kept["stubs"]
        compiler.link([case.object(PATH), root / "stub/stub.o", root / "stub/expected.o"], path)
        selftest = IsolatedSelftest(ffi.dlopen(str(path)), rows, int(checksum, 16))
        if case.mutated is not None and case.mutated.path == PATH:
            case.select_in(path)
        try:
            for check in (_passes, _detects_each_fault, _detects_each_wrong_point, _accepts_another_calibration):
                check(selftest)
        finally:
            ffi.dlclose(selftest.lib)  # coverage counts are written here


def _compile_stubs(root: Path, compiler: Compiler) -> Any:
    """Compile the stubs; return the FFI with their types."""
    (root / "stub").mkdir(exist_ok=True)
    for path, text in STUBS.items():
        (root / path).write_text(text, encoding="ascii")
    for name in ("stub", "expected"):
        compiler.compile(root, f"stub/{name}.c", root / f"stub/{name}.o", ("-Istub",))
    return parsed_ffi(derive_cdef([Path("stub/stub.h")], ("include", "stub"), for_dlopen=True, folder=root))

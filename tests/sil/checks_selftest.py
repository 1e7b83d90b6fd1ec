"""What must hold of the generated self-test alone: all that it asks of the others is answered by stand-ins that can be wrong.

Each check takes the library of the self-test and its stand-ins and raises AssertionError where it does not hold.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from codegen.emit.folder import Folder
from codegen.sil.compile import Library

PATH = "src/ars_selftest.c"
ROW = re.compile(r"\{ (\S+)f, (\S+)f, (\S+)f, (\S+)f \}")
TOLERANCE = 1e-5
"""rad/s, as the self-test's own comment says."""

HEADER = """
#include "ars_controller.h"
#include "ars_e2e.h"
#include "ars_map.h"

enum { STUB_ROWS_MAX = 64 };

/* What the stand-ins answer: the checksum, the verdict on the parameters, what is wrong with the CRC of frames whose second
 * byte is 0 and 1, and the lookup's places with their answers. */
typedef struct {
    uint32_t checksum;
    bool valid;
    uint8_t crc_error[2];
    uint8_t crc_error_of; /* last byte of frames whose second byte is 1: zero for none */
    uint32_t rows;
    uint32_t asked;
    float known[STUB_ROWS_MAX][4];
} stub_t;

extern stub_t stub;
void stub_clear(void);
"""
SOURCE = """
#include "stub.h"

#include <math.h>
#include <string.h>

stub_t stub;
const uint32_t ars_map_expected_checksum = 0x12345678u;
const ars_parameters_t ars_parameters_default = { 0 };

void stub_clear(void)
{
    memset(&stub, 0, sizeof(stub));
}

uint32_t ars_map_checksum(void)
{
    return stub.checksum;
}

bool ars_parameters_valid(const ars_parameters_t *parameters)
{
    return (parameters == &ars_parameters_default) && stub.valid;
}

/* Bit by bit, as the specification has it. */
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


def rows_of(folder: Folder) -> list[tuple[float, ...]]:
    """Speed, front angle, friction and yaw rate of each place that the self-test asks for."""
    text = folder.files[PATH].decode("ascii")
    return [tuple(float(np.float32(number)) for number in found) for found in ROW.findall(text)]


def answer(library: Library, rows: list[tuple[float, ...]], **wrong: Any) -> bool:
    """What the self-test says where all is right but for what is given."""
    library.lib.stub_clear()
    stub = library.lib.stub
    stub.checksum, stub.valid, stub.rows = 0x12345678, True, len(rows)
    for k, row in enumerate(rows):
        stub.known[k] = row
    for name, value in wrong.items():
        setattr(stub, name, value)
    return bool(library.lib.ars_selftest())


def check_selftest_passes(library: Library, rows: list[tuple[float, ...]]) -> None:
    """Where all is right it says so, and it asks for every place."""
    assert len(rows) >= 10
    assert answer(library, rows)
    assert library.lib.stub.asked == len(rows)


def check_selftest_sees_each_fault(library: Library, rows: list[tuple[float, ...]]) -> None:
    """Each thing alone makes it fail."""
    for checksum in (0x12345679, 0x92345678, 0, 0xFFFFFFFF):
        assert not answer(library, rows, checksum=checksum)
    assert not answer(library, rows, valid=False)
    for bit in range(8):
        assert not answer(library, rows, crc_error=[1 << bit, 0])
        assert not answer(library, rows, crc_error=[0, 1 << bit])
        assert not answer(library, rows, crc_error=[1 << bit, 1 << bit])
    for byte in (1, 2, 127, 128, 254, 255):
        assert not answer(library, rows, crc_error_of=byte), "one entry of the table"


def check_selftest_sees_each_place(library: Library, rows: list[tuple[float, ...]]) -> None:
    """Each place is judged, to both sides of the tolerance; where the answer is zero, to the last bit of it."""
    tolerance = float(np.float32(TOLERANCE))
    for k, (*place, yaw_rate) in enumerate(rows):
        exact = yaw_rate == 0.0
        inside, beyond = (0.98 * tolerance, 1.02 * tolerance) if not exact else (
            tolerance, float(np.nextafter(np.float32(tolerance), np.float32(1.0)))
        )  # fmt: skip
        for side in (1.0, -1.0):
            for off, passes in ((inside, True), (beyond, False), (math.nan, False), (math.inf, False)):
                changed = [*rows[:k], (*place, float(np.float32(yaw_rate + side * off))), *rows[k + 1 :]]
                assert answer(library, changed) == passes, (k, side * off)


CHECKS = (check_selftest_passes, check_selftest_sees_each_fault, check_selftest_sees_each_place)

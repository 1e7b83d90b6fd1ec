"""Chosen breakpoints and int16 tables through what verifies a build: the reference that reads the C, and the MISRA findings."""

from __future__ import annotations

import functools
import math
import re

import numpy as np
import pytest

from codegen.config import Kind
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder
from codegen.refmap.lookup import Lookup
from codegen.refmap.place import Request, choose
from codegen.verify.analysis.check import check as analyse
from codegen.verify.check import Effort, Subject, Verdict
from codegen.verify.map_reference import lookup_of
from tests import builds

REQUEST = Request(math.radians(0.5), None, "int16", "--max-error 0.5deg/s --storage int16")


@functools.cache
def made(kind: Kind) -> Folder:
    options = BuildOptions("sample", request=REQUEST)
    return build(builds.paper_map(), builds.CONFIGS[kind], options, BuildInputs("sample.npz", "0" * 64, "preset"))


@pytest.mark.parametrize("kind", ["pi", "tracking"])
def test_the_reference_that_reads_the_c_has_the_numbers_of_the_map(kind: Kind) -> None:
    folder = made(kind)
    found = lookup_of(Subject("sample", folder.files, folder.manifest))
    total = choose(builds.paper_map(), builds.CONFIGS[kind], REQUEST, 2 if kind == "tracking" else 1, np.float32).total
    wanted = Lookup.from_map(total)
    np.testing.assert_array_equal(found.tables, wanted.tables)
    if kind == "tracking":
        np.testing.assert_array_equal(found.rear_tables, wanted.rear_tables)


def test_misra_finds_what_the_deviations_list_and_no_more() -> None:
    folder = made("tracking")
    outcome = analyse(Subject("sample", folder.files, folder.manifest), Effort(quick=True))
    assert outcome.verdict is Verdict.PASSED, outcome.findings


def test_the_a2l_has_raw_tables_with_their_scales() -> None:
    folder = made("tracking")
    text, storage = folder.files["ars.a2l"].decode("ascii"), folder.manifest["map"]["storage"]
    for name, key in (("yaw_rate", "scale_rad_s"), ("rear_angle", "scale_rad")):
        method = re.search(rf"COMPU_METHOD ars\.raw_{name} .* LINEAR .*\n\s+COEFFS_LINEAR (\S+) 0\n", text)
        assert method is not None
        assert np.float32(method[1]) == np.float32(storage[name][key])
        table = re.search(rf"CHARACTERISTIC ars\.map\.{name} .*?ars_RAW_FUNCTION 0 (\S+) (\S+) (\S+)\n", text, re.DOTALL)
        assert table is not None
        assert table[1] == f"ars.raw_{name}"
        assert float(table[3]) == pytest.approx(32767 * storage[name][key], rel=1e-6)
    assert re.search(r"RECORD_LAYOUT ars_RAW_FUNCTION\n\s+FNC_VALUES 1 SWORD ROW_DIR DIRECT\n", text)


def test_no_double_in_the_c_of_raw_tables() -> None:
    for path, content in made("tracking").files.items():
        if path.startswith(("src/ars_map", "src/ars_calibration", "include/ars_map")):
            assert b"double" not in content

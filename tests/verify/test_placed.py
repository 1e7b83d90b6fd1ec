"""The lookup that the checks read from the C: chosen breakpoints with int16 tables, and a map for several frictions."""

from __future__ import annotations

import functools
import math
import re

import numpy as np
import pytest

from codegen.emit.folder import Folder
from codegen.refmap.lookup import Lookup
from codegen.refmap.place import Request, choose
from codegen.verify.map_reference import lookup_of
from tests import builds
from tests.verify import builds as verify_builds
from tests.verify import planted

REQUEST = Request(math.radians(0.5), None, "int16", "--max-error 0.5deg/s --storage int16")


@functools.cache
def made() -> Folder:
    return verify_builds.build_of(builds.paper_map(), builds.TRACKING_CONFIG, request=REQUEST)


def test_int16_tables_are_read_with_their_scales() -> None:
    found = lookup_of(planted.subject_of(made()))
    wanted = Lookup.from_map(choose(builds.paper_map(), builds.TRACKING_CONFIG, REQUEST, 2, np.float32).total)
    np.testing.assert_array_equal(found.tables, wanted.tables)
    np.testing.assert_array_equal(found.rear_tables, wanted.rear_tables)


def test_the_caps_of_a_stack_are_read_from_the_c() -> None:
    lookup = lookup_of(planted.subject_of(verify_builds.made("tracking", "uneven", layers=True)))
    assert lookup.tables.shape == lookup.rear_tables.shape == (4, 9, 10)
    assert lookup.caps.tolist() == sorted(lookup.caps.tolist())
    assert lookup.lateral_acceleration_cap_per_friction == pytest.approx(lookup.caps[0] / 0.3, rel=1e-6)  # single precision


def test_the_a2l_has_raw_tables_with_their_scales_and_the_c_no_double() -> None:
    folder = made()
    text, storage = folder.files["ars.a2l"].decode("ascii"), folder.manifest["map"]["storage"]
    for name, key in (("yaw_rate", "scale_rad_s"), ("rear_angle", "scale_rad")):
        method = re.search(rf"COMPU_METHOD ars\.raw_{name} .* LINEAR .*\n\s+COEFFS_LINEAR (\S+) 0\n", text)
        assert method is not None
        assert np.float32(method[1]) == np.float32(storage[name][key])
        table = re.search(rf"CHARACTERISTIC ars\.map\.{name} .*?ars_RAW_FUNCTION 0 (\S+) (\S+) (\S+)\n", text, re.DOTALL)
        assert table is not None
        assert table[1] == f"ars.raw_{name}"
        assert float(table[3]) == pytest.approx(32767 * storage[name][key], rel=1e-6)  # printed with seven digits
    assert re.search(r"RECORD_LAYOUT ars_RAW_FUNCTION\n\s+FNC_VALUES 1 SWORD ROW_DIR DIRECT\n", text)
    for path, content in folder.files.items():
        if path.startswith(("src/ars_map", "src/ars_calibration", "include/ars_map")):
            assert b"double" not in content

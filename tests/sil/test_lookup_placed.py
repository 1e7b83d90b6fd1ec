"""Builds with chosen breakpoints, in real numbers and as int16: the C against the NumPy reference, bit for bit."""

from __future__ import annotations

import functools
import math
import re
import zlib
from dataclasses import replace

import numpy as np
import pytest

from codegen.config import Config, Kind
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.text import Precision, numpy_type
from codegen.refmap.map import ReferenceMap
from codegen.refmap.place import Placed, Request, choose
from codegen.refmap.stack import solve_stack
from codegen.refmap.storage import RAW_MAX, Storage, raw_of
from codegen.sil.software import compile_build
from tests.sil import builds, checks_lookup, checks_map_reference
from tests.sil.builds import Built
from tests.sil.relinked import Builds
from tests.sil.units import Units

BOUND = math.radians(0.5)
CASES: tuple[tuple[Kind, Precision, Storage, bool], ...] = (
    ("pi", "single", "float", False),
    ("pi", "single", "int16", False),
    ("pi", "double", "int16", False),
    ("tracking", "single", "int16", False),
    ("tracking", "single", "int16", True),
)


@functools.cache
def stack() -> ReferenceMap:
    return solve_stack(builds.CONFIG, "4ws-2", [0.4, 0.65, 0.9])


@functools.cache
def made(kind: Kind, precision: Precision, storage: Storage, stacked: bool) -> tuple[Built, Placed]:
    """The build, and what `choose` placed for it."""
    reference_map = stack() if stacked else builds.paper_map()
    config: Config = builds.CONFIGS[kind]
    request = Request(BOUND, None, storage, f"--max-error 0.5deg/s --storage {storage}")
    options = BuildOptions("sample", precision=precision, request=request)
    folder = build(reference_map, config, options, BuildInputs("sample.npz", "0" * 64, "preset"))
    placed = choose(reference_map, config, request, 2 if kind == "tracking" else 1, numpy_type(precision))
    return Built(folder, placed.total, compile_build(folder.files, folder.manifest)), placed


@pytest.fixture(scope="module", params=CASES, ids=lambda case: " ".join(map(str, case)))
def both(request: pytest.FixtureRequest) -> tuple[Built, Placed]:
    return made(*request.param)


def test_the_lookup_holds(both: tuple[Built, Placed]) -> None:
    built, _ = both
    checks_lookup.check_same_bits(built)
    checks_lookup.check_finite(built)
    checks_lookup.check_odd_symmetry(built)
    checks_lookup.check_edges(built)
    if not built.total.layers:
        checks_lookup.check_cap(built)
        checks_lookup.check_cap_is_reached(built)
        assert checks_lookup.check_error_bound(built) >= 1.0


@pytest.mark.parametrize("stacked", [False, True])
def test_the_rear_angle_has_the_bits_of_the_reference(stacked: bool) -> None:
    built, placed = made("tracking", "single", "int16", stacked)
    units = Units(built.folder, placed.total, builds.CONFIGS["tracking"])
    checks_map_reference.check_same_bits_as_reference(units)


def numbers_of(built: Built) -> list[np.ndarray]:
    """What the checksum is over, made from the total map."""
    total, real = built.total, built.real
    names = ["yaw_rate", *(["rear_angle"] if built.folder.manifest["options"]["kind"] == "tracking" else [])]
    tables = [np.stack([getattr(layer, name) for layer in total.stack]) for name in names]
    scales = [] if total.scales is None else [getattr(total.scales, name) for name in names]
    stored = [raw_of(table, scale) for table, scale in zip(tables, scales, strict=True)] if scales else tables
    frictions = [layer.friction for layer in total.stack] if total.layers else []
    rest = np.concatenate([scales, frictions, total.speed, total.front_angle]).astype(real)
    return [*(part if scales else part.astype(real) for part in stored), rest]


def test_the_checksum_covers_tables_scales_and_axes(both: tuple[Built, Placed]) -> None:
    built, placed = both
    numbers = numbers_of(built)
    wanted = zlib.crc32(b"".join(part.astype(part.dtype.newbyteorder("<")).tobytes() for part in numbers))
    assert built.software.function("map_checksum")() == built.software.function("map_expected_checksum") == wanted
    facts = built.folder.manifest["map"]
    assert facts["flash_bytes"] == placed.flash_bytes == sum(part.nbytes for part in numbers)


def test_the_selftest_passes_and_the_map_is_valid(both: tuple[Built, Placed]) -> None:
    built, _ = both
    assert built.software.function("selftest")()
    assert built.software.function("map_valid")()


def test_the_manifest_tells_the_request_the_scale_and_the_errors() -> None:
    built, placed = made("tracking", "single", "int16", False)
    facts, options = built.folder.manifest["map"], built.folder.manifest["options"]
    assert (options["max_error_rad_s"], options["max_flash_bytes"], options["storage"]) == (BOUND, None, "int16")
    scales = placed.total.scales
    assert scales is not None
    assert facts["storage"]["yaw_rate"]["scale_rad_s"] == scales.yaw_rate
    assert facts["storage"]["rear_angle"]["scale_rad"] == scales.rear_angle
    assert 0.0 < facts["storage"]["yaw_rate"]["largest_rounding_rad_s"] <= 0.5001 * scales.yaw_rate
    assert placed.error.yaw_rate_whole <= facts["placement"]["error_whole_domain_rad_s"] <= BOUND * 1.001
    assert facts["placement"]["rear_angle_error_rad"] > 0.0
    assert "c" in facts["rules"]


def test_a_build_without_a_request_tells_nothing_of_it() -> None:
    manifest = builds.paper().folder.manifest
    assert manifest["options"].keys() == {"prefix", "precision", "kind"}
    assert not {"placement", "storage"} & manifest["map"].keys()


@functools.cache
def around_int16() -> Builds:
    """What the builds share of which one place differs from the int16 build."""
    return Builds(made("pi", "single", "int16", False)[0].folder)


def spoiled(old: str, new: str, path: str = "src/ars_map.c") -> Built:
    """The int16 build with one place of its C changed."""
    built, _ = made("pi", "single", "int16", False)
    return replace(built, software=around_int16().software(builds.altered_folder(built.folder, path, old, new)))


def test_a_wrong_scale_or_conversion_is_seen() -> None:
    built, _ = made("pi", "single", "int16", False)
    scale = re.search(rb"yaw_rate_scale = ([\d.e+-]+)f;", built.folder.files["src/ars_map.c"])
    assert scale is not None
    other = spoiled(f"yaw_rate_scale = {scale[1].decode()}f", "yaw_rate_scale = 6.0e-5f")
    assert not other.software.function("selftest")()
    unsigned = spoiled("return (float)raw * scale;", "return (float)(raw + 1) * scale;")
    with pytest.raises(AssertionError):
        checks_lookup.check_same_bits(unsigned)
    assert not unsigned.software.function("selftest")()


def test_a_negative_yaw_rate_in_the_table_is_refused() -> None:
    built, _ = made("pi", "single", "int16", False)
    text = built.folder.files["src/ars_calibration.c"].decode("ascii")
    assert text.count(f" {RAW_MAX}") >= 1
    head, _, tail = text.rpartition(f" {RAW_MAX}")
    files = {**built.folder.files, "src/ars_calibration.c": f"{head} -{RAW_MAX}{tail}".encode("ascii")}
    software = around_int16().software(replace(built.folder, files=files))
    assert not software.function("map_valid")()
    assert not software.function("selftest")()

"""Builds with chosen breakpoints, in real numbers and as int16: the C against the NumPy reference, bit for bit."""

from __future__ import annotations

import functools
import math
import re
import zlib
from dataclasses import replace
from typing import Any, Literal
from unittest import mock

import numpy as np
import pytest

from benchmarks.nonlinear_map import nonlinear
from codegen.config import Config, Kind
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.text import Precision
from codegen.refmap import place_grip
from codegen.refmap.lookup import error_bound
from codegen.refmap.map import ReferenceMap
from codegen.refmap.place import Placed, Request, choose
from codegen.refmap.solve import solve_case
from codegen.refmap.stack import solve_stack
from codegen.refmap.storage import RAW_MAX, Storage, raw_of
from codegen.refmap.total import GripTable
from codegen.sil.software import compile_build
from tests import builds
from tests.builds import Built
from tests.sil import checks_lookup, checks_map_reference
from tests.sil.relinked import Builds
from tests.sil.units import Units

BOUND = math.radians(0.5)
Which = Literal["linear", "stack", "nonlinear", "nonlinear stack"]
CASES: tuple[tuple[Kind, Precision, Storage, Which], ...] = (
    ("pi", "single", "float", "linear"),
    ("pi", "single", "int16", "linear"),
    ("pi", "double", "int16", "linear"),
    ("tracking", "single", "int16", "linear"),
    ("tracking", "single", "int16", "stack"),
    ("pi", "single", "float", "nonlinear"),
    ("tracking", "double", "float", "nonlinear stack"),
    ("tracking", "single", "int16", "nonlinear stack"),
)


@functools.cache
def map_of(which: Which) -> ReferenceMap:
    if which == "linear":
        return builds.paper_map()
    config = nonlinear(builds.CONFIG, "4ws-2") if which.startswith("nonlinear") else builds.CONFIG
    if which == "nonlinear":
        return solve_case(config, "4ws-2")
    return solve_stack(config, "4ws-2", [0.4, 0.65, 0.9])


@functools.cache
def made(kind: Kind, precision: Precision, storage: Storage, which: Which = "linear") -> tuple[Built, Placed]:
    """The build, and what `choose` placed for it; with the nonlinear tyre on a coarser grid than it has else."""
    with mock.patch.object(place_grip, "HALVINGS", 1):
        return _made(map_of(which), kind, precision, storage)


def _made(reference_map: ReferenceMap, kind: Kind, precision: Precision, storage: Storage) -> tuple[Built, Placed]:
    config: Config = builds.CONFIGS[kind]
    request = Request(BOUND, None, storage, f"--max-error 0.5deg/s --storage {storage}")
    options = BuildOptions("sample", precision=precision, request=request)
    chosen: list[Placed] = []

    def choosing(*asked: Any) -> Placed:
        chosen.append(choose(*asked))
        return chosen[0]

    with mock.patch("codegen.emit.build.choose", choosing):
        folder = build(reference_map, config, options, BuildInputs("sample.npz", "0" * 64, "preset"))
    (placed,) = chosen
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
    if not built.total.layers and built.total.grip is None:
        checks_lookup.check_cap(built)
        checks_lookup.check_cap_is_reached(built)
        assert checks_lookup.check_error_bound(built) >= 1.0


@pytest.mark.parametrize("which", ["linear", "stack", "nonlinear stack"])
def test_the_rear_angle_has_the_bits_of_the_reference(which: Which) -> None:
    built, placed = made("tracking", "single", "int16", which)
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
    numbers += grip_numbers(built)
    wanted = zlib.crc32(b"".join(part.astype(part.dtype.newbyteorder("<")).tobytes() for part in numbers))
    assert built.software.function("map_checksum")() == built.software.function("map_expected_checksum") == wanted
    facts = built.folder.manifest["map"]
    assert facts["flash_bytes"] == placed.flash_bytes == sum(part.nbytes for part in numbers)


def grip_numbers(built: Built) -> list[np.ndarray]:
    """The table of what grip leaves, as the C holds it."""
    grip = built.total.grip
    if grip is None:
        return []
    shares = np.stack([layer.grip.share for layer in built.total.stack if layer.grip is not None])
    axes = np.concatenate([grip.speed, grip.front_angle]).astype(built.real)
    if grip.scale is None:
        return [shares.astype(built.real), axes]
    return [raw_of(shares, grip.scale), np.array([grip.scale], dtype=built.real), axes]


@pytest.mark.parametrize("friction", [math.nan, 0.9, 0.5, 0.2])
def test_what_slip_leaves_is_kept_in_exact_arithmetic(friction: float) -> None:
    """No yaw rate is above the share of the cap that stands at its speed and front angle, and many are at it."""
    built, _ = made("pi", "single", "float", "nonlinear")
    total, grip = built.total, built.total.grip
    assert grip is not None
    rng = np.random.default_rng(5)
    speed, front_angle = (
        rng.uniform(0.3 * axis[-1], axis[-1], 4_000).astype(built.real) for axis in (total.speed, total.front_angle)
    )
    found = built.software.function("map_yaw_rate_on_road")
    share = interpolated_at(grip, speed.astype(np.float64), front_angle.astype(np.float64))
    slippery = 1.0 if math.isnan(friction) else min(friction / total.friction, 1.0)
    allowed = slippery * total.lateral_acceleration_cap * share / speed
    asked = np.array([found(float(v), float(angle), friction) for v, angle in zip(speed, front_angle, strict=True)])
    # Rounding moves a position, and with it a share, as `lookup.error_bound` counts.
    off = error_bound(total, built.real)
    assert (asked <= allowed + off).all()
    assert np.mean(np.abs(asked - allowed) <= off) > 0.5


def interpolated_at(grip: GripTable, speed: np.ndarray, front_angle: np.ndarray) -> np.ndarray:
    """Shares at pairs of a speed and a front angle."""
    corners, weights = [], []
    for axis, x in ((grip.speed, speed), (grip.front_angle, front_angle)):
        cell = np.clip(np.searchsorted(axis, x, side="right") - 1, 0, axis.size - 2)
        corners.append(cell)
        weights.append((x - axis[cell]) / (axis[cell + 1] - axis[cell]))
    (i, j), (u, w) = corners, weights
    table = grip.share
    along = [(1.0 - u) * table[i, j + k] + u * table[i + 1, j + k] for k in (0, 1)]
    return np.asarray((1.0 - w) * along[0] + w * along[1])


@pytest.mark.parametrize("share", ["1.5f", "(0.0f / 0.0f)", "-1.0f"])
def test_a_share_that_a_flash_lost_is_told_and_lifts_no_cap(share: str) -> None:
    """One in the midst of the table: the self-test finds it by the checksum, and until then the cap holds without it."""
    built, _ = made("pi", "single", "float", "nonlinear")
    text = built.folder.files["src/ars_map.c"].decode("ascii")
    begin = text.index("grip_share_table[")
    numbers = list(re.compile(r"\d\.\d+f").finditer(text, begin, text.index("};", begin)))
    lost = numbers[len(numbers) // 2]
    changed = text[: lost.start()] + share + text[lost.end() :]
    software = around("pi", "nonlinear", "float").software(
        replace(built.folder, files={**built.folder.files, "src/ars_map.c": changed.encode("ascii")})
    )
    assert built.software.function("selftest")() and not software.function("selftest")()
    speed, front_angle = np.meshgrid(np.linspace(1.0, 40.0, 120), np.linspace(0.0, 0.7, 120))
    yaw_rate = software.map_yaw_rate(speed.astype(np.float32), front_angle.astype(np.float32))
    assert (yaw_rate * speed <= built.total.lateral_acceleration_cap).all()
    assert (yaw_rate >= 0.0).all()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("road->lateral_acceleration_max * share;", "road->lateral_acceleration_max;"),
        ("locate_grip_speed(speed), locate_grip", "locate_speed(speed), locate_grip"),
        ("interpolate_grip(grip_share_table[road->layer.lower + 1u]", "interpolate_grip(grip_share_table[road->layer.lower]"),
        ("grip_share_scale = ", "grip_share_scale = 1.01f * "),
    ],
)
def test_a_share_that_is_not_applied_or_is_anothers_is_seen(old: str, new: str) -> None:
    with pytest.raises(AssertionError):
        checks_lookup.check_same_bits(spoiled(old, new, "tracking", "nonlinear stack"))


def test_the_selftest_passes_and_the_map_is_valid(both: tuple[Built, Placed]) -> None:
    built, _ = both
    assert built.software.function("selftest")()
    assert built.software.function("map_valid")()


def test_the_manifest_tells_the_request_the_scale_and_the_errors() -> None:
    built, placed = made("tracking", "single", "int16")
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
def around(kind: Kind = "pi", which: Which = "linear", storage: Storage = "int16") -> Builds:
    """What the builds share of which one place differs from a build."""
    return Builds(made(kind, "single", storage, which)[0].folder)


def spoiled(old: str, new: str, kind: Kind = "pi", which: Which = "linear") -> Built:
    """An int16 build with one place of its lookup changed."""
    built, _ = made(kind, "single", "int16", which)
    folder = builds.altered_folder(built.folder, "src/ars_map.c", old, new)
    return replace(built, software=around(kind, which).software(folder))


def test_a_wrong_scale_or_conversion_is_seen() -> None:
    built, _ = made("pi", "single", "int16")
    scale = re.search(rb"yaw_rate_scale = ([\d.e+-]+)f;", built.folder.files["src/ars_map.c"])
    assert scale is not None
    other = spoiled(f"yaw_rate_scale = {scale[1].decode()}f", "yaw_rate_scale = 6.0e-5f")
    assert not other.software.function("selftest")()
    unsigned = spoiled("return (float)raw * scale;", "return (float)(raw + 1) * scale;")
    with pytest.raises(AssertionError):
        checks_lookup.check_same_bits(unsigned)
    assert not unsigned.software.function("selftest")()


def test_a_negative_yaw_rate_in_the_table_is_refused() -> None:
    built, _ = made("pi", "single", "int16")
    text = built.folder.files["src/ars_calibration.c"].decode("ascii")
    assert text.count(f" {RAW_MAX}") >= 1
    head, _, tail = text.rpartition(f" {RAW_MAX}")
    files = {**built.folder.files, "src/ars_calibration.c": f"{head} -{RAW_MAX}{tail}".encode("ascii")}
    software = around().software(replace(built.folder, files=files))
    assert not software.function("map_valid")()
    assert not software.function("selftest")()

"""Checks of the generated lookup. Each takes a build and raises AssertionError if the build fails it.

Tests and planted faults share these checks.
"""

import functools
import math
import zlib
from fractions import Fraction
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from codegen.ecu_map.extend import TotalMap
from codegen.ecu_map.storage import raw_of
from tests.builds import Built

RealArray = npt.NDArray[Any]


class Mapped(Protocol):
    """A build or units with a map in some precision."""

    @property
    def total(self) -> TotalMap: ...

    @property
    def real(self) -> Any: ...


def bits(values: RealArray) -> RealArray:
    """Return the bit patterns of an array."""
    return np.ascontiguousarray(values).view(f"u{values.dtype.itemsize}")


def special_values(real: Any) -> RealArray:
    """Return zeros, subnormals, the extremes, infinities, and NaN: quiet, signalling, both signs, with a payload."""
    info = np.finfo(real)
    plain = [0.0, info.smallest_subnormal, info.tiny, info.eps, 1.0, 1e10, info.max, np.inf]
    values = np.array([*plain, *(-value for value in plain)], dtype=real)
    if real is np.float32:
        nan = np.array([0x7FC00000, 0xFFC00000, 0x7F800001, 0xFF800001, 0x7FA12345, 0xFFFFFFFF], dtype=np.uint32)
    else:
        nan = np.array([0x7FF8 << 48, 0xFFF8 << 48, (0x7FF0 << 48) + 1, (0xFFF0 << 48) + 1, 2**64 - 1], dtype=np.uint64)
    return np.concatenate([values, nan.view(real)])


def _around(breakpoints: RealArray, real: Any) -> RealArray:
    """Return each breakpoint and its neighbours up to two units in the last place away, and their negatives."""
    at = breakpoints.astype(real)
    up, down = (np.nextafter(at, real(side)) for side in (np.inf, -np.inf))
    near = np.concatenate([at, up, down, np.nextafter(up, real(np.inf)), np.nextafter(down, real(-np.inf))])
    return np.concatenate([near, -near])


def finite_points(built: Mapped, count: int = 100_000) -> tuple[RealArray, RealArray]:
    """Return speeds and front angles: breakpoints with their neighbours, including corners, then random points, a tenth of them
    beyond the last breakpoint."""
    real, total = built.real, built.total
    rng = np.random.default_rng(20_240_607)
    speed, angle = (_around(values, real) for values in (total.speed, total.front_angle))
    some = 10 * count // 4
    if speed.size * angle.size > some:  # all of one axis with a sample of the other, twice, and all corners
        ends_v, ends_a = speed[np.abs(speed) >= total.speed[-2]], angle[np.abs(angle) >= total.front_angle[-2]]
        pairs = [
            (np.repeat(speed, 40), rng.choice(angle, 40 * speed.size)),
            (rng.choice(speed, 40 * angle.size), np.repeat(angle, 40)),
            (np.repeat(ends_v, ends_a.size), np.tile(ends_a, ends_v.size)),
        ]
    else:
        pairs = [(np.repeat(speed, angle.size), np.tile(angle, speed.size))]
    reach = rng.choice([1.1, 1.1, 1.1, 3.0], count)
    random_v = rng.uniform(-0.1, 1.0, count) * reach * total.speed[-1]
    random_a = rng.uniform(-1.0, 1.0, count) * reach * total.front_angle[-1]
    pairs.append((random_v.astype(real), random_a.astype(real)))
    return np.concatenate([pair[0] for pair in pairs]), np.concatenate([pair[1] for pair in pairs])


def raw_points(built: Mapped, count: int = 100_000) -> tuple[RealArray, RealArray]:
    """Return pairs of any bit patterns, and every special value paired with special and plain ones."""
    real = built.real
    width = np.dtype(real).itemsize
    rng = np.random.default_rng(7)
    raw = np.frombuffer(rng.bytes(2 * count * width), dtype=real).reshape(2, count)
    special, speed, angle = special_values(real), built.total.speed.astype(real), built.total.front_angle.astype(real)
    some = np.concatenate([special, speed, angle])
    one, other = np.repeat(special, some.size), np.tile(some, special.size)
    return np.concatenate([raw[0], one, other]), np.concatenate([raw[1], other, one])


@functools.cache
def all_points(built: Mapped) -> tuple[RealArray, RealArray]:
    finite, raw = finite_points(built), raw_points(built)
    return np.concatenate([finite[0], raw[0]]), np.concatenate([finite[1], raw[1]])


def check_cap(built: Built) -> None:
    """Check that speed times yaw rate never exceeds ay_cap, or its share on a slippery road, without any tolerance.

    In single precision every product is checked, exactly, in double precision. In double precision some are checked, as
    fractions. Products too small to differ from zero in the build's numbers count as zero.
    """
    speed, angle = finite_points(built)
    forward = speed > 0.0
    single = built.software.real is np.float32
    speed, angle = (values[forward][:: 1 if single else 25] for values in (speed, angle))
    own, smallest = built.total.friction, float(np.finfo(built.software.real).smallest_subnormal)
    for friction in (math.nan, own, 0.5 * own, 0.0):
        share = Fraction(1)
        if float(built.software.real(friction)) < own:
            share = Fraction(float(built.software.real(friction))) / Fraction(own)
        most = max(Fraction(built.total.lateral_acceleration_cap) * share, Fraction(smallest))
        yaw_rate = np.abs(built.software.map_yaw_rate(speed, angle, friction))
        if single:
            # float() rounds by far less than the four units in the last place of single precision that the C stays below.
            assert (speed.astype(np.float64) * yaw_rate.astype(np.float64) <= float(most)).all()
        else:
            assert all(Fraction(v) * Fraction(r) <= most for v, r in zip(speed.tolist(), yaw_rate.tolist(), strict=True))


def any_numbers(rng: np.random.Generator, real: Any, count: int, special: Any) -> Any:
    """Return `count` numbers of any bit pattern, including special ones."""
    size = np.dtype(real).itemsize
    raw = np.frombuffer(rng.bytes(count * size), dtype=real)
    return np.where(rng.random(count) < 0.5, raw, rng.choice(special, count)).astype(real)


def check_map_functions(built: Built) -> None:
    """Check the function without friction, the checksums of the numbers in memory, and the self-test that compares them."""
    for speed, angle in ((12.0, 0.03), (33.0, -0.3), (90.0, 0.6), (0.0, 0.1), (20.0, 0.0)):
        assert built.software.function("map_yaw_rate")(speed, angle) == built.lookup(speed, angle)
    wanted = zlib.crc32(b"".join(part.astype(part.dtype.newbyteorder("<")).tobytes() for part in numbers_of(built)))
    assert built.software.function("map_crc")(0xFFFFFFFF) == wanted ^ 0xFFFFFFFF
    assert built.folder.manifest["map"]["checksum_crc32"] == f"{wanted:08x}"
    whole = built.software.function("calibration_checksum")()
    assert whole == built.software.function("calibration_expected_checksum")
    assert built.folder.manifest["calibration"]["checksum_crc32"] == f"{whole:08x}"
    assert built.software.selftest()


def numbers_of(built: Built) -> list[np.ndarray]:
    """Return the numbers that the checksum covers, made from the total map."""
    total, real = built.total, built.real
    has_rear_angle = built.software.config.controller.kind in ("tracking", "feedforward")
    names = ["yaw_rate", *(["rear_angle"] if has_rear_angle else [])]
    tables = [np.stack([getattr(layer, name) for layer in total.stack]) for name in names]
    scales = [] if total.scales is None else [getattr(total.scales, name) for name in names]
    stored = [raw_of(table, scale) for table, scale in zip(tables, scales, strict=True)] if scales else tables
    frictions = [layer.friction for layer in total.stack] if total.layers else []
    rest = np.concatenate([scales, frictions, total.speed, total.front_angle]).astype(real)
    numbers = [*(part if scales else part.astype(real) for part in stored), rest]
    if total.grip is None:
        return numbers
    shares = np.stack([layer.grip.share for layer in total.stack if layer.grip is not None])
    axes = np.concatenate([total.grip.speed, total.grip.front_angle]).astype(real)
    if total.grip.scale is None:
        return [*numbers, shares.astype(real), axes]
    return [*numbers, raw_of(shares, total.grip.scale), np.array([total.grip.scale], dtype=real), axes]

"""What must hold of the generated lookup. Each check takes a build and raises AssertionError where it does not.

Apart from the tests, so that the planted faults are judged by the very same checks.
"""

from __future__ import annotations

import functools
import math
import zlib
from fractions import Fraction
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from codegen.refmap.extend import TotalMap
from codegen.refmap.lookup import Lookup, error_bound
from tests.builds import Built

RealArray = npt.NDArray[Any]
FRICTIONS = (math.nan, -math.inf, -0.5, 0.0, 1e-3, 0.35, 0.8999999, 0.9, 0.9000001, 1.4, math.inf)


class Mapped(Protocol):
    """What holds a map in some precision: a build, or units of one."""

    @property
    def total(self) -> TotalMap: ...

    @property
    def real(self) -> Any: ...


def bits(values: RealArray) -> RealArray:
    """The bit patterns of an array."""
    return np.ascontiguousarray(values).view(f"u{values.dtype.itemsize}")


def special_values(real: Any) -> RealArray:
    """Zeros, subnormals, the extremes, infinities, and NaN: quiet, signalling, both signs, with a payload."""
    info = np.finfo(real)
    plain = [0.0, info.smallest_subnormal, info.tiny, info.eps, 1.0, 1e10, info.max, np.inf]
    values = np.array([*plain, *(-value for value in plain)], dtype=real)
    if real is np.float32:
        nan = np.array([0x7FC00000, 0xFFC00000, 0x7F800001, 0xFF800001, 0x7FA12345, 0xFFFFFFFF], dtype=np.uint32)
    else:
        nan = np.array([0x7FF8 << 48, 0xFFF8 << 48, (0x7FF0 << 48) + 1, (0xFFF0 << 48) + 1, 2**64 - 1], dtype=np.uint64)
    return np.concatenate([values, nan.view(real)])


def _around(breakpoints: RealArray, real: Any) -> RealArray:
    """Each breakpoint and its neighbours up to two units in the last place away, and the same negated."""
    at = breakpoints.astype(real)
    up, down = (np.nextafter(at, real(side)) for side in (np.inf, -np.inf))
    near = np.concatenate([at, up, down, np.nextafter(up, real(np.inf)), np.nextafter(down, real(-np.inf))])
    return np.concatenate([near, -near])


def finite_points(built: Mapped, count: int = 100_000) -> tuple[RealArray, RealArray]:
    """Speeds and front angles: breakpoints with their neighbours against each other, corners included; then random, a tenth
    of it beyond the last breakpoint."""
    real, total = built.real, built.total
    rng = np.random.default_rng(20_240_607)
    speed, angle = (_around(values, real) for values in (total.speed, total.front_angle))
    some = 10 * count // 4
    if speed.size * angle.size > some:  # all of one axis against a sample of the other, twice; the corners always
        ends_v, ends_a = speed[np.abs(speed) >= total.speed[-2]], angle[np.abs(angle) >= total.front_angle[-2]]
        pairs = [
            (np.repeat(speed, 40), rng.choice(angle, 40 * speed.size)),
            (rng.choice(speed, 40 * angle.size), np.repeat(angle, 40)),
            (np.repeat(ends_v, ends_a.size), np.tile(ends_a, ends_v.size)),
        ]
    else:
        pairs = [(np.repeat(speed, angle.size), np.tile(angle, speed.size))]
    reach = rng.choice([1.1, 1.1, 1.1, 3.0], count)
    pairs.append(
        (
            (rng.uniform(-0.1, 1.0, count) * reach * total.speed[-1]).astype(real),
            (rng.uniform(-1.0, 1.0, count) * reach * total.front_angle[-1]).astype(real),
        )
    )
    return np.concatenate([pair[0] for pair in pairs]), np.concatenate([pair[1] for pair in pairs])


def raw_points(built: Mapped, count: int = 100_000) -> tuple[RealArray, RealArray]:
    """Any bit pattern against any other, and every special value against special and plain ones."""
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


def check_finite(built: Built) -> None:
    """Every pair of bit patterns has a finite answer, on every road."""
    speed, angle = all_points(built)
    special = special_values(built.software.real)
    friction = np.resize(special, speed.size)
    for road in (np.full(speed.size, np.nan), friction):
        assert np.isfinite(built.software.map_yaw_rate(speed, angle, road)).all()


def check_odd_symmetry(built: Built) -> None:
    """A right turn is the mirror image of the left one, to the last bit."""
    speed, angle = all_points(built)
    number = ~np.isnan(angle) & (angle != 0.0)  # NaN counts as zero, and zero has one answer
    speed, angle = speed[number], angle[number]
    left, right = built.software.map_yaw_rate(speed, np.abs(angle)), built.software.map_yaw_rate(speed, -np.abs(angle))
    assert np.array_equal(bits(left), bits(-right))
    assert (left > 0.0).any()


def check_cap(built: Built) -> None:
    """Speed times yaw rate is never more than ay_cap, and on a slippery road than its share: without any tolerance.

    In single precision every product is judged, and is exact, in double precision; in double precision a part of them, as
    fractions. What is too small for a product of the build's numbers to tell from zero counts as zero.
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


def check_cap_is_reached(built: Built) -> None:
    """Where the table asks for more, the answer is ay_cap over speed and not something smaller."""
    real = built.software.real
    speed = real(3.0) * real(built.total.speed[-1])
    yaw_rate = float(built.software.map_yaw_rate(speed, built.total.front_angle[-1]))
    expected = built.total.lateral_acceleration_cap / float(speed)
    # Lowered by four units in the last place (8 u), and one division.
    assert expected * (1.0 - 10.0 * built.eps) <= yaw_rate <= expected


def check_edges(built: Built) -> None:
    """No speed, a negative one and NaN count as zero speed; beyond the last breakpoint the edge holds up to the cap."""
    real, total = built.software.real, built.total
    angle = np.linspace(0.0, 2.0 * total.front_angle[-1], 101).astype(real)
    speed = np.linspace(0.0, 2.0 * total.speed[-1], 103).astype(real)
    top_speed, top_angle = real(total.speed[-1]), real(total.front_angle[-1])

    def look(v: Any, a: Any) -> RealArray:
        return built.software.map_yaw_rate(v, a)

    for none in (0.0, -0.0, -1e-30, -20.0, -np.inf, np.nan):
        assert not look(none, angle).any()
        if not none < 0.0:
            assert not look(speed, none).any()
    beyond = look(speed, np.array([top_angle * real(1.5), real(7.0), real(np.inf)])[:, np.newaxis])
    assert np.array_equal(beyond, np.broadcast_to(beyond[0], beyond.shape))
    bound = error_bound(built.total, real)  # at the last breakpoint itself the place in the cell is rounded
    assert np.abs(beyond[0] - look(speed, top_angle)).max() <= bound
    faster = np.array(
        [top_speed, built.next(float(top_speed), np.inf), 1.2 * top_speed, 5.0 * top_speed, 1e6, 1e30], dtype=real
    )
    edge = look(faster[:, np.newaxis], angle)
    assert (np.diff(edge, axis=0) <= 0.0).all(), "beyond the last speed the answer never grows with speed"
    lowered = built.lookup.lateral_acceleration_cap
    if built.total.grip is not None:
        lowered = lowered * np.interp(angle, built.total.grip.front_angle, built.total.grip.share[-1]).astype(real)
    wanted = np.where(edge[0] * faster[:, np.newaxis] > lowered, lowered / faster[:, np.newaxis], edge[0])
    assert np.abs(edge - wanted).max() <= bound


def exact_yaw_rate(total: TotalMap, speed: float, front_angle: float) -> Fraction:
    """The rule itself in whole numbers: bilinear between the breakpoints, clamped at the last ones, at most ay_cap / speed."""
    v, a = Fraction(speed), Fraction(front_angle)
    if v <= 0 or a == 0:
        return Fraction(0)
    cells, shares = [], []
    for axis, value in ((total.speed, v), (total.front_angle, abs(a))):
        inside = min(value, Fraction(float(axis[-1])))
        cell = min(int(np.searchsorted(axis, float(inside), side="right")) - 1, axis.size - 2)
        low, high = (Fraction(float(axis[cell + k])) for k in (0, 1))
        cells.append(cell)
        shares.append((inside - low) / (high - low))
    (i, j), (u, w) = cells, shares
    corner = [[Fraction(float(total.yaw_rate[i + di, j + dj])) for dj in (0, 1)] for di in (0, 1)]
    slower, faster = ((1 - w) * row[0] + w * row[1] for row in corner)
    yaw_rate = min((1 - u) * slower + u * faster, Fraction(total.lateral_acceleration_cap) / v)
    return yaw_rate if a > 0 else -yaw_rate


def check_error_bound(built: Built) -> float:
    """The stated bound on the error against exact arithmetic holds. Returns the bound as a multiple of the largest error.

    Every point against the reference in double precision, whose own error is 1e-9 of a single-precision bound; a part of
    them as fractions, which also says that the reference follows the rule.
    """
    speed, angle = finite_points(built)
    bound = error_bound(built.total, built.software.real)
    largest = 0.0
    if built.software.real is np.float32:
        fine = Lookup.from_map(built.total, np.float64)
        error = np.abs(built.software.map_yaw_rate(speed, angle) - fine(speed.astype(np.float64), angle.astype(np.float64)))
        largest = float(error.max())
    some = slice(None, None, speed.size // 4000)
    got = built.software.map_yaw_rate(speed[some], angle[some]).tolist()
    for v, a, yaw_rate in zip(speed[some].tolist(), angle[some].tolist(), got, strict=True):
        largest = max(largest, float(abs(Fraction(yaw_rate) - exact_yaw_rate(built.total, v, a))))
    assert largest <= bound
    return bound / largest


def check_checksum(built: Built) -> None:
    """Table and breakpoints in memory, expected value, manifest and `zlib.crc32` agree."""
    axes = [axis.table for axis in (built.lookup.speed_axis, built.lookup.front_axis)]
    stored = np.concatenate([built.lookup.table.ravel(), *axes])
    wanted = zlib.crc32(stored.astype(stored.dtype.newbyteorder("<")).tobytes())
    assert built.software.function("map_checksum")() == wanted
    assert built.software.function("map_expected_checksum") == wanted
    assert built.folder.manifest["map"]["checksum_crc32"] == f"{wanted:08x}"


def any_numbers(rng: np.random.Generator, real: Any, count: int, special: Any) -> Any:
    """Numbers (count,) of any bit pattern, and special ones."""
    size = np.dtype(real).itemsize
    raw = np.frombuffer(rng.bytes(count * size), dtype=real)
    return np.where(rng.random(count) < 0.5, raw, rng.choice(special, count)).astype(real)

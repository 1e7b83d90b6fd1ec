"""The generated lookup against the NumPy reference, bit for bit, and what must hold of both."""

from __future__ import annotations

import re

import numpy as np
import pytest

from codegen.emit.text import literal
from codegen.refmap.axis import Axis
from codegen.refmap.extend import extend
from codegen.sil.software import compile_build
from tests import builds
from tests.builds import Built
from tests.sil import checks_lookup

MAP_C, CALIBRATION_C = "src/ars_map.c", "src/ars_calibration.c"
SELFTEST_C, E2E_C = "src/ars_selftest.c", "src/ars_e2e.c"


@pytest.fixture(scope="module", params=[(name, precision) for name in builds.MAPS for precision in builds.PRECISIONS], ids=str)
def built(request: pytest.FixtureRequest) -> Built:
    """Every kind of axis, in both precisions."""
    return builds.of_map(*request.param)


def test_the_maps_hold_every_kind_of_axis() -> None:
    kinds = set()
    for name in builds.MAPS:
        total = extend(builds.MAPS[name](), builds.CONFIG)
        for values in (total.speed, total.front_angle):
            axis = Axis.from_breakpoints(values)
            kinds.add((axis.even, axis.has_first_cell, axis.has_last_cell))
    assert kinds == {(False, False, False), (True, False, False), (True, True, False), (True, False, True), (True, True, True)}


def test_same_bits_as_the_reference(built: Built) -> None:
    checks_lookup.check_same_bits(built)


def test_both_functions_are_one_lookup(built: Built) -> None:
    """The array form, which the other tests use, calls the one with friction; without an estimate both give the same bits."""
    speed, angle = (values[::500] for values in checks_lookup.finite_points(built))
    plain = built.software.function("map_yaw_rate")
    got = np.array([plain(float(v), float(a)) for v, a in zip(speed, angle, strict=True)], dtype=built.software.real)
    assert np.array_equal(checks_lookup.bits(got), checks_lookup.bits(built.software.map_yaw_rate(speed, angle)))


def test_every_pair_of_bit_patterns_has_a_finite_answer(built: Built) -> None:
    checks_lookup.check_finite(built)


def test_a_right_turn_mirrors_a_left_turn_to_the_bit(built: Built) -> None:
    checks_lookup.check_odd_symmetry(built)


def test_never_asks_for_more_than_the_cap(built: Built) -> None:
    checks_lookup.check_cap(built)


def test_the_cap_itself_is_reached(built: Built) -> None:
    checks_lookup.check_cap_is_reached(built)


def test_the_edges_hold_outside_the_table(built: Built) -> None:
    checks_lookup.check_edges(built)


def test_the_error_bound_holds_and_means_something(built: Built) -> None:
    """A bound far above every error would not notice a lost digit."""
    # Found: 4 to 37 times the largest error. The bound adds up the worst of every rounding and takes the steepest slope and
    # the largest corner, which the cap mostly hides.
    assert 1.0 <= checks_lookup.check_error_bound(built) < 50.0


def test_the_checksum_is_that_of_zlib(built: Built) -> None:
    checks_lookup.check_checksum(built)


def test_the_selftest_passes(built: Built) -> None:
    assert built.software.selftest()


def test_an_estimate_of_negative_zero_counts_as_zero(either: Built) -> None:
    """C and reference: the sign of a zero friction must not turn the sign of the answer."""
    speed, angle = either.software.real(20.0), either.software.real(0.05)
    got, wanted = (look(speed, angle, -0.0) for look in (either.software.map_yaw_rate, either.lookup))
    assert np.array_equal(checks_lookup.bits(got), checks_lookup.bits(wanted))


class TestSelftest:
    """What a bit flipped in flash, or an edit by hand, does to the self-test."""

    @staticmethod
    def sees(path: str, old: str, new: str) -> bool:
        return not builds.altered(path, old, new).software.selftest()

    def test_one_number_of_the_table_is_one_unit_in_the_last_place_off(self, paper: Built) -> None:
        numbers = re.findall(r" (\d\.\d+f),", source(paper, CALIBRATION_C).partition("yaw_rate_table[ARS_MAP")[2])
        old = next(number for number in numbers if numbers.count(number) == 1)
        new = literal(paper.next(float(old.rstrip("f")), 10.0), "single")
        assert self.sees(CALIBRATION_C, f" {old},", f" {new},")

    @pytest.mark.parametrize(
        "constant",
        ["lateral_acceleration_cap", "lateral_acceleration_cap_per_friction"],
    )
    def test_a_constant_of_the_lookup_is_a_thousandth_off(self, paper: Built, constant: str) -> None:
        old, value = re.findall(rf"(static const float {constant} = ([^;]+)f;)", source(paper, MAP_C))[0]
        assert self.sees(MAP_C, old, old.replace(value, f"{1.001 * float(value):.9g}"))

    @pytest.mark.parametrize("factor", [0.97, 1.03])
    def test_the_friction_of_the_map_is_off(self, paper: Built, factor: float) -> None:
        value = paper.total.friction
        old = f"static const float map_friction = {value}f;"
        assert self.sees(MAP_C, old, old.replace(f"{value}", f"{factor * value:.6g}"))

    @pytest.mark.parametrize("name", ["paper", "uneven"])
    def test_a_breakpoint_is_one_unit_in_the_last_place_off(self, name: str) -> None:
        built = builds.of_map(name, "single")
        for axis in ("speed", "front_angle"):
            listed = source(built, CALIBRATION_C).partition(f"{axis}_breakpoints[")[2].partition("{")[2].partition("}")[0]
            number = listed.split(",")[2].strip()
            wrong = literal(built.next(float(number.rstrip("f")), 1000.0), "single")
            text = source(built, CALIBRATION_C).replace(listed, listed.replace(f" {number},", f" {wrong},", 1), 1)
            files = {**built.folder.files, CALIBRATION_C: text.encode("ascii")}
            assert files[CALIBRATION_C] != built.folder.files[CALIBRATION_C]
            assert not compile_build(files, built.folder.manifest).selftest()

    def test_a_known_corner_is_wrong(self, paper: Built) -> None:
        rows = re.findall(r"\{ (\S+f, \S+f, \S+f), (\S+)f \}", source(paper, SELFTEST_C))
        assert len(rows) == 14
        for place, yaw_rate in rows[3], rows[5], rows[10], rows[13]:  # at the last breakpoints, inside, beyond, slippery
            wrong = f"{float(yaw_rate) + 2e-5:.9g}"  # twice the tolerance of the self-test
            assert self.sees(SELFTEST_C, f"{{ {place}, {yaw_rate}f }}", f"{{ {place}, {wrong}f }}")

    def test_the_expected_checksum_is_wrong(self, paper: Built) -> None:
        right = f"0x{paper.software.function('map_expected_checksum'):08X}u"
        assert self.sees(CALIBRATION_C, right, "0x00000000u")

    def test_a_default_parameter_is_out_of_range(self) -> None:
        assert self.sees(CALIBRATION_C, ".friction_min = 0.1f", ".friction_min = 0.0f")

    def test_the_crc_has_another_polynomial(self) -> None:
        assert self.sees(E2E_C, "0x00u, 0x1Du, 0x3Au", "0x00u, 0x2Fu, 0x3Au")


def source(built: Built, path: str) -> str:
    """The text of a generated file."""
    return built.folder.files[path].decode("ascii")

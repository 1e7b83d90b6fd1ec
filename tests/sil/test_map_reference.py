"""The map with the optimum's own rear angle, and stacks of maps over friction, against the NumPy reference, bit for bit."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from codegen.emit.text import literal
from codegen.refmap.axis import Axis
from codegen.sil.software import compile_build
from tests import builds
from tests.sil import checks_map_reference, units
from tests.sil.units import Units

MAP_C, CALIBRATION_C = "src/ars_map.c", "src/ars_calibration.c"


@pytest.fixture(scope="module", params=[(name, precision) for name in units.MAPS for precision in builds.PRECISIONS], ids=str)
def of_map(request: pytest.FixtureRequest) -> Units:
    """Even and uneven axes, solved and bare, with and without a stack, in both precisions."""
    return units.of_map(*request.param)


def test_the_maps_have_stacks_and_every_kind_of_axis() -> None:
    layers, even = set(), set()
    for name in units.MAPS:
        total = units.of_map(name, "single").total
        layers.add(len(total.stack))
        even |= {Axis.from_breakpoints(axis).even for axis in (total.speed, total.front_angle)}
    assert layers == {1, 2, 4}
    assert even == {True, False}


def test_same_bits_as_the_reference(of_map: Units) -> None:
    checks_map_reference.check_same_bits_as_reference(of_map)


def test_every_set_of_bit_patterns_has_a_finite_answer(of_map: Units) -> None:
    checks_map_reference.check_reference_finite(of_map)


def test_a_right_turn_mirrors_a_left_turn_to_the_bit(of_map: Units) -> None:
    checks_map_reference.check_reference_symmetry(of_map)


def test_the_rule_written_in_another_way_gives_the_same(of_map: Units) -> None:
    checks_map_reference.check_reference_rule(of_map)


def test_on_a_layer_s_own_friction_the_map_is_that_layer() -> None:
    """Between neighbours, the value moves from one to the other without a step."""
    of_map = units.of_map("stack", "double")
    speed, angle = (values.ravel() for values in np.meshgrid(np.linspace(1.0, 40.0, 30), np.linspace(0.001, 0.6, 30)))
    for layer in of_map.total.stack:
        alone = replace(layer, layers=())
        yaw_rate, rear_angle, _ = checks_map_reference.reference_by_rule(alone, speed, angle, layer.friction)
        got = of_map.map_reference(speed, angle, layer.friction)
        assert np.abs(got[0] - yaw_rate).max() < 1e-12
        assert np.abs(got[1] - rear_angle).max() < 1e-11
        below, above = (of_map.map_reference(speed, angle, layer.friction + step) for step in (-1e-9, 1e-9))
        assert np.abs(above[:2] - below[:2]).max() < 1e-6


@pytest.fixture(scope="module")
def stacked() -> builds.Built:
    """A whole build around a stack; small, for it is compiled again and again."""
    return builds.make(units.MAPS["rough stack"](), builds.FEEDFORWARD_CONFIG)


class TestSelftest:
    """What an edit of a stack does to the self-test."""

    def test_the_stack_passes(self, stacked: builds.Built) -> None:
        assert stacked.software.selftest()

    @pytest.mark.parametrize("name", ["yaw_rate_table", "rear_angle_table"])
    @pytest.mark.parametrize("layer", [0, 3])
    def test_one_number_of_a_layer_is_off(self, stacked: builds.Built, name: str, layer: int) -> None:
        text = stacked.folder.files[CALIBRATION_C].decode("ascii")
        head, table = re.split(rf"(?<=const float ars_map_{name})", text, maxsplit=1)
        start = (
            table.index("/* friction", table.index("{"))
            if layer == 0
            else [m.start() for m in re.finditer("/\\* friction", table)][layer]
        )
        number = next(match for match in re.finditer(r"-?\d\.\d{5,}f", table[start:]))
        wrong = literal(stacked.next(float(number[0].rstrip("f")), 10.0), "single")
        changed = head + table[:start] + table[start:].replace(number[0], wrong, 1)
        assert changed != text
        files = {**stacked.folder.files, CALIBRATION_C: changed.encode("ascii")}
        assert not compile_build(files, stacked.folder.manifest).selftest()

    def test_a_friction_of_the_stack_is_off(self, stacked: builds.Built) -> None:
        changed = builds.altered_folder(stacked.folder, MAP_C, "0.2f, 0.21f, 0.6f, 0.9f", "0.2f, 0.21000002f, 0.6f, 0.9f")
        assert not compile_build(changed.files, changed.manifest).selftest()

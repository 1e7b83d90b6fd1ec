"""The AUTOSAR component of every build, on an RTE made from its ARXML, in a whole scenario."""

import itertools

import pytest

from tests.export.test_arxml import BUILDS, FRAME_KINDS, check_scenario

PAIRS = (
    *itertools.product(("explicit", "implicit"), (*BUILDS, *FRAME_KINDS[1:])),
    *itertools.product(("raw",), (*BUILDS, *FRAME_KINDS)),
)


@pytest.mark.long
@pytest.mark.parametrize(("on_rte", "name"), PAIRS)
def test_a_whole_scenario_on_the_rte_has_the_bits_of_the_sil(on_rte: str, name: str) -> None:
    check_scenario(name, on_rte)

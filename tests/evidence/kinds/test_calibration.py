"""Calibration files of the kinds of controller and the maps that `make test` leaves out."""

from pathlib import Path

import pytest

from tests.export.test_calibration import check_map_of_set, check_round_trip


@pytest.mark.long
@pytest.mark.parametrize("kind", ["feedforward", "proportional"])
def test_every_value_returns_from_both_formats_with_the_same_bits(kind: str, tmp_path: Path) -> None:
    check_round_trip(kind, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("name", ["4ws2", "4ws2-paper"])
def test_a_map_of_the_set_builds_the_same_map(name: str) -> None:
    check_map_of_set(name)

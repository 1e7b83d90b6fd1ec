"""Random frames of every E2E profile, protected and checked by the C and by independent implementations."""

from typing import get_args

import pytest

from codegen.configuration.e2e_profiles import ProfileName
from tests.sil import e2e_profiles

FRAMES = 1_000_000


@pytest.mark.parametrize("name", get_args(ProfileName))
def test_a_million_random_frames(name: ProfileName) -> None:
    assert e2e_profiles.compare(name, FRAMES) == FRAMES

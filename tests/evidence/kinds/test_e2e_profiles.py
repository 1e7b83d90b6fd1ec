"""Random frames of every E2E profile, protected and checked by the C and by independent implementations."""

from typing import get_args

import pytest

from codegen.configuration.e2e_profiles import ProfileName
from tests.sil import e2e_profiles


@pytest.mark.parametrize("frames", [50_000, pytest.param(1_000_000, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", get_args(ProfileName))
def test_random_frames(name: ProfileName, frames: int) -> None:
    assert e2e_profiles.compare(name, frames) == frames

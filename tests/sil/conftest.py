"""Builds that several tests share; made when first asked for, once a process."""

from __future__ import annotations

import pytest

CHECKS = ("lookup", "map_reference", "control", "supervision", "kinds", "tracking", "reference", "limiter", "reference_model")
pytest.register_assert_rewrite(*(f"tests.sil.checks_{name}" for name in CHECKS))

from tests import builds  # noqa: E402 - only now, so that its asserts tell what they compared


@pytest.fixture(scope="session")
def paper() -> builds.Built:
    """The paper's build in single precision."""
    return builds.paper()


@pytest.fixture(scope="session", params=builds.PRECISIONS)
def either(request: pytest.FixtureRequest) -> builds.Built:
    """The paper's build in single and in double precision."""
    return builds.paper(request.param)

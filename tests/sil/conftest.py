"""The paper's build as a fixture; asserts of the checks report what they compared."""

from __future__ import annotations

import pytest

pytest.register_assert_rewrite(
    *(
        f"tests.sil.checks_{name}"
        for name in (
            "calibration",
            "control",
            "edges",
            "edges_law",
            "edges_units",
            "kinds",
            "limiter",
            "lookup",
            "map_reference",
            "parameters",
            "reference",
            "reference_model",
            "selftest",
            "supervision",
            "task",
            "tracking",
        )
    )
)

from tests import builds  # noqa: E402 - after the registration, which it would defeat


@pytest.fixture(scope="session")
def paper() -> builds.Built:
    """The paper's build in single precision."""
    return builds.paper()


@pytest.fixture(scope="session", params=builds.PRECISIONS)
def either(request: pytest.FixtureRequest) -> builds.Built:
    """The paper's build in single and in double precision."""
    return builds.paper(request.param)

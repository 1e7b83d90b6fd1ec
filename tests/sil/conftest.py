"""The paper's build as a fixture."""

import pytest

from tests import builds


@pytest.fixture(scope="session")
def paper() -> builds.Built:
    """The paper's build in single precision."""
    return builds.paper()


@pytest.fixture(scope="session", params=builds.PRECISIONS)
def either(request: pytest.FixtureRequest) -> builds.Built:
    """The paper's build in single and in double precision."""
    return builds.paper(request.param)

"""Programs of the host that these tests need."""

import os
import shutil

import pytest


def tool(name: str) -> str:
    """Return the path of a program. Where it is missing, skip the test; in CI, fail it."""
    found = shutil.which(name)
    if found is None and os.environ.get("CI", "").lower() not in ("", "0", "false"):
        pytest.fail(f"{name} is not installed; CI runs every test")
    return found or pytest.skip(f"{name} is not installed")

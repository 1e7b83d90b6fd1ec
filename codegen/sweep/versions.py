"""Package versions that affect the results of a campaign. They are stored with it and must match on all workers."""

from __future__ import annotations

from functools import cache
from importlib.metadata import version

from codegen import __version__

PACKAGES = ("numpy", "scipy", "casadi")


@cache
def versions() -> dict[str, str]:
    """Return name -> version of this package and of PACKAGES."""
    return {"codegen": __version__, **{name: version(name) for name in PACKAGES}}

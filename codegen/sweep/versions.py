"""Versions of what the numbers of a campaign come from: kept with the results, and the same on all workers of a cluster."""

from __future__ import annotations

from functools import cache
from importlib.metadata import version

from codegen import __version__

PACKAGES = ("numpy", "scipy", "casadi")


@cache
def versions() -> dict[str, str]:
    """Name to version: of this package, and of those that draw, compute and generate."""
    return {"codegen": __version__, **{name: version(name) for name in PACKAGES}}

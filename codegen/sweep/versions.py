"""Versions of the packages that determine the results of a campaign."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version
from pathlib import Path

import codegen
from codegen.emit.render import templates_root

PACKAGES = ("numpy", "scipy", "casadi")


@cache
def versions() -> dict[str, str]:
    """Return name -> version of this package and of PACKAGES."""
    return {"codegen": codegen.__version__, **{name: version(name) for name in PACKAGES}}


@cache
def sources_digest() -> str:
    """Return SHA-256 of the versions and of all sources of this package, in hexadecimal digits.

    During development the sources change without the version.
    """
    found = hashlib.sha256(repr(versions()).encode())
    for root, pattern in ((Path(codegen.__file__).parent, "*.py"), (templates_root(), "*")):
        for path in sorted(path for path in root.rglob(pattern) if path.is_file()):
            found.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()

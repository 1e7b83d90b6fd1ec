"""The zip archive of an FMU; equal files give equal bytes."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping

DESCRIPTION = "modelDescription.xml"
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Earliest time that the format can represent."""


def pack(files: Mapping[str, bytes]) -> bytes:
    """Return the archive of path -> content: the description first, the others sorted."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(files, key=lambda path: (path != DESCRIPTION, path)):
            entry = zipfile.ZipInfo(path, _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, wherever this runs
            entry.external_attr = 0o100644 << 16
            archive.writestr(entry, files[path])
    return buffer.getvalue()

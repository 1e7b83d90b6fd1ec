"""Files of other tools: read once, up to a size limit, with their SHA-256; XML without declarations."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.parsers import expat

from codegen.errors import CodegenError
from codegen.files import decoded, read_file, refuse_empty, refuse_utf16

MIB = 2**20

TABLE_BYTES_MAX = 64 * MIB
"""Size limit of a MATLAB file, packed and unpacked, and of a text table; that of a map (docs/interface.md)."""


class ImportFault(CodegenError):
    """A file that cannot be imported."""


@dataclass(frozen=True)
class Source:
    """A file that was read whole: its path and its bytes."""

    path: Path
    data: bytes

    @property
    def name(self) -> str:
        """Name without the folder, so that results contain no path."""
        return self.path.name

    @property
    def sha256(self) -> str:
        """SHA-256 of the bytes, in hexadecimal digits."""
        return hashlib.sha256(self.data).hexdigest()


def read(path: Path, limit: int) -> Source:
    """Read a regular file of at most `limit` bytes. Raises ImportFault."""
    data = read_file(path, limit, "name the file to import", ImportFault, smaller="leave out what is not needed")
    refuse_empty(len(data), path, ImportFault)
    return Source(path, data)


def text_of(source: Source) -> str:
    """Return the text; see `decoded`. Raises ImportFault for binary data."""
    refuse_utf16(source.data, source.path, ImportFault)
    if b"\0" in source.data:
        raise ImportFault("not a text file (it holds zero bytes)", where=source.path, remedy="save it as UTF-8 text")
    return decoded(source.data).replace("\r\n", "\n").replace("\r", "\n")


class _End(Exception):
    """The first element."""


def refuse_declarations(parser: Any, path: Path) -> None:
    """Make a parser of expat reject entities and default values of attributes.

    Both make a file grow: each use of an entity, and each element whose attribute has a default, adds the declared text.
    """

    def entity(*_: object) -> None:
        raise _error("an entity", parser, path)

    def attribute(element: str, name: str, kind: str, default: str | None, is_required: int) -> None:
        del element, name, kind, is_required
        if default is not None:
            raise _error("a default value of an attribute", parser, path)

    parser.EntityDeclHandler, parser.AttlistDeclHandler = entity, attribute


def check_head(content: bytes | str, path: Path) -> None:
    """Check the declarations of a file that a library parses. Other faults are left to the library. Raises CodegenError."""

    def end(*_: object) -> None:
        raise _End

    parser = expat.ParserCreate()
    refuse_declarations(parser, path)
    parser.StartElementHandler = end
    try:
        parser.Parse(content, True)
    except (_End, expat.ExpatError, ValueError, LookupError):
        return


def _error(what: str, parser: Any, path: Path) -> CodegenError:
    where = f"{path}, line {parser.CurrentLineNumber}"
    return CodegenError(f"declares {what}", where=where, remedy="remove the declaration")

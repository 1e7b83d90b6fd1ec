"""Declarations at the head of an XML file, before its first element."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.parsers import expat

from codegen.errors import CodegenError


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

"""Jinja environment over the project's templates, found in a checkout and in an installed wheel alike."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from codegen.emit.filters import FILTERS
from codegen.errors import BuildError


def templates_root() -> Path:
    """The template folder: inside an installed package, or next to the package in a checkout."""
    package = Path(__file__).resolve().parent.parent
    for candidate in (package / "_templates", package.parent / "templates"):
        if (candidate / "_macros.j2").is_file():
            return candidate
    raise BuildError("the templates are missing", where=package, remedy="install ars-codegen again")


@lru_cache(maxsize=1)
def environment() -> Environment:
    """The one environment: an undefined name is an error, and a template's last newline is kept."""
    made = Environment(
        loader=FileSystemLoader(templates_root(), encoding="utf-8"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=False,
        lstrip_blocks=False,
        autoescape=False,
    )
    made.filters.update(FILTERS)
    return made


def render(template: str, context: Mapping[str, Any]) -> bytes:
    """Render `template` with `context`; ASCII only, single blank lines, one newline at the end.

    Raises:
        UnicodeEncodeError: a template or a value is not ASCII (programming error: names are checked before).
    """
    # Set as globals of this template too, so that imported macros see the same names.
    text = environment().get_template(template, globals=dict(context)).render(**context)
    return (_tidy(text).rstrip("\n") + "\n").encode("ascii")


def verbatim(name: str) -> bytes:
    """Return a file of the template folder as it is: C that is the same in every build."""
    return (templates_root() / name).read_bytes()


def _tidy(text: str) -> str:
    """No trailing blanks, never two blank lines in a row, none at the start of the file or of a block."""
    lines: list[str] = []
    for line in (raw.rstrip() for raw in text.splitlines()):
        if not line and (not lines or not lines[-1] or lines[-1].endswith("{")):
            continue
        lines.append(line)
    return "\n".join(lines)

"""Jinja environment of the project's templates, in a checkout or in an installed wheel, and its filters.

Templates print domain objects through the filters, so view models need not copy fields as text.

>>> environment().from_string("{{ 0.1 | literal }}").render(precision="single")
'0.1f'
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined, pass_context
from jinja2.runtime import Context

from codegen.emit.text import Precision, comment_text
from codegen.emit.text import literal as literal_text
from codegen.errors import BuildError


@pass_context
def literal(context: Context, value: float, precision: Precision | None = None) -> str:
    """Return a number as a C literal, in the precision of the build unless `precision` names another one.

    >>> from codegen.emit.render import environment
    >>> environment().from_string("{{ 0.1 | literal('double') }}").render()
    '0.1'
    """
    return literal_text(value, context["precision"] if precision is None else precision)


@pass_context
def c_type(context: Context, kind: str) -> str:
    """Return the C type of a field: the number type of the build for "real", and any other kind unchanged.

    >>> from codegen.emit.render import environment
    >>> environment().from_string("{{ 'real' | c_type }} {{ 'bool' | c_type }}").render(real="float")
    'float bool'
    """
    return str(context["real"]) if kind == "real" else kind


def hexadecimal(value: int, digits: int = 1) -> str:
    """Return a whole number in hexadecimal with at least `digits` digits.

    >>> hexadecimal(257, 4)
    '0x0101'
    """
    return f"0x{value:0{digits}X}"


def decimal(value: float) -> str:
    """Return a number with at most twelve digits and without an exponent, which some readers of a DBC reject.

    >>> decimal(5e-05), decimal(500000.0)
    ('0.00005', '500000')
    """
    return np.format_float_positional(float(f"{value:.12g}"), trim="-")


def exact_decimal(value: float) -> str:
    """Return the shortest number without an exponent that reads back to the same bits: for factors, which others compute with.

    >>> exact_decimal(5e-05), exact_decimal(0.0017453292519943296)
    ('0.00005', '0.0017453292519943296')
    """
    return np.format_float_positional(value, trim="-")


def unit(text: str, symbol: str) -> str:
    """Return a description after its unit, as in the comments of fields. The unit of a ratio is "".

    >>> unit("yaw rate", "rad/s"), unit("friction", "")
    ('rad/s, yaw rate', 'friction')
    """
    return f"{symbol}, {text}" if symbol else text


FILTERS: Mapping[str, Callable[..., Any]] = {
    "c_type": c_type,
    "comment": comment_text,
    "decimal": decimal,
    "hexadecimal": hexadecimal,
    "literal": literal,
    "unit": unit,
}
"""Filters by their names in the templates; `comment` makes any text safe for a C comment or string."""


OPTIONS: dict[str, Any] = {
    "undefined": StrictUndefined,  # an undefined name is an error
    "keep_trailing_newline": True,
    "trim_blocks": False,
    "lstrip_blocks": False,
    "autoescape": False,
}


def templates_root() -> Path:
    """Return the template folder: inside an installed package, or next to the package in a checkout."""
    package = Path(__file__).resolve().parent.parent
    for candidate in (package / "_templates", package.parent / "templates"):
        if (candidate / "_macros.j2").is_file():
            return candidate
    raise BuildError("the templates are missing", where=package, remedy="install ars-codegen again")


@lru_cache(maxsize=1)
def environment() -> Environment:
    """Return the environment that all templates share. It has no cache on disk, from which a changed file would run as code."""
    made = Environment(loader=FileSystemLoader(templates_root(), encoding="utf-8"), **OPTIONS)
    made.filters.update(FILTERS)
    return made


def render(template: str, context: Mapping[str, Any]) -> bytes:
    """Render `template` with `context` as ASCII, with single blank lines and one newline at the end.

    Raises:
        UnicodeEncodeError: a template or a value is not ASCII. That is a programming error, because names are checked earlier.
    """
    # Imported macros see only globals, so the context is passed as globals too.
    text = environment().get_template(template, globals=dict(context)).render(**context)
    return (_tidy(text).rstrip("\n") + "\n").encode("ascii")


def verbatim(name: str) -> bytes:
    """Return an unrendered file of the template folder: C that is the same in every build."""
    return (templates_root() / name).read_bytes()


def _tidy(text: str) -> str:
    """Remove trailing blanks, repeated blank lines, and blank lines at the start of the file or of a block."""
    lines: list[str] = []
    for line in (raw.rstrip() for raw in text.splitlines()):
        if not line and (not lines or not lines[-1] or lines[-1].endswith("{")):
            continue
        lines.append(line)
    return "\n".join(lines)

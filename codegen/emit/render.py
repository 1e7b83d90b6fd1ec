"""Jinja environment of the project's templates, in a checkout or in an installed wheel, and its filters.

Templates print domain objects through the filters, so view models need not copy fields as text.

>>> environment().from_string("{{ 0.1 | literal }}").render(precision="single")
'0.1f'
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined, pass_context
from jinja2.runtime import Context

from codegen.emit.parameters import Field, Parameter
from codegen.emit.text import Precision, comment_text, initialiser, lines_of
from codegen.emit.text import literal as literal_text
from codegen.errors import BuildError
from codegen.units import Unit, unit_of

C_TYPES = ("bool", "int16_t", "uint8_t", "uint16_t", "uint32_t")
"""Types of C among those of members."""


@pass_context
def literal(context: Context, value: float | tuple[float, ...], precision: Precision | None = None) -> str:
    """Return a number as a C literal, in the precision of the build unless `precision` names another one.

    A tuple becomes the initialiser of an array.

    >>> from codegen.emit.render import environment
    >>> environment().from_string("{{ 0.1 | literal('double') }}").render()
    '0.1'
    """
    own: Precision = context["precision"] if precision is None else precision
    return initialiser(value, own) if isinstance(value, tuple) else literal_text(value, own)


@pass_context
def c_type(context: Context, kind: str) -> str:
    """Return the C type of a field: the number type of the build for "real", types of C, and others with the prefix.

    >>> from codegen.emit.render import environment
    >>> environment().from_string("{{ 'real' | c_type }} {{ 'bool' | c_type }}").render(real="float")
    'float bool'
    """
    if kind == "real":
        return str(context["real"])
    return kind if kind in C_TYPES else f"{context['build'].prefix}_{kind}"


@pass_context
def declaration(context: Context, member: Parameter | Field) -> str:
    """Return the declaration of a member of a struct."""
    size = f"[{context['build'].PREFIX}_{member.points}]" if isinstance(member, Parameter) and member.points else ""
    return f"{c_type(context, member.kind)} {member.name}{size};"


@pass_context
def lines(context: Context, values: Iterable[Any]) -> tuple[str, ...]:
    """Return numbers as lines of C literals, several to a line; raw numbers of a table as they are."""
    precision: Precision = context["precision"]
    texts = (str(int(each)) if isinstance(each, np.integer) else literal_text(each, precision) for each in values)
    return lines_of(list(texts))


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


def unit(text: str, of: Unit) -> str:
    """Return a description after its unit, as in the comments of fields.

    >>> from codegen.units import NONE, RAD_S
    >>> unit("yaw rate", RAD_S), unit("friction", NONE)
    ('rad/s, yaw rate', 'friction')
    """
    return f"{of}, {text}" if of else text


FILTERS: Mapping[str, Callable[..., Any]] = {
    "c_type": c_type,
    "comment": comment_text,
    "decimal": decimal,
    "declaration": declaration,
    "hexadecimal": hexadecimal,
    "lines": lines,
    "literal": literal,
    "unit": unit,
    "unit_of": unit_of,
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

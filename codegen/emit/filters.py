"""Jinja filters of the templates: numbers, units and words as C text.

Templates print domain objects through these filters, so view models need not copy fields as text.

>>> from codegen.emit.render import environment
>>> environment().from_string("{{ 0.1 | literal }}").render(precision="single")
'0.1f'
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jinja2 import pass_context
from jinja2.runtime import Context

from codegen.emit.text import Precision, comment_text
from codegen.emit.text import literal as literal_text


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

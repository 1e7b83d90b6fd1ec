"""Jinja filters of the templates: numbers, units and words as C text.

A template prints domain objects through them, so that no view model has to copy fields as text.

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
    """A number as a C literal, in the precision of the build or in another one.

    >>> from codegen.emit.render import environment
    >>> environment().from_string("{{ 0.1 | literal('double') }}").render()
    '0.1'
    """
    return literal_text(value, context["precision"] if precision is None else precision)


@pass_context
def c_type(context: Context, kind: str) -> str:
    """The C type of a field: "real" is the number type of the build, everything else is a C type already.

    >>> from codegen.emit.render import environment
    >>> environment().from_string("{{ 'real' | c_type }} {{ 'bool' | c_type }}").render(real="float")
    'float bool'
    """
    return str(context["real"]) if kind == "real" else kind


def hexadecimal(value: int, digits: int = 1) -> str:
    """A whole number in hexadecimal, with at least so many digits.

    >>> hexadecimal(257, 4)
    '0x0101'
    """
    return f"0x{value:0{digits}X}"


def decimal(value: float) -> str:
    """A number with at most twelve digits and without an exponent, which some readers of a DBC do not accept.

    >>> decimal(5e-05), decimal(500000.0)
    ('0.00005', '500000')
    """
    return np.format_float_positional(float(f"{value:.12g}"), trim="-")


def unit(text: str, symbol: str) -> str:
    """A description with its unit in front, as the comments of fields have it; "" is the unit of a ratio.

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

"""The tables of `ars.toml` as Markdown: every key with type, range, unit, default and meaning, from the models."""

from __future__ import annotations

import json
import re
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Le
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from codegen.configuration import Config
from codegen.configuration.section import Breakpoints, Meaning, Range, RangeOrZero, Section
from codegen.identify.names import Names, SignalChoice
from codegen.identify.parameters import PARAMETERS
from codegen.identify.quantities import LOG_QUANTITIES
from scripts.guide.markdown import table

KEYS = ("key", "type and range", "default", "meaning")


def meaning(model: type[BaseModel], key: str) -> str:
    """Return the meaning of a key of a table, from the model or the base that it inherits the key from.

    Raises:
        LookupError: the key has no meaning.
    """
    for base in model.__mro__:
        if issubclass(base, BaseModel) and (field := base.model_fields.get(key)):
            for one in field.metadata:
                if isinstance(one, Meaning):
                    return one.text
    raise LookupError(f"{model.__module__}: {model.__name__}.{key} has no meaning; add a Meaning to its annotation")


def _number(value: float) -> str:
    return f"{value:.10g}"


def _between(metadata: tuple[Any, ...]) -> str:
    """The range that annotations give, with its unit; empty where there is none."""
    for one in metadata:
        if isinstance(one, Range):
            unit = f" {one.unit.split(' (')[0].split(' for ')[0]}" if one.unit and not one.unit.startswith("(") else ""
            zero = ", or 0" if isinstance(one, RangeOrZero) else ""
            return f"{_number(one.low)} to {_number(one.high)}{unit}{zero}"
        if isinstance(one, Breakpoints):
            return f"increasing, {_number(one.low)} to {_number(one.high)} {one.unit}"
        if isinstance(one, FieldInfo) and one.metadata:
            return _between(tuple(one.metadata))
    low, high = (next((getattr(one, side) for one in metadata if hasattr(one, side)), None) for side in ("ge", "le"))
    assert all(isinstance(one, Ge | Le) for one in metadata if hasattr(one, "ge") or hasattr(one, "le"))
    return "" if low is None or high is None else f"{_number(low)} to {_number(high)}"


def described(annotation: Any, metadata: tuple[Any, ...] = ()) -> str:
    """A type with its range, in words. Raises TypeError for one that is not known here."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return described(arguments[0], (*arguments[1:], *metadata))
    if origin in (Union, types.UnionType):
        parts = [described(one, metadata) for one in arguments if one is not type(None)]
        return ", or ".join(dict.fromkeys(parts))
    if origin is Literal:
        return " or ".join(f"`{json.dumps(one)}`" for one in arguments)
    within = _between(metadata)
    if origin in (list, tuple):
        inner = described(arguments[0])
        return f"list of numbers, {within}" if within else f"list, each a {inner}"
    names = {float: "number", int: "whole number", bool: "`true` or `false`", str: "text"}
    if annotation not in names:
        raise TypeError(f"no words for {annotation!r}")
    return f"{names[annotation]}, {within}" if within else names[annotation]


def _default(model: type[BaseModel], key: str) -> str:
    if issubclass(model, Section) and key in model.one_of:
        return "*one required*"
    value = model.model_fields[key].get_default(call_default_factory=True)
    if value is PydanticUndefined:
        return "*required*"
    if value is None:
        return "–"
    if isinstance(value, BaseModel):
        return ", ".join(f"`{key} = {json.dumps(one)}`" for key, one in value.model_dump().items())
    if isinstance(value, float):
        return f"`{_number(value)}`"
    return f"`{json.dumps(value)}`"


def _section_of(annotation: Any) -> type[BaseModel] | None:
    """The model that an annotation stands for, also as `Model | None`."""
    candidates = [annotation, *get_args(annotation)]
    return next((one for one in candidates if isinstance(one, type) and issubclass(one, BaseModel)), None)


def _is_inline(model: type[BaseModel]) -> bool:
    """Return whether a model is written as an inline table: a signal or a sensor."""
    return any(base.__name__ in ("Signal", "Sensor") for base in model.__mro__)


def _rows(model: type[BaseModel]) -> Iterator[tuple[str, FieldInfo, str]]:
    for key, field in model.model_fields.items():
        section = _section_of(field.annotation)
        if section is None or _is_inline(section):
            yield key, field, meaning(model, key)


def _plain_docstring(model: type[BaseModel]) -> str:
    text = " ".join((model.__doc__ or "").split())
    return re.sub(r"(?<!`)\b(\w+_\w+)\b(?!`)", r"`\1`", text)


def sections(model: type[BaseModel] = Config, path: str = "") -> Iterator[tuple[str, type[BaseModel]]]:
    """Every table with its name in the file, in the file's order; `cases.NAME` and the tyre of an axle once."""
    yield path.rstrip("."), model
    for key, field in model.model_fields.items():
        name = "cases.NAME" if path + key == "cases" else path + key
        section = _section_of(field.annotation) or (_section_of(get_args(field.annotation)[1]) if key == "cases" else None)
        if section is None or _is_inline(section) or name == "tyre.rear":
            continue
        if len(section.model_fields) and section.__name__ == "Tyres":
            yield from sections(section.model_fields["front"].annotation, "tyre.front.")  # type: ignore[arg-type]
        else:
            yield from sections(section, f"{name}.")


def inline_tables() -> Iterator[tuple[str, type[BaseModel]]]:
    """The inline tables: a name for each kind, and its model."""
    from codegen.configuration.can import RealSignal, Signal

    yield "A signal that is a number of its own", Signal
    yield "A signal that is a physical value", RealSignal


def markdown() -> str:
    """The whole reference, a heading for each table."""
    lines: list[str] = []
    for name, model in sections():
        rows = [(f"`{key}`", _typed(field), _default(model, key), text) for key, field, text in _rows(model)]
        if not rows:
            continue
        title = {"": "Top level", "tyre.front": "`[tyre.front]` and `[tyre.rear]`"}.get(name, f"`[{name}]`")
        lines += [f"## {title}", "", *([] if not name else [_plain_docstring(model), ""]), table(KEYS, rows)]
    for title, model in inline_tables():
        rows = [
            (f"`{key}`", described(field.annotation, tuple(field.metadata)), _default(model, key), meaning(model, key))
            for key, field in model.model_fields.items()
        ]
        lines += [f"## {title}", "", _plain_docstring(model), "", table(KEYS, rows)]
    return "\n".join(lines)


def names_markdown() -> str:
    """The keys of a `names.toml`: those at the top, then those of a signal."""
    top = [
        (f"`{key}`", described(field.annotation, tuple(field.metadata)), _default(Names, key), meaning(Names, key))
        for key, field in Names.model_fields.items()
        if key not in LOG_QUANTITIES
    ]
    tables = [
        (
            f"`[{key}]`",
            f"{quantity.meaning}; units: {', '.join(quantity.units)}",
            ", ".join(map("`{}`".format, quantity.names.split())),
        )
        for key, quantity in LOG_QUANTITIES.items()
    ]
    signal = [
        (
            f"`{key}`",
            described(field.annotation, tuple(field.metadata)),
            _default(SignalChoice, key),
            meaning(SignalChoice, key),
        )
        for key, field in SignalChoice.model_fields.items()
    ]
    names = table(("table", "quantity", "names that need no table"), tables)
    return "\n".join([table(KEYS, top), "A table for each quantity:\n", names, "Its keys:\n", table(KEYS, signal)])


def quantities_markdown() -> str:
    """The quantities that `codegen identify` identifies."""
    rows = []
    for each in PARAMETERS:
        spread = f"{100.0 * each.spread:g} %" if each.is_relative else f"{_number(each.spread / each.size)} {each.unit}".strip()
        rows.append((each.title, f"`{each.key}`" if each.key else "–", spread, each.manoeuvre))
    return table(("quantity", "key", "spread before", "manoeuvre"), rows)


def _typed(field: FieldInfo) -> str:
    section = _section_of(field.annotation)
    if section is None:
        return described(field.annotation, tuple(field.metadata))
    keys = (f"`{key}`: {described(one.annotation, tuple(one.metadata))}" for key, one in section.model_fields.items())
    return "inline table" if section.__name__.endswith("Signal") else f"inline table; {'; '.join(keys)}"

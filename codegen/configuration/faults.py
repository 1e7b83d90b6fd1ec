"""Error message for the first fault that pydantic finds in a TOML file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from codegen.errors import CodegenError, suggestion

Location = tuple[int | str, ...]


def first_fault(
    error: ValidationError,
    where: object,
    model: type[BaseModel],
    kind: type[CodegenError],
    key_of: Callable[[Location], str] = lambda location: ".".join(map(str, location)),
) -> CodegenError:
    """Return the error of `kind` for the first fault: what is wrong, the file and key, and the remedy.

    Args:
        error: raised by validating `model`.
        where: location for the message, usually a file.
        key_of: formats a location as a key.
    """
    # A misspelt key explains a value that seems missing, so it is reported first.
    fault = min(error.errors(include_url=False), key=lambda each: each["type"] != "extra_forbidden")
    location = tuple(part for part in fault["loc"] if not _is_union_label(part))
    key = key_of(location) or "the file as a whole"
    if fault["type"] == "extra_forbidden":
        word, known = str(location[-1]), _fields_at(model, location)
        remedy = suggestion(word, known).lstrip("; ") or f"known here: {', '.join(known)}"
        return kind("unknown key", where=f"{where}: {key}", remedy=remedy)
    if fault["type"] == "value_error":
        message = str(fault["ctx"]["error"])
    elif fault["type"] in ("model_type", "model_attributes_type", "dict_type"):
        message = f"a table is needed, not {shown(fault['input'])}; write [{key}] and its keys below"
    elif fault["type"] == "missing":
        message = "this key is missing; add it"
    elif fault["type"] in ("too_short", "too_long"):
        message = _length_fault(fault)
    else:
        message = f"{fault['msg']} (not {shown(fault['input'])})"
    what, _, remedy = message.partition("; ")
    return kind(what, where=f"{where}: {key}", remedy=remedy or "correct the value")


def shown(value: object) -> str:
    """Return the `repr` of a value for a message. Python refuses to print numbers of thousands of digits."""
    try:
        return repr(value)
    except ValueError:
        return "a number with thousands of digits"


def _fields_at(model: type[BaseModel], location: Location) -> list[str]:
    """Return the keys of the table that holds the last part of `location`."""
    current = model
    for part in location[:-1]:
        field = current.model_fields.get(str(part))
        if field is not None:  # else the name of an entry or its number
            current = next(_models_in(field.annotation), current)
    return list(current.model_fields)


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models that an annotation names, such as the values of a dict or the entries of a list."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)


def _length_fault(fault: Mapping[str, Any]) -> str:
    """Return the message and the remedy for pydantic's too_short and too_long."""
    found, short = fault["ctx"]["actual_length"], fault["type"] == "too_short"
    bound = fault["ctx"]["min_length" if short else "max_length"]
    entries = "entry" if bound == 1 else "entries"
    wanted = f"at least {bound} {entries} needed" if short else f"at most {bound} {entries} possible"
    return f"{wanted}, not {found}; {'add what is missing' if short else 'remove some'}"


def _is_union_label(part: int | str) -> bool:
    # pydantic names the branch of a union ("float", "literal['off']", "function-after[...]") inside the path.
    return isinstance(part, str) and bool(re.match(r"(function-|literal\[|list\[|float\Z|\[key\]\Z|constrained-)", part))

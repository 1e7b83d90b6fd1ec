"""Common base of the tables and numbers of `ars.toml`.

Degrees and km/h exist only in the configuration; properties convert them to SI. A value that no car can have is rejected with
the range and the unit, because a wrong unit is the usual cause.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar, get_args

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationError
from pydantic_core import CoreSchema, ErrorDetails, core_schema

from codegen.errors import CodegenError, one_line, parts_of, suggestion

NAME_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,62}\Z", re.ASCII)

MAX_BREAKPOINTS = 2000
MAX_CELLS = 1_000_000
"""Largest number of cells of a map: more than any ECU can store, and well within the 64 MiB limit of an unpacked map file."""


def check_name(name: str) -> str:
    """Return `name` if it is valid in file names and C comments, else raise ValueError.

    A valid name has 1 to 63 characters: ASCII letters, digits, dots, hyphens and underscores, the first a letter or digit.
    """
    if len(name) > 63:
        raise ValueError(
            f"the name {name[:20]!r}... has {len(name)} characters; use 1 to 63 ASCII letters, digits, '.', '_' or '-'"
        )
    if not NAME_PATTERN.match(name):
        raise ValueError(
            f"the name {name!r} has characters that are not allowed in C; use 1 to 63 ASCII letters, digits, '.', '_' or '-'"
        )
    return name


def check_number(value: object) -> object:
    """Return a number unchanged. Raises ValueError for anything else."""
    # A TOML boolean or text is not a number, although Python would turn both into one.
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"a number is needed, not {value!r}")
    return value


@dataclass(frozen=True)
class Range:
    """Annotation of a number between `low` and `high` (inclusive). Error messages name the range and the unit."""

    low: float
    high: float
    unit: str = ""

    def check(self, value: float) -> float:
        """Return `value`, or raise ValueError if it is outside the range or NaN."""
        if not self.low <= value <= self.high:
            raise ValueError(f"{value:g} is outside {self.shown}; check the value and its unit")
        return value

    @property
    def shown(self) -> str:
        """Range and unit, for messages."""
        return f"{self.low:g} to {self.high:g}{f' {self.unit}' if self.unit else ''}"

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        number = core_schema.no_info_before_validator_function(check_number, handler(source))
        return core_schema.no_info_after_validator_function(self.check, number)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(schema), **self._limits(), "description": self.shown}

    def _limits(self) -> dict[str, Any]:
        """Return the limits as JSON Schema, which has no infinity."""
        limits = {"minimum": self.low, "maximum": self.high}
        return {key: value for key, value in limits.items() if math.isfinite(value)}


class RangeOrZero(Range):
    """A range that also accepts zero, for "none"."""

    def check(self, value: float) -> float:
        """Return `value`, or raise ValueError if it is neither zero nor in the range."""
        return value if value == 0.0 else super().check(value)

    @property
    def shown(self) -> str:
        """Range and unit, for messages."""
        return f"{super().shown} and not 0"

    def _limits(self) -> dict[str, Any]:
        """Return the limits as JSON Schema."""
        return {"anyOf": [{"const": 0.0}, super()._limits()]}


@dataclass(frozen=True)
class NotEmpty:
    """Annotation of a list that needs an entry."""

    def check(self, values: list[float]) -> list[float]:
        """Return `values`, or raise ValueError if there are none."""
        if not values:
            raise ValueError("the list is empty; give at least one entry, such as that of the configured car")
        return values

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.check, handler(source))


@dataclass(frozen=True)
class Breakpoints:
    """Annotation of a list of breakpoints, strictly increasing and each within `low` to `high`; None for an even axis."""

    low: float
    high: float
    unit: str

    def check(self, values: list[float] | None) -> list[float] | None:
        """Return `values`, or raise ValueError with the first breakpoint at fault."""
        if values is None:
            return None
        if not 2 <= len(values) <= MAX_BREAKPOINTS:
            raise ValueError(f"{len(values)} breakpoints; 2 to {MAX_BREAKPOINTS} are needed")
        inside = Range(self.low, self.high, self.unit)
        for value in values:
            inside.check(value)
        for index, (left, right) in enumerate(pairwise(values), start=1):
            if right <= left:
                raise ValueError(f"breakpoint {index} ({right:g}) is not above the one before it ({left:g}); sort the list")
        return values

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.check, handler(source))


@dataclass(frozen=True)
class Meaning:
    """Annotation with the meaning of a key, as Markdown for the tables of the guide.

    It has no effect on validation. A subclass that defines the key again inherits its meaning.
    """

    text: str

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        found = handler(schema)
        return {**found, "description": "; ".join(filter(None, (self.text, found.get("description"))))}


class Section(BaseModel):
    """A table of `ars.toml`: immutable, and unknown keys are errors."""

    one_of: ClassVar[tuple[str, ...]] = ()
    """Keys of which exactly one is required."""

    # defer_build: most tables are never validated alone, and building all of them takes longer than solving a map.
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, defer_build=True)


Location = tuple[int | str, ...]

NUMBER_FAULTS: Mapping[str, str] = {
    "greater_than_equal": "{} is below {ge}, the smallest value; check the value and its unit",
    "less_than_equal": "{} is above {le}, the largest value; check the value and its unit",
}
"""Type of a fault that pydantic finds in a number -> message."""
NEEDED: Mapping[str, str] = {
    "literal_error": "{expected}",
    "bool_type": "true or false",
    "string_type": "a text",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
}
"""Type of a fault -> values that are allowed."""


def needed(fault: ErrorDetails) -> str:
    """Return the message for a value of a wrong type."""
    if fault["type"] == "missing":
        return "it is missing"
    allowed = NEEDED.get(fault["type"], "another value").format(**fault.get("ctx", {}))
    return f"{allowed} is needed, not {one_line(shown(fault['input']), 80)}"


def key_of_entry(location: Location) -> str:
    """Return a key with the number of its entry, from 1 on, if the location is in a list."""
    keys = ".".join(str(part) for part in location if isinstance(part, str))
    numbers = "".join(f", entry {part + 1}" for part in location if isinstance(part, int))
    return keys + numbers


MISSING_SHOWN = 8
"""Largest number of missing keys that a message names."""


def first_fault(
    error: ValidationError,
    where: object,
    model: type[BaseModel],
    kind: type[CodegenError],
    key_of: Callable[[Location], str] = key_of_entry,
    missing_remedy: str = "",
) -> CodegenError:
    """Return the error of `kind` for the first fault, or for all missing keys: what is wrong, the file and key, and the remedy.

    Args:
        error: raised by validating `model`.
        where: location for the message, usually a file; "" if there is none.
        key_of: formats a location as a key.
        missing_remedy: what helps with missing keys, beyond adding them.
    """
    faults = error.errors(include_url=False)
    # A misspelt key or a wrong table explains a value that seems missing, so it is reported first.
    fault = min(faults, key=lambda each: (each["type"] != "extra_forbidden", each["type"] == "missing"))
    if fault["type"] == "missing":
        missing = [key_of(key) for each in faults for key in _missing_at(model, each["loc"])]
        return _missing(missing, where, kind, missing_remedy)
    location = tuple(part for part in fault["loc"] if not _is_union_label(part))
    key = key_of(location) or "the file as a whole"
    place = f"{where}: {key}" if where else key
    if fault["type"] == "extra_forbidden":
        word, known = str(location[-1]), _fields_at(model, location)
        remedy = suggestion(word, known).lstrip("; ") or f"known here: {', '.join(known)}"
        return kind("unknown key", where=place, remedy=remedy)
    if fault["type"] == "value_error":
        message = str(fault["ctx"]["error"])
    elif fault["type"] in ("model_type", "model_attributes_type", "dict_type"):
        message = f"a table is needed, not {shown(fault['input'])}; write [{key}] and its keys below"
    elif fault["type"] in NUMBER_FAULTS:
        bounds = {name: f"{bound:g}" for name, bound in fault.get("ctx", {}).items() if isinstance(bound, int | float)}
        message = NUMBER_FAULTS[fault["type"]].format(shown(fault["input"]), **bounds)
    elif fault["type"] in ("too_short", "too_long"):
        message = _length_fault(fault)
    else:
        message = needed(fault)
    what, remedy = parts_of(message)
    return kind(what, where=place, remedy=remedy or "correct the value")


def required_keys(model: type[BaseModel]) -> Iterator[Location]:
    """Yield the location of each key without a default in a table and in the tables that it requires."""
    if issubclass(model, Section):
        yield from ((key,) for key in model.one_of[:1])
    for key, field in model.model_fields.items():
        if not field.is_required():
            continue
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from ((key, *rest) for rest in required_keys(field.annotation))
        else:
            yield (key,)


def _missing_at(model: type[BaseModel], location: Location) -> Iterator[Location]:
    """Yield the missing keys at a location: those that a table requires, else the location itself."""
    location = tuple(part for part in location if not _is_union_label(part))
    field = _table_of(model, location).model_fields.get(str(location[-1]))
    table = next(_models_in(field.annotation), None) if field else None
    yield from (location,) if table is None else ((*location, *rest) for rest in required_keys(table))


def _missing(keys: Sequence[str], where: object, kind: type[CodegenError], remedy: str) -> CodegenError:
    """Return the error for missing keys."""
    listed = ", ".join(keys[:MISSING_SHOWN])
    if len(keys) > MISSING_SHOWN:
        listed += f" and {len(keys) - MISSING_SHOWN} more"
    verb, them = ("is", "it") if len(keys) == 1 else ("are", "them")
    return kind(f"{listed} {verb} missing", where=where, remedy=f"add {them}{remedy}")


def shown(value: object) -> str:
    """Return the `repr` of a value for a message. Python refuses to print numbers of thousands of digits."""
    try:
        return repr(value)
    except ValueError:
        return "a number with thousands of digits"


def _fields_at(model: type[BaseModel], location: Location) -> list[str]:
    """Return the keys of the table that holds the last part of `location`."""
    return list(_table_of(model, location).model_fields)


def _table_of(model: type[BaseModel], location: Location) -> type[BaseModel]:
    """Return the table that holds the last part of `location`."""
    current = model
    for part in location[:-1]:
        field = current.model_fields.get(str(part))
        if field is not None:  # else the name of an entry or its number
            current = next(_models_in(field.annotation), current)
    return current


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

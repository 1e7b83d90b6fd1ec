"""Common base of the tables and numbers of `ars.toml`.

Degrees and km/h exist only in the configuration; properties convert them to SI. A value that no car can have is rejected with
the range and the unit, because a wrong unit is the usual cause.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, get_args

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, ValidationError
from pydantic_core import CoreSchema, core_schema

from codegen.errors import CodegenError, suggestion

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
            in_unit = f" {self.unit}" if self.unit else ""
            raise ValueError(f"{value:g} is outside {self.low:g} to {self.high:g}{in_unit}; check the value and its unit")
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        number = core_schema.no_info_before_validator_function(check_number, handler(source))
        return core_schema.no_info_after_validator_function(self.check, number)


class RangeOrZero(Range):
    """A range that also accepts zero, for "none"."""

    def check(self, value: float) -> float:
        """Return `value`, or raise ValueError if it is neither zero nor in the range."""
        return value if value == 0.0 else super().check(value)


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


class Section(BaseModel):
    """A table of `ars.toml`: immutable, and unknown keys are errors."""

    # defer_build: most tables are never validated alone, and building all of them takes longer than solving a map.
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, defer_build=True)


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
        where: location for the message, usually a file; "" if there is none.
        key_of: formats a location as a key.
    """
    # A misspelt key explains a value that seems missing, so it is reported first.
    fault = min(error.errors(include_url=False), key=lambda each: each["type"] != "extra_forbidden")
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
    elif fault["type"] == "missing":
        message = "this key is missing; add it"
    elif fault["type"] in ("too_short", "too_long"):
        message = _length_fault(fault)
    else:
        message = f"{fault['msg']} (not {shown(fault['input'])})"
    what, _, remedy = message.partition("; ")
    return kind(what, where=place, remedy=remedy or "correct the value")


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

"""The tests of a module as plain functions of a build: what pytest would call, with `paper`, `either` and `car` filled in.

Only for tests that ask for nothing else: their own parameters, and builds.
"""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Callable, Iterator, Mapping
from types import ModuleType
from typing import Any

from tests.builds import Built
from tests.sil.test_task import car_of

Test = Callable[[Built], object]
GIVEN: Mapping[str, Callable[[Built], Any]] = {"paper": lambda built: built, "either": lambda built: built, "car": car_of}
"""Fixtures by name: what they are for a build."""


def each_test(*modules: ModuleType, but: tuple[str, ...] = ()) -> Iterator[tuple[str, Test]]:
    """Name and function of each test for every one of its parameters; those whose name holds one of `but` are left out."""
    for module in modules:
        for name, value in vars(module).items():
            if name.startswith("test_") and inspect.isfunction(value):
                yield from _expanded(name, value, but)
            elif name.startswith("Test") and inspect.isclass(value):
                for inner, _ in inspect.getmembers(value, inspect.isfunction):
                    if inner.startswith("test_"):
                        yield from _expanded(f"{name}.{inner}", getattr(value(), inner), but)


def _expanded(name: str, function: Callable[..., object], but: tuple[str, ...]) -> Iterator[tuple[str, Test]]:
    marks = [mark for mark in getattr(function, "pytestmark", []) if mark.name == "parametrize"]
    asked = set(inspect.signature(function).parameters)
    known = {word.strip() for mark in marks for word in _words(mark.args[0])}
    if any(part in name for part in but) or not asked - known <= GIVEN.keys():
        return
    for number, chosen in enumerate(itertools.product(*(_rows(mark) for mark in marks))):
        values = {word: value for row in chosen for word, value in row.items()}
        yield f"{name}[{number}]" if marks else name, _bound(function, asked - known, values)


def _bound(function: Callable[..., object], fixtures: set[str], values: dict[str, Any]) -> Test:
    return lambda built: function(**{name: GIVEN[name](built) for name in fixtures}, **values)


def _words(names: str | tuple[str, ...] | list[str]) -> list[str]:
    return [word.strip() for word in names.split(",")] if isinstance(names, str) else list(names)


def _rows(mark: Any) -> list[dict[str, Any]]:
    words = _words(mark.args[0])
    rows = []
    for value in mark.args[1]:
        given = value.values if hasattr(value, "values") and hasattr(value, "marks") else value if len(words) > 1 else (value,)
        rows.append(dict(zip(words, given, strict=True)))
    return rows

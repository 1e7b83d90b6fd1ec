"""The public names of `import codegen` as Markdown, from their docstrings."""

from __future__ import annotations

import inspect

import codegen
from scripts.guide.markdown import table


def markdown() -> str:
    """Return tables of the functions with their arguments, and of the classes."""
    values = {name: getattr(codegen, name) for name in codegen.__all__}
    functions = [
        (f"`{name}({_arguments(value)})`", _first(value)) for name, value in values.items() if inspect.isfunction(value)
    ]
    classes = [(f"`{name}`", _first(value)) for name, value in values.items() if inspect.isclass(value)]
    return "\n\n".join(
        (table(("function", "what it does"), functions).strip(), table(("class", "what it is"), classes).strip())
    )


def _arguments(function: object) -> str:
    """Return the names of the arguments, with `*` before those that are given by name, and `**` before any others."""
    parameters = inspect.signature(function).parameters.values()  # type: ignore[arg-type]
    named = [each.name for each in parameters if each.kind is each.KEYWORD_ONLY]
    others = [f"**{each.name}" for each in parameters if each.kind is each.VAR_KEYWORD]
    first = [each.name for each in parameters if each.kind is each.POSITIONAL_OR_KEYWORD]
    return ", ".join([*first, *(["*", *named] if named else []), *others])


def _first(value: object) -> str:
    """Return the first sentence of a docstring."""
    text = " ".join((inspect.getdoc(value) or "").split("\n\n")[0].split())
    return text.partition(". ")[0].rstrip(".") + "."

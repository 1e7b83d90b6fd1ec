"""Claims about helper functions, and the C of the build that they concern."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from codegen import configuration
from codegen.configuration import Config
from codegen.emit.text import literal
from codegen.verify.outcomes import Subject

FLOATS = 2**32
"""Inputs of a helper with a single-precision argument: every bit pattern."""
TEMPLATES = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).parent),
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)

_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_FUNCTION = re.compile(r"^[^\s#{}][^(){};=]*?(\w+)\(([^(){}]*)\)\s*\{", re.MULTILINE)
_REAL = re.compile(r"(?:const )?(?:float|double) \w+")
_WHOLE = re.compile(r"(?:const )?(?:u?int\d+_t|int|unsigned) \w+")


@dataclass(frozen=True)
class Claim:
    """A helper function and its required result for each input.

    The C texts are Jinja templates. They see `values`, the name of the function as `function`, and the prefix as `p`.

    Attributes:
        unit, function: without prefix, such as "map", and with "@" for it. of: suffix where a function has several claims.
        text: the claim, one sentence without its full stop.
        body: C that checks the input `x` with the bits `bits`. With few inputs, `bits` is the number of the input.
        edges: C that names further inputs of a quick run with EDGE(x). setup: C at file scope.
        start: C that resets the state of a claim that compares an input with the previous one.
        inputs: number of inputs; FLOATS, or few enough to run all of them in a quick run.
    """

    unit: str
    function: str
    text: str
    body: str
    edges: str = ""
    setup: str = ""
    start: str = ""
    of: str = ""
    inputs: int = FLOATS
    values: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the function with the suffix of the claim."""
        return f"{self.function} ({self.of})" if self.of else self.function

    def rendered(self, prefix: str) -> Claim:
        """Return the claim for a build, with its texts rendered to C."""
        function = self.function.replace("@", prefix)
        values = {**self.values, "p": prefix, "function": function}
        names = ("body", "edges", "setup", "start")
        texts = {name: TEMPLATES.from_string(getattr(self, name)).render(values) for name in names}
        return dataclasses.replace(self, function=function, **texts)


def number(value: float) -> str:
    """Return a number as a C literal in single precision."""
    return literal(value, "single")


def exact(value: float) -> str:
    """Return a C literal in double precision with the value of the single-precision number."""
    return repr(float(np.float32(value)))


def edges(*values: str) -> str:
    """Return C that runs the inputs around some numbers."""
    return "".join(f"EDGE({value});\n" for value in dict.fromkeys(values))


@dataclass(frozen=True, eq=False)
class Source:
    """The C of a build. Its definitions at file scope must start in the first column, as the templates write them."""

    subject: Subject

    @cached_property
    def config(self) -> Config:
        """Configuration of the build. Expected values come from here, not from the C."""
        return configuration.parse(self.subject.manifest["configuration"], "manifest.json: configuration")

    def path(self, unit: str) -> str:
        """Return the path of a unit such as "map"."""
        return f"src/{self.subject.prefix}_{unit}.c"

    @cached_property
    def functions(self) -> dict[str, dict[str, bool]]:
        """Functions by the path of their unit. The value is true for those that need a claim: a parameter is a real number, or
        all are integers."""
        texts = {path: content.decode("ascii") for path, content in self.subject.sources().items() if path.endswith(".c")}
        found = {path: _FUNCTION.findall(_COMMENT.sub("", text)) for path, text in texts.items()}
        return {path: {name: _takes_number(parameters) for name, parameters in each} for path, each in found.items()}


def _takes_number(parameters: str) -> bool:
    stripped = [parameter.strip() for parameter in parameters.split(",")]
    return any(map(_REAL.fullmatch, stripped)) or all(map(_WHOLE.fullmatch, stripped))

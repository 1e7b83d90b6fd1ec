"""What the exhaustive part says of a helper: what it should compute, in C that goes another way than the helper's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from codegen import config as configuration
from codegen.config import Config
from codegen.emit.text import literal
from codegen.verify.check import Subject

FLOATS = 2**32
"""Inputs of a helper that takes a number in single precision: every pattern of bits."""


@dataclass(frozen=True)
class Helper:
    """A helper and its claim. The texts are Jinja: `call(function, parameter=...)` calls a function of the unit, `p` is the
    prefix of the build, and `values` are there too. They are put into exhaustive.c.j2.

    Attributes:
        unit: without prefix, such as "map". function: with "@" for the prefix.
        claim: what is judged, one sentence without its full stop.
        body: C that judges the input `x`, whose bits are `bits`; with few inputs `bits` is the number of the input.
        inputs: how many there are; FLOATS, or few enough to be gone through in any case.
        setup: C at file scope before it. start: C that begins anew what it remembers. edges: C that names inputs by EDGE(x).
        of: tells apart several claims of one function.
    """

    unit: str
    function: str
    claim: str
    body: str
    inputs: int = FLOATS
    setup: str = ""
    start: str = ""
    edges: str = ""
    of: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)

    @property
    def floats(self) -> bool:
        """Whether its input is a number in single precision."""
        return self.inputs == FLOATS


@dataclass(frozen=True)
class Facts:
    """What the claims go by: the configuration of a build, not its C."""

    subject: Subject

    @cached_property
    def config(self) -> Config:
        """As the build was made with."""
        return configuration.parse(self.subject.manifest["configuration"], "manifest.json: configuration")

    @property
    def is_tracking(self) -> bool:
        """Whether the controller is of that kind."""
        return self.subject.kind == "tracking"

    def has(self, unit: str) -> bool:
        """Whether the build has a unit."""
        return f"src/{self.subject.prefix}_{unit}.c" in self.subject.files


def number(value: float) -> str:
    """In C, in single precision."""
    return literal(value, "single")


def edges(*values: str) -> str:
    """C that takes the inputs around some numbers."""
    return "".join(f"EDGE({value});\n" for value in values)

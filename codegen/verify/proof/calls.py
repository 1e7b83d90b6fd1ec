"""A call as claims see it, the same where the function is proven and where it is called."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from codegen.verify.proof.c_types import Scalar
from codegen.verify.proof.invariants import Path, dotted
from codegen.verify.proof.terms import Pool, Term


@dataclass(frozen=True)
class Call:
    """A call, as claims see it. What is not there raises LookupError.

    Attributes:
        scalar: a number that is an argument.
        behind: a number that an argument points to, behind the call, by the parameter's name and the path.
        before: the same before the call.
        results: the numbers of the result by their paths; () for a plain number.
    """

    pool: Pool
    scalar: Callable[[str], Term]
    behind: Callable[[str, Path], Term]
    before: Callable[[str, Path], Term]
    results: dict[Path, tuple[Scalar, Term]]


Claims = Callable[[Call], Iterator[tuple[str, Term]]]
"""In words, and what has to hold."""


def stated(claims: Claims, call: Call) -> tuple[list[tuple[str, Term]], list[str]]:
    """The claims of a call, and in words what they miss to be stated."""
    found: list[tuple[str, Term]] = []
    try:
        for text, term in claims(call):
            found.append((text, term))
    except LookupError as error:
        key = error.args[0] if error.args else ""
        if isinstance(key, tuple) and len(key) == 2 and isinstance(key[1], tuple):
            key = f"{str(key[0]).partition('~')[0]}: {dotted(key[1])}"
        name = getattr(claims, "__qualname__", "").partition(".")[0].strip("_").replace("_", " ")
        return found, [f"{name}: what it is about is not there: {key}"]
    return found, []

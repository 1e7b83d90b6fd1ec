"""Choices of names on the command line of the benchmarks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from codegen.errors import CodegenError


class WrongOption(CodegenError):
    """An option of a benchmark that cannot be used."""


def chosen(option: str, given: Sequence[str], known: Iterable[str]) -> list[str]:
    """Return the given names. Raises WrongOption for one that is not known, or for none."""
    names = list(known)
    if not given:
        raise WrongOption("it names nothing", where=option, remedy=f"known: {', '.join(names)}")
    if unknown := [each for each in given if each not in names]:
        raise WrongOption(f"unknown: {unknown[0]!r}", where=option, remedy=f"known: {', '.join(names)}")
    return list(given)

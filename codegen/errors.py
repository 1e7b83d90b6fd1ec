"""The errors that users see. Each names what is wrong, where, and what to do about it."""

from __future__ import annotations

import contextlib
import difflib
import unicodedata
from collections.abc import Iterable, Iterator


def printable(text: object) -> str:
    """Return `text` without control characters, those that change the direction of writing included; newlines and tabs stay.

    Output quotes names and values from files; an escape sequence in those must not reach the terminal.
    """
    whole = str(text)
    if all(line.isprintable() for line in whole.split("\n")):  # nearly always
        return whole
    return "".join(each for each in whole if each in "\n\t" or not unicodedata.category(each).startswith("C"))


def one_line(text: object, limit: int = 300) -> str:
    """Return `text` as a single printable line of at most `limit` characters. See `printable`."""
    flat = " ".join(printable("".join(" " if each.isspace() else each for each in str(text))).split())
    return flat if len(flat) <= limit else flat[: limit - 1] + "…"


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return an addition to a remedy: "; did you mean 'NAME'?" for the known name nearest to `word`, "" if none is near."""
    near = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def parts_of(message: object) -> tuple[str, str]:
    """Return what is wrong and the remedy of a message "what; remedy", as validators raise it in a ValueError.

    Libraries that call the validators keep only the text, so this is the one place that takes it apart.

    >>> parts_of("-5 is outside 0 to 10; check the value")
    ('-5 is outside 0 to 10', 'check the value')
    """
    what, _, remedy = str(message).partition("; ")
    return what, remedy


class CodegenError(Exception):
    """Input that cannot be used, or a request that cannot be met.

    Attributes:
        what: the fault.
        where: the file, key or index with the fault; "" if there is none to name.
        remedy: what the user can do.
        exit_code: 2, bad input or usage.
    """

    exit_code = 2

    def __init__(self, what: str, *, where: object = "", remedy: str = "") -> None:
        self.what = one_line(what)
        self.where = one_line(where)
        self.remedy = one_line(remedy)
        super().__init__(str(self))

    def __str__(self) -> str:
        place = f"{self.where}: " if self.where else ""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{place}{self.what}{remedy}"


@contextlib.contextmanager
def within(place: object) -> Iterator[None]:
    """Put `place`, usually a file, before the location of every error raised in the block; "" changes nothing."""
    try:
        yield
    except CodegenError as error:
        where = ": ".join(filter(None, (str(place), error.where)))
        raise type(error)(error.what, where=where, remedy=error.remedy) from error


class ConfigError(CodegenError):
    """`ars.toml` (or the configuration inside a map) cannot be used."""


class MapError(CodegenError):
    """A reference map breaks the contract of the `.npz` file, or cannot be extended."""


class BuildError(CodegenError):
    """The C cannot be generated, written or compiled."""


class CheckFailed(CodegenError):
    """A check failed although its input was valid (exit code 1)."""

    exit_code = 1

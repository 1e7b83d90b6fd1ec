"""Common base of all results, progress, and the conversion of arguments."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from html import escape
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from pydantic import ConfigDict, ValidationError, validate_call

from codegen import console
from codegen.errors import CheckFailed, CodegenError, one_line, suggestion

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Progress = Callable[[float], object]
"""A function that is called with the share of the work that is done, from 0 to 1."""

PathLike = str | Path
Function = TypeVar("Function", bound=Callable[..., Any])


def public(function: Function) -> Function:
    """Check the types of a public function's arguments against its annotations. Wrong ones are a CodegenError."""
    checked: list[Callable[..., Any]] = []  # made at the first call, as that takes some milliseconds

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        if not checked:
            checked.append(validate_call(config=ConfigDict(arbitrary_types_allowed=True))(function))
        try:
            return checked[0](*map(_plain, arguments), **{name: _plain(value) for name, value in named.items()})
        except ValidationError as error:
            if error.title != function.__name__:  # raised inside
                raise
            raise _wrong_argument(function, error) from None

    return cast(Function, call)


def _plain(value: Any) -> Any:
    """Return arrays and numbers of NumPy as those of Python."""
    return value.tolist() if hasattr(value, "tolist") else value


def _wrong_argument(function: Callable[..., Any], error: ValidationError) -> CodegenError:
    """Return the error for the first wrong argument."""
    fault = error.errors(include_url=False)[0]
    known = list(inspect.signature(function).parameters)
    place = fault["loc"][0]
    name, where = known[place] if isinstance(place, int) and place < len(known) else str(place), f"codegen.{function.__name__}"
    if fault["type"] == "unexpected_positional_argument":
        return CodegenError("too many arguments without a name", where=where, remedy=f"its arguments are {', '.join(known)}")
    if fault["type"] == "unexpected_keyword_argument":
        return CodegenError(
            f"there is no argument {name!r}", where=where, remedy=f"known: {', '.join(known)}{suggestion(name, known)}"
        )
    if fault["type"].startswith("missing_argument"):
        return CodegenError(f"the argument {name!r} is missing", where=where, remedy=f"its arguments are {', '.join(known)}")
    allowed = " or ".join(_allowed(get_type_hints(function, include_extras=True)[name]))
    return CodegenError(f"{one_line(repr(fault['input']), 60)} is no {name}", where=where, remedy=f"give {allowed}")


_WORDS = {bool: "True or False", int: "a whole number", float: "a number", str: "a text", Path: "a path"}
_GENERIC = {Sequence: "a list", Mapping: "a dictionary", Callable: "a function"}


def _allowed(annotation: Any) -> list[str]:
    """Return the kinds of values that an annotation allows, in words."""
    kind, parts = get_origin(annotation), get_args(annotation)
    if kind is Annotated:
        low, high = (getattr(parts[1], name, None) for name in ("ge", "le"))
        return [
            f"{each} {f'of {low:g} or more' if high is None else f'from {low:g} to {high:g}'}" for each in _allowed(parts[0])
        ]
    if kind in (Union, UnionType):
        inner = [each for each in parts if each is not NoneType and not (each is str and Path in parts)]
        return list(dict.fromkeys(word for each in inner for word in _allowed(each)))
    if kind is Literal:
        return [repr(each) for each in parts]
    if kind is Sequence:
        return ["a list of " + " or ".join(f"{each.removeprefix('a ')}s" for each in _allowed(parts[0]))]
    return [_GENERIC.get(kind) or _WORDS.get(annotation) or f"a {annotation.__name__}"]


class Result:
    """A result: attributes for programs, `lines()` for people, `to_dict()` for JSON, and a view in notebooks.

    Attributes:
        notes: what the user should know about how the result was made.
        warnings: what may be wrong with the input.
        failure: why a check failed; "" if none did.
    """

    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    failure: CheckFailed | None = None

    def lines(self) -> Iterable[str]:
        """Return the result as lines of text, tables included."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON values."""
        raise NotImplementedError

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _figure(self) -> Figure | None:
        """Return the picture for notebooks; None without one."""
        return None

    def _repr_html_(self) -> str:
        from base64 import b64encode

        told = "\n".join([*(f"warning: {text}" for text in self.warnings), *self.lines()])
        figure, picture = self._figure(), ""
        if figure is not None:
            from codegen.figures.draw import to_bytes

            picture = f'<img style="max-width: 100%" src="data:image/png;base64,{b64encode(to_bytes(figure)).decode("ascii")}">'
        return f"{picture}<pre>{escape(told)}</pre>"


def drawn(figure: Figure, path: PathLike | None) -> Figure:
    """Return a figure, after writing it if there is a path. Raises CodegenError: see `codegen.figures.draw.save`."""
    if path is not None:
        from codegen.figures.draw import save

        save(figure, path_of(path, "the path of a picture"))
    return figure


class Work:
    """Progress of a function in stages of about equal length.

    The command line shows each stage with its title; any other callback gets the share of the whole.
    """

    def __init__(self, progress: Progress | None, *names: str) -> None:
        """Name the stages, in their order; without names there is one, of any name."""
        self._progress, self._names, self._begun, self._share = progress, names, -1, 0.0
        self._is_shown = progress is console.shown

    @contextmanager
    def stage(self, name: str, title: str = "") -> Iterator[console.Tell]:
        """Begin a stage, which reports its steps. Raises ValueError: it is not one of the names that are left."""
        self._begin(name)
        if self._is_shown:
            with console.progress(title or name) as tell:
                yield tell
            return
        yield self._tell
        self._tell(1, 1)

    @contextmanager
    def status(self, name: str, title: str = "") -> Iterator[None]:
        """Begin a stage of unknown length. Raises ValueError as `stage`."""
        self._begin(name)
        with console.status(title or name, quiet=not self._is_shown):
            yield
        self._tell(1, 1)

    def _begin(self, name: str) -> None:
        names = self._names or (name,)
        if name not in names[self._begun + 1 :]:
            raise ValueError(f"{name!r} is not one of the stages that are left")
        self._begun = names.index(name)

    def _tell(self, done: int, total: int, step: str = "") -> None:
        del step
        share = (self._begun + min(done / max(total, 1), 1.0)) / max(len(self._names), 1)
        if self._progress is not None and share > self._share:  # a stage may count several times
            self._share = share
            self._progress(share)


def path_of(path: object, what: str) -> Path:
    """Return a path given as text or `Path`. Raises CodegenError for anything else."""
    if isinstance(path, (str, Path)):
        return Path(path)
    raise CodegenError(f"{what} is needed, not {type(path).__name__}", remedy="give its path as text")

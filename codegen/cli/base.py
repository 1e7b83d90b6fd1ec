"""The command group with its version, and helpers that its commands share."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import EllipsisType
from typing import TYPE_CHECKING, Any

import click

from codegen import __version__, console
from codegen.errors import CodegenError

if TYPE_CHECKING:
    from codegen.library.result import Result

PROGRAM, OTHER_NAME = "codegen", "ars-codegen"
"""Both commands; messages and help name the first one."""
COMPLETION = "_CODEGEN_COMPLETE"
"""Environment variable of completion requests; click's convention."""
PACKAGES = ("casadi", "numpy", "cffi", "python-can")
"""Packages whose version can change a result."""

json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")


def example(text: str) -> str:
    """Return an epilog that click prints unchanged."""
    return f"\b\nExample:\n  {text}"


ARGUMENT = re.compile(r"`(?:\w+\[')?(\w+)(?:'\])?=([^`]*)`")
"""An argument in the library's messages: `name=`, `name=value` or `mapping['name']=value`."""


def in_options(text: str) -> str:
    """Return a message of the library with its arguments as options: --friction instead of `friction=`.

    A parameter of click has the name of the argument that it becomes. Those of the running command come first; a remedy may
    name another command's.
    """
    if "`" not in text:  # nearly always
        return text
    context = click.get_current_context(silent=True)
    own = context.command.params if context is not None else []
    others = [each for command in cli.commands.values() for each in command.params if isinstance(each, click.Option)]
    known = {each.name: each for each in reversed((*own, *others))}
    return ARGUMENT.sub(
        lambda found: _option(known[found[1]], found[2].replace("'", "")) if found[1] in known else found[0], text
    )


def _in_options(value: Any) -> Any:
    """Return JSON values with `in_options` of all texts."""
    if isinstance(value, dict):
        return {key: _in_options(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_in_options(each) for each in value]
    return in_options(value) if isinstance(value, str) else value


def _option(parameter: click.Parameter, value: str) -> str:
    """Return a parameter with a value as the user writes it."""
    if not isinstance(parameter, click.Option):
        return value or parameter.human_readable_name
    if parameter.is_flag:
        is_other = bool(parameter.secondary_opts) and value == "False"
        return (parameter.secondary_opts if is_other else parameter.opts)[0]
    name = max(parameter.opts, key=len)
    return f"{name} {value}" if value else name


class Command(click.Command):
    """A command whose errors name its options."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command. Raises CodegenError."""
        try:
            return super().invoke(ctx)
        except CodegenError as error:
            error.what, error.where, error.remedy = map(in_options, (error.what, error.where, error.remedy))
            raise


class Commands(click.Group):
    """The group of all commands."""

    command_class = Command


def show(result: Result, as_json: bool, plot: Path | EllipsisType | None = ...) -> None:
    """Print a result as JSON, or as lines with its notes and warnings. Raises CheckFailed if a check failed.

    Args:
        plot: the picture of a command that may draw one; None if it did not.
    """
    if as_json:
        data = _in_options(result.to_dict())
        if plot is not ...:
            data["plot"] = None if plot is None else str(plot)
        console.print_json(data)
        console.warn(*(() if "warnings" in data else map(in_options, result.warnings)))
    else:
        console.note(*map(in_options, result.notes))
        console.warn(*map(in_options, result.warnings))
        console.say(*map(in_options, result.lines()))
        if isinstance(plot, Path):
            console.say(f"\nplot: {plot}")
    if result.failure is not None:
        raise result.failure


def note_edited(build: Path, edited: Sequence[str], *, quiet: bool = False) -> None:
    """Warn about generated files that were edited."""
    for path in () if quiet else edited:
        console.note(f"{build / path} was changed after the build; the changed file is used")


def _version_lines() -> Iterator[str]:
    """Yield the version of codegen, then those of its environment, from the metadata of packages that are not imported."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    from codegen.errors import BuildError
    from codegen.sil.toolchain import compiler_command, compiler_identity

    yield f"codegen, version {__version__}"
    yield f"Python {platform.python_version()}"
    for name in PACKAGES:
        try:
            yield f"{name} {version(name)}"
        except PackageNotFoundError:
            yield f"{name}: not installed"
    try:
        yield f"C compiler: {compiler_identity(compiler_command(), ())[0]}"
    except BuildError as error:
        yield f"C compiler: {error}"
    yield f"platform: {platform.system()} {platform.machine()}"


def _version(context: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    del parameter
    if wanted and not context.resilient_parsing:
        for line in _version_lines():
            console.say(line)
        context.exit()


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]}, epilog=example("codegen init my-car"))
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_version, help="Show versions and exit.")
@click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error.")
def cli() -> None:
    """From vehicle data to checked C for active rear steering."""

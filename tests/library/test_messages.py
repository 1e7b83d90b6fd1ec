"""Messages of the library name its arguments, as `friction=`; the command line prints their options instead."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

import codegen as ars
from codegen.cli.base import ARGUMENT, in_options
from codegen.cli.commands import cli

ROOT = Path(__file__).resolve().parents[2]
COMMANDS_ONLY = ("codegen/cli", "codegen/doctor.py", "codegen/explore")
"""Packages that no public function uses."""
OPTIONS = {name for command in cli.commands.values() for each in command.params for name in (*each.opts, *each.secondary_opts)}
OPTION = re.compile(r"(?<![-\w])--?[a-z][-\w]*")
MESSAGES = ("what", "where", "remedy", "cause")


def text_of(node: ast.AST) -> str:
    """Return the text of a literal; its fields as {}."""
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(each) for each in node.values)
    if isinstance(node, ast.FormattedValue):
        return "{}"
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def is_message(node: ast.AST) -> bool:
    """Return whether a statement or call makes an error, or a part of its text."""
    if isinstance(node, ast.Call):
        return ast.unparse(node.func).endswith(("Error", "Fault", "Failed", "within")) or any(
            each.arg in MESSAGES for each in node.keywords
        )
    if isinstance(node, ast.Assign):
        return any(name in MESSAGES for target in node.targets for name in ast.unparse(target).split(", "))
    return isinstance(node, ast.Raise)


def messages() -> Iterator[tuple[str, str]]:
    """Yield a place and a text for each literal of a message, and for each constant of a module that a message uses."""
    for path in sorted([*ROOT.glob("codegen/**/*.py"), *ROOT.glob("hil_sim/**/*.py")]):
        name = path.relative_to(ROOT).as_posix()
        if name.startswith(COMMANDS_ONLY):
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        constants = {
            target.id: node.value
            for node in tree.body
            if isinstance(node, ast.Assign)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        for message in filter(is_message, ast.walk(tree)):
            for node in ast.walk(message):
                found = constants.get(node.id) if isinstance(node, ast.Name) else node
                if found is not None and (text := text_of(found)):
                    yield f"{name}:{message.lineno}", text  # type: ignore[attr-defined]


def test_no_message_names_an_option() -> None:
    found = list(messages())
    assert len(found) > 1000
    assert not [(place, text) for place, text in found if OPTIONS.intersection(OPTION.findall(text))]


def test_every_argument_in_a_message_becomes_an_option() -> None:
    """The table is that of the options: each argument that a message names is the name of one."""
    named = {(place, each[1]) for place, text in messages() for each in ARGUMENT.finditer(text)}
    known = {each.name for command in cli.commands.values() for each in command.params}
    assert len({name for _, name in named}) > 20
    assert not [each for each in named if each[1] not in known]


def test_options_have_the_names_of_the_arguments() -> None:
    """A command that calls the function of its name passes its options on: other names are those of its outputs."""
    outputs = {"as_json", "plot", "csv", "files", "output", "second", "flash", "suite", "cars", "limits", "json_file"}
    outputs |= {"requirements_file", "check_only", "lateral_acceleration_max", "duration", "folder", "report_path", "run_path"}
    for name in ("build", "check", "faults", "identify", "log", "paper", "report", "sil", "solve", "suite", "tune", "verify"):
        arguments = set(inspect.signature(getattr(ars, {"sil": "run"}.get(name, name))).parameters)
        options = {each.name for each in cli.commands[name].params} - outputs
        assert options <= arguments, name


@pytest.mark.parametrize(
    ("command", "text", "words"),
    [
        ("sil", "`speed_km_h=`: too fast", "--speed-km-h: too fast"),
        ("sil", "leave `through_can=` out", "leave --can out"),
        ("hil", "`lock_step=True`; use `lock_step=False`", "--lock-step; use --real-time"),
        ("build", "again without `write=False`", "again without --check"),
        ("check", "build with `precision='double'`", "build with --precision double"),
        (
            "import",
            "add `units='vx=m/s,delta_f=rad'`, `variables['delta_f']='NAME'`",
            "add --units vx=m/s,delta_f=rad, --delta-f NAME",
        ),
        ("report", "`runs='x=/a b'`, `path=`", "--run x=/a b, --output"),
        ("verify", "`build=`", "DIR"),
        ("tune", "`mass_kg = -5` must be positive, `unknown=`", "`mass_kg = -5` must be positive, `unknown=`"),
    ],
)
def test_arguments_become_options(command: str, text: str, words: str) -> None:
    with click.Context(cli.commands[command]):
        assert in_options(text) == words

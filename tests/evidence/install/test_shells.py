"""Completion in bash, fish and zsh, with the script that `codegen completion` prints."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import ROOT

IN_BASH = """
source <(codegen completion bash)
compopt() { echo compopt "$1" "$2"; }
COMP_LINE=$1 COMP_POINT=${#1}
shift
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
"_${COMP_WORDS[0]//-/_}_completion" "${COMP_WORDS[0]}"
printf '[%s]' "${COMPREPLY[@]}"
"""
IN_FISH = 'codegen completion fish | source; complete -C "ars-codegen show my"'
IN_ZSH = """
compdef() { :; }; compadd() { print -r -- $*; }; source <(codegen completion zsh)
words=(ars-codegen show my); CURRENT=3; _ars_codegen_completion
"""
"""The completion function alone, with stubs of the line editor."""


def bash(line: str, *words: str) -> tuple[str, ...]:
    return ("bash", "--norc", "-c", IN_BASH, "bash", line, *(words or line.split()))


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        (bash("codegen show my"), "compopt -o filenames\n[my map.npz]"),
        (bash("ars-codegen init oth"), "compopt -o filenames\ncompopt -o nospace\n[other/]"),
        (bash("codegen show *"), "[]"),
        # bash splits words at the colon.
        (bash("codegen hil --bus a:v --ecu na", "codegen", "hil", "--bus", "a", ":", "v", "--ecu", "na"), "[native]"),
        (("fish", "--no-config", "-c", IN_FISH), "my map.npz"),
        (("zsh", "-f", "-c", IN_ZSH), "-U -f -- my map.npz"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_files_and_words_are_completed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...], expected: str
) -> None:
    program = tmp_path / "bin" / "codegen"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m codegen "$@"\n')
    program.chmod(0o755)
    program.with_name("ars-codegen").symlink_to(program)
    monkeypatch.chdir(tmp_path)
    Path("my map.npz").write_text("")
    Path("other").mkdir()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PATH": f"{program.parent}{os.pathsep}{os.environ['PATH']}"}
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (answer.stdout.strip(), answer.stderr) == (expected, "")

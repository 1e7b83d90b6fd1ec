"""What a shell is offered: by click's classes, through the real entry point, and in the shells that are installed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import get_args

import click
import pytest
from click.shell_completion import get_completion_class

from codegen import config as configuration
from codegen.cli import cli, completion, values
from codegen.cli.entry import COMPLETION, PROGRAM
from codegen.config import Preset
from codegen.export import runs
from hil_sim import log_formats, scenarios

from .conftest import Run

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a map, a build, a configuration of its own, and files that nothing here reads."""
    monkeypatch.chdir(tmp_path)
    for name in ("4ws2.npz", "my map.npz", "run.csv", "notes.md", ".hidden.npz", "a,b.npz"):
        Path(name).write_text("")
    Path("car.toml").write_text("[cases.mine]\n[cases.4ws-2]\n")
    Path("broken.toml").write_text("[cases")
    for folder in ("made/one", "other"):
        Path(folder).mkdir(parents=True)
    Path("made/one/manifest.json").write_text("{}")
    return tmp_path


def offered(shell: str, line: str, monkeypatch: pytest.MonkeyPatch, word: str | None = None) -> list[str]:
    """The values that the shell gets for a line that ends at the cursor; `word` as bash parts it."""
    chosen = get_completion_class(shell)
    assert chosen is not None
    words = line.split(" ")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", words[-1] if shell == "fish" else str(len(words) - 1))
    monkeypatch.setenv("COMP_WORD", words[-1] if word is None else word)
    answer = chosen(cli, {}, PROGRAM, COMPLETION).complete()
    if shell == "zsh":
        return answer.split("\n")[1::3]
    return [each.split(",", 1)[1].split("\t")[0] for each in answer.splitlines()]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("codegen so", ["solve"]),
        ("codegen solve --ca", ["--case"]),
        ("codegen solve --case ", ["fws", "4ws-1", "4ws-2"]),
        ("codegen solve --case 4", ["4ws-1", "4ws-2"]),
        ("codegen solve --config car.toml --case ", ["mine", "4ws-2"]),
        ("codegen solve --config broken.toml --case f", ["fws"]),
        ("codegen solve --config nowhere.toml --case f", ["fws"]),
        ("codegen solve --method ", ["exact", "ipopt"]),
        ("codegen solve --config ", ["broken.toml", "car.toml", "made/", "other/"]),
        ("codegen solve -o new", ["new.npz"]),
        ("codegen show ", ["4ws2.npz", "a,b.npz", "made/", "my map.npz", "other/"]),
        ("codegen show .", [".hidden.npz"]),
        ("codegen show ./4", ["./4ws2.npz"]),
        ("codegen show nowhere/", []),
        ("codegen sil --build ", ["made/", "other/"]),
        ("codegen sil --build made/", ["made/one"]),
        ("codegen verify made/", ["made/one"]),
        ("codegen sil --scenario step", ["step-steer"]),
        ("codegen sil --scenario ru", ["run.csv"]),
        ("codegen sil --suite ", ["tracking"]),
        ("codegen sil -o x", ["x.mf4", "x.parquet", "x.csv"]),
        ("codegen sil -o x.p", ["x.parquet"]),
        ("codegen hil --ecu ", ["native", "cffi", "external"]),
        ("codegen hil --log trace", ["trace.blf", "trace.asc", "trace.log", "trace.mf4"]),
        ("codegen hil --log trace.", ["trace.blf", "trace.asc", "trace.log", "trace.mf4"]),
        ("codegen ecu --ecu ", ["native", "cffi"]),
        ("codegen fmu --what c", ["controller"]),
        ("codegen completion ", ["bash", "zsh", "fish"]),
        ("codegen init ", ["made/", "other/"]),
    ],
)
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_what_fits_is_offered(here: Path, monkeypatch: pytest.MonkeyPatch, shell: str, line: str, expected: list[str]) -> None:
    assert offered(shell, line, monkeypatch) == expected


def test_names_of_buses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(values, "can_interfaces", lambda: ["can3"])
    assert offered("fish", "codegen hil --bus s", monkeypatch) == ["socketcan:can3", "socketcan:vcan0"]


def test_bash_gets_the_part_that_it_takes_for_the_word(monkeypatch: pytest.MonkeyPatch) -> None:
    """COMP_WORDBREAKS holds ':' and '='."""
    monkeypatch.setattr(values, "can_interfaces", list)
    assert offered("bash", "codegen hil --bus socketcan:", monkeypatch, ":") == ["vcan0"]
    assert offered("bash", "codegen hil --bus socketcan:v", monkeypatch, "v") == ["vcan0"]
    assert offered("bash", "codegen hil --bus=udp", monkeypatch, "udp") == ["udp_multicast:239.74.163.2"]
    assert offered("bash", "codegen solve --case=", monkeypatch, "=") == ["fws", "4ws-1", "4ws-2"]
    assert offered("bash", "codegen hil --bus socketcan:vcan0 --ecu n", monkeypatch) == ["native"]


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_take_an_option_and_its_value_for_one_word(monkeypatch: pytest.MonkeyPatch, shell: str) -> None:
    assert offered(shell, "codegen solve --case=4", monkeypatch) == ["--case=4ws-1", "--case=4ws-2"]


def test_names_that_are_kept_here_are_those_of_the_project() -> None:
    assert list(values.SCENARIOS) == list(scenarios.SCENARIOS)
    for preset in get_args(Preset):
        assert list(configuration.preset(preset).cases) == list(values.OF_EVERY_CASE)
    assert set(values.run_to_write.endings or ()) == set(runs.FORMATS)
    assert set(values.log_to_write.endings or ()) == set(log_formats.FORMATS)


def test_every_path_on_the_command_line_says_what_it_is() -> None:
    for name, command in cli.commands.items():
        for parameter in command.params:
            if isinstance(parameter.type, click.Path):
                assert isinstance(parameter.type, values.FileType), f"{name} {parameter.opts}"


def test_the_command_prints_what_the_shell_gets_in_clicks_own_way(run: Run) -> None:
    for shell in completion.SHELLS:
        printed = run("completion", shell)
        asked = ask(f"{shell}_source")
        assert printed.code == 0
        assert printed.out == asked.stdout
        assert "_CODEGEN_COMPLETE" in printed.out


def ask(instruction: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """The real command, as a shell starts it."""
    return subprocess.run(
        [sys.executable, "-m", "codegen"],
        env={**os.environ, "PYTHONPATH": str(ROOT), COMPLETION: instruction, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def test_through_the_entry_point() -> None:
    answer = ask("bash_complete", COMP_WORDS="codegen sil --sc", COMP_CWORD="2", COMP_WORD="--sc")
    assert (answer.returncode, answer.stdout, answer.stderr) == (0, "plain,--scenario\n", "")


@pytest.mark.parametrize("instruction", ["bash_complete", "nonsense", "tcsh_source"])
def test_what_no_script_asks_is_answered_with_silence(instruction: str) -> None:
    answer = ask(instruction)
    assert (answer.returncode, answer.stdout, answer.stderr) == (1, "", "")


def test_an_answer_imports_nothing_heavy() -> None:
    script = (
        "import sys; from codegen import cli\n"
        "try: cli.main()\n"
        "except SystemExit: pass\n"
        "heavy = {'casadi', 'matplotlib', 'scipy', 'numpy', 'pydantic', 'jinja2', 'cffi', 'can', 'rich'} & set(sys.modules)\n"
        "sys.exit(', '.join(sorted(heavy)) or None)\n"
    )
    for line in ("codegen solve --case ", "codegen sil --scenario s", "codegen hil --bus s", "codegen show g"):
        asked = {COMPLETION: "bash_complete", "COMP_WORDS": line, "COMP_CWORD": "3"}
        environment = {**os.environ, "PYTHONPATH": str(ROOT), **asked}
        result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment, check=False)
        assert result.returncode == 0, result.stderr


@pytest.fixture
def on_path(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment in which `codegen` is this command."""
    folder = tmp_path_factory.mktemp("bin")
    program = folder / "codegen"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m codegen "$@"\n')
    program.chmod(0o755)
    return {**os.environ, "PYTHONPATH": str(ROOT), "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"}


IN_BASH = """
source <(codegen completion bash)
compopt() { echo compopt "$1" "$2"; }
COMP_LINE=$1 COMP_POINT=${#1}
shift
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
_codegen_completion codegen
printf '[%s]' "${COMPREPLY[@]}"
"""


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("codegen", "so"), "[solve]"),
        (("codegen", "show", "my"), "compopt -o filenames\n[my map.npz]"),
        (("codegen", "init", "oth"), "compopt -o filenames\ncompopt -o nospace\n[other/]"),
        (("codegen", "show", "*"), "[]"),
        (("codegen", "hil", "--bus", "socketcan", ":", "vcan", "--ecu", "na"), "[native]"),  # as bash parts it
    ],
)
def test_in_bash(here: Path, on_path: dict[str, str], words: tuple[str, ...], expected: str) -> None:
    command = ["bash", "--norc", "-c", IN_BASH, "bash", " ".join(words).replace(" : ", ":"), *words]
    answer = subprocess.run(command, env=on_path, capture_output=True, text=True, check=False)
    assert (answer.stdout, answer.stderr) == (expected, "")


@pytest.mark.skipif(shutil.which("fish") is None, reason="no fish")
def test_in_fish(here: Path, on_path: dict[str, str]) -> None:
    script = 'codegen completion fish | source; complete -C "codegen show my"'
    answer = subprocess.run(["fish", "--no-config", "-c", script], env=on_path, capture_output=True, text=True, check=False)
    assert answer.stdout.splitlines() == ["my map.npz"]


@pytest.mark.skipif(shutil.which("zsh") is None, reason="no zsh")
def test_in_zsh(here: Path, on_path: dict[str, str]) -> None:
    """The function alone, with stand-ins for what the line editor gives."""
    script = (
        "compdef() { :; }; compadd() { print -r -- $*; }; source <(codegen completion zsh); "
        "words=(codegen show my); CURRENT=3; _codegen_completion"
    )
    answer = subprocess.run(["zsh", "-f", "-c", script], env=on_path, capture_output=True, text=True, check=False)
    assert answer.stdout.splitlines() == ["-U -f -- my map.npz"]

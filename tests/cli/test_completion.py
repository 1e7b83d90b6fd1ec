"""Shell completion: through the classes of click and through the real entry point."""

from pathlib import Path
from typing import get_args

import click
import pytest
from click.shell_completion import get_completion_class

from codegen import configuration
from codegen.cli import cli, completion, options
from codegen.cli.base import COMPLETION, PROGRAM
from codegen.configuration import Preset
from codegen.export import runs
from codegen.sil.vector import ISAS
from hil_sim import logs, scenarios

from .conftest import MAIN, Run, python


@pytest.fixture
def files(here: Path) -> None:
    """Create a map, a build, a configuration, and files that no command reads."""
    for name in ("4ws2.npz", "my map.npz", "run.csv", "notes.md", ".hidden.npz", "a,b.npz"):
        Path(name).write_text("")
    Path("car.toml").write_text("[cases.mine]\n[cases.4ws-2]\n")
    Path("broken.toml").write_text("[cases")
    for folder in ("made/one", "other"):
        Path(folder).mkdir(parents=True)
    Path("made/one/manifest.json").write_text("{}")


def offered(shell: str, line: str, monkeypatch: pytest.MonkeyPatch, word: str | None = None) -> list[str]:
    """Return the completions for a line that ends at the cursor. `word` is the last word as split by bash."""
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
        ("codegen solve --case 4", ["4ws-1", "4ws-2"]),
        ("codegen solve --config car.toml --case ", ["mine", "4ws-2", "zero-sideslip", "variable-wheelbase", "envelope"]),
        ("codegen solve --config broken.toml --case f", ["fws"]),
        ("codegen solve --config ", ["broken.toml", "car.toml", "made/", "other/"]),
        ("codegen show ", ["4ws2.npz", "a,b.npz", "made/", "my map.npz", "other/"]),
        ("codegen sil --build ", ["made/", "other/"]),
        ("codegen sil -o x.p", ["x.parquet"]),
        ("codegen hil --log trace.", ["trace.blf", "trace.asc", "trace.log", "trace.mf4"]),
        ("codegen report --run name=ru", ["name=run.csv"]),
    ],
)
def test_matching_values_are_offered(files: None, monkeypatch: pytest.MonkeyPatch, line: str, expected: list[str]) -> None:
    for shell in completion.SHELLS:
        assert offered(shell, line, monkeypatch) == expected


def test_bash_gets_the_part_after_its_word_break(monkeypatch: pytest.MonkeyPatch) -> None:
    """COMP_WORDBREAKS contains ':' and '='. In other shells an option and its value are one word."""
    monkeypatch.setattr(options, "can_interfaces", lambda: ["can3"])
    assert offered("fish", "codegen hil --bus s", monkeypatch) == ["socketcan:can3", "socketcan:vcan0"]
    assert offered("bash", "codegen hil --bus socketcan:", monkeypatch, ":") == ["can3", "vcan0"]
    assert offered("bash", "codegen hil --bus=udp", monkeypatch, "udp") == ["udp_multicast:239.74.163.2"]
    assert offered("zsh", "codegen solve --case=4", monkeypatch) == ["--case=4ws-1", "--case=4ws-2"]


def test_names_copied_for_speed_match_the_project() -> None:
    (isa,) = (parameter.type for parameter in cli.commands["sweep"].params if parameter.name == "isa")
    assert isinstance(isa, click.Choice) and tuple(isa.choices) == ISAS
    assert list(options.SCENARIO_NAMES) == list(scenarios.BUILT_IN)
    for preset in get_args(Preset):
        assert list(configuration.preset(preset).cases) == list(options.OF_EVERY_CASE)
    assert list(configuration.REFERENCE_CASES) == list(options.FOR_COMPARISON)
    assert set(options.run_to_write.endings or ()) == set(runs.RUN_FORMATS)
    assert set(options.log_to_write.endings or ()) == set(logs.LOG_WRITERS)


def test_through_the_entry_point(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    printed = {shell: run("completion", shell) for shell in completion.SHELLS}
    assert [(answer.code, answer.out.count(COMPLETION)) for answer in printed.values()] == [(0, 2)] * 3  # for both names
    monkeypatch.setenv(COMPLETION, "zsh_source")  # click's own mechanism
    assert printed["zsh"].out == run().out
    asked = {COMPLETION: "bash_complete", "COMP_WORDS": "codegen sil --sc", "COMP_CWORD": "2", "COMP_WORD": "--sc"}
    answer = python(MAIN, **asked)
    assert (answer.returncode, answer.stdout, answer.stderr) == (0, "plain,--scenario\n", "")
    monkeypatch.setenv(COMPLETION, "nonsense")
    assert (run().code, run().out, run().err) == (1, "", "")

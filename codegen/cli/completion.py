"""Shell completion: click's, with values that suit each option, and the command that prints the script for a shell.

A shell runs the command with `_CODEGEN_COMPLETE` set. The command then avoids slow imports and prints only completions.
The value types are in `codegen.cli.options`.
"""

from __future__ import annotations

import os

import click
from click.shell_completion import (
    BashComplete,
    CompletionItem,
    FishComplete,
    ShellComplete,
    ZshComplete,
    add_completion_class,
    shell_complete,
    split_arg_string,
)

from codegen import console
from codegen.cli.base import COMPLETION, OTHER_NAME, PROGRAM, cli, example
from codegen.cli.options import PATH

SHELLS = ("bash", "zsh", "fish")


def complete(group: click.Command, program: str, variable: str, instruction: str) -> int:
    """Answer a completion request of a shell and return the exit code.

    Args:
        program: name of the command.
        variable: environment variable that the shell sets.
        instruction: its value, such as "bash_complete" or "bash_source".
    """
    try:
        return shell_complete(group, {}, program, variable, instruction)
    except (KeyError, ValueError):  # not called by a completion script, which would set COMP_WORDS and COMP_CWORD
        return 1


_BASH = """\
%(complete_func)s() {
    local IFS=$'\\n' type value response
    # The line and not COMP_WORDS, which bash parts at ':' and '=' too.
    response=$(env COMP_WORDS="${COMP_LINE:0:COMP_POINT}" COMP_CWORD=$COMP_CWORD COMP_WORD="${COMP_WORDS[COMP_CWORD]}" \\
        %(complete_var)s=bash_complete "$1" 2>/dev/null)
    COMPREPLY=()
    while IFS=',' read -r type value; do
        case $type in
            path) compopt -o filenames; COMPREPLY+=("$value") ;;
            plain) COMPREPLY+=("$value") ;;
        esac
    done <<< "$response"
    if [[ ${#COMPREPLY[@]} -eq 1 && ${COMPREPLY[0]} == */ ]]; then
        compopt -o nospace
    fi
}

complete -o nosort -F %(complete_func)s %(prog_name)s
"""


class ForBothNames(ShellComplete):
    """A completion script for both names of the command."""

    def source(self) -> str:
        """Return the scripts of both names; each calls the command under its own name."""
        other = type(self)(self.cli, {}, OTHER_NAME, self.complete_var)
        return super().source() + self.source_template % other.source_vars()


class PathsInBash(ForBothNames, BashComplete):
    """Completion for bash: click's, with quoting of special characters in file names, no space after a folder, and support
    for ':' and '=' in values."""

    source_template = _BASH

    def get_completion_args(self) -> tuple[list[str], str]:
        """Return the complete words before the one being typed, and that word."""
        line = os.environ["COMP_WORDS"]
        words = split_arg_string(line)[1:]
        if line[-1:].isspace() and not line.endswith("\\ "):
            words.append("")
        return words[:-1], words[-1] if words else ""

    def complete(self) -> str:
        """Return click's completions, reduced to the part of each value that bash regards as the word."""
        arguments, incomplete = self.get_completion_args()
        items = self.get_completions(arguments, incomplete)
        if incomplete.startswith("-"):
            incomplete = incomplete.partition("=")[2]
        typed = os.environ.get("COMP_WORD", incomplete).lstrip(":=")
        start = incomplete.rfind(":") + 1 if ":" not in typed else 0
        for item in items:
            item.value = item.value[start:]
        return "\n".join(map(self.format_completion, items))


class _WholeWord(ForBothNames):
    """Completion for shells that treat `--option=value` as one word: a completion replaces the whole word."""

    def get_completions(self, args: list[str], incomplete: str) -> list[CompletionItem[str]]:
        """Return click's completions, with the option before each value."""
        items = super().get_completions(args, incomplete)
        option, equals, _ = incomplete.partition("=")
        if option.startswith("-") and equals:
            for item in items:
                item.value = f"{option}={item.value}"
        return items


class PathsInZsh(_WholeWord, ZshComplete):
    """Completion for zsh: click's, with no space after a folder."""

    source_template = ZshComplete.source_template.replace(
        '        elif [[ "$type" == "dir" ]]; then',
        '        elif [[ "$type" == "path" ]]; then\n'
        '            if [[ "$key" == */ ]]; then\n'
        '                compadd -U -f -S "" -- "$key"\n'
        "            else\n"
        '                compadd -U -f -- "$key"\n'
        "            fi\n"
        '        elif [[ "$type" == "dir" ]]; then',
    )


class PathsInFish(_WholeWord, FishComplete):
    """Completion for fish, which itself quotes and continues after a folder. A value may contain a comma."""

    source_template = FishComplete.source_template.replace('string split ","', 'string split -m 1 ","')

    def format_completion(self, item: CompletionItem[str]) -> str:
        """Return a path like any other value."""
        return super().format_completion(CompletionItem(item.value, "plain" if item.type == PATH else item.type, item.help))


for shell in (PathsInBash, PathsInZsh, PathsInFish):
    add_completion_class(shell)


PLACES = """\
In the file that the shell reads at its start:

\b
  bash  ~/.bashrc                           eval "$(codegen completion bash)"
  zsh   ~/.zshrc, after compinit            eval "$(codegen completion zsh)"
  fish  ~/.config/fish/config.fish          codegen completion fish | source
"""


@cli.command(
    short_help="Print the shell completion script.",
    help=f"Print the script that makes a shell complete commands, options, files and names.\n\n{PLACES}",
    epilog=example("codegen completion bash"),
)
@click.argument("shell", type=click.Choice(SHELLS))
@click.pass_context
def completion(context: click.Context, shell: str) -> None:
    """Print the completion script of a shell."""
    from click.shell_completion import get_completion_class

    chosen = get_completion_class(shell)
    assert chosen is not None
    console.say(chosen(context.find_root().command, {}, PROGRAM, COMPLETION).source().rstrip("\n"))

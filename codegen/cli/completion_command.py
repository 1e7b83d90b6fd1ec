"""`codegen completion`: print the script that enables completion in a shell."""

from __future__ import annotations

import click

from codegen import console
from codegen.cli.base import example

PLACES = """\
In the file that the shell reads at its start:

\b
  bash  ~/.bashrc                           eval "$(codegen completion bash)"
  zsh   ~/.zshrc, after compinit            eval "$(codegen completion zsh)"
  fish  ~/.config/fish/config.fish          codegen completion fish | source
"""


@click.command(
    short_help="Print the shell completion script.",
    help=f"Print the script that makes a shell complete commands, options, files and names.\n\n{PLACES}",
    epilog=example("codegen completion bash"),
)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def completion(context: click.Context, shell: str) -> None:
    """Print the completion script of a shell."""
    from click.shell_completion import get_completion_class

    from codegen.cli import completion as shells
    from codegen.cli.entry import COMPLETION, PROGRAM

    chosen = get_completion_class(shell)
    assert chosen is not None
    assert shell in shells.SHELLS
    console.say(chosen(context.find_root().command, {}, PROGRAM, COMPLETION).source().rstrip("\n"))


COMMANDS = (completion,)

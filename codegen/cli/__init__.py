"""The `codegen` command: parse, call, print. What it calls is imported where it is used, so that `--help` stays quick."""

from __future__ import annotations

from codegen.cli import bench_commands, map_commands, tune_command, verify_command
from codegen.cli.base import cli
from codegen.cli.entry import main

__all__ = ["cli", "main"]

for command in (*map_commands.COMMANDS, *tune_command.COMMANDS, *bench_commands.COMMANDS, *verify_command.COMMANDS):
    cli.add_command(command)

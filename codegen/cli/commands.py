"""The group `cli` with all its commands."""

from __future__ import annotations

from codegen.cli import (
    bench_commands,
    check_commands,
    completion,
    exchange_commands,
    map_commands,
    show_commands,
    sil_command,
    sweep_command,
    tune_command,
)
from codegen.cli.base import cli

__all__ = ["cli"]

MODULES = (
    map_commands,
    show_commands,
    exchange_commands,
    tune_command,
    sil_command,
    bench_commands,
    check_commands,
    sweep_command,
    completion,
)

for module in MODULES:
    for command in module.COMMANDS:
        cli.add_command(command)

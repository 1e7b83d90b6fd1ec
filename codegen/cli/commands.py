"""The group `cli` with all its commands."""

from __future__ import annotations

from codegen.cli import (
    bench_commands,
    check_commands,
    completion_command,
    explore_command,
    export_commands,
    import_command,
    map_commands,
    report_command,
    show_command,
    sweep_command,
    tune_command,
)
from codegen.cli.base import cli

__all__ = ["cli"]

MODULES = (
    map_commands,
    show_command,
    import_command,
    tune_command,
    explore_command,
    bench_commands,
    check_commands,
    report_command,
    sweep_command,
    export_commands,
    completion_command,
)

for module in MODULES:
    for command in module.COMMANDS:
        cli.add_command(command)

"""The group `cli` with all its commands."""

from __future__ import annotations

from codegen.cli import (
    a2l_command,
    bench_commands,
    check_command,
    completion_command,
    doctor_command,
    explore_command,
    firmware_command,
    fmu_command,
    import_command,
    map_commands,
    report_command,
    show_command,
    sweep_command,
    tune_command,
    verify_command,
)
from codegen.cli.base import cli

__all__ = ["cli"]

MODULES = (
    map_commands,
    show_command,
    check_command,
    import_command,
    tune_command,
    explore_command,
    bench_commands,
    verify_command,
    report_command,
    sweep_command,
    a2l_command,
    firmware_command,
    fmu_command,
    doctor_command,
    completion_command,
)

for module in MODULES:
    for command in module.COMMANDS:
        cli.add_command(command)

"""The group `cli` with all its commands: each module adds its own when it is imported."""

from __future__ import annotations

from codegen.cli import (  # noqa: F401
    bench_commands,
    check_commands,
    completion,
    exchange_commands,
    identify_command,
    map_commands,
    show_commands,
    sil_command,
    sweep_command,
)
from codegen.cli.base import cli

__all__ = ["cli"]

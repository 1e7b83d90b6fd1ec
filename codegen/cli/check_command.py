"""The command that looks for contradictions and implausible values without driving anything."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from codegen import console
from codegen.cli.base import example, json_option
from codegen.cli.values import checked_path, configuration_file
from codegen.errors import CheckFailed

EXAMPLE = "codegen check ars.toml\n  codegen check 4ws2.npz\n  codegen check generated/4ws2"


@click.command(short_help="Check a car, a map or a build for plausibility.", epilog=example(EXAMPLE))
@click.argument("subject", metavar="ars.toml|MAP.npz|BUILD", type=checked_path)
@click.option(
    "--config", "config_path", type=configuration_file, help="For a map: ars.toml; by default the map's own configuration."
)
@json_option
def check(subject: Path, config_path: Path | None, as_json: bool) -> None:
    """Check a configuration, a map or a build for implausible values and contradictions, in seconds and without driving it.

    The car: yaw inertia, tyre stiffness, understeer gradient. Across sections: limits against the actuator, rates, the lag
    that the gains were tuned for. The map, and the build that would be made of it: units, the share that actuator and limiter
    reach, slip bounds, margins, and whatever `codegen build` refuses. The build: the same, edited files, verification.
    `solve`, `tune` and `build` report the same warnings. Exit code 1 where there is any.
    """
    from codegen.plausibility.check import check_path

    with console.status(f"checking {subject}"):
        found = check_path(subject, config_path)
    if as_json:
        facts: dict[str, Any] = {"subject": str(subject), "kind": found.kind}
        console.print_json({**facts, **found.facts, "notes": list(found.notes), "warnings": list(found.warnings)})
    else:
        for line in found.lines:
            console.say(line)
        for text in found.notes:
            console.note(text)
        for text in found.warnings:
            console.warn(text)
    if found.warnings:
        one = len(found.warnings) == 1
        count = "1 warning" if one else f"{len(found.warnings)} warnings"
        raise CheckFailed(count, where=subject, remedy=f"resolve {'it' if one else 'them'}")
    if not as_json:
        console.say("no warnings")


COMMANDS = (check,)

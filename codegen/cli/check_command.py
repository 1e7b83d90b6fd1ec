"""The command that looks for contradictions and implausible values without driving anything."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from codegen import console
from codegen.cli.base import example, json_option
from codegen.cli.values import checked_path
from codegen.errors import CheckFailed

EXAMPLE = "codegen check ars.toml\n  codegen check 4ws2.npz\n  codegen check generated/4ws2"


@click.command(short_help="Check a car, a map or a build for plausibility.", epilog=example(EXAMPLE))
@click.argument("subject", metavar="ars.toml|MAP.npz|BUILD", type=checked_path)
@json_option
def check(subject: Path, as_json: bool) -> None:
    """Check a configuration, a map or a build for implausible values and contradictions, in seconds and without driving it.

    The car: yaw inertia, tyre stiffness, understeer gradient. Across sections: limits against the actuator, rates, the lag
    that the gains were tuned for. The map: units, the share that actuator and limiter reach, slip bounds. The build: margins,
    edited files, verification. `solve`, `tune` and `build` report the same warnings. Exit code 1 where there is any.
    """
    from codegen.plausibility.check import check_path

    with console.status(f"checking {subject}"):
        found = check_path(subject)
    if as_json:
        facts: dict[str, Any] = {"subject": str(subject), "kind": found.kind}
        console.print_json({**facts, **found.facts, "warnings": list(found.warnings)})
    else:
        for line in found.lines:
            console.say(line)
        for text in found.warnings:
            console.warn(text)
    if found.warnings:
        count = len(found.warnings)
        raise CheckFailed(f"{count} warning{'s' if count > 1 else ''}", where=subject, remedy="mend what they name")
    if not as_json:
        console.say("no warnings")


COMMANDS = (check,)

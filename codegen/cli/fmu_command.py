"""`codegen fmu`: the C of a build for Simulink, CarMaker and other simulators."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from codegen import console
from codegen.cli.base import example, json_option
from codegen.cli.run_options import build_option
from codegen.cli.values import FileType

if TYPE_CHECKING:
    from codegen.export.fmu.standard import Version
    from codegen.export.fmu.variables import What

SUFFIX = ".fmu"


@click.command(
    short_help="Write an FMU for other simulators.",
    epilog=example("codegen fmu --build generated/4ws2 --what controller -o controller.fmu"),
)
@build_option
@click.option(
    "--what",
    type=click.Choice(["controller", "plant", "loop"]),
    required=True,
    help="The controller, the car of the build's configuration, or both in closed loop.",
)
@click.option("--fmi", "version", type=click.Choice(["2", "3"]), default="2", show_default=True, help="FMI 2.0 or 3.0.")
@click.option(
    "-o", "--output", required=True, type=FileType((SUFFIX,), to_write=True), metavar="FMU", help="The file to write, .fmu."
)
@json_option
def fmu(build_path: Path, what: What, version: Version, output: Path, as_json: bool) -> None:
    """Write a co-simulation FMU of a build, with its sources and the binary for this machine.

    A simulator that imports it runs the build's own C, with the bits that `codegen sil` gives.
    """
    from codegen.cli.bench_report import note_edited
    from codegen.emit.outputs import check_output
    from codegen.export.fmu.export import make_fmu
    from codegen.files import write_atomically

    check_output(output, SUFFIX, (build_path,))
    with console.status(f"compiling {build_path}"):
        made = make_fmu(build_path, what, version)
    note_edited(build_path, made.edited, quiet=as_json)
    write_atomically(output, made.content)
    counted = {role: sum(each.role == role for each in made.variables) for role in ("input", "output", "fixed", "tunable")}
    parameters = counted["fixed"] + counted["tunable"]
    if as_json:
        console.print_json(
            {
                "fmu": str(output),
                "what": what,
                "fmi": f"{version}.0",
                "model_identifier": made.identifier,
                "token": made.token,
                "platform": made.platform,
                "internal_step_s": made.internal_step,
                "bytes": len(made.content),
                "inputs": counted["input"],
                "outputs": counted["output"],
                "parameters": parameters,
                "edited": list(made.edited),
            }
        )
        return
    console.say(
        f"{output}: FMI {version}.0 co-simulation, {what}, for {made.platform}; {counted['input']} inputs, "
        f"{counted['output']} outputs, {parameters} parameters; steps of whole multiples of {made.internal_step:g} s"
    )


COMMANDS = (fmu,)

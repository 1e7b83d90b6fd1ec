"""An export is added by its module, its command, and one line each in the list of commands and in the synopsis."""

from __future__ import annotations

import csv
import json

from tests.additions.copy import ROOT, Copy

EXPORT = '''"""The adjustable parameters of a build as a CSV table."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from codegen import configuration
from codegen.emit.controller_view import controller_parameters
from codegen.emit.inputs_view import inputs_parameters
from codegen.emit.limiter_view import limiter_parameters
from codegen.emit.manifest import read_build

COLUMNS = ("struct", "name", "value", "low", "high", "unit")


def parameter_table(build: Path) -> str:
    """Return one row for each parameter, in SI units; array elements are separated by spaces.

    Raises:
        BuildError: `build` is not a build folder.
    """
    config = configuration.parse(read_build(build)["configuration"], "manifest.json: configuration")
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\\n")
    writer.writerow(COLUMNS)
    groups = {"controller": controller_parameters, "inputs": inputs_parameters, "limiter": limiter_parameters}
    for struct, parameters_of in groups.items():
        for each in parameters_of(config):
            values = each.value if isinstance(each.value, tuple) else (each.value,)
            text = " ".join(repr(value) for value in values)
            writer.writerow((struct, each.name, text, each.low, each.high, each.unit))
    return table.getvalue()
'''

COMMAND = '''"""`codegen parameters`: the parameters of a build as a table."""

from __future__ import annotations

from pathlib import Path

import click

from codegen import console
from codegen.cli.base import cli, example, json_option
from codegen.cli.options import build_option, csv_to_write


@cli.command(
    short_help="Write the parameters of a build as CSV.",
    epilog=example("codegen parameters --build generated/4ws2 -o parameters.csv"),
)
@build_option
@click.option("-o", "--output", required=True, type=csv_to_write, metavar="CSV", help="The file to write, .csv.")
@json_option
def parameters(build: Path, output: Path, as_json: bool) -> None:
    """Write name, value, range and unit of each parameter of a build."""
    from codegen.emit.folder import check_output
    from codegen.export.parameter_table import parameter_table
    from codegen.files import write_atomically

    check_output(output, ".csv", (build,))
    text = parameter_table(build)
    write_atomically(output, text.encode("ascii"))
    count = text.count("\\n") - 1
    if as_json:
        console.print_json({"csv": str(output), "parameters": count})
        return
    console.say(f"{output}: {count} parameters")
'''

SYNOPSIS = "codegen parameters --build DIR -o CSV               name, value, range and unit of each parameter of a build\n"

IMPORTED = "    map_commands,\n    parameters_command,"


def test_an_export_touches_at_most_four_files(tree: Copy) -> None:
    tree.add("codegen/export/parameter_table.py", EXPORT)
    tree.add("codegen/cli/parameters_command.py", COMMAND)
    tree.replace("codegen/cli/commands.py", "    map_commands,", IMPORTED)
    tree.replace("docs/interface.md", "codegen verify DIR [--quick]", f"{SYNOPSIS}codegen verify DIR [--quick]")

    build, output = ROOT / "generated" / "4ws2", tree.root / "parameters.csv"
    printed = tree.run("-m", "codegen", "parameters", "--build", str(build), "-o", str(output), "--json")
    with output.open(newline="") as file:
        rows = {(row["struct"], row["name"]): row for row in csv.DictReader(file)}
    assert json.loads(printed)["parameters"] == len(rows)
    assert rows["controller", "rear_angle_max"]["unit"] == "rad" and rows["controller", "slow_speed"]["unit"] == "m/s"
    for row in rows.values():
        values = [float(value) for value in row["value"].split()]
        assert values and all(float(row["low"]) <= value <= float(row["high"]) for value in values), row

    # Help and completion list the command, and it is documented.
    assert "Write the parameters of a build as CSV." in tree.run("-m", "codegen", "--help")
    words = {"_CODEGEN_COMPLETE": "bash_complete", "COMP_WORDS": "codegen param", "COMP_CWORD": "1"}
    assert "parameters" in tree.run("-m", "codegen", more=words)
    tree.run("-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/docs/test_pages.py", "-k", "names_every_command")
    assert len(tree.touched) <= 4

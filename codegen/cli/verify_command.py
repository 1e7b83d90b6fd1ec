"""`codegen verify`: the checks of a build."""

from __future__ import annotations

from pathlib import Path

import click

from codegen import console
from codegen.cli.base import example
from codegen.cli.values import FileType, build_folder
from codegen.errors import CheckFailed


@click.command(epilog=example("codegen verify generated/4ws2"))
@click.argument("build", type=build_folder, metavar="DIR")
@click.option("--quick", is_flag=True, help="Run only the checks that finish in half a minute.")
@click.option(
    "--json", "json_file", type=FileType((".json",), to_write=True), metavar="FILE", help="Write the result as JSON too."
)
def verify(build: Path, quick: bool, json_file: Path | None) -> None:
    """Verify the C of a build.

    Compiles it for ECU cores, analyses it, runs it on emulated processors, counts its instructions, proves its bounds, and
    feeds it faults and random bytes. Writes verify.json and verify.md, the safety manual, into the build. Exits with 1 if a
    check fails, or none could be run; one whose tool is missing is not run, and says so.
    """
    from codegen.emit.outputs import check_output
    from codegen.files import write_atomically
    from codegen.sil.software import require_can_side
    from codegen.verify import record, runner, table
    from codegen.verify.check import Effort, Subject, Verdict

    check_output(json_file, ".json", (build,))
    subject = Subject.read(build)
    require_can_side(subject.manifest, build)
    record.require_place(build)
    for path in subject.edited:
        console.note(f"{build / path} is not as it was built; what follows is about the file as it is")
    with console.progress(f"verifying {build}") as progress:
        report = runner.run(subject, Effort(quick), progress)
    if json_file is not None:
        write_atomically(json_file, record.render(report))
    console.say(table.table(report))
    for line in table.findings(report):
        console.say(line)
    if record.write(report, build):
        console.say(f"written: {build / record.JSON}, {build / record.MANUAL}")
    else:
        console.note(f"{build / record.JSON} and {record.MANUAL} are of a whole run of the same files, and stay")
    passed, not_run = report.count(Verdict.PASSED), report.count(Verdict.NOT_RUN)
    if report.failed:
        raise CheckFailed(
            f"{len(report.failed)} of {len(report.outcomes)} checks failed: {', '.join(report.failed)}", where=build
        )
    if not passed:
        raise CheckFailed("no check could be run", where=build, remedy='pip install "ars-codegen[verify]"')
    console.say(f"{passed} checks passed" + (f", {not_run} not run" if not_run else ""))


COMMANDS = (verify,)

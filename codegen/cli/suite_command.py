"""The command that runs a test suite."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

import codegen
from codegen import console
from codegen.cli.base import cli, example, json_option, show
from codegen.cli.options import build_folder, check_picture, configuration_file, folder_to_write, picture_to_write
from codegen.errors import CodegenError
from codegen.files import resolved

SUITES = ("tracking", "cars", "references")


@dataclass(frozen=True, kw_only=True)
class SuiteChoices:
    """Options of a suite: a picture of the overview, or a folder for all pictures."""

    build: Path | None
    plot: Path | None
    files: tuple[Path, ...]
    cars: int | None
    seed: int | None
    limits: Path | None
    as_json: bool

    def run(self, name: str, note: str = "") -> None:
        """Run a suite, draw its pictures, and print and judge its results after a note. Raises CodegenError, CheckFailed."""
        self._check(name)
        found = codegen.suite(self.build, name, cars=self.cars, seed=self.seed, limits=self.limits, progress=console.shown)
        if self.plot is not None:
            found.plot(self.plot)
        for folder in self.files:
            found.plot_all(folder)
        if note and not self.as_json:
            console.note(note)
        show(found, self.as_json)

    def _check(self, name: str) -> None:
        """Reject paths that cannot be written, before anything runs. Raises CodegenError."""
        from codegen.emit.outputs import check_output

        if name == "cars" and (self.plot is not None or self.files):
            where = "--output" if self.plot is None else "--plot"
            raise CodegenError("this suite draws no pictures", where=where, remedy="leave it out; --json has all figures")
        if len(self.files) > 1:
            raise CodegenError("a second folder for the pictures", where=self.files[1], remedy="name one")
        check_picture(self.plot)
        for folder in self.files:
            if folder.exists() and not folder.is_dir():
                raise CodegenError("not a folder", where=folder, remedy="name a folder for the pictures")
            # The folder is created when there is something to write.
            place = folder if folder.is_dir() else resolved(folder).parent
            check_output(place / "overview.png", ".png")


@cli.command(
    short_help="Run a test suite.",
    epilog=example(
        "codegen suite tracking --build generated/4ws2\n  codegen suite cars\n  codegen suite references --plot references.png"
    ),
)
@click.argument("name", metavar="tracking|cars|references", shell_complete=lambda *_: list(SUITES))
@click.option(
    "--build",
    type=build_folder,
    metavar="DIR",
    help="A build; by default the recommended preset.",
)
@click.option("--cars", type=click.IntRange(1, 1000), metavar="N", help="Number of random cars; by default 8.")
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the random cars; by default 1.")
@click.option(
    "--limits",
    type=configuration_file,
    metavar="TOML",
    help="Limits that differ from the suite's own, such as overshoot_percent = 5.0.",
)
@click.option("--plot", type=picture_to_write, metavar="PNG|SVG", help="Draw an overview.")
@click.option("-o", "--output", "folder", type=folder_to_write, metavar="DIR", help="Folder for all pictures.")
@json_option
def suite(
    name: str,
    build: Path | None,
    cars: int | None,
    seed: int | None,
    limits: Path | None,
    plot: Path | None,
    folder: Path | None,
    as_json: bool,
) -> None:
    """Run a test suite, and exit with 1 if a requirement is missed.

    tracking: simulate the controller and its baselines in every cell of the test set, and compare the figures with the
    requirements.

    cars: draw plausible cars from a seed, solve, tune and build a controller for each, simulate all, and compare the figures
    with the limits. Seed 1 is for development. Seed 4 is for testing; nothing is tuned on it.

    references: drive the controller in the same cells on other maps: the cases of the configuration and the published
    references zero-sideslip, variable-wheelbase and envelope. Nothing is judged.
    """
    files = () if folder is None else (folder,)
    chosen = SuiteChoices(build=build, plot=plot, files=files, cars=cars, seed=seed, limits=limits, as_json=as_json)
    chosen.run(name)

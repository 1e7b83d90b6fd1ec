"""The model checker CBMC with the solver Bitwuzla: where they are, and their installation beside the system.

CBMC comes from the system or, where the distribution has none, from the next Debian release. Then
`python -m codegen.verify.cbmc [DIR]` downloads it with apt into a folder, the cache by default. It uses a source list, package
lists and a loader of that folder; nothing of the system changes. Bitwuzla comes from its PyPI wheel.
"""

from __future__ import annotations

import argparse
import os
import platform
import shlex
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.cache import cache_folder
from codegen.emit.render import verbatim
from codegen.errors import CodegenError, one_line
from codegen.programs import run_program
from codegen.verify.tools import MissingTool

INSTALL = f"{Path(sys.executable).name} -m codegen.verify.cbmc"
"""The line that installs both."""
NEXT_RELEASE = {"bookworm": "trixie"}
"""Debian release that has a CBMC, by the release that has none."""
PACKAGES = ("cbmc", "libc6", "libstdc++6", "libgcc-s1", "zlib1g", "minisat")
"""The packages that CBMC needs, its C library included."""
CBMC_PROGRAMS = ("cbmc", "goto-cc", "goto-instrument")
"""The programs of CBMC that proofs use."""
KEYRING = Path("/usr/share/keyrings/debian-archive-keyring.gpg")
_LAUNCHER = """#!/bin/sh
exec {loader} --library-path {libraries} {program} "$@"
"""


@dataclass(frozen=True)
class Cbmc:
    """An installed CBMC with its solver. A process with the variables of `environment` finds the commands."""

    environment: Mapping[str, str]

    @property
    def version(self) -> str:
        """Version of CBMC."""
        program = shutil.which("cbmc", path=self.environment["PATH"]) or "cbmc"
        return run_program([program, "--version"]).stdout.split(" ")[0].strip()


def installed() -> Cbmc:
    """Return the installed CBMC. Raises MissingTool: one of its programs, or Bitwuzla, is not installed."""
    path = os.pathsep.join((str(cache_folder() / "cbmc" / "bin"), os.environ.get("PATH", "")))
    for name in (*CBMC_PROGRAMS, "bitwuzla"):
        if shutil.which(name, path=path) is None:
            raise MissingTool("it is not installed", where=name, remedy=INSTALL)
    return Cbmc({**os.environ, "PATH": path})


def install(folder: Path) -> None:
    """Install CBMC and Bitwuzla into a folder; their commands are in its folder `bin`.

    Raises:
        CodegenError: this system is no Debian with such a next release, or a download failed.
    """
    root, commands, wheels = folder / "root", folder / "bin", folder / "python"
    for each in (root, commands, wheels):
        each.mkdir(parents=True, exist_ok=True)
    _unpack(folder, root)
    libraries = next(root.glob("usr/lib/*/libc.so.6")).parent
    loader = next(libraries.glob("ld-linux*.so.*"))
    paths = {"loader": str(loader), "libraries": f"{libraries}:{root / 'usr/lib'}"}
    for name in CBMC_PROGRAMS:
        words = {**paths, "program": str(root / "usr/bin" / name)}
        _write_command(commands / name, _LAUNCHER.format(**{key: shlex.quote(word) for key, word in words.items()}))
    _run(sys.executable, "-m", "pip", "install", "--quiet", "--upgrade", "--target", str(wheels), "bitwuzla")
    # Links are followed: a virtual environment may be removed, the Python that it links to stays.
    shim = verbatim("verify/bitwuzla.py.txt").decode("ascii")
    _write_command(commands / "bitwuzla", f"#!{Path(sys.executable).resolve()}\n{shim}")


def _unpack(folder: Path, root: Path) -> None:
    """Download the packages with apt and unpack them."""
    lists, archives, downloads = folder / "lists", folder / "archives", folder / "packages"
    for each in (lists / "partial", archives / "partial", downloads):
        each.mkdir(parents=True, exist_ok=True)
    sources, status = folder / "sources.list", folder / "status"
    sources.write_text(f"deb [signed-by={KEYRING}] {_mirror()} main\n", encoding="ascii")
    status.write_bytes(b"")  # nothing counts as installed, so that every package is downloaded
    places = {
        "Dir::Etc::SourceList": sources,
        "Dir::Etc::SourceParts": "/dev/null",
        "Dir::State::Lists": lists,
        "Dir::State::Status": status,
        "Dir::Cache::Archives": archives,
        "Dir::Cache::PkgCache": "",
        "Dir::Cache::SrcPkgCache": "",
    }
    apt = ["apt-get", "--quiet=2", *(f"--option={key}={value}" for key, value in places.items())]
    _run(*apt, "update")
    _run(*apt, "--option=APT::Sandbox::User=root", "download", *PACKAGES, folder=downloads)
    for package in sorted(downloads.glob("*.deb")):
        _run("dpkg", "-x", str(package), str(root))


def _mirror() -> str:
    """Return the configured mirror of this release and the name of the next one, as a line of a source list has them."""
    own = platform.freedesktop_os_release().get("VERSION_CODENAME", "")
    if own not in NEXT_RELEASE:
        raise CodegenError("no later release is known", where=own or "this system", remedy="install the package `cbmc` of it")
    found = _run("apt-get", "indextargets", "--format", "$(REPO_URI)", "Created-By: Packages", f"Codename: {own}").split()
    mirrors = [each for each in found if "security" not in each]
    if not mirrors:
        raise CodegenError("no mirror of Debian is configured", where="apt", remedy="run `apt-get update` and try again")
    return f"{mirrors[0]} {NEXT_RELEASE[own]}"


def _write_command(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
    path.chmod(0o755)


def _run(*command: str, folder: Path | None = None) -> str:
    remedy = "check the network and try again"
    try:
        result = run_program(command, folder)
    except OSError as error:
        raise CodegenError(f"cannot be started ({error.strerror})", where=command[0], remedy=remedy) from None
    if result.returncode != 0:
        last = (result.stderr.strip() or f"exit code {result.returncode}").splitlines()[-1]
        raise CodegenError(last, where=command[0], remedy=remedy)
    return result.stdout


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `python -m codegen.verify.cbmc [DIR]`. Returns the exit code."""
    parser = argparse.ArgumentParser(f"python -m {__spec__.name}", description="Install CBMC and Bitwuzla beside the system.")
    parser.add_argument("folder", metavar="DIR", nargs="?", type=Path, help="default: the cache, where codegen verify looks")
    folder = (parser.parse_args(arguments).folder or cache_folder() / "cbmc").resolve()
    try:
        install(folder)
    except (CodegenError, OSError) as error:
        print(f"error: {one_line(error)}", file=sys.stderr)
        return CodegenError.exit_code
    print(f"installed: {folder / 'bin'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

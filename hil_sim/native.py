"""The native ECU: the Linux program of a build, compiled once and kept in the cache.

It is compiled from the files that the build's manifest names, in their current state. Nothing is written into the build.
"""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
from pathlib import Path

from codegen.cache import cache_folder
from codegen.emit.folder import read_files
from codegen.emit.manifest import read_build
from codegen.errors import BuildError
from codegen.sil.toolchain import compiler_command, compiler_identity, require_success, run

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-g", "-fno-pie", "-no-pie")
"""The same arithmetic as in `codegen.sil`: no fused multiply-add. For XCP: 32-bit addresses and debug information."""

FOLDERS = ("include/", "src/", "linux/")
CACHE_FORMAT = 2
"""Version of the cached program; increase it when its sources or the build change."""


def command(build: Path, interface: str, *, lock_step: bool = False, parent: int | None = None, xcp: bool = False) -> list[str]:
    """Return the command line of the ECU on a CAN interface, for `EcuProcess` or `os.execv`; compile it if necessary.

    Args:
        parent: id of the starting process; the ECU ends with it. None: it runs on its own.
        xcp: whether a master can measure and calibrate.

    Raises:
        BuildError: see `compile_ecu`; a build that has no XCP.
    """
    if xcp:
        _require_xcp(build)
    options = ["--lock-step"] if lock_step else []
    options += ["--xcp"] if xcp else []
    options += [] if parent is None else ["--parent", str(parent)]
    return [str(compile_ecu(build)), *options, interface]


def _require_xcp(build: Path) -> None:
    manifest = read_build(build)
    source = "linux/ars_xcp.c"
    if source not in read_files(build, manifest, FOLDERS):
        raise BuildError(f"the build has no {source}", where=build, remedy="build again with `codegen build`")


def section_flag(prefix: str) -> str:
    """Return the flag that puts the calibration into a section of its own, whose ends the linker defines."""
    return f'-D{prefix.upper()}_SECTION_CALIBRATION=__attribute__((section("{prefix}_calibration")))'


def compile_ecu(build: Path) -> Path:
    """Return the executable from the cache, compiling it if necessary.

    Raises:
        BuildError: not a build, or one without the program; not Linux, no compiler, C that does not compile, a full disk.
    """
    if sys.platform != "linux":
        raise BuildError("the native ECU needs Linux", where=build, remedy="use --ecu cffi")
    manifest = read_build(build)
    prefix, sources = manifest["options"]["prefix"], read_files(build, manifest, FOLDERS)
    program = "linux/ars_ecu.c"
    if program not in sources:
        raise BuildError(f"the build has no {program}", where=build, remedy="build again with `codegen build`")
    compiler = compiler_command()
    flags = (*FLAGS, section_flag(prefix))
    name, cache = f"{prefix}_ecu_{_key(sources, compiler, flags)}", cache_folder()
    try:
        return _cached(cache, name) or _compile(sources, program, (*compiler, *flags), cache, name)
    except OSError as error:
        raise BuildError(
            f"the native ECU cannot be stored: {error.strerror or error}",
            where=cache,
            remedy="free space there, or set ARS_CACHE",
        ) from error


def counters(line: str) -> dict[str, int]:
    """Parse the last line of an ECU, `name=count` separated by spaces."""
    return {name: int(count) for name, _, count in (word.partition("=") for word in line.split())}


def _key(sources: dict[str, bytes], compiler: tuple[str, ...], flags: tuple[str, ...]) -> str:
    description = {
        "format": CACHE_FORMAT,
        "sources": {path: hashlib.sha256(content).hexdigest() for path, content in sources.items()},
        "flags": flags,
        "compiler": [compiler, compiler_identity(compiler, ())],
    }
    return hashlib.sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()


def _digest(program: Path) -> str:
    return hashlib.sha256(program.read_bytes()).hexdigest()[:16]


def _cached(cache: Path, name: str) -> Path | None:
    """Return the cached program if its content matches its name; a damaged one is ignored."""
    return next((path for path in sorted(cache.glob(f"{name}-*")) if path.name == f"{name}-{_digest(path)}"), None)


def _compile(sources: dict[str, bytes], program: str, compile_c: tuple[str, ...], cache: Path, name: str) -> Path:
    with tempfile.TemporaryDirectory(prefix="build-", dir=cache) as scratch_name:
        tree, made = Path(scratch_name, "tree"), Path(scratch_name, "ecu")
        for path, content in sources.items():
            (tree / path).parent.mkdir(parents=True, exist_ok=True)
            (tree / path).write_bytes(content)
        units = sorted(path for path in sources if path.endswith(".c"))
        same_everywhere = f"-fdebug-prefix-map={tree}=."
        require_success(run([*compile_c, same_everywhere, "-Iinclude", *units, "-o", str(made), "-lm"], tree), program)
        # Renamed in one step, so that other processes never see a partial file, and a running program is kept.
        return made.replace(cache / f"{name}-{_digest(made)}")

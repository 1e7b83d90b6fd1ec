"""A build as one shared library with the plant and the test loops: compiled file by file, opened with cffi."""

import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from codegen.configuration import Config
from codegen.emit.folder import Folder
from codegen.emit.text import c_type
from codegen.errors import BuildError
from codegen.sil.compile import Library, derive_cdef, parsed_ffi
from codegen.sil.software import bench_sources
from tests.sil.checks_calibration import WRITABLE
from tests.sil.probe import DECLARATIONS, DEFINITIONS

FLAGS = ("-std=c99", "-O0", "-ffp-contract=off", "-fPIC", "-w", "-ftrivial-auto-var-init=pattern", WRITABLE)
"""Compiler flags. Uninitialised variables get a pattern that no correct result has; the calibration is writable."""
OPTIMISED = tuple("-O2" if flag == "-O0" else flag for flag in FLAGS)
"""Flags with the optimisation of a build for use."""
SEARCH = ("-Iinclude", "-Ibench", "-Iprobe")


@dataclass(frozen=True)
class Tree:
    """Files of a library in a folder, with objects next to their sources: generated units, test sources, and the headers that
    Python needs, in include order."""

    root: Path
    units: tuple[str, ...]
    others: tuple[str, ...]
    headers: tuple[str, ...]

    @classmethod
    def write(cls, folder: Folder, config: Config, root: Path) -> Self:
        """Write a build, the plant of a configuration and the loops of the tests."""
        options = folder.manifest["options"]
        files = {path: content for path, content in folder.files.items() if path.startswith(("include/", "src/"))}
        files |= bench_sources(config, options["prefix"], options["precision"])
        files |= _probe(folder)
        for path, content in files.items():
            (root / path).parent.mkdir(parents=True, exist_ok=True)
            (root / path).write_bytes(content)
        sources = sorted(path for path in files if path.endswith(".c"))
        sections = f"include/{options['prefix']}_sections.h"
        public = [path for path in files if path.startswith("include/") and path != sections]
        return cls(
            root,
            tuple(path for path in sources if path.startswith("src/")),
            tuple(path for path in sources if not path.startswith("src/")),
            (*public, "bench/plant.h", "bench/loop.h", "probe/probe.h"),
        )

    def object(self, source: str) -> Path:
        """Return the object file of a source."""
        return self.root / f"{source}.o"

    def ffi(self) -> Any:
        """Return the FFI with the library's types and functions, whichever file it is opened from."""
        headers = [Path(header) for header in self.headers]
        return parsed_ffi(derive_cdef(headers, ("include", "bench", "probe"), for_dlopen=True, folder=self.root))


def _probe(folder: Folder) -> dict[str, bytes]:
    """Return the loops of `tests.sil.units` for the units of the build, with their headers."""
    text = {path: content.decode("ascii") for path, content in folder.files.items() if path.startswith("include/")}
    has_reference = "ars_map_reference_t" in text["include/ars_map.h"]
    only = [*(["map"] if has_reference else []), "limiter"]
    only += ["reference_model"] if "include/ars_reference_model.h" in text else []
    real = c_type(folder.manifest["options"]["precision"])
    header = "#include <stdint.h>\n" + "".join(f'#include "ars_{unit}.h"\n' for unit in only)
    header += "".join(DECLARATIONS[unit] for unit in only)
    source = '#include "probe.h"\n#include <string.h>\n' + "".join(DEFINITIONS[unit] for unit in only)
    return {"probe/probe.h": header.replace("REAL", real).encode(), "probe/probe.c": source.replace("REAL", real).encode()}


@dataclass(frozen=True)
class Compiler:
    """A C compiler with its flags, and additional ones for compiling and linking the code under test."""

    command: tuple[str, ...]
    flags: tuple[str, ...] = FLAGS
    measuring: tuple[str, ...] = ()

    def compile(self, root: Path, source: str, target: Path, more: Sequence[str] = ()) -> None:
        """Compile a source to an object; both are below the root. Raises BuildError with the compiler's first line."""
        self._run([*self.flags, *more, *SEARCH, "-c", source, "-o", str(target)], root, source)

    def compile_all(self, tree: Tree) -> None:
        """Compile every source; the generated ones with coverage."""
        for source in (*tree.units, *tree.others):
            self.compile(tree.root, source, tree.object(source), self.measuring if source in tree.units else ())

    def link(self, objects: Sequence[Path], target: Path) -> None:
        """Link objects to a shared library."""
        self._run(["-shared", *self.measuring, *map(str, objects), "-o", str(target), "-lm"], target.parent, target.name)

    def link_program(self, objects: Sequence[Path], target: Path, more: Sequence[str]) -> None:
        """Link objects to a program."""
        self._run([*more, *map(str, objects), "-o", str(target), "-lm"], target.parent, target.name)

    def _run(self, arguments: Sequence[str], folder: Path, where: str) -> None:
        done = subprocess.run([*self.command, *arguments], cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise BuildError(done.stderr.strip().partition("\n")[0] or "the compiler failed", where=where)


class Opened:
    """Functions of a library that can be replaced by another one with the same headers."""

    def __init__(self, ffi: Any) -> None:
        self._ffi = ffi
        self._lib: Any = None

    def open(self, path: Path) -> None:
        """Use the functions of this file from now on."""
        self._lib = self._ffi.dlopen(str(path))

    def close(self) -> None:
        """Close the library; this also writes its coverage counts."""
        self._ffi.dlclose(self._lib)
        self._lib = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._lib, name)


def library_of(tree: Tree, ffi: Any) -> tuple[Library, Opened]:
    """Return a compiled build for the tests, and the object that selects its file; types are those of `Tree.ffi`."""
    opened = Opened(ffi)
    return Library(ffi, opened, tree.root, "abi"), opened

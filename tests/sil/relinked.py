"""Builds of which single files differ: only those are compiled anew, and linked with the objects that the others share."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from codegen import config as configuration
from codegen.config import Config
from codegen.emit.folder import Folder
from codegen.sil.cdef import derive_cdef, parsed_ffi
from codegen.sil.compile import DEFAULT_FLAGS, Library
from codegen.sil.software import Software, bench_sources
from codegen.sil.toolchain import compiler_command
from tests.sil.library import Compiler

QUICK_FLAGS = tuple("-O0" if flag == "-O2" else flag for flag in (*DEFAULT_FLAGS, "-w"))
"""Without optimisation, which compiles faster, and without warnings, for what is planted may leave a function unused."""
INCLUDE_FOLDERS = ("include", "bench", "probe")


class Objects:
    """What a library is linked from.

    Args:
        sources: relative path -> content, of all .c and .h files. headers: which of them Python calls, in include order.

    Raises:
        BuildError: they do not compile.
    """

    def __init__(self, sources: Mapping[str, bytes], headers: Sequence[str]) -> None:
        self._sources = dict(sources)
        self._folder = tempfile.TemporaryDirectory(prefix="ars-objects-")
        self._root = Path(self._folder.name)
        self._compiler = Compiler(compiler_command(), QUICK_FLAGS)
        self._number: Iterator[int] = itertools.count()
        for path, content in self._sources.items():
            (self._root / path).parent.mkdir(parents=True, exist_ok=True)
            (self._root / path).write_bytes(content)
        self._objects = {path: self._compiled(path) for path in sorted(self._sources) if path.endswith(".c")}
        declarations = derive_cdef(
            [Path(header) for header in headers], INCLUDE_FOLDERS, flags=QUICK_FLAGS, for_dlopen=True, folder=self._root
        )
        self._ffi = parsed_ffi(declarations)

    def _compiled(self, path: str) -> Path:
        target = self._root / f"{next(self._number)}.o"
        self._compiler.compile(self._root, path, target)
        return target

    def library(self, sources: Mapping[str, bytes]) -> Library:
        """The library of these sources.

        Raises:
            BuildError: what differs does not compile.
            LookupError: there are other files, or a header differs, so that the objects are not those of these sources.
        """
        differ = [path for path, content in sources.items() if self._sources.get(path) != content]
        if sources.keys() != self._sources.keys() or not all(path.endswith(".c") for path in differ):
            raise LookupError(f"not linked from the same objects: {', '.join(differ) or 'other files'}")
        own: dict[str, Path] = {}
        for path in differ:
            place = f"{next(self._number)}.c"
            (self._root / place).write_bytes(sources[path])
            own[path] = self._compiled(place)
        shared = self._root / f"{next(self._number)}.so"  # of a name that no library had before: it would be taken for that one
        self._compiler.link(list((self._objects | own).values()), shared)
        library = Library(self._ffi, self._ffi.dlopen(str(shared)), shared, "abi")
        shared.unlink()
        return library


class Builds:
    """The builds around one folder, each with single files of its own."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder
        self._config = configuration.parse(folder.manifest["configuration"], "manifest.json: configuration")
        sources = self._sources(folder, self._config)
        public = [path for path in sources if path.startswith("include/") and not path.endswith("_sections.h")]
        self._objects = Objects(sources, [*public, "bench/plant.h", "bench/loop.h"])

    def _sources(self, folder: Folder, car: Config) -> dict[str, bytes]:
        options = self._folder.manifest["options"]
        own = {path: content for path, content in folder.files.items() if path.startswith(("include/", "src/"))}
        return own | bench_sources(car, options["prefix"], options["precision"])

    def software(self, folder: Folder | None = None, car: Config | None = None) -> Software:
        """The build of a folder with other sources, or with the plant of another car. Raises: see `Objects.library`."""
        options, config = self._folder.manifest["options"], car or self._config
        library = self._objects.library(self._sources(folder or self._folder, config))
        return Software(library, options["prefix"], options["precision"], config)

"""Compile C sources with cffi, cache the result and load it.

The compiler's preprocessor derives the cffi declarations (`cdef`) from the real headers. There are two modes:

- API mode compiles the C and cffi's glue to a Python extension; the C compiler checks every declaration.
- ABI mode, used without Python's headers, compiles a plain shared library and opens it with `ffi.dlopen`.

cffi releases the GIL around every call in both modes.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.util
import json
import os
import re
import sys
import sysconfig
import tempfile
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.machinery import ExtensionFileLoader, ModuleSpec
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import cffi
from cffi.recompiler import make_c_source
from pycparser import c_ast, c_generator, c_parser

from codegen import cache
from codegen.cache import cache_folder
from codegen.errors import BuildError
from codegen.sil.toolchain import compiler_command, compiler_identity, find_compiler, require_success, run

__all__ = ["DEFAULT_FLAGS", "Library", "Mode", "cache_folder", "compile_library", "derive_cdef", "find_compiler"]

DEFAULT_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-Wall", "-Wextra", "-Werror")
CACHE_FORMAT = 3
"""Version of the cache; increase it when the content of an entry or the way it is built changes."""

LIBRARY, CDEF = ".so", ".h"
"""Suffixes of the two files of an entry: the compiled file and its declarations."""

Mode = Literal["auto", "api", "abi"]

_SOURCE_PATH = re.compile(r"[\w.+-]+(/[\w.+-]+)*", re.ASCII)
# Flags for the user's C only: cffi's glue and Python's headers violate the standard and cause warnings.
_STRICTNESS = re.compile(r"-W(?![lap],).*|-std=.*|-ansi|-pedantic.*")


@dataclass(frozen=True)
class Library:
    """A loaded C library.

    Attributes:
        ffi: cffi FFI with the library's types (`ffi.new("ars_controller_t *")`).
        lib: functions, constants and objects as attributes. Do not write objects that are const in C.
        path: compiled file in the cache.
        mode: "api" or "abi". In ABI mode `static` functions and `static` objects of a header are missing, integers excepted.
    """

    ffi: Any
    lib: Any
    path: Path
    mode: str


@dataclass(frozen=True)
class _Job:
    """All inputs that determine the compiled file."""

    name: str
    sources: Mapping[str, bytes]
    headers: tuple[str, ...]
    include_folders: tuple[str, ...]
    flags: tuple[str, ...]
    unit_flags: Mapping[str, tuple[str, ...]]
    mode: str
    compiler: tuple[str, ...]

    @functools.cached_property
    def module_name(self) -> str:
        """Module name and stem of the file names. It includes the cache key, so it is unique for each library."""
        every_flag = (*self.flags, *(flag for flags in self.unit_flags.values() for flag in flags))
        native = tuple(flag for flag in every_flag if flag.endswith("=native"))
        description = {
            "format": CACHE_FORMAT,
            "sources": {path: hashlib.sha256(content).hexdigest() for path, content in self.sources.items()},
            "headers": self.headers,
            "include_folders": self.include_folders,
            "flags": self.flags,
            "unit_flags": self.unit_flags,
            "mode": self.mode,
            "compiler": [self.compiler, compiler_identity(self.compiler, native)],
            "python": sysconfig.get_config_var("EXT_SUFFIX"),
            "cffi": cffi.__version__,
        }
        key = hashlib.sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()
        return f"_{re.sub('[^0-9A-Za-z_]', '_', self.name)[:40]}_{key}"


@dataclass(frozen=True)
class _Entry:
    """A compiled file in the cache and its declarations."""

    path: Path
    cdef: str


_loaded: dict[str, Library] = {}
_loading = threading.RLock()


def compile_library(
    name: str,
    sources: Mapping[str, str | bytes],
    headers: Sequence[str],
    *,
    include_folders: Sequence[str] = ("include",),
    flags: Sequence[str] = DEFAULT_FLAGS,
    unit_flags: Mapping[str, Sequence[str]] | None = None,
    mode: Mode = "auto",
) -> Library:
    """Compile C sources, or find them in the cache, and load them. Equal inputs return the same object within a process.

    Args:
        name: readable part of the file name.
        sources: relative path with "/" -> content of every .c and .h file.
        headers: paths of the public headers, in include order.
        include_folders: search folders relative to the same root.
        flags: compiler flags; those for warnings and the standard do not apply to cffi's glue.
        unit_flags: path of a .c file -> additional flags for that file, not for the linker.
        mode: "auto" selects "api" if Python's headers are installed, else "abi".

    Raises:
        BuildError: no compiler, C that does not compile or load, a header that cffi does not support, a full disk.
    """
    job = _Job(
        name=name,
        sources={_checked_path(path): text.encode() if isinstance(text, str) else text for path, text in sources.items()},
        headers=tuple(headers),
        include_folders=tuple(include_folders),
        flags=tuple(flags),
        unit_flags={path: tuple(own) for path, own in (unit_flags or {}).items()},
        mode=_resolved_mode(mode),
        compiler=compiler_command(),
    )
    for header in job.headers:
        if header not in job.sources:
            raise BuildError("the public header is not among the sources", where=header)
    for unit in job.unit_flags:
        if unit not in job.sources:
            raise BuildError("flags for a file that is not among the sources", where=unit)
    with _loading:  # one build at a time: threads that need the same library wait for it
        if job.module_name not in _loaded:
            _loaded[job.module_name] = _open(job, cache_folder())
        return _loaded[job.module_name]


def _checked_path(path: str) -> str:
    if not _SOURCE_PATH.fullmatch(path) or ".." in PurePosixPath(path).parts:
        raise BuildError("not a plain relative path of ASCII letters, digits and . _ + -", where=path)
    return path


def _python_include_folders() -> list[str]:
    return list(dict.fromkeys(sysconfig.get_path(name) for name in ("include", "platinclude")))


def _resolved_mode(mode: Mode) -> str:
    if mode == "abi":
        return "abi"
    if any(Path(folder, "Python.h").is_file() for folder in _python_include_folders()):
        return "api"
    if mode == "auto":
        return "abi"
    raise BuildError("Python.h is not installed", remedy='apt install python3-dev, or use mode "abi", which does not need it')


def _open(job: _Job, folder: Path) -> Library:
    entry = _find_entry(job, folder)
    if entry is not None:
        # An intact entry may fail to load, for example after an update of the C library. Then it is built again.
        with contextlib.suppress(BuildError):
            return _load(job, entry)
    try:
        return _load(job, _build(job, folder))
    except OSError as error:
        raise BuildError(
            f"the compiled C cannot be stored: {error.strerror or error}",
            where=folder,
            remedy="free space there, or set ARS_CACHE",
        ) from error


def _find_entry(job: _Job, folder: Path) -> _Entry | None:
    """Return the cached entry, or None if a file of it is missing or damaged. Loading a truncated library would terminate the
    process."""
    library, cdef = cache.find(folder, job.module_name, LIBRARY), cache.find(folder, job.module_name, CDEF)
    return None if library is None or cdef is None else _Entry(library.path, cdef.content.decode())


def _build(job: _Job, folder: Path) -> _Entry:
    with cache.scratch(folder) as scratch:
        tree = scratch / "tree"  # separate, so that no source collides with a file created here
        for path, content in job.sources.items():
            (tree / path).parent.mkdir(parents=True, exist_ok=True)
            (tree / path).write_bytes(content)
        units = sorted(path for path in job.sources if path.endswith(".c"))
        search = [f"-I{folder}" for folder in job.include_folders]
        # The sources are compiled first, so that the compiler reports errors in headers before the parser does.
        commands = [
            [*job.compiler, *job.flags, *job.unit_flags.get(unit, ()), *search, "-c", unit, "-o", f"../{number}.o"]
            for number, unit in enumerate(units)
        ]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for unit, result in zip(units, pool.map(lambda command: run(command, tree), commands), strict=True):
                require_success(result, unit)
        cdef = derive_cdef(
            [Path(header) for header in job.headers],
            job.include_folders,
            flags=job.flags,
            for_dlopen=job.mode == "abi",
            folder=tree,
        )
        ffi = parsed_ffi(cdef)
        objects = [f"../{number}.o" for number in range(len(units))]
        if job.mode == "api":
            _compile_glue(job, ffi, tree, search)
            objects.append("../glue.o")
        kind = ["-bundle", "-undefined", "dynamic_lookup"] if sys.platform == "darwin" else ["-shared"]
        require_success(run([*job.compiler, *job.flags, *kind, *objects, "-o", "../library.so", "-lm"], tree), job.name)
        cache.keep(folder, job.module_name, cdef.encode(), CDEF)
        content = (scratch / "library.so").read_bytes()
        return _Entry(cache.keep(folder, job.module_name, content, LIBRARY, executable=True).path, cdef)


def _compile_glue(job: _Job, ffi: Any, tree: Path, search: Sequence[str]) -> None:
    # Equivalent to FFI.emit_c_code, which would also print a line to standard output.
    includes = "".join(f'#include "{header}"\n' for header in job.headers)
    make_c_source(ffi, job.module_name, includes, str(tree.parent / "glue.c"))
    flags = [flag for flag in job.flags if not _STRICTNESS.fullmatch(flag)]
    flags.append("-O0")  # the glue converts arguments; optimising it takes longer than the C itself
    python = [f"-I{folder}" for folder in _python_include_folders()]
    command = [*job.compiler, *flags, "-fPIC", "-I.", *search, *python, "-c", "../glue.c", "-o", "../glue.o"]
    require_success(run(command, tree), "the glue code of cffi")


def _load(job: _Job, entry: _Entry) -> Library:
    try:
        if job.mode == "abi":
            ffi = parsed_ffi(entry.cdef)
            return Library(ffi, ffi.dlopen(str(entry.path)), entry.path, job.mode)
        loader = ExtensionFileLoader(job.module_name, str(entry.path))
        module: Any = importlib.util.module_from_spec(ModuleSpec(job.module_name, loader, origin=str(entry.path)))
        loader.exec_module(module)
        return Library(module.ffi, module.lib, entry.path, job.mode)
    except (ImportError, OSError) as error:
        reason = str(error).rpartition(f"{entry.path}: ")[2]  # without the long path
        raise BuildError(f"the compiled C does not load: {reason}", where=job.name) from error


_ATTRIBUTE = re.compile(r"__attribute__\s*\(\((?:[^()]|\([^()]*\))*\)\)")
_LAYOUT_WORD = re.compile(r"\b_*(packed|aligned)_*\b")
_PRAGMA_PACK = re.compile(r"^\s*#\s*pragma\s+pack\b", re.MULTILINE)


def _write_stand_ins(folder: Path) -> None:
    """Write minimal standard headers for the parser; cffi knows their types."""
    widths = [f"{kind}{bits}" for kind in ("", "_least", "_fast") for bits in (8, 16, 32, 64)]
    types = [f"{sign}int{width}_t" for sign in ("", "u") for width in (*widths, "ptr", "max")]
    limits = [f"#define {sign}INT{bits}_MAX __{sign}INT{bits}_MAX__" for sign in ("", "U") for bits in (8, 16, 32, 64)]
    limits += [f"#define INT{bits}_MIN (-INT{bits}_MAX - 1)" for bits in (8, 16, 32, 64)]
    stdint = [f"typedef int {name};" for name in types] + limits
    stddef = [f"typedef int {name};" for name in ("size_t", "ptrdiff_t", "wchar_t")] + ["#define NULL ((void *)0)"]
    stdbool = ["#define bool _Bool", "#define true 1", "#define false 0"]
    for name, lines in {"stdint": stdint, "stddef": stddef, "stdbool": stdbool}.items():
        guarded = [f"#ifndef STAND_IN_{name}", f"#define STAND_IN_{name}", *lines, "#endif", ""]
        (folder / f"{name}.h").write_text("\n".join(guarded), encoding="ascii")


def _declaration(node: Any, for_dlopen: bool) -> Any | None:
    """Return the part of a top-level node that cffi accepts, or None."""
    if isinstance(node, c_ast.StaticAssert | c_ast.Pragma):
        return None
    if isinstance(node, c_ast.FuncDef):
        node = node.decl
    if not isinstance(node, c_ast.Decl):
        return node
    if isinstance(node.type, c_ast.FuncDecl):
        if for_dlopen and "static" in node.storage:
            return None
        node.storage, node.funcspec = [], []
    elif for_dlopen and isinstance(node.type, c_ast.TypeDecl | c_ast.PtrDecl) and "extern" in node.storage:
        # In ABI mode cffi reads variables but not constants.
        node.type.quals = [qualifier for qualifier in node.type.quals if qualifier != "const"]
    elif for_dlopen and "static" in node.storage and not _is_integer(node.init):
        return None
    return node


def _is_integer(value: Any) -> bool:
    if isinstance(value, c_ast.UnaryOp) and value.op == "-":
        value = value.expr
    return isinstance(value, c_ast.Constant) and "int" in value.type


def _refuse_set_layout(text: str) -> None:
    # cffi would assume natural layout for such a struct and read the wrong bytes.
    attributes = (found[0] for found in _ATTRIBUTE.finditer(text) if _LAYOUT_WORD.search(found[0]))
    if _PRAGMA_PACK.search(text) or any(attributes):
        raise BuildError(
            "packed or aligned structs are not supported", where="the public headers", remedy="use the natural layout"
        )


def derive_cdef(
    headers: Sequence[Path],
    include_folders: Sequence[Path | str],
    *,
    flags: Sequence[str] = ("-std=c99",),
    for_dlopen: bool = False,
    folder: Path | None = None,
) -> str:
    """Return the declarations of C headers in the form that `ffi.cdef` accepts.

    Macros, function bodies, static assertions and attributes are removed; enums and `static const int` remain.

    Args:
        headers: public headers in include order. They may include stdint, stdbool and stddef, but no other standard header.
        include_folders: search folders for other headers of the project.
        flags: compiler flags; only macro definitions and the language standard have an effect.
        for_dlopen: omit declarations that a plain shared library does not export.
        folder: base of relative paths; default: the current folder.

    Raises:
        BuildError: the headers do not preprocess or parse, or set the layout of a struct (packed, aligned), which is not
            supported.
    """
    includes = [word for header in headers for word in ("-include", str(header))]
    with tempfile.TemporaryDirectory(prefix="ars-stand-ins-") as stand_ins:
        _write_stand_ins(Path(stand_ins))
        search = [f"-I{place}" for place in (stand_ins, *include_folders)]
        result = run([*compiler_command(), *flags, "-E", "-nostdinc", *search, *includes, "-xc", "/dev/null"], folder)
    require_success(result, "the public headers")
    _refuse_set_layout(result.stdout)
    # Line markers let the parser report header and line of an error.
    try:
        parsed = c_parser.CParser().parse(_ATTRIBUTE.sub("", result.stdout))
    except c_parser.ParseError as error:
        raise BuildError(f"the header is not plain C99: {error}", where="the public headers") from error
    generator = c_generator.CGenerator()
    own = [node for node in parsed.ext if node.coord is None or not str(node.coord.file).startswith(stand_ins)]
    kept = [declaration for node in own if (declaration := _declaration(node, for_dlopen)) is not None]
    return "".join(f"{generator.visit(node)};\n" for node in kept)


def parsed_ffi(cdef: str) -> Any:
    """Return an FFI with the declarations `cdef`. Raises BuildError if cffi rejects one."""
    ffi = cffi.FFI()
    try:
        ffi.cdef(cdef)
    except (cffi.CDefError, cffi.FFIError, NotImplementedError) as error:
        raise BuildError(f"cffi rejects a declaration: {error.args[0]}", where="the public headers") from error
    return ffi

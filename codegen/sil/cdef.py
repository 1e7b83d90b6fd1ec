"""Derive the declarations for cffi (`cdef`) from the real headers with the compiler's preprocessor."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cffi
from pycparser import c_ast, c_generator, c_parser

from codegen.errors import BuildError
from codegen.sil.toolchain import compiler_command, require_success, run

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
            "a packed or aligned struct cannot be carried over", where="the public headers", remedy="use the natural layout"
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
        raise BuildError(f"cffi does not take a declaration: {error.args[0]}", where="the public headers") from error
    return ffi

"""The self-test of a case with stand-ins for all that it asks: linked apart, for the case itself has the real ones."""

import tempfile
from pathlib import Path

from codegen.sil.cdef import derive_cdef, parsed_ffi
from codegen.sil.compile import Library
from tests.sil.case import Case
from tests.sil.checks_selftest import CHECKS, STUBS, Alone
from tests.sil.library import Compiler


def check_selftest(case: Case) -> None:
    """What is asked of the self-test alone; with all the rest of the build it passes."""
    assert case.built.software.selftest()
    root, compiler = case.tree.root, case.compiler
    if "stand-ins" not in case.kept:
        case.kept["stand-ins"] = _stand_ins(root, compiler)
    with tempfile.TemporaryDirectory(dir=root) as scratch:
        path = Path(scratch) / "selftest.so"
        compiler.link([case.object("src/ars_selftest.c"), root / "stub/stub.o", root / "stub/expected.o"], path)
        ffi = case.kept["stand-ins"]
        library = Library(ffi, ffi.dlopen(str(path)), path, "abi")
        if case.mutated is not None and case.mutated.path == "src/ars_selftest.c":
            case.select_in(path)
        try:
            for check in CHECKS:
                check(Alone.of(library, case.built.folder))
        finally:
            ffi.dlclose(library.lib)  # where it counts what was run, that is written now


def _stand_ins(root: Path, compiler: Compiler) -> object:
    """Compile them; gives what knows their types."""
    (root / "stub").mkdir(exist_ok=True)
    for path, text in STUBS.items():
        (root / path).write_text(text, encoding="ascii")
    for name in ("stub", "expected"):
        compiler.compile(root, f"stub/{name}.c", root / f"stub/{name}.o", ("-Istub",))
    headers = [Path("stub/stub.h")]
    return parsed_ffi(derive_cdef(headers, ("include", "stub"), for_dlopen=True, folder=root))

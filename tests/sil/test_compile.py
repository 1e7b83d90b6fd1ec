"""Compiling with cffi: small C examples, both modes, the cache, and the messages of failures."""

import json
import os
import stat
import subprocess
import sys
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cffi
import pytest

from codegen import cache
from codegen.errors import BuildError
from codegen.sil.compile import DEFAULT_FLAGS, Library, cache_folder, compile_library, derive_cdef, find_compiler

ROOT = Path(__file__).resolve().parents[2]
HAS_PYTHON_H = any(Path(sysconfig.get_path(name), "Python.h").is_file() for name in ("include", "platinclude"))
MODES = ["api", "abi"] if HAS_PYTHON_H else ["abi"]
Sources = dict[str, str]

TYPES_H = """
#include <stdint.h>
typedef enum { GEAR_REVERSE = -1, GEAR_NEUTRAL } gear_t;
enum { TABLE_ROWS = 2, TABLE_POINTS = TABLE_ROWS + 1 };
"""
SAMPLE_H = """
#include <stdbool.h>
#include <stdint.h>
#include "types.h"
#define HALF(x) (0.5f * (x))
_Static_assert(sizeof(float) == 4, "float of four bytes (binary32)");
typedef struct {
    uint8_t counter;
    float speed; /* m/s */
    bool inhibit;
    gear_t gear;
    double history[TABLE_POINTS];
    uint16_t limits[UINT8_MAX - 253];
} sample_t;
extern const float sample_table[TABLE_ROWS][TABLE_POINTS];
sample_t sample_step(const sample_t *input, float factor) __attribute__((nonnull(1)));
static inline float sample_half(float value)
{
    return HALF(value);
}
"""


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Provide a cache for the test, without a compiler from the user's CC."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("ARS_CACHE", str(folder))
    monkeypatch.delenv("CC", raising=False)
    return folder


def tiny(value: int) -> Sources:
    """A library whose `tiny()` returns `value`."""
    source = f'#include "tiny.h"\nint tiny(void)\n{{\n    return {value};\n}}\n'
    return {"include/tiny.h": "int tiny(void);\n", "src/tiny.c": source}


@pytest.fixture
def unique_sources(tmp_path: Path) -> Sources:
    """Return `tiny(1)` in sources of this test only, which the process has not loaded yet."""
    return {**tiny(1), "src/unique.h": f"/* {tmp_path} */\n"}


def compiled(sources: Sources, mode: Any = "abi") -> Library:
    return compile_library("tiny", sources, ["include/tiny.h"], mode=mode)


def script(path: Path, body: str) -> str:
    """Write an executable shell script and return its path."""
    path.write_text(f"#!/bin/sh\n{body}\n", encoding="utf-8")
    path.chmod(0o755)
    return str(path)


@pytest.fixture
def compiler_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the path of a log that gets one line of arguments for each start of the compiler."""
    log = tmp_path / "log"
    log.touch()
    monkeypatch.setenv("CC", script(tmp_path / "logged-cc", f'echo "$@" >> "{log}"\nexec {find_compiler()} "$@"'))
    return log


def compilations(log: Path) -> int:
    """Return how often a source was compiled, without version queries."""
    return sum(" -c " in line for line in log.read_text(encoding="utf-8").splitlines())


CHILD = """
import json, sys
from codegen.sil.compile import compile_library
sources, mode = json.loads(sys.argv[1])
print("ready", flush=True)
sys.stdin.readline()
library = compile_library("tiny", sources, ["include/tiny.h"], mode=mode)
print(library.lib.tiny(), library.path, flush=True)
"""


def start_process(sources: Sources, mode: str) -> subprocess.Popen[str]:
    """Start a Python process that compiles and calls `tiny` when it reads a line."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", CHILD, json.dumps([sources, mode])]
    return subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def finish(process: subprocess.Popen[str]) -> tuple[int, Path]:
    """Return the process's result of `tiny` and the library's path."""
    output, _ = process.communicate("go\n")
    assert process.returncode == 0
    value, path = output.split("\n")[-2].split(" ", 1)
    return int(value), Path(path)


# Declarations for cffi


def cdef_of(folder: Path, header: str, **options: Any) -> str:
    (folder / "types.h").write_text(TYPES_H, encoding="utf-8")
    (folder / "header.h").write_text(header, encoding="utf-8")
    return derive_cdef([folder / "header.h"], [folder], **options)


def test_declarations_follow_the_header(tmp_path: Path) -> None:
    cdef, ffi = cdef_of(tmp_path, SAMPLE_H), cffi.FFI()
    ffi.cdef(cdef)
    assert ffi.sizeof("sample_t") == 48  # 1 + 3 pad, 4, 1 + 3 pad, 4, 3 x 8, 2 x 2 + 4 pad
    assert not any(word in cdef for word in ("#", "__attribute__", "_Static_assert", "return", "int_least8_t"))
    wide = "#ifdef WIDE\ntypedef double real_t;\n#else\ntypedef float real_t;\n#endif\n"
    assert "float real_t" in cdef_of(tmp_path, wide)
    assert "double real_t" in cdef_of(tmp_path, wide, flags=["-std=c99", "-DWIDE"])


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("typedef struct { char a; int b __attribute__((__aligned__(16))); } p_t;\n", "packed or aligned"),
        ("#pragma pack(push, 1)\ntypedef struct { char a; int b; } p_t;\n#pragma pack(pop)\n", "packed or aligned"),
        ("int f(void);\nint 3 g;\n", r"header\.h:2"),
    ],
)
def test_a_header_that_has_no_declarations_for_cffi_is_refused(tmp_path: Path, header: str, message: str) -> None:
    with pytest.raises(BuildError, match=message):
        cdef_of(tmp_path, header)


# The compiler


def test_the_first_compiler_on_the_path_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own_cache: Path, unique_sources: Sources
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BuildError, match=r"^no C compiler was found; install one, e\.g\. apt install gcc, or set CC$"):
        compiled(unique_sources, mode="auto")
    assert not own_cache.exists()
    for name in ("clang", "gcc", "cc"):
        script(tmp_path / name, "exit 1")
        assert find_compiler() == name


@pytest.mark.parametrize("command", ["/nowhere/cc -O2", "''", "cc 'open"])
def test_a_missing_compiler_is_named(monkeypatch: pytest.MonkeyPatch, command: str) -> None:
    monkeypatch.setenv("CC", command)
    with pytest.raises(BuildError) as caught:
        find_compiler()
    assert caught.value.where == "CC"
    assert command.split()[0].strip("'") in caught.value.what


def require_refused(sources: Sources, own_cache: Path, where: str, message: str) -> None:
    """Check that the sources are rejected with one line and nothing is left in the cache."""
    with pytest.raises(BuildError, match=message) as caught:
        compiled(sources, mode="auto")
    assert caught.value.where == where
    assert "\n" not in str(caught.value)
    assert list(own_cache.iterdir()) == []


def test_the_first_error_and_its_place(unique_sources: Sources, own_cache: Path) -> None:
    require_refused({**unique_sources, "src/tiny.c": '#include "absent.h"\n'}, own_cache, "src/tiny.c:1", "absent.h")
    warned = "int tiny(void)\n{\n    int unused;\n    return 1;\n}\n"  # a warning is an error
    require_refused({**unique_sources, "src/tiny.c": warned}, own_cache, "src/tiny.c:3", "unused")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("kill -9 $$", "signal 9"),
        ("exit 3", "exit code 3: it printed nothing"),
        ("echo '/tmp/x.s: Fatal error: cannot write: No space left on device' >&2; exit 1", "No space left on device"),
    ],
)
def test_a_crashing_compiler_is_reported_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unique_sources: Sources, own_cache: Path, body: str, message: str
) -> None:
    compiler = f'case " $* " in *" -c "*) {body};; esac\nexec {find_compiler()} "$@"'
    monkeypatch.setenv("CC", script(tmp_path / "failing-cc", compiler))
    require_refused(unique_sources, own_cache, "src/tiny.c", message)


@pytest.mark.parametrize("mode", MODES)
def test_errors_of_linker_and_cffi(unique_sources: Sources, mode: str) -> None:
    absent = {"src/tiny.c": "int absent(void);\nint tiny(void);\nint tiny(void)\n{\n    return absent();\n}\n"}
    for _ in range(2):  # the second time it comes from the cache
        with pytest.raises(BuildError, match=r"does not load: .*absent"):
            compiled({**unique_sources, **absent}, mode=mode)
    with pytest.raises(BuildError, match=r"(multiple definition|duplicate symbol).*tiny"):
        compiled({**unique_sources, "src/again.c": unique_sources["src/tiny.c"]}, mode=mode)
    odd = {"include/tiny.h": "int tiny(void);\ntypedef struct { int a[sizeof(int)]; } s_t;\n"}
    with pytest.raises(BuildError, match="cffi rejects"):
        compiled({**unique_sources, **odd}, mode=mode)


def test_flags_of_a_unit_reach_neither_other_units_nor_the_linker() -> None:
    """The linker would reject its option; the compiler ignores it."""
    sources = {"two.h": "int one(void);\nint two(void);\n", "one.c": '#include "two.h"\nint one(void) { return NUMBER; }\n'}
    sources["two.c"] = '#include "two.h"\n#ifdef NUMBER\n#error "not for this one"\n#endif\nint two(void) { return 2; }\n'
    for number in (1, 7):  # another flag, another library
        own = {"one.c": [f"-DNUMBER={number}", "-Wl,--no-such-option"]}
        library = compile_library("two", sources, ["two.h"], unit_flags=own, include_folders=(".",))
        assert (library.lib.one(), library.lib.two()) == (number, 2)


def test_the_checked_mode_needs_python_h_and_prints_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unique_sources: Sources, capfd: pytest.CaptureFixture[str]
) -> None:
    library = compiled(unique_sources, mode="auto")
    assert library.mode == MODES[0]
    assert library is compiled(unique_sources, mode=MODES[0])
    monkeypatch.setattr(sysconfig, "get_path", lambda _name: str(tmp_path / "no-headers"))
    plain = compiled({**unique_sources, **tiny(2)}, mode="auto")
    assert (plain.mode, plain.lib.tiny()) == ("abi", 2)
    assert capfd.readouterr() == ("", "")


# The cache


def test_everything_that_affects_the_result_is_in_the_key(unique_sources: Sources, monkeypatch: pytest.MonkeyPatch) -> None:
    def path(sources: Sources, name: str = "tiny", **options: Any) -> Path:
        return compile_library(name, sources, ["include/tiny.h"], **{"mode": "abi", **options}).path

    paths = [path(unique_sources), path({**unique_sources, **tiny(2)}), path(unique_sources, name="other")]
    paths += [path(unique_sources, flags=(*DEFAULT_FLAGS, "-O0")), path(unique_sources, include_folders=("include", "src"))]
    monkeypatch.setenv("CC", f"{find_compiler()} -DOTHER")
    paths.append(path(unique_sources))
    assert len(set(paths)) == len(paths)


def test_threads_and_later_calls_share_one_build(compiler_log: Path, unique_sources: Sources) -> None:
    with ThreadPoolExecutor(4) as pool:
        libraries = list(pool.map(lambda _: compiled(unique_sources), range(8)))
    assert len({id(library) for library in libraries}) == 1
    assert compilations(compiler_log) == 1


@pytest.mark.parametrize("mode", MODES)
def test_concurrent_and_later_processes_share_one_build(
    compiler_log: Path, unique_sources: Sources, own_cache: Path, mode: str
) -> None:
    processes = [start_process(unique_sources, mode) for _ in range(2)]
    for process in processes:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
    for process in processes:  # both are running: now they compile concurrently
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    found = [finish(process) for process in processes]
    assert [value for value, _ in found] == [1, 1]
    assert {path.suffix for path in own_cache.iterdir()} == {".so", ".h"}
    count = compilations(compiler_log)
    assert finish(start_process(unique_sources, mode)) in found
    assert compilations(compiler_log) == count > 0


@pytest.mark.parametrize("damage", ["truncated", "no library", "one bit", "one bit of a declaration", "foreign"])
def test_a_damaged_entry_is_built_again(compiler_log: Path, unique_sources: Sources, own_cache: Path, damage: str) -> None:
    _, path = finish(start_process(unique_sources, "abi"))
    content = path.read_bytes()
    if damage == "truncated":
        path.write_bytes(content[: len(content) // 3])
    elif damage == "no library":
        path.unlink()
    elif damage == "one bit":
        path.write_bytes(content.replace(b"tiny", b"tinx"))
    elif damage == "one bit of a declaration":
        (declarations,) = own_cache.glob("*.h")
        declarations.write_bytes(declarations.read_bytes().replace(b"tiny", b"tinx"))
    else:  # whole, but not for this machine
        path.unlink()
        cache.keep(own_cache, path.stem.rpartition("-")[0], b"foreign", ".so")
    assert finish(start_process(unique_sources, "abi")) == (1, path)
    assert compilations(compiler_log) == 2
    assert path.read_bytes() == content


def test_a_full_disk_is_reported_in_one_line(unique_sources: Sources, monkeypatch: pytest.MonkeyPatch, own_cache: Path) -> None:
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(BuildError, match=r"cannot be stored: No space left on device; .*ARS_CACHE"):
        compiled(unique_sources)
    assert list(own_cache.iterdir()) == []


@pytest.mark.parametrize("squatter", ["", "open folder", "link"])
def test_a_private_temporary_folder_replaces_an_unwritable_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unique_sources: Sources, squatter: str
) -> None:
    """`$ARS_CACHE` is below a regular file, where not even root can write. A folder that others could have prepared is not
    used."""
    (tmp_path / "file").touch()
    monkeypatch.setenv("ARS_CACHE", str(tmp_path / "file" / "cache"))
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    cache._folder_of_this_process.cache_clear()
    expected = cache_folder()
    if squatter == "open folder":
        expected.chmod(0o777)
    elif squatter == "link":
        expected.symlink_to(expected.rename(tmp_path / "elsewhere"))
    folder = cache_folder()
    assert (folder == expected) == (not squatter)
    assert folder.parent == tmp_path / "tmp"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    if not squatter:
        library = compiled(unique_sources)
        assert (library.lib.tiny(), library.path.parent) == (1, folder)

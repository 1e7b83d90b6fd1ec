"""Compiling with cffi: real C samples, both modes, the cache, and what is told when it cannot be done."""

from __future__ import annotations

import hashlib
import json
import os
import stat
import subprocess
import sys
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, ClassVar

import cffi
import pytest

from codegen.errors import BuildError
from codegen.sil import cache
from codegen.sil.compile import DEFAULT_FLAGS, Library, cache_folder, compile_library, derive_cdef, find_compiler

ROOT = Path(__file__).resolve().parents[2]
HAS_PYTHON_H = any(Path(sysconfig.get_path(name), "Python.h").is_file() for name in ("include", "platinclude"))
MODES = ["api", "abi"] if HAS_PYTHON_H else ["abi"]

TYPES_H = """
#ifndef TYPES_H
#define TYPES_H
#include <stdint.h>
typedef enum { GEAR_REVERSE = -1, GEAR_NEUTRAL, GEAR_FORWARD = 3, GEAR_COUNT } gear_t;
enum { TABLE_ROWS = 2, TABLE_POINTS = TABLE_ROWS + 1 };
#endif
"""
SAMPLE_H = """
#ifndef SAMPLE_H
#define SAMPLE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "types.h"

#ifdef __cplusplus
extern "C" {
#endif

#define HALF(x) (0.5f * (x))
_Static_assert(sizeof(float) == 4, "float of four bytes (binary32)");

/* Members of several sizes: a wrong layout reads a wrong value. */
typedef struct {
    uint8_t counter;
    float speed; /* m/s */
    bool inhibit;
    gear_t gear;
    double history[TABLE_POINTS];
    uint16_t limits[UINT8_MAX - 253];
} sample_t;

static const int SAMPLE_VERSION = 7;
extern const sample_t sample_default;
extern const float sample_table[TABLE_ROWS][TABLE_POINTS];
extern const float sample_gain;

sample_t sample_step(const sample_t *input, float factor) __attribute__((nonnull(1)));
float sample_lookup(size_t row, size_t column);
uint32_t sample_pack(const sample_t *input, uint8_t data[8]);
static inline float sample_half(float value)
{
    return HALF(value);
}

#ifdef __cplusplus
}
#endif
#endif
"""
SAMPLE_C = """
#include "sample.h"

static const float offsets[TABLE_ROWS] = {0.25f, 0.5f};
const float sample_table[TABLE_ROWS][TABLE_POINTS] = {{1.0f, 2.0f, 3.0f}, {4.0f, 5.0f, 6.0f}};
const float sample_gain = 2.5f;
const sample_t sample_default = {1U, 10.0f, true, GEAR_FORWARD, {0.1, 0.2, 0.3}, {5U, 6U}};

sample_t sample_step(const sample_t *input, float factor)
{
    sample_t result = *input;
    result.counter = (uint8_t)(result.counter + 1U);
    result.speed = sample_half(result.speed * factor);
    result.inhibit = !result.inhibit;
    result.gear = GEAR_REVERSE;
    return result;
}

float sample_lookup(size_t row, size_t column)
{
    return sample_table[row][column] + offsets[row];
}

uint32_t sample_pack(const sample_t *input, uint8_t data[8])
{
    data[0] = input->counter;
    data[7] = input->inhibit ? 255U : 0U;
    return 0x101U;
}
"""
SAMPLE = {"include/types.h": TYPES_H, "include/sample.h": SAMPLE_H, "src/sample.c": SAMPLE_C}


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of the test's own; a compiler set by the user's CC is not what these tests are about."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("ARS_CACHE", str(folder))
    monkeypatch.delenv("CC", raising=False)
    return folder


def tiny(value: int) -> dict[str, str]:
    """A library whose `tiny()` returns `value`."""
    return {
        "include/tiny.h": "int tiny(void);\n",
        "src/tiny.c": f'#include "tiny.h"\nint tiny(void)\n{{\n    return {value};\n}}\n',
    }


@pytest.fixture
def unique(tmp_path: Path) -> dict[str, str]:
    """`tiny(1)` in sources that no other test has, so that this process has not loaded them yet."""
    return {**tiny(1), "src/unique.h": f"/* {tmp_path} */\n"}


def script(path: Path, body: str) -> str:
    """An executable shell script; returns its path."""
    path.write_text(f"#!/bin/sh\n{body}\n", encoding="utf-8")
    path.chmod(0o755)
    return str(path)


@pytest.fixture
def logged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A log with one line for each start of the compiler, its arguments."""
    log = tmp_path / "log"
    log.touch()
    monkeypatch.setenv("CC", script(tmp_path / "logged-cc", f'echo "$@" >> "{log}"\nexec {find_compiler()} "$@"'))
    return log


def compilations(log: Path) -> int:
    """How often a source was compiled; questions for the version are not counted."""
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


def start_process(sources: dict[str, str], mode: str) -> subprocess.Popen[str]:
    """A Python process that compiles and calls `tiny` when it reads a line."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", CHILD, json.dumps([sources, mode])]
    return subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def finish(process: subprocess.Popen[str]) -> tuple[int, Path]:
    """What `tiny` returned there, and the library's path."""
    output, _ = process.communicate("go\n")
    assert process.returncode == 0
    value, path = output.split("\n")[-2].split(" ", 1)
    return int(value), Path(path)


@pytest.fixture(scope="module", params=MODES)
def sample(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Library:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ARS_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.delenv("CC", raising=False)
        # Flags that the user's C meets and cffi's glue and Python's headers do not.
        flags = (*DEFAULT_FLAGS, "-pedantic-errors", "-Wconversion", "-Wmissing-prototypes", "-Wstrict-prototypes")
        return compile_library("4ws-2 sample", SAMPLE, ["include/sample.h"], flags=flags, mode=request.param)


class TestBothModes:
    def test_structs_constants_tables_and_arrays(self, sample: Library) -> None:
        lib, ffi = sample.lib, sample.ffi
        given = ffi.new("sample_t *", {"counter": 255, "speed": 3.0, "inhibit": True, "history": [1, 2, 3]})
        result = lib.sample_step(given, 5.0)
        assert (result.counter, result.speed, result.inhibit, list(result.history)) == (0, 7.5, False, [1.0, 2.0, 3.0])
        assert result.gear == lib.GEAR_REVERSE == -1
        assert (lib.GEAR_NEUTRAL, lib.GEAR_FORWARD, lib.GEAR_COUNT, lib.TABLE_POINTS, lib.SAMPLE_VERSION) == (0, 3, 4, 3, 7)
        assert [list(row) for row in lib.sample_table] == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
        default = lib.sample_default
        assert (default.counter, default.speed, default.inhibit, default.gear) == (1, 10.0, True, lib.GEAR_FORWARD)
        assert (list(default.history), list(default.limits)) == ([0.1, 0.2, 0.3], [5, 6])
        assert lib.sample_step(ffi.addressof(default), 1.0).speed == 5.0
        assert lib.sample_lookup(1, 2) == 6.5
        data = ffi.new("uint8_t[8]")
        assert lib.sample_pack(ffi.new("sample_t *", {"counter": 9, "inhibit": True}), data) == 0x101
        assert list(data) == [9, 0, 0, 0, 0, 0, 0, 255]
        assert hasattr(lib, "sample_half") == (sample.mode == "api"), "an inline function of a header"


class TestCdef:
    def folder(self, tmp_path: Path, header: str) -> Path:
        (tmp_path / "types.h").write_text(TYPES_H, encoding="utf-8")
        path = tmp_path / "header.h"
        path.write_text(header, encoding="utf-8")
        return path

    def test_it_follows_the_header(self, tmp_path: Path) -> None:
        cdef = derive_cdef([self.folder(tmp_path, SAMPLE_H)], [tmp_path])
        ffi = cffi.FFI()
        ffi.cdef(cdef)
        assert ffi.sizeof("sample_t") == 48  # 1 + 3 pad, 4, 1 + 3 pad, 4, 3 x 8, 2 x 2 + 4 pad
        assert "GEAR_FORWARD" in cdef
        for word in ("#", "__attribute__", "_Static_assert", "return", "__cplusplus", "int_least8_t"):
            assert word not in cdef

    def test_macros_of_the_flags_count(self, tmp_path: Path) -> None:
        header = self.folder(tmp_path, "#ifdef WIDE\ntypedef double real_t;\n#else\ntypedef float real_t;\n#endif\n")
        assert "float real_t" in derive_cdef([header], [])
        assert "double real_t" in derive_cdef([header], [], flags=["-std=c99", "-DWIDE"])

    @pytest.mark.parametrize(
        "header",
        [
            "typedef struct { char a; int b; } __attribute__((packed)) p_t;\n",
            "typedef struct { char a; int b __attribute__((__aligned__(16))); } p_t;\n",
            "#pragma pack(push, 1)\ntypedef struct { char a; int b; } p_t;\n#pragma pack(pop)\n",
        ],
    )
    def test_a_set_layout_is_refused(self, tmp_path: Path, header: str) -> None:
        with pytest.raises(BuildError, match="packed or aligned"):
            derive_cdef([self.folder(tmp_path, header)], [])

    def test_members_may_be_called_packed(self, tmp_path: Path) -> None:
        assert "aligned" in derive_cdef([self.folder(tmp_path, "typedef struct { int packed; int aligned; } p_t;\n")], [])

    def test_a_header_that_is_not_c_names_the_line(self, tmp_path: Path) -> None:
        with pytest.raises(BuildError, match=r"header\.h:2"):
            derive_cdef([self.folder(tmp_path, "int f(void);\nint 3 g;\n")], [])

    def test_what_cffi_cannot_take(self, unique: dict[str, str]) -> None:
        unique["include/tiny.h"] += "typedef struct { int a[sizeof(int)]; } s_t;\n"
        with pytest.raises(BuildError, match="cffi does not take"):
            compile_library("tiny", unique, ["include/tiny.h"], mode="abi")


class TestCompiler:
    def test_cc_with_arguments(self, monkeypatch: pytest.MonkeyPatch, unique: dict[str, str]) -> None:
        unique["src/tiny.c"] = '#include "tiny.h"\nint tiny(void)\n{\n    return GIVEN;\n}\n'
        monkeypatch.setenv("CC", f"{find_compiler()} -DGIVEN='(40 + 2)'")
        assert find_compiler().endswith("2)'")
        assert compile_library("tiny", unique, ["include/tiny.h"], mode="abi").lib.tiny() == 42

    def test_order_on_the_path(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("PATH", str(tmp_path))
        script(tmp_path / "clang", "exit 1")
        assert find_compiler() == "clang"
        script(tmp_path / "gcc", "exit 1")
        assert find_compiler() == "gcc"
        script(tmp_path / "cc", "exit 1")
        assert find_compiler() == "cc"

    def test_none(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own_cache: Path, unique: dict[str, str]) -> None:
        monkeypatch.setenv("PATH", str(tmp_path))
        with pytest.raises(BuildError, match=r"^no C compiler was found; install one, e\.g\. apt install gcc, or set CC$"):
            compile_library("tiny", unique, ["include/tiny.h"])
        assert not own_cache.exists()

    @pytest.mark.parametrize("command", ["/nowhere/cc -O2", "no-such-compiler", "''", "cc 'open"])
    def test_bad_cc(self, monkeypatch: pytest.MonkeyPatch, command: str) -> None:
        monkeypatch.setenv("CC", command)
        with pytest.raises(BuildError) as caught:
            find_compiler()
        assert caught.value.where == "CC"
        assert command.split()[0].strip("'") in caught.value.what

    @pytest.mark.parametrize(
        ("body", "message"),
        [
            ("kill -9 $$", "signal 9"),
            ("exit 3", "exit code 3: it printed nothing"),
            ("echo; echo odd failure >&2; exit 4", "exit code 4: odd failure"),
            ("echo '/tmp/x.s: Fatal error: cannot write: No space left on device' >&2; exit 1", "No space left on device"),
        ],
    )
    def test_it_fails_without_an_error_in_the_source(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unique: dict[str, str], own_cache: Path, body: str, message: str
    ) -> None:
        compiler = f'case " $* " in *" -c "*) {body};; esac\nexec {find_compiler()} "$@"'
        monkeypatch.setenv("CC", script(tmp_path / "failing-cc", compiler))
        with pytest.raises(BuildError, match=message) as caught:
            compile_library("tiny", unique, ["include/tiny.h"])
        assert caught.value.where == "src/tiny.c"
        assert "\n" not in str(caught.value)
        assert list(own_cache.iterdir()) == []


class TestBadC:
    @pytest.mark.parametrize(
        ("text", "where", "message"),
        [
            ("int tiny(void)\n{\n    return nothing;\n}\n", "src/tiny.c:3", "nothing"),
            ('#include "absent.h"\n', "src/tiny.c:1", "absent.h"),
            ("int tiny(void)\n{\n    int unused;\n    return 1;\n}\n", "src/tiny.c:3", "unused"),  # a warning is an error
        ],
    )
    def test_first_error_and_place(self, unique: dict[str, str], own_cache: Path, text: str, where: str, message: str) -> None:
        unique["src/tiny.c"] = text
        with pytest.raises(BuildError, match=message) as caught:
            compile_library("tiny", unique, ["include/tiny.h"])
        assert caught.value.where == where
        assert "\n" not in str(caught.value)
        assert list(own_cache.iterdir()) == []

    def test_defined_twice(self, unique: dict[str, str]) -> None:
        unique["src/again.c"] = unique["src/tiny.c"]
        with pytest.raises(BuildError, match=r"(multiple definition|duplicate symbol).*tiny"):
            compile_library("tiny", unique, ["include/tiny.h"], mode="abi")

    @pytest.mark.parametrize("mode", MODES)
    def test_not_defined_at_all(self, unique: dict[str, str], mode: Any) -> None:
        unique["src/tiny.c"] = "int absent(void);\nint tiny(void);\nint tiny(void)\n{\n    return absent();\n}\n"
        for _ in range(2):  # the second time it comes from the cache
            with pytest.raises(BuildError, match=r"does not load: .*absent"):
                compile_library("tiny", unique, ["include/tiny.h"], mode=mode)

    @pytest.mark.parametrize("path", ["../tiny.c", "/tmp/tiny.c", "src/../../tiny.c", "", 'a".h', "a\n.c"])
    def test_source_outside_the_folder(self, tmp_path: Path, path: str) -> None:
        with pytest.raises(BuildError, match="not a plain relative path"):
            compile_library("tiny", {path: "int a;\n"}, [])
        assert list(tmp_path.iterdir()) == []


class TestUnitFlags:
    SOURCES: ClassVar[dict[str, str]] = {
        "include/two.h": "int one(void);\nint two(void);\n",
        "one.c": '#include "two.h"\nint one(void)\n{\n    return NUMBER;\n}\n',
        "two.c": '#include "two.h"\n#ifdef NUMBER\n#error "not for this one"\n#endif\nint two(void)\n{\n    return 2;\n}\n',
    }

    def test_they_are_for_one_source_and_not_for_the_linker(self) -> None:
        """The linker would refuse its option; here the compiler takes no notice of it."""
        for number in (1, 7):  # another flag, another library
            own = {"one.c": [f"-DNUMBER={number}", "-Wl,--no-such-option"]}
            library = compile_library("two", self.SOURCES, ["include/two.h"], unit_flags=own)
            assert (library.lib.one(), library.lib.two()) == (number, 2)


class TestModes:
    @pytest.fixture
    def no_python_h(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(sysconfig, "get_path", lambda _name: str(tmp_path / "no-headers"))

    @pytest.mark.usefixtures("no_python_h")
    def test_without_python_h_the_plain_library_is_taken(self, unique: dict[str, str]) -> None:
        library = compile_library("tiny", unique, ["include/tiny.h"])
        assert library.mode == "abi"
        assert library.lib.tiny() == 1

    @pytest.mark.parametrize("mode", MODES)
    def test_nothing_is_printed(self, unique: dict[str, str], capfd: pytest.CaptureFixture[str], mode: Any) -> None:
        compile_library("tiny", unique, ["include/tiny.h"], mode=mode)
        assert capfd.readouterr() == ("", "")

    def test_auto_takes_the_checked_mode(self, unique: dict[str, str]) -> None:
        library = compile_library("tiny", unique, ["include/tiny.h"])
        assert library.mode == MODES[0]
        assert library is compile_library("tiny", unique, ["include/tiny.h"], mode=MODES[0])  # type: ignore[arg-type]


class TestCache:
    def test_a_second_call_does_not_start_the_compiler(self, logged: Path, unique: dict[str, str]) -> None:
        first = compile_library("tiny", unique, ["include/tiny.h"], mode="abi")
        started = logged.read_text(encoding="utf-8")
        assert compilations(logged) == 1
        assert compile_library("tiny", unique, ["include/tiny.h"], mode="abi") is first
        assert logged.read_text(encoding="utf-8") == started

    @pytest.mark.parametrize("mode", MODES)
    def test_another_process_takes_what_stands(self, logged: Path, unique: dict[str, str], mode: Any) -> None:
        first = finish(start_process(unique, mode))
        compiled = compilations(logged)
        assert compiled > 0
        assert finish(start_process(unique, mode)) == first
        assert compilations(logged) == compiled

    def test_whatever_decides_the_result_is_in_the_key(self, unique: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
        def path(sources: dict[str, str], name: str = "tiny", **options: Any) -> Path:
            return compile_library(name, sources, ["include/tiny.h"], **{"mode": "abi", **options}).path

        paths = [
            path(unique),
            path({**unique, **tiny(2)}),
            path({**unique, "include/tiny.h": "int tiny(void); /* other */\n"}),
            path(unique, name="other"),
            path(unique, flags=(*DEFAULT_FLAGS, "-O0")),
            path(unique, include_folders=("include", "src")),
        ]
        monkeypatch.setenv("CC", f"{find_compiler()} -DOTHER")
        paths.append(path(unique))
        assert len(set(paths)) == len(paths)

    @pytest.mark.parametrize("mode", MODES)
    def test_two_processes_at_once(self, unique: dict[str, str], own_cache: Path, mode: Any) -> None:
        processes = [start_process(unique, mode) for _ in range(2)]
        for process in processes:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
        for process in processes:  # both are up: now they compile side by side
            assert process.stdin is not None
            process.stdin.write("go\n")
            process.stdin.flush()
        assert [finish(process)[0] for process in processes] == [1, 1]
        assert {path.suffix for path in own_cache.iterdir()} == {".so", ".json"}

    def test_threads_share_one_build(self, logged: Path, unique: dict[str, str]) -> None:
        with ThreadPoolExecutor(4) as pool:
            libraries = list(pool.map(lambda _: compile_library("tiny", unique, ["include/tiny.h"], mode="abi"), range(8)))
        assert len({id(library) for library in libraries}) == 1
        assert compilations(logged) == 1

    @pytest.mark.parametrize("damage", ["truncated", "changed", "no library", "half an index", "foreign"])
    def test_a_damaged_entry_is_built_again(self, logged: Path, unique: dict[str, str], damage: str) -> None:
        _, path = finish(start_process(unique, "abi"))
        (index,) = path.parent.glob("*.json")
        content = path.read_bytes()
        if damage == "truncated":
            path.write_bytes(content[: len(content) // 3])
        elif damage == "changed":
            path.write_bytes(content[:5000] + bytes([content[5000] ^ 1]) + content[5001:])
        elif damage == "no library":
            path.unlink()
        elif damage == "half an index":
            index.write_bytes(index.read_bytes()[:40])
        else:  # whole, but not for this machine
            digest = hashlib.sha256(b"foreign").hexdigest()
            index.write_text(json.dumps({**json.loads(index.read_text(encoding="utf-8")), "sha256": digest}), encoding="utf-8")
            path.with_name(f"{path.stem.rpartition('-')[0]}-{digest[:16]}.so").write_bytes(b"foreign")
        assert finish(start_process(unique, "abi")) == (1, path)
        assert compilations(logged) == 2
        assert path.read_bytes() == content

    def test_a_full_disk_is_one_line(self, unique: dict[str, str], monkeypatch: pytest.MonkeyPatch, own_cache: Path) -> None:
        def full(*_: object) -> int:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(Path, "write_bytes", full)
        with pytest.raises(BuildError, match=r"cannot be stored: No space left on device; .*ARS_CACHE"):
            compile_library("tiny", unique, ["include/tiny.h"], mode="abi")
        assert list(own_cache.iterdir()) == []


class TestCacheFolder:
    def test_xdg_then_home(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("ARS_CACHE", "")
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
        monkeypatch.setenv("HOME", str(tmp_path / "home"))
        assert cache_folder() == tmp_path / "xdg" / "ars-codegen"
        for ignored in ("", "relative/folder"):
            monkeypatch.setenv("XDG_CACHE_HOME", ignored)
            assert cache_folder() == tmp_path / "home" / ".cache" / "ars-codegen"

    @pytest.fixture
    def unwritable(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        """`$ARS_CACHE` below a regular file, where not even root can write; returns the folder for temporary files."""
        (tmp_path / "file").touch()
        monkeypatch.setenv("ARS_CACHE", str(tmp_path / "file" / "cache"))
        temporary = tmp_path / "tmp"
        temporary.mkdir()
        monkeypatch.setattr(tempfile, "tempdir", str(temporary))
        cache._folder_of_this_process.cache_clear()
        return temporary

    def test_unwritable_falls_to_a_private_temporary_folder(self, unwritable: Path, unique: dict[str, str]) -> None:
        folder = cache_folder()
        assert folder.parent == unwritable
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert cache_folder() == folder
        library = compile_library("tiny", unique, ["include/tiny.h"], mode="abi")
        assert library.lib.tiny() == 1
        assert library.path.parent == folder

    @pytest.mark.parametrize("squatter", ["open folder", "link", "file"])
    def test_what_others_could_have_left_there_is_not_taken(self, unwritable: Path, tmp_path: Path, squatter: str) -> None:
        expected = cache_folder()
        expected.rmdir()
        if squatter == "open folder":
            expected.mkdir()
            expected.chmod(0o777)
        elif squatter == "link":
            (tmp_path / "elsewhere").mkdir(mode=0o700)
            expected.symlink_to(tmp_path / "elsewhere")
        else:
            expected.touch(mode=0o600)
        folder = cache_folder()
        assert folder != expected
        assert folder.parent == unwritable
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert cache_folder() == folder

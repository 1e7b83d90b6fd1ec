"""Files for use in a C project: GNU make here, CMake and Zephyr's CMake in tests/evidence/toolchains."""

import functools
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import kconfiglib
import yaml

from codegen.emit.folder import Folder
from codegen.emit.from_files import prepare
from codegen.emit.write import write_folder

MAP = Path(__file__).parents[2] / "generated" / "4ws2-paper.npz"

SELFTEST_MAIN = """#include <stdio.h>
#include "ars_controller.h"
int main(void)
{
    (void)printf("hello\\n");
    return ars_selftest() ? 0 : 1;
}
"""
BOTH_MAIN = """#include "ars_task.h"
#include "rws_task.h"
#include "ars_dynamics.h"
int main(void)
{
    const ars_dynamics_state_t state = { 0 };
    const ars_dynamics_input_t input = { .speed = 20.0f };
    (void)ars_dynamics_magic_formula(&state, &input);
    return (ars_selftest() && rws_selftest()) ? 0 : 1;
}
"""
MAKE_HELLO = """CFLAGS = -O1 -Wall -Wextra -Werror
hello: main.o
\t$(CC) $(LDFLAGS) $^ $(LDLIBS) -o $@
"""
MAKE_LINES = "include ars/ars.mk\nhello: $(ARS_OBJECTS)\n"


@functools.cache
def made(prefix: str = "ars") -> Folder:
    return prepare(MAP, prefix=prefix).folder


def text(path: str, prefix: str = "ars") -> str:
    return made(prefix).files[path].decode("ascii")


def run(command: Sequence[str | Path], folder: Path) -> subprocess.CompletedProcess[str]:
    words, environment = [str(word) for word in command], {**os.environ, "LC_ALL": "C"}
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False, env=environment)


def done(result: subprocess.CompletedProcess[str]) -> str:
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def project(folder: Path, files: dict[str, str], *prefixes: str) -> Path:
    """Write a project with these files, and for each prefix a build in a folder of that name."""
    folder.mkdir(parents=True)
    for prefix in prefixes:
        write_folder(made(prefix), folder / prefix)
    for name, content in files.items():
        (folder / name).write_text(content)
    return folder


# --- GNU make -------------------------------------------------------------------------------------------------------


def test_a_fresh_make_project_needs_two_lines(tmp_path: Path) -> None:
    """They may come first: the default goal and the project's own compilation stay unchanged."""
    folder = project(tmp_path / "a plain project", {"Makefile": MAKE_LINES + MAKE_HELLO, "main.c": SELFTEST_MAIN}, "ars")
    before = sorted((folder / "ars").rglob("*"))
    output = done(run(["make"], folder)).splitlines()
    assert done(run([folder / "hello"], folder)) == "hello\n"
    assert sorted((folder / "ars").rglob("*")) == before
    compiled = [line for line in output if " -c " in line]
    for line in compiled:
        assert ("-ffp-contract=off" in line) == ("ars/src/" in line), line
        assert ("-std=c99" in line) == ("ars/src/" in line), line
    assert len(compiled) == len([path for path in made().files if path.startswith("src/")])  # plus main.c, minus the dynamics
    assert "up to date" in done(run(["make"], folder))
    header = folder / "ars" / "include" / "ars_sections.h"
    newer = (folder / "hello").stat().st_mtime + 2.0
    os.utime(header, (newer, newer))
    assert "ars_map.c" in done(run(["make", "-n"], folder))


def test_objects_of_two_builds_with_dynamics_go_to_the_project_s_folder(tmp_path: Path) -> None:
    out = tmp_path / "out"
    lines = "include ../ecu/ars/ars.mk\nhello: $(ARS_OBJECTS)\n"
    both = lines + "hello: $(ARS_DYNAMICS_OBJECTS)\nLDLIBS += -lm\n" + lines.replace("ars", "rws").replace("ARS", "RWS")
    makefile = "vpath %.c ../ecu\n" + MAKE_HELLO + both
    folder = project(tmp_path / "ecu", {"Makefile": makefile, "main.c": BOTH_MAIN}, "ars", "rws")
    before = sorted(folder.rglob("*"))
    out.mkdir()
    done(run(["make", "-f", "../ecu/Makefile", "ARS_OBJECT_DIR=of-the-controller"], out))
    done(run([out / "hello"], out))
    assert sorted(folder.rglob("*")) == before
    assert (out / "of-the-controller" / "ars_task.o").is_file()


def test_a_blank_in_the_included_path_is_reported(tmp_path: Path) -> None:
    folder = project(tmp_path / "ecu", {"Makefile": MAKE_HELLO + MAKE_LINES.replace("ars/ars.mk", "a\\ b/ars.mk")}, "ars")
    (folder / "ars").rename(folder / "a b")
    result = run(["make"], folder)
    assert result.returncode == 2
    assert "has a blank; make cannot have that" in result.stderr


# --- Zephyr ---------------------------------------------------------------------------------------------------------


def test_the_zephyr_module_names_files_of_the_build() -> None:
    """Keys: Zephyr's documentation, "Modules (External projects)", "Module yaml file description"."""
    cmake, kconfig_file = "zephyr", "zephyr/Kconfig"
    assert yaml.safe_load(text("zephyr/module.yml")) == {
        "name": "ars_rear_steering",
        "build": {"cmake": cmake, "kconfig": kconfig_file},
    }
    assert made().files.keys() >= {f"{cmake}/CMakeLists.txt", kconfig_file}


def kconfig(folder: Path, prefix: str = "ars", minimal: bool = False, **values: str) -> dict[str, str]:
    """Return the values of the module's symbols, in a tree with the symbols that Zephyr provides."""
    folder.mkdir(exist_ok=True)
    (folder / "Kconfig.module").write_bytes(made(prefix).files["zephyr/Kconfig"])
    (folder / "Kconfig").write_text(
        f'mainmenu "test"\nconfig MINIMAL_LIBC\n\tbool\n\tdefault {"y" if minimal else "n"}\n'
        f'menu "{prefix}"\nosource "{folder}/Kconfig.module"\nendmenu\n'
    )
    known: Any = kconfiglib.Kconfig(str(folder / "Kconfig"), warn_to_stderr=False)
    for name, value in values.items():
        known.syms[name].set_value(value)
    assert known.warnings == []
    return {name: symbol.str_value for name, symbol in known.syms.items() if name.startswith(prefix.upper())}


def test_the_symbols_of_zephyr_are_off_by_default(tmp_path: Path) -> None:
    one, dynamics = "ARS_REAR_STEERING", "ARS_REAR_STEERING_DYNAMICS"
    assert kconfig(tmp_path) == kconfig(tmp_path, **{dynamics: "y"}) == {one: "n", dynamics: "n"}
    assert kconfig(tmp_path, **{one: "y"}) == {one: "y", dynamics: "n"}
    assert kconfig(tmp_path, **{one: "y", dynamics: "y"}) == {one: "y", dynamics: "y"}
    assert kconfig(tmp_path, minimal=True, **{one: "y", dynamics: "y"}) == {one: "y", dynamics: "n"}
    assert set(kconfig(tmp_path, "rws")) == {"RWS_REAR_STEERING", "RWS_REAR_STEERING_DYNAMICS"}

"""A C project takes a build over: fresh projects with CMake, GNU make and (its parts played here) Zephyr, two lines each."""

from __future__ import annotations

import functools
import importlib
import json
import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from codegen.emit.folder import Folder
from codegen.emit.from_files import prepare
from codegen.emit.write import write_folder

MAP = Path(__file__).parents[2] / "generated" / "4ws2.npz"

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
int main(void)
{
    return (ars_selftest() && rws_selftest()) ? 0 : 1;
}
"""
DYNAMICS_MAIN = """#include "ars_dynamics.h"
int main(void)
{
    const ars_dynamics_state_t state = { 0 };
    const ars_dynamics_input_t input = { .speed = 20.0f };
    (void)ars_dynamics_magic_formula(&state, &input);
    return 0;
}
"""

CMAKE_HELLO = """cmake_minimum_required(VERSION 3.13)
project(hello LANGUAGES C)
add_executable(hello main.c)
"""
CMAKE_LINES = "add_subdirectory(ars)\ntarget_link_libraries(hello PRIVATE ars::ars)\n"

MAKE_HELLO = """CFLAGS = -O2 -Wall -Wextra -Werror
hello: main.o
\t$(CC) $(LDFLAGS) $^ $(LDLIBS) -o $@
"""
MAKE_LINES = "include ars/ars.mk\nhello: $(ARS_OBJECTS)\n"

Commands = list[dict[str, str]]


def lacking(name: str) -> NoReturn:
    """Skip the test, or fail it where all tests must run."""
    if os.environ.get("CI", "").lower() not in ("", "0", "false"):
        pytest.fail(f"in CI no test here may be skipped: {name} is not installed")
    pytest.skip(f"{name} is not installed")


def tool(name: str) -> str:
    """A program of the host."""
    return shutil.which(name) or lacking(name)


def package(name: str) -> Any:
    """A Python package."""
    try:
        return importlib.import_module(name)
    except ImportError:
        lacking(name)


@functools.cache
def made(prefix: str = "ars") -> Folder:
    return prepare(MAP, prefix=prefix).folder


def text(path: str, prefix: str = "ars") -> str:
    return made(prefix).files[path].decode("ascii")


def run(command: Sequence[str | Path], folder: Path, **more: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(word) for word in command],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "LC_ALL": "C", **more},
    )


def done(result: subprocess.CompletedProcess[str]) -> str:
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def project(folder: Path, files: dict[str, str], *prefixes: str) -> Path:
    """A project with these files, and beside them a build for each prefix in a folder of its name."""
    folder.mkdir(parents=True)
    for prefix in prefixes:
        write_folder(made(prefix), folder / prefix)
    for name, content in files.items():
        (folder / name).write_text(content)
    return folder


def cmake(folder: Path, *options: str) -> Path:
    """Configure and build; the folder of what was made."""
    at = folder / "made here"
    command = [tool("cmake"), "-G", "Unix Makefiles", "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON", *options, "-S", folder, "-B", at]
    tool("make")
    done(run(command, folder))
    done(run([tool("cmake"), "--build", at], folder))
    return at


def contraction_is_off(at: Path) -> dict[str, bool]:
    """Name of each compiled file -> whether products and sums are kept apart in it."""
    commands: Commands = json.loads((at / "compile_commands.json").read_text())
    return {Path(each["file"]).name: "-ffp-contract=off" in each["command"] for each in commands}


def is_generated(name: str) -> bool:
    return name.startswith(("ars_", "rws_"))


MAP_MAIN = """#include <stdio.h>
#include "ars_map.h"
int main(void)
{
    (void)printf("%a\\n", (double)ars_map_yaw_rate(20.0f, 0.05f));
    return 0;
}
"""


def stretched(program: Path) -> Path:
    """The program with other speeds in its map, as a calibration tool would write them."""
    listed = text("src/ars_calibration.c").partition("ars_map_speed_breakpoints[")[2].partition("{")[2].partition("}")[0]
    speeds = np.array([number.strip().rstrip("f") for number in listed.split(",")], dtype=np.float32)
    content = program.read_bytes()
    assert content.count(speeds.tobytes()) == 1
    other = program.with_name("stretched")
    other.write_bytes(content.replace(speeds.tobytes(), (np.float32(1.2) * speeds).tobytes()))
    other.chmod(0o755)
    return other


@pytest.mark.parametrize("tools", ["cmake", "make"])
def test_link_time_optimisation_makes_no_constant_of_a_calibrated_number(tmp_path: Path, tools: str) -> None:
    """Nor does a unity build. Changed in the finished program, the map answers otherwise."""
    if tools == "cmake":
        files = {"main.c": MAP_MAIN, "CMakeLists.txt": CMAKE_HELLO + CMAKE_LINES}
        options = ("-DCMAKE_INTERPROCEDURAL_OPTIMIZATION=ON", "-DCMAKE_UNITY_BUILD=ON", "-DCMAKE_BUILD_TYPE=Release")
        program = cmake(project(tmp_path / "one", files, "ars"), *options) / "hello"
    else:
        files = {"main.c": MAP_MAIN, "Makefile": MAKE_HELLO.replace("-O2", "-O2 -flto") + MAKE_LINES}
        folder = project(tmp_path / "one", files, "ars")
        done(run([tool("make"), "LDFLAGS=-flto -O2"], folder))
        program = folder / "hello"
    assert done(run([program], tmp_path)) != done(run([stretched(program)], tmp_path))


# --- every build has them -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("prefix", ["ars", "rws"])
def test_every_build_has_the_files_and_they_name_only_what_is_there(prefix: str) -> None:
    files = made(prefix).files
    sources = {path for path in files if path.startswith("src/")}
    for path in ("CMakeLists.txt", f"{prefix}.mk", "zephyr/CMakeLists.txt"):
        assert set(re.findall(r"src/[a-z_0-9]+\.c", text(path, prefix))) == sources, path


@pytest.mark.parametrize("path", ["CMakeLists.txt", "ars.mk", "zephyr/CMakeLists.txt", "zephyr/Kconfig", "zephyr/module.yml"])
def test_every_path_in_them_is_relative(path: str) -> None:
    assert not re.search(r"(?<![\w./)}])/\w", text(path)), path


# --- CMake ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("main", ["the example", "the self-test"])
def test_a_fresh_cmake_project_needs_two_lines(tmp_path: Path, main: str) -> None:
    program = text("example/example_main.c") if main == "the example" else SELFTEST_MAIN
    plain = CMAKE_HELLO.splitlines()
    folder = project(tmp_path / "a plain project", {"CMakeLists.txt": CMAKE_HELLO + CMAKE_LINES, "main.c": program}, "ars")
    assert len((folder / "CMakeLists.txt").read_text().splitlines()) == len(plain) + 2
    at = cmake(folder)
    assert ("yaw rate" if main == "the example" else "hello") in done(run([at / "hello"], folder))
    found = contraction_is_off(at)
    assert {name for name, off in found.items() if off} == {name for name in found if is_generated(name)}
    assert len(found) == 1 + len([path for path in made().files if path.startswith("src/")])


def test_the_example_and_the_tests_stay_out_of_another_project(tmp_path: Path) -> None:
    lists = CMAKE_HELLO + "enable_testing()\n" + CMAKE_LINES
    folder = project(tmp_path / "ecu", {"CMakeLists.txt": lists, "main.c": SELFTEST_MAIN}, "ars")
    at = cmake(folder)
    assert "No tests were found" in run([tool("ctest"), "--test-dir", at], folder).stderr
    assert not list(at.rglob("*example*"))
    assert not list(at.rglob("ars_ecu*"))


def test_the_options_of_the_project_around_it_stay(tmp_path: Path) -> None:
    """Its standard, its warnings and its options; and ours hold against an option of theirs."""
    lists = (
        "cmake_minimum_required(VERSION 3.13)\nproject(hello LANGUAGES C)\nset(CMAKE_C_STANDARD 11)\n"
        "add_compile_options(-ffp-contract=fast -Wall -Wextra -Werror -Wconversion)\nadd_executable(hello main.c)\n"
        + CMAKE_LINES
    )
    folder = project(tmp_path / "ecu", {"CMakeLists.txt": lists, "main.c": SELFTEST_MAIN}, "ars")
    commands: Commands = json.loads((cmake(folder) / "compile_commands.json").read_text())
    for each in commands:
        ours = is_generated(Path(each["file"]).name)
        words = each["command"].split()
        assert [word for word in words if word.startswith("-ffp-contract")][-1] == f"-ffp-contract={'off' if ours else 'fast'}"
        assert ("-std=c99" in words) == ours
        assert ("-std=gnu11" in words) == (not ours)


def test_two_builds_stand_in_one_cmake_project(tmp_path: Path) -> None:
    lists = (
        CMAKE_HELLO + "add_subdirectory(ars)\nadd_subdirectory(rws)\ntarget_link_libraries(hello PRIVATE ars::ars rws::rws)\n"
    )
    folder = project(tmp_path / "two of them", {"CMakeLists.txt": lists, "main.c": BOTH_MAIN}, "ars", "rws")
    done(run([cmake(folder) / "hello"], folder))


def test_two_builds_of_one_prefix_are_refused_with_the_remedy(tmp_path: Path) -> None:
    folder = project(
        tmp_path / "ecu", {"CMakeLists.txt": CMAKE_HELLO + "add_subdirectory(ars)\nadd_subdirectory(rws)\n"}, "ars"
    )
    (folder / "main.c").write_text(SELFTEST_MAIN)
    shutil.copytree(folder / "ars", folder / "rws")
    result = run([tool("cmake"), "-G", "Unix Makefiles", "-S", folder, "-B", folder / "made"], folder)
    assert result.returncode != 0
    assert "build one of the two with another --prefix" in " ".join(result.stderr.split())


def test_a_build_outside_of_the_cmake_project_can_be_named(tmp_path: Path) -> None:
    lists = CMAKE_HELLO + CMAKE_LINES.replace("add_subdirectory(ars)", "add_subdirectory(../ars build-of-ars)")
    write_folder(made(), tmp_path / "ars")
    folder = project(tmp_path / "ecu", {"CMakeLists.txt": lists, "main.c": SELFTEST_MAIN})
    assert done(run([cmake(folder) / "hello"], folder)) == "hello\n"


# --- GNU make -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("main", ["the example", "the self-test"])
@pytest.mark.parametrize("lines", ["first", "last"])
def test_a_fresh_make_project_needs_two_lines(tmp_path: Path, main: str, lines: str) -> None:
    """Wherever they stand: the default goal stays, and so does the project's own compilation."""
    make, program = tool("make"), text("example/example_main.c") if main == "the example" else SELFTEST_MAIN
    makefile = MAKE_LINES + MAKE_HELLO if lines == "first" else MAKE_HELLO + MAKE_LINES
    assert len(makefile.splitlines()) == len(MAKE_HELLO.splitlines()) + 2
    folder = project(tmp_path / "a plain project", {"Makefile": makefile, "main.c": program}, "ars")
    before = sorted((folder / "ars").rglob("*"))
    said = done(run([make], folder)).splitlines()
    done(run([folder / "hello"], folder))
    assert sorted((folder / "ars").rglob("*")) == before
    compiled = [line for line in said if " -c " in line]
    for line in compiled:
        assert ("-ffp-contract=off" in line) == ("ars/src/" in line), line
        assert ("-std=c99" in line) == ("ars/src/" in line), line
    assert len(compiled) == len([path for path in made().files if path.startswith("src/")])  # main.c, and not the dynamics
    assert "up to date" in done(run([make], folder))


def test_what_depends_on_a_changed_header_is_compiled_again(tmp_path: Path) -> None:
    make = tool("make")
    folder = project(tmp_path / "ecu", {"Makefile": MAKE_HELLO + MAKE_LINES, "main.c": SELFTEST_MAIN}, "ars")
    done(run([make], folder))
    header = folder / "ars" / "include" / "ars_sections.h"
    newer = (folder / "hello").stat().st_mtime + 2.0
    os.utime(header, (newer, newer))
    assert "ars_map.c" in done(run([make, "-n"], folder))


def test_objects_go_where_the_make_project_wants_them(tmp_path: Path) -> None:
    make, out = tool("make"), tmp_path / "out"
    makefile = "vpath %.c ../ecu\n" + MAKE_HELLO + MAKE_LINES.replace("ars/ars.mk", "../ecu/ars/ars.mk")
    folder = project(tmp_path / "ecu", {"Makefile": makefile, "main.c": SELFTEST_MAIN}, "ars")
    before = sorted(folder.rglob("*"))
    out.mkdir()
    done(run([make, "-f", "../ecu/Makefile", "ARS_OBJECT_DIR=of-the-controller"], out))
    assert done(run([out / "hello"], out)) == "hello\n"
    assert sorted(folder.rglob("*")) == before
    assert (out / "of-the-controller" / "ars_task.o").is_file()


def test_two_builds_stand_in_one_make_project(tmp_path: Path) -> None:
    make = tool("make")
    makefile = MAKE_HELLO + MAKE_LINES + MAKE_LINES.replace("ars", "rws").replace("ARS", "RWS")
    folder = project(tmp_path / "two of them", {"Makefile": makefile, "main.c": BOTH_MAIN}, "ars", "rws")
    done(run([make], folder))
    done(run([folder / "hello"], folder))


def test_the_dynamics_are_one_more_variable(tmp_path: Path) -> None:
    make = tool("make")
    makefile = MAKE_HELLO + "include ars/ars.mk\nhello: $(ARS_DYNAMICS_OBJECTS)\nLDLIBS += -lm\n"
    folder = project(tmp_path / "ecu", {"Makefile": makefile, "main.c": DYNAMICS_MAIN}, "ars")
    done(run([make], folder))
    done(run([folder / "hello"], folder))


def test_a_blank_in_the_included_path_is_told(tmp_path: Path) -> None:
    make = tool("make")
    folder = project(tmp_path / "ecu", {"Makefile": MAKE_HELLO + MAKE_LINES.replace("ars/ars.mk", "a\\ b/ars.mk")}, "ars")
    (folder / "ars").rename(folder / "a b")
    result = run([make], folder)
    assert result.returncode == 2
    assert "has a blank; make cannot have that" in result.stderr


# --- Zephyr ---------------------------------------------------------------------------------------------------------

MODULE_KEYS = {"name", "build", "tests", "samples", "boards", "blobs"}
BUILD_KEYS = {"cmake", "kconfig", "cmake-ext", "kconfig-ext", "depends", "settings"}
"""Of zephyr/module.yml, by Zephyr's documentation, "Modules (External projects)", "Module yaml file description"."""

# What Zephyr's documentation says of these functions (cmake/modules/extensions.cmake), on top of plain CMake: options of a
# library come last, as Zephyr has them in a library of options that is linked last.
ZEPHYR_CMAKE = """cmake_minimum_required(VERSION 3.20)
project(zephyr_application LANGUAGES C)
add_library(zephyr_interface INTERFACE)
target_compile_options(zephyr_interface INTERFACE -Wall -Werror)
function(zephyr_include_directories)
  foreach(path IN LISTS ARGN)
    if(NOT IS_ABSOLUTE "${path}")
      set(path "${CMAKE_CURRENT_SOURCE_DIR}/${path}")
    endif()
    target_include_directories(zephyr_interface INTERFACE "${path}")
  endforeach()
endfunction()
macro(zephyr_library_named name)
  set(ZEPHYR_CURRENT_LIBRARY ${name})
  add_library(${name} STATIC "")
  set_property(GLOBAL APPEND PROPERTY ZEPHYR_LIBS ${name})
  target_link_libraries(${name} PUBLIC zephyr_interface)
endmacro()
function(zephyr_library_sources)
  target_sources(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${ARGN})
endfunction()
function(zephyr_library_sources_ifdef feature source)
  if(${${feature}})
    zephyr_library_sources(${source} ${ARGN})
  endif()
endfunction()
function(zephyr_library_compile_options)
  target_compile_options(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${ARGN})
endfunction()
add_executable(app main.c)
foreach(module IN ITEMS MODULES)
  add_subdirectory("${CMAKE_CURRENT_SOURCE_DIR}/${module}/zephyr" "module-${module}")
endforeach()
get_property(libraries GLOBAL PROPERTY ZEPHYR_LIBS)
target_link_libraries(app PRIVATE zephyr_interface ${libraries})
"""


def symbols(folder: Path, prefix: str = "ars", minimal: bool = False, **values: str) -> dict[str, str]:
    """What Kconfig makes of the module's symbols, inside a tree that has what Zephyr has around them."""
    kconfiglib = package("kconfiglib")
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


def test_the_zephyr_module_is_as_documented() -> None:
    yaml = package("yaml")
    facts = yaml.safe_load(text("zephyr/module.yml"))
    assert set(facts) <= MODULE_KEYS
    assert set(facts["build"]) <= BUILD_KEYS
    assert facts["name"] == "ars_rear_steering"
    assert f"{facts['build']['cmake']}/CMakeLists.txt" in made().files  # else Zephyr refuses the module
    assert facts["build"]["kconfig"] in made().files


def test_the_symbols_of_zephyr_are_off_until_asked_for(tmp_path: Path) -> None:
    both = {"ARS_REAR_STEERING", "ARS_REAR_STEERING_DYNAMICS"}
    assert symbols(tmp_path) == dict.fromkeys(both, "n")
    assert symbols(tmp_path, ARS_REAR_STEERING="y") == {"ARS_REAR_STEERING": "y", "ARS_REAR_STEERING_DYNAMICS": "n"}
    assert symbols(tmp_path, ARS_REAR_STEERING="y", ARS_REAR_STEERING_DYNAMICS="y") == dict.fromkeys(both, "y")
    assert symbols(tmp_path, ARS_REAR_STEERING_DYNAMICS="y") == dict.fromkeys(both, "n")
    assert symbols(tmp_path, minimal=True, ARS_REAR_STEERING="y", ARS_REAR_STEERING_DYNAMICS="y") == {
        "ARS_REAR_STEERING": "y",
        "ARS_REAR_STEERING_DYNAMICS": "n",
    }
    assert set(symbols(tmp_path, "rws")) == {"RWS_REAR_STEERING", "RWS_REAR_STEERING_DYNAMICS"}


@pytest.mark.parametrize("dynamics", [False, True])
def test_the_cmake_of_the_zephyr_module_compiles_and_links(tmp_path: Path, dynamics: bool) -> None:
    files = {"CMakeLists.txt": ZEPHYR_CMAKE.replace("MODULES", "ars rws"), "main.c": BOTH_MAIN}
    folder = project(tmp_path / "a zephyr application", files, "ars", "rws")
    more = ["-DCONFIG_ARS_REAR_STEERING_DYNAMICS=y"] if dynamics else []
    at = cmake(folder, "-DCONFIG_ARS_REAR_STEERING=y", "-DCONFIG_RWS_REAR_STEERING=y", *more)
    done(run([at / "app"], folder))
    found = contraction_is_off(at)
    assert {name for name, off in found.items() if off} == {name for name in found if is_generated(name)}
    assert ("ars_dynamics.c" in found) == dynamics
    assert "rws_dynamics.c" not in found


def test_a_zephyr_module_that_is_off_adds_nothing(tmp_path: Path) -> None:
    files = {"CMakeLists.txt": ZEPHYR_CMAKE.replace("MODULES", "ars"), "main.c": "int main(void) { return 0; }\n"}
    assert set(contraction_is_off(cmake(project(tmp_path / "app", files, "ars")))) == {"main.c"}

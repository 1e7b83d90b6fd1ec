"""Builds in new projects: with CMake, with Zephyr's CMake functions, and with link-time optimisation."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from codegen.emit.write import write_folder
from tests.emit.test_take_over import BOTH_MAIN, SELFTEST_MAIN, done, made, project, run, text

CMAKE_HELLO = """cmake_minimum_required(VERSION 3.13)
project(hello LANGUAGES C)
add_executable(hello main.c)
"""
CMAKE_LINES = "add_subdirectory(ars)\ntarget_link_libraries(hello PRIVATE ars::ars)\n"
MAP_MAIN = """#include <stdio.h>
#include "ars_map.h"
int main(void)
{
    (void)printf("%a\\n", (double)ars_map_yaw_rate(20.0f, 0.05f));
    return 0;
}
"""


def cmake(folder: Path, *options: str) -> Path:
    """Configure and build a project; return the folder of the results."""
    at = folder / "made here"
    command = ["cmake", "-G", "Unix Makefiles", "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON", *options, "-S", folder, "-B", at]
    done(run(command, folder))
    done(run(["cmake", "--build", at], folder))
    return at


def compile_commands(at: Path) -> dict[str, list[str]]:
    """Return the compiler arguments of each compiled file, by file name."""
    commands = json.loads((at / "compile_commands.json").read_text())
    return {Path(each["file"]).name: each["command"].split() for each in commands}


def check_contraction(at: Path) -> set[str]:
    """Check that only the generated files disable contraction of products and sums; return the names of compiled files."""
    for name, words in (commands := compile_commands(at)).items():
        assert ("-ffp-contract=off" in words) == name.startswith(("ars_", "rws_")), name
    return set(commands)


def with_scaled_speeds(program: Path) -> Path:
    """Copy a program with other speeds in its map, as a calibration tool would write them."""
    listed = text("src/ars_calibration.c").partition("ars_map_speed_breakpoints[")[2].partition("{")[2].partition("}")[0]
    speeds = np.array([number.strip().rstrip("f") for number in listed.split(",")], dtype=np.float32)
    content = program.read_bytes()
    assert content.count(speeds.tobytes()) == 1
    other = program.with_name("stretched")
    other.write_bytes(content.replace(speeds.tobytes(), (np.float32(1.2) * speeds).tobytes()))
    other.chmod(0o755)
    return other


@pytest.mark.long
def test_link_time_optimisation_does_not_fold_calibrated_numbers(tmp_path: Path) -> None:
    """A unity build does not either. Modified in the finished program, the map returns another value."""
    files = {"main.c": MAP_MAIN, "CMakeLists.txt": CMAKE_HELLO + CMAKE_LINES}
    options = ("-DCMAKE_INTERPROCEDURAL_OPTIMIZATION=ON", "-DCMAKE_UNITY_BUILD=ON", "-DCMAKE_BUILD_TYPE=Release")
    program = cmake(project(tmp_path / "one", files, "ars"), *options) / "hello"
    assert done(run([program], tmp_path)) != done(run([with_scaled_speeds(program)], tmp_path))


def test_cmake_builds_and_tests_the_folder(tmp_path: Path) -> None:
    write_folder(made(), tmp_path / "folder")
    at = cmake(tmp_path / "folder", "-DCMAKE_C_FLAGS=-Wall -Wextra -Werror")
    assert "100% tests passed" in done(run(["ctest", "--test-dir", at, "--output-on-failure"], at))


@pytest.mark.parametrize("main", ["the example", "the self-test"])
def test_a_fresh_cmake_project_needs_two_lines(tmp_path: Path, main: str) -> None:
    """The example and the tests of the build are not part of it."""
    program = text("example/example_main.c") if main == "the example" else SELFTEST_MAIN
    lists = CMAKE_HELLO + "enable_testing()\n" + CMAKE_LINES
    folder = project(tmp_path / "a plain project", {"CMakeLists.txt": lists, "main.c": program}, "ars")
    at = cmake(folder)
    assert ("yaw rate" if main == "the example" else "hello") in done(run([at / "hello"], folder))
    assert len(check_contraction(at)) == 1 + len([path for path in made().files if path.startswith("src/")])
    assert "No tests were found" in run(["ctest", "--test-dir", at], folder).stderr
    assert not [*at.rglob("*example*"), *at.rglob("ars_ecu*")]


def test_the_options_of_the_enclosing_project_stay(tmp_path: Path) -> None:
    """The project keeps its standard and options; the build's options override those of the project."""
    options = "set(CMAKE_C_STANDARD 11)\nadd_compile_options(-ffp-contract=fast -Wall -Wextra -Werror -Wconversion)\n"
    lists = CMAKE_HELLO.replace("add_executable", options + "add_executable") + CMAKE_LINES
    folder = project(tmp_path / "ecu", {"CMakeLists.txt": lists, "main.c": SELFTEST_MAIN}, "ars")
    for name, words in compile_commands(cmake(folder)).items():
        ours = name.startswith("ars_")
        assert [word for word in words if word.startswith("-ffp-contract")][-1] == f"-ffp-contract={'off' if ours else 'fast'}"
        assert (("-std=c99" in words), ("-std=gnu11" in words)) == (ours, not ours)


def test_two_builds_share_one_cmake_project(tmp_path: Path) -> None:
    """One of them is outside the project."""
    lists = CMAKE_HELLO + "add_subdirectory(ars)\nadd_subdirectory(../rws build-of-rws)\n"
    lists += "target_link_libraries(hello PRIVATE ars::ars rws::rws)\n"
    write_folder(made("rws"), tmp_path / "rws")
    folder = project(tmp_path / "two of them", {"CMakeLists.txt": lists, "main.c": BOTH_MAIN}, "ars")
    done(run([cmake(folder) / "hello"], folder))


def test_two_builds_of_one_prefix_are_refused_with_the_remedy(tmp_path: Path) -> None:
    lists = CMAKE_HELLO + "add_subdirectory(ars)\nadd_subdirectory(rws)\n"
    folder = project(tmp_path / "ecu", {"CMakeLists.txt": lists, "main.c": SELFTEST_MAIN}, "ars")
    shutil.copytree(folder / "ars", folder / "rws")
    result = run(["cmake", "-G", "Unix Makefiles", "-S", folder, "-B", folder / "made"], folder)
    assert result.returncode != 0
    assert "build one of the two with another --prefix" in " ".join(result.stderr.split())


# Zephyr's functions as documented (cmake/modules/extensions.cmake), in plain CMake.
ZEPHYR_CMAKE = """cmake_minimum_required(VERSION 3.20)
project(zephyr_application LANGUAGES C)
add_executable(app main.c)
macro(zephyr_include_directories)
  include_directories(${ARGN})
  target_include_directories(app PRIVATE ${ARGN})
endmacro()
macro(zephyr_library_named name)
  set(ZEPHYR_CURRENT_LIBRARY ${name})
  add_library(${name} STATIC "")
  target_link_libraries(app PRIVATE ${name} m)
endmacro()
macro(zephyr_library_sources)
  target_sources(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${ARGN})
endmacro()
macro(zephyr_library_sources_ifdef feature)
  if(${${feature}})
    zephyr_library_sources(${ARGN})
  endif()
endmacro()
macro(zephyr_library_compile_options)
  target_compile_options(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${ARGN})
endmacro()
add_subdirectory(ars/zephyr module-ars)
add_subdirectory(rws/zephyr module-rws)
"""


def test_the_cmake_of_the_zephyr_module_compiles_and_links(tmp_path: Path) -> None:
    """Both modules, one of them with the dynamics; a disabled module adds nothing."""
    on = ["-DCONFIG_ARS_REAR_STEERING=y", "-DCONFIG_RWS_REAR_STEERING=y", "-DCONFIG_ARS_REAR_STEERING_DYNAMICS=y"]
    folder = project(tmp_path / "an application", {"CMakeLists.txt": ZEPHYR_CMAKE, "main.c": BOTH_MAIN}, "ars", "rws")
    at = cmake(folder, *on)
    done(run([at / "app"], folder))
    assert {name for name in check_contraction(at) if "dynamics" in name} == {"ars_dynamics.c"}
    files = {"CMakeLists.txt": ZEPHYR_CMAKE, "main.c": "int main(void) { return 0; }\n"}
    assert check_contraction(cmake(project(tmp_path / "off", files, "ars", "rws"))) == {"main.c"}

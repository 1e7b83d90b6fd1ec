"""The section macros of the generated code: the linker can place every function and object."""

import subprocess
from pathlib import Path

from elftools.elf.elffile import ELFFile

from codegen.emit.write import write_folder
from codegen.optimum.solve import solve_case
from codegen.sil.toolchain import compiler_command
from tests import builds

KINDS = {"CODE": ".mine.code", "CONST": ".mine.const", "CALIBRATION": ".mine.calibration", "STATE": ".mine.state"}


def placed(source: Path, folder: Path, level: str, out: Path) -> dict[str, set[str]]:
    """Return the names of functions and objects by section."""
    macros = [f'-DARS_SECTION_{kind}=__attribute__((section("{name}")))' for kind, name in KINDS.items()]
    command = [*compiler_command(), "-std=c99", level, *macros, f"-I{folder / 'include'}", "-c", str(source), "-o", str(out)]
    subprocess.run(command, check=True, capture_output=True)
    found: dict[str, set[str]] = {}
    with out.open("rb") as file:
        elf = ELFFile(file)
        for symbol in elf.get_section_by_name(".symtab").iter_symbols():
            if symbol["st_info"]["type"] in ("STT_FUNC", "STT_OBJECT") and symbol["st_shndx"] != "SHN_UNDEF":
                found.setdefault(elf.get_section(symbol["st_shndx"]).name, set()).add(symbol.name)
    return found


def test_every_function_and_object_has_the_section_of_its_kind(tmp_path: Path) -> None:
    # Breakpoints in memory too.
    grid = builds.CONFIG.grid.model_copy(update={"speed_breakpoints_km_h": [20.0, 30.0, 50.0, 120.0], "front_angle_points": 10})
    config = builds.CONFIG.model_copy(update={"grid": grid})
    sources, found = tmp_path / "build", {}
    write_folder(builds.render(solve_case(config, "4ws-2"), config), sources)
    for level in ("-O2", "-O0"):
        for name in ("calibration", "map", "controller", "dynamics"):
            found[name] = placed(sources / f"src/ars_{name}.c", sources, level, tmp_path / "object.o")
            assert set(found[name]) <= set(KINDS.values()), (name, found[name])
    # Static ones are numbered.
    table = {kind: {name.partition(".")[0] for name in names} for kind, names in found["map"].items()}
    assert {"ars_map_yaw_rate", "interpolate"} <= table[KINDS["CODE"]]
    assert KINDS["CALIBRATION"] not in table
    assert "sampling_time" in {name.partition(".")[0] for name in found["controller"][KINDS["CONST"]]}
    map_names = {f"ars_map_{each}" for each in ("speed_breakpoints", "front_angle_breakpoints", "yaw_rate_table")}
    assert found["calibration"] == {
        KINDS["CALIBRATION"]: {"ars_parameters_default", "ars_epk", "ars_calibration_expected_checksum", *map_names},
        KINDS["CONST"]: {"ars_constants"},
    }
    example = placed(sources / "example/example_main.c", sources, "-O0", tmp_path / "example.o")
    assert example[KINDS["STATE"]] == {"controller"}

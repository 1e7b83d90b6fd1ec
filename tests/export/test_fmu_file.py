"""The file: the same bytes, what its description says, sources that stand on their own, and the command that writes it."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fmpy.validation import validate_fmu

from codegen import cli
from codegen.emit.from_files import prepare
from codegen.emit.units import unit_of_comment
from codegen.emit.write import write_folder
from codegen.errors import CodegenError
from codegen.export.fmu import standard
from codegen.export.fmu.export import make_fmu
from codegen.export.fmu.standard import Version
from codegen.export.fmu.variables import What
from codegen.sil.closed_loop import ClosedLoop
from codegen.sil.software import RECORD_COLUMNS, Status, load
from codegen.sil.toolchain import compiler_command
from tests.export import fmus
from tests.export.fmus import BUILDS, OUTPUTS, STEP, Made, Slave

Maker = Callable[[str, What, Version], Made]

HERE = Path(__file__).parent
each_version = pytest.mark.parametrize("version", ["2", "3"])
each_what = pytest.mark.parametrize("what", ["controller", "plant", "loop"])


def text_of(made: Made, path: str = "modelDescription.xml") -> str:
    return (made.folder / path).read_text(encoding="utf-8")


def listed_sources(made: Made) -> list[str]:
    """The C files that the FMU tells a simulator to compile."""
    if made.version == "2":
        return [element.attrib["name"] for element in ET.fromstring(text_of(made)).iter("File")]
    description = ET.fromstring(text_of(made, "sources/buildDescription.xml"))
    return [element.attrib["name"] for element in description.iter("SourceFile")]


@each_version
@each_what
def test_the_same_bytes_twice(
    made: Maker, what: What, version: Version, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "another place"
    shutil.copytree(BUILDS["pi"], elsewhere)
    (tmp_path / "scratch").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "scratch"))
    monkeypatch.setattr("tempfile.tempdir", None)  # read again
    again = make_fmu(elsewhere, what, version)
    assert again.content == made("pi", what, version).path.read_bytes()


@each_version
def test_nothing_in_it_tells_time_or_place(made: Maker, version: Version) -> None:
    known = made("tracking", "loop", version)
    with zipfile.ZipFile(known.path) as archive:
        entries = archive.infolist()
        assert {entry.date_time for entry in entries} == {(1980, 1, 1, 0, 0, 0)}
        assert entries[0].filename == "modelDescription.xml"
        for entry in entries:
            content = archive.read(entry)
            for word in (b"/home", b"/tmp", b"/usr", b"generationDate", str(fmus.ROOT).encode()):
                assert word not in content, entry.filename


def test_each_fmu_has_its_own_token(made: Maker) -> None:
    tokens = {
        made(kind, what, version).fmu.token
        for kind in BUILDS
        for what in ("controller", "plant", "loop")
        for version in ("2", "3")
    }
    # Both builds have the same car, and their plants differ by name.
    assert len(tokens) == 12
    assert all(re.fullmatch("[0-9a-f]{64}", token) for token in tokens)


def test_the_token_follows_the_sources(made: Maker, tmp_path: Path) -> None:
    edited = tmp_path / "edited"
    shutil.copytree(BUILDS["pi"], edited)
    source = edited / "src" / "ars_controller.c"
    source.write_text(source.read_text(encoding="ascii") + "/* edited */\n", encoding="ascii")
    changed = make_fmu(edited, "controller", "2")
    assert changed.token != made("pi", "controller", "2").fmu.token
    assert changed.edited == ("src/ars_controller.c",)


@each_version
def test_the_binary_lies_where_this_machine_looks_for_it(made: Maker, version: Version) -> None:
    import fmpy

    known = made("pi", "plant", version)
    folder = fmpy.platform if version == "2" else fmpy.platform_tuple
    library = known.folder / "binaries" / folder / f"{known.fmu.identifier}{fmpy.sharedLibraryExtension}"
    assert library.is_file()
    assert [path.name for path in (known.folder / "binaries").iterdir()] == [folder]


@each_version
def test_the_licence_of_the_standards_headers_goes_along(made: Maker, version: Version) -> None:
    licence = text_of(made("pi", "plant", version), "documentation/licenses/fmi-headers.txt")
    assert "2-Clause BSD License" in licence
    assert "Modelica Association" in licence
    assert licence.rstrip().endswith("ADVISED OF THE POSSIBILITY OF SUCH DAMAGE.")
    for name in standard.headers(version):
        assert name in licence.splitlines()[0]


# ---- what the description says ----


@each_version
def test_the_columns_of_a_run_are_variables_of_the_loop(made: Maker, version: Version) -> None:
    description = made("tracking", "loop", version).description
    variables = {variable.name: variable for variable in description.modelVariables}
    assert set(RECORD_COLUMNS) <= set(variables)
    units = {"_m_s2": "m/s2", "_rad_s": "rad/s", "_m_s": "m/s", "_rad": "rad", "time_s": "s"}
    for name in RECORD_COLUMNS:
        ending = next((unit for end, unit in units.items() if name.endswith(end)), None)
        assert variables[name].unit == ending
        assert variables[name].causality == ("output" if name in OUTPUTS else variables[name].causality)


@each_version
@each_what
def test_every_variable_is_described(made: Maker, what: What, version: Version) -> None:
    description = made("tracking", what, version).description
    for variable in description.modelVariables:
        assert variable.description, variable.name
        if variable.causality in ("input", "parameter"):
            assert variable.start is not None
        shown = {"rad": "deg", "rad/s": "deg/s", "m/s": "km/h"}.get(variable.unit)
        assert variable.displayUnit == shown
    for unit in description.unitDefinitions:
        assert unit.baseUnit is not None
    factors = {shown.name: shown.factor for unit in description.unitDefinitions for shown in unit.displayUnits}
    assert factors == pytest.approx({"km/h": 3.6, "deg": 180.0 / np.pi, "deg/s": 180.0 / np.pi}, rel=1e-15)


@each_version
@pytest.mark.parametrize("kind", list(BUILDS))
def test_every_parameter_starts_at_the_value_of_the_build(made: Maker, kind: str, version: Version) -> None:
    slave, software = Slave(made(kind, "controller", version)), fmus.software(kind)

    def numbers(value: object, name: str) -> dict[str, float]:
        if isinstance(value, float | int):
            return {name: float(value)}
        kind_of = software.ffi.typeof(value)
        if kind_of.kind == "array":
            return {f"{name}[{k + 1}]": float(value[k]) for k in range(len(value))}
        return {k: v for field, _ in kind_of.fields for k, v in numbers(getattr(value, field), f"{name}.{field}").items()}

    wanted = numbers(software.function("parameters_default"), "parameters")
    described = {v.name: v for v in slave.made.description.modelVariables if v.name.startswith("parameters.")}
    assert set(described) == set(wanted)
    for name, value in wanted.items():
        assert slave.get(name) == value
        before, start = value, float(described[name].start)
        slave.set({name: start})  # the text of the description reads back to the same bits
        assert slave.get(name) == before
        if described[name].min is not None:
            assert float(described[name].min) <= start <= float(described[name].max)
    ranged = [name for name, variable in described.items() if variable.min is not None]
    assert len(ranged) == len(described)
    slave.close()


@each_version
def test_the_status_is_an_enumeration_of_the_c(made: Maker, version: Version) -> None:
    description = made("pi", "controller", version).description
    status = next(variable for variable in description.modelVariables if variable.name == "status")
    assert status.type == "Enumeration"
    items = {item.name: int(item.value) for item in status.declaredType.items}
    assert items == {state.name: state.value for state in Status}
    assert all(item.description for item in status.declaredType.items)


@each_version
def test_the_plant_says_what_follows_at_once(made: Maker, version: Version) -> None:
    structure = {
        unknown.variable.name: {variable.name for variable in unknown.dependencies}
        for unknown in made("pi", "plant", version).description.outputs
    }
    # No output follows the rear command or the steering wheel without a step in between: no algebraic loop with a controller.
    assert structure["yaw_rate_rad_s"] == structure["rear_angle_rad"] == structure["front_angle_rad"] == set()
    assert structure["lateral_acceleration_m_s2"] == {"speed_m_s", "friction"}
    assert structure["sideslip_rad"] == {"speed_m_s"}
    slave = Slave(made("pi", "plant", version)).start({"speed_m_s": 20.0, "steering_wheel_command_rad": 0.8})
    for _ in range(30):
        slave.step(0.01)
    for name in ("speed_m_s", "steering_wheel_command_rad", "friction", "yaw_moment_n_m", "rear_angle_command_rad"):
        before, value = slave.row(structure), slave.get(name)
        slave.set({name: value + 0.05})
        moved = {output for output, old, new in zip(structure, before, slave.row(structure), strict=True) if old != new}
        assert moved == {output for output, depends in structure.items() if name in depends}
    slave.close()


@pytest.mark.parametrize(
    ("comment", "unit"),
    [
        ("rad, bound on the command", "rad"),
        ("s: rad of rear angle for each rad/s of error", "s"),
        ("rad of rear angle for each rad of integrated error", ""),
        ("m/s^2 of missing lateral acceleration", "m/s^2"),
        ("rad/s beyond what speed and steering explain", "rad/s"),
        ("rad/s", "rad/s"),
        ("1/s, how fast", "1/s"),
        ("samples that an implausible yaw rate is held", ""),
        ("share of a new rate", ""),
        ("m, for the plausibility", "m"),
        ("", ""),
    ],
)
def test_units_in_comments(comment: str, unit: str) -> None:
    assert unit_of_comment(comment).symbol == unit


# ---- sources ----


def compiled_again(made: Made, folder: Path, *flags: str) -> Made:
    """The FMU with its binary made from its own list of sources, by a compiler and nothing else."""
    shutil.copytree(made.folder, folder)
    (library,) = (path for path in (folder / "binaries").rglob("*") if path.is_file())
    library.unlink()
    command = [*compiler_command(), *flags, "-fPIC", "-shared", *listed_sources(made), "-o", str(library), "-lm"]
    subprocess.run(command, cwd=folder / "sources", check=True)
    return replace(made, folder=folder)


@each_version
@pytest.mark.parametrize("kind", list(BUILDS))
def test_the_sources_compile_alone(made: Maker, kind: str, version: Version, tmp_path: Path) -> None:
    again = compiled_again(made(kind, "loop", version), tmp_path / "again", "-std=c99", "-O2", "-ffp-contract=off")
    slave = Slave(again).start()
    rows = fmus.inputs(kind, "sine-with-dwell")[:3000]
    assert np.array_equal(fmus.drive(slave, rows, STEP), ClosedLoop(fmus.software(kind)).run(rows)[:, RECORD_ORDER])
    slave.close()


RECORD_ORDER = [RECORD_COLUMNS.index(name) for name in OUTPUTS]


@each_version
@each_what
def test_the_sources_are_clean_c99(made: Maker, what: What, version: Version, tmp_path: Path) -> None:
    known = made("tracking", what, version)
    own = [name for name in listed_sources(known) if not name.startswith(("ars_", "plant"))]
    assert {"model.c", "instance.c", "variables.c", f"fmi{version}.c"} <= set(own)
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wno-strict-prototypes", "-Werror"]
    command = [*compiler_command(), *strict, "-fsyntax-only", *own]
    answer = subprocess.run(command, cwd=known.folder / "sources", capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="needs gcc's leak sanitizer")
@each_version
def test_a_simulator_that_does_everything_wrong(made: Maker, version: Version, tmp_path: Path) -> None:
    known = made("tracking", "loop", version)
    program = tmp_path / "misuse"
    sanitizers = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g", "-O1", "-std=c99", "-Wall", "-Werror"]
    sources = [*listed_sources(known), str(HERE / f"misuse_fmi{version}.c")]
    command = [*compiler_command(), *sanitizers, "-I.", *sources, "-o", str(program), "-lm"]
    built = subprocess.run(command, cwd=known.folder / "sources", capture_output=True, text=True, check=False)
    if built.returncode and "asan" in built.stderr:
        pytest.skip("the compiler has no address sanitizer")
    assert built.returncode == 0, built.stderr
    answer = subprocess.run([program, known.fmu.token], capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr


def test_another_configuration(tmp_path: Path) -> None:
    """Double precision, another prefix, tyres with a relaxation length, and a command that acts two samples later."""
    settings = tmp_path / "ars.toml"
    kind = '[controller]\nkind = "pi"\n'
    settings.write_text(f"{kind}[plant]\ncommand_delay_samples = 2\nrelaxation_length_m = 0.3\n", encoding="utf-8")
    build = tmp_path / "build"
    prepared = prepare(fmus.ROOT / "generated" / "4ws2.npz", settings, build, "rear", "double")
    write_folder(prepared.folder, build)
    known = fmus.pack_at(tmp_path, "other", make_fmu(build, "loop", "3"))
    assert validate_fmu(str(known.path)) == []
    slave = Slave(known).start()
    rows = fmus.inputs("pi", "sine-with-dwell")
    wanted = ClosedLoop(load(build)).run(rows)
    assert np.array_equal(fmus.drive(slave, rows, STEP), wanted[:, RECORD_ORDER])
    assert not np.array_equal(wanted, fmus.recorded("pi", "sine-with-dwell"))
    slave.close()


# ---- the command ----


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[int, str, str]]:
    def command(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["codegen", "fmu", *(str(argument) for argument in arguments)])
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        seen = capsys.readouterr()
        assert isinstance(stopped.value.code, int)
        return stopped.value.code, seen.out, seen.err

    return command


def test_the_command_writes_the_file_and_tells_what_is_in_it(run: Callable[..., tuple[int, str, str]], tmp_path: Path) -> None:
    target = tmp_path / "car.fmu"
    code, out, err = run("--build", BUILDS["pi"], "--what", "plant", "--fmi", "3", "-o", target)
    assert (code, err) == (0, "")
    assert out.startswith(f"{target}: FMI 3.0 co-simulation, plant, for ")
    assert "5 inputs, 7 outputs, 0 parameters" in out
    assert validate_fmu(str(target)) == []
    before = target.read_bytes()
    code, out, _ = run("--build", BUILDS["pi"], "--what", "plant", "--fmi", "3", "-o", target, "--json")
    told = json.loads(out)
    assert (told["fmi"], told["what"], told["internal_step_s"], told["bytes"]) == ("3.0", "plant", 0.001, len(before))
    assert target.read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--build", BUILDS["pi"], "--what", "plant", "-o", "car.zip"), "only .fmu is written"),
        (("--build", BUILDS["pi"], "--what", "plant", "-o", "nowhere/car.fmu"), "its folder does not exist"),
        (("--build", BUILDS["pi"], "--what", "plant", "-o", BUILDS["pi"] / "car.fmu"), "it lies inside a build"),
        (("--build", "nothing", "--what", "plant", "-o", "car.fmu"), "there is no manifest.json"),
        (("--build", BUILDS["pi"], "--what", "car", "-o", "car.fmu"), "'car' is not one of"),
        (("--build", BUILDS["pi"], "--what", "plant", "--fmi", "1", "-o", "car.fmu"), "'1' is not one of"),
        (("--build", BUILDS["pi"], "-o", "car.fmu"), "Missing option '--what'"),
    ],
)
def test_bad_input_is_one_line(
    run: Callable[..., tuple[int, str, str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[object, ...],
    told: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert told in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_missing_fmpy_is_one_line(
    run: Callable[..., tuple[int, str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "fmpy" else there(name, *rest))
    code, _, err = run("--build", BUILDS["pi"], "--what", "plant", "-o", tmp_path / "car.fmu")
    assert code == 2
    assert err.rstrip().endswith('is missing; pip install "ars-codegen[tools]"')
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_c_that_does_not_compile_leaves_what_stood(run: Callable[..., tuple[int, str, str]], tmp_path: Path) -> None:
    edited, target = tmp_path / "edited", tmp_path / "old.fmu"
    target.write_bytes(b"old")
    shutil.copytree(BUILDS["pi"], edited)
    (edited / "src" / "ars_map.c").write_text("not C\n", encoding="ascii")
    code, _, err = run("--build", edited, "--what", "loop", "-o", target)
    assert code == 2
    assert "the C does not compile" in err
    assert target.read_bytes() == b"old"


def test_a_platform_without_a_name_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    from codegen.export.fmu import binary

    places = {
        ("linux", "x86_64"): ("linux64", "x86_64-linux", "so"),
        ("linux", "aarch64"): ("linux64", "aarch64-linux", "so"),
        ("darwin", "arm64"): ("darwin64", "aarch64-darwin", "dylib"),
    }
    for (system, machine), (second, third, ending) in places.items():
        monkeypatch.setattr("sys.platform", system)
        monkeypatch.setattr("platform.machine", lambda machine=machine: machine)
        assert binary.library_path("2", "car") == f"binaries/{second}/car.{ending}"
        assert binary.library_path("3", "car") == f"binaries/{third}/car.{ending}"
    monkeypatch.setattr("platform.machine", lambda: "riscv64")
    with pytest.raises(CodegenError, match="no FMU can be compiled here"):
        binary.library_path("2", "car")

"""The FMU file: reproducible bytes, its description, self-contained sources, and the command that writes it."""

import importlib.util
import json
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest

from codegen.emit.a2l_view import OF_THE_ANGLE
from codegen.emit.manifest import read_build
from codegen.emit.objects import Layout
from codegen.export.fmu.export import make_fmu
from codegen.export.fmu.variables import Version, What
from codegen.sil.closed_loop import ClosedLoop
from codegen.sil.software import RECORD_COLUMNS, Status
from codegen.sil.toolchain import compiler_command
from tests.cli.conftest import Answer, refused, run
from tests.export import fmus
from tests.export.fmus import BUILDS, OUTPUTS, STEP, Slave, listed_sources, made, text_of

__all__ = ["refused", "run"]  # fixtures

Run, Refused = Callable[..., Answer], Callable[..., str]

RECORD_ORDER = [RECORD_COLUMNS.index(name) for name in OUTPUTS]
WHATS: tuple[What, ...] = ("controller", "plant", "loop")
each_version = pytest.mark.parametrize("version", ["2", "3"])


def test_the_same_bytes_twice_and_a_token_that_follows_the_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    elsewhere = Path(shutil.copytree(BUILDS["tracking"], tmp_path / "another place"))
    (tmp_path / "scratch").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "scratch"))
    monkeypatch.setattr("tempfile.tempdir", None)  # evaluated again
    again = make_fmu(elsewhere, "controller", "2")
    assert again.content == made("controller", "2").fmu.content
    with (elsewhere / "src" / "ars_controller.c").open("a", encoding="ascii") as source:
        source.write("/* edited */\n")
    changed = make_fmu(elsewhere, "controller", "2")
    assert changed.edited == ("src/ars_controller.c",)
    assert len({changed.token, again.token, made("plant", "2").fmu.token}) == 3


@each_version
def test_the_archive_is_anonymous_and_has_the_required_content(version: Version) -> None:
    known = made("loop", version)
    with zipfile.ZipFile(known.path) as archive:
        entries = archive.infolist()
        assert {entry.date_time for entry in entries} == {(1980, 1, 1, 0, 0, 0)}
        for entry in entries:
            content = archive.read(entry)
            for word in (b"/home", b"/tmp", b"/usr", b"generationDate", str(fmus.ROOT).encode()):
                assert word not in content, entry.filename
    folder = fmpy.platform if version == "2" else fmpy.platform_tuple
    binaries = [path.relative_to(known.folder).as_posix() for path in known.folder.glob("binaries/*/*")]
    assert binaries == [f"binaries/{folder}/{known.fmu.identifier}{fmpy.sharedLibraryExtension}"]
    assert "2-Clause BSD License" in text_of(known, "documentation/licenses/fmi-headers.txt")


# ---- the description ----


@each_version
def test_every_variable_is_described(version: Version) -> None:
    for what in WHATS:
        description = made(what, version).description
        for variable in description.modelVariables:
            assert variable.description, variable.name
            shown = {"rad": "deg", "rad/s": "deg/s", "m/s": "km/h"}.get(variable.unit)
            assert variable.displayUnit == shown
        factors = {shown.name: shown.factor for unit in description.unitDefinitions for shown in unit.displayUnits}
        assert factors == pytest.approx({"km/h": 3.6, "deg": 180.0 / np.pi, "deg/s": 180.0 / np.pi}, rel=1e-15)
    variables = {variable.name: variable for variable in description.modelVariables}
    items = {item.name: int(item.value) for item in variables["status"].declaredType.items}
    assert items == {state.name: state.value for state in Status}
    units = {"_m_s2": "m/s2", "_rad_s": "rad/s", "_m_s": "m/s", "_rad": "rad", "time_s": "s"}
    for name in RECORD_COLUMNS:  # the columns of a run are variables of the loop
        assert variables[name].unit == next((unit for end, unit in units.items() if name.endswith(end)), None)
        assert (variables[name].causality == "output") == (name in OUTPUTS)


@each_version
def test_every_parameter_starts_at_the_value_of_the_build(version: Version) -> None:
    slave, software = Slave(made("controller", version)), fmus.software("tracking")

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
        slave.set({name: float(described[name].start)})  # the text of the description reads back to the same bits
        assert slave.get(name) == value


@each_version
def test_descriptions_and_ranges_of_parameters_are_those_of_the_a2l(version: Version) -> None:
    default = "ars_parameters_default."
    of_the_a2l = {
        each.link.removeprefix(default): (each.meaning, each.low, each.high)
        for each in Layout.of(read_build(BUILDS["tracking"])).objects.values()
        # The A2L bounds two of the limiter by rear_angle_max. An FMU takes any count; the C rejects it in the next step.
        if each.link.startswith(default)
        and each.link.removeprefix(f"{default}limiter.") not in OF_THE_ANGLE
        and each.stored != "u2"
    }
    variables = {
        variable.name.removeprefix("parameters.").partition("[")[0]: variable
        for variable in made("controller", version).description.modelVariables
    }
    assert len(of_the_a2l) > 50
    for name, expected in of_the_a2l.items():
        found = variables[name]
        assert (found.description, float(found.min), float(found.max)) == expected, name


@each_version
def test_the_plant_lists_its_direct_dependencies(version: Version) -> None:
    structure = {
        unknown.variable.name: {variable.name for variable in unknown.dependencies}
        for unknown in made("plant", version).description.outputs
    }
    # No output depends directly on the rear command or the steering wheel: no algebraic loop with a controller.
    assert set().union(*structure.values()) == {"speed_m_s", "friction"}
    slave = Slave(made("plant", version)).start({"speed_m_s": 20.0, "steering_wheel_command_rad": 0.8})
    slave.step(0.3)
    for name in ("speed_m_s", "steering_wheel_command_rad", "friction", "yaw_moment_n_m", "rear_angle_command_rad"):
        before = slave.row(structure)
        slave.set({name: slave.get(name) + 0.05})
        moved = {output for output, old, new in zip(structure, before, slave.row(structure), strict=True) if old != new}
        assert moved == {output for output, depends in structure.items() if name in depends}


# ---- sources ----


@each_version
def test_the_sources_compile_alone(version: Version, tmp_path: Path) -> None:
    """The binary is made from the FMU's own list of sources with a plain compiler."""
    known, again = made("loop", version), tmp_path / "again"
    shutil.copytree(known.folder, again)
    (library,) = (path for path in (again / "binaries").rglob("*") if path.is_file())
    library.unlink()
    flags = ("-std=c99", "-O1", "-ffp-contract=off", "-fPIC", "-shared")
    command = [*compiler_command(), *flags, *listed_sources(known), "-o", str(library), "-lm"]
    subprocess.run(command, cwd=again / "sources", check=True)
    rows = fmus.inputs("tracking", "sine-with-dwell")[:3000]
    driven = fmus.drive(Slave(replace(known, folder=again)).start(), rows, STEP)
    assert np.array_equal(driven, ClosedLoop(fmus.software("tracking")).run(rows)[:, RECORD_ORDER])


# ---- the command ----


def test_the_command_writes_the_file_and_reports_it(run: Run, tmp_path: Path) -> None:
    target = tmp_path / "car.fmu"
    answer = run("fmu", "--build", BUILDS["pi"], "--what", "plant", "--fmi", "3", "-o", target, "--json")
    assert (answer.code, answer.err) == (0, "")
    facts = json.loads(answer.out)
    assert (facts["fmi"], facts["what"], facts["internal_step_s"]) == ("3.0", "plant", 0.001)
    assert facts["bytes"] == len(target.read_bytes())


def test_a_bus_needs_fmi_3(run: Run, refused: Refused, tmp_path: Path) -> None:
    ecu = ("fmu", "--build", BUILDS["pi"], "--what", "ecu", "-o", tmp_path / "ecu.fmu")
    facts = json.loads(run(*ecu, "--json").out)
    assert (facts["what"], facts["fmi"], facts["bus"], facts["internal_step_s"]) == ("ecu", "3.0", True, 0.001)
    assert "needs the clocks of FMI 3.0" in refused(*ecu, "--fmi", "2")
    car = ("fmu", "--build", BUILDS["pi"], "--bus", "-o", "car.fmu")
    assert "controller has no bus" in refused(*car, "--what", "controller")
    assert "needs the clocks of FMI 3.0" in refused(*car, "--what", "plant", "--fmi", "2")


def test_bad_input_is_one_line(refused: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plant = ("fmu", "--build", BUILDS["pi"], "--what", "plant", "-o")
    assert "only .fmu is written" in refused(*plant, "car.zip")
    assert "it lies inside a build" in refused(*plant, BUILDS["pi"] / "car.fmu")
    edited = Path(shutil.copytree(BUILDS["pi"], tmp_path / "edited"))
    (edited / "src" / "ars_map.c").write_text("not C\n", encoding="ascii")
    (tmp_path / "old.fmu").write_bytes(b"old")
    assert "the C does not compile" in refused("fmu", "--build", edited, "--what", "loop", "-o", "old.fmu")
    there = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "fmpy" else there(name, *rest))
    assert refused(*plant, "car.fmu").endswith('is missing; pip install "fmpy>=0.3.32,<0.4"')

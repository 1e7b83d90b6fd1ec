"""Calibration data: exact round trips, independent readers, the checks of the C, and images."""

import functools
import math
import os
import re
import struct
import subprocess
import tomllib
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import bincopy
import numpy as np
import pytest
from dcmReader.dcm_reader import DcmReader
from matplotlib.axes import Axes

from codegen import configuration
from codegen.emit.controller_view import controller_parameters
from codegen.emit.folder import Folder, read_manifest
from codegen.emit.inputs_view import inputs_parameters
from codegen.emit.limiter_view import limiter_parameters
from codegen.emit.objects import Values
from codegen.errors import BuildError, CodegenError
from codegen.export.calibration.build import BuildCalibration
from codegen.export.calibration.convert import map_of, toml_of
from codegen.export.calibration.images import Image
from codegen.export.calibration.labels import number_text
from codegen.export.calibration.sets import CALIBRATION_READERS, merged, read_set
from codegen.figures.draw import draw
from codegen.report.calibration_plots import ValueChange, calibration_picture
from codegen.units import KM_H
from codegen.verify.target import CORTEX_M4F, POWERPC_BE, Core, Processor, compile_image
from tests import builds, shared
from tests.calibrations import addressed, records_of
from tests.cli.conftest import Answer, refused, run
from tests.export.test_a2l import compiled
from tests.hostile_files import HOSTILE
from tests.sil.case import named
from tests.sil.library import Compiler

__all__ = ["refused", "run"]  # fixtures

Run, Refused = Callable[..., Answer], Callable[..., str]

GENERATED = Path(__file__).resolve().parents[2] / "generated"
BUILD = GENERATED / "4ws2"
FORMATS = sorted(CALIBRATION_READERS)
SLOW, GAIN = "ars.parameters.slow_speed", "ars.parameters.integral_gain"


def _int16() -> Folder:
    """Return a build whose tables are stored as int16."""
    scratch = shared.folder() / f"int16 {os.getpid()}"
    return named("tracking uneven with int16", scratch, Compiler(())).built.folder


def _uneven_stack() -> Folder:
    return builds.render(builds.MAPS["stack of two, uneven"](), builds.CONFIGS["tracking"])


BUILDS: dict[str, Callable[[], Path]] = {
    "4ws2": lambda: BUILD,
    "4ws2-paper": lambda: GENERATED / "4ws2-paper",
    "tracking, double": lambda: shared.build_folder("tracking", "double"),
    "int16": lambda: shared.written("calibration int16", _int16),
    "uneven stack": lambda: shared.written("calibration uneven stack", _uneven_stack),
}
"""Two kinds, both precisions, scaled storage, uneven axes and a stack. tests/evidence/kinds has the other kinds."""


@functools.cache
def loaded(name: str = "4ws2") -> BuildCalibration:
    """Return the calibration of one of BUILDS, or of a kind of controller."""
    return BuildCalibration.load(BUILDS[name]() if name in BUILDS else shared.build_folder(name))  # type: ignore[arg-type]


def changed(**changes: Any) -> Values:
    """Return the values of the build with others: "parameters__slow_speed" -> ars.parameters.slow_speed."""
    values = dict(loaded().values)
    for key, value in changes.items():
        name = f"ars.{key.replace('__', '.')}"
        values[name] = np.asarray(value, dtype=values[name].dtype).reshape(values[name].shape)
    return values


def write(values: Values, path: Path, name: str = "4ws2") -> Path:
    path.write_bytes(CALIBRATION_READERS[path.suffix].write(values, loaded(name).layout, "test"))
    return path


@functools.cache
def another(build: BuildCalibration) -> Values:
    """Return other valid values for each object: scaled down by a number without a short decimal, within the limits."""
    values = dict(build.values)
    for each in build.layout.objects.values():
        if each.dtype.kind == "f":
            scaled = np.clip(values[each.name] * each.dtype.type(1 - 1 / 4099), each.low, each.high).astype(each.dtype)
            trial = {**values, each.name: each.physical_values(each.raw(scaled))}
            try:
                build.check(trial, {})
            except CodegenError:
                continue  # it is tied to others
            values = trial
    return values


# --- files --------------------------------------------------------------------------------------------------------------


def check_round_trip(name: str, folder: Path) -> None:
    """Check that every value returns from both formats with the same bits."""
    build = loaded(name)
    values = another(build)
    differing = [each for each in build.values if not np.array_equal(values[each], build.values[each])]
    assert len(differing) > 0.7 * len(values)
    for suffix in FORMATS:
        found = read_set(write(values, folder / f"set{suffix}", name), build.layout)
        assert found.keys() == values.keys() == build.layout.objects.keys()
        for each, numbers in found.items():
            assert (numbers.dtype, numbers.shape) == (values[each].dtype, values[each].shape), each
            assert numbers.tobytes() == values[each].tobytes(), each


@pytest.mark.parametrize("name", BUILDS)
def test_every_value_returns_from_both_formats_with_the_same_bits(name: str, tmp_path: Path) -> None:
    check_round_trip(name, tmp_path)


def test_the_values_are_those_of_the_c_source() -> None:
    """Read from the text of the C."""
    text = (BUILD / "src" / "ars_calibration.c").read_text(encoding="ascii")
    for name, pattern in {
        "ars.parameters.grip_loss_rate": r"\.grip_loss_rate = ([^,]*)",
        SLOW: r"\.slow_speed = ([^,]*)",
    }.items():
        found = re.search(pattern, text)
        assert found and np.float32(found[1].rstrip("f")) == loaded().values[name]
    block = text.partition("ars_map_yaw_rate_table[")[2].partition("};")[0].partition("= {")[2]
    numbers = re.findall(r"(?<![\w.])-?\d+\.\d+(?:e[-+]\d+)?(?=f)", re.sub(r"/\*.*?\*/", "", block))
    assert np.array_equal(np.array(numbers, dtype=np.float32), loaded().values["ars.map.yaw_rate"].ravel())


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_the_text_of_a_number_is_exact(precision: Any) -> None:
    rng = np.random.default_rng(2)
    numbers = (rng.uniform(-1, 1, 2000) * 10.0 ** rng.integers(-30, 30, 2000)).astype(precision)
    special = np.array(
        [0.0, -0.0, 1.0, 1e-5, 9.9999e-6, 1e15, 1e16, np.finfo(precision).max, np.finfo(precision).tiny], precision
    )
    for number in (*numbers, *special):
        text = number_text(number)
        assert precision(text).tobytes() == number.tobytes(), text
        assert len(text) < 28


def test_an_independent_reader_reads_the_dcm(tmp_path: Path) -> None:
    """dcmReader has its own parser: same names, units, axes and numbers."""
    reader, build = DcmReader(), loaded()
    values = another(build)
    reader.read(str(write(values, tmp_path / "set.dcm")))
    objects, seen = build.layout.objects, set[str]()

    def check(name: str, numbers: Any, unit: str) -> None:
        seen.add(name)
        assert unit == objects[name].unit
        assert np.array_equal(np.array(numbers, dtype=values[name].dtype), values[name]), name

    for each in reader.get_parameters():
        check(each.name, each.value, each.unit)
    for each in reader.get_distributions():
        check(each.name, each.values, each.unit_x)
    for each in reader.get_group_characteristic_lines():
        assert each.x_mapping == objects[each.name].axes[0]
        check(each.x_mapping, list(each.values), each.unit_x)
        check(each.name, list(each.values.values()), each.unit_values)
    for each in reader.get_group_characteristic_maps():
        assert (each.x_mapping, each.y_mapping) == objects[each.name].axes
        rows = list(each.values.values())
        check(each.x_mapping, list(rows[0]), each.unit_x)
        check(each.y_mapping, list(each.values), each.unit_y)
        check(each.name, [list(row.values()) for row in rows], each.unit_values)
    assert seen == objects.keys()


# --- rejections ---------------------------------------------------------------------------------------------------------


def rejection(values: Values, path: Path) -> str:
    build = loaded()
    with pytest.raises(CodegenError) as caught:
        merged(build, build.values, "build", [write(values, path)])
    return str(caught.value)


@pytest.mark.parametrize("suffix", FORMATS)
def test_the_build_rejects_what_its_c_rejects_by_name(suffix: str, tmp_path: Path) -> None:
    path, axis = tmp_path / f"set{suffix}", loaded().values["ars.map.speed"].copy()
    axis[40] += 0.1  # no longer even
    falling = loaded().values["ars.parameters.schedule_speed"].copy()
    falling[3] = falling[2]
    for changes, words in {
        ("parameters__slow_speed", 60.0): f"{path}: {SLOW}: 60 is outside 0.5555556 to 13.888889 m/s",
        ("parameters__slow_speed", 10.0): f"{path}: {SLOW}: 10 conflicts with other values: ars_parameters_valid()",
        ("inputs__speed_max", 20.0): f"{path}: ars.inputs.speed_max: 20 conflicts with other values",
    }.items():
        assert words in rejection(changed(**{changes[0]: changes[1]}), path)
    assert "it requires slow_speed <= " in rejection(changed(parameters__slow_speed=10.0), path)
    assert f"{path}: ars.map.speed: one of its 119 values conflicts" in rejection(changed(map__speed=axis), path)
    line = rejection(changed(parameters__schedule_speed=falling), path)
    assert f"{path}: ars.parameters.schedule_speed: breakpoint 3 (8.33333302 m/s) is not above" in line


def test_ranges_are_those_of_the_c() -> None:
    """Each limit is valid in C, or conflicts with other values; the next number beyond is rejected by the C alone too."""
    build = loaded()
    for each in build.layout.objects.values():
        if each.kind != "VALUE" or each.dtype.kind != "f":
            continue
        for limit, beyond in ((each.low, -math.inf), (each.high, math.inf)):
            number = np.nextafter(each.dtype.type(limit), each.dtype.type(beyond))
            with build._written({**build.values, each.name: number}):
                assert not build._is_valid(), each.name


SCHEDULE = read_manifest(BUILD)["configuration"]["controller"]["tracking"]["schedule"]
POINTS, LAST = len(SCHEDULE["speed_km_h"]), " ".join(str(np.float32(speed * KM_H)) for speed in SCHEDULE["speed_km_h"][-2:])
"""Breakpoints of the schedule, and the last two as a file has them."""

DAMAGES: dict[str, tuple[str, str, str, str]] = {
    "name": (
        ".dcm",
        SLOW,
        "ars.parameters.disable_sped",
        "does not have it; remove it, or give the build that has it; did you",
    ),
    "two numbers": (".dcm", f"FESTWERT {SLOW}\n", f"FESTWERT {SLOW}\n WERT 2\n", f"2 numbers for {SLOW}, which has 1"),
    "word": (".dcm", "0.48658288", "nan", "'nan' is not a number"),
    "missing number": (
        ".dcm",
        f"{LAST}\nEND",
        f"{LAST.split()[0]}\nEND",
        f"{POINTS - 1} numbers for ars.parameters.schedule_speed, which has {POINTS}",
    ),
    "fraction": (".dcm", "WERT 73\n", "WERT 73.5\n", "not whole numbers from 0 to 65535"),
    "no END": (".dcm", "END\n\nFESTWERT ars.limiter.rear_rate_max", "\nFESTWERT ars.limiter.rear_rate_max", "has no END"),
    "no END of another's": (
        ".dcm",
        "FORMAT 2.0\n",
        "FORMAT 2.0\nFESTWERT other.value\n  TEXT abc\n",
        "FESTWERT other.value has no END",
    ),
    "unit": (
        ".dcm",
        'full from twice it"\n   EINHEIT_W "m/s"',
        'full from twice it"\n   EINHEIT_W "km/h"',
        "in km/h in the file, in m/s in the",
    ),
    "unit of an axis": (
        ".dcm",
        'yaw-rate error"\n   EINHEIT_X "m/s"',
        'yaw-rate error"\n   EINHEIT_X "km/h"',
        "breakpoints of ars.parameters.schedule_speed in km/h in the file, in m/s in the build",
    ),
    "size": (".dcm", f"KENNLINIE {GAIN} {POINTS}", f"KENNLINIE {GAIN} 2", f"size 2 in the file, {POINTS} in the build"),
    "keyword": (".dcm", "FESTWERT ars.limiter.speed_max", "KENNWERT ars.limiter.speed_max", "unknown keyword KENNWERT"),
    "kind": (".dcm", "FESTWERT ars.limiter.speed_max", "KENNLINIE ars.limiter.speed_max 1", "a curve in the file, a value in"),
    "format": (".dcm", "KONSERVIERUNG_FORMAT 2.0", "KONSERVIERUNG_FORMAT 1.0", "does not begin with KONSERVIERUNG_FORMAT 2.0"),
    "unit in CDF": (
        ".cdfx",
        ">m/s</UNIT-DISPLAY-NAME>\n              <SW-VALUES-PHYS>\n                <V>2.0833333<",
        ">km/h</UNIT-DISPLAY-NAME>\n              <SW-VALUES-PHYS>\n                <V>2.0833333<",
        "in km/h in the file, in m/s in the",
    ),
    "entity": (".cdfx", '.dtd">', '.dtd" [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]>', "declares an entity"),
    "end": (".cdfx", "</SW-SYSTEMS>", "</SW-SYSTEM>", "not well-formed XML"),
    "category": (".cdfx", "<CATEGORY>CDF20</CATEGORY>", "<CATEGORY>MDX</CATEGORY>", "no MSRSW of category CDF20"),
    "number": (".cdfx", "<V>0.48658288</V>", "<V>1e999</V>", "inf is outside 0.01 to 1"),
}
"""Suffix, text that occurs once, its replacement, and words of the message."""


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_rejected_with_its_place(damage: str, tmp_path: Path) -> None:
    suffix, old, new, words = DAMAGES[damage]
    path, build = write(loaded().values, tmp_path / f"set{suffix}"), loaded()
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(CodegenError) as caught:
        merged(build, build.values, "build", [path])
    assert str(path) in str(caught.value) and words in str(caught.value)


def test_files_of_other_tools_are_read(tmp_path: Path) -> None:
    """Blocks of other software, comments, Latin-1, variants of CDF, and an axis that is only inside its curve."""
    points = " ".join(map(number_text, loaded().values["ars.parameters.schedule_speed"]))
    dcm = f"""* Kommentar
KONSERVIERUNG_FORMAT 2.0
MODULKOPF "a"
FUNKTIONEN
  FKT f "1.0" "END of it"
END
TEXTSTRING other
  TEXT "°C"
END
FESTWERT other.value
  EINHEIT_W "°C"
  WERT abc
END
FESTWERT other.mode
  TEXT "on"
END
KENNLINIE other.curve
  ST_TX/X "a" "b"
  WERT 1 2
END
FESTWERT {SLOW}
  LANGNAME "a ""b"" c"
  EINHEIT_W ""
  VAR a=1
  WERT 3.25
END
KENNLINIE {GAIN} {POINTS}
  EINHEIT_X "m/s"
  ST/X {points}
  WERT {" ".join(["0.5"] * POINTS)}
END
"""
    (tmp_path / "set.dcm").write_bytes(dcm.encode("latin-1"))
    found = read_set(tmp_path / "set.dcm", loaded().layout)
    assert found.keys() == {SLOW, GAIN, "ars.parameters.schedule_speed"}
    assert found[SLOW] == np.float32(3.25) and (found[GAIN] == np.float32(0.5)).all()
    value = f"<SHORT-NAME>{SLOW}</SHORT-NAME><CATEGORY>VALUE</CATEGORY>"
    held = "<SW-VALUE-CONT><SW-VALUES-PHYS><V>3.2500000000000000</V></SW-VALUES-PHYS></SW-VALUE-CONT>"
    variant = "SW-INSTANCE-PROPS-VARIANT"
    for content in (held, f"<{variant}S><{variant}>{held}</{variant}></{variant}S>"):
        others = f"<SW-INSTANCE>{value.replace(SLOW, 'other.value')}</SW-INSTANCE>"
        tree = f"<SW-INSTANCE-TREE>{others}<SW-INSTANCE>{value}{content}</SW-INSTANCE></SW-INSTANCE-TREE>"
        inside = f"<SW-INSTANCE-SPEC>{tree}</SW-INSTANCE-SPEC>"
        text = f"<MSRSW><CATEGORY>CDF20</CATEGORY><SW-SYSTEMS><SW-SYSTEM>{inside}</SW-SYSTEM></SW-SYSTEMS></MSRSW>"
        (tmp_path / "set.cdfx").write_text(text)
        assert read_set(tmp_path / "set.cdfx", loaded().layout) == {SLOW: np.float32(3.25)}


@pytest.mark.parametrize(("category", "text"), [("BOOLEAN", "<VT>true</VT>"), ("DEPENDENT_VALUE", "<V>1</V>")])
def test_values_of_other_categories_are_read(category: str, text: str, tmp_path: Path) -> None:
    held = f"<SW-VALUE-CONT><SW-VALUES-PHYS>{text}</SW-VALUES-PHYS></SW-VALUE-CONT>"
    value = f"<SW-INSTANCE><SHORT-NAME>{SLOW}</SHORT-NAME><CATEGORY>{category}</CATEGORY>{held}</SW-INSTANCE>"
    (tmp_path / "set.cdfx").write_text(f"<MSRSW><CATEGORY>CDF20</CATEGORY>{value}</MSRSW>", encoding="ascii")
    assert read_set(tmp_path / "set.cdfx", loaded().layout) == {SLOW: np.float32(1.0)}


def test_a_value_in_a_block_that_is_not_supported_is_refused(tmp_path: Path) -> None:
    (tmp_path / "set.dcm").write_text(f"KONSERVIERUNG_FORMAT 2.0\nFESTWERTEBLOCK {SLOW} 1\n  WERT 1\nEND\n", encoding="ascii")
    with pytest.raises(CodegenError, match=f"line 2: {SLOW} is a FESTWERTEBLOCK, which is not supported; export it as one of"):
        read_set(tmp_path / "set.dcm", loaded().layout)
    value = f"<SW-INSTANCE><SHORT-NAME>{SLOW}</SHORT-NAME><CATEGORY>VAL_BLK</CATEGORY></SW-INSTANCE>"
    (tmp_path / "set.cdfx").write_text(f"<MSRSW><CATEGORY>CDF20</CATEGORY>{value}</MSRSW>", encoding="ascii")
    with pytest.raises(CodegenError, match=f"{SLOW}: is of category VAL_BLK; export it as one of VALUE"):
        read_set(tmp_path / "set.cdfx", loaded().layout)


@pytest.mark.parametrize("head", [f'FESTWERT "{SLOW}"', f'FESTWERTEBLOCK "{SLOW}" 1', "FESTWERTEBLOCK", "FESTWERT"])
def test_a_quoted_or_missing_name_is_not_skipped(head: str, tmp_path: Path) -> None:
    blocks = f"FESTWERT {SLOW}\n  WERT 1\nEND\n{head}\n  WERT 2\nEND\n"
    (tmp_path / "set.dcm").write_text(f"KONSERVIERUNG_FORMAT 2.0\n{blocks}", encoding="ascii")
    with pytest.raises(CodegenError, match="line 5: "):
        read_set(tmp_path / "set.dcm", loaded().layout)


def test_the_categories_that_are_written_are_those_of_the_objects() -> None:
    """DEPENDENT_VALUE, which is read, would make a value read-only in a calibration tool."""
    root = ElementTree.fromstring(CALIBRATION_READERS[".cdfx"].write(loaded().values, loaded().layout, "a title"))
    found = {each.findtext("SHORT-NAME"): each.findtext("CATEGORY") for each in root.iter("SW-INSTANCE")}
    categories = {"VALUE": "VALUE", "AXIS": "COM_AXIS", "CURVE": "CURVE", "MAP": "MAP"}
    assert found == {name: categories[each.kind] for name, each in loaded().layout.objects.items()}


def instance(name: str, category: str, inside: str) -> str:
    return f"<SW-INSTANCE><SHORT-NAME>{name}</SHORT-NAME><CATEGORY>{category}</CATEGORY>{inside}</SW-INSTANCE>"


@pytest.mark.parametrize("depth", [1, 2])
def test_members_of_structures_are_read(depth: int, tmp_path: Path) -> None:
    *outer, name = SLOW.split(".", depth)
    inside = instance(name, "VALUE", "<SW-VALUE-CONT><SW-VALUES-PHYS><V>2</V></SW-VALUES-PHYS></SW-VALUE-CONT>")
    for each in reversed(outer):
        inside = instance(each, "STRUCTURE", inside)
    (tmp_path / "set.cdfx").write_text(f"<MSRSW><CATEGORY>CDF20</CATEGORY>{inside}</MSRSW>", encoding="ascii")
    assert read_set(tmp_path / "set.cdfx", loaded().layout) == {SLOW: np.float32(2.0)}


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ("<SW-VALUES-CODED><V>2</V></SW-VALUES-CODED>", "has no physical values"),
        ("<SW-VALUES-PHYS><VH>0x10</VH></SW-VALUES-PHYS>", "'0x10' is not a number"),
    ],
)
def test_values_in_other_forms_are_refused(values: str, words: str, tmp_path: Path) -> None:
    inside = instance(SLOW, "VALUE", f"<SW-VALUE-CONT>{values}</SW-VALUE-CONT>")
    (tmp_path / "set.cdfx").write_text(f"<MSRSW><CATEGORY>CDF20</CATEGORY>{inside}</MSRSW>", encoding="ascii")
    with pytest.raises(CodegenError, match=words):
        read_set(tmp_path / "set.cdfx", loaded().layout)


def test_a_name_in_other_letters_is_not_skipped(tmp_path: Path) -> None:
    (tmp_path / "set.dcm").write_text(f"KONSERVIERUNG_FORMAT 2.0\nFESTWERT {SLOW.upper()}\n  WERT 1\nEND\n", encoding="ascii")
    with pytest.raises(CodegenError, match=f"{SLOW.upper()}: the build .* does not have it"):
        read_set(tmp_path / "set.dcm", loaded().layout)


# --- conversion ---------------------------------------------------------------------------------------------------------


CONFIGS = {"4ws2": configuration.parse(read_manifest(BUILD)["configuration"], "4ws2"), **builds.CONFIGS}


@pytest.mark.parametrize("name", CONFIGS)
def test_every_key_gives_its_parameter(name: str) -> None:
    """The value of each key returns from the value of its parameter."""
    config = CONFIGS[name]
    parameters = (*controller_parameters(config), *inputs_parameters(config), *limiter_parameters(config))
    keys = [each.key for each in parameters if each.key]
    assert len(set(keys)) == len(keys) > 0.75 * len(parameters)
    for each in parameters:
        current = reduce(getattr, each.key.split("."), config) if each.key else None
        if each.key and current is not None and not str(current).startswith("from-") and current != [0.0]:
            found = [each.to_key(value) for value in np.atleast_1d(each.value).tolist()]
            wanted = current if isinstance(current, list) else [current]
            if current == "off" and len(found) > 1:
                continue
            assert found == [value if isinstance(value, str) else pytest.approx(value, rel=1e-12) for value in wanted], (
                each.name
            )


def test_a_set_becomes_an_ars_toml_with_the_same_bits(tmp_path: Path) -> None:
    """Numbers without a short decimal in the keys of every parameter that has one."""
    build = loaded()
    values, free = dict(build.values), {"ars.limiter.rear_angle_max", "ars.limiter.speed_max", "ars.limiter.front_angle_max"}
    free |= {
        "ars.parameters.rear_angle_max",
        "ars.parameters.actuator_share",
        "ars.inputs.wheelbase",
        "ars.inputs.understeer_coefficient",
    }
    made = another(build)
    values |= {name: made[name] for name in values if name not in free and ".map." not in name}
    for name in ("ars.inputs.speed_max", "ars.inputs.front_angle_max"):  # the limiter's are the same keys
        values[name.replace("inputs", "limiter")] = values[name]
    build.check(values, {})
    config = configuration.parse(tomllib.loads(toml_of(values, build, None).text), "set")
    found = {
        f"ars.{group}.{each.name}": each.value
        for group, parameters in (
            ("parameters", controller_parameters(config)),
            ("inputs", inputs_parameters(config)),
            ("limiter", limiter_parameters(config)),
        )
        for each in parameters
    }
    assert len(found) > 50
    for name, value in found.items():
        assert np.array_equal(np.asarray(value, dtype=values[name].dtype), values[name]), name


def test_comments_stay_and_values_without_a_key_are_rejected(tmp_path: Path) -> None:
    build, path = loaded(), tmp_path / "ars.toml"
    path.write_text("# mine\n" + toml_of(build.values, build, None).text, encoding="utf-8")
    written = toml_of(changed(parameters__slow_speed=np.float32(11.5 / 3.6)), build, path)
    assert written.changed == ("controller.slow_speed_km_h",)
    assert "slow_speed_km_h = 11.5\n" in written.text and written.text.startswith("# mine\n")
    with pytest.raises(CodegenError, match=r"ars\.inputs\.wheelbase: 3 cannot be set by a key"):
        toml_of(changed(inputs__wheelbase=3.0), build, None)


@pytest.mark.parametrize(
    ("name", "preset", "key", "line"),
    [
        ("4ws2-paper", "paper", "disable_speed", "disable_speed_km_h = 11.5     # control ends below this speed\n"),
        ("4ws2", "recommended", "slow_speed", "slow_speed_km_h = 11.5         # no feedback up to this speed"),
    ],
)
def test_a_set_goes_into_the_file_of_codegen_init(
    name: str, preset: configuration.Preset, key: str, line: str, tmp_path: Path
) -> None:
    """The file keeps its comments. That of kind "tracking" has no gains yet; those of the set are added."""
    build, path = loaded(name), tmp_path / "ars.toml"
    path.write_text(configuration.preset_text(preset), encoding="utf-8")
    values = dict(build.values) | {f"ars.parameters.{key}": np.float32(11.5 / 3.6)}
    written = toml_of(values, build, path)
    assert line in written.text
    path.write_text(written.text, encoding="utf-8")
    assert not toml_of(values, build, path).changed  # every parameter is that of the set


def check_map_of_set(name: str) -> None:
    """Check that the lookup of a build of the written map returns that of the set at its own breakpoints."""
    build = loaded(name)
    written = map_of(build.values, build, "set")
    assert not written.lost
    folder = builds.render(written.map, written.map.config or builds.CONFIG)
    again = BuildCalibration.load(shared.written(f"map of {name}", lambda: folder))
    with_rear = written.map.rear_angle is not None
    speed, angle = np.float32(written.map.speed), np.float32(written.map.front_angle)
    for friction in build.manifest["map"]["frictions"]:
        sets = ((build, build.values), (again, again.values))
        one, two = (each.looked_up(values, speed, angle, (friction,), with_rear_angle=with_rear) for each, values in sets)
        for first, second in zip(one, two, strict=True):
            # Five roundings to single precision of numbers up to 2.
            assert np.abs(first - second).max() < 5 * 2 * np.finfo(np.float32).eps


@pytest.mark.parametrize("name", ["uneven stack", "int16"])
def test_a_map_of_the_set_builds_the_same_map(name: str) -> None:
    check_map_of_set(name)


# --- images -------------------------------------------------------------------------------------------------------------

MAIN = """
#include <stdio.h>
#include <string.h>

#include "ars_controller.h"
#include "ars_map.h"
#include "ars_task.h"

static ars_task_t task;

int main(void)
{
    ars_task_init(&task, &ars_parameters_default);
    printf("%d %.9g %.9g %.9g %d\\n", (int)ars_selftest(), (double)ars_parameters_default.slow_speed,
        (double)ars_parameters_default.integral_gain[3], (double)ars_map_yaw_rate_table[7][9],
        (int)(ars_calibration_checksum() == ars_calibration_expected_checksum));
    return 0;
}
"""


def recalibrated() -> Values:
    build = loaded()
    table, gains = build.values["ars.map.yaw_rate"].copy(), build.values[GAIN].copy()
    table[7, 9], gains[3] = 0.123456789, 1.25
    values = changed(parameters__slow_speed=3.25, map__yaw_rate=table, parameters__integral_gain=gains)
    build.check(values, {})
    return values


def test_a_patched_program_runs_with_the_set_and_passes_its_self_test(tmp_path: Path) -> None:
    program, build, values = compiled(BUILD, tmp_path, MAIN), loaded(), recalibrated()
    image = Image.load(program, None, BUILD, build.layout)
    assert all(np.array_equal(found, build.values[name]) for name, found in image.read().items())
    patched = tmp_path / "patched"
    patched.write_bytes(image.patched(values))
    patched.chmod(0o755)
    printed = [subprocess.run([each], check=True, capture_output=True, text=True).stdout.split() for each in (program, patched)]
    assert printed[0][0] == printed[1][0] == printed[1][4] == "1"
    assert printed[1][1:4] == ["3.25", "1.25", "0.123456791"]
    assert printed[0][1:4] != printed[1][1:4]


@pytest.mark.parametrize("core", [CORTEX_M4F, POWERPC_BE], ids=lambda core: core.name)
def test_a_patched_image_passes_its_self_test_on_a_core(core: Core, tmp_path: Path) -> None:
    """Little-endian and big-endian. With the old checksum, the self-test fails."""
    build, values = loaded(), recalibrated()
    sources: dict[str, str | bytes] = {
        path.relative_to(BUILD).as_posix(): path.read_bytes() for path in (*BUILD.glob("include/*.h"), *BUILD.glob("src/*.c"))
    }
    sources.pop("src/ars_dynamics.c")
    path = tmp_path / "image.elf"
    path.write_bytes(compile_image(sources, ("ars_selftest", "ars_calibration_checksum", "ars_epk"), ("-O2", "-g"), core))
    image = Image.load(path, None, BUILD, build.layout)
    assert all(np.array_equal(found, build.values[name]) for name, found in image.read().items())
    checksum = build.layout.checksum.name
    stale = {**values, checksum: build.values[checksum]}
    answers = [Processor(image.patched(each), core).call("ars_selftest") & 0xFF for each in (build.values, values, stale)]
    assert answers == [1, 1, 0]
    assert Processor(image.patched(values), core).call("ars_calibration_checksum") == int(values[checksum])


def bytes_of(text: str) -> dict[int, int]:
    """Return address -> byte of an S-record or Intel HEX text, read without bincopy; checks every checksum."""
    found: dict[int, int] = {}
    base = 0
    for line in text.splitlines():
        if line.startswith("S"):
            record = bytes.fromhex(line[2:])
            assert sum(record) & 0xFF == 0xFF and record[0] == len(record) - 1
            width = {"1": 2, "2": 3, "3": 4}.get(line[1], 0)
            if width:
                address = int.from_bytes(record[1 : 1 + width], "big")
                found |= {address + k: byte for k, byte in enumerate(record[1 + width : -1])}
        else:
            record = bytes.fromhex(line[1:])
            assert sum(record) & 0xFF == 0 and record[0] == len(record) - 5
            if record[3] == 4:
                base = int.from_bytes(record[4:6], "big") << 16
            elif record[3] == 0:
                address = base + int.from_bytes(record[1:3], "big")
                found |= {address + k: byte for k, byte in enumerate(record[4:-1])}
    return found


@pytest.mark.parametrize("name", ["4ws2", "int16"])
@pytest.mark.parametrize("order", ["MSB_LAST", "MSB_FIRST"])
@pytest.mark.parametrize("suffix", [".s19", ".hex"])
def test_records_are_patched_only_where_values_change(name: str, order: str, suffix: str, tmp_path: Path) -> None:
    build = loaded(name)
    a2l, path = tmp_path / "ecu.a2l", tmp_path / f"ecu{suffix}"
    a2l.write_bytes(addressed((build.folder / "ars.a2l").read_bytes(), order))
    records = records_of(a2l.read_bytes(), build)
    path.write_text(records.as_srec() if suffix == ".s19" else records.as_ihex())
    image = Image.load(path, a2l, build.folder, build.layout)
    assert all(np.array_equal(found, build.values[each]) for each, found in image.read().items())
    values = another(build)
    before, after = bytes_of(path.read_text()), bytes_of(image.patched(values).decode())
    wanted = bytes_of(records_of(a2l.read_bytes(), build, values).as_srec())
    assert after == wanted != before
    assert bytes_of(image.patched(build.values).decode()) == before


@pytest.mark.parametrize("kind", ["S-record, pieces", "Intel HEX, pieces"])
def test_records_in_very_many_pieces_are_refused(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "ecu"
    path.write_bytes(HOSTILE[kind].make(0.02))
    with pytest.raises(BuildError, match=r"ecu: damaged \(more than 1000 separate pieces\); write the image again"):
        Image.load(path, None, BUILD, loaded().layout)


def test_an_elf_gives_the_addresses_of_records(tmp_path: Path) -> None:
    build, values, program = loaded(), recalibrated(), compiled(BUILD, tmp_path, MAIN)
    path, records = tmp_path / "ecu.hex", bincopy.BinFile()
    records.add_elf_file(str(program))
    path.write_text(records.as_ihex())
    image = Image.load(path, program, BUILD, build.layout)
    patched = tmp_path / "patched.elf"
    patched.write_bytes(Image.load(program, None, BUILD, build.layout).patched(values))
    wanted = bincopy.BinFile()
    wanted.add_elf_file(str(patched))
    assert bytes_of(image.patched(values).decode()) == bytes_of(wanted.as_ihex())


def test_records_lie_where_a_programmer_writes(tmp_path: Path) -> None:
    """Calibration that is copied to RAM at start: the load address of its segment is another one."""
    build, program = loaded(), compiled(BUILD, tmp_path, MAIN)
    content, (start, size, count) = bytearray(program.read_bytes()), (64, 56, program.read_bytes()[56])
    moved = 0x4000_0000
    for at in range(start, start + size * count, size):
        (physical,) = struct.unpack_from("<Q", content, at + 24)  # p_paddr of Elf64_Phdr
        struct.pack_into("<Q", content, at + 24, physical + moved)
    program.write_bytes(content)
    path, records = tmp_path / "ecu.s19", bincopy.BinFile()
    records.add_elf_file(str(program))
    path.write_text(records.as_srec())
    assert min(bytes_of(path.read_text())) > moved
    assert all(
        np.array_equal(found, build.values[name])
        for name, found in Image.load(path, program, BUILD, build.layout).read().items()
    )


# --- the command --------------------------------------------------------------------------------------------------------


def test_the_command_writes_compares_and_converts(run: Run, tmp_path: Path) -> None:
    first, second = tmp_path / "first.dcm", write(recalibrated(), tmp_path / "second.cdfx")
    answer = run("calibrate", "--build", BUILD, "-o", first)
    assert (answer.code, answer.err) == (0, "") and "68 objects, 0 other than in the build" in answer.out
    assert "no difference" in run("calibrate", "--build", BUILD, first).out
    plot = tmp_path / "changes.png"
    out = run("calibrate", "--build", BUILD, first, second, "--plot", plot).out
    assert plot.read_bytes().startswith(b"\x89PNG")
    rows = {line.split()[0]: line.split()[1:] for line in out.splitlines() if line.startswith("ars.")}
    assert rows.keys() == {SLOW, GAIN, "ars.map.yaw_rate"}
    assert rows[SLOW][:3] == ["1", "2.08333", "3.25"]
    for name in ("ars.toml", "map.npz", "again.dcm"):
        assert run("calibrate", "--build", BUILD, second, "-o", tmp_path / name).code == 0
    assert configuration.load(tmp_path / "ars.toml").controller.slow_speed_km_h == 11.7
    found = read_set(tmp_path / "again.dcm", loaded().layout)
    assert all(found[name].tobytes() == value.tobytes() for name, value in recalibrated().items())


def test_the_picture_names_both_sets_and_units() -> None:
    change = ValueChange(SLOW, "m/s", 10.0 / 3.0, 3.25)
    figure = draw(calibration_picture([change], [], None, ("first.dcm", "second.cdfx")))
    (axes,) = figure.findobj(Axes)
    assert axes.get_title(loc="left") == "Values, first (first.dcm) to second (second.cdfx)"
    assert [label.get_text() for label in axes.get_yticklabels()] == [f"{SLOW}: 3.333 → 3.25 m/s"]


def test_unsuitable_arguments_are_rejected(refused: Refused, tmp_path: Path) -> None:
    good, image = write(loaded().values, tmp_path / "set.dcm"), tmp_path / "ecu.s19"
    image.write_text("S9030000FC\n")
    other = tmp_path / "other.dcm"
    other.write_text("KONSERVIERUNG_FORMAT 2.0\nFESTWERT a.b\n  WERT 1\nEND\n")
    command = ("calibrate", "--build", BUILD)
    empty, wide = tmp_path / "empty.s19", tmp_path / "wide.s19"
    empty.write_bytes(b"")
    wide.write_text(image.read_text(), encoding="utf-16-le")
    for arguments, words in (
        ((good, "--image", empty, "-o", "a.s19"), "empty; save or copy it again"),
        ((good, "--image", wide, "-o", "a.s19"), "it is in UTF-16; save it as UTF-8"),
        ((good, "--image", image, "--addresses", empty, "-o", "a.s19"), "empty.s19: empty; save"),
        ((good, "--image", image, "--addresses", wide, "-o", "a.s19"), "wide.s19: it is in UTF-16; save"),
        ((good, "-o", "set.bin"), "give the image to patch with --image"),
        ((good, "-o", good), "it is an input of this command"),
        ((good, good, good), "3 files"),
        (("--plot", "a.png"), "draws a comparison"),
        ((good, "--addresses", good), "--addresses: has no effect here"),
        ((good, "--config", good, "-o", "a.dcm"), "--config: has no effect here"),
        ((good, "--image", image, "-o", "a.s19"), "give its ELF, or the A2L of codegen a2l, with --addresses"),
        ((good, "--image", tmp_path / "program", "-o", "a.s19"), "only .elf is written; name it a.elf"),
        ((good, "--image", good, "-o", "a.dcm"), "neither ELF, S-record nor Intel HEX"),
        ((other,), "contains no value of this build"),
        ((tmp_path / "none.dcm",), "cannot be read"),
        ((image,), ".s19 is not supported"),
    ):
        assert words in refused(*command, *arguments), arguments

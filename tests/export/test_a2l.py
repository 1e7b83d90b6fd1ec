"""The A2L: read by independent readers, and compared with the addresses and numbers that a program prints."""

import re
import struct
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from codegen.configuration import parse
from codegen.configuration.xcp import NATIVE_COMMANDS
from codegen.emit.a2l_view import a2l
from codegen.emit.manifest import read_build
from codegen.emit.text import Precision
from codegen.errors import BuildError
from codegen.export import elf as elf_module
from codegen.export.a2l import Filled, fill
from codegen.export.elf import Elf, MemoryObject
from codegen.map_file import map as refmap
from codegen.sil.toolchain import compiler_command
from tests import builds
from tests.xcp.description import Description, if_data, read_module, tools

GENERATED = Path(__file__).resolve().parents[2] / "generated"
BUILD = GENERATED / "4ws2"
OBJECT = re.compile(r"/begin (AXIS_PTS|CHARACTERISTIC|MEASUREMENT) (\S+) .*?/end \1", re.DOTALL)
KINDS = ("AXIS_PTS", "CHARACTERISTIC", "MEASUREMENT")
REFERENCES = ("REF_CHARACTERISTIC", "REF_MEASUREMENT")

MAIN = """
#include <stdio.h>

#include "ars_task.h"
#include "ars_controller.h"
#include "ars_map.h"

typedef struct {
    int before;
    ars_task_t task;
} ecu_t;

static ecu_t ecu;

static void show(const char *name, const void *at, size_t size)
{
    const unsigned char *bytes = at;
    size_t k;

    printf("%s %p ", name, at);
    for (k = 0u; k < size; k++) {
        printf("%02x", bytes[k]);
    }
    printf("\\n");
}

int main(void)
{
    ars_task_init(&ecu.task, &ars_parameters_default);
SHOWN
    return 0;
}
"""


def objects(text: str) -> dict[str, tuple[str, str, int]]:
    """Return kind, link and address by name, parsed from text."""
    found = {}
    for block in OBJECT.finditer(text):
        link = re.search(r'SYMBOL_LINK "([^"]*)"', block[0])
        address = re.search(r"\b0x([0-9A-Fa-f]{8})\b", block[0])
        assert link and address
        found[block[2]] = (block[1], link[1], int(address[1], 16))
    return found


@dataclass(frozen=True)
class Linked:
    """A program with the linked build, and their A2L."""

    program: Path
    elf: Elf
    filled: Filled

    @property
    def objects(self) -> dict[str, tuple[str, str, int]]:
        return objects(self.filled.text)


def compiled(build_path: Path, folder: Path, main: str, *flags: str) -> Path:
    """Return a program compiled from a build's sources and a main."""
    (folder / "main.c").write_text(main, encoding="ascii")
    sources = [str(path) for path in sorted((build_path / "src").glob("*.c"))]
    program = folder / "program"
    command = [*compiler_command(), "-std=c99", "-O0", "-g", "-no-pie", "-fno-pie", "-ffp-contract=off", *flags]
    command += [f"-I{build_path / 'include'}", str(folder / "main.c"), *sources, "-o", str(program), "-lm"]
    subprocess.run(command, check=True, capture_output=True, text=True)
    return program


@pytest.fixture(scope="module")
def tracking(tmp_path_factory: pytest.TempPathFactory) -> Linked:
    names = objects((BUILD / "ars.a2l").read_text(encoding="ascii"))
    links = {name: link.replace("ars_task.", "ecu.task.") for name, (_, link, _) in names.items()}
    shown = "\n".join(f'    show("{name}", &({link}), sizeof({link}));' for name, link in links.items())
    program = compiled(BUILD, tmp_path_factory.mktemp("tracking"), MAIN.replace("SHOWN", shown))
    elf = Elf.read(program)
    return Linked(program, elf, fill(BUILD, elf))


def test_every_address_and_its_bytes_are_those_of_the_program(tracking: Linked) -> None:
    """The program prints the address and content of each object; the ELF holds the same bytes."""
    printed = subprocess.run([tracking.program], check=True, capture_output=True, text=True).stdout
    read = {name: (int(address, 16), bytes.fromhex(content)) for name, address, content in map(str.split, printed.splitlines())}
    assert read.keys() == tracking.objects.keys() and len(read) > 40
    for name, (kind, _, address) in tracking.objects.items():
        assert address == read[name][0], name
        assert tracking.filled.places[name].bytes == len(read[name][1]), name
        if kind != "MEASUREMENT":
            assert tracking.elf.bytes_at(address, len(read[name][1])) == read[name][1], name
    assert not tracking.filled.left_out
    assert tracking.filled.instance == "ecu.task"
    first, size = tracking.filled.segment
    inside = {name for name, (_, _, address) in tracking.objects.items() if first <= address < first + size}
    assert inside == {name for name, (kind, _, _) in tracking.objects.items() if kind != "MEASUREMENT"}
    assert f"0x{first:08X} 0x{size:X}" in tracking.filled.text


def test_independent_readers_see_the_same_objects(tracking: Linked, tmp_path: Path) -> None:
    """a2ltool finds no fault, in the build's own A2L either. pya2l: every object is in a group, with its address and unit."""
    shown = read_strictly(tracking.filled.text, tmp_path)
    assert re.findall(r"CAN .*: .*", shown) == ["CAN id master: 0x6A0", "CAN id slave: 0x6A1", "CAN baudrate: 500 kbps"]
    read_strictly((BUILD / "ars.a2l").read_text(encoding="ascii"), tmp_path)
    assert "/include" not in tracking.filled.text
    filled = tmp_path / "filled.a2l"
    filled.write_text(tracking.filled.text, encoding="ascii")
    module = read_module(filled)
    found = {each["Name"]["Value"]: each for kind in KINDS for each in module[kind]}
    assert found.keys() == tracking.objects.keys()
    for name, (kind, link, address) in tracking.objects.items():
        assert found[name]["SYMBOL_LINK"]["SymbolName"]["Value"] == link
        place = found[name]["ECU_ADDRESS"]["Address"] if kind == "MEASUREMENT" else found[name]["Address"]
        assert int(place["Value"]) == address
    lists = [group.get(part, {}).get("Identifier", []) for group in module["GROUP"] for part in REFERENCES]
    assert sorted(each["Value"] for names in lists for each in names) == sorted(found)
    units = {each["Name"]["Value"]: each.get("Unit", {}).get("Value", "") for each in module["COMPU_METHOD"]}
    for name, unit in {"parameters.rear_angle_max": "rad", "limiter.rear_rate_max": "rad/s"}.items():
        assert units[found[f"ars.{name}"]["Conversion"]["Value"]] == unit


A2ML = re.compile(r" */begin A2ML.*?/end A2ML\n", re.DOTALL)


def a2ltool(text: str, folder: Path, *options: str) -> str:
    """Run a2ltool on a text and return what it prints."""
    (folder / "checked.a2l").write_text(text, encoding="ascii")
    answer = subprocess.run(["a2ltool", *options, str(folder / "checked.a2l")], capture_output=True, text=True, env=tools())
    assert answer.returncode == 0, answer
    return answer.stdout + answer.stderr


def read_strictly(text: str, folder: Path) -> str:
    """Check that a2ltool reports no problem, and that all IF_DATA follows its definitions. Return the XCP settings as printed.

    The definitions are the A2ML of the file, and the standard's, which a2ltool inserts into a file without A2ML.
    """
    assert "No problems found" in a2ltool(text, folder, "--check", "--strict")
    whole, kept = folder / "standard.a2l", folder / "kept.a2l"
    a2ltool(A2ML.sub("", text), folder, "--insert-a2ml", "-o", str(whole))
    for each in (text, whole.read_text(encoding="utf-8")):
        assert "/begin A2ML" in each
        a2ltool(each.encode("ascii", "replace").decode(), folder, "--ifdata-cleanup", "-o", str(kept))  # removes invalid ones
        assert kept.read_text(encoding="utf-8").count("/begin IF_DATA") == text.count("/begin IF_DATA") > 1
    return a2ltool(text, folder, "--check", "--strict", "--show-xcp")


def test_the_orientation_of_the_map(tracking: Linked) -> None:
    """ROW_DIR in ASAP2 stores neighbours along the first axis, the front angle, consecutively."""
    text, solved = tracking.filled.text, refmap.load(GENERATED / "4ws2.npz")
    block = re.search(r"/begin CHARACTERISTIC ars.map.yaw_rate .*?/end CHARACTERISTIC", text, re.DOTALL)
    assert block is not None and "FNC_VALUES 1 FLOAT32_IEEE ROW_DIR DIRECT" in text
    assert re.findall(r"AXIS_PTS_REF (\S+)", block[0]) == ["ars.map.front_angle", "ars.map.speed"]
    columns, rows = (int(points) for points in re.findall(r"COM_AXIS \S+ \S+ (\d+)", block[0]))

    def read(name: str, count: int) -> np.ndarray:
        content = tracking.elf.bytes_at(tracking.objects[name][2], 4 * count)
        assert content is not None
        return np.frombuffer(content, "<f4")

    _, at_speed, same_speed = np.intersect1d(read("ars.map.speed", rows), np.float32(solved.speed), return_indices=True)
    _, at_angle, same_angle = np.intersect1d(
        read("ars.map.front_angle", columns), np.float32(solved.front_angle), return_indices=True
    )
    found = read("ars.map.yaw_rate", rows * columns).reshape(rows, columns)[np.ix_(at_speed, at_angle)]
    there, wanted = (each[np.ix_(same_speed, same_angle)] for each in (solved.feasible, np.float32(solved.yaw_rate)))
    assert there.sum() > 1000 and np.array_equal(found[there], wanted[there])


def test_the_byte_order_is_that_of_the_program(tracking: Linked) -> None:
    """Both places state it: the one for memory and the one for packets of XCP."""
    words, elf = ("BYTE_ORDER MSB_", "BYTE_ORDER_MSB_"), Elf.read(tracking.program)
    elf.is_little = False
    for text, end in ((tracking.filled.text, "LAST"), (fill(BUILD, elf).text, "FIRST")):
        assert all(f"{word}{end}" in A2ML.sub("", text) for word in words)


# --- other programs -----------------------------------------------------------------------------------------------------

PROGBITS, NOBITS, ALLOC = 1, 8, 2
"""Types of sections of an ELF, and the flag of those in memory."""
EMPTY = "int main(void) { return 0; }\n"
TASKS = '#include "ars_task.h"\nars_task_t one, two[2];\nint main(void) { return one.has_measured || two[1].has_measured; }\n'


def written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def debug_information_of(program: Path) -> Path:
    """Return a file as `objcopy --only-keep-debug` writes it: sections with code and values have no content."""
    content = bytearray(program.read_bytes())
    first, size, count = struct.unpack_from("<Q", content, 40)[0], *struct.unpack_from("<HH", content, 58)
    for head in range(first, first + size * count, size):
        kind, flags = struct.unpack_from("<LQ", content, head + 4)
        if kind == PROGBITS and flags & ALLOC:
            struct.pack_into("<L", content, head + 4, NOBITS)
    return written(program.with_suffix(".debug"), bytes(content))


MAIN_OF_TASK = '#include "ars_task.h"\nars_task_t task;\nint main(void) { return task.has_measured; }\n'
UNSUITABLE: dict[str, Callable[[Path], Path]] = {
    "not an ELF": lambda folder: BUILD / "README.md",
    "no symbols": lambda folder: compiled(BUILD, folder, EMPTY, "-s"),
    "no debug information": lambda folder: compiled(BUILD, folder, EMPTY, "-g0"),
    "ars_epk has no type in its debug information; compile with -g, not": lambda folder: compiled(
        BUILD, folder, MAIN_OF_TASK, "-g1"
    ),
    "in files of its own, such as program-main.dwo; compile without -gsplit-dwarf": lambda folder: compiled(
        folder, folder, EMPTY, "-gsplit-dwarf"
    ),
    "empty; save or copy it again": lambda folder: written(folder / "empty.elf", b""),
    "it has debug information alone, without code and values": lambda folder: debug_information_of(
        compiled(folder, folder, EMPTY)
    ),
    "keep the calibration from --gc-sections and -flto": lambda folder: compiled(folder, folder, EMPTY),
    "no variable ars_epk": lambda folder: compiled(folder, folder, "int number = 1;\n" + EMPTY),
    "it holds the build ": lambda folder: compiled(GENERATED / "4ws2-paper", folder, EMPTY),
}


@pytest.mark.parametrize("words", UNSUITABLE)
def test_a_program_of_another_build_is_rejected(tmp_path: Path, words: str) -> None:
    with pytest.raises(BuildError) as caught:
        fill(BUILD, Elf.read(UNSUITABLE[words](tmp_path)))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_a2l_is_rendered_from_the_manifest() -> None:
    """Of a build that was read from disk, it has the same bytes as from the generator."""
    manifest = read_build(BUILD)
    assert a2l(manifest, parse(manifest["configuration"], "manifest")) == (BUILD / "ars.a2l").read_bytes()


def test_a_damaged_program_is_reported_in_one_line(tracking: Linked) -> None:
    """Truncated or with changed bytes, it is read or rejected as damaged."""
    content, rng = tracking.program.read_bytes(), np.random.default_rng(11)
    refused = 0
    for k in range(60):
        damaged = bytearray(content[: rng.integers(len(content))] if k % 3 == 0 else content)
        for place in rng.integers(len(damaged), size=0 if k % 3 == 0 else 10 * k):
            damaged[place] = rng.integers(256)
        try:
            fill(BUILD, Elf("damaged.elf", bytes(damaged)))
        except BuildError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused > 20


def test_one_of_several_instances_is_chosen(tmp_path: Path) -> None:
    elf = Elf.read(compiled(BUILD, tmp_path, TASKS))
    with pytest.raises(BuildError, match=r"several objects of ars_task_t: one, two\[0\], two\[1\]"):
        fill(BUILD, elf)
    places = {name: fill(BUILD, elf, name).places["ars.law.integral"] for name in ("one", "two[1]")}
    assert places["two[1]"] == elf.place("two[1].controller.law.integral") != places["one"]
    assert 'SYMBOL_LINK "two[1].controller.law.integral" 0' in fill(BUILD, elf, "two[1]").text


def test_too_many_objects_of_a_type_are_named_as_such(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elf_module, "INSTANCES_MAX", 2)
    with pytest.raises(BuildError, match="more than 2 objects of the type ars_task_t; link the program without"):
        fill(BUILD, Elf.read(compiled(BUILD, tmp_path, TASKS)))


APART = "-fdebug-types-section"
TYPES = """typedef struct { float integral; } law_t;
typedef struct { int first; law_t law[3]; } task_t;
typedef struct { char name; task_t task; } ecu_t;
static ecu_t ecu;
int main(void)
{
    if (ecu.name) {
        static task_t inside;
        return inside.first++;
    }
    return ecu.task.law[1].integral > 0.0f;
}
"""


@pytest.mark.parametrize("flags", [("-gdwarf-4",), ("-gdwarf-4", APART), ("-gdwarf-5",), ("-gdwarf-5", APART)])
def test_types_in_units_of_their_own(tmp_path: Path, flags: tuple[str, ...]) -> None:
    """DWARF 4 has them in another section, DWARF 5 among the other units. A variable inside a function counts as well."""
    elf = Elf.read(compiled(tmp_path, tmp_path, TYPES, *flags))
    laws = [f"{task}.law[{k}]" for task in ("ecu.task", "inside") for k in range(3)]
    assert elf.instances("task_t") == ["ecu.task", "inside"] and elf.instances("law_t") == laws
    assert elf.instances("float") == []
    first, last = elf.place("ecu.task.first"), elf.place("ecu.task.law[2].integral")
    assert first is not None and last == MemoryObject(first.address + 12, 4, "float", 1)


def test_a_frozen_calibration_is_still_the_same_build(tracking: Linked) -> None:
    """The map and its checksum have changed: the program still belongs to the linked build."""
    content = bytearray(tracking.program.read_bytes())
    place = tracking.elf.place("ars_calibration_expected_checksum")
    assert place is not None
    stored = tracking.elf.bytes_at(place.address, 4)
    assert stored is not None
    content = content.replace(stored, b"\x12\x34\x56\x78")  # the self-test contains it too
    assert fill(BUILD, Elf("frozen", bytes(content))).places == tracking.filled.places


def test_missing_objects_are_omitted(tracking: Linked, tmp_path: Path) -> None:
    """A program without task and controller has only the calibration."""
    main = '#include "ars_controller.h"\nint main(void) { return ars_selftest() ? 0 : 1; }\n'
    filled = fill(BUILD, Elf.read(compiled(BUILD, tmp_path, main)))
    measured = {name for name, (kind, _, _) in tracking.objects.items() if kind == "MEASUREMENT"}
    assert (filled.instance, set(filled.left_out)) == ("", measured)
    assert objects(filled.text).keys() == tracking.objects.keys() - measured
    read_strictly(filled.text, tmp_path)


# --- the slave of another ECU ---------------------------------------------------------------------------------------------

OWN = {
    "receive_id": 0x18DA00F1,
    "transmit_id": 0x18DAF100,
    "extended_ids": True,
    "bitrate_kbit_s": 1000.0,
    "data_bitrate_kbit_s": 5000.0,
    "frame_bytes_max": 64,
    "frames_are_full": True,
    "max_cto": 32,
    "max_dto": 64,
    "timeout_ms": 25,
    "seed_and_key_function": "SeedNKey.dll",
    "commands": [*NATIVE_COMMANDS, "GET_SEED", "UNLOCK", "SHORT_DOWNLOAD"],
    "event_channel": 300,
    "event_name": "Rear steering",
    "daq_lists_max": 16,
    "identification": "relative-word-aligned",
    "has_prescaler": False,
    "timestamp_bytes": 4,
    "timestamp_unit": "1 us",
}


def made_for(options: dict[str, object], folder: Path, precision: Precision = "single") -> tuple[Description, str, str]:
    """Return the A2L of a build with an [xcp], its XCP settings as printed by a2ltool, and the header of the native ECU."""
    config = parse({**builds.CONFIG.model_dump(), "can": {}, "xcp": options}, "ars.toml")
    files = builds.render(builds.paper_map(), config, precision).files
    (folder / "own.a2l").write_bytes(files["ars.a2l"])
    shown = read_strictly(files["ars.a2l"].decode("ascii"), folder)
    return Description.read(folder / "own.a2l"), shown, files["linux/ars_ecu_config.h"].decode("ascii")


def test_the_options_of_another_slave(tmp_path: Path) -> None:
    a2l, shown, header = made_for(OWN, tmp_path)
    assert re.findall(r"(CAN.*): (.*)", shown) == [
        ("CAN id master", "0x18DA00F1"),
        ("CAN id slave", "0x18DAF100"),
        ("CAN baudrate", "1000 kbps"),
        ("CAN-FD data baudrate", "5000 kbps"),
        ("CAN-FD max DLC", "64"),
    ]
    rates = {"bitrate": 1_000_000, "fd": True, "data_bitrate": 5_000_000}
    assert a2l.bus == {"can_id_master": 0x98DA00F1, "can_id_slave": 0x98DAF100, **rates}
    assert "#define ARS_XCP_ID_TRANSMIT 0x98DAF100u " in header
    assert "MAX_DLC_REQUIRED" in a2l.xcp["XCP_ON_CAN"]["CAN_FD"].values
    layer, daq = a2l.xcp["PROTOCOL_LAYER"], a2l.xcp["DAQ"]
    assert (layer.values[1:10], layer.after("SEED_AND_KEY_EXTERNAL_FUNCTION")) == ([*[25] * 7, 32, 64], "SeedNKey.dll")
    assert sorted(a2l.commands) == sorted([*NATIVE_COMMANDS, "GET_SEED", "UNLOCK", "SHORT_DOWNLOAD"])
    assert daq.values[1] == 16 and daq.after("GRANULARITY_ODT_ENTRY_SIZE_DAQ_BYTE") == 60
    assert {"IDENTIFICATION_FIELD_TYPE_RELATIVE_WORD_ALIGNED", "PRESCALER_SUPPORTED"} & set(daq.values) == {
        "IDENTIFICATION_FIELD_TYPE_RELATIVE_WORD_ALIGNED"
    }
    assert daq["TIMESTAMP_SUPPORTED"].values == [1, "SIZE_DWORD", "UNIT_1US"]
    assert daq["EVENT"].values[:3] == ["Rear steering", "Rear ste", 300]
    assert {each.event for each in a2l.measured.values()} == {300}


def test_a_slave_without_lists_pages_and_checksum(tmp_path: Path) -> None:
    a2l, _, _ = made_for({"commands": ["SET_MTA", "UPLOAD", "SHORT_UPLOAD", "DOWNLOAD"]}, tmp_path)
    assert not [name for name in ("DAQ", "PAG") if list(a2l.xcp.blocks(name))]
    segment = if_data(a2l.segment)["SEGMENT"]
    assert (segment.values, list(segment.blocks("CHECKSUM"))) == ([0, 1, 0, 0, 0], [])
    assert [page.values[0] for page in segment.blocks("PAGE")] == [0]
    assert not [each for each in a2l.module["MEASUREMENT"] if "IF_DATA" in each]


def test_a_number_that_no_packet_holds_has_no_event(tmp_path: Path) -> None:
    """Eight bytes do not fit into a packet of eight bytes with its identification field."""
    a2l, _, _ = made_for({"timestamp_bytes": 0}, tmp_path, "double")
    assert not list(a2l.xcp["DAQ"].blocks("TIMESTAMP_SUPPORTED"))
    with_event = {each["DataType"]["Value"]: "IF_DATA" in each for each in a2l.module["MEASUREMENT"]}
    assert with_event == {"FLOAT64_IEEE": False, "ULONG": True, "UBYTE": True}

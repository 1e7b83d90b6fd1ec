"""The AUTOSAR export: what independent readers find in the ARXML, and the component on an RTE that is made from it."""

from __future__ import annotations

import functools
import itertools
import json
import re
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args
from unittest import mock

import autosar_data
import cantools
import numpy as np
import pytest
from cantools.autosar.end_to_end import check_profile2_crc, check_profile5_crc
from elftools.elf.elffile import ELFFile

from codegen import __version__
from codegen.configuration import Config, parse
from codegen.configuration.can import Can
from codegen.configuration.e2e_profiles import PROFILES, ProfileName
from codegen.ecu_map.extend import extend
from codegen.ecu_map.placement import Placed, Request
from codegen.ecu_map.placement_error import MeasuredError
from codegen.ecu_map.storage import Scales
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.can_view import DIAGNOSTIC_CAUSES
from codegen.emit.folder import read_files, read_manifest
from codegen.emit.manifest import read_build
from codegen.emit.misra_rules import ADVISORY
from codegen.emit.objects import Layout
from codegen.emit.write import write_folder
from codegen.export.arxml import Access, Protection, export
from codegen.export.firmware import record
from codegen.sil.compile import DEFAULT_FLAGS, compile_library
from codegen.sil.software import load
from codegen.sil.toolchain import compiler_command
from codegen.verify.static_analysis import judged_by_misra
from hil_sim.codec import Frame
from hil_sim.e2e import protect
from hil_sim.scenario_files import find
from tests import builds, frame_kinds, shared
from tests.cli.conftest import Answer, refused, run
from tests.export import rte
from tests.hil_sim.test_codec import OTHER
from tests.sil import e2e_profiles
from tests.whole_car import car

__all__ = ["refused", "run"]  # fixtures

Run, Refused = Callable[..., Answer], Callable[..., str]
GENERATED = Path(__file__).parents[2] / "generated"
BUILDS = ("4ws2", "4ws2-paper", "other")
"""`other` has Motorola byte order, odd lengths and offsets, a stack of maps in int16, double precision, and another prefix."""
FRAME_KINDS = ("29 bits", "FD, 24 bytes, profile 11C, 29 bits", "FD, 64 bytes, profile 5")
VARIANTS: tuple[tuple[Protection, Access], ...] = (
    ("transformer", "explicit"),
    ("transformer", "implicit"),
    ("task", "explicit"),
)


@functools.cache
def build_of(name: str) -> Path:
    """Return the folder of a build."""
    if name in frame_kinds.KINDS:
        return frame_kinds.folder(name)
    if name != "other":
        return GENERATED / name
    with shared.locked("autosar other build") as path:
        place = path / "other"
        if not place.exists():
            tables = builds.TRACKING_CONFIG.model_dump(mode="json")
            for role, changes in OTHER.items():
                tables["can"][role] |= changes
            config, reference_map = Config.model_validate(tables), builds.MAPS["rough stack"]()
            total = extend(reference_map, config, config.steering.front_angle_stop)
            tables = [[getattr(each, name) for each in total.stack] for name in ("yaw_rate", "rear_angle")]
            largest = (float(np.abs(np.array(layers)).max()) for layers in tables)
            total = replace(total, scales=Scales.of(*largest, np.float64))
            # As stored, without the search for breakpoints, which takes long.
            placed = Placed(total, "uneven", 0, MeasuredError(), (0.0, 0.0), "table", (0.0, 1.0), (0.0, 1.0), 1)
            request = Request(1.0, None, "int16", "--max-error 1rad/s --storage int16")
            options = BuildOptions("other", prefix="rear_axle", precision="double", request=request)
            with mock.patch("codegen.emit.build.choose", return_value=placed):
                write_folder(build(reference_map, config, options, BuildInputs("other.npz", "0" * 64, "preset")), place)
        return place


def can_of(name: str) -> Can:
    """Return `[can]` of a build."""
    return parse(read_manifest(build_of(name))["configuration"], name).can


def prefix_of(name: str) -> str:
    """Return the prefix of a build."""
    return str(read_manifest(build_of(name))["options"]["prefix"])


@functools.cache
def written(name: str, protection: Protection = "transformer", access: Access = "explicit") -> Path:
    """Return the export of a build on disk."""
    with shared.locked(f"autosar {name} {protection} {access}") as path:
        place = path / "autosar"
        if not place.exists():
            write_folder(export(build_of(name), protection, access).folder, place)
        return place


def arxml_of(name: str, protection: Protection = "transformer", access: Access = "explicit") -> Path:
    """Return the ARXML of a build."""
    return written(name, protection, access) / f"{prefix_of(name)}.arxml"


# --- readers ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "variant"), list(itertools.product((*BUILDS, *FRAME_KINDS), VARIANTS)))
def test_the_strict_reader_has_no_warning_and_finds_every_reference(name: str, variant: tuple[Protection, Access]) -> None:
    model, warnings = rte.load(written(name, *variant))
    assert warnings == []
    assert model.check_references() == []
    assert repeated_names(model) == []
    assert all(file.version == autosar_data.AutosarVersion.AUTOSAR_00051 for file in model.files)


OF_THEIR_OWNER = {
    "AR-PACKAGE",
    "IMPLEMENTATION-DATA-TYPE-ELEMENT",  # of an array or record
    "PARAMETER-ACCESS",  # of a runnable
    "P-PORT-PROTOTYPE",  # of a component
    "R-PORT-PROTOTYPE",
    "VARIABLE-DATA-PROTOTYPE",  # of an interface: the functions of the RTE have the name of the port too
}
"""Kinds of elements whose names generators combine with that of their owner, and packages."""
OF_COM = ("I-SIGNAL", "I-SIGNAL-GROUP", "I-SIGNAL-I-PDU", "I-SIGNAL-I-PDU-GROUP")
"""Kinds of elements that become containers of one configuration, that of COM."""


def repeated_names(model: Any) -> list[tuple[str, str]]:
    """Return kind and short name of each repetition that a generator without packages would find."""
    kinds = [(each.element_name, each.item_name) for _, each in model.identifiable_elements]
    kinds += [("COM", name) for kind, name in kinds if kind in OF_COM]
    return sorted(each for each, count in Counter(kinds).items() if count > 1 and each[0] not in OF_THEIR_OWNER)


def test_short_names_are_unique_where_names_in_the_dbc_are_not(tmp_path: Path) -> None:
    """Names of messages, groups and parameters are taken too. cantools decodes a frame with the names of the ARXML."""
    can = e2e_profiles.can_of("11C")
    for role in ("vehicle_motion", "vehicle_conditions", "rear_steer_command"):
        can[role] |= {"crc_name": "Crc", "counter_name": "Counter", "nibble_name": "Nibble"}
    can["vehicle_motion"]["speed"]["name"] = "VehicleMotion"
    can["vehicle_motion"]["front_angle"]["name"] = "VehicleConditions_Group"
    can["vehicle_conditions"]["inhibit"]["name"] = "integral_gain"
    can["vehicle_conditions"]["friction"]["name"] = "VehicleMotion_Crc"
    can["rear_steer_command"]["status"]["name"] = "Dem_EventStatusType"
    config = builds.CONFIG.model_copy(update={"can": car({"can": can}).can})
    write_folder(builds.render(builds.paper_map(), config), tmp_path / "build")
    for protection in get_args(Protection):
        write_folder(export(tmp_path / "build", protection).folder, tmp_path / protection)
        model, warnings = rte.load(tmp_path / protection)
        assert (warnings, model.check_references(), repeated_names(model)) == ([], [], [])
    database = cantools.database.load_file(tmp_path / "transformer" / "ars.arxml")
    message = config.can.vehicle_motion
    data = protect(message.e2e_data_id, 3, bytes(8), PROFILES["11C"])
    assert database.decode_message(message.id, data) == {
        "VehicleMotion_VehicleMotion_Crc": data[0],
        "VehicleMotion_Counter": 3,
        "VehicleMotion_Nibble": 1,
        "Motion_Qualifier": 0,
        "VehicleMotion_VehicleMotion": 0.0,
        "VehicleMotion_VehicleConditions_Group": 0.0,
        "YawRate": 0.0,
    }


def test_names_that_c_reserves_or_that_differ_in_letter_case_are_changed(tmp_path: Path) -> None:
    """Short names begin with a letter and are unique in any letter case (constr_2508), and members of structs are compiled."""
    can: dict[str, Any] = {
        "vehicle_motion": {"crc_name": "CRC", "speed": {"name": "double"}, "yaw_rate": {"name": "_r"}},
        "vehicle_conditions": {"crc_name": "Crc", "friction": {"name": "NULL"}, "inhibit": {"name": "INTEGRAL_gain"}},
        "rear_steer_command": {"status": {"name": "int"}},
    }
    config = builds.CONFIG.model_copy(update={"can": car({"can": can}).can})
    write_folder(builds.render(builds.paper_map(), config), tmp_path / "build")
    place = tmp_path / "autosar"
    write_folder(export(tmp_path / "build").folder, place)
    model, warnings = rte.load(place)
    names = [name.casefold() for name in rte.named(model, "I-SIGNAL")]
    assert (warnings, model.check_references(), sorted(names)) == ([], [], sorted(set(names)))
    changed = {f"VehicleMotion_{name}" for name in ("CRC", "double", "_r")} | {"RearSteerCommand_int"}
    changed |= {f"VehicleConditions_{name}" for name in ("Crc", "NULL", "INTEGRAL_gain")}
    assert changed <= rte.named(model, "I-SIGNAL").keys()
    (tmp_path / "Rte_Ars.h").write_text(rte.Rte(model).files()["rte/Rte_Ars.h"])
    folders = [tmp_path / "build/include", place / "include", tmp_path]
    assert compiled(place / "src/ars_swc.c", folders, tmp_path / "object.o")


@pytest.mark.parametrize(
    ("names", "protection", "words"),
    [
        (("_Motion", "Conditions"), "transformer", "/_Motion: it does not begin with a letter, which AUTOSAR does not allow"),
        (("Ars_Parameters", "Conditions"), "transformer", "/Ars/Interfaces/Ars_Parameters: two elements are called"),
        (("Event_TASK_LATE", "Conditions"), "task", "/Ars/Components/Ars/Event_TASK_LATE: two elements are called"),
        (("Motion", "MOTION_Pdu"), "transformer", "two elements are called Motion_Pdu in any letter case"),
        (("Motion", "Motion_Frame"), "task", "/Ars_System/Pdus/Motion_Frame: two elements"),
    ],
)
def test_messages_with_the_name_of_another_element_are_rejected(
    names: tuple[str, str], protection: str, words: str, refused: Refused, tmp_path: Path
) -> None:
    can = {role: {"name": name} for role, name in zip(("vehicle_motion", "vehicle_conditions"), names, strict=True)}
    config = builds.CONFIG.model_copy(update={"can": car({"can": can}).can})
    write_folder(builds.render(builds.paper_map(), config), tmp_path / "build")
    line = refused("arxml", "--build", tmp_path / "build", "-o", tmp_path / "new", "--e2e", protection)
    assert words in line and "; rename the message" in line
    assert not (tmp_path / "new").exists()


PLACE_OF_LIMITS = (
    "SW-DATA-DEF-PROPS-VARIANTS/SW-DATA-DEF-PROPS-CONDITIONAL/DATA-CONSTR-REF/@/DATA-CONSTR-RULES/DATA-CONSTR-RULE"
)


@pytest.mark.parametrize("name", [*BUILDS, *FRAME_KINDS])
def test_signals_have_the_limits_of_the_dbc(name: str) -> None:
    """In codes; "not available" is a valid code too, and a table of texts is limited to its texts. cantools does not read the
    constraints of an ARXML."""
    model, expected = rte.load(written(name))[0], dict[str, tuple[int, int]]()
    for signal in (each for message in cantools_of(name).messages for each in message.signals):
        codes = list(signal.choices or ())
        if all(text == "not available" for text in (signal.choices or {}).values()):
            codes += [round((limit - signal.offset) / signal.scale) for limit in (signal.minimum, signal.maximum)]
        expected[signal.name] = (min(codes), max(codes))
    for kind, props in (
        ("I-SIGNAL", "NETWORK-REPRESENTATION-PROPS"),
        ("SYSTEM-SIGNAL", "PHYSICAL-PROPS"),
        ("APPLICATION-PRIMITIVE-DATA-TYPE", "SW-DATA-DEF-PROPS"),
    ):
        found = {}
        for each, element in rte.named(model, kind).items():
            for limits in rte.find(element, f"{props}/{PLACE_OF_LIMITS}/INTERNAL-CONSTRS"):
                found[each] = tuple(int(rte.text(limits, f"{side}-LIMIT")) for side in ("LOWER", "UPPER"))
        header = {of for each in can_of(name).messages().values() for of, _ in each.header(can_of(name).e2e.definition)}
        wanted = expected.keys() - header if kind == "APPLICATION-PRIMITIVE-DATA-TYPE" else expected.keys()
        assert found == {each: expected[each] for each in wanted}


ATTRIBUTES_OF_SIGNALS = (
    "start",
    "length",
    "byte_order",
    "is_signed",
    "scale",
    "offset",
    "unit",
    "choices",
    "receivers",
    "raw_initial",
)


@pytest.mark.parametrize("name", [*BUILDS, *FRAME_KINDS])
def test_cantools_reads_the_messages_of_the_dbc(name: str) -> None:
    """Every attribute that both formats have is equal, and so is every signal of 10,000 random frames."""
    dbc = cantools.database.load_file(build_of(name) / f"{prefix_of(name)}.dbc")
    arxml = cantools.database.load_file(arxml_of(name))
    assert [each.name for each in arxml.messages] == [each.name for each in dbc.messages]
    random = np.random.default_rng(12)
    for here, there in zip(arxml.messages, dbc.messages, strict=True):
        for attribute in ("frame_id", "length", "is_extended_frame", "is_fd", "cycle_time", "senders"):
            assert getattr(here, attribute) == getattr(there, attribute), (here.name, attribute)
        assert here.autosar.e2e.category == can_of(name).e2e.definition.category
        assert here.autosar.e2e.data_ids == [there.dbc.attributes["E2eDataId"].value]
        assert here.autosar.e2e.payload_length == there.length
        assert {each.name for each in here.signals} == {each.name for each in there.signals}
        for signal in there.signals:
            other = here.get_signal_by_name(signal.name)
            for attribute in ATTRIBUTES_OF_SIGNALS:
                assert getattr(other, attribute) == getattr(signal, attribute), (signal.name, attribute)
        for data in random.integers(0, 256, (10_000, here.length), dtype=np.uint8):
            assert here.decode(data.tobytes()) == there.decode(data.tobytes())


@pytest.mark.parametrize("name", FRAME_KINDS)
def test_readers_find_the_bit_rates(name: str) -> None:
    """That of the data phase, and that frames switch to it."""
    can, model = can_of(name), rte.load(written(name))[0]
    (bus,) = cantools.database.load_file(arxml_of(name)).buses
    assert (bus.baudrate, bus.fd_baudrate) == (500_000, 2_000_000 if can.is_fd else None)
    switches = [each.character_data for _, each in model.elements_dfs if each.element_name == "TX-BIT-RATE-SWITCH"]
    assert switches == (["true", "true"] if can.is_fd else [])


PLACES = {"COUNTER-OFFSET", "CRC-OFFSET", "DATA-ID-MODE"}
NIBBLE = {"DATA-ID-NIBBLE-OFFSET"}
SYNCHRONISATION = {"MAX-NO-NEW-OR-REPEATED-DATA", "SYNC-COUNTER-INIT"}
BEHAVIOR = {"PROFILE-BEHAVIOR"}
OFFSET = {"OFFSET"}
ATTRIBUTES: dict[ProfileName, set[str]] = {
    "1B": PLACES | SYNCHRONISATION | BEHAVIOR,
    "1C": PLACES | NIBBLE | SYNCHRONISATION | BEHAVIOR,
    "2": OFFSET | SYNCHRONISATION | BEHAVIOR,
    "5": OFFSET,
    "11A": PLACES,
}
"""Attributes of a transformer that a profile requires; the others are not allowed (System Template, constr_3174 and constr_3185
to constr_3194). An end-to-end profile has no OFFSET and no PROFILE-BEHAVIOR, and otherwise the same rule (constr_1118)."""


@pytest.mark.parametrize("profile", list(ATTRIBUTES))
def test_readers_find_the_profile_and_its_data_ids(profile: ProfileName, tmp_path: Path) -> None:
    """cantools takes the data ids from the ARXML and computes the CRC of profiles 2 and 5 from it."""
    build, can = tmp_path / "build", e2e_profiles.config_of(profile).can
    write_folder(e2e_profiles.built(profile).folder, build)
    for protection in get_args(Protection):
        write_folder(export(build, protection).folder, tmp_path / protection)
        model, warnings = rte.load(tmp_path / protection)
        assert warnings == []
        assert model.check_references() == []
        assert repeated_names(model) == []
        found, expected = {each.element_name for _, each in model.elements_dfs}, ATTRIBUTES[profile]
        optional = PLACES | NIBBLE | SYNCHRONISATION | BEHAVIOR | OFFSET
        assert found & optional == (expected if protection == "transformer" else expected - BEHAVIOR - OFFSET)
    database = cantools.database.load_file(tmp_path / "transformer" / "ars.arxml")
    for message, there in zip(can.messages().values(), database.messages, strict=True):
        number, entry = message.e2e_data_id, PROFILES[profile]
        assert there.autosar.e2e.category == entry.category
        assert there.autosar.e2e.data_ids == (list(number) if isinstance(number, bytes) else [number])
        data = protect(number, 3, bytes(range(8)), entry)
        assert there.decode(data, decode_choices=False)[message.counter_name] == 3
        if profile in ("2", "5"):
            check = check_profile2_crc if profile == "2" else check_profile5_crc
            assert check(data, there)


@pytest.mark.parametrize("name", BUILDS)
def test_the_calibration_is_that_of_the_a2l(name: str) -> None:
    """Both formats name the same C objects, with the same sizes, axes and limits."""
    prefix, (model, _) = prefix_of(name), rte.load(written(name))
    default = f"{prefix}_parameters_default."
    expected = {
        each.link.removeprefix(default).partition("[")[0].replace(".", "_"): (
            each.shape[::-1],
            float(each.low),
            float(each.high),
        )
        for each in Layout.of(read_build(build_of(name))).objects.values()
        if each.group != "calibration"
    }
    found = {}
    for each in rte.named(model, "PARAMETER-DATA-PROTOTYPE").values():
        of = rte.one(each, "TYPE-TREF/@")
        limits = rte.one(of, rte.PROPS + "/DATA-CONSTR-REF/@/DATA-CONSTR-RULES/DATA-CONSTR-RULE/PHYS-CONSTRS")
        axes = rte.PROPS + "/SW-CALPRM-AXIS-SET/SW-CALPRM-AXIS/"
        own = [int(rte.text(axis, "SW-MAX-AXIS-POINTS")) for axis in rte.find(of, axes + "SW-AXIS-INDIVIDUAL")]
        shared_axes = [axis.item_name for axis in rte.find(of, axes + "SW-AXIS-GROUPED/SHARED-AXIS-TYPE-REF/@")]
        low, high = (float(rte.text(limits, tag)) for tag in ("LOWER-LIMIT", "UPPER-LIMIT"))
        found[each.item_name] = (own, shared_axes, low, high)
    assert found.keys() == expected.keys()
    for member, (own, shared_axes, low, high) in found.items():
        sizes = [found[axis][0][0] for axis in shared_axes] or own
        # The A2L rounds the limits of raw tables to nine digits.
        assert (tuple(sizes), pytest.approx(low, rel=1e-8), pytest.approx(high, rel=1e-8)) == expected[member], member
        if shared_axes and member.startswith(f"{prefix}_map"):
            assert shared_axes == [f"{prefix}_map_{axis}_breakpoints" for axis in ("front_angle", "speed")]
            assert own == ([4] if name == "other" else [])  # frictions of the stack


def test_debouncing_counts_samples() -> None:
    model, _ = rte.load(written("4ws2"))
    counter = "DIAG-EVENT-DEBOUNCE-ALGORITHM/DIAG-EVENT-DEBOUNCE-COUNTER-BASED/COUNTER-{}-THRESHOLD"
    found = {
        name: tuple(
            int(rte.text(each, f"SERVICE-NEEDS/DIAGNOSTIC-EVENT-NEEDS/{counter.format(side)}")) for side in ("FAILED", "PASSED")
        )
        for name, each in rte.named(model, "SWC-SERVICE-DEPENDENCY").items()
    }
    assert found.keys() == {*(each.name for each in DIAGNOSTIC_CAUSES), "PARAMETERS_REJECTED"}
    # 0.1 s and 1 s at 10 ms; the generated C has counted samples already.
    assert found["MOTION_WRONG_CRC"] == (10, -100)
    assert found["ACTUATOR_STUCK"] == (1, -100)


# --- the component on an RTE -----------------------------------------------------------------------------------------------


@functools.cache
def component(name: str, protection: Protection, access: Access = "explicit") -> tuple[Any, Any]:
    """Return the component on an RTE of its own ARXML as a library, and the model."""
    folder = written(name, protection, access)
    model, _ = rte.load(folder)
    sources = dict(read_files(build_of(name), read_manifest(build_of(name)), ("include/", "src/")))
    sources |= read_files(folder, read_manifest(folder), ("include/", "src/"))
    library = compile_library(
        f"autosar_{protection}_{access}",
        {**sources, **rte.Rte(model).files()},
        ["rte/stub.h"],
        include_folders=("include", "rte"),
        flags=(*DEFAULT_FLAGS, "-pedantic"),
        unit_flags={
            f"src/{prefix_of(name)}_swc.c": ("-Wconversion", "-Wsign-conversion", "-Wshadow", "-Wcast-qual", "-Wundef")
        },
    )
    return library.lib, model


@functools.cache
def drive(name: str) -> tuple[list[tuple[Frame, ...]], list[Frame]]:
    """Return the frames of the paper's whole scenario in the SIL: those that came in each cycle, and those sent."""
    software = load(build_of(name))
    return record(software, find("step-steer", software.config))


def events_of(library: Any) -> set[str]:
    """Return the events of the last sample that were reported as prefailed (3), not as prepassed (2)."""
    reports = {each: getattr(library, f"rte_Event_{each.name}") for each in DIAGNOSTIC_CAUSES}
    assert set(reports.values()) <= {2, 3}
    return {each.name for each, report in reports.items() if report == 3}


def causes_of(name: str, data: bytes) -> set[str]:
    """Return the names of the bits of `Diagnostics` in a command."""
    signal = OTHER["rear_steer_command"]["diagnostics"]["name"] if name == "other" else "Diagnostics"
    message = cantools_of(name).get_message_by_name("RearSteerCommand")
    bits = message.decode(data, scaling=False, decode_choices=False)[signal]
    return {each.name for each in DIAGNOSTIC_CAUSES if bits >> each.bit & 1}


@functools.cache
def cantools_of(name: str) -> Any:
    """Return the DBC of a build."""
    return cantools.database.load_file(build_of(name) / f"{prefix_of(name)}.dbc")


def through_transformer(
    name: str, cycles: list[tuple[Frame, ...]], access: Access = "explicit", checks_again: bool = False
) -> list[tuple[int, bytes]]:
    """Run the component for the frames of each cycle, with COM and E2E in the RTE; return the frames that it sends."""
    library, model = component(name, "transformer", access)
    com, sent = rte.Com(library, model, arxml_of(name, "transformer", access), checks_again), []
    library.rte_Run_Init()
    for frames in cycles:
        com.receive({frame.id: frame.data for frame in frames})
        library.rte_Run_Step()
        sent.append(com.send())
        assert events_of(library) == causes_of(name, sent[-1][1])
    return sent


def on_raw_frames(name: str, cycles: list[tuple[Frame, ...]]) -> list[tuple[int, bytes]]:
    """Run the component that checks frames itself."""
    library, _ = component(name, "task")
    messages = {each.frame_id: each.name for each in cantools.database.load_file(arxml_of(name, "task")).messages}
    (identifier,) = (each for each, message in messages.items() if message == "RearSteerCommand")
    library.rte_Run_Init()
    sent = []
    for frames in cycles:
        for frame in frames:
            port = messages[frame.id]
            queue, index = getattr(library, f"rte_{port}"), getattr(library, f"rte_{port}_written")
            for place, byte in enumerate(frame.data):
                queue[index % len(queue)][place] = byte
            setattr(library, f"rte_{port}_written", index + 1)
        library.rte_Run_Step()
        sent.append((identifier, bytes(library.rte_RearSteerCommand)))
        assert events_of(library) == causes_of(name, sent[-1][1])
    return sent


through_transformer_again = functools.partial(through_transformer, checks_again=True)
"""On an RTE that checks the last frame again while none arrives."""
implicitly, implicitly_again = (
    functools.partial(each, access="implicit") for each in (through_transformer, through_transformer_again)
)
ON_RTE = {
    "explicit": through_transformer,
    "explicit again": through_transformer_again,
    "implicit": implicitly,
    "implicit again": implicitly_again,
    "raw": on_raw_frames,
}


def check_scenario(name: str, on_rte: str) -> None:
    """Check that a build on the RTE sends the frames of the SIL in a whole scenario."""
    cycles, sent = drive(name)
    assert len(sent) > 1000
    assert ON_RTE[on_rte](name, cycles) == [(frame.id, frame.data) for frame in sent]


@pytest.mark.parametrize(
    ("on_rte", "name"),
    [("explicit", "other"), ("explicit", FRAME_KINDS[1]), ("implicit", "4ws2"), ("raw", "4ws2"), ("raw", FRAME_KINDS[0])],
)
def test_a_whole_scenario_on_the_rte_has_the_bits_of_the_sil(name: str, on_rte: str) -> None:
    """tests/evidence/kinds has every build."""
    check_scenario(name, on_rte)


REPEATED = 200
"""Cycle with a repeated frame."""


def disturbed(cycles: list[tuple[Frame, ...]]) -> list[tuple[Frame, ...]]:
    """Return the cycles with lost, damaged and repeated frames, and a silence."""
    changed = [list(frames) for frames in cycles[:600]]
    changed[100] = changed[100][1:]  # lost
    conditions = changed[150][1]
    changed[150][1] = Frame(conditions.id, bytes((conditions.data[0] ^ 1, *conditions.data[1:])))
    changed[REPEATED][0] = changed[REPEATED - 1][0]
    for cycle in range(300, 330):
        changed[cycle] = []
    for cycle in range(400, 420, 2):  # so many that the messages become invalid
        changed[cycle] = [Frame(frame.id, bytes(8)) for frame in changed[cycle]]
    return [tuple(frames) for frames in changed]


@pytest.mark.parametrize("on_rte", ON_RTE)
def test_disturbed_frames_give_the_commands_of_the_task(on_rte: str) -> None:
    """Angle, reference and status are those of the task. So are the diagnostics, with two exceptions: a transformer cannot tell
    a repeated frame from a missing one, and does not report lost frames within its tolerance, which count for INTERMITTENT."""
    cycles, task, expected = disturbed(drive("4ws2")[0]), load(build_of("4ws2")).task(), []
    for frames in cycles:
        for frame in frames:
            task.on_can_frame(frame.id, frame.data)
        expected.append(task.run())
    found = ON_RTE[on_rte]("4ws2", cycles)
    seen: set[str] = set()
    for cycle, ((identifier, data), (_, wanted)) in enumerate(zip(found, expected, strict=True)):
        assert (identifier, data[1:6]) == (0x201, wanted[1:6]), cycle
        causes = causes_of("4ws2", wanted)
        seen |= causes
        if on_rte != "raw":
            causes -= {"INTERMITTENT"}
            if cycle == REPEATED:
                causes = causes - {"MOTION_WRONG_COUNTER"} | {"MOTION_MISSING"}
            assert causes_of("4ws2", data) - {"INTERMITTENT"} == causes, cycle
    assert seen >= {"MOTION_MISSING", "CONDITIONS_WRONG_CRC", "MOTION_WRONG_COUNTER", "SPEED_REPLACED"}
    if on_rte == "raw":
        assert found == expected


@pytest.mark.parametrize("access", get_args(Access))
def test_other_codes_of_the_rte_mean_a_missing_frame(access: Access) -> None:
    """MAX_AGE_EXCEEDED, COM_STOPPED, NEVER_RECEIVED, UNCONNECTED and HARD_TRANSFORMER_ERROR of SWS_RTE."""
    library, model = component("4ws2", "transformer", access)
    com, cycles = rte.Com(library, model, arxml_of("4ws2", "transformer", access)), iter(drive("4ws2")[0])
    library.rte_Run_Init()

    def events_with(status: int | None) -> set[str]:
        """Return the events of a sample with good frames, the first of which has a status instead of that of COM."""
        com.receive({frame.id: frame.data for frame in next(cycles)})
        if status is not None:
            library.rte_VehicleMotion_status = status
        library.rte_Run_Step()
        return events_of(library)

    for _ in range(10):  # until both messages are valid
        events_with(None)
    for status in (64, 128, 133, 134, 138):
        assert events_with(None) == set()
        assert events_with(status) == {"MOTION_MISSING"}, status


def test_parameters_of_the_rte_act_and_invalid_ones_do_not() -> None:
    cycles, sent = drive("4ws2")
    library, model = component("4ws2", "transformer")
    rate, signals = library.rte_limiter_rear_rate_max, cantools_of("4ws2")

    def fastest(frames: list[tuple[int, bytes]]) -> float:
        angles = [signals.decode_message(*each, decode_choices=False)["RearAngleCommand"] for each in frames[100:]]
        return float(np.abs(np.diff(angles)).max())

    def run_with(at_start: float, later: float) -> list[tuple[int, bytes]]:
        """Run with a parameter at the start, and another value of it from the first sample on."""
        com, frames_sent = rte.Com(library, model, arxml_of("4ws2")), []
        library.rte_limiter_rear_rate_max = at_start
        library.Ars_Init()
        library.rte_limiter_rear_rate_max = later
        for cycle, frames in enumerate(cycles):
            if cycle % 100 == 0:
                library.Ars_Calibrate()
            com.receive({frame.id: frame.data for frame in frames})
            library.Ars_Step()
            frames_sent.append(com.send())
        return frames_sent

    try:
        usual = [(frame.id, frame.data) for frame in sent]
        slow = run_with(0.1, 0.1)
        # 0.1 rad/s for 10 ms, and half a code of rounding at either end.
        assert fastest(slow) == pytest.approx(1e-3, abs=5.1e-5)
        assert fastest(usual) > 2e-3
        assert library.rte_Event_PARAMETERS_REJECTED == 2
        assert run_with(rate, 0.1) == slow
        assert run_with(0.1, rate) == usual
        assert run_with(-1.0, -1.0) == usual
        assert library.rte_Event_PARAMETERS_REJECTED == 3
        assert run_with(0.1, -1.0) == slow
    finally:
        library.rte_limiter_rear_rate_max = rate


def test_initial_parameters_are_those_of_the_build() -> None:
    library, _ = component("4ws2", "transformer")
    software = load(build_of("4ws2"))
    compared = 0

    def compare(struct: Any, values: Any, path: str) -> None:
        nonlocal compared
        for name, about in struct.fields:
            value, name = getattr(values, name), f"{path}_{name}".strip("_")
            if about.type.kind == "struct":
                compare(about.type, value, name)
            else:
                found = getattr(library, f"rte_{name}")
                assert (list(found) == list(value)) if about.type.kind == "array" else (found == value), name
                compared += 1

    compare(software.ffi.typeof("ars_parameters_t"), software.function("parameters_default"), "")
    assert compared == len([name for name in dir(library) if name.startswith("rte_") and name[4].islower()])


@pytest.mark.parametrize("variant", VARIANTS[1:])
def test_the_adapter_breaks_no_required_rule_of_misra(variant: tuple[Protection, Access], tmp_path: Path) -> None:
    folder = written("4ws2", *variant)
    sources = dict(read_files(build_of("4ws2"), read_manifest(build_of("4ws2")), ("include/",)))
    sources |= read_files(folder, read_manifest(folder), ("include/", "src/"))
    rte_files = rte.Rte(rte.load(folder)[0]).files()
    sources["include/Rte_Ars.h"] = rte_files["rte/Rte_Ars.h"].encode()
    for path, content in sources.items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_bytes(content)
    found = [each for each in judged_by_misra(tmp_path) if each.file == "src/ars_swc.c"]
    assert found
    assert {each.rule for each in found} <= ADVISORY


# --- memory sections ------------------------------------------------------------------------------------------------------


def compiled(source: Path, folders: list[Path], out: Path) -> dict[str, bytes]:
    """Return name -> content of the sections of an object file that a program loads."""
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", *(f"-I{folder}" for folder in folders)]
    subprocess.run([*compiler_command(), *flags, "-c", source, "-o", out], check=True, capture_output=True)
    with out.open("rb") as file:
        allocated = 2  # SHF_ALLOC
        return {each.name: each.data() for each in ELFFile(file).iter_sections() if each["sh_flags"] & allocated}


def test_the_implementation_names_the_sources_that_the_component_needs() -> None:
    """All of the build, and the adapter, without the dynamics."""
    model, _ = rte.load(written("4ws2"))
    (implementation,) = rte.named(model, "SWC-IMPLEMENTATION").values()
    artifacts = "CODE-DESCRIPTORS/CODE/ARTIFACT-DESCRIPTORS/AUTOSAR-ENGINEERING-OBJECT/SHORT-LABEL"
    found = {str(each.character_data) for each in rte.find(implementation, artifacts)}
    sources = {path for path in read_manifest(build_of("4ws2"))["files"] if path.startswith("src/")}
    assert found == sources - {"src/ars_dynamics.c"} | {"src/ars_swc.c"}


def test_the_adapter_compiles_with_the_names_of_older_releases(tmp_path: Path) -> None:
    """The RTE defines the error of a transformer up to R19-11, and Std_Types.h since."""
    place, objects = written("4ws2"), []
    header = rte.Rte(rte.load(place)[0]).files()["rte/Rte_Ars.h"]
    for text in (header, header.replace("Std_Transformer", "Rte_Transformer").replace("STD_TRANSFORMER", "RTE_TRANSFORMER")):
        (tmp_path / "Rte_Ars.h").write_text(text)
        folders = [build_of("4ws2") / "include", place / "include", tmp_path]
        objects.append(compiled(place / "src/ars_swc.c", folders, tmp_path / "object.o"))
    assert objects[0] == objects[1]


def test_sources_between_sections_compile_to_the_same_objects(tmp_path: Path) -> None:
    place, build_folder = written("4ws2"), build_of("4ws2")
    units = [path.stem for path in sorted((build_folder / "src").glob("*.c"))]
    assert {path.stem for path in (place / "memmap").iterdir()} == {f"{unit}_memmap" for unit in units}
    for unit in units:
        folders = [build_folder / "include", build_folder / "src", place / "include"]
        inside = compiled(place / "memmap" / f"{unit}_memmap.c", folders, tmp_path / "object.o")
        assert inside == compiled(build_folder / "src" / f"{unit}.c", folders, tmp_path / "object.o"), unit


def test_the_sections_of_the_memory_map_are_those_of_the_arxml_and_close() -> None:
    model, _ = rte.load(written("4ws2"))
    text = (written("4ws2") / "include/Ars_MemMap.h").read_text()
    named = set(re.findall(r"defined\(Ars_START_SEC_(\w+)\)", text))
    assert named == set(rte.named(model, "SW-ADDR-METHOD"))
    for path in (*(written("4ws2") / "memmap").iterdir(), written("4ws2") / "src/ars_swc.c"):
        opened: list[str] = []
        for way, section in re.findall(r"#define Ars_(START|STOP)_SEC_(\w+)\n#include \"Ars_MemMap.h\"", path.read_text()):
            assert section in named
            if way == "START":
                opened.append(section)
            else:
                opened.remove(section)
        assert not opened, path.name


# --- the command ----------------------------------------------------------------------------------------------------------


def test_the_command_writes_the_folder_once(run: Run, tmp_path: Path) -> None:
    command = ("arxml", "--build", build_of("4ws2"), "-o", tmp_path / "autosar")
    assert "E2E by the transformer, explicit access" in run(*command).out
    content = {path.relative_to(tmp_path): path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert "(unchanged)" in run(*command).out
    assert not [path for path, text in content.items() if str(GENERATED).encode() in text or b"UUID" in text]
    assert json.loads(run(*command, "--e2e", "task", "--json").out)["e2e"] == "task"
    assert json.loads(run(*command, "--access", "implicit", "--json").out)["access"] == "implicit"
    assert read_manifest(tmp_path / "autosar")["options"]["access"] == "implicit"


def test_implicit_access_to_raw_frames_is_rejected(refused: Refused, tmp_path: Path) -> None:
    command = ("arxml", "--build", build_of("4ws2"), "-o", tmp_path / "new", "--e2e", "task", "--access", "implicit")
    assert "implicit access cannot read the queues of raw frames; give --e2e transformer" in refused(*command)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("can", "message"),
    [
        ({"e2e": {"max_error_state_init": 1}}, "max_error_state_invalid = 2 is above max_error_state_init = 1"),
        ({"e2e": {"min_ok_state_init": 4}}, "min_ok_state_init = 4 is above min_ok_state_invalid = 3"),
        ({"e2e": {"window_size": 4}}, "min_ok_state_valid + max_error_state_valid = 5 is above window_size = 4"),
        ({"e2e": {"max_delta_counter_init": 0}}, "max_delta_counter_init = 0 is below 1"),
        (
            {**frame_kinds.KINDS["FD, 24 bytes, profile 11C, 29 bits"], "e2e": {"profile": "1C"}},
            "[can.vehicle_conditions]: the data id 0xFF is below 0x100",
        ),
    ],
    ids=["errors", "good frames", "window", "counter", "data id"],
)
def test_settings_that_autosar_does_not_allow_for_a_transformer_are_rejected(
    can: dict[str, Any], message: str, refused: Refused, tmp_path: Path
) -> None:
    if "frame_bytes" in can:
        can = {**can, "vehicle_conditions": {**can["vehicle_conditions"], "data_id": 0xFF}}
    config = builds.CONFIG.model_copy(update={"can": car({"can": can}).can})
    write_folder(builds.render(builds.paper_map(), config, "single"), tmp_path / "build")
    assert message in refused("arxml", "--build", tmp_path / "build", "-o", tmp_path / "new")
    assert not (tmp_path / "new").exists()
    assert export(tmp_path / "build", "task").arxml


def test_other_folders_and_changed_files_are_kept(refused: Refused, tmp_path: Path) -> None:
    place = tmp_path / "autosar"
    write_folder(export(build_of("4ws2")).folder, place)
    (place / "include/Ars_MemMap.h").write_text("/* pragmas */\n")
    line = refused("arxml", "--build", build_of("4ws2"), "-o", place)
    assert "include/Ars_MemMap.h was changed since it was written" in line
    assert "inside a generated folder" in refused("arxml", "--build", build_of("4ws2"), "-o", place / "more")
    assert "is missing" in refused("arxml", "--build", tmp_path, "-o", tmp_path / "new")
    assert "made from a build, but is not one itself" in refused("arxml", "--build", place, "-o", tmp_path / "new")


def test_unsuitable_builds_are_rejected(refused: Refused, tmp_path: Path) -> None:
    place = Path(shutil.copytree(build_of("4ws2"), tmp_path / "changed"))
    manifest, calibration = place / "manifest.json", place / "src/ars_calibration.c"
    kept = manifest.read_text()
    manifest.write_text(kept.replace(f'"version": "{__version__}"', '"version": "0.0.1"'))
    assert "made by codegen 0.0.1" in refused("arxml", "--build", place, "-o", tmp_path / "new")
    manifest.write_text(kept)
    calibration.write_text(re.sub(r"(\.trim_share = 0\.0)\d", r"\g<1>9", calibration.read_text()))
    assert "ars_calibration.c was changed after the build" in refused("arxml", "--build", place, "-o", tmp_path / "new")

"""The AUTOSAR export: what independent readers find in the ARXML, and the component on an RTE that is made from it."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import autosar_data
import cantools
import numpy as np
import pytest

from codegen.emit.can_view import DIAGNOSTICS
from codegen.emit.folder import read_files, read_manifest
from codegen.emit.write import write_folder
from codegen.export.arxml.export import Protection, export
from codegen.export.firmware import record
from codegen.sil.compile import DEFAULT_FLAGS, compile_library
from codegen.sil.software import load
from hil_sim.codec import Frame
from hil_sim.scenarios import find
from tests import shared
from tests.cli.conftest import Answer, refused, run
from tests.export import rte

__all__ = ["refused", "run"]  # fixtures

Run, Refused = Callable[..., Answer], Callable[..., str]
GENERATED = Path(__file__).parents[2] / "generated"
BUILDS = ("4ws2", "4ws2-paper")
PROTECTIONS: tuple[Protection, ...] = ("transformer", "task")


@functools.cache
def written(name: str, protection: Protection = "transformer") -> Path:
    """Return the export of a committed build on disk."""
    with shared.locked(f"autosar {name} {protection}") as path:
        place = path / "autosar"
        if not place.exists():
            write_folder(export(GENERATED / name, protection).folder, place)
        return place


@pytest.mark.parametrize(("name", "protection"), list(itertools.product(BUILDS, PROTECTIONS)))
def test_the_strict_reader_has_no_warning_and_finds_every_reference(name: str, protection: Protection) -> None:
    model, warnings = rte.load(written(name, protection))
    assert warnings == []
    assert model.check_references() == []
    assert {str(file.version) for file in model.files} == {str(autosar_data.AutosarVersion.AUTOSAR_00051)}


@pytest.mark.parametrize("name", BUILDS)
def test_cantools_reads_the_messages_of_the_dbc(name: str) -> None:
    """Every attribute that both formats have is equal, and so is every signal of 10,000 random frames."""
    dbc = cantools.database.load_file(GENERATED / name / "ars.dbc")
    arxml = cantools.database.load_file(written(name) / "ars.arxml")
    assert [each.name for each in arxml.messages] == [each.name for each in dbc.messages]
    random = np.random.default_rng(12)
    for here, there in zip(arxml.messages, dbc.messages, strict=True):
        for attribute in ("frame_id", "length", "is_extended_frame", "is_fd", "cycle_time", "senders"):
            assert getattr(here, attribute) == getattr(there, attribute), (here.name, attribute)
        assert here.autosar.e2e.category == "PROFILE_01"
        assert here.autosar.e2e.data_ids == [there.dbc.attributes["E2eDataId"].value]
        assert here.autosar.e2e.payload_length == there.length
        assert {each.name for each in here.signals} == {each.name for each in there.signals}
        for signal in there.signals:
            other = here.get_signal_by_name(signal.name)
            for attribute in ("start", "length", "byte_order", "is_signed", "scale", "offset", "unit", "choices", "receivers"):
                assert getattr(other, attribute) == getattr(signal, attribute), (signal.name, attribute)
        for data in random.integers(0, 256, (10_000, 8), dtype=np.uint8):
            assert here.decode(data.tobytes()) == there.decode(data.tobytes())


@functools.cache
def component(name: str, protection: Protection) -> tuple[Any, Any]:
    """Return the component on an RTE of its own ARXML as a library, and the model."""
    build, folder = GENERATED / name, written(name, protection)
    model, _ = rte.load(folder)
    sources = dict(read_files(build, read_manifest(build), ("include/", "src/")))
    sources |= read_files(folder, read_manifest(folder), ("include/", "src/"))
    library = compile_library(
        f"autosar_{protection}",
        {**sources, **rte.Rte(model).files()},
        ["rte/stub.h"],
        include_folders=("include", "rte"),
        flags=(*DEFAULT_FLAGS, "-pedantic"),
    )
    return library.lib, model


@functools.cache
def drive(name: str) -> tuple[list[tuple[Frame, ...]], list[Frame]]:
    """Return the frames of the whole scenario of the paper in the SIL: those that came in each cycle, and those sent."""
    software = load(GENERATED / name)
    return record(software, find("step-steer", software.config))


def events_of(library: Any) -> set[str]:
    """Return the events of the last sample that were reported as prefailed (3), not as prepassed (2)."""
    reports = {each: getattr(library, f"rte_Event_{each.name}") for each in DIAGNOSTICS}
    assert set(reports.values()) <= {2, 3}
    return {each.name for each, report in reports.items() if report == 3}


def causes_of(data: bytes) -> set[str]:
    """Return the names of the bits of `Diagnostics` in a command."""
    bits = int.from_bytes(data[6:], "little")
    return {each.name for each in DIAGNOSTICS if bits >> each.bit & 1}


def through_transformer(name: str, cycles: list[tuple[Frame, ...]]) -> list[tuple[int, bytes]]:
    """Run the component for the frames of each cycle, with COM and E2E in the RTE; return the frames that it sends."""
    library, model = component(name, "transformer")
    com, sent = rte.Com(library, model, written(name) / "ars.arxml"), []
    library.Ars_Init()
    for frames in cycles:
        com.receive({frame.id: frame.data for frame in frames})
        library.Ars_Step()
        sent.append(com.send())
        assert events_of(library) == causes_of(sent[-1][1])
    return sent


def on_raw_frames(name: str, cycles: list[tuple[Frame, ...]]) -> list[tuple[int, bytes]]:
    """Run the component that checks frames itself."""
    library, model = component(name, "task")
    ports = {each.frame_id: each.name for each in cantools.database.load_file(written(name) / "ars.arxml").messages}
    sent = []
    library.Ars_Init()
    for frames in cycles:
        for frame in frames:
            port = ports[frame.id]
            queue, index = getattr(library, f"rte_{port}"), getattr(library, f"rte_{port}_written")
            for place, byte in enumerate(frame.data):
                queue[index % len(queue)][place] = byte
            setattr(library, f"rte_{port}_written", index + 1)
        library.Ars_Step()
        sent.append((0x201, bytes(library.rte_RearSteerCommand)))
        assert events_of(library) == causes_of(sent[-1][1])
    return sent


@pytest.mark.parametrize("name", BUILDS)
@pytest.mark.parametrize("on_rte", [through_transformer, on_raw_frames])
def test_a_whole_scenario_on_the_rte_has_the_bits_of_the_sil(name: str, on_rte: Any) -> None:
    cycles, sent = drive(name)
    assert len(sent) > 1000
    assert on_rte(name, cycles) == [(frame.id, frame.data) for frame in sent]


def disturbed(cycles: list[tuple[Frame, ...]]) -> list[tuple[Frame, ...]]:
    """Return the cycles with lost, damaged and repeated frames, and a silence."""
    motion = [list(frames) for frames in cycles[:600]]
    motion[100] = motion[100][1:]  # lost
    motion[150][1] = Frame(motion[150][1].id, bytes((motion[150][1].data[0] ^ 1, *motion[150][1].data[1:])))
    motion[200][0] = motion[199][0]  # repeated
    for cycle in range(300, 330):
        motion[cycle] = []
    for cycle in range(400, 420, 2):  # the messages become invalid
        motion[cycle] = [Frame(frame.id, bytes(8)) for frame in motion[cycle]]
    return [tuple(frames) for frames in motion]


@pytest.mark.parametrize("on_rte", [through_transformer, on_raw_frames])
def test_disturbed_frames_give_the_commands_of_the_task(on_rte: Any) -> None:
    """Angle, reference and status are those of the task; so are the diagnostics, except for the state of the bus."""
    cycles, task, expected = disturbed(drive("4ws2")[0]), load(GENERATED / "4ws2").task(), []
    for frames in cycles:
        for frame in frames:
            task.on_can_frame(frame.id, frame.data)
        expected.append(task.run())
    found = on_rte("4ws2", cycles)
    seen: set[str] = set()
    for cycle, ((identifier, data), (_, wanted)) in enumerate(zip(found, expected, strict=True)):
        assert (identifier, data[1:6]) == (0x201, wanted[1:6]), cycle
        assert causes_of(data) - {"INTERMITTENT"} == causes_of(wanted) - {"INTERMITTENT"}, cycle
        seen |= causes_of(wanted)
    assert seen >= {"MOTION_MISSING", "CONDITIONS_WRONG_CRC", "MOTION_WRONG_COUNTER", "SPEED_REPLACED"}
    if on_rte is on_raw_frames:
        assert found == expected

"""Batches of calls for the emulated cores, and the rows that drive them."""

import functools
from typing import Any

import numpy as np
import pytest

from codegen.emit.can_view import DIAGNOSTICS
from codegen.sil.software import Status
from codegen.verify import traffic
from codegen.verify.drives import Ground
from codegen.verify.pil import stimuli
from codegen.verify.pil.batches import Program, Rows, program_of, rows_of_cycles
from codegen.verify.pil.runners import OnHost, OnTarget
from codegen.verify.pil.stimuli import Source, specials
from codegen.verify.target.cross import POWERPC_BE
from hil_sim.runs import run_through_can
from hil_sim.scenarios import SCENARIOS
from tests.verify import builds

TRACKING = builds.made("tracking", "uneven")
COUNT = 4_000


@functools.cache
def program() -> Program:
    return program_of(builds.compiled(), TRACKING.files)


@functools.cache
def host() -> OnHost:
    return OnHost(program())


def source(seed: int = 0) -> Source:
    return Source(Ground.of(TRACKING.manifest), np.uint32, np.random.default_rng(seed))


def column(batch: str, rows: Rows, name: str) -> Rows:
    return rows[:, [output.name for output in program().batches[batch].outputs].index(name)]


@pytest.mark.parametrize("batch", ["controller", "limiter", "task"])
def test_every_number_of_a_state_is_an_output_once(batch: str) -> None:
    """Together they are as many as the struct has without its pointers."""

    def numbers(declared: Any, name: str) -> list[str]:
        if declared.kind == "struct":
            return [each for field, of in declared.fields for each in numbers(of.type, f"{name}.{field}")]
        return [] if declared.kind == "pointer" else [name]

    names = [output.name for output in program().batches[batch].outputs if output.name.startswith("state.")]
    assert sorted(names) == sorted(numbers(builds.compiled().ffi.typeof(f"ars_{batch}_t"), "state"))


def test_long_batches_are_run_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    batch = program().batches["limiter"]
    rows = source().numbers(batch, 500)
    target = OnTarget(program(), POWERPC_BE)
    whole = target.run(batch, rows)
    monkeypatch.setattr("codegen.verify.pil.runners.DATA_BYTES", 1024)
    assert (target.run(batch, rows) == whole).all()
    assert target.run(batch, rows[:0]).shape == (0, len(batch.outputs))


@pytest.mark.parametrize(("word", "real"), [(np.uint32, np.float32), (np.uint64, np.float64)])
def test_special_numbers(word: stimuli.Word, real: type) -> None:
    """Of both signs, and quiet and signalling NaN."""
    words = specials(word)
    numbers, limits = words.view(real), np.finfo(real)
    for number in (0.0, limits.smallest_subnormal, limits.tiny, limits.max, np.inf, 1.0):
        assert {number, -number} <= set(numbers.tolist())
    payloads = words[np.isnan(numbers)]
    quiet = (payloads >> np.array(limits.nmant - 1, dtype=word)) & np.array(1, dtype=word)
    assert 4 <= int(quiet.sum()) <= len(payloads) - 4
    assert len(set(words.tolist())) == len(words)


def test_random_steps_reach_every_status_and_hold_every_kind_of_number() -> None:
    """The tour at their start reaches every status alone, and returns to control from both ways into the fail-safe."""
    batch = program().batches["controller"]
    rows = source().steps(batch, COUNT)
    assert len(rows) == COUNT
    for place in range(1, 7):
        numbers = rows[:, place].view(np.float32)
        assert np.isinf(numbers).any()
        assert (np.isnan(numbers) & (rows[:, place] & 0x400000 == 0)).any()  # a signalling one
        assert ((np.abs(numbers) < np.finfo(np.float32).tiny) & (numbers != 0.0)).any()
    assert set(rows[:, 7].tolist()) == {0, 1}
    tour = rows[: int(np.flatnonzero(rows[:, 0])[1])]
    status = column("controller", host().run(batch, tour), "command.status")
    assert set(status.tolist()) == set(Status)
    assert len(np.flatnonzero((status[1:] == Status.FAIL_SAFE) & (status[:-1] != Status.FAIL_SAFE))) == 2
    assert status[-1] in (Status.TRACKING, Status.LIMITED)
    assert (rows == source().steps(batch, COUNT)).all()
    assert (rows != source(1).steps(batch, COUNT)).any()


def test_disturbed_traffic_sets_every_diagnostic_and_reaches_every_status() -> None:
    software, batch = builds.compiled(), program().batches["task"]
    _, cycles = traffic.closed_loop(software)
    disturbed = traffic.disturbed(software.config, cycles, 2_000)
    assert max(map(len, disturbed)) <= traffic.FRAMES
    results = host().run(batch, rows_of_cycles(disturbed, batch, np.uint32, traffic.restarts_of(2_000)))
    causes = np.bitwise_or.reduce(column("task", results, "data[4..7]") >> 16)
    assert causes == 2 ** len(DIAGNOSTICS) - 1
    assert set(column("task", results, "state.controller.status").tolist()) == set(Status)
    assert set(column("task", results, "complete").tolist()) == {0, 1}


def test_the_recorded_scenario_is_the_closed_loop() -> None:
    """Played back, its frames make the task repeat the commands that the bench received."""
    software, batch = builds.compiled(), program().batches["task"]
    name, cycles = traffic.closed_loop(software)
    results = host().run(batch, rows_of_cycles(cycles, batch, np.uint32))
    commands = run_through_can(software, SCENARIOS[name]).record[:, 7]
    codes = (column("task", results, "data[0..3]") >> 16).astype(np.int16)
    assert len(cycles) == len(commands)
    started = np.flatnonzero(codes != -32768)
    assert len(started) > 1_000
    np.testing.assert_array_equal(codes[started], np.rint(commands[started] * 20_000.0).astype(np.int16))
    assert np.abs(codes[started]).max() > 100

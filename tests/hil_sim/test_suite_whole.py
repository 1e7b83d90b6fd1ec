"""The controller under test and its baselines, and the parts of the whole suite.

The whole suite runs in `tests/evidence/drives/test_suite_drives.py`.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from codegen import configuration
from codegen.configuration import Config, Kind
from codegen.emit.write import write_folder
from codegen.errors import BuildError, CodegenError, ConfigError
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_stack
from hil_sim import second_plant
from hil_sim.suite import full_suite, subjects
from hil_sim.suite.background import Background
from hil_sim.suite.full_suite import run_full_suite
from hil_sim.suite.subjects import (
    PASSIVE,
    Candidate,
    Comparison,
    baseline_configs,
    of_config,
    of_folder,
    recommended,
    recommended_config,
)
from hil_sim.suite.tracking import SuiteResult
from tests import builds

PAPER, BEST = builds.CONFIG, configuration.preset("recommended")
MESSAGES = ("vehicle_motion", "vehicle_conditions", "rear_steer_command")
SMALL = PAPER.replace({"grid": {"speed_points": 5, "front_angle_points": 5}})


def of_kind(config: Config, kind: Kind) -> Config:
    return config.replace({"controller": {"kind": kind}})


def written(at: Path, reference_map: ReferenceMap, config: Config) -> Path:
    write_folder(builds.render(reference_map, config), at / "sample")
    return at / "sample"


@pytest.fixture
def tuned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the gain design by a fixed schedule."""
    tracking = {"controller": {"tracking": {"schedule": builds.SCHEDULE}}}
    for module in (subjects, full_suite):
        monkeypatch.setattr(module, "tuned", lambda _, config, steps=None: config.replace(tracking))


def test_each_candidate_has_its_baselines() -> None:
    own = PAPER.replace({"controller": {"integral_gain": 0.3}})
    for config, names in (
        (BEST, ["tracking", "pi", "feedforward", "proportional"]),
        (PAPER, ["pi", "tracking", "feedforward", "proportional"]),
        (own, ["pi", "tracking", "pi (paper)", "feedforward", "proportional"]),
        (of_kind(BEST, "feedforward"), ["feedforward", "tracking", "pi", "proportional"]),
    ):
        contenders = Candidate("x", config, "4ws-2", (0.9,)).contenders()
        assert list(contenders) == names
        assert next(iter(contenders.values())) == config
    best = Candidate("x", PAPER, "4ws-2", (0.9,)).contenders()["tracking"]
    assert (best.controller, best.limiter, best.vehicle) == (BEST.controller, BEST.limiter, PAPER.vehicle)
    contenders = Candidate("x", own, "4ws-2", (0.9,)).contenders()
    assert (contenders["pi"].controller.integral_gain, contenders["pi (paper)"].controller.integral_gain) == (0.3, 1.0)
    found = recommended()
    assert (found.name, found.case, found.frictions, found.folder, found.config) == ("tracking", "4ws-2", (0.9,), None, BEST)


def test_baselines_keep_the_users_sampling_time() -> None:
    quick = BEST.replace({"controller": {"sampling_time_s": 0.005}, "can": {name: {"cycle_time_ms": 5.0} for name in MESSAGES}})
    for config in (*baseline_configs(quick).values(), recommended_config(quick)):
        assert config.controller.sampling_time_s == 0.005
        assert configuration.parse(config.model_dump(), "test") == config  # and the whole is consistent


@pytest.mark.usefixtures("tuned")
def test_line_up_tunes_each_contender_with_a_schedule() -> None:
    found = Candidate("x", BEST.replace({"grid": {"speed_points": 5}}), "4ws-2", (0.9,)).comparison()
    assert [each.name for each in found.baselines] == ["pi", "feedforward", "proportional"]
    assert found.tested.config.controller.tracking.schedule is not None
    assert (found.notes, found.build) == ((), found.tested.around)
    assert found.build.generated.manifest["options"]["kind"] == "tracking"


def test_a_build_is_tested_with_its_own_files_and_gains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ready = builds.CONFIGS["tracking"]
    folder = written(tmp_path, builds.paper_map(), ready)
    source = folder / "src" / "ars_controller.c"
    source.write_text(source.read_text(encoding="ascii") + "/* by hand */\n", encoding="ascii")
    monkeypatch.setattr(subjects, "tuned", lambda *given: pytest.fail("tuned again"))
    comparison = of_folder(folder).comparison()
    generated = comparison.build.generated
    assert generated.files["src/ars_controller.c"].endswith(b"/* by hand */\n")
    assert generated.edited == ("src/ars_controller.c",)
    assert comparison.tested.config == ready
    assert [each.name for each in comparison.baselines] == ["pi", "feedforward", "proportional"]


def test_a_stack_stays_a_stack_and_a_build_that_cannot_be_solved_again_is_refused(tmp_path: Path) -> None:
    found = of_folder(written(tmp_path, solve_stack(SMALL, "4ws-2", (0.5, 0.9)), SMALL))
    assert found.frictions == (0.5, 0.9)
    assert [layer.value for layer in found.reference_map().layers] == [0.5]
    solved = builds.paper_map()
    bare = ReferenceMap(solved.speed, solved.front_angle, np.where(solved.feasible, solved.yaw_rate, np.nan), solved.feasible)
    with pytest.raises(BuildError, match="cannot be solved again"):
        of_folder(written(tmp_path / "bare", bare, PAPER))
    for text in ('{"generator": "codegen", "files": {}}', '{"generator": "codegen", "files": {}, "inputs": 1}'):
        (tmp_path / "manifest.json").write_text(text, encoding="ascii")
        with pytest.raises(BuildError, match="build again"):
            of_folder(tmp_path)


def test_background_returns_results_and_errors_and_ends_its_processes(tmp_path: Path) -> None:
    with Background() as background:
        root, refused = background.call(math.sqrt, 9.0), background.call(configuration.load, tmp_path / "ars.toml")
        assert root.get() == 3.0
        with pytest.raises(ConfigError, match=r"ars\.toml: cannot be read .*; name an ars"):
            refused.get()
        background.call(time.sleep, 3600.0)
        workers = background.processes
        assert workers
    assert not any(worker.is_alive() for worker in workers)


@pytest.mark.usefixtures("tuned")
@pytest.mark.parametrize("kind", ["tracking", "pi"])
def test_a_job_uses_its_own_car(monkeypatch: pytest.MonkeyPatch, kind: Kind) -> None:
    """It is solved, tuned and built for the third party's car, here replaced by a heavier paper car."""
    heavy = of_kind(SMALL, kind).replace({"vehicle": {"mass_kg": 2500.0}})
    monkeypatch.setattr(second_plant, "published", lambda: "parameters")
    monkeypatch.setattr(second_plant, "car_of", lambda parameters, base: heavy if parameters == "parameters" else base)
    monkeypatch.setattr("hil_sim.suite.subjects.compile_build", lambda files, manifest, plant, edited: plant)
    seen: list[Any] = []

    def drive(reference_map: ReferenceMap, config: Config, software: Any, *, controlled: bool) -> tuple[Any, ...]:
        seen.append((reference_map.config, config.controller.kind, software == config, controlled))
        return ("driven",)

    monkeypatch.setattr(full_suite, "third_party_cells", drive)
    jobs = full_suite.third_party_jobs({kind: of_kind(BEST, kind)}, "4ws-2")
    assert list(jobs) == [kind, PASSIVE]
    assert [job() for job in jobs.values()] == [("driven",), ("driven",)]
    assert seen == [(heavy, kind, True, True), (heavy, "pi", True, False)]  # a passive car needs no tuning


class SynchronousBackground(nullcontext):
    """Replacement for Background that runs calls in this process, at `get`."""

    def __enter__(self) -> "SynchronousBackground":
        return self

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return SimpleNamespace(get=lambda: function(*arguments))


@pytest.mark.parametrize("installed", [True, False])
def test_the_whole_collects_its_parts(monkeypatch: pytest.MonkeyPatch, installed: bool) -> None:
    """A figure that cannot be measured leaves a note. Results without simulation replace those of the suite."""

    def refuse(*given: Any) -> Any:
        raise CodegenError("not installed", where="ziglang", remedy="install it")

    tested = of_config("pi", builds.paper_map(), PAPER)
    bare = SuiteResult("pi", ("pi",), (), (), "", {"pi": {}}, {"pi": {}}, (), {}, {}, {})
    monkeypatch.setattr(Candidate, "comparison", lambda self, steps: Comparison(tested, (), PAPER.case("4ws-2"), ("a note",)))
    monkeypatch.setattr(full_suite, "Background", SynchronousBackground)
    monkeypatch.setattr(full_suite, "run_suite", lambda *given, progress: (progress("x", 0, 1), bare)[1])
    monkeypatch.setattr(full_suite, "has_third_party", lambda: installed)
    monkeypatch.setattr(full_suite, "third_party_jobs", lambda contenders, case: {"pi": refuse})
    stages: dict[str, list[tuple[int, int]]] = {}

    @contextmanager
    def stage(title: str) -> Iterator[Callable[[int, int], None]]:
        yield lambda done, total: stages.setdefault(title, []).append((done, total))

    count = refuse if installed else (lambda files, manifest: len(files))
    found = run_full_suite(Candidate("x", PAPER, "4ws-2", (0.9,)), count, stage)
    assert found.edited == ()
    assert stages["driving"] == [(1, 1)]
    last = stages["third party's plant and instructions"]
    if installed:
        missing = "ziglang: not installed; install it"
        driven = f"pi was not simulated on the third party's plant: {missing}"
        assert found.notes == ("a note", driven, f"the instructions of a step were not counted: {missing}")
        assert (found.result.third_party, found.result.instructions, last) == ({}, None, [(1, 2), (2, 2)])
    else:
        assert found.notes[0] == "a note" and found.notes[1].endswith('; pip install "commonroad-vehicle-models>=3.0.2,<3.1"')
        assert found.result.requirements[-1].measured == found.result.instructions > 10
        assert last == [(1, 1)]

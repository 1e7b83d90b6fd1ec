"""Where the controller under test comes from, what it is shown beside, and the suite as a whole."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen import config as configuration
from codegen.config import Config, Kind
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.write import write_folder
from codegen.errors import BuildError, CodegenError, ConfigError
from codegen.refmap.map import ReferenceMap
from codegen.refmap.solve import solve_case
from codegen.refmap.stack import solve_stack
from hil_sim import second_plant
from hil_sim.suite import candidate, third_party, tracking, whole
from hil_sim.suite.background import Background
from hil_sim.suite.candidate import Candidate, of_folder, recommended
from hil_sim.suite.conditions import NOMINAL
from hil_sim.suite.plants import changed
from hil_sim.suite.subjects import PASSIVE, baseline_configs, recommended_config, tuned
from hil_sim.suite.whole import run_whole

ONE_CAR = {
    "tuning": {
        "speed_km_h": [30.0, 60.0],
        "actuator_lag_s": [0.05],
        "mass_percent": [0.0],
        "stiffness_percent": [0.0],
        "relaxation_length_m": [0.0],
    },
    "grid": {"speed_points": 21, "front_angle_min_deg": 0.5, "front_angle_points": 20},
}
"""A family of one car and a coarse grid: gains and maps are soon made."""

PAPER = changed(configuration.preset(), ONE_CAR)
BEST = changed(configuration.preset("recommended"), ONE_CAR)

Write = Callable[..., Path]


@pytest.fixture
def written(tmp_path: Path) -> Write:
    """`written(map, config)`: what `codegen build` leaves."""

    def write(reference_map: ReferenceMap, config: Config) -> Path:
        folder = build(reference_map, config, BuildOptions("sample"), BuildInputs("sample.npz", "0" * 64, "map"))
        write_folder(folder, tmp_path / "sample")
        return tmp_path / "sample"

    return write


def of_kind(config: Config, kind: Kind) -> Config:
    return config.model_copy(update={"controller": config.controller.model_copy(update={"kind": kind})})


# --- who is driven -----------------------------------------------------------------------------------------------------


def test_recommended_preset_is_shown_beside_all_baselines() -> None:
    found = recommended()
    assert (found.name, found.case, found.frictions, found.folder) == ("tracking", "4ws-2", (0.9,), None)
    assert list(found.contenders()) == ["tracking", "pi", "feedforward", "proportional"]
    assert found.config == configuration.preset("recommended")


def test_papers_build_is_shown_beside_the_recommended_controller() -> None:
    found = Candidate("x", configuration.preset(), "4ws-2", (0.9,))
    contenders = found.contenders()
    assert list(contenders) == ["pi", "tracking", "feedforward", "proportional"]
    best = configuration.preset("recommended")
    assert contenders["tracking"].controller == best.controller
    assert contenders["tracking"].limiter == best.limiter
    assert contenders["tracking"].vehicle == found.config.vehicle


def test_a_pi_of_the_users_own_is_shown_beside_the_papers() -> None:
    own = changed(configuration.preset(), {"controller": {"integral_gain": 0.3}})
    contenders = Candidate("x", own, "4ws-2", (0.9,)).contenders()
    assert list(contenders) == ["pi", "tracking", "pi (paper)", "feedforward", "proportional"]
    assert (contenders["pi"].controller.integral_gain, contenders["pi (paper)"].controller.integral_gain) == (0.3, 1.0)


def test_a_baseline_under_test_is_not_its_own_baseline() -> None:
    contenders = Candidate("x", of_kind(BEST, "feedforward"), "4ws-2", (0.9,)).contenders()
    assert list(contenders) == ["feedforward", "tracking", "pi", "proportional"]


def test_baselines_keep_the_users_sampling_time() -> None:
    messages = {name: {"cycle_time_ms": 5.0} for name in ("vehicle_motion", "vehicle_conditions", "rear_steer_command")}
    quick = changed(configuration.preset("recommended"), {"controller": {"sampling_time_s": 0.005}, "can": messages})
    for config in (*baseline_configs(quick).values(), recommended_config(quick)):
        assert config.controller.sampling_time_s == 0.005
        assert configuration.parse(config.model_dump(), "test") == config  # and are consistent as a whole


def test_line_up_tunes_what_needs_it() -> None:
    found = Candidate("x", BEST, "4ws-2", (0.9,)).line_up()
    assert [each.name for each in found.baselines] == ["pi", "feedforward", "proportional"]
    assert found.tested.config == tuned(BEST)
    assert found.tested.config.controller.tracking.schedule is not None
    assert found.notes == ()
    assert found.build is found.tested.around
    assert found.build.generated.manifest["options"]["kind"] == "tracking"


def test_a_build_is_tested_with_its_own_files(written: Write) -> None:
    folder = written(solve_case(PAPER, "4ws-2"), PAPER)
    source = folder / "src" / "ars_controller.c"
    source.write_text(source.read_text(encoding="ascii") + "/* by hand */\n", encoding="ascii")
    line_up = of_folder(folder).line_up()
    generated = line_up.build.generated
    assert generated.files["src/ars_controller.c"].endswith(b"/* by hand */\n")
    assert generated.edited == ("src/ars_controller.c",)
    assert line_up.tested.config == PAPER
    assert [each.name for each in line_up.baselines] == ["tracking", "feedforward", "proportional"]


def test_a_tuned_build_is_not_tuned_again(written: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    ready = tuned(BEST)
    folder = written(solve_case(BEST, "4ws-2"), ready)
    monkeypatch.setattr(candidate, "tuned", lambda *given: pytest.fail("tuned again"))
    assert of_folder(folder).line_up().tested.config == ready


def test_a_stack_stays_a_stack(written: Write) -> None:
    found = of_folder(written(solve_stack(PAPER, "4ws-2", (0.5, 0.9)), PAPER))
    assert found.frictions == (0.5, 0.9)
    assert [layer.friction for layer in found.reference_map().layers] == [0.5]


def test_a_build_of_a_users_own_table_is_refused(written: Write) -> None:
    solved = solve_case(PAPER, "4ws-2")
    bare = ReferenceMap(solved.speed, solved.front_angle, np.where(solved.feasible, solved.yaw_rate, np.nan), solved.feasible)
    with pytest.raises(BuildError, match="cannot be solved again"):
        of_folder(written(bare, PAPER))


@pytest.mark.parametrize(
    "text", ['{"generator": "codegen", "files": {}}', '{"generator": "codegen", "files": {}, "inputs": 1}']
)
def test_a_manifest_without_its_facts_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "manifest.json").write_text(text, encoding="ascii")
    with pytest.raises(BuildError, match="build it again"):
        of_folder(tmp_path)


def test_what_cannot_be_tuned_is_left_out_beside_and_refused_under_test() -> None:
    def refuse(*given: Any) -> Config:
        raise ConfigError("no gains meet the demands", where="[tuning]", remedy="ask for less")

    beside = Candidate("x", PAPER, "4ws-2", (0.9,))
    under_test = Candidate("x", BEST, "4ws-2", (0.9,))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(candidate, "tuned", refuse)
        line_up = beside.line_up()
        assert [each.name for each in line_up.baselines] == ["feedforward", "proportional"]
        assert line_up.notes == ("tracking is not shown beside: [tuning]: no gains meet the demands; ask for less",)
        with pytest.raises(ConfigError, match="no gains"):
            under_test.line_up()


# --- processes of their own --------------------------------------------------------------------------------------------


def test_calls_run_elsewhere_and_their_errors_come_back(tmp_path: Path) -> None:
    missing = tmp_path / "ars.toml"
    with Background() as background:
        root, refused = background.call(math.sqrt, 9.0), background.call(configuration.load, missing)
        assert root.get() == 3.0
        with pytest.raises(ConfigError, match=r"ars\.toml: cannot be read .*; check the path"):
            refused.get()


def test_at_the_end_everything_is_stopped() -> None:
    with Background() as background:
        background.call(time.sleep, 3600.0)
        assert background.processes
        workers = background.processes
    assert not any(worker.is_alive() for worker in workers)


# --- the third party's plant -------------------------------------------------------------------------------------------


def test_a_job_for_each_contender_and_the_passive_car() -> None:
    made = third_party.jobs(recommended().contenders(), "4ws-2")
    assert list(made) == ["tracking", "pi", "feedforward", "proportional", PASSIVE]
    assert [job.controlled for job in made.values()] == [True] * 4 + [False]


@pytest.mark.parametrize("kind", ["tracking", "pi"])
def test_a_job_is_for_a_car_of_its_own(monkeypatch: pytest.MonkeyPatch, kind: Kind) -> None:
    """Solved, tuned and built for the third party's car; here the paper's with more mass stands in for it."""
    heavy = changed(of_kind(BEST, kind), {"vehicle": {"mass_kg": 2500.0}})
    monkeypatch.setattr(second_plant, "published", lambda: "parameters")
    monkeypatch.setattr(second_plant, "car_of", lambda parameters, base: heavy if parameters == "parameters" else base)
    seen: list[Any] = []

    def drive(reference_map: ReferenceMap, config: Config, software: Any, *, controlled: bool) -> tuple[Any, ...]:
        seen.extend((reference_map.config, config, software.config, controlled))
        return ("driven",)

    monkeypatch.setattr(third_party, "third_party_cells", drive)
    assert third_party.Job(of_kind(BEST, kind), "4ws-2")() == ("driven",)
    ready = tuned(heavy) if kind == "tracking" else heavy
    assert seen == [heavy, ready, ready, True]
    assert third_party.Job(BEST, "4ws-2", controlled=False)() == ("driven",)
    assert seen[5].controller.kind == "pi"  # nothing to tune for a car without control
    assert seen[7] is False


# --- the whole ---------------------------------------------------------------------------------------------------------


class AtOnce:
    """Stands in for Background: calls in this process, when they are asked for."""

    def __enter__(self) -> AtOnce:
        return self

    def __exit__(self, *given: object) -> None:
        pass

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return type("Answer", (), {"get": lambda self: function(*arguments)})()


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """One condition, four cells, no processes, and no plant of a third party."""
    points = tracking.cells
    monkeypatch.setattr(tracking, "conditions", lambda config: (NOMINAL,))
    monkeypatch.setattr(tracking, "cells", lambda config, case: points(config, case)[:4])
    monkeypatch.setattr(whole, "Background", AtOnce)
    monkeypatch.setattr(third_party, "available", lambda: False)


@pytest.mark.usefixtures("quick")
def test_whole_suite_of_a_candidate() -> None:
    told: dict[str, list[tuple[int, int]]] = {}

    @contextmanager
    def stage(title: str) -> Iterator[Callable[[int, int], None]]:
        steps = told.setdefault(title, [])
        yield lambda done, total: steps.append((done, total))

    counted: list[str] = []

    def count(files: Any, manifest: Any) -> int:
        counted.append(manifest["options"]["kind"])
        return len(files)

    found = run_whole(Candidate("x", BEST, "4ws-2", (0.9,)), count, stage)
    assert found.result.subjects == ("tracking", "pi", "feedforward", "proportional", "passive")
    assert counted == ["tracking"]
    assert found.result.instructions is not None
    assert found.result.requirements[-1].measured == found.result.instructions > 10
    assert found.notes == (whole.THIRD_PARTY_MISSING,)
    assert list(told) == ["tuning", "driving", "third party's plant and instructions"]
    assert all(steps[-1][0] == steps[-1][1] for steps in told.values())
    assert [shown.cell.speed_km_h for shown in found.result.shown] == [42.5]  # the cells at 25 km/h are not among those shown
    c1 = found.result.c1
    assert c1["tracking"]["lag-50"].overshoot_percent < 0.2 * c1["pi"]["lag-50"].overshoot_percent


@pytest.mark.usefixtures("quick")
def test_what_cannot_be_had_from_outside_is_noted(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*given: Any) -> Any:
        raise CodegenError("not installed", where="ziglang", remedy="install it")

    monkeypatch.setattr(third_party, "available", lambda: True)
    monkeypatch.setattr(third_party, "jobs", lambda contenders, case: {"tracking": refuse})
    found = run_whole(Candidate("x", of_kind(PAPER, "pi"), "4ws-2", (0.9,)), refuse)
    assert found.notes == (
        "tracking was not driven on the third party's plant: ziglang: not installed; install it",
        "the instructions of a step were not counted: ziglang: not installed; install it",
    )
    assert found.result.third_party == {}
    assert found.result.instructions is None

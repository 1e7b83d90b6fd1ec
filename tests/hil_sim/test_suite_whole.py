"""The controller under test and its baselines, and the parts that the whole suite is made of.

The whole suite, driven, is in `tests/evidence/drives/test_suite_drives.py`.
"""

import math
import time
from pathlib import Path

import numpy as np
import pytest

from codegen import config as configuration
from codegen.config import Config, Kind
from codegen.emit.write import write_folder
from codegen.errors import BuildError, ConfigError
from codegen.refmap.map import ReferenceMap
from codegen.refmap.stack import solve_stack
from hil_sim.suite import candidate
from hil_sim.suite.background import Background
from hil_sim.suite.candidate import Candidate, of_folder
from hil_sim.suite.plants import changed
from tests import builds

PAPER, BEST = builds.CONFIG, configuration.preset("recommended")
SMALL = changed(PAPER, {"grid": {"speed_points": 5, "front_angle_points": 5}})


def of_kind(config: Config, kind: Kind) -> Config:
    return changed(config, {"controller": {"kind": kind}})


def written(at: Path, reference_map: ReferenceMap, config: Config) -> Path:
    write_folder(builds.render(reference_map, config), at / "sample")
    return at / "sample"


def test_each_candidate_has_its_baselines() -> None:
    own = changed(PAPER, {"controller": {"integral_gain": 0.3}})
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


def test_a_build_is_tested_with_its_own_files_and_gains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ready = builds.CONFIGS["tracking"]
    folder = written(tmp_path, builds.paper_map(), ready)
    source = folder / "src" / "ars_controller.c"
    source.write_text(source.read_text(encoding="ascii") + "/* by hand */\n", encoding="ascii")
    monkeypatch.setattr(candidate, "tuned", lambda *given: pytest.fail("tuned again"))
    line_up = of_folder(folder).line_up()
    generated = line_up.build.generated
    assert generated.files["src/ars_controller.c"].endswith(b"/* by hand */\n")
    assert generated.edited == ("src/ars_controller.c",)
    assert line_up.tested.config == ready
    assert [each.name for each in line_up.baselines] == ["pi", "feedforward", "proportional"]


def test_a_stack_stays_a_stack_and_a_build_that_cannot_be_solved_again_is_refused(tmp_path: Path) -> None:
    found = of_folder(written(tmp_path, solve_stack(SMALL, "4ws-2", (0.5, 0.9)), SMALL))
    assert found.frictions == (0.5, 0.9)
    assert [layer.friction for layer in found.reference_map().layers] == [0.5]
    solved = builds.paper_map()
    bare = ReferenceMap(solved.speed, solved.front_angle, np.where(solved.feasible, solved.yaw_rate, np.nan), solved.feasible)
    with pytest.raises(BuildError, match="cannot be solved again"):
        of_folder(written(tmp_path / "bare", bare, PAPER))
    for text in ('{"generator": "codegen", "files": {}}', '{"generator": "codegen", "files": {}, "inputs": 1}'):
        (tmp_path / "manifest.json").write_text(text, encoding="ascii")
        with pytest.raises(BuildError, match="build it again"):
            of_folder(tmp_path)


def test_background_calls_and_their_errors_come_back_and_its_processes_end(tmp_path: Path) -> None:
    with Background() as background:
        root, refused = background.call(math.sqrt, 9.0), background.call(configuration.load, tmp_path / "ars.toml")
        assert root.get() == 3.0
        with pytest.raises(ConfigError, match=r"ars\.toml: cannot be read .*; check the path"):
            refused.get()
        background.call(time.sleep, 3600.0)
        workers = background.processes
        assert workers
    assert not any(worker.is_alive() for worker in workers)

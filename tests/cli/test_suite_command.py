"""`codegen suite` and `codegen sil --baselines` at the command line."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from codegen import configuration
from codegen.errors import CodegenError
from codegen.figures import suites as suite_charts
from hil_sim.suite import cars, full_suite, references
from hil_sim.suite.cars import CarResult, CarsResult
from hil_sim.suite.full_suite import FullSuite
from hil_sim.suite.requirements import Limits, car_requirements, load
from hil_sim.suite.runs import summarise
from hil_sim.suite.subjects import Candidate
from hil_sim.suite.tracking import ExternalFigures, SuiteResult
from tests.report import test_references as made_references
from tests.report.made_suite import CELLS, SUBJECTS, cell_result, made, margins, with_table

from .conftest import Refused, Run, everything_in

SMALL_TUNING = {"speed_km_h": [30.0, 60.0], "actuator_lag_s": [0.05], "mass_percent": [0.0]}
SMALL_TUNING |= {"stiffness_percent": [0.0], "relaxation_length_m": [0.0]}


@pytest.fixture(scope="module")
def good() -> SuiteResult:
    return made()


@pytest.fixture
def suite(monkeypatch: pytest.MonkeyPatch, here: Path) -> Callable[..., list[Candidate]]:
    """Return `suite(result)`, which replaces the simulation of the whole suite by a result and returns the list of its
    candidates."""

    def give(result: SuiteResult, **more: Any) -> list[Candidate]:
        seen: list[Candidate] = []
        found = FullSuite(**{"result": result, "edited": (), "notes": (), **more})
        monkeypatch.setattr(full_suite, "run_full_suite", lambda tested, count, stage, limits: (seen.append(tested), found)[1])
        return seen

    return give


def test_suite_of_the_recommended_preset(run: Run, suite: Callable[..., list[Candidate]], good: SuiteResult) -> None:
    seen = suite(good, notes=("a note",))
    answer = run("suite", "tracking")
    assert answer.code == 0, answer
    first, *lines = answer.out.splitlines()
    assert first == "suite tracking: the recommended preset, case 4ws-2, solved, tuned and built in memory"
    assert "Requirements, and results of tracking" in lines
    assert seen[0].config == configuration.preset("recommended")
    assert everything_in(Path()) == {}
    answer = run("suite", "tracking", "--json", "--plot", "overview.png")
    data = json.loads(answer.out)
    assert (data["tested"], data["passed"], data["subjects"]) == ("tracking", True, list(SUBJECTS))
    assert (data["build"], data["notes"], data["pictures"], answer.err) == (None, ["a note"], ["overview.png"], "")


def test_the_earlier_form(run: Run, suite: Callable[..., list[Candidate]], good: SuiteResult) -> None:
    suite(good)
    new, old = run("suite", "tracking"), run("sil", "--suite", "tracking")
    assert (old.code, old.out) == (new.code, new.out)
    assert old.err == "note: `codegen suite tracking` is the new form of `codegen sil --suite tracking`\n"


def test_a_missed_figure_is_a_failed_check(run: Run, suite: Callable[..., list[Candidate]], good: SuiteResult) -> None:
    wide = tuple(cell_result("tracking", cell, "nominal", sideslip_excess_deg=1.25) for cell in CELLS)
    suite(with_table(good, "tracking", "nominal", wide))
    answer = run("suite", "tracking")
    assert answer.code == 1
    assert "NOT MET" in answer.out
    figure = "all cells, as configured: |sideslip| beyond its bound 1.25 deg (at most 0.2 deg)"
    assert answer.err == f"error: 1 figure misses its requirement: {figure}; see the first table\n"


def test_a_limits_file_that_is_too_large_names_its_limit(tmp_path: Path) -> None:
    (tmp_path / "large.toml").write_bytes(b"#" * (2**16 + 1))
    with pytest.raises(CodegenError, match="over 64 KiB;"):
        load(tmp_path / "large.toml")


def test_limits_from_a_file_and_their_purpose(run: Run, suite: Callable[..., list[Candidate]], good: SuiteResult) -> None:
    wide = tuple(cell_result("tracking", cell, "nominal", sideslip_excess_deg=1.25) for cell in CELLS)
    missed = with_table(good, "tracking", "nominal", wide)
    suite(missed)
    why = "sideslip_excess_deg = 0.2: beyond the map's bound"
    assert why in run("suite", "tracking").out
    Path("mine.toml").write_text("sideslip_excess_deg = 1.5\n", encoding="utf-8")
    assert load(Path("mine.toml")).sideslip_excess_deg == 1.5
    suite(missed.with_outside(ExternalFigures(missed.third_party, missed.instructions), load(Path("mine.toml"))))
    answer = run("suite", "tracking", "--limits", "mine.toml", "--json")
    assert answer.code == 0 and json.loads(answer.out)["limits"]["sideslip_excess_deg"] == 1.5


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("overshot_percent = 1.0", "mine.toml: overshot_percent: unknown key; did you mean 'overshoot_percent'?"),
        ("overshoot_percent = -1.0", "mine.toml: overshoot_percent: -1 is outside 0 to 1000 %; check the value and its unit"),
        ("instructions = 1.5", "mine.toml: instructions: a whole number is needed, not 1.5"),
    ],
)
def test_an_invalid_file_of_limits(refused: Refused, here: Path, text: str, words: str) -> None:
    Path("mine.toml").write_text(text, encoding="utf-8")
    assert words in refused("suite", "tracking", "--limits", "mine.toml")


def car(number: int, overshoot: float, error: str = "", roll: float = 4.0) -> CarResult:
    summaries = {
        plant: summarise("tracking", plant, [cell_result("tracking", CELLS[-1], "x", overshoot_percent=value)])
        for plant, value in (("nominal", overshoot), ("roll", roll), ("ideal", 9.0))
    }
    loop = margins(stable=True)
    rows = car_requirements(f"car {number}", summaries, loop, Limits())
    return CarResult(number, 2000.0, 2.9, 1.0, 5.0, 0.05, {}, {} if error else summaries, loop, () if error else rows, error)


def test_suite_of_random_cars(run: Run, monkeypatch: pytest.MonkeyPatch, here: Path) -> None:
    asked = []

    def give(seed: int, count: int, steps: object, limits: object) -> CarsResult:
        asked.append((seed, count))
        return CarsResult(seed, tuple(car(number, 4.0) for number in range(1, count + 1)))

    monkeypatch.setattr(cars, "run_cars", give)
    answer = run("suite", "cars")
    assert answer.code == 0, answer
    assert (
        "8 of 8 cars meet all limits" in answer.out and "car 1: 2,000 kg, 2.90 m, 1.00 deg/g, 5.0 deg, 50 ms: all" in answer.out
    )
    data = json.loads(run("suite", "cars", "--cars", "2", "--seed", "5", "--json").out)
    assert (data["seed"], data["passed"], len(data["cars"]), asked) == (5, 2, 2, [(1, 8), (5, 2)])
    assert data["passed_on"] == {"nominal": 2, "roll": 2, "ideal": 0}
    mixed = CarsResult(1, (car(1, 4.0), car(2, 5.5), car(3, 1.0, "no gains"), car(4, 4.0, roll=6.0)))
    monkeypatch.setattr(cars, "run_cars", lambda *_: mixed)
    answer = run("suite", "cars", "--cars", "4")
    assert answer.code == 1 and "car 2: 2,000 kg" in answer.out
    assert "1 of 4 cars meet all limits; on each plant alone: 2 as configured, 2 roll plant, 0 ideal plant" in answer.out
    missed = "car 2: overshoot 5.50 % (at most 5 %); car 3: no gains; car 4: overshoot, roll plant 6.00 % (at most 5 %)"
    expected = f"error: 1 of 4 cars meet all limits: {missed}; see the tables"
    assert answer.err.splitlines()[-1] == expected


def test_suite_of_references(run: Run, refused: Refused, monkeypatch: pytest.MonkeyPatch, here: Path) -> None:
    seen: list[Candidate] = []
    result = made_references.made()
    monkeypatch.setattr(references, "run_references", lambda candidate, _: (seen.append(candidate), result)[1])
    monkeypatch.setattr(suite_charts, "pictures", lambda shown: {"price": suite_charts.price_picture(shown)})
    answer = run("suite", "references", "--plot", "overview.png", "-o", "pictures")
    assert answer.code == 0, answer
    assert answer.out.startswith("suite references: the recommended preset\n\nReferences under the same controller")
    assert "plot: overview.png" in answer.out and "plot: pictures/price.png" in answer.out
    assert Path("overview.png").read_bytes() == Path("pictures/overview.png").read_bytes()
    data = json.loads(run("suite", "references", "--json").out)
    assert (data["same_as"], data["feasible_percent"]["pi"], data["pictures"]) == ({"envelope": "pi"}, 20.0, [])
    assert "requirements" not in data and data["configuration"].startswith("the recommended preset")
    assert [candidate.config for candidate in seen] == [configuration.preset("recommended")] * 2
    Path("limits.toml").write_text("", encoding="utf-8")
    assert "--limits: this suite has no limits; leave it out" in refused("suite", "references", "--limits", "limits.toml")

"""The library from `import codegen` alone: the session of the guide, errors of input, and the names that are promised."""

import ast
import inspect
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import jsonschema
import numpy as np
import pytest

import codegen as ars
from codegen.configuration import preset_text
from codegen.library.result import Work

ROOT = Path(__file__).resolve().parents[2]
SMALL = {"grid.speed_points": 11, "grid.front_angle_points": 10}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("session")


@pytest.fixture(scope="module")
def solved() -> ars.SolvedMap:
    return ars.solve(ars.preset("paper").replace(SMALL), case="4ws-2")


@pytest.fixture(scope="module")
def build(folder: Path) -> ars.Build:
    return ars.build(ROOT / "generated/4ws2-paper.npz", folder / "paper")


@pytest.fixture(scope="module")
def run(build: ars.Build) -> ars.Run:
    return ars.run(build, "step-steer", speed_km_h=60.0)


def test_a_session(folder: Path) -> None:
    """The lines of the guide, with the paper's controller, which needs no tuning; tests/cli tunes."""
    created = ars.init(folder / "car", "paper")
    config = ars.load_config(created.path).replace({"vehicle.mass_kg": 1950.0, **SMALL})
    m = ars.solve(config, case="4ws-2")
    assert m.save(folder / "4ws2.npz") == m.path
    again = ars.load_map(folder / "4ws2.npz")
    assert again.config == m.config and again.config.vehicle.mass_kg == 1950.0
    b = ars.build(m, folder / "4ws2")
    assert b.changed and (b.folder / "src/ars_controller.c").is_file() and not ars.build(again, folder / "4ws2").changed
    assert ars.build(again, folder / "4ws2", write=False).differences == []
    assert ars.load_build(folder / "4ws2").config == m.config


def test_the_schema_of_a_configuration() -> None:
    schema = ars.schema()
    check = jsonschema.Draft202012Validator(schema).is_valid
    jsonschema.Draft202012Validator.check_schema(schema)
    for name in ("paper", "recommended"):
        text = preset_text(name)
        data = tomllib.loads(text)
        assert check(data) and text.startswith("#:schema ./ars.schema.json\n")
        for value, is_valid in ((2100.0, True), (-5.0, False), ("heavy", False)):
            assert check({**data, "vehicle": {**data["vehicle"], "mass_kg": value}}) is is_valid
        assert not check({**data, "vehicle": {**data["vehicle"], "mas_kg": 2100.0}})
    mass = schema["$defs"]["Vehicle"]["properties"]["mass_kg"]
    assert mass["description"] == "m, with the load of normal operation; 200 to 60000 kg"


def test_progress_is_a_rising_share(build: ars.Build) -> None:
    shares: list[float] = []
    few = {"grid.speed_points": 4, "grid.front_angle_points": 3}
    frictions = np.array([0.5, 0.9])
    ars.solve(ars.preset("paper").replace(few), method="ipopt", friction=frictions, progress=shares.append)
    assert shares == sorted(set(shares)) and 0.0 < shares[0] < shares[-1] == 1.0
    shares.clear()
    ars.run(build, "step-steer", progress=shares.append)
    assert shares == sorted(set(shares)) and shares[-1] == 1.0


def test_stages_are_named_and_not_counted() -> None:
    shares: list[float] = []
    work = Work(shares.append, "first", "left out", "last")
    with work.stage("first") as tell:
        tell(1, 2)
    with work.status("last", "the last one"):
        pass
    assert shares == pytest.approx([1 / 6, 1 / 3, 1.0])
    for name in ("first", "last", "another"):
        with pytest.raises(ValueError, match=name), work.status(name):
            pass


def test_every_named_stage_is_begun() -> None:
    named, begun = set[str](), set[str]()
    for path in (*ROOT.glob("codegen/library/*.py"), *ROOT.glob("hil_sim/suite/*.py")):
        for call in (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)):
            function, texts = ast.unparse(call.func), [each.value for each in call.args if isinstance(each, ast.Constant)]
            if function == "Work":
                named |= {each.value for each in ast.walk(call) if isinstance(each, ast.Constant)}
            elif re.fullmatch(r"(work\.)?(stage|status)", function):
                begun |= set(texts[:1])
    assert named | {"controller"} == begun  # `_Given.stages`
    assert len(named) > 10


def test_a_check_has_the_judgement_of_the_map() -> None:
    found, tuned = ars.check(ROOT / "generated/4ws2.npz"), ars.load_map(ROOT / "generated/4ws2.npz")
    assert found.judgement == tuned.judgement is not None and found.kind == "map" and found.failure is not None
    assert set(tuned.judgement.warnings) <= set(found.warnings)


def test_arrays_of_a_map(solved: ars.SolvedMap, folder: Path) -> None:
    shape = (solved.speed_m_s.size, solved.front_angle_rad.size)
    assert shape == (11, 10) == solved.yaw_rate_rad_s.shape == solved.rear_angle_rad.shape == solved.feasible.shape
    assert (solved.case, solved.path) == ("4ws-2", None) and "feasible" in str(solved)
    assert solved.plot(folder / "map.png").axes and (folder / "map.png").read_bytes().startswith(b"\x89PNG")
    own = ars.Map.from_arrays(solved.speed_m_s, solved.front_angle_rad, np.nan_to_num(solved.yaw_rate_rad_s, nan=0.1))
    assert own.config is None and own.case is None


def test_columns_metrics_and_tables_of_a_run(run: ars.Run, folder: Path) -> None:
    yaw_rate = run["yaw_rate_rad_s"]
    assert yaw_rate.shape == (1500,) and run.scenario == "step-steer" and run.verdict.startswith("verdict: ")
    assert run.metrics["yaw_rate_steady_deg_s"] == pytest.approx(np.degrees(yaw_rate[-50:].mean()), rel=1e-3)  # still settling
    table = run.to_pandas()
    assert table.index.name == "time_s" and np.array_equal(table["yaw_rate_rad_s"], yaw_rate)
    data = run.to_xarray()
    assert data["yaw_rate_rad_s"].attrs["units"] == "rad/s"
    assert np.array_equal(data["yaw_rate_rad_s"].sel(car="passive"), run.column("yaw_rate_rad_s", of="passive"))
    run.save(folder / "run.csv")
    assert (folder / "run.csv").read_text().startswith("time_s,speed_m_s,")
    assert "<img" in run._repr_html_() and "verdict: " in run._repr_html_()


PAPER = ROOT / "generated/4ws2-paper.npz"
WRONG: dict[str, tuple[Any, str]] = {
    "key": (lambda _: ars.preset("paper").replace({"vehicle.mas_kg": 1.0}), "mas_kg: unknown key; did you mean 'mass_kg'?"),
    "value": (lambda _: ars.preset("paper").replace({"vehicle.mass_kg": -5.0}), "vehicle.mass_kg: -5 is outside"),
    "type of a value": (lambda _: ars.preset("paper").replace({"vehicle.mass_kg": "heavy"}), "a number is needed, not 'heavy'"),
    "preset": (lambda _: ars.preset("papper"), "there is no preset 'papper'; known: paper, recommended; did you mean 'paper'?"),
    "case": (lambda _: ars.solve(ars.preset("paper"), case="4ws2"), "there is no case '4ws2'; known cases: "),
    "file": (lambda _: ars.load_config("none.toml"), "none.toml: cannot be read"),
    "configuration": (lambda _: ars.solve(5), "codegen.solve: 5 is no config; give "),
    "map": (lambda _: ars.load_map("none.npz"), "none.npz: cannot be read"),
    "argument that is no map": (lambda _: ars.tune(None), "codegen.tune: None is no map; give "),
    "table": (lambda _: ars.Map.from_arrays([1.0, 2.0], [0.0], [[1.0], [1.0, 2.0]]), "the rows have different lengths"),
    "folder that is no build": (lambda here: ars.load_build(here), "manifest.json"),
    "prefix": (lambda _: ars.build(PAPER, "x", prefix="1"), "prefix"),
    "precision": (
        lambda _: ars.build(PAPER, "x", precision="half"),
        "'half' is no precision; give 'single' or 'double'",
    ),
    "unit": (
        lambda _: ars.build(PAPER, "x", max_error="5 m"),
        "'5 m' is in 'm'; give a number",
    ),
    "storage": (
        lambda _: ars.build(PAPER, "x", storage="int16"),
        "`storage=`: applies only to chosen breakpoints; add `max_error=`",
    ),
    "shares": (lambda _: ars.solve(share=0.9, friction=[0.5]), "`friction=`: cannot be combined with `share=`"),
    "cars of another suite": (lambda _: ars.suite(None, cars=3), "`cars=`: random cars belong to their suite"),
    "campaign": (lambda _: ars.sweep(None, "x"), "`spec=`: no factors to vary are given; give `spec=` or `measured=`"),
    "the same map": (lambda _: ars.compare(PAPER, PAPER), "`second=` "),
    "drives": (lambda _: ars.read_drives([]), "`logs=`: no drive is named; name a measured drive"),
    "empty key": (lambda _: ars.preset("paper").replace({"": 1}), "'' is no key; give dotted keys of ars.toml"),
    "text for a choice": (lambda _: ars.preset("paper").replace({"controller.kind": 3}), "'proportional' is needed, not 3"),
    "text of a list": (lambda _: ars.log("x.blf", dbc=3), "codegen.log: 3 is no dbc; give a path or a list of paths"),
    "missing log": (lambda _: ars.log("x.csv"), "x.csv: cannot be read (No such file or directory); name a log"),
    "missing table": (lambda _: ars.import_map("x.csv"), "No such file or directory); name the file to import"),
    "missing scenario": (
        lambda _: ars.run(PAPER.with_suffix(""), "x.csv"),
        "No such file or directory); name a .csv or .toml file",
    ),
    "suite": (lambda _: ars.suite(None, "trackin"), "there is no suite 'trackin'; known: "),
    "progress": (lambda _: ars.solve(progress=1), "1 is no progress; give a function"),
    "name of an argument": (lambda _: ars.solve(cases="fws"), "there is no argument 'cases'; known: config, case, "),
    "missing argument": (lambda _: ars.tune(), "codegen.tune: the argument 'map' is missing"),
    "changes": (lambda _: ars.preset("paper").replace([("vehicle.mass_kg", 1.0)]), "the changes are no dictionary"),
    "frictions": (lambda _: ars.solve(friction="high"), "codegen.solve: 'high' is no friction; "),
    "cars": (lambda _: ars.suite(None, "cars", cars=0), "codegen.suite: 0 is no cars; give a whole number from 1 to 1000"),
    "subject": (lambda _: ars.check(3.0), "codegen.check: 3.0 is no subject; give "),
}


OF_PYDANTIC = ("Input should", "valid ", "unable to", "instance of", "greater than", "less than")


@pytest.mark.parametrize("what", WRONG)
def test_wrong_input_is_one_line(what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    call, words = WRONG[what]
    with pytest.raises(ars.CodegenError) as refused:
        call(tmp_path)
    assert words in str(refused.value) and "\n" not in str(refused.value) and "--" not in str(refused.value)
    assert not [each for each in OF_PYDANTIC if each in str(refused.value)]
    assert list(tmp_path.iterdir()) == []


def test_wrong_input_of_a_run_is_one_line(build: ars.Build, run: ars.Run) -> None:
    for scenario, options, words in (
        ("step-stear", {}, "there is no scenario 'step-stear'; known: "),
        ("step-steer", {"speed_km_h": "fast"}, "'fast' is no speed_km_h; give a number"),
        ("step-steer", {"speed_km_h": float("nan")}, "nan is no speed_km_h; give a number from 1 to 400"),
        ("split-friction", {"steering_wheel_angle_deg": 9.0}, "split-friction does not take it"),
        ("step-steer", {"seed": -1}, "-1 is no seed; give a whole number of 0 or more"),
        ("step-steer", {"sensors": True}, "`sensors=`: sensors .* CAN frames; add `through_can=True`"),
        ("step-steer", {"jitter_ms": 1.0}, "`jitter_ms=`: clock drift"),
        ("step-steer", {"plant": "roll", "through_can": True}, "`plant=`: runs .*; leave `through_can=` out"),
        ("step-steer", {"plant": "bus"}, "'bus' is no plant; give 'two-track' or 'roll'"),
    ):
        with pytest.raises(ars.CodegenError, match=words) as refused:
            ars.run(build, scenario, **options)
        assert "--" not in str(refused.value)
    with pytest.raises(ars.CodegenError, match=r"there is no column 'yaw_rate' in this run; known: .*did you mean"):
        run["yaw_rate"]
    with pytest.raises(ars.CodegenError, match="no format for a run"):
        run.save("run.xls")
    with pytest.raises(ars.CodegenError, match="the path of a picture is needed, not int"):
        run.plot(3)  # type: ignore[arg-type]
    with pytest.raises(ars.CodegenError, match="too many arguments without a name"):
        ars.export(build, "fmu", "car.fmu", {"fmi": "2"})  # type: ignore[call-arg]


def test_a_configuration_serves_like_its_file(tmp_path: Path) -> None:
    """Only the text differs: a file keeps its comments."""
    path = ars.init(tmp_path, "paper").path
    config = ars.load_config(path)
    plans = [ars.plan_drives(each, duration=30.0, lateral_acceleration_max=9.5) for each in (path, config)]
    assert plans[0].names == plans[1].names and plans[0].to_dict() == plans[1].to_dict()
    tir = ROOT / "tests/importing/data/mf52.tir"
    tyres = [ars.import_tyres(tir, each) for each in (path, config)]
    assert tyres[0].config == tyres[1].config != config and tyres[0].to_dict() == tyres[1].to_dict()
    assert ars.load_config(tyres[1].save(tmp_path / "tyres.toml") or tmp_path / "tyres.toml") == tyres[1].config
    with pytest.raises(ars.CodegenError, match="the configuration: "):
        ars.plan_drives(config, duration=1.0)


def test_the_import_is_fast_and_the_names_are_known() -> None:
    script = "import sys, codegen; assert 'numpy' not in sys.modules and 'click' not in sys.modules; print(dir(codegen))"
    listed = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert all(repr(name) in listed for name in ars.__all__)
    public = {name: getattr(ars, name) for name in ars.__all__}
    assert not [name for name, value in public.items() if isinstance(value, ModuleType)]
    assert not [
        name for name, value in public.items() if not isinstance(value, type) and name != "Progress" and not value.__doc__
    ]
    with pytest.raises(AttributeError, match="no attribute 'simulate'"):
        ars.simulate  # noqa: B018


def test_processes_do_not_run_the_script_again(tmp_path: Path) -> None:
    """`verify` and `suite` start processes, also from a script without `if __name__ == "__main__"`."""
    script = tmp_path / "script.py"
    script.write_text(
        "from codegen.library.verification import without_main\nfrom hil_sim.suite.background import Background\n\n"
        "print('once')\n"
        "with without_main(), Background() as background:\n    print(background.call(abs, -3).get())\n",
        encoding="utf-8",
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, check=False, timeout=300)
    assert (done.returncode, done.stdout) == (0, "once\n3\n"), done.stderr


def test_signatures() -> None:
    """A change of this list is a change of the public interface: it goes into CHANGELOG.md."""
    functions = {name: value for name in ars.__all__ if inspect.isfunction(value := getattr(ars, name))}
    found = "".join(f"{name}{inspect.signature(value)}\n" for name, value in functions.items())
    assert found == (Path(__file__).parent / "signatures.txt").read_text(encoding="utf-8")

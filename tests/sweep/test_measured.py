"""Campaigns with the cars of a measured car: their distribution, their plants, their identity and what is refused."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cloudpickle
import numpy as np
import pyarrow.parquet as pq
import pytest

from codegen import configuration
from codegen.configuration import Config
from codegen.design.tune import with_tracking
from codegen.errors import ConfigError
from codegen.importing.toml_edit import whole
from codegen.sil.batch import DIFFERENCE_MAX_FLIPPED
from codegen.sil.closed_loop import INPUT_COLUMNS, ClosedLoop, LoopOptions
from codegen.sil.software import compile_build
from codegen.sweep import measured, store
from codegen.sweep import plan as planning
from codegen.sweep.chunk import replay, run_chunk
from codegen.sweep.engine import Threads, run_campaign
from codegen.sweep.lanes import draw_samples
from codegen.sweep.plan import Plan
from codegen.vehicle.plant_car import PLANT_PARAMETERS
from tests import builds
from tests.sweep.conftest import ROOT

DEVIATIONS = {
    "tyre.front.cornering_stiffness_n_per_rad": 4_000.0,
    "tyre.rear.cornering_stiffness_n_per_rad": 5_000.0,
    "tyre.rear.peak_factor_p1": 0.03,
    "tyre.rear.shape_factor_c": 0.04,
    "tyre.front.curvature_factor_e": 0.3,
    "tyre.front.peak_load_sensitivity_p2": 0.02,
    "vehicle.yaw_inertia_kg_m2": 120.0,
    "plant.relaxation_length_m": 0.03,
    "steering.ratio": 0.3,
    "rear_actuator.lag_s": 0.004,
    "rear_actuator.rate_max_deg_s": 2.0,
    "plant.command_delay_samples": 0.4,
}
"""Every kind of key that `codegen identify` writes -> standard deviation."""
KEYS = list(DEVIATIONS)
STIFFNESSES, INERTIA = KEYS[:2], "vehicle.yaw_inertia_kg_m2"
CORRELATION = 0.9
"""Correlation of both stiffnesses."""


def identified(deviations: dict[str, float], **changes: Any) -> dict[str, Any]:
    """Return an ars.toml of the committed builds' car with these uncertainties, as a dictionary."""
    data = configuration.preset("recommended").model_dump(mode="json", exclude_none=True)
    data["plant"] |= {"relaxation_length_m": 0.3, "command_delay_samples": 1}
    matrix = np.eye(len(deviations))
    if set(STIFFNESSES) <= set(deviations):
        one, other = (list(deviations).index(key) for key in STIFFNESSES)
        matrix[one, other] = matrix[other, one] = CORRELATION
    table = {
        "keys": list(deviations),
        "standard_deviations": list(deviations.values()),
        "correlations": matrix.tolist(),
        "interval_floor_percent": 0.0,
    }
    return data | {"identified": table} | changes


def write_car(at: Path, deviations: dict[str, float] = DEVIATIONS, **changes: Any) -> Path:
    path = at / "identified.toml"
    path.write_text(whole(configuration.parse(identified(deviations, **changes), "test"), "a test"), encoding="utf-8")
    return path


SPEC = """
samples = {samples}
seed = 5
scenarios = ["step-steer"]
lead_s = 0.2
length_s = 2.0

[controllers]
tracking = "{root}/generated/4ws2"

[factors]
{factors}
"""
FACTORS = "mass_percent = [0, 20]\nspeed_km_h = { uniform = [40, 90] }"


def write_spec(at: Path, samples: int = 300, factors: str = FACTORS) -> Path:
    path = at / "sweep.toml"
    path.write_text(SPEC.format(samples=samples, root=ROOT, factors=factors), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    folder = tmp_path_factory.mktemp("measured")
    return planning.read(write_spec(folder), None, write_car(folder))


def test_the_campaigns_cars_have_the_deviations_and_the_correlation(plan: Plan, tmp_path: Path) -> None:
    count = 300
    table = pq.read_table(run_campaign(plan, tmp_path / "out", Threads(2)))
    drawn = np.array([table[key].to_numpy() for key in KEYS])
    config = plan.config
    mean = np.array([_value(config, key) for key in KEYS])
    given = np.array(list(DEVIATIONS.values()))
    # A rounded whole number has 1/12 more variance than the normal distribution behind it (Sheppard), here within 1 %.
    given[KEYS.index("plant.command_delay_samples")] = (0.4**2 + 1.0 / 12.0) ** 0.5
    # Five standard errors: s / sqrt(n) of a mean, 1 / sqrt(2 n) of a deviation, (1 - r^2) / sqrt(n) of a correlation.
    assert np.abs((drawn.mean(axis=1) - mean) / given).max() < 5.0 / count**0.5
    assert drawn.std(axis=1) == pytest.approx(given, rel=5.0 / (2.0 * count) ** 0.5)
    correlations = np.corrcoef(drawn)
    assert correlations[0, 1] == pytest.approx(CORRELATION, abs=5.0 * (1.0 - CORRELATION**2) / count**0.5)
    correlations[0, 1] = correlations[1, 0] = 0.0
    assert np.abs(correlations - np.eye(len(KEYS))).max() < 5.0 / count**0.5
    assert set(table["plant.command_delay_samples"].to_pylist()) == {0.0, 1.0, 2.0}


def _value(config: Config, key: str) -> float:
    value: Any = config
    for part in key.split("."):
        value = getattr(value, part)
    return float(value)


def test_a_run_equals_the_single_loop_of_the_configuration_with_those_values(plan: Plan) -> None:
    """Each key of the row is written into the ars.toml, and the plant of that file is driven alone."""
    alone = replace(plan, spec=plan.spec.model_copy(update={"factors": {}}))
    found = replay(alone, 7)
    row, controller = found.row, plan.controllers[0]
    data = plan.config.model_dump(mode="json", exclude_none=True)
    for key in KEYS:
        *tables, name = key.split(".")
        target = data
        for table in tables:
            target = target[table]
        assert target[name] != row[key] or name == "command_delay_samples"
        target[name] = type(target[name])(row[key])
    changed = configuration.parse(data, "test")
    inputs = found.profile.inputs.copy()
    inputs[:, INPUT_COLUMNS.index("steering_wheel_command")] *= row["steering_wheel_angle_deg"] / 90.0
    loop = ClosedLoop(compile_build(controller.files, controller.manifest, changed), LoopOptions())  # the delay of the file
    difference = np.abs(found.records["tracking"] - loop.run(inputs))[:, :-1]
    assert difference.max() < DIFFERENCE_MAX_FLIPPED, difference.max(axis=0)


def test_other_factors_act_on_the_drawn_cars(plan: Plan) -> None:
    """The mass of the factor is added to the drawn car, whose stiffnesses stay."""
    samples = range(40)
    assert plan.measured is not None
    drawn, alone = (
        draw_samples(spec, samples, plan.config, plan.measured.population)
        for spec in (plan.spec, plan.spec.model_copy(update={"factors": {}}))
    )
    heavier = 1.0 + drawn.factors["mass_percent"] / 100.0
    assert set(drawn.factors["mass_percent"]) == {0.0, 20.0}
    for name in ("mass", "yaw_inertia", "front_static_load"):
        column = PLANT_PARAMETERS.index(name)
        assert drawn.cars[:, column] == pytest.approx(heavier * alone.cars[:, column], rel=1e-14)
    assert all(np.array_equal(drawn.factors[key], values) for key, values in alone.factors.items())


def test_a_car_depends_only_on_its_number_the_seed_and_the_file(plan: Plan, tmp_path: Path) -> None:
    chunk = run_chunk(plan, 0)
    again = run_chunk(cloudpickle.loads(cloudpickle.dumps(plan)), 0)  # as a cluster sends it
    assert all(np.array_equal(values, again[name], equal_nan=True) for name, values in chunk.items())
    other = planning.read(write_spec(tmp_path), None, write_car(tmp_path, {**DEVIATIONS, INERTIA: 121.0}))
    assert store.facts_text(other) != store.facts_text(plan)
    assert np.array_equal(run_chunk(other, 0)[STIFFNESSES[0]], chunk[STIFFNESSES[0]])
    seeded = replace(plan, spec=plan.spec.model_copy(update={"seed": 6}))
    assert not np.intersect1d(run_chunk(seeded, 0)[INERTIA], chunk[INERTIA]).size
    commented = write_car(tmp_path)
    commented.write_text("# a comment\n" + commented.read_text(encoding="utf-8"), encoding="utf-8")
    assert store.facts_text(planning.read(write_spec(tmp_path), None, commented)) == store.facts_text(plan)
    found = replay(plan, 17).row
    assert all(found[key] == chunk[key][17] for key in KEYS)


def test_what_cannot_vary_and_builds_of_other_cars_are_notes(tmp_path: Path) -> None:
    deviations = {INERTIA: 100.0, "road.friction": 0.1, "controller.friction_min": 0.01}
    car = write_car(tmp_path, deviations)
    made = planning.read(write_spec(tmp_path), None, car)
    assert made.notes == (
        "road.friction cannot vary within a campaign; it keeps its value",
        "controller.friction_min cannot vary within a campaign; it keeps its value",
    )
    assert made.measured and made.measured.population.keys == (INERTIA,)
    heavy = tomllib.loads(car.read_text(encoding="utf-8"))["vehicle"] | {"mass_kg": 1700.0}
    other = planning.read(write_spec(tmp_path), None, write_car(tmp_path, {INERTIA: 100.0}, vehicle=heavy))
    assert other.notes == ("controllers.tracking is built for another [vehicle] than that of identified.toml",)
    assert other.config.vehicle.mass_kg == 1700.0


@pytest.mark.parametrize(
    ("deviations", "factors", "message"),
    [
        (
            DEVIATIONS,
            "rear_lag_s = 0.1",
            "sweep.toml: factors.rear_lag_s: rear_actuator.lag_s already varies as in identified.toml; remove the factor",
        ),
        (
            DEVIATIONS,
            "tyre_peak_percent = 5",
            "factors.tyre_peak_percent: tyre.rear.peak_factor_p1 already varies",
        ),
        (DEVIATIONS, "delay_samples = [0, 1]", "factors.delay_samples: plant.command_delay_samples already varies"),
        (
            dict.fromkeys(STIFFNESSES, 1e9),
            "",
            "identified.toml: identified.standard_deviations: hardly any car within these standard deviations is possible",
        ),
        ({}, "", "identified.toml: identified.keys: there are no identified keys"),
        ({"road.friction": 0.1}, "", "identified.toml: identified.keys: no identified key can vary in a campaign"),
    ],
)
def test_refused(tmp_path: Path, deviations: dict[str, float], factors: str, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        planning.read(write_spec(tmp_path, factors=factors), None, write_car(tmp_path, deviations))


def test_a_car_in_doubt_is_refused_until_its_file_accepts_it(tmp_path: Path) -> None:
    car = write_car(tmp_path, DEVIATIONS)
    text = car.read_text(encoding="utf-8")
    car.write_text(
        text.replace("[identified]", '[identified]\ndoubts = ["front D is at the end of its range, 3"]'), encoding="utf-8"
    )
    with pytest.raises(ConfigError, match=r"in doubt: front D is at the end .* identified.doubts_accepted = true"):
        measured.load(car)
    text = car.read_text(encoding="utf-8")
    car.write_text(text.replace("[identified]", "[identified]\ndoubts_accepted = true"), encoding="utf-8")
    assert measured.load(car).population.keys


def test_a_factorial_design_and_another_sampling_time_are_refused(tmp_path: Path) -> None:
    spec, car = write_spec(tmp_path, factors="friction = [0.5, 0.9]"), write_car(tmp_path)
    spec.write_text(spec.read_text().replace("samples = 300", 'design = "factorial"'))
    with pytest.raises(ConfigError, match="design: in a factorial design each combination would have another car"):
        planning.read(spec, None, car)
    data = identified({INERTIA: 100.0})
    slower = data["controller"] | {"sampling_time_s": 0.02}
    cycles = {
        name: value | {"cycle_time_ms": 20.0} if isinstance(value, dict) and "cycle_time_ms" in value else value
        for name, value in data["can"].items()
    }
    with pytest.raises(ConfigError, match=r"another controller\.sampling_time_s than that of identified\.toml"):
        planning.read(write_spec(tmp_path), None, write_car(tmp_path, {INERTIA: 100.0}, controller=slower, can=cycles))


def test_a_family_that_is_too_wide_is_replaced_by_that_of_tuning_and_the_map_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ARS_CACHE", str(tmp_path / "cache"))
    schedule, tried = builds.TRACKING_CONFIG.controller.tracking.model_dump(mode="json")["schedule"], []

    def tune(reference_map: Any, config: Config, *_: object) -> Any:
        tried.append(config.identified.keys)
        if config.identified.keys:
            raise ConfigError("no gains")
        return SimpleNamespace(config=with_tracking(config, {"schedule": schedule}, "test"))

    monkeypatch.setattr(measured, "tune", tune)
    monkeypatch.setattr(measured, "solve_case", lambda config, case: builds.paper_map().with_config(config))
    car = measured.load(write_car(tmp_path))
    found = measured.solve_map(car)
    assert tried == [KEYS, []]
    monkeypatch.setattr(measured, "solve_case", None)
    again = measured.solve_map(car)
    assert again.config == found.config and np.array_equal(again.yaw_rate, found.yaw_rate, equal_nan=True)
    spec = write_spec(tmp_path, samples=1, factors="")
    spec.write_text(spec.read_text().partition("[controllers]")[0], encoding="utf-8")
    plan = planning.read(spec, None, tmp_path / "identified.toml")
    assert list(plan.spec.controllers) == ["tracking", "passive"]
    assert [note for note in plan.notes if "the controller is tuned for that of [tuning]" in note]

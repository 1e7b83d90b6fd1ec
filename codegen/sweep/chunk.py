"""Simulate one chunk of a campaign: its samples with every controller in every scenario, and their metrics."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.errors import BuildError, within
from codegen.metrics import Figures, figures
from codegen.metrics.runs import METRIC_COLUMNS, Runs
from codegen.sil.batch import BatchSoftware, Lanes, compile_batch
from codegen.sil.software import RECORD_COLUMNS
from codegen.sil.vector import best_isa, machine_runs
from codegen.sweep import lanes
from codegen.sweep.lanes import Drawn, Profile
from codegen.sweep.plan import Controller, Plan, RunKey
from codegen.sweep.spec import MAX_CONTROLLERS
from codegen.units import KM_H
from codegen.vehicle.plant_car import PLANT_PARAMETERS
from codegen.vehicle.tyre import slip_bounds

Table = dict[str, npt.NDArray[Any]]
"""Column name -> values, one row for each run, by run number."""

DRIVEN = ("speed_km_h", "steering_wheel_angle_deg", "friction", "friction_estimate")
MASS, STEERING_RATIO = (PLANT_PARAMETERS.index(name) for name in ("mass", "steering_ratio"))

_LOCK = threading.Lock()
_COMPILED: dict[tuple[str, str, str], BatchSoftware] = {}
COMPILED_MAX = MAX_CONTROLLERS
"""Number of most recently used compiled builds that a process keeps. Cluster workers may serve many campaigns."""


def software(plan: Plan, controller: Controller) -> BatchSoftware:
    """Return a controller compiled with the batch plant of the plan's car; the process caches the last COMPILED_MAX.

    Raises:
        BuildError: it does not compile, or this machine lacks the campaign's instructions.
    """
    # The plan's configuration, that of its first controller, defines the plant.
    key = (controller.digest, hashlib.sha256(plan.config.model_dump_json().encode()).hexdigest(), plan.isa)
    with _LOCK:
        found = _COMPILED.pop(key, None)
        if found is None:
            if not machine_runs(plan.isa):
                raise BuildError(
                    f"this machine has no instructions of {plan.isa}",
                    where="`isa=`",
                    remedy=f"run the whole campaign with `isa={best_isa()!r}`",
                )
            with within(controller.folder or controller.name):
                found = compile_batch(controller.files, controller.manifest, plan.config, isa=plan.isa)
        _COMPILED[key] = found
        while len(_COMPILED) > COMPILED_MAX:
            del _COMPILED[next(iter(_COMPILED))]
        return found


@dataclass(frozen=True)
class Work:
    """The function that an engine calls, locally or on another machine: chunk number -> table."""

    plan: Plan

    def __call__(self, chunk: int) -> Table:
        """See `run_chunk`."""
        return run_chunk(self.plan, chunk)


def run_chunk(plan: Plan, chunk: int) -> Table:
    """Simulate all runs of a chunk. The table holds run, sample, scenario, controller, factors, conditions and figures.

    Raises:
        CodegenError: the car cannot do a scenario at a drawn speed, or the C does not compile.
    """
    samples = plan.samples_of(chunk)
    drawn = _draw(plan, samples)
    tables = []
    for place, profile in enumerate(plan.profiles):
        driven = lanes.conditions(plan.config, profile, drawn.factors, len(samples))
        every = lanes.lanes(plan.spec, samples, place, profile, plan.config, drawn, driven)
        for index, controller in enumerate(plan.controllers):
            batch = replace(every, controlled=controller.controlled)
            record = software(plan, controller).run(profile.inputs, batch, columns=METRIC_COLUMNS)
            number = (np.arange(samples.start, samples.stop) * len(plan.profiles) + place) * len(plan.controllers) + index
            tables.append(
                {
                    "run": number,
                    "sample": np.arange(samples.start, samples.stop),
                    "scenario": np.full(len(samples), place),
                    "controller": np.full(len(samples), index),
                    **_varied(drawn.factors, driven),
                    **_figures(plan, profile, record, batch, _map_yaw_rate(plan, controller, driven, record)),
                }
            )
    return _joined(tables)


def _draw(plan: Plan, samples: range) -> Drawn:
    population = None if plan.measured is None else plan.measured.population
    return lanes.draw_samples(plan.spec, samples, plan.config, population)


def _varied(factors: Mapping[str, FloatArray], driven: lanes.Conditions) -> Table:
    return {**{key: values for key, values in factors.items() if key not in DRIVEN}, **asdict(driven)}


def _map_yaw_rate(plan: Plan, controller: Controller, driven: lanes.Conditions, record: FloatArray) -> FloatArray:
    """Return the map's yaw rate (n,) in rad/s at the end of a recording (columns, samples, n), columns COLUMNS."""
    look_up = software(plan, controller).software.function("map_yaw_rate_on_road")
    front_angle = record[METRIC_COLUMNS.index("front_angle_rad"), -1]
    places = zip(driven.speed_km_h * KM_H, front_angle, driven.friction_estimate, strict=True)
    return np.array([look_up(*place) for place in places])


def _figures(plan: Plan, profile: Profile, record: FloatArray, batch: Lanes, map_yaw_rate: FloatArray) -> Figures:
    """Return the figures of a recording (columns, samples, n), columns COLUMNS."""
    runs = Runs(
        time=np.arange(record.shape[1], dtype=np.float64) * plan.config.controller.sampling_time_s,
        signals=dict(zip(METRIC_COLUMNS, record, strict=True)),
        steer_time=profile.steer_time,
        steering_ratio=batch.cars[:, STEERING_RATIO],
        mass=batch.cars[:, MASS],
        slip_bounds=slip_bounds(plan.config),
        map_yaw_rate=map_yaw_rate,
    )
    return figures(profile.kind, runs)


def _joined(tables: list[Table]) -> Table:
    names = list(dict.fromkeys(name for table in tables for name in table))
    joined = {name: np.concatenate([table.get(name, np.full(table["run"].size, np.nan)) for table in tables]) for name in names}
    order = np.argsort(joined["run"], kind="stable")
    return {name: values[order] for name, values in joined.items()}


@dataclass(frozen=True, eq=False)
class Replayed:
    """One repeated run, and the same sample with the other controllers.

    Attributes:
        key: sample, scenario and controller of the run.
        controller: name of its controller.
        records: controller name -> recording (samples, columns), RECORD_COLUMNS; the run's own controller first.
        row: numbers of its row in the table, without NaN.
        profile: the scenario's profile.
    """

    key: RunKey
    controller: str
    records: Mapping[str, FloatArray]
    row: Mapping[str, float]
    profile: Profile


def replay(plan: Plan, run: int) -> Replayed:
    """Repeat one run of a campaign with a complete recording. The figures equal those of the campaign.

    Raises:
        CodegenError: there is no such run; see also `run_chunk`.
    """
    key = plan.key(run)
    samples = plan.samples_of(key.sample // plan.samples_per_chunk)
    at = key.sample - samples.start
    drawn = _draw(plan, samples)
    profile, own = plan.profiles[key.scenario], plan.controllers[key.controller]
    driven = lanes.conditions(plan.config, profile, drawn.factors, len(samples))
    every = lanes.lanes(plan.spec, samples, key.scenario, profile, plan.config, drawn, driven)
    alone = lanes.only(every, [at])
    records, figures_of_run = {}, Figures()
    for controller in (own, *(other for other in plan.controllers if other is not own)):
        batch = replace(alone, controlled=controller.controlled)
        record = software(plan, controller).run(profile.inputs, batch)
        records[controller.name] = np.ascontiguousarray(record[:, :, 0].T)
        if controller is own:
            places = [RECORD_COLUMNS.index(name) for name in METRIC_COLUMNS]
            conditions = lanes.Conditions(**{name: values[[at]] for name, values in asdict(driven).items()})
            of_map = _map_yaw_rate(plan, controller, conditions, record[places])
            figures_of_run = _figures(plan, profile, record[places], batch, of_map)
    row = {"run": float(run), "sample": float(key.sample)}
    row |= {name: float(values[at]) for name, values in _varied(drawn.factors, driven).items()}
    row |= {name: float(values[0]) for name, values in figures_of_run.items()}
    return Replayed(key, own.name, records, {name: value for name, value in row.items() if not np.isnan(value)}, profile)


__all__ = ["DRIVEN", "Replayed", "Table", "Work", "replay", "run_chunk", "software"]

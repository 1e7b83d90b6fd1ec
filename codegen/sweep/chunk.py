"""One chunk of a campaign: its samples drawn, driven by every controller in every scenario, and measured."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.errors import within
from codegen.sil.batch import BatchSoftware, compile_batch
from codegen.sweep import lanes
from codegen.sweep.draw import draw
from codegen.sweep.metrics import COLUMNS, Runs, figures
from codegen.sweep.plan import Controller, Plan, RunKey
from codegen.sweep.profile import Profile
from codegen.vehicle.plant_car import PLANT_PARAMETERS

FloatArray = npt.NDArray[np.float64]
Table = dict[str, npt.NDArray[Any]]
"""Column to values, a row for each run, in the order of their numbers."""

DRIVEN = ("speed_km_h", "steering_wheel_angle_deg", "friction", "friction_estimate")
MASS = PLANT_PARAMETERS.index("mass")

_LOCK = threading.Lock()
_COMPILED: dict[tuple[str, str], BatchSoftware] = {}


def software(plan: Plan, controller: Controller) -> BatchSoftware:
    """A controller compiled with the batch plant: once in each process. Raises BuildError."""
    key = (controller.digest, plan.isa)
    with _LOCK:
        if key not in _COMPILED:
            with within(controller.folder or controller.name):
                _COMPILED[key] = compile_batch(controller.files, controller.manifest, plan.config, isa=plan.isa)
        return _COMPILED[key]


@dataclass(frozen=True)
class Work:
    """What an engine calls, here or on another machine: the number of a chunk -> its table."""

    plan: Plan

    def __call__(self, chunk: int) -> Table:
        """See `run_chunk`."""
        return run_chunk(self.plan, chunk)


def run_chunk(plan: Plan, chunk: int) -> Table:
    """All runs of a chunk: run, sample, scenario, controller, what varied, what was driven, and every figure.

    Raises:
        CodegenError: the car cannot do a scenario at a drawn speed, or the C does not compile.
    """
    spec, samples = plan.spec, plan.samples_of(chunk)
    factors = draw(spec, chunk, samples)
    tables = []
    for place, profile in enumerate(plan.profiles):
        driven = lanes.conditions(plan.config, profile, factors, len(samples))
        for index, controller in enumerate(plan.controllers):
            batch = lanes.lanes(spec, chunk, place, profile, plan.config, factors, driven, controller.controlled)
            record = software(plan, controller).run(profile.inputs, batch, columns=COLUMNS)
            runs = Runs(
                time=np.arange(record.shape[1], dtype=np.float64) * plan.config.controller.sampling_time_s,
                signals=dict(zip(COLUMNS, record, strict=True)),
                steer_time=profile.steer_time,
                steering_ratio=plan.config.steering.ratio,
                mass=batch.cars[:, MASS],
            )
            number = (np.arange(samples.start, samples.stop) * len(plan.profiles) + place) * len(plan.controllers) + index
            tables.append(
                {
                    "run": number,
                    "sample": np.arange(samples.start, samples.stop),
                    "scenario": np.full(len(samples), place),
                    "controller": np.full(len(samples), index),
                    **{key: values for key, values in factors.items() if key not in DRIVEN},
                    **asdict(driven),
                    **figures(profile.kind, runs),
                }
            )
    return _joined(tables)


def _joined(tables: list[Table]) -> Table:
    names = list(dict.fromkeys(name for table in tables for name in table))
    joined = {name: np.concatenate([table.get(name, np.full(table["run"].size, np.nan)) for table in tables]) for name in names}
    order = np.argsort(joined["run"], kind="stable")
    return {name: values[order] for name, values in joined.items()}


@dataclass(frozen=True, eq=False)
class Replayed:
    """One run again, and the same sample with the other controllers.

    Attributes:
        key: which it is. controller: its name.
        records: controller to recording (samples, 12), columns RECORD_COLUMNS; the run's own first.
        row: its row of the table, without what it does not have and without names.
        profile: what was driven.
    """

    key: RunKey
    controller: str
    records: Mapping[str, FloatArray]
    row: Mapping[str, float]
    profile: Profile


def replay(plan: Plan, run: int) -> Replayed:
    """One run of a campaign, with its whole recording: the same numbers as in the campaign.

    Raises:
        CodegenError: there is no such run; see also `run_chunk`.
    """
    key = plan.key(run)
    chunk = key.sample // plan.samples_per_chunk
    samples = plan.samples_of(chunk)
    factors = draw(plan.spec, chunk, samples)
    profile, own = plan.profiles[key.scenario], plan.controllers[key.controller]
    driven = lanes.conditions(plan.config, profile, factors, len(samples))
    records = {}
    for controller in (own, *(other for other in plan.controllers if other is not own)):
        every = lanes.lanes(plan.spec, chunk, key.scenario, profile, plan.config, factors, driven, controller.controlled)
        record = software(plan, controller).run(profile.inputs, lanes.only(every, key.sample - samples.start))
        records[controller.name] = np.ascontiguousarray(record[:, :, 0].T)
    table = run_chunk(plan, chunk)
    at = int(np.flatnonzero(table["run"] == run)[0])
    row = {name: float(values[at]) for name, values in table.items() if name not in ("scenario", "controller")}
    return Replayed(key, own.name, records, {name: value for name, value in row.items() if not np.isnan(value)}, profile)


__all__ = ["DRIVEN", "Replayed", "Table", "Work", "replay", "run_chunk", "software"]

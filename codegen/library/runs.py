"""Runs of the generated C in closed loop with a simulated car, and their results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from annotated_types import Ge, Interval

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.emit.folder import check_output
from codegen.emit.manifest import read_build
from codegen.errors import CheckFailed, CodegenError, suggestion
from codegen.export import runs as exported
from codegen.judgement.car_warnings import car_warnings
from codegen.library.builds import BuildLike, edited_notes, folder_of
from codegen.library.maps import MapLike, map_of, place_of
from codegen.library.result import PathLike, Progress, Result, Work, drawn, path_of, public
from codegen.report.bus_tables import bus_facts, bus_lines
from codegen.report.summary import metric_rows
from codegen.requirements import missing
from codegen.sil.software import RECORD_COLUMNS, Software, load
from codegen.text import text_table
from hil_sim import bench, third_plant
from hil_sim.bench import BenchResult
from hil_sim.metrics import Evaluation, coverage, evaluate, verdict
from hil_sim.metrics.run import LookUp, column
from hil_sim.metrics.run import Run as Recorded
from hil_sim.metrics.verdict import Covers
from hil_sim.scenario_files import find, with_settings
from hil_sim.scenarios import DEFAULT_SCENARIO, Scenario
from hil_sim.settings import SPEED_RANGE_KM_H, STEERING_WHEEL_ANGLE_RANGE_DEG

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

CONTROLLED, PASSIVE = "controlled", "passive"

SpeedKmH = Annotated[float, Interval(ge=SPEED_RANGE_KM_H[0], le=SPEED_RANGE_KM_H[1])]
SteeringWheelAngleDeg = Annotated[float, Interval(ge=STEERING_WHEEL_ANGLE_RANGE_DEG[0], le=STEERING_WHEEL_ANGLE_RANGE_DEG[1])]


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Recorded data of a run, from which its results are computed.

    Attributes:
        title: the build, and the bus if there is one.
        records: name -> (samples, columns), RECORD_COLUMNS; the controlled run first.
        facts: JSON values that describe the run.
        on_bus: statistics of the bus; None without one.
        ecu_counters: text of an ECU; "" if unknown.
        look_up, covers: lookup and coverage of the controller's map; None if unknown.
    """

    title: str
    config: Config
    scenario: Scenario
    records: Mapping[str, FloatArray]
    facts: Mapping[str, Any]
    on_bus: BenchResult | None = None
    ecu_counters: str = ""
    look_up: LookUp | None = None
    covers: Covers | None = None


class Run(Result):
    """A run of a scenario. `run["yaw_rate_rad_s"]` is a column of the controlled car, (n,) in SI units.

    Attributes:
        columns: names of all columns.
        names: names of the recorded cars: "controlled" and "passive", and the baselines.
        metrics: key -> value, for the controlled car; None where it has none.
        verdict: whether the car followed its map or course, in one line.
        written: files by kind that were written.
    """

    columns = RECORD_COLUMNS

    def __init__(self, recording: Recording, notes: Iterable[str] = (), warnings: Iterable[str] = ()) -> None:
        self.recording, self.notes, self.warnings = recording, tuple(notes), tuple(warnings)
        self.written: dict[str, list[str]] = {}
        if recording.on_bus is not None and not recording.on_bus.received["commands"]:
            self.notes += ("no ECU sent a command; the rear wheels did not move",)

    def __getitem__(self, name: str) -> FloatArray:
        return self.column(name)

    def column(self, name: str, of: str = CONTROLLED) -> FloatArray:
        """Return a column, (n,), of one of the cars in `names`. Raises CodegenError if there is none of that name."""
        for word, known, what in ((of, self.names, "car"), (name, self.columns, "column")):
            if word not in known:
                remedy = f"known: {', '.join(known)}{suggestion(str(word), known)}"
                raise CodegenError(f"there is no {what} {word!r} in this run", remedy=remedy)
        return column(self.recording.records[of], name)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.recording.records)

    @property
    def config(self) -> Config:
        """The configuration of the simulated car."""
        return self.recording.config

    @property
    def scenario(self) -> str:
        """Name of the scenario."""
        return self.recording.scenario.name

    @cached_property
    def evaluation(self) -> Evaluation:
        """Metrics of all cars."""
        given = self.recording
        return evaluate(given.scenario, given.config, given.records, given.look_up)

    @property
    def metrics(self) -> dict[str, float | bool | None]:
        return next(iter(self.evaluation.runs.values())).to_dict()

    @cached_property
    def verdict(self) -> str:
        given, controlled = self.recording, next(iter(self.evaluation.runs.values()))
        driven = Recorded(next(iter(given.records.values())), given.scenario, given.config, given.look_up)
        return verdict(driven, controlled.metrics, controlled.spun_at, given.covers)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the controlled car as a table with a row for each sample, indexed by `time_s`. Needs pandas."""
        try:
            import pandas
        except ImportError:
            raise missing("pandas", "makes tables", "to_pandas") from None
        table = pandas.DataFrame({name: self[name] for name in self.columns}).set_index("time_s")
        table.attrs = {"scenario": self.scenario, "verdict": self.verdict}
        return table

    def to_xarray(self) -> xarray.Dataset:
        """Return all cars as a dataset over `car` and `time_s`, with units and meanings. Needs xarray."""
        try:
            import xarray
        except ImportError:
            raise missing("xarray", "makes datasets", "to_xarray") from None
        import numpy as np

        time, *others = exported.EXPORT_COLUMNS
        tables = {
            each.name: (
                ("car", time.name),
                np.stack([self.column(each.name, name) for name in self.names]),
                {"units": each.unit, "long_name": each.meaning},
            )
            for each in others
        }
        along = (time.name, self[time.name], {"units": time.unit, "long_name": time.meaning})
        coordinates = {"car": list(self.names), time.name: along}
        return xarray.Dataset(tables, coordinates, {"scenario": self.scenario, "verdict": self.verdict})

    def save(self, path: PathLike) -> Path:
        """Write the controlled car as .csv, .parquet, .mf4 or .mat, and return the path. Raises CodegenError."""
        place = path_of(path, "the path of a run")
        exported.check_formats((place,))
        check_output(place, place.suffix.lower())
        exported.save(self.recording.records[CONTROLLED], place, self.recording.scenario.title)
        self.written.setdefault("recording", []).append(str(place))
        return place

    def plot(self, path: PathLike | None = None) -> Figure:
        """Draw all cars over time, or as the scenario's standard does; write a PNG if there is a path."""
        figure = drawn(self._figure(), path)
        if path is not None:
            self.written.setdefault("plot", []).append(str(path))
        return figure

    def _figure(self) -> Figure:
        from codegen.figures.draw import draw
        from codegen.figures.scenarios import scenario_picture

        given = self.recording
        return draw(scenario_picture(given.scenario, given.config, given.records, given.title, look_up=given.look_up))

    def lines(self) -> list[str]:
        """Return the metrics of all cars, the verdict, and the statistics of the bus."""
        given = self.recording
        lines = [f"{given.title}: {given.scenario.title}"]
        if given.facts.get("sensors", "ideal") != "ideal":
            lines.append(f"measured by the sensors of the configuration, {given.facts['sensors']}")
        lines += [text_table(("", *self.evaluation.runs), metric_rows(self.evaluation)), self.verdict]
        if given.on_bus is not None:
            lines += ["", *bus_lines(given.on_bus, given.config.controller.sampling_time_s)]
            lines += [f"ECU: {given.ecu_counters}"] if given.ecu_counters else []
        return [*lines, *(f"{kind}: {name}" for kind, names in self.written.items() for name in names)]

    def to_dict(self) -> dict[str, Any]:
        """Return the metrics by car, the verdict, and the statistics of the bus."""
        given, bus = self.recording, {}
        if given.on_bus is not None:
            figures = bus_facts(given.on_bus, given.config.controller.sampling_time_s)
            bus = {"bus_figures": figures, "ecu_counters": given.ecu_counters or None}
        results = {"metrics": self.evaluation.to_dict(), "verdict": self.verdict}
        return {**given.facts, **results, **bus, "files": self.written}


@public
def run(
    build: BuildLike,
    scenario: str | Path = DEFAULT_SCENARIO,
    *,
    map: MapLike | None = None,
    speed_km_h: SpeedKmH | None = None,
    steering_wheel_angle_deg: SteeringWheelAngleDeg | None = None,
    baselines: bool = False,
    plant: Literal["two-track", "roll"] = "two-track",
    through_can: bool = False,
    clock_drift_ppm: float | None = None,
    jitter_ms: float | None = None,
    sensors: bool = False,
    seed: Annotated[int, Ge(0)] = 0,
    progress: Progress | None = None,
) -> Run:
    """Run the C of a build in closed loop with a simulated car, and the same car with straight rear wheels.

    Args:
        build: a build, or the path of its folder.
        scenario: a name of `scenarios`, a recorded .csv, or a .toml of your own.
        map: simulate the car of this map instead of the build's.
        speed_km_h, steering_wheel_angle_deg: for scenarios that accept them.
        baselines: also run the paper's PI, feedforward and the proportional law.
        plant: "roll" has other tyres, roll and backlash of its own, and sensors with bias and jitter.
        through_can: run through the task and its CAN frames, without a bus. The arguments below require it.
        clock_drift_ppm: drift between the clocks of car and ECU. jitter_ms: largest deviation of frames and task from their
        clock.
        sensors: simulate noise, bias, delay and resolution of `[sensors]`.
        seed: of noise, faults and jitter.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: there is no such scenario, it does not take a value, or the C does not compile.
    """
    folder, work = folder_of(build), Work(progress, "compiling", "driving", *(["baselines"] if baselines else []))
    _refuse(plant, through_can, clock_drift_ppm, jitter_ms, sensors)
    config, notes = None, []
    if map is not None:
        found = map_of(map)
        config = found.config
        notes = [] if config is not None else [f"{place_of(found)} contains no car; using the build's"]
    with work.status("compiling", f"compiling {folder}"):
        software = load(folder, config)
    settings = {"speed_km_h": speed_km_h, "steering_wheel_angle_deg": steering_wheel_angle_deg}
    given = {key: value for key, value in settings.items() if value is not None}
    driven = with_settings(find(str(scenario), software.config), given).with_clocks(clock_drift_ppm, jitter_ms)
    if not software.selftest():
        raise CheckFailed("the generated self-test fails", where=folder, remedy="build again")
    drive = _Drive(driven, plant, through_can, sensors, seed)
    with work.status("driving", driven.title):
        controlled, result = drive.controlled(software)
        passive = drive.passive(software)
    beside = {}
    if baselines:
        from hil_sim.suite.subjects import of_folder  # slow, and not needed for most runs

        with work.stage("baselines") as steps:
            comparison = of_folder(folder).comparison(steps)
        notes += comparison.notes
        beside = {each.name: drive.controlled(each.around(software.config))[0] for each in comparison.baselines}
    facts = {"build": str(folder), "scenario": driven.name, "edited": list(software.edited)}
    if sensors:
        facts["sensors"] = f"seed {seed}"
    recording = Recording(
        title=str(folder),
        config=software.config,
        scenario=driven,
        records={CONTROLLED: controlled, **beside, PASSIVE: passive},
        facts=facts,
        on_bus=result,
        look_up=software.map_yaw_rate,
        covers=coverage(read_build(folder)),
    )
    return Run(recording, (*notes, *edited_notes(folder, software.edited)), car_warnings(software.config))


def _refuse(plant: str, through_can: bool, drift_ppm: float | None, jitter_ms: float | None, sensors: bool) -> None:
    """Raise CodegenError for options that do not go together."""
    if plant != "two-track" and through_can:
        raise CodegenError(
            "runs through CAN frames support only the two-track car", where="`plant=`", remedy="leave `through_can=` out"
        )
    if sensors and not through_can:
        raise CodegenError("sensors are simulated only with CAN frames", where="`sensors=`", remedy="add `through_can=True`")
    if (drift_ppm is not None or jitter_ms is not None) and not through_can:
        where = "`jitter_ms=`" if drift_ppm is None else "`clock_drift_ppm=`"
        raise CodegenError(
            "clock drift and jitter are simulated only with CAN frames", where=where, remedy="add `through_can=True`"
        )


@dataclass(frozen=True)
class _Drive:
    """A scenario, and how it is driven."""

    scenario: Scenario
    plant: str
    through_can: bool
    sensors: bool
    seed: int

    def controlled(self, software: Software) -> tuple[FloatArray, BenchResult | None]:
        """Return a recording of a controller, and the bus statistics if the run uses frames."""
        if self.plant == "roll":
            return third_plant.run(software, software.config, self.scenario, seed=self.seed), None
        if not self.through_can:
            return bench.run(software, self.scenario), None
        result = bench.run_through_can(software, self.scenario, sensors=self.sensors, seed=self.seed)
        return result.record, result

    def passive(self, software: Software) -> FloatArray:
        """Return a recording of the same car with its rear wheels straight."""
        if self.plant == "roll":
            return third_plant.run(None, software.config, self.scenario, seed=self.seed)
        return bench.run(software, self.scenario, controlled=False)

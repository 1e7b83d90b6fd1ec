"""Value types of the command line with shell completion (see `codegen.cli.completion`), and the options that commands share.

The module avoids slow imports. Items that cannot be read are not offered.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from codegen.cli.base import json_option
from codegen.errors import CodegenError
from codegen.files import read_text
from codegen.library.quantities import MEMORY_KIND, YAW_RATE_KIND, Kind
from codegen.logs.formats import ENDINGS

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    Items = list[CompletionItem[str]]


PATH = "path"
"""Type of an item that is a file or a folder: the shell quotes it and adds no space after a folder."""

MANIFEST = "manifest.json"
OF_EVERY_CASE = ("fws", "4ws-1", "4ws-2")
"""Cases of all presets. They are repeated here, as the scenarios are, because reading the presets would delay completion."""
FOR_COMPARISON = ("zero-sideslip", "variable-wheelbase", "envelope")
"""Cases that every configuration has, `configuration.REFERENCE_CASES`, repeated for the same reason."""
SCENARIO_NAMES = (
    "step-steer",
    "ramp-steer",
    "sine-with-dwell",
    "sine-sweep",
    "speed-ramp",
    "low-friction",
    "low-friction-estimated",
    "split-friction",
    "yaw-moment",
    "ecu-loss",
    "double-lane-change",
    "slalom",
)
INTERFACES = ("socketcan:vcan0", "udp_multicast:239.74.163.2", "virtual:bench")
SCENARIO_ENDINGS = (".csv", ".toml")
RESULT_ENDINGS = (".csv", ".parquet", ".mf4", ".blf", ".asc", ".log", ".json")


class FileType(click.Path):
    """A path like `click.Path`, with completion of files that have certain endings, and of folders on the way to them.

    Args:
        endings: file endings, such as (".npz",); empty for folders only, None for any file.
        to_write: whether the file may be a new one; the endings are then completed as well.
        builds: whether folders made by `codegen build` are expected.
    """

    def __init__(self, endings: tuple[str, ...] | None = None, *, to_write: bool = False, builds: bool = False) -> None:
        super().__init__(path_type=Path)
        self.endings, self.to_write, self.builds = endings, to_write, builds

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> Items:
        """Return the files and folders that begin with `incomplete`."""
        del ctx, param
        found = list(self._found(incomplete))
        if self.to_write and self.endings:
            found += [name for name in _with_endings(incomplete, self.endings) if name not in found]
        return [_item(name, PATH) for name in found]

    def _found(self, incomplete: str) -> Iterable[str]:
        folder, start = os.path.split(incomplete)
        for entry in _entries(folder):
            if not entry.name.startswith(start) or (entry.name.startswith(".") and not start.startswith(".")):
                continue
            name = os.path.join(folder, entry.name)  # noqa: PTH118 - as the user typed it: "./x" stays "./x"
            if _is_folder(entry):
                is_build = self.builds and Path(entry, MANIFEST).is_file()
                yield name if is_build else f"{name}/"
            elif not self.builds and (self.endings is None or entry.name.lower().endswith(self.endings or "/")):
                yield name


def scenario_names(context: click.Context, parameter: click.Parameter, incomplete: str) -> Items:
    """Return the built-in scenarios and files that may contain one."""
    named = [_item(name) for name in SCENARIO_NAMES if name.startswith(incomplete)]
    return named + FileType(SCENARIO_ENDINGS).shell_complete(context, parameter, incomplete)


def case_names(context: click.Context, parameter: click.Parameter, incomplete: str) -> Items:
    """Return the cases of the ars.toml on the command line, or else those of the presets, and the cases for comparison."""
    del parameter
    names = dict.fromkeys((*_cases(context.params.get("config")), *FOR_COMPARISON))
    return [_item(name) for name in names if name.startswith(incomplete)]


def bus_names(context: click.Context, parameter: click.Parameter, incomplete: str) -> Items:
    """Return common buses, and the CAN interfaces of this machine."""
    del context, parameter
    here = [f"socketcan:{name}" for name in can_interfaces()]
    names = dict.fromkeys((*here, *INTERFACES))
    return [_item(name) for name in names if name.startswith(incomplete)]


def can_interfaces() -> list[str]:
    """Return the names of the CAN interfaces of this machine; ARPHRD_CAN of linux/if_arp.h is 280."""
    found = []
    for entry in _entries("/sys/class/net"):
        try:
            is_can = Path(entry, "type").read_text(encoding="ascii").strip() == "280"
        except (OSError, ValueError):
            continue
        if is_can:
            found.append(entry.name)
    return found


def result_names(context: click.Context, parameter: click.Parameter, incomplete: str) -> Items:
    """Return files that `codegen report --run` accepts, with or without a leading `NAME=`."""
    name, sign, path = incomplete.rpartition("=")
    found = FileType(RESULT_ENDINGS).shell_complete(context, parameter, path)
    return [_item(f"{name}{sign}{item.value}", item.type) for item in found]


def _item(value: str, kind: str = "plain") -> CompletionItem[str]:
    from click.shell_completion import CompletionItem

    return CompletionItem(value, kind)


def _cases(config_path: Any) -> tuple[str, ...]:
    if config_path is None:
        return OF_EVERY_CASE
    import tomllib

    from codegen.configuration import CONFIG_BYTES_MAX

    try:
        text = read_text(Path(config_path), CONFIG_BYTES_MAX, "")
        cases = tomllib.loads(text).get("cases", {})
    except (CodegenError, ValueError):
        return OF_EVERY_CASE
    return tuple(cases) if isinstance(cases, dict) and cases else OF_EVERY_CASE


def _entries(folder: str) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(os.path.expanduser(folder) or ".") as listing:  # noqa: PTH111
            return sorted(listing, key=lambda entry: entry.name)
    except (OSError, ValueError):
        return []


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        return False


def _with_endings(incomplete: str, endings: Iterable[str]) -> list[str]:
    """Return `run` as run.blf, run.asc, ...; `run.b` as run.blf."""
    stem, ending = os.path.splitext(incomplete)  # noqa: PTH122
    if not os.path.basename(stem):  # noqa: PTH119
        return []
    return [stem + each for each in endings if each.startswith(ending)]


class FiniteRange(click.FloatRange):
    """A number within a range. Rejects NaN, which the comparisons of click do not exclude."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Convert a value. Raises click.BadParameter: not a number, or out of range."""
        number = float(super().convert(value, param, ctx))
        if math.isnan(number):
            self.fail(f"{value!r} is not a number", param, ctx)
        return number


class QuantityType(click.ParamType[str]):
    """A positive number with its unit, such as 0.05deg/s, as the library takes it."""

    def __init__(self, kind: Kind) -> None:
        self.name, self.kind = kind.name, kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Check a value. Raises click.BadParameter: no number, no unit or an unknown one, or an impossible value."""
        try:
            return self.kind.read(value).words
        except CodegenError as error:
            self.fail(f"{error.what}; {error.remedy}", param, ctx)


yaw_rate_error, memory_size = QuantityType(YAW_RATE_KIND), QuantityType(MEMORY_KIND)
any_file = FileType()
map_file, map_to_write = FileType((".npz",)), FileType((".npz",), to_write=True)
configuration_file = FileType((".toml",))
checked_path = FileType((".toml", ".npz"))
build_folder = FileType((), builds=True)
folder_to_write = FileType(())
picture_to_write = FileType((".png", ".svg"), to_write=True)
csv_to_write = FileType((".csv",), to_write=True)
run_to_write = FileType((".mf4", ".parquet", ".mat", ".csv"), to_write=True)
report_to_write = FileType((".html",), to_write=True)
drive_log = FileType(ENDINGS)
log_to_write = FileType((".blf", ".asc", ".log", ".mf4"), to_write=True)


Command = TypeVar("Command", bound=Callable[..., Any])

DEFAULT_SCENARIO = "step-steer"
SCENARIO_HELP = "One of codegen scenarios, a recorded .csv, or a .toml of your own."
OUTPUT_HELP = "Write the run: .mf4, .parquet, .mat or .csv; may be repeated."

build_option = click.option("--build", required=True, type=build_folder, metavar="DIR", help="A folder made by codegen build.")
database_option = click.option(
    "--dbc",
    multiple=True,
    type=FileType((".dbc", ".arxml")),
    metavar="FILE",
    help="Database for the log of a bus, DBC or ARXML; may be repeated.",
)
channel_option = click.option(
    "--channel", metavar="NAME", help="Use the frames of this channel of a log only, as the log names it: can0, 1."
)
signals_option = click.option(
    "--signals",
    type=configuration_file,
    metavar="TOML",
    help="names.toml: names, units and signs of the signals, column of the time, channel, if they are not obvious.",
)
bus_option = click.option(
    "--bus",
    "bus",
    required=True,
    metavar="INTERFACE:CHANNEL",
    shell_complete=bus_names,
    help="Interface and channel of python-can, e.g. socketcan:vcan0.",
)
scenario_option = click.option(
    "--scenario",
    "scenario",
    default=DEFAULT_SCENARIO,
    show_default=True,
    metavar="NAME|FILE",
    shell_complete=scenario_names,
    help=SCENARIO_HELP,
)
clock_option = click.option(
    "--lock-step/--real-time",
    "lock_step",
    default=False,
    help="Run in simulated time, as fast as possible, or in real time (default).",
)
xcp_option = click.option(
    "--xcp", is_flag=True, help="Let a calibration tool measure and calibrate the native ECU: XCP on CAN, ids of [xcp]."
)
log_option = click.option("--log", type=log_to_write, metavar="FILE", help="Log the bus: .blf, .asc, .log (candump) or .mf4.")


def output_option(text: str, metavar: str = "FILE") -> Callable[[Command], Command]:
    """Return the option -o, --output, which may be repeated: the run as a file in the format of the extension."""
    return click.option("-o", "--output", "files", type=run_to_write, multiple=True, metavar=metavar, help=text)


def sensor_options(command: Command) -> Command:
    """Add --sensors and --seed."""
    command = click.option(
        "--seed",
        type=click.IntRange(min=0),
        default=0,
        show_default=True,
        help="Seed of noise, faults, jitter and random cars.",
    )(command)
    return click.option("--sensors", is_flag=True, help="Simulate the noise, bias, delay and resolution of [sensors].")(command)


def drift_options(command: Command) -> Command:
    """Add --clock-drift and --jitter."""
    command = click.option(
        "--jitter",
        "jitter_ms",
        type=FiniteRange(min=0.0, max=100.0),
        metavar="MS",
        help="Largest deviation of frames and task from their clocks.",
    )(command)
    return click.option(
        "--clock-drift",
        "clock_drift_ppm",
        type=FiniteRange(min=-1e4, max=1e4),
        metavar="PPM",
        help="Let the car's clock run faster than the ECU's.",
    )(command)


def result_options(command: Command) -> Command:
    """Add --plot, --csv and --json."""
    command = json_option(command)
    command = click.option("--csv", type=csv_to_write, metavar="CSV", help="Write the run, units in the column names.")(command)
    return click.option("--plot", type=picture_to_write, metavar="PNG|SVG", help="Plot the run and the passive car.")(command)


def run_options(command: Command) -> Command:
    """Add all options of a run on a bus."""
    output = output_option(OUTPUT_HELP)
    options = (result_options, output, log_option, drift_options, sensor_options, clock_option, scenario_option, bus_option)
    for option in options:
        command = option(command)
    return command


def check_picture(path: Path | None, inputs: Iterable[Path | None] = ()) -> None:
    """Reject a picture that is neither PNG nor SVG, or that would destroy something: see `check_output`."""
    from codegen.emit.folder import check_output
    from codegen.figures.draw import kind_of

    if path is not None:
        check_output(path, f".{kind_of(path)}", inputs)

"""The account of a log: what is in it, what is read, and what is not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from codegen.identify.names import Names, load_names
from codegen.library.result import PathLike, Progress, Result, Work, path_of, public
from codegen.logs import account, measurement
from codegen.logs.account import BusLog
from codegen.logs.databases import Databases
from codegen.logs.measurement import Account
from codegen.text import text_table


class Log(Result):
    """The account of the log of a bus, or of a measurement.

    Attributes:
        is_bus: whether it is the log of a bus.
        findings: all that is not plain about it.
    """

    def __init__(self, found: BusLog | Account) -> None:
        self._found, self.is_bus = found, isinstance(found, BusLog)
        if isinstance(found, BusLog):
            self.findings = tuple(account.findings(found))
        else:
            self.findings = (*found.findings, *found.channel_findings)

    def lines(self) -> Iterator[str]:
        """Yield the numbers of frames or rows, a row for each channel and identifier, and the findings."""
        found = self._found
        if isinstance(found, BusLog):
            yield from account.summary_lines(found)
            if len(found.frames):
                yield from ("", text_table(account.BUS_CHANNEL_HEADER, account.channel_cells(found), left=2))
                yield from ("", text_table(account.IDENTIFIER_HEADER, account.identifier_cells(found), left=4))
        else:
            yield from measurement.summary_lines(found)
            yield from ("", text_table(measurement.GROUP_HEADER, measurement.group_cells(found), left=1))
            if found.channels:
                yield from ("", text_table(measurement.MEASUREMENT_CHANNEL_HEADER, measurement.channel_cells(found), left=3))
        yield from ("", *(self.findings or ["no findings"]))

    def to_dict(self) -> dict[str, Any]:
        """Return the same facts."""
        return account.to_dict(self._found)


def paths_of(paths: PathLike | Sequence[PathLike], what: str) -> tuple[Path, ...]:
    """Return one or several paths as a tuple. Raises CodegenError."""
    return tuple(path_of(path, what) for path in ([paths] if isinstance(paths, (str, Path)) else paths))


def names_of(signals: PathLike | None, channel: str | None) -> Names:
    """Return the names of a file, with a channel that replaces its own. Raises CodegenError."""
    names = Names() if signals is None else load_names(path_of(signals, "a names.toml"))
    return names if channel is None else names.model_copy(update={"channel": channel})


@public
def log(
    path: PathLike,
    dbc: PathLike | Sequence[PathLike] = (),
    *,
    channel: str | None = None,
    signals: PathLike | None = None,
    progress: Progress | None = None,
) -> Log:
    """Account for every frame of the log of a bus (.blf, .asc, .log, .mf4) or row of a measurement (.mf4, .csv, .parquet).

    Args:
        path: the log.
        dbc: databases of the bus, DBC or ARXML.
        channel: use the frames of this channel only, as the log names it.
        signals: names.toml, if signals and columns have no obvious names.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: the file cannot be read, or has no such channel.
    """
    place, names = path_of(path, "a log"), names_of(signals, channel)
    with Work(progress).status(f"reading {place.name}"):
        databases = Databases(paths_of(dbc, "a database"))
        return Log(account.open_log(place, databases, names.channel, names.time, names.time_unit))

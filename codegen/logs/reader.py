"""Reading of logs of a CAN bus (BLF, ASC, candump or MF4)."""

from __future__ import annotations

from pathlib import Path

from codegen.errors import CodegenError, one_line
from codegen.files import reason_of, refuse_empty, require_regular
from codegen.importing import child
from codegen.limits import Limits
from codegen.logs.formats import LOGS
from codegen.logs.frames import BYTES_MAX, REMEDY, Collector, FileAccount, Frames
from codegen.requirements import pip_install


def read_frames(path: Path) -> tuple[Frames, FileAccount]:
    """Read the frames of a log, on one clock, and account for every frame of the file.

    Raises:
        CodegenError: no log by its name, not a regular file, over 1 GiB, damaged or cut short, or its reader is not installed.
    """
    kind = path.suffix.lower()
    if kind not in LOGS:
        raise CodegenError("not a log of a CAN bus", where=path, remedy="give .blf, .asc, .log (candump) or .mf4 (version 4)")
    size = require_regular(path, BYTES_MAX, "name a log", smaller="give a shorter log")
    refuse_empty(size, path)
    limits = Limits.of(size)
    try:
        if kind == ".mf4":
            found: tuple[Frames, FileAccount] = child.call("codegen.logs.mf4", "read", path, limits=limits)
            return found
        with limits.enforced(path):
            with child.collected() as warnings:
                into, clock = LOG_READERS[kind](path)
            return into.finish(clock, warnings)
    except CodegenError:
        raise
    except OSError as error:
        raise CodegenError(f"cannot be read ({reason_of(error)})", where=path, remedy="check its permissions") from None
    except ImportError as error:
        what = f"the package that reads it is missing ({one_line(error)})"
        raise CodegenError(what, where=path, remedy=pip_install("asammdf")) from None
    except Exception as error:  # readers may raise anything for a damaged file
        raise CodegenError(f"not a readable log of a CAN bus ({one_line(error)})", where=path, remedy=REMEDY) from None


def _blf(path: Path) -> tuple[Collector, str]:
    from codegen.logs import blf  # here, as python-can takes half a second

    return blf.read(path)


def _asc(path: Path) -> tuple[Collector, str]:
    from codegen.logs import text

    return text.read_asc(path)


def _candump(path: Path) -> tuple[Collector, str]:
    from codegen.logs import text

    return text.read_candump(path)


LOG_READERS = {".blf": _blf, ".asc": _asc, ".log": _candump}

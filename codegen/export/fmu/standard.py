"""The headers of the FMI standard and their licence, from the package `fmpy`."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Literal

from codegen.errors import CodegenError

Version = Literal["2", "3"]
VERSIONS: tuple[Version, ...] = ("2", "3")

_HEADERS = {
    "2": ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    "3": ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
_LICENCE = re.compile(r"^ *Copyright \(C\).*?POSSIBILITY OF SUCH DAMAGE\.$", re.DOTALL | re.MULTILINE)


def headers(version: Version) -> dict[str, bytes]:
    """Return name -> content of the standard's C headers. Raises CodegenError: fmpy or its headers are missing."""
    remedy = 'pip install "ars-codegen[tools]"'
    # Located, not imported: only its files are needed, and its import is slow.
    found = importlib.util.find_spec("fmpy")
    if found is None or found.origin is None:
        raise CodegenError("fmpy, which has the headers of the FMI standard, is missing", where="codegen fmu", remedy=remedy)
    folder = Path(found.origin).parent / "c-code"
    try:
        return {name: (folder / name).read_bytes() for name in _HEADERS[version]}
    except OSError as error:
        raise CodegenError(f"cannot be read ({error.strerror})", where=folder, remedy=remedy) from None


def licence(files: dict[str, bytes]) -> bytes:
    """Return the licence text that the headers contain."""
    names = ", ".join(sorted(files))
    for content in files.values():
        text = content.decode("utf-8", "replace").replace("\r\n", "\n")
        if found := _LICENCE.search(text):
            lines = [line.strip() for line in found[0].split("\n")]
            return (f"Of the files {names}:\n\n" + "\n".join(lines) + "\n").encode()
    raise CodegenError("the headers of the FMI standard state no licence", where="fmpy", remedy="install fmpy again")

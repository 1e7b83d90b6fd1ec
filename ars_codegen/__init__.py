"""Start of the commands `codegen` and `ars-codegen`.

A distribution named `codegen` installs a package and a command of the same names. Installed over this one, it replaces
files, and its removal deletes them. Therefore the package `codegen` is imported only if it has the mark of this distribution.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

TYPE_CHECKING = False  # avoids importing typing
if TYPE_CHECKING:
    from importlib.metadata import Distribution
    from typing import NoReturn

DISTRIBUTION = "ars-codegen"
PACKAGE = "codegen"
MARK = f'DISTRIBUTION = "{DISTRIBUTION}"'.encode()
"""Line of `codegen/__init__.py`."""
EXIT_BAD_INPUT = 2


def main() -> NoReturn:
    """Run the command; print one line and exit with code 2 if the package `codegen` belongs to another distribution."""
    spec = find_spec(PACKAGE)
    file = Path(spec.origin) if spec is not None and spec.origin is not None else None
    if file is None or MARK not in file.read_bytes():
        print(f"error: {_explanation(file)}", file=sys.stderr)
        raise SystemExit(EXIT_BAD_INPUT)
    from codegen.cli import main as run

    run()


def _explanation(file: Path | None) -> str:
    """Return what is wrong with the package, where, and the command that repairs it."""
    from importlib.metadata import distributions

    installed = {each.name: each for each in reversed([*distributions()])}  # of one name, the first on the path is in use
    repair = f"pip install --force-reinstall --no-deps {_source(installed.pop(DISTRIBUTION, None))}"
    if file is None:
        folder = Path(__file__).resolve().parents[1] / PACKAGE
        return f"{folder}: files of {DISTRIBUTION} are missing, as after the removal of another package {PACKAGE}; {repair}"
    for name, other in installed.items():
        if any(path.name == file.name and Path(str(other.locate_file(path))) == file for path in other.files or ()):
            return f"{file}: belongs to {name} {other.version}, not to {DISTRIBUTION}; pip uninstall {name} && {repair}"
    return f"{file}: does not belong to {DISTRIBUTION}; remove it from the search path of Python, or {repair}"


def _source(ours: Distribution | None) -> str:
    """Return the argument of pip for the checkout or the wheel that this distribution was installed from."""
    import json
    import shlex
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    record = json.loads((ours.read_text("direct_url.json") if ours is not None else None) or "{}")
    url = urlsplit(record.get("url", ""))
    if url.scheme != "file":
        return "CHECKOUT-OR-WHEEL"
    return "-e " * bool(record.get("dir_info", {}).get("editable")) + shlex.quote(url2pathname(url.path))

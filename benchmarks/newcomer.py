"""A newcomer's first command: `make sil` on a fresh checkout, from nothing to tables and report, download aside."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.timing import Comparison, Report, Times
from codegen.errors import CodegenError

ROOT = Path(__file__).resolve().parents[1]
LIMIT = Times("asked: 3 minutes", (180.0,))


def run(quick: bool, say: Callable[[str], None]) -> Report:
    """Fetch the packages, then time `make sil` in a fresh clone, once.

    Raises:
        CodegenError: no package index, no git, or a command that fails.
    """
    del quick
    with tempfile.TemporaryDirectory(prefix="ars-newcomer-") as scratch:
        checkout, packages, home = (Path(scratch, name) for name in ("checkout", "packages", "home"))
        home.mkdir()
        say("cloning")
        _done(["git", "clone", "-q", str(ROOT), str(checkout)])
        say("fetching the packages of requirements.lock, which does not count")
        lock = str(checkout / "requirements.lock")
        _done([sys.executable, "-m", "pip", "download", "-q", "--require-hashes", "-r", lock, "-d", str(packages)])
        # Nothing of this user's: neither settings nor what was compiled before.
        offline = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": packages.as_uri(), "PIP_CONFIG_FILE": os.devnull}
        environment = {"PATH": os.environ["PATH"], "HOME": str(home), **offline}
        say("make sil")
        begun, start = time.time(), time.perf_counter()
        _done(["make", "sil", f"PYTHON={sys.executable}"], cwd=checkout, environment=environment)
        whole = time.perf_counter() - start
        installed = (checkout / ".venv" / ".ready").stat().st_mtime - begun
        pages = [path.relative_to(checkout) for path in (checkout / "build").glob("*.html")]
    if not pages:
        raise CodegenError("no report came out", where="make sil", remedy="see what it prints")
    made = f"tables, plots and {', '.join(map(str, pages))} {whole - installed:.0f} s"
    notes = (f"installing {installed:.0f} s, of it no download; {made}",)
    return Report(
        "A newcomer's first command, on a fresh checkout",
        (Comparison("make sil", LIMIT, Times("make sil", (whole,)), required=1.0, paired=False),),
        notes,
    )


def _done(words: list[str], cwd: Path | None = None, environment: dict[str, str] | None = None) -> None:
    try:
        result = subprocess.run(words, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    except OSError as error:
        raise CodegenError(f"cannot be run ({error.strerror})", where=words[0], remedy="install it") from None
    if result.returncode:
        said = (result.stderr.strip() or result.stdout.strip() or "nothing was said").splitlines()[-1]
        raise CodegenError(f"exit code {result.returncode}: {said}", where=" ".join(words[:4]), remedy="run it by hand")

"""The parts of the evidence: what each shows, what it is about and the code that it runs.

A part is either a module with `run(folders, effort, progress) -> Outcome` or a folder of pytest files of the same name. Its
record names the hashes of its subject and of its own code; if either changes, the record is out of date.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.verify.check import Effort, Outcome
from tests.evidence.progress import Progress

ROOT = Path(__file__).parents[2]
FOLDERS = (ROOT / "generated" / "4ws2", ROOT / "generated" / "4ws2-tracking")
RECORDS = ROOT / "docs" / "evidence"

Run = Callable[[Sequence[Path], Effort, Progress], Outcome]


@dataclass(frozen=True)
class Part:
    """A part of the evidence.

    Attributes:
        name: name on the command line and of the record.
        shows: what it shows if it passes, one sentence without its full stop.
        subject: patterns of the files that it is about, relative to the checkout. own: patterns of the code that it runs.
        module: module with `run`; empty for a folder of pytest files.
        worker_count: processes that share the tests of a folder; 0 for none beside pytest itself.
        is_optional: whether the part may be missing, because few have its tool.
    """

    name: str
    shows: str
    subject: tuple[str, ...]
    own: tuple[str, ...]
    module: str = ""
    worker_count: int = 2
    is_optional: bool = False

    @property
    def folder(self) -> Path:
        """Folder of the pytest files of a part without a module."""
        return ROOT / "tests" / "evidence" / self.name

    def hashes(self) -> dict[str, str]:
        """Return the SHA-256 of the subject and of the part's own code, over names and contents of the files."""
        return {"subject": hash_of(self.subject), "own_code": hash_of(self.own)}


def hash_of(patterns: Sequence[str], root: Path = ROOT) -> str:
    """Return the SHA-256 over names and contents of all files that match one of the patterns; compiled Python is left out."""
    found = {path for pattern in patterns for path in root.glob(pattern) if path.is_file() and "__pycache__" not in path.parts}
    digest = hashlib.sha256()
    for path in sorted(found):
        digest.update(f"{path.relative_to(root).as_posix()} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()


C = ("generated/4ws2*/include/*", "generated/4ws2*/src/*")
MAPS = ("generated/*.npz",)
GENERATOR = ("templates/**/*", "codegen/emit/**/*", "codegen/refmap/**/*", "codegen/vehicle/**/*")
CHECKS_OF_THE_C = ("tests/sil/*", "tests/builds.py", "codegen/verify/law/*", "codegen/sil/*")

PARTS = (
    Part(
        "builds",
        "all checks of `codegen verify` pass on both committed builds: compilers, static analysis, processor in the loop, "
        "budgets, control law, proof, sanitizers, fuzzing",
        ("generated/4ws2*/manifest.json", *C),
        ("codegen/verify/**/*", "templates/verify/*", "tests/evidence/builds.py"),
        "tests.evidence.builds",
    ),
    Part(
        "verify",
        "each check of `codegen verify` finds what it is there for, in every kind of controller",
        ("codegen/verify/**/*", "templates/verify/*"),
        ("tests/evidence/verify/*",),
    ),
    Part(
        "mutation",
        "the tests of the C see every small fault in it, or it is argued why no input can show it",
        (*C, *MAPS),
        ("tests/evidence/mutation/*", *CHECKS_OF_THE_C),
        "tests.evidence.mutation.mutation",
    ),
    Part(
        "faults",
        "a fault that is planted in the C fails just those checks of `codegen verify` that are there for it",
        C,
        ("tests/evidence/faults/*", "codegen/verify/**/*", "templates/verify/*"),
        "tests.evidence.faults.planted",
    ),
    Part(
        "coverage",
        "the tests of the C run every line and every branch of it",
        C,
        ("tests/evidence/coverage/*", *CHECKS_OF_THE_C),
        "tests.evidence.coverage.coverage",
    ),
    Part(
        "mcdc",
        "in the tests of the C every condition decides by itself",
        C,
        ("tests/evidence/coverage/*", *CHECKS_OF_THE_C),
        "tests.evidence.coverage.mcdc",
    ),
    Part(
        "exhaustive",
        "helpers of one argument are right for all 2^32 inputs",
        C,
        ("tests/evidence/exhaustive/*",),
        "tests.evidence.exhaustive.exhaustive",
    ),
    Part(
        "libfuzzer",
        "libFuzzer, guided by coverage, finds no crash and no broken bound",
        C,
        ("tests/evidence/libfuzzer/*", "templates/verify/*"),
        "tests.evidence.libfuzzer.libfuzzer",
    ),
    Part(
        "frama-c",
        "Frama-C finds no undefined behaviour",
        C,
        ("tests/evidence/frama_c/*",),
        "tests.evidence.frama_c.frama_c",
        is_optional=True,
    ),
    Part(
        "kinds",
        "the checks of the C pass for every kind of controller, precision, map and storage",
        GENERATOR,
        ("tests/evidence/kinds/*", *CHECKS_OF_THE_C),
    ),
    Part(
        "toolchains",
        "the C builds and runs with other compilers, in CMake and Make projects, and as firmware in QEMU",
        (*GENERATOR, "codegen/export/**/*"),
        ("tests/evidence/toolchains/*",),
    ),
    Part(
        "ipopt",
        "the optimum is that of IPOPT and of a search by brute force, on whole grids and for random cars",
        ("codegen/refmap/**/*", "codegen/vehicle/**/*"),
        ("tests/evidence/ipopt/*",),
    ),
    Part(
        "drives",
        "long closed-loop suites, a second plant and campaigns end as they should",
        ("codegen/design/*", "codegen/sweep/**/*", "hil_sim/**/*", "generated/4ws2*/src/*"),
        ("tests/evidence/drives/*",),
    ),
    Part(
        "vcan",
        "the bench works on real SocketCAN",
        ("hil_sim/**/*", "templates/linux/*", "generated/4ws2*/linux/*"),
        ("tests/evidence/vcan/*",),
        worker_count=0,  # one guest for all tests, which go by its clock
    ),
    Part(
        "browser",
        "report and explorer work in a browser",
        ("codegen/report/**/*", "codegen/explore/**/*", "templates/report/*", "templates/explore/*"),
        ("tests/evidence/browser/*",),
    ),
    Part(
        "guide",
        "the commands of README and guide run, and print what stands there",
        ("README.md", "docs/*.md", "codegen/cli/*"),
        ("tests/evidence/guide/*",),
    ),
    Part(
        "install",
        "wheel, source distribution and make targets work in a fresh environment",
        ("pyproject.toml", "requirements.lock", "Makefile", "scripts/*"),
        ("tests/evidence/install/*",),
    ),
)
BY_NAME = {part.name: part for part in PARTS}

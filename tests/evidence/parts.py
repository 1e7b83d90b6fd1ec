"""The parts of the evidence: what each shows, what it is about and the code that it runs.

A part is either a module with `run(folders, effort, progress) -> Outcome` or a folder of pytest files of the same name. Its
record names the hashes of its subject and of its own code; if either changes, the record is out of date.
"""

import ast
import functools
import hashlib
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.verify.check import Effort, Outcome
from tests.evidence.progress import Progress

ROOT = Path(__file__).parents[2]
FOLDERS = (ROOT / "generated" / "4ws2-paper", ROOT / "generated" / "4ws2")
RECORDS = ROOT / "docs" / "evidence"

PACKAGES = {
    "gcov": "gcc",
    "clang-19": "clang-19 libclang-rt-19-dev",
    "llvm-profdata-19": "llvm-19",
    "llvm-cov-19": "llvm-19",
    "arm-none-eabi-gcc": "gcc-arm-none-eabi",
}
"""Debian's packages with a program, where their names differ."""

Run = Callable[[Sequence[Path], Effort, Progress], Outcome]


@dataclass(frozen=True)
class Part:
    """A part of the evidence.

    Attributes:
        name: name on the command line and of the record.
        shows: what it shows if it passes, one sentence without its full stop.
        subject: patterns of the files that it is about, relative to the checkout.
        module: module with `run`; empty for a folder of pytest files of the part's name.
        runs: patterns of code outside `tests` that it runs, beside its subject.
        worker_count: processes that share the tests of a folder; 0 for none beside pytest itself.
        tools: programs that it needs beside a C compiler.
    """

    name: str
    shows: str
    subject: tuple[str, ...]
    module: str = ""
    runs: tuple[str, ...] = ()
    worker_count: int = 2
    tools: tuple[str, ...] = ()

    @property
    def own(self) -> tuple[str, ...]:
        """Patterns of the code that it runs, relative to the checkout; what this imports from `tests` belongs to it too."""
        *folder, module = self.module.split(".") if self.module else ["tests", "evidence", self.name, ""]
        by_pytest = () if self.module else ("tests/conftest.py", "tests/evidence/conftest.py", "tests/evidence/pytest_part.py")
        return ("/".join(folder) + ("/*" if len(folder) > 2 else f"/{module}.py"), *by_pytest, *self.runs)

    @property
    def folder(self) -> Path:
        """Folder of the pytest files of a part without a module."""
        return ROOT / "tests" / "evidence" / self.name

    def missing_tools(self) -> tuple[str, ...]:
        """Return a sentence with its remedy for each program that is not installed."""
        missing = [name for name in self.tools if shutil.which(name) is None]
        return tuple(f"{name} is not installed: apt install {PACKAGES.get(name, name)}" for name in missing)

    def hashes(self) -> dict[str, str]:
        """Return the SHA-256 of the subject and of the part's own code, over names and contents of the files."""
        return {"subject": hash_of(matching(self.subject)), "own_code": hash_of(with_imports(matching(self.own)))}


def matching(patterns: Iterable[str], root: Path = ROOT) -> set[Path]:
    """Return all files that match one of the patterns; compiled Python is left out."""
    return {path for pattern in patterns for path in root.glob(pattern) if path.is_file() and "__pycache__" not in path.parts}


def with_imports(files: set[Path], root: Path = ROOT) -> set[Path]:
    """Return files and all modules of `tests` that they import, directly or not, with the data that lie beside those modules.

    This module is left out: its patterns show in the hashes, and another sentence in it does not make a record wrong.
    """
    todo, found = set(files), set[Path]()
    while todo:
        path = todo.pop()
        found.add(path)
        package = path.parent.relative_to(root).parts
        if path.suffix == ".py" and package[0] == "tests":
            modules = {root.joinpath(*name) for name in _imported(path.read_bytes(), package)}
            sources = {file for at in modules for file in (at.with_suffix(".py"), at / "__init__.py") if file.is_file()}
            data = {file for source in sources for file in matching(("*",), source.parent) if file.suffix != ".py"}
            todo |= (sources | data) - found - {root / "tests/evidence/parts.py"}
    return found


@functools.cache
def _imported(source: bytes, package: tuple[str, ...]) -> frozenset[tuple[str, ...]]:
    """Return the names, split at their dots, of all modules of `tests` that a module of a package may import."""
    names = set[tuple[str, ...]]()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {tuple(alias.name.split(".")) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else ()
            base = (*start, *(node.module.split(".") if node.module else ()))
            names |= {base, *((*base, alias.name) for alias in node.names)}
    return frozenset(name[:end] for name in names if name[0] == "tests" for end in range(2, len(name) + 1))


def hash_of(files: Iterable[Path], root: Path = ROOT) -> str:
    """Return the SHA-256 over names and contents of files."""
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(f"{path.relative_to(root).as_posix()} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()


C = ("generated/4ws2*/include/*", "generated/4ws2*/src/*")
CONFIG = ("codegen/configuration/**/*",)
"""The configuration. It reaches the committed C through `generated` alone, so the parts about that C leave it out."""
MAPS = ("codegen/map_file/*", "codegen/optimum/*", "codegen/ecu_map/*", "codegen/vehicle/**/*", *CONFIG)
GENERATOR = ("templates/**/*", "codegen/emit/**/*", *MAPS)
TUNING = ("codegen/design/*", "codegen/tuning/*")
COMMANDS = ("codegen/*.py", "codegen/[!e]*/**/*", "codegen/ex*/**/*", "hil_sim/**/*")
"""What the commands run, without `codegen/emit`: `make test` compares the output of that byte by byte."""
SIL = ("codegen/sil/*", "codegen/verify/law/*")
VERIFY = ("codegen/verify/**/*", "templates/verify/*")
FUZZING = ("templates/verify/*", "codegen/verify/fuzzing/*", "codegen/verify/sanitizers/*")
ALL_CHECKS = (
    "all checks of `codegen verify` pass on both committed builds: compilers, static analysis, processor in the loop, budgets, "
    "control law, proof, sanitizers, fuzzing"
)
MUTATION = "the tests of the C see every small fault in it, or it is argued why no input can show it"
FAULTS = "a fault that is planted in the C fails just those checks of `codegen verify` that are there for it"
FINDS = "each check of `codegen verify` finds what it is there for, in every kind of controller"
MCDC = "in the tests of the C every condition decides by itself"
HELPERS = "helpers of one argument are right for all 2^32 inputs"
FUZZED = "libFuzzer, guided by coverage, finds no crash and no broken bound"
KINDS = "the checks of the C pass for every kind of controller, precision, map and storage"
TOOLCHAINS = "the C builds and runs with other compilers, in CMake and Make projects, and as firmware in QEMU"
IPOPT = "the optimum is that of IPOPT and of a search by brute force, on whole grids and for random cars"
DRIVES = "long closed-loop suites, a second plant and campaigns end as they should"
LOADERS = "damaged files of every kind are read, or answered in one line"
INSTALL = "wheel, source distribution and make targets work in a fresh environment"
BENCH = ("hil_sim/**/*", "templates/linux/*", "generated/4ws2*/linux/*", *C, *CONFIG)
DRIVEN = ("codegen/sweep/**/*", "codegen/report/paper.py", "hil_sim/**/*", "generated/4ws2*/src/*", *TUNING, *CONFIG)
FIRMWARE = ("make", "arm-none-eabi-gcc", "qemu-system-arm")
PAGES = ("codegen/report/**/*", "codegen/explore/**/*", "templates/report/*", "templates/explore/*", *TUNING, *CONFIG)
HERE = "tests.evidence"
PARTS = (
    Part("builds", ALL_CHECKS, ("generated/4ws2*/manifest.json", *C), f"{HERE}.builds", VERIFY),
    Part("verify", FINDS, VERIFY),
    Part("mutation", MUTATION, (*C, "generated/*.npz"), f"{HERE}.mutation.mutation", SIL),
    Part("faults", FAULTS, C, f"{HERE}.faults.planted", VERIFY),
    Part(
        "coverage",
        "the tests of the C run every line and every branch of it",
        C,
        f"{HERE}.coverage.coverage",
        SIL,
        tools=("gcc", "gcov"),
    ),
    Part("mcdc", MCDC, C, f"{HERE}.coverage.mcdc", SIL, tools=("clang-19", "llvm-profdata-19", "llvm-cov-19")),
    Part("exhaustive", HELPERS, C, f"{HERE}.exhaustive.exhaustive", ("codegen/verify/sanitizers/*",)),
    Part("libfuzzer", FUZZED, C, f"{HERE}.libfuzzer.libfuzzer", FUZZING, tools=("clang-19",)),
    Part("kinds", KINDS, GENERATOR, runs=SIL),
    Part("toolchains", TOOLCHAINS, (*GENERATOR, "codegen/export/**/*"), runs=SIL, tools=("cmake", *FIRMWARE)),
    Part("ipopt", IPOPT, (*MAPS, "codegen/design/*")),
    Part("drives", DRIVES, DRIVEN, runs=SIL),
    Part(
        "vcan", "the bench works on real SocketCAN", BENCH, runs=SIL, worker_count=0
    ),  # one guest for all tests, which go by its clock
    Part("loaders", LOADERS, COMMANDS, f"{HERE}.loaders.cases"),
    Part("browser", "report and explorer work in a browser", PAGES, tools=("chromium",)),
    Part(
        "guide",
        "the commands of README and guide run, and print what stands there",
        ("README.md", "docs/*.md", *COMMANDS),
        tools=FIRMWARE,
    ),
    Part(
        "install",
        INSTALL,
        ("pyproject.toml", "requirements.lock", "Makefile", "scripts/*"),
        tools=("git", "bash", "fish", "zsh"),
    ),
)

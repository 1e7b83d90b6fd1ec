"""Parts of the evidence: what each shows, its subject and the code that it runs.

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
    "octave-cli": "octave",
    "mkoctfile": "octave-dev",
}
"""Debian packages of programs with another name."""

Run = Callable[[Sequence[Path], Effort, Progress], Outcome]


@dataclass(frozen=True)
class Part:
    """A part of the evidence.

    Attributes:
        name: name on the command line and of the record.
        shows: what it shows if it passes, one sentence without its full stop.
        subject: patterns of the tested files, relative to the checkout.
        module: module with `run`; empty for a folder of pytest files of the part's name.
        runs: patterns of further code outside `tests` that it runs.
        worker_count: processes that share the tests of a folder; 0 for none besides pytest itself.
        tools: programs that it needs besides a C compiler.
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
        """Patterns of its own code, relative to the checkout; imports from `tests` are added."""
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
    """Return all files that match one of the patterns, except compiled Python."""
    return {path for pattern in patterns for path in root.glob(pattern) if path.is_file() and "__pycache__" not in path.parts}


def with_imports(files: set[Path], root: Path = ROOT) -> set[Path]:
    """Return files, all modules of `tests` that they import, directly or not, and the data next to those modules.

    This module is excluded: its patterns affect the hashes anyway, and rewording a sentence does not outdate a record.
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
"""The configuration. It reaches the committed C only through `generated`, so the parts about that C exclude it."""
MAPS = ("codegen/map_file/*", "codegen/optimum/*", "codegen/ecu_map/*", "codegen/vehicle/**/*", *CONFIG)
GENERATOR = ("templates/**/*", "codegen/emit/**/*", *MAPS)
TUNING = ("codegen/design/*", "codegen/tuning/*")
COMMANDS = ("codegen/*.py", "codegen/[!e]*/**/*", "codegen/ex*/**/*", "hil_sim/**/*")
"""Code that the commands run, except `codegen/emit`, whose output `make test` compares byte by byte."""
SIL = ("codegen/sil/*", "codegen/verify/law/*")
VERIFY = ("codegen/verify/**/*", "templates/verify/*")
FUZZING = ("templates/verify/*", "codegen/verify/sanitizers/*")
ALL_CHECKS = (
    "all checks of `codegen verify` pass on both committed builds: compilers, static analysis, processor in the loop, budgets, "
    "control law, sanitizers, contracts, abstract interpretation"
)
MUTATION = "the tests of the C detect every small fault in it, or an argument shows that no input can reveal it"
FAULTS = "each fault planted in the C fails exactly the responsible checks of `codegen verify`"
FINDS = "each check of `codegen verify` finds its kinds of faults, in every kind of controller"
MCDC = "in the tests of the C every condition alone determines a result"
HELPERS = "helpers of one argument are right for all 2^32 inputs"
FUZZED = "libFuzzer, guided by coverage, finds no crash and no broken bound"
KINDS = "the checks of the C pass for every kind of controller, precision, map and storage"
TOOLCHAINS = (
    "the C builds and runs with other compilers, in CMake and Make projects, and as firmware in QEMU; CDF files are valid "
    "against the schema of CDF 2.0"
)
IPOPT = "IPOPT and a brute-force search find the same optimum, on whole grids and for random cars"
DRIVES = "long closed-loop suites, a second plant and campaigns give the expected results"
FOREIGN = "the map from an identified car keeps its slip and sideslip bounds on cars that the model does not describe"
UNCERTAIN = "10,000 cars drawn afresh keep the limits with a map for 99 % of the cars, in at least this share"
LOADERS = "damaged files of every kind are read, or rejected in one line"
LOGS = "codegen identify reads damaged and wrong logs or rejects them in one line, and no file is lost"
INSTALL = "wheel, source distribution and make targets work in a fresh environment"
BENCH = ("hil_sim/**/*", "templates/linux/*", "generated/4ws2*/linux/*", *C, *CONFIG)
DRIVEN = ("codegen/sweep/**/*", "codegen/report/paper.py", "hil_sim/**/*", "generated/4ws2*/src/*", *TUNING, *CONFIG)
IDENTIFIED = ("codegen/identify/*", "templates/identify/*", "hil_sim/second_plant/*", "hil_sim/third_plant.py", *MAPS)
FIRMWARE = ("make", "arm-none-eabi-gcc", "qemu-system-arm")
PAGES = ("codegen/report/**/*", "codegen/explore/**/*", "templates/report/*", "templates/explore/*", *TUNING, *CONFIG)
PACKAGE = "tests.evidence"
PARTS = (
    Part("builds", ALL_CHECKS, ("generated/4ws2*/manifest.json", *C), f"{PACKAGE}.builds", VERIFY),
    Part("verify", FINDS, VERIFY),
    Part("mutation", MUTATION, (*C, "generated/*.npz"), f"{PACKAGE}.mutation.mutation", SIL),
    Part("faults", FAULTS, C, f"{PACKAGE}.faults.planted", VERIFY),
    Part(
        "coverage",
        "the tests of the C execute its every line and branch",
        C,
        f"{PACKAGE}.coverage.coverage",
        SIL,
        tools=("gcc", "gcov"),
    ),
    Part("mcdc", MCDC, C, f"{PACKAGE}.coverage.mcdc", SIL, tools=("clang-19", "llvm-profdata-19", "llvm-cov-19")),
    Part("exhaustive", HELPERS, C, f"{PACKAGE}.exhaustive.exhaustive", ("codegen/verify/sanitizers/*",)),
    Part("libfuzzer", FUZZED, C, f"{PACKAGE}.libfuzzer.libfuzzer", FUZZING, tools=("clang-19",)),
    Part("kinds", KINDS, GENERATOR, runs=SIL),
    Part("toolchains", TOOLCHAINS, (*GENERATOR, "codegen/export/**/*"), runs=SIL, tools=("cmake", *FIRMWARE)),
    Part("ipopt", IPOPT, (*MAPS, "codegen/design/*")),
    Part("uncertain", UNCERTAIN, MAPS, f"{PACKAGE}.uncertain.share"),
    Part("drives", DRIVES, DRIVEN, runs=SIL),
    Part("foreign", FOREIGN, IDENTIFIED, f"{PACKAGE}.foreign.plants", SIL),
    Part(
        "vcan", "the bench works on real SocketCAN", BENCH, runs=SIL, worker_count=0
    ),  # one guest for all tests, which use its clock
    Part("loaders", LOADERS, COMMANDS, f"{PACKAGE}.loaders.cases"),
    Part("logs", LOGS, COMMANDS, f"{PACKAGE}.logs.cases"),
    Part("browser", "report and explorer work in a browser", PAGES, tools=("chromium",)),
    Part(
        "guide",
        "the commands of README and guide run and print the output shown",
        ("README.md", "docs/*.md", *COMMANDS),
        tools=(*FIRMWARE, "octave-cli", "mkoctfile"),
    ),
    Part(
        "install",
        INSTALL,
        ("pyproject.toml", "requirements.lock", "Makefile", "scripts/*"),
        tools=("git", "bash", "fish", "zsh"),
    ),
)

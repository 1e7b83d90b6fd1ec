"""Parts of the evidence: what each is about, and how it runs. docs/evidence.md lists what each shows.

A part is either a module with `run(folders, effort, progress) -> Outcome` or a folder of pytest files of the same name. The
folders are those of the committed builds, or that of the user's files.
"""

import hashlib
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDERS = (ROOT / "generated" / "4ws2-paper", ROOT / "generated" / "4ws2")
RECORDS = ROOT / "docs" / "evidence"

PACKAGES = dict(line.split(maxsplit=1) for line in (ROOT / ".ci" / "tools").read_text(encoding="ascii").splitlines())
"""Debian packages by the program that they contain; CI installs them."""


@dataclass(frozen=True)
class Part:
    """A part of the evidence.

    Attributes:
        name: name on the command line and of the record.
        subject: patterns of the files that it is about, relative to the checkout.
        module: module in this folder with `run`; empty for a folder of pytest files of the part's name.
        tools: programs that it needs besides a C compiler.
        needs_files: whether it is about files that the user gives, instead of the committed builds.
    """

    name: str
    subject: tuple[str, ...]
    module: str = ""
    tools: tuple[str, ...] = ()
    needs_files: bool = False

    @property
    def folder(self) -> Path:
        """Folder of the pytest files of a part without a module."""
        return ROOT / "tests" / "evidence" / self.name

    @property
    def patterns(self) -> tuple[str, ...]:
        """Patterns of the subject and of the part's own code."""
        own = self.module.partition(".")[0] or self.name
        return (*self.subject, f"tests/evidence/{own}.py", f"tests/evidence/{own}/**/*")

    def hash(self) -> str:
        """Return the hash of the files that a run is about; a record is out of date if it has another one."""
        return hash_of(self.patterns)

    def missing_tools(self) -> tuple[str, ...]:
        """Return a line with its remedy for each program that is not installed."""
        missing = [name for name in self.tools if shutil.which(name) is None]
        return tuple(f"{name} is not installed: apt install {PACKAGES.get(name, name)}" for name in missing)


def matching(patterns: Iterable[str]) -> set[Path]:
    """Return all files that match one of the patterns, except compiled Python."""
    return {path for pattern in patterns for path in ROOT.glob(pattern) if path.is_file() and "__pycache__" not in path.parts}


def hash_of(patterns: Iterable[str]) -> str:
    """Return the SHA-256 over names and contents of all files that match one of the patterns."""
    digest = hashlib.sha256()
    for path in sorted(matching(patterns)):
        digest.update(f"{path.relative_to(ROOT).as_posix()} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()


C = ("generated/4ws2*/include/*", "generated/4ws2*/src/*")
CONFIG = ("codegen/configuration/**/*",)
"""The configuration. It reaches the committed C only through `generated`, so the parts about that C exclude it."""
MAPS = ("codegen/map_file/*", "codegen/optimum/*", "codegen/ecu_map/*", "codegen/vehicle/**/*", *CONFIG)
TUNING = ("codegen/design/*",)
COMMANDS = ("codegen/*.py", "codegen/[!e]*/**/*", "codegen/ex*/**/*", "hil_sim/**/*")
"""Code that the commands run, except `codegen/emit`, whose output `make test` compares byte by byte."""
SIL = ("codegen/sil/*", "codegen/verify/drive*.py", "tests/oracle/*", "tests/sil/*")
GENERATOR = ("templates/**/*", "codegen/emit/**/*", *MAPS, *SIL)
VERIFY = ("codegen/verify/**/*", "templates/verify/*")
BENCH = ("hil_sim/**/*", "templates/linux/*", "generated/4ws2*/linux/*", *C, *CONFIG, *SIL)
DRIVEN = (
    "benchmarks/*.py",
    "codegen/sweep/**/*",
    "codegen/report/paper.py",
    "hil_sim/**/*",
    "generated/4ws2*/src/*",
    *TUNING,
    *CONFIG,
    *SIL,
)
IDENTIFIED = ("codegen/identify/*", "templates/identify/*", "tests/identify/*", "hil_sim/**/*", *MAPS, *SIL)
PAGES = ("codegen/report/**/*", "codegen/explore/**/*", "templates/report/*", "templates/explore/*", *TUNING, *CONFIG)
INSTALLED = ("pyproject.toml", "requirements*.lock", "ars_codegen/*", "Makefile", "scripts/**/*", "ars_codegen/*")
READ = ("codegen/logs/*", "codegen/importing/*", "codegen/identify/channels.py")
FIRMWARE = ("make", "arm-none-eabi-gcc", "qemu-system-arm")
PARTS = (
    Part("guide", ("README.md", "docs/*.md", "docs/notebooks/*", *COMMANDS), tools=(*FIRMWARE, "octave-cli", "mkoctfile")),
    Part("vcan", BENCH),
    Part("browser", PAGES, tools=("chromium",)),
    Part("builds", ("generated/4ws2*/manifest.json", *C, *VERIFY), "builds", ("gcc", "frama-c")),
    Part("verify", VERIFY, tools=("gcc", "frama-c")),
    Part("mutation", ("generated/*.npz", *C, *SIL), "mutation.mutation"),
    Part("faults", (*C, *VERIFY), "faults.planted", ("gcc", "frama-c")),
    Part("coverage", (*C, *SIL), "coverage.coverage", ("gcc", "gcov")),
    Part("mcdc", (*C, *SIL), "coverage.mcdc", ("clang-19", "llvm-profdata-19", "llvm-cov-19")),
    Part("exhaustive", (*C, "codegen/verify/sanitize*"), "exhaustive.exhaustive"),
    Part("libfuzzer", (*C, "templates/verify/*", "codegen/verify/sanitize*"), "libfuzzer.libfuzzer", ("clang-19",)),
    Part("kinds", GENERATOR),
    Part("toolchains", (*GENERATOR, "codegen/export/**/*"), tools=("cmake", *FIRMWARE)),
    Part("ipopt", (*MAPS, "codegen/design/*")),
    Part("uncertain", MAPS, "uncertain.share"),
    Part("drives", DRIVEN),
    Part("foreign", IDENTIFIED, "foreign.plants"),
    Part("gaps", BENCH, "gaps.gaps"),
    Part("loaders", COMMANDS, "loaders.cases"),
    Part("logs", COMMANDS, "logs.cases"),
    Part("public", READ, "public.files", needs_files=True),
    Part("install", INSTALLED, tools=("git", "bash", "fish", "zsh")),
)
"""Those that take longest in their quick forms come first, so that no part runs alone at the end."""

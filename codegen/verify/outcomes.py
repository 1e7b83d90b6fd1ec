"""Input and result of the checks of `codegen verify`.

A check is a function `check(subject, effort) -> Outcome`. It reads only the files of the subject, and raises an exception only
if it cannot run; see `codegen.verify.runner`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any, Self, cast

from codegen import __version__, configuration
from codegen.configuration import Config
from codegen.emit.folder import MANIFEST, read_files, verify_hashes
from codegen.emit.manifest import read_build
from codegen.emit.text import Precision


class Verdict(StrEnum):
    """Verdict of a check. A check that was not run never counts as passed."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_RUN = "not run"


@dataclass(frozen=True)
class Outcome:
    """Result of a check.

    Attributes:
        shows: property that the check shows, one sentence without a full stop.
        figure: main figure for the table, such as "0 mismatches in 300,000 steps".
        verdict: passed, failed or not run.
        findings: each fault in one line, with file and line where there is one; for a check that was not run, why.
        figures: all measurements, as JSON values, without times and paths.
        limits: what the check does not show, as sentences for the safety manual.
        tools: name -> version of the tools used.
    """

    shows: str
    figure: str
    verdict: Verdict
    findings: tuple[str, ...] = ()
    figures: Mapping[str, Any] = field(default_factory=dict)
    limits: tuple[str, ...] = ()
    tools: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Effort:
    """Extent of a check. A quick one runs only what finishes in half a minute."""

    quick: bool = False


@dataclass(frozen=True)
class Subject:
    """The build under check.

    Attributes:
        name: name of the folder, for messages.
        files: relative POSIX path -> content of all files in the manifest.
        manifest: manifest of the build.
        edited: paths of files changed after generation.
        manifest_sha256: SHA-256 of the manifest file.
    """

    name: str
    files: Mapping[str, bytes]
    manifest: Mapping[str, Any]
    edited: tuple[str, ...] = ()
    manifest_sha256: str = ""

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the build in a folder.

        Raises:
            BuildError, ConfigError: not a build, or a file of it cannot be read.
        """
        manifest = read_build(folder)
        files = read_files(folder, manifest, ("",))
        digest = hashlib.sha256((folder / MANIFEST).read_bytes()).hexdigest()
        return cls(folder.resolve().name, files, manifest, tuple(verify_hashes(folder)), digest)

    @property
    def prefix(self) -> str:
        """Prefix of the C names."""
        return str(self.manifest["options"]["prefix"])

    @property
    def precision(self) -> Precision:
        """Precision of the numbers."""
        return cast(Precision, self.manifest["options"]["precision"])

    @property
    def is_single(self) -> bool:
        """Whether the build computes in single precision."""
        return self.precision == "single"

    @property
    def is_of_this_version(self) -> bool:
        """Whether this version of codegen made the build, so that its arithmetic is known to the last bit."""
        return bool(self.manifest["version"] == __version__)

    @property
    def kind(self) -> str:
        """Kind of controller."""
        return str(self.manifest["options"]["kind"])

    @cached_property
    def config(self) -> Config:
        """Configuration of the build. Raises ConfigError if the manifest's is invalid."""
        return configuration.parse(self.manifest["configuration"], "manifest.json: configuration")

    @cached_property
    def unbounded(self) -> tuple[str, ...]:
        """Reasons why a call of the C might not return; see `complaints`. Checked once, as copies of the subject keep it."""
        from codegen.verify.bounded_loops import complaints

        return complaints(self.files, self.manifest)

    def sources(self, *folders: str) -> dict[str, bytes]:
        """Return the .c and .h files below some folders; default: include/ and src/, the files for an ECU."""
        below = tuple(f"{folder}/" for folder in (folders or ("include", "src")))
        return {path: content for path, content in self.files.items() if path.startswith(below) and path.endswith((".c", ".h"))}

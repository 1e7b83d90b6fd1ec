"""Export a build as an FMU. The headers of the FMI standard come from the package `fmpy`."""

from __future__ import annotations

import hashlib
import importlib.util
import io
import json
import platform
import re
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from codegen import __version__, configuration
from codegen.configuration import Config
from codegen.emit.folder import read_files, verify_hashes
from codegen.emit.manifest import read_build
from codegen.emit.render import render, verbatim
from codegen.emit.text import Precision, comment_text
from codegen.errors import BuildError, CodegenError
from codegen.export.fmu.description import Description, build_description, model_description
from codegen.export.fmu.model_view import TITLES, context, rows, step_size
from codegen.export.fmu.variables import Variable, Version, What, parameter_variables, status_values, variables_of
from codegen.sil.compile import DEFAULT_FLAGS
from codegen.sil.plant import plant_sources
from codegen.sil.software import compile_build, require_can_side
from codegen.sil.toolchain import compiler_command, require_success, run

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


FLAGS = (*DEFAULT_FLAGS, "-fvisibility=hidden")
"""Compiler flags of the SIL, for identical results; only FMI functions are exported."""

_ARCHITECTURES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}


def library_path(version: Version, identifier: str) -> str:
    """Return the path of the binary in the archive. FMI 3.0 names the processor; FMI 2.0 only system and word length.

    Raises:
        BuildError: the platform is not supported.
    """
    system = next((name for name in ("linux", "darwin") if sys.platform.startswith(name)), None)
    architecture = _ARCHITECTURES.get(platform.machine().lower())
    if system is None or architecture is None:
        where = f"{sys.platform} on {platform.machine()}"
        raise BuildError("no FMU can be compiled here", where=where, remedy="use Linux or macOS on x86-64 or AArch64")
    folder = f"{architecture}-{system}" if version == "3" else f"{system}64"
    return f"binaries/{folder}/{identifier}.{'dylib' if system == 'darwin' else 'so'}"


def compile_binary(sources: Mapping[str, bytes], name: str) -> bytes:
    """Compile C sources to the shared library `name`; equal sources and compilers give equal bytes.

    Raises:
        BuildError: no compiler, or C that does not compile.
    """
    if sys.platform == "darwin":
        kind = ["-dynamiclib", f"-Wl,-install_name,@rpath/{name}"]
    else:  # without local symbols and build id, which vary although the code does not
        kind = ["-shared", "-s", "-Wl,--build-id=none"]
    units = sorted(path for path in sources if path.endswith(".c"))
    with tempfile.TemporaryDirectory(prefix="ars-fmu-") as scratch:
        folder = Path(scratch)
        try:
            for path, content in sources.items():
                (folder / path).write_bytes(content)
            require_success(run([*compiler_command(), *FLAGS, *kind, *units, "-o", name, "-lm"], folder), name)
            return (folder / name).read_bytes()
        except OSError as error:
            raise BuildError(
                f"the FMU cannot be compiled: {error.strerror}", where=scratch, remedy="free some space"
            ) from error


_INCLUDE = re.compile(rb'^#include "([^"]+)"', re.MULTILINE)


def build_sources(files: Mapping[str, bytes], prefix: str) -> dict[str, bytes]:
    """Return name -> content of the controller's sources in a build, and of every header and source they depend on."""
    named = {PurePosixPath(path).name: content for path, content in files.items()}
    found: dict[str, bytes] = {}
    waiting = [f"{prefix}_controller.h", f"{prefix}_calibration.c"]
    while waiting:
        name = waiting.pop()
        if name in named and name not in found:
            found[name] = named[name]
            waiting += [included.decode("ascii", "replace") for included in _INCLUDE.findall(named[name])]
            waiting.append(f"{name.removesuffix('.h')}.c")
    return found


def model_sources(
    what: What, version: Version, config: Config, prefix: str, precision: Precision, variables: Sequence[Variable], token: str
) -> dict[str, bytes]:
    """Return the wrapper: model, variables, instance, FMI functions and, if used, the plant."""
    seen = {
        **context(what, config, prefix, precision, variables),
        "variables": rows(variables, version),
        "token": token,
    }
    model = "plant_model.c" if what == "plant" else f"{what}_model.c.j2"
    templates = {
        "fmu_config.h": "fmu_config.h.j2",
        "model.h": "model.h.j2",
        "model.c": model,
        "variables.h": "variables.h",
        "variables.c": "variables.c.j2",
        "instance.h": "instance.h",
        "instance.c": "instance.c",
        f"fmi{version}.c": f"fmi{version}.c",
    }
    if version == "3":
        templates["fmi3_unsupported.c"] = "fmi3_unsupported.c"
    made = {
        name: render(f"fmu/{source}", seen) if source.endswith(".j2") else verbatim(f"fmu/{source}")
        for name, source in templates.items()
    }
    return {**made, **(plant_sources(config) if what != "controller" else {})}


_DESCRIPTION = "modelDescription.xml"
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Earliest time that a zip archive can represent."""


@dataclass(frozen=True)
class Fmu:
    """An FMU in memory.

    Attributes:
        content: bytes of the file.
        identifier: C identifier of the model.
        token: the GUID of FMI 2.0, the instantiation token of FMI 3.0: a SHA-256 of description, sources and flags.
        platform: folder of the binary, such as "x86_64-linux".
        internal_step: in s; communication steps are whole multiples of it.
        variables: by value reference.
        edited: files of the build that were changed after generation; the FMU contains the changed files.
    """

    content: bytes
    identifier: str
    token: str
    platform: str
    internal_step: float
    variables: tuple[Variable, ...]
    edited: tuple[str, ...]


def make_fmu(build: Path, what: What, version: Version) -> Fmu:
    """Return the FMU of a build's controller, of the car of its configuration, or of both in closed loop.

    Raises:
        CodegenError: no build, no compiler, C that does not compile, or fmpy is missing.
    """
    standard = headers(version)
    manifest = read_build(build)
    require_can_side(manifest, build)
    files = read_files(build, manifest, ("include/", "src/"))
    maker = _Maker(what, version, manifest, files)
    token = maker.token()
    sources, description = maker.sources(token), maker.description(token)
    path = library_path(version, maker.identifier)
    library = compile_binary({**sources, **standard}, PurePosixPath(path).name)
    content = {
        _DESCRIPTION: description,
        path: library,
        "documentation/licenses/fmi-headers.txt": licence(standard),
        **{f"sources/{name}": text for name, text in {**sources, **standard}.items()},
    }
    if version == "3":
        content["sources/buildDescription.xml"] = build_description(maker.identifier, maker.units)
    return Fmu(
        _pack(content),
        maker.identifier,
        token,
        PurePosixPath(path).parent.name,
        maker.internal_step,
        maker.variables,
        tuple(verify_hashes(build)),
    )


class _Maker:
    """The parts of one FMU."""

    def __init__(self, what: What, version: Version, manifest: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
        self._what, self._version, self._manifest = what, version, manifest
        self._config = configuration.parse(manifest["configuration"], "manifest.json: configuration")
        self._prefix, self._precision = manifest["options"]["prefix"], manifest["options"]["precision"]
        self._build = build_sources(files, self._prefix) if what != "plant" else {}
        self.variables = variables_of(what, self._config)
        if what != "plant":
            # Compiled as for a run, so that the struct and its values come from the compiler.
            software = compile_build(files, manifest)
            self.variables += parameter_variables(software, files)
        self._statuses = status_values(files, self._prefix)
        self.internal_step = step_size(what, self._config)
        self.identifier = re.sub(r"\W", "_", f"{self._prefix}_{manifest['name']}_{what}", flags=re.ASCII)

    def sources(self, token: str) -> dict[str, bytes]:
        """Return every C file except the headers of the standard."""
        made = model_sources(self._what, self._version, self._config, self._prefix, self._precision, self.variables, token)
        return {**self._build, **made}

    @property
    def units(self) -> tuple[str, ...]:
        """Return the names of the C files to compile."""
        return tuple(sorted(name for name in self.sources("") if name.endswith(".c")))

    def description(self, token: str) -> bytes:
        """Return modelDescription.xml."""
        manifest = self._manifest
        name = comment_text(str(manifest["name"]))
        return model_description(
            Description(
                version=self._version,
                identifier=self.identifier,
                name=f"{name}: {self._what}",
                about=f"Active rear steering, {TITLES[self._what]}: C of the build {name}, kind {manifest['options']['kind']}",
                build_id=str(manifest["build_id"]),
                tool=f"ars-codegen {__version__}",
                token=token,
                internal_step=self.internal_step,
                communication_step=self._config.controller.sampling_time_s,
                variables=self.variables,
                statuses=self._statuses,
                sources=self.units,
            )
        )

    def token(self) -> str:
        """Return the SHA-256 of all content except the token and the compiled binary."""
        content = {"flags": list(FLAGS), "description": hashlib.sha256(self.description("")).hexdigest()}
        hashes = {name: hashlib.sha256(text).hexdigest() for name, text in self.sources("").items()}
        return hashlib.sha256(json.dumps([content, hashes], sort_keys=True).encode()).hexdigest()


def _pack(files: Mapping[str, bytes]) -> bytes:
    """Return the archive of path -> content: the description first, the others sorted; equal files give equal bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(files, key=lambda path: (path != _DESCRIPTION, path)):
            entry = zipfile.ZipInfo(path, _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, wherever this runs
            entry.external_attr = 0o100644 << 16
            archive.writestr(entry, files[path])
    return buffer.getvalue()

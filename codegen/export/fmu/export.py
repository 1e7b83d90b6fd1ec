"""Export a build as an FMU: its C with a wrapper, the binary, and the archive.

The headers of the FMI standard come from the package `fmpy`.
"""

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
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from codegen import __version__, configuration
from codegen.configuration import Config
from codegen.emit.folder import read_files, verify_hashes
from codegen.emit.manifest import read_build
from codegen.emit.render import render, verbatim
from codegen.emit.text import Precision, comment_text
from codegen.errors import BuildError, CodegenError
from codegen.export.a2l import fill
from codegen.export.elf import Elf
from codegen.export.fmu.description import Description, build_description, model_description
from codegen.export.fmu.model_view import MODEL_TITLES, context, row, step_size, uses_unit
from codegen.export.fmu.variables import (
    BUS,
    TERMINALS_PATH,
    WITH_BUS,
    XCP,
    Variable,
    Version,
    What,
    bus_manifest,
    manifest_path,
    parameter_variables,
    terminals,
    variables_of,
    xcp_manifest,
)
from codegen.requirements import missing, pip_install
from codegen.sil.compile import DEFAULT_FLAGS
from codegen.sil.plant import plant_sources
from codegen.sil.software import compile_build, require_can_side, writable_flags
from codegen.sil.toolchain import compiler_command, require_success, run

_HEADERS = {
    "2": ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    "3": ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
_LICENCE = re.compile(r"^ *Copyright \(C\).*?POSSIBILITY OF SUCH DAMAGE\.$", re.DOTALL | re.MULTILINE)


def headers(version: Version) -> dict[str, bytes]:
    """Return name -> content of the standard's C headers. Raises CodegenError: fmpy or its headers are missing."""
    # Located, not imported: only its files are needed, and its import is slow.
    found = importlib.util.find_spec("fmpy")
    if found is None or found.origin is None:
        raise missing("fmpy", "has the headers of the FMI standard", "codegen fmu")
    folder = Path(found.origin).parent / "c-code"
    try:
        return {name: (folder / name).read_bytes() for name in _HEADERS[version]}
    except OSError as error:
        raise CodegenError(f"cannot be read ({error.strerror})", where=folder, remedy=pip_install("fmpy")) from None


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


def compile_binary(sources: Mapping[str, bytes], name: str, flags: Sequence[str] = FLAGS) -> bytes:
    """Compile C sources to the shared library `name`; equal sources and compilers give equal bytes.

    With "-g" among the flags it keeps its symbols.

    Raises:
        BuildError: no compiler, or C that does not compile.
    """
    if sys.platform == "darwin":
        kind = ["-dynamiclib", f"-Wl,-install_name,@rpath/{name}"]
    else:  # without local symbols and build id, which vary although the code does not
        kind = ["-shared", *(() if "-g" in flags else ("-s",)), "-Wl,--build-id=none"]
    units = sorted(path for path in sources if path.endswith(".c"))
    with tempfile.TemporaryDirectory(prefix="ars-fmu-") as scratch:
        folder = Path(scratch)
        try:
            for path, content in sources.items():
                (folder / path).write_bytes(content)
            require_success(run([*compiler_command(), *flags, *kind, *units, "-o", name, "-lm"], folder), name)
            return (folder / name).read_bytes()
        except OSError as error:
            raise BuildError(
                f"the FMU cannot be compiled: {error.strerror}", where=scratch, remedy="free some space"
            ) from error


def build_sources(what: What, files: Mapping[str, bytes], prefix: str) -> dict[str, bytes]:
    """Return name -> content of the headers and sources of a build that a model uses."""
    named = {PurePosixPath(path): content for path, content in files.items()}
    return {path.name: content for path, content in named.items() if uses_unit(what, path.stem.removeprefix(f"{prefix}_"))}


def model_sources(
    what: What, version: Version, config: Config, prefix: str, precision: Precision, variables: Sequence[Variable], token: str
) -> dict[str, bytes]:
    """Return the wrapper: model, variables, instance, FMI functions and, if used, the plant."""
    seen = {
        **context(what, config, prefix, precision, variables),
        "variables": [row(each, version) for each in variables],
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
        events = "fmi3_bus.c" if what in WITH_BUS else "fmi3_no_events.c"
        templates |= {name: name for name in ("fmi3_unsupported.c", "events.h", events)}
    if what in WITH_BUS:
        templates |= {name: name for name in ("can_node.h", "can_node.c")}
    made = {
        name: render(f"fmu/{source}", seen) if source.endswith(".j2") else verbatim(f"fmu/{source}")
        for name, source in templates.items()
    }
    return {**made, **(plant_sources(config) if what not in ("controller", "ecu") else {})}


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
        CodegenError: no build, no compiler, C that does not compile, fmpy is missing, or a bus in FMI 2.0.
    """
    if what in WITH_BUS and version != "3":
        raise CodegenError("a bus needs the clocks of FMI 3.0", where="`fmi=`", remedy="give `fmi='3'`, or leave it out")
    standard = headers(version)
    manifest = read_build(build)
    require_can_side(manifest, build)
    files = read_files(build, manifest, ("include/", "src/"))
    config = configuration.parse(manifest["configuration"], "manifest.json: configuration")
    prefix, precision = manifest["options"]["prefix"], manifest["options"]["precision"]
    variables = variables_of(what, config)
    if what in ("controller", "loop"):
        # Compiled as for a run, so that the struct and its values come from the compiler.
        variables += parameter_variables(compile_build(files, manifest))
    name, identifier = comment_text(str(manifest["name"])), f"{prefix}_{manifest['name']}_{what}"
    own = build_sources(what, files, prefix)
    flags = (*FLAGS, *(writable_flags(prefix) if what == "ecu" else ()))

    def sources_with(token: str) -> dict[str, bytes]:
        return {**own, **model_sources(what, version, config, prefix, precision, variables, token)}

    about = Description(
        version=version,
        identifier=re.sub(r"\W", "_", identifier, flags=re.ASCII),
        name=f"{name}: {what}",
        about=f"Active rear steering, {MODEL_TITLES[what]}: C of the build {name}, kind {manifest['options']['kind']}",
        build_id=str(manifest["build_id"]),
        tool=f"ars-codegen {__version__}",
        token="",
        internal_step=step_size(what, config),
        communication_step=step_size(what, config) if what in WITH_BUS else config.controller.sampling_time_s,
        variables=variables,
        sources=sorted(name for name in sources_with("") if name.endswith(".c")),
        has_bus=what in WITH_BUS,
        is_single=what == "ecu",
    )
    # The SHA-256 of all content except the token and the compiled binary.
    hashed = {"flags": list(flags), "description": hashlib.sha256(model_description(about)).hexdigest()}
    hashes = {name: hashlib.sha256(text).hexdigest() for name, text in sources_with("").items()}
    token = hashlib.sha256(json.dumps([hashed, hashes], sort_keys=True).encode()).hexdigest()
    sources = {**sources_with(token), **standard}
    path = library_path(version, about.identifier)
    content = {
        _DESCRIPTION: model_description(replace(about, token=token)),
        path: compile_binary(sources, PurePosixPath(path).name, flags),
        "documentation/licenses/fmi-headers.txt": licence(standard),
        **{f"sources/{name}": text for name, text in sources.items()},
    }
    if version == "3":
        content["sources/buildDescription.xml"] = build_description(about.identifier, about.sources)
    if what in WITH_BUS:
        content[TERMINALS_PATH] = terminals()
        content[manifest_path(BUS)] = bus_manifest()
    if what == "ecu" and sys.platform.startswith("linux"):
        content |= _memory_description(build, prefix, sources, path, flags, content[path])
    return Fmu(
        _pack(content),
        about.identifier,
        token,
        PurePosixPath(path).parent.name,
        about.internal_step,
        variables,
        tuple(verify_hashes(build)),
    )


def _memory_description(
    build: Path, prefix: str, sources: Mapping[str, bytes], path: str, flags: Sequence[str], binary: bytes
) -> dict[str, bytes]:
    """Return the files of FMI-LS-XCP: the A2L with the addresses of the binary, relative to its base, and the manifest."""
    name = PurePosixPath(path)
    elf = Elf(name.name, compile_binary(sources, name.name, (*flags, "-g")), shared=True)
    if not elf.is_stripped_to(binary):
        raise BuildError("the binary depends on debug information", where=name.name, remedy="use another compiler")
    folder = f"extra/{XCP}"
    text = fill(build, elf).text.encode("ascii")
    return {
        manifest_path(XCP): xcp_manifest(f"{prefix}.a2l"),
        f"{folder}/{name.parent.name}/{prefix}.a2l": text,
        "documentation/fmi-ls-xcp.txt": _XCP_GUIDE.encode(),
    }


_XCP_GUIDE = """\
The A2L describes the memory of the task and its calibration in the binary. Addresses are relative to the base of the loaded
library.
The FMU has no XCP service of its own: the importer provides it and replaces IF_DATA XCP by the settings of its service.

For another machine, run codegen fmu there: addresses differ from one compiler to the next.
"""


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

"""A generated folder in memory and on disk: its files, its manifest, and which files belong to the generator.

A folder belongs to the generator if its `manifest.json` declares it, and a file if that manifest names it. The content of the
files does not matter here. `check_output` keeps the output of a command from replacing an input or a part of a build. This
module imports only `errors` and `files`.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import stat
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Literal

from codegen.errors import BuildError, CodegenError
from codegen.files import read_file, resolved

MANIFEST = "manifest.json"
VERIFICATION_FILES = ("verify.json", "verify.md")
"""Files that `codegen verify` writes into a build. They belong to the generator, but describe the build, so its manifest does
not name them."""

BUILD_FILE_BYTES_MAX = 2**28
MANIFEST_BYTES_MAX = 16 * 2**20
DEPTH_MAX = 32
"""Largest depth of folders in a build; generated ones have two."""
GENERATOR = "codegen"

Kind = Literal["file", "folder", "other"]
"""Type of a folder's entry. A link is always "other"."""


@dataclass(frozen=True)
class Folder:
    """A generated folder in memory.

    Attributes:
        files: content by relative POSIX path, without the manifest.
        manifest: facts for the manifest, JSON values only; "files" and "generator" are added by `render_manifest`.

    Raises:
        ValueError: a path is not plain (relative, ASCII, no ".."), is reserved, or names both a file and a folder;
            or a fact has a reserved key. All are programming errors, not errors of the user.
    """

    files: Mapping[str, bytes]
    manifest: Mapping[str, Any]

    def __post_init__(self) -> None:
        folders = folders_of(self.files)
        for path in self.files:
            if not _is_plain(path) or path in (MANIFEST, *VERIFICATION_FILES) or path in folders:
                raise ValueError(f"{path!r} cannot be the path of a generated file")
        if reserved := {"files", "generator"} & self.manifest.keys():
            raise ValueError(f"reserved keys in the manifest: {sorted(reserved)}")

    def content(self) -> dict[str, bytes]:
        """Return every file by path. The manifest comes first, so that an incomplete folder still lists all its files."""
        return {MANIFEST: render_manifest(self), **self.files}


def render_manifest(folder: Folder) -> bytes:
    """Return the manifest as JSON: the caller's facts, and size and SHA-256 of each file. Equal folders give equal bytes."""
    files = {
        path: {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)} for path, content in folder.files.items()
    }
    facts = {**folder.manifest, "generator": GENERATOR, "files": files}
    text = json.dumps(facts, indent=1, sort_keys=True, allow_nan=False)
    # A line break inside brackets can only come from `indent`: within a JSON string it would be escaped.
    return (re.sub(r"\[\n( *)([-+.,\s\deE]+)\]", _number_rows, text) + "\n").encode("ascii")


def _number_rows(match: re.Match[str]) -> str:
    # With one number per line, the manifest would have thousands of lines.
    indent, numbers = match[1], " ".join(match[2].split())
    rows = textwrap.fill(numbers, 120, initial_indent=indent, subsequent_indent=indent, break_long_words=False)
    return f"[\n{rows}\n{indent[:-1]}]"


def read_files(target: Path, manifest: Mapping[str, Any], folders: tuple[str, ...]) -> dict[str, bytes]:
    """Return the files in `folders` (such as "src/") that the manifest names. Raises BuildError if one cannot be read."""
    files = {}
    for path in manifest["files"]:
        if path.startswith(folders):
            files[path] = read_file(target / path, BUILD_FILE_BYTES_MAX, "build again with `codegen build`", BuildError)
    return files


def read_manifest(target: Path) -> dict[str, Any]:
    """Return the manifest of a generated folder. Raises BuildError if it is missing, unreadable or not codegen's."""
    path = Path(target) / MANIFEST
    remedy = "write the folder with `codegen build`"
    try:
        regular = stat.S_ISREG(os.lstat(path).st_mode)
        # Opening a pipe would block for ever, and a link may point outside the folder.
        if not regular:
            raise BuildError("not a regular file", where=path, remedy=remedy)
        with path.open("rb") as file:
            text = file.read(MANIFEST_BYTES_MAX + 1)
    except (FileNotFoundError, NotADirectoryError):
        raise BuildError(f"not a generated folder: {MANIFEST} is missing", where=target, remedy=remedy) from None
    except OSError as error:
        raise BuildError(f"cannot be read ({error.strerror})", where=path, remedy="check its permissions") from error
    if len(text) > MANIFEST_BYTES_MAX:
        raise BuildError(f"larger than {MANIFEST_BYTES_MAX} bytes, so not a manifest of codegen", where=path, remedy=remedy)
    try:
        manifest = json.loads(text)
    except (ValueError, RecursionError):
        raise BuildError("not JSON, so not a manifest of codegen", where=path, remedy=remedy) from None
    if not _is_ours(manifest):
        raise BuildError("not a manifest that codegen wrote", where=path, remedy=remedy)
    return dict(manifest)


def differences(folder: Folder, target: Path) -> list[str]:
    """Return the changes that building `folder` into `target` would make, one line per file; empty if it is up to date.

    Nothing is written.

    Raises:
        BuildError: something in the target cannot be read.
    """
    place = Path(target)
    if not place.is_dir():
        return [f"{target}: {'not a folder' if os.path.lexists(place) else 'missing'}"]
    content = folder.content()
    ours = {*content, *VERIFICATION_FILES}
    with as_build_error(target, "read"):
        found = dict(entries(place))
        lines = [f"{path}: missing" for path in content if path not in found]
        lines += [f"{path}: not named by the manifest" for path in foreign_paths(found.items(), ours)]
        lines += [
            f"{path}: differs" for path, data in content.items() if found.get(path) == "file" and not _holds(place / path, data)
        ]
    return sorted(lines)


def verify_hashes(target: Path) -> list[str]:
    """Return the sorted paths of files that are missing or do not match their hash in the manifest of `target`.

    Raises:
        BuildError: as `read_manifest`, or a file cannot be read.
    """
    named = read_manifest(target)["files"]
    with as_build_error(target, "read"):
        found = dict(entries(Path(target)))
        return sorted(
            path
            for path, facts in named.items()
            if found.get(path) != "file" or _sha256(Path(target) / path) != facts["sha256"]
        )


def _is_plain(path: str) -> bool:
    """Return whether `path` is a relative path in normalised spelling that stays below its folder."""
    parts = PurePosixPath(path)
    plain_text = path.isascii() and path.isprintable() and "\\" not in path
    return plain_text and parts.as_posix() == path != "." and not parts.is_absolute() and ".." not in parts.parts


def _is_ours(manifest: object) -> bool:
    if not isinstance(manifest, dict) or manifest.get("generator") != GENERATOR:
        return False
    files = manifest.get("files")
    return isinstance(files, dict) and all(
        _is_plain(path) and isinstance(facts, dict) and isinstance(facts.get("sha256"), str) for path, facts in files.items()
    )


def owned_paths(folder: Path) -> set[str]:
    """Return the paths that `folder` may contain according to its manifest; none if it has no manifest of codegen."""
    try:
        return {*read_manifest(folder)["files"], MANIFEST, *VERIFICATION_FILES}
    except BuildError:
        return set()


def folders_of(paths: Iterable[str]) -> set[str]:
    """Return the relative paths of all folders that contain files at `paths`."""
    return {str(parent) for path in paths for parent in PurePosixPath(path).parents} - {"."}


def entries(folder: Path, below: str = "") -> Iterator[tuple[str, Kind]]:
    """Yield every entry of `folder` by relative path, sorted, a folder after its content. Links are reported, not followed.

    Raises:
        BuildError: folders are nested deeper than any build's.
    """
    if below.count("/") > DEPTH_MAX:
        what = f"folders nested deeper than {DEPTH_MAX}"
        raise BuildError(what, where=folder / PurePosixPath(below).parts[0], remedy="move it out of the build")
    with os.scandir(folder / below) as listing:
        children = sorted(listing, key=lambda child: child.name)
    for child in children:
        path = below + child.name
        if child.is_dir(follow_symlinks=False):
            yield from entries(folder, f"{path}/")
            yield path, "folder"
        else:
            yield path, "file" if child.is_file(follow_symlinks=False) else "other"


def foreign_paths(found: Iterable[tuple[str, Kind]], ours: set[str]) -> Iterator[str]:
    """Yield the paths in `found` that are neither regular files of `ours` nor folders that contain such files."""
    folders = folders_of(ours)
    for path, kind in found:
        if (kind, path in ours) != ("file", True) and (kind, path in folders) != ("folder", True):
            yield path


def _holds(path: Path, content: bytes) -> bool:
    return path.stat().st_size == len(content) and path.read_bytes() == content


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def as_build_error(target: Path, done: str) -> Iterator[None]:
    """Convert an OSError to a BuildError: `target` cannot be `done` ("written", "read"), the cause, and the remedy."""
    try:
        yield
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        place = f" at {error.filename}" if error.filename is not None and not full else ""
        remedy = "free some space" if full else "choose another folder, or check its permissions"
        unchanged = "; the previous content is unchanged" if done == "written" else ""
        raise BuildError(
            f"cannot be {done} ({error.strerror}{place}){unchanged}", where=target, remedy=f"{remedy} and try again"
        ) from error


def check_output(path: Path | None, suffix: str, inputs: Iterable[Path | None] = ()) -> None:
    """Reject an output that would destroy something: an input, a device, a folder, or a file inside a build.

    Args:
        path: the file to write, or None if the user gave none.
        suffix: required suffix of its name, such as ".npz".
        inputs: files that the command reads.

    Raises:
        CodegenError: the output is rejected, or is a link to itself; the remedy suggests another name.
    """
    if path is None:
        return
    if path.suffix.lower() != suffix:
        raise CodegenError(f"only {suffix} is written", where=path, remedy=f"name it {path.stem or 'result'}{suffix}")
    target = resolved(path)
    if not target.parent.is_dir():
        raise CodegenError("its folder does not exist", where=path, remedy=f"create {path.parent} first")
    if target.exists() and not target.is_file():
        raise CodegenError("it exists and is not a file", where=path, remedy="name another file")
    for source in inputs:
        if source is not None and source.exists() and target.exists() and source.samefile(target):
            raise CodegenError("it is an input of this command", where=path, remedy="name another file for the result")
    for folder in target.parents:
        if owned_paths(folder):
            raise CodegenError("it lies inside a build", where=path, remedy=f"name a file outside of {folder}")


def refuse_folder(target: Path, what: str, title: str) -> None:
    """Check that writing a project to a folder destroys nothing.

    Args:
        what: manifest entry of the project.
        title: its name in messages, such as "a firmware project".

    Raises:
        BuildError: the folder holds generated output of another kind, or a project in which a file was changed; or it lies
            inside such a folder.
    """
    place = resolved(target, BuildError)
    for parent in place.parents:
        if owned_paths(parent):
            raise BuildError("it lies inside a generated folder", where=target, remedy=f"name a folder outside of {parent}")
    if not owned_paths(place):
        return
    if (found := read_manifest(place).get("what")) != what:
        holds = "a build" if found is None else "another kind of project"
        raise BuildError(f"it is {holds}, not {title}", where=target, remedy="choose another folder")
    if changed := verify_hashes(place):
        remedy = "nothing was changed; choose another folder, or move that one away"
        raise BuildError(f"{changed[0]} was changed since it was written", where=target, remedy=remedy)

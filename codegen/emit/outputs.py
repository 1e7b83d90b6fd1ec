"""Check the output path of a command before the command does any work."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from codegen.emit.folder import owned_paths, read_manifest, verify_hashes
from codegen.errors import BuildError, CodegenError
from codegen.files import resolved


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

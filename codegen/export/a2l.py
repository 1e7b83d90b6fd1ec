"""Fill the A2L of a build with the addresses of a linked program."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Literal

from codegen import configuration
from codegen.emit.a2l_view import ASAP2_TYPES, INSTANCE, SUPERVISION, UNSIGNED, a2l
from codegen.emit.folder import verify_hashes
from codegen.emit.manifest import read_build
from codegen.emit.objects import CalibrationObject, Layout, Measurement
from codegen.emit.text import comment_text
from codegen.errors import BuildError
from codegen.export.elf import Elf, MemoryObject

NOT_FOUND_REMEDY = "link the program with this build and compile it with -g; keep the calibration from --gc-sections and -flto"


@dataclass(frozen=True)
class Filled:
    """Result of `codegen a2l`.

    Attributes:
        text: content of the A2L.
        layout: the objects of the build with their addresses.
        places: object name -> location.
        left_out: measurements that the program does not contain.
        instance: path of the measured task or controller; "" if there is none.
        segment: first address and size in bytes of the calibration data and the build's identity.
        edited: files of the build that were changed after generation.
    """

    text: str
    layout: Layout
    places: dict[str, MemoryObject]
    left_out: tuple[str, ...]
    instance: str
    segment: tuple[int, int]
    edited: tuple[str, ...]


@dataclass(frozen=True)
class _Instance:
    """The object of a task, or of a controller alone."""

    path: str
    what: Literal["task", "controller", "none"]


def fill(build: Path, elf: Elf, instance: str | None = None) -> Filled:
    """Return the A2L of a build with a program's addresses, byte order and types.

    Args:
        build: folder of the build.
        elf: the program.
        instance: path of the task or controller object, such as `ecu.task`; None searches for it.

    Raises:
        BuildError: no build; a program without this build, or with another one; several instances.
    """
    manifest = read_build(build)
    layout = Layout.of(manifest, build)
    epk = _check_same_build(elf, layout.prefix, layout.build_id)
    found = _found(elf, layout.prefix, instance)
    calibration = {each.name: _calibrated(elf, each) for each in layout.objects.values()}
    measured = {each.name: (path, place) for each in layout.measurements for path, place in _measured(elf, each, layout, found)}
    places = {**calibration, **{name: place for name, (_, place) in measured.items()}}
    for name, place in places.items():
        if place.address >= 1 << 32:
            what = f"{name} lies at 0x{place.address:X}, beyond the 32 bits of an A2L"
            raise BuildError(what, where=elf.name, remedy="link it elsewhere, on a PC without PIE")
    data = (*calibration.values(), epk)
    first = min(place.address for place in data)
    segment = (first, max(place.address + place.bytes for place in data) - first)
    addresses = {name: place.address for name, place in calibration.items()}
    placed = replace(
        layout.at(addresses, epk.address, "<" if elf.is_little else ">"),
        measurements=tuple(_moved(each, *measured[each.name]) for each in layout.measurements if each.name in measured),
    )
    config = configuration.parse(manifest["configuration"], "manifest.json: configuration")
    digest = hashlib.sha256(elf.content).hexdigest()
    origin = f"Addresses of {comment_text(PurePath(elf.name).name)}, SHA-256 {digest}"
    return Filled(
        a2l(manifest, config, placed, origin, segment).decode("ascii"),
        placed,
        places,
        tuple(each.name for each in layout.measurements if each.name not in measured),
        found.path,
        segment,
        tuple(verify_hashes(build)),
    )


def _calibrated(elf: Elf, each: CalibrationObject) -> MemoryObject:
    """Return the location of an object of the calibration. Raises BuildError: the program does not have it in this size."""
    place = elf.place(each.link)
    if place is None:
        raise BuildError(f"no variable {each.link}", where=elf.name, remedy=NOT_FOUND_REMEDY)
    size, count = each.stored.itemsize, math.prod(each.shape)
    if (place.size, place.count) != (size, count):
        raise BuildError(
            f"{each.name} is {place.count} numbers of {place.size} bytes, in this build {count} of {size}",
            where=elf.name,
            remedy="link the program with this build",
        )
    return place


def _measured(elf: Elf, each: Measurement, layout: Layout, instance: _Instance) -> Iterator[tuple[str, MemoryObject]]:
    """Yield path and location of a measurement if the program has it. Raises BuildError: it has another precision."""
    path = _path(each.link, layout.prefix, instance)
    place = None if path is None else elf.place(path)
    if path is None or place is None:
        return
    if place.kind == "float" and place.size != ASAP2_TYPES[each.type][1]:
        raise BuildError(f"{path} is a number of {place.size} bytes", where=elf.name, remedy="link it with this build")
    yield path, place


def _moved(each: Measurement, path: str, place: MemoryObject) -> Measurement:
    """Return a measurement with the type and location that it has in the program."""
    kind = each.type if place.kind == "float" else UNSIGNED[place.size]
    return each.model_copy(update={"link": path, "type": kind, "address": place.address})


def _check_same_build(elf: Elf, prefix: str, identity: str) -> MemoryObject:
    """Check that the program contains this build, and return the location of its identity."""
    place = elf.place(f"{prefix}_epk")
    if place is None:
        raise BuildError(
            f"no variable {prefix}_epk",
            where=elf.name,
            remedy=NOT_FOUND_REMEDY,
        )
    found = (elf.bytes_at(place.address, place.bytes) or b"").rstrip(b"\0").decode("ascii", "replace")
    if found != identity:
        raise BuildError(
            f"it holds the build {comment_text(found)}, and this is {identity}",
            where=elf.name,
            remedy="give the build that the program was linked with",
        )
    return place


def _found(elf: Elf, prefix: str, wanted: str | None) -> _Instance:
    tasks, controllers = elf.instances(f"{prefix}_task_t"), elf.instances(f"{prefix}_controller_t")
    if wanted is not None:
        if wanted in tasks:
            return _Instance(wanted, "task")
        if wanted in controllers:
            return _Instance(wanted, "controller")
        there = ", ".join(tasks or controllers) or "none"
        raise BuildError(f"no task or controller {wanted}", where=elf.name, remedy=f"there are: {there}")
    for what, found in (("task", tasks), ("controller", controllers)):
        if len(found) > 1:
            raise BuildError(
                f"several objects of {prefix}_{what}_t: {', '.join(found)}", where=elf.name, remedy="choose one by `instance=`"
            )
        if found:
            return _Instance(found[0], "task" if what == "task" else "controller")
    return _Instance("", "none")


def _path(link: str, prefix: str, instance: _Instance) -> str | None:
    """Replace the build's object name in a path by the program's; None if that object has no such member."""
    inside = link.removeprefix(f"{prefix}_{INSTANCE}")
    if instance.what == "task":
        return instance.path + inside
    if instance.what == "controller" and inside == f".{SUPERVISION}.status":
        return f"{instance.path}.status"
    if instance.what == "controller" and inside.startswith(".controller."):
        return instance.path + inside.removeprefix(".controller")
    return None

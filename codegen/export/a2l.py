"""Fill the A2L of a build with the addresses of a linked program."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Literal

from codegen.emit.a2l_view import INSTANCE, SUPERVISION
from codegen.emit.folder import read_files, verify_hashes
from codegen.emit.manifest import read_build
from codegen.emit.text import comment_text
from codegen.errors import BuildError
from codegen.export.elf import Elf, MemoryObject

_BLOCK = re.compile(
    r"^ *\/begin (?P<kind>AXIS_PTS|CHARACTERISTIC|MEASUREMENT) (?P<name>\S+) .*?^ *\/end (?P=kind)\n", re.DOTALL | re.MULTILINE
)
NOT_FOUND_REMEDY = "link the program with this build and compile it with -g; keep the calibration from --gc-sections and -flto"
_LINK = re.compile(r'SYMBOL_LINK "(?P<path>[^"]*)" 0')
_ADDRESS = re.compile(r"\b0x00000000\b")
_AXIS_POINTS = re.compile(r"COM_AXIS \S+ \S+ (\d+)|\w+_BREAKPOINTS 0 \S+ (\d+)")
_TYPE = re.compile(r"\b(FLOAT32_IEEE|FLOAT64_IEEE|UBYTE|UWORD|ULONG)\b")
_SIZES = {"REAL": None, "FUNCTION": None, "RAW_FUNCTION": 2, "BREAKPOINTS": None, "COUNT": 2, "CHECKSUM": 4}
"""Bytes of a number by record layout; None: those of the build's precision."""
_UNSIGNED = {1: "UBYTE", 2: "UWORD", 4: "ULONG"}


@dataclass(frozen=True)
class Filled:
    """Result of `codegen a2l`.

    Attributes:
        text: content of the A2L.
        places: object name -> location.
        left_out: measurements that the program does not contain.
        instance: path of the measured task or controller; "" if there is none.
        segment: first address and size in bytes of the calibration data and the build's identity.
        edited: files of the build that were changed after generation.
    """

    text: str
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
    prefix = str(manifest["options"]["prefix"])
    path = f"{prefix}.a2l"
    text = read_files(build, manifest, (path,)).get(path, b"").decode("ascii", "replace")
    if not text:
        raise BuildError(f"this build has no {path}", where=build, remedy="build again with this version")
    epk = _check_same_build(elf, prefix, str(manifest["build_id"]))
    real = 4 if manifest["options"]["precision"] == "single" else 8
    found = _found(elf, prefix, instance)
    blocks = _Blocks(elf, prefix, real, found)
    text = _BLOCK.sub(lambda block: blocks.filled(block), text)
    for name in blocks.left_out:
        text = _without(text, name)
    data = (*blocks.calibration, epk)
    first = min(place.address for place in data)
    segment = (first, max(place.address + place.bytes for place in data) - first)
    return Filled(
        _headed(text, elf, segment, epk),
        blocks.places,
        tuple(blocks.left_out),
        found.path,
        segment,
        tuple(verify_hashes(build)),
    )


def _without(text: str, name: str) -> str:
    """Return the A2L without any reference to a measurement."""
    text = re.sub(rf"^ *{re.escape(name)}\n", "", text, flags=re.MULTILINE)
    return re.sub(rf"(?<= ){re.escape(name)} (?=\S+ \S)", "NO_INPUT_QUANTITY ", text)


class _Blocks:
    """Fills the A2L objects one by one and records their locations."""

    def __init__(self, elf: Elf, prefix: str, real: int, instance: _Instance) -> None:
        self.elf, self.prefix, self.real, self.instance = elf, prefix, real, instance
        self.places: dict[str, MemoryObject] = {}
        self.calibration: list[MemoryObject] = []
        self.left_out: list[str] = []

    def filled(self, block: re.Match[str]) -> str:
        text, name = block[0], block["name"]
        link = _LINK.search(text)
        if link is None or len(_ADDRESS.findall(text)) != 1:
            raise BuildError(f"{name} is not as it was built", where=f"{self.prefix}.a2l", remedy="build again")
        if block["kind"] == "MEASUREMENT":
            return self._measurement(text, name, link["path"])
        place = self.elf.place(link["path"])
        if place is None:
            raise BuildError(
                f"no variable {link['path']}",
                where=self.elf.name,
                remedy=NOT_FOUND_REMEDY,
            )
        self._check(text, name, place)
        self.calibration.append(place)
        return self._with(text, name, place)

    def _measurement(self, text: str, name: str, link: str) -> str:
        path = _moved(link, self.prefix, self.instance)
        place = None if path is None else self.elf.place(path)
        if path is None or place is None:
            self.left_out.append(name)
            return ""
        if place.kind != "float":
            text = _TYPE.sub(_UNSIGNED[place.size], text, count=1)
        elif place.size != self.real:
            raise BuildError(f"{path} is a number of {place.size} bytes", where=self.elf.name, remedy="link it with this build")
        return self._with(text.replace(f'"{link}"', f'"{path}"'), name, place)

    def _with(self, text: str, name: str, place: MemoryObject) -> str:
        if place.address >= 1 << 32:
            what = f"{name} lies at 0x{place.address:X}, beyond the 32 bits of an A2L"
            raise BuildError(what, where=self.elf.name, remedy="link it elsewhere, on a PC without PIE")
        self.places[name] = place
        return _ADDRESS.sub(f"0x{place.address:08X}", text)

    def _check(self, text: str, name: str, place: MemoryObject) -> None:
        layout = next(each for each in _SIZES if re.search(rf"\b{self.prefix}_{each} 0 ", text))
        size = _SIZES[layout] or self.real
        count = 1
        for points in _AXIS_POINTS.finditer(text):
            count *= int(points[1] or points[2])
        if (place.size, place.count) != (size, count):
            raise BuildError(
                f"{name} is {place.count} numbers of {place.size} bytes, in this build {count} of {size}",
                where=self.elf.name,
                remedy="link the program with this build",
            )


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


def _moved(link: str, prefix: str, instance: _Instance) -> str | None:
    """Replace the build's object name in a path by the program's; None if that object has no such member."""
    inside = link.removeprefix(f"{prefix}_{INSTANCE}")
    if instance.what == "task":
        return instance.path + inside
    if instance.what == "controller" and inside == f".{SUPERVISION}.status":
        return f"{instance.path}.status"
    if instance.what == "controller" and inside.startswith(".controller."):
        return instance.path + inside.removeprefix(".controller")
    return None


def _headed(text: str, elf: Elf, segment: tuple[int, int], epk: MemoryObject) -> str:
    digest = hashlib.sha256(elf.content).hexdigest()
    address, size = segment
    byte_order = "MSB_LAST" if elf.is_little else "MSB_FIRST"
    origin = f"Addresses of {comment_text(PurePath(elf.name).name)}, SHA-256 {digest}"
    for pattern, new in (
        (r"(?<=/begin HEADER \")[^\"]*", f"Made by codegen; do not edit, build again. {origin}"),
        (r"(?<=BYTE_ORDER )MSB_\w+", byte_order),
        (r"(?<= BYTE_ORDER_)MSB_\w+(?= ADDRESS)", byte_order),
        (r"(?<=ADDR_EPK )0x00000000", f"0x{epk.address:08X}"),
        (r"(?<=INTERN )0x00000000 0x0\b", f"0x{address:08X} 0x{size:X}"),
    ):
        text, count = re.subn(pattern, new, text, flags=re.MULTILINE)
        if count != 1:
            raise BuildError("its header is not as it was built", where="the build's A2L", remedy="build again")
    return text

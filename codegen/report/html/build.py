"""Tables of a build: what was verified, budgets, memory map, manifest with hashes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from codegen.configuration.budgets import KEY_OF_FUNCTION
from codegen.emit.folder import VERIFICATION_FILES, read_manifest, verify_hashes
from codegen.emit.limiter_view import cut_text
from codegen.emit.manifest import read_build
from codegen.judgement.build_warnings import is_current, read_record
from codegen.report.html.page import Block, Table, Text

VERDICTS = {"passed": "good", "shown": "good", "failed": "bad"}
SECTIONS = ("text", "rodata", "data", "bss")
FUNCTION_TITLES = {
    "controller_step": "controller_step, its limiter apart",
    "cycle": "cycle: both frames received, and the task",
}


def verification_blocks(folder: Path) -> Iterator[Block]:
    """Yield the record of `codegen verify` of a build; a notice if there is none, or one of other files.

    Raises:
        BuildError: not a build folder.
    """
    read_manifest(folder)
    if not (folder / VERIFICATION_FILES[0]).exists():
        yield Text(
            f"This build has no verification record. Run `codegen verify {folder}`, then write the report again.", "notice"
        )
        return
    record = read_record(folder)
    if record is None:
        yield Text(
            f"{VERIFICATION_FILES[0]} beside this build is damaged or of another version and is not shown. "
            f"Run `codegen verify {folder}`, then write the report again.",
            "notice",
        )
        return
    if not is_current(record, folder):
        yield Text(f"This record belongs to an older build. Run `codegen verify {folder}` to verify this one.", "notice")
    if record.get("effort") == "quick":
        yield Text(f"Only the quick checks were run. `codegen verify {folder}` runs them in full.", "notice")
    rows = [(name, check["shows"], check["figure"] or "-", check["verdict"]) for name, check in record["checks"].items()]
    yield Table(
        "What codegen verify checked",
        ("check", "what it shows", "figure", "verdict"),
        rows,
        words=(0, 1, 2, 3),
        verdicts=VERDICTS,
    )
    if requirements := record.get("requirements"):
        header = tuple(requirements[0])
        yield Table(
            "Requirements", header, [tuple(row.values()) for row in requirements], words=range(len(header)), verdicts=VERDICTS
        )
    found = [(name, finding) for name, check in record["checks"].items() for finding in check["findings"]]
    if found:
        yield Table("Findings", ("check", "finding"), found, words=(0, 1))
    budgets = record["checks"].get("budgets", {}).get("figures", {})
    if "functions" in budgets:
        yield from _budgets(budgets)
    limits = [(name, limit) for name, check in record["checks"].items() for limit in check["limits"]]
    yield Table("What is not shown", ("check", "limit"), limits, words=(0, 1))


def current_record(folder: Path) -> Mapping[str, Any] | None:
    """Return the verification record of a build; None if there is none, or if it belongs to other files."""
    record = read_record(folder)
    return record if record is not None and is_current(record, folder) else None


def _budgets(figures: Mapping[str, Any]) -> Iterator[Block]:
    asked, counted = figures["budgets"], figures["functions"]
    rows = []
    for name, count in counted.items():
        budget = asked.get(KEY_OF_FUNCTION.get(name, ""))
        instructions = count["instructions"]
        rows.append((FUNCTION_TITLES.get(name, name), *map(_number, (instructions["max"], instructions["mean"], budget))))
    header = ("function", "instructions, worst", "mean", "budget of instructions")
    yield Table("Budgets on a Cortex-M4F", header, rows)
    stack = [(name, _number(each["watermark"]), _number(each["bound"])) for name, each in figures["stack_bytes"].items()]
    yield Table("Stack (bytes)", ("function", "deepest seen", "bound by the compiler's frames"), stack)
    yield from _memory(figures)


def _memory(figures: Mapping[str, Any]) -> Iterator[Block]:
    objects = figures["objects"]
    rows = [(path, *(_number(sizes.get(section, 0)) for section in SECTIONS)) for path, sizes in objects.items()]
    total = [sum(sizes.get(section, 0) for sizes in objects.values()) for section in SECTIONS]
    rows.append(("all", *map(_number, total)))
    caption = "Memory map (bytes, Cortex-M4F): code, constants, written memory of each object; the objects themselves have none"
    yield Table(caption, ("object", "code", "constants", "initialised RAM", "zeroed RAM"), rows)
    structs = [
        (f"one {name}", _number(size), "flash" if name == "parameters" else "RAM")
        for name, size in figures["struct_bytes"].items()
    ]
    yield Table("What the caller provides (bytes)", ("instance", "size", "lies in"), structs)


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:,}" if isinstance(value, int) else f"{value:,.0f}"


def manifest_blocks(folder: Path) -> Iterator[Block]:
    """Yield the origin of a build, and the SHA-256 of each of its files.

    Raises:
        BuildError: not a build folder.
    """
    manifest = read_build(folder)
    edited = verify_hashes(folder)
    if edited:
        yield Text(f"Edited since it was made: {', '.join(edited)}.", "notice")
    yield Table("Where it comes from", ("", ""), list(_origin(manifest)), words=(0, 1), hashes=True)
    rows = [(path, f"{entry['bytes']:,}", entry["sha256"]) for path, entry in manifest["files"].items()]
    yield Table("Files", ("file", "bytes", "SHA-256"), rows, words=(0, 2), hashes=True)


def _origin(manifest: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "build", f"{manifest['name']}, id {manifest['build_id']}"
    yield "generator", f"{manifest['generator']} {manifest['version']}"
    if "limiter_cut" in manifest:  # missing in older builds
        yield "share of the map cut off by the limiter", cut_text(manifest["limiter_cut"])
    for what, entry in manifest["inputs"].items():
        told = ", ".join(f"{key} {value}" for key, value in entry.items() if key != "sha256" and value is not None)
        yield f"input: {what}", f"{told}; SHA-256 {entry.get('sha256', '-')}"
    for key, value in manifest["options"].items():
        yield f"option: {key}", str(value)
    for key, value in manifest["tools"].items():
        yield f"tool: {key}", str(value)
    if calibration := manifest.get("calibration"):  # older builds have a checksum of the map only
        yield "checksum of the calibration (CRC-32)", calibration["checksum_crc32"]

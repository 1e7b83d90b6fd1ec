"""Instructions of the E2E protection on a Cortex-M4F, for each profile. Counted, not timed."""

from __future__ import annotations

from typing import get_args

from benchmarks.images import flash_bytes
from benchmarks.tables import Row
from codegen.configuration.e2e_profiles import PROFILES, ProfileName
from codegen.verify.target import DATA, Processor, compile_image
from tests.sil import e2e_profiles

HEADER = ("profile", "CRC", "protect", "check, worst", "flash bytes")
FRAMES = 100
"""Frames of each profile. The run time depends on the counter only: in sequence, repeated, or after a gap."""


def rows() -> tuple[Row, ...]:
    """Return the instructions of each profile for a frame of classical CAN."""
    return tuple(_row(name) for name in get_args(ProfileName))


def _row(name: ProfileName) -> Row:
    files, profile = e2e_profiles.built(name).folder.files, PROFILES[name]
    paths = ("src/ars_e2e.c", "include/ars_e2e.h", "include/ars_sections.h")
    entries = tuple(f"ars_e2e_{what}" for what in ("crc", "protect", "check", "receiver_init"))
    image = compile_image({path: files[path] for path in paths}, entries, ("-O2", "-fdata-sections"))
    core = Processor(image)
    frame, counter, receiver = DATA, DATA + 64, DATA + 128
    core.call("ars_e2e_receiver_init", receiver)
    counts: dict[str, list[int]] = {"crc": [], "protect": [], "check": []}

    def count(what: str, *arguments: int) -> None:
        counts[what].append(int(core.traced(lambda: core.call(f"ars_e2e_{what}", *arguments)).instructions.sum()))

    for step, (_, number, _, contents) in enumerate(e2e_profiles.random_frames(profile, FRAMES)):
        core.write(frame, contents)
        if step % 10 == 3:  # one frame is lost
            core.write(counter, bytes(((core.read(counter, 1)[0] + 1) % profile.counter_count,)))
        count("protect", number, counter, frame)
        count("crc", number, frame)
        count("check", receiver, number, frame)
        if step % 10 == 7:  # the frame comes twice
            count("check", receiver, number, frame)
    worst = {what: max(found) for what, found in counts.items()}
    return Row((name, str(worst["crc"]), str(worst["protect"]), str(worst["check"]), f"{flash_bytes(image):,}"))

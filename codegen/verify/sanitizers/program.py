"""The C around the generated code: a server, the plant and the closed loop, and the fuzz harnesses of reception and step.

All of it is one program; the harnesses also work with libFuzzer. The driver of the harnesses works with every compiler and
follows coverage too.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np

from codegen.configuration import Config
from codegen.configuration.can import Message, RealSignal
from codegen.configuration.signals import CARRIED, MEASURED
from codegen.emit.can_view import task_view
from codegen.emit.controller_view import REFERENCE_OVERSHOOT
from codegen.emit.laws import LAWS
from codegen.emit.render import render, verbatim
from codegen.emit.text import c_type, literal, numpy_type
from codegen.sil.software import bench_sources
from codegen.verify.check import Subject

Name = Literal["can", "step"]
HARNESSES: tuple[Name, ...] = ("can", "step")

COVERAGE = "-fsanitize-coverage=trace-pc"
"""Flag with which the sanitized code reports its edges to the driver."""
CRC_AND_COUNTER = range(12)
"""Bits of a protected frame."""


def sources(subject: Subject) -> dict[str, bytes]:
    """Return the C of the program."""
    return {
        **bench_sources(subject.config, subject.prefix, subject.manifest["options"]["precision"]),
        **{f"fuzz_{name}.c": harness(subject, name, f"fuzz_{name}") for name in HARNESSES},
        "fuzz_main.c": verbatim("verify/fuzz_main.c"),
        "served_ecu.c": render("verify/served_ecu.c.j2", _context(subject)),
    }


def harness(subject: Subject, name: Name, entry: str = "LLVMFuzzerTestOneInput") -> bytes:
    """Return the C of a harness, with the name of its function."""
    return render(f"verify/fuzz_{name}.c.j2", {**_context(subject), "entry": entry})


def _context(subject: Subject) -> dict[str, Any]:
    config, facts, precision = subject.config, subject.manifest["map"], subject.manifest["options"]["precision"]
    law, real, cap = LAWS[subject.kind], numpy_type(precision), facts["lateral_acceleration_cap_m_s2"]
    numbers = {
        "sampling_time": config.controller.sampling_time_s,
        "plant_step": config.plant.sampling_time_s,
        "actuator_angle_max": float(real(config.rear_actuator.angle_max)),
        "cap": cap,
        "cap_per_friction": cap / facts["frictions"][0],
        "overshoot": REFERENCE_OVERSHOOT if law.uses_reference_model else 1.0,
        "rounding": 8.0 * float(np.finfo(real).eps),
        "smallest": float(np.finfo(real).smallest_subnormal),
    }
    return {
        "build": {"prefix": subject.prefix, "PREFIX": subject.prefix.upper()},
        "real": c_type(precision),
        "task": task_view(config),
        "can": config.can,
        "used_bits": _used_bits(config.can.rear_steer_command),
        "signals": tuple(_reals(config)),
        "measured": MEASURED,
        "carried": CARRIED,
        "stacked": len(facts["frictions"]) > 1,
        "with_rear_angle": law.uses_rear_angle,
        "with_model": law.uses_reference_model,
        **{key: literal(value, "double") for key, value in numbers.items()},
    }


def _used_bits(message: Message) -> int:
    """Return a mask of the used bits of a frame, from the lowest of byte 0."""
    used = {*CRC_AND_COUNTER, *(bit for signal in message.signals().values() for bit in signal.bits(message.byte_order))}
    return sum(1 << bit for bit in used)


def _reals(config: Config) -> Iterator[tuple[str, str, RealSignal]]:
    """Yield struct in the harness, field and layout of each scaled signal."""
    names = {"vehicle_motion": "motion", "vehicle_conditions": "conditions", "rear_steer_command": "command"}
    for role, message in config.can.messages().items():
        for name, signal in message.signals().items():
            if isinstance(signal, RealSignal):
                yield names[role], name, signal

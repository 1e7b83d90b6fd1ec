"""Builds with other kinds of frames than classical CAN with 11-bit identifiers and E2E profile 1A."""

import functools
from pathlib import Path
from typing import Any

from codegen.configuration import Xcp
from tests import builds, shared
from tests.whole_car import car

IDS = {"vehicle_motion": 0x18FF0101, "vehicle_conditions": 0x102, "rear_steer_command": 0x1FFFFFFF}
"""Identifiers of 29 bits; one of them would fit into 11."""
EXTENDED: dict[str, Any] = {
    "extended_ids": True,
    **{role: {"id": number, "data_id": number & 0x7FF} for role, number in IDS.items()},
}


FD = {"data_bitrate_kbit_s": 2000.0, "frame_bytes": 12}
KINDS: dict[str, dict[str, Any]] = {
    "29 bits": EXTENDED,
    "FD, 12 bytes, profile 5": {
        **FD,
        "e2e": {"profile": "5"},
        # The default signals do not fit into the first eight bytes with this header.
        "vehicle_motion": {"qualifier": {"start_bit": 24}, "speed": {"start_bit": 80}},
        "vehicle_conditions": {"inhibit": {"start_bit": 24}, "rear_angle": {"start_bit": 80}},
        "rear_steer_command": {"status": {"start_bit": 24}, "rear_angle": {"start_bit": 80}},
    },
    "FD, 24 bytes, profile 11C, 29 bits": {
        **FD,
        "frame_bytes": 24,
        "extended_ids": True,
        "e2e": {"profile": "11C"},
        "vehicle_motion": {**EXTENDED["vehicle_motion"], "qualifier": {"start_bit": 64}},
        "vehicle_conditions": {**EXTENDED["vehicle_conditions"], "inhibit": {"start_bit": 64}},
        "rear_steer_command": {**EXTENDED["rear_steer_command"], "status": {"start_bit": 64}},
    },
    "FD, 64 bytes, profile 5": {
        **FD,
        "frame_bytes": 64,
        "e2e": {"profile": "5"},
        "vehicle_motion": {"qualifier": {"start_bit": 500}, "speed": {"start_bit": 80}},
        "vehicle_conditions": {"inhibit": {"start_bit": 511}, "rear_angle": {"start_bit": 80}},
        "rear_steer_command": {"status": {"start_bit": 24}, "rear_angle": {"start_bit": 80}},
    },
    "FD, 8 bytes": {"data_bitrate_kbit_s": 4000.0},
}


XCP_FD = {
    "receive_id": 0x18DA10F1,
    "transmit_id": 0x18DAF110,
    "extended_ids": True,
    "data_bitrate_kbit_s": 2000.0,
    "frame_bytes_max": 64,
    "max_cto": 64,
    "max_dto": 48,
}
"""XCP in frames of CAN FD with 29-bit identifiers, beside the default frames of the task."""


def xcp_folder() -> Path:
    """Return the paper's build with such an XCP, on disk. Tests must not write to it."""
    config = builds.CONFIG.model_copy(update={"xcp": Xcp.model_validate(XCP_FD)})
    return shared.written("build folder XCP FD", lambda: builds.render(builds.paper_map(), config))


@functools.cache
def built(name: str = "29 bits") -> builds.Built:
    """Return the paper's build with another kind of frames."""
    can = car({"can": KINDS[name]}).can
    return builds.make(builds.paper_map(), builds.CONFIG.model_copy(update={"can": can}))


def folder(name: str) -> Path:
    """Return such a build on disk. Tests must not write to it."""
    return shared.written(f"build folder {name}", lambda: built(name).folder)

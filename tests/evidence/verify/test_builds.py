"""The checks of `codegen verify` on builds of every kind, precision, grid and layout: no findings."""

import functools
import importlib
import math

import pytest

from codegen import configuration
from codegen.ecu_map.placement import Request
from codegen.emit.folder import Folder
from codegen.optimum.solve import solve_case
from codegen.verify.outcomes import Effort, Verdict
from codegen.verify.runner import CHECKS
from tests import frame_kinds
from tests.sil import e2e_profiles
from tests.verify import builds, planted

MODULES = {check.name: check.module for check in CHECKS}
QUICK = ("memory",)
"""Checks of the quick form: those that neither `make test` nor the quick form of the part "builds" runs."""


def other_car() -> Folder:
    """Return a build with the map of another car: only the C contains the car that steers at the limit of grip."""
    config = builds.config_of("tracking", "uneven")
    heavier = config.model_copy(update={"vehicle": config.vehicle.model_copy(update={"mass_kg": 2400.0})})
    return builds.build_of(solve_case(config, builds.CASE), heavier, "ars.toml")


def other_frames() -> Folder:
    """Return the paper's build with Motorola byte order, an offset, unsigned signals and other identifiers."""
    data = configuration.preset("paper").model_dump(mode="json")
    motion, command = data["can"]["vehicle_motion"], data["can"]["rear_steer_command"]
    motion["byte_order"], command["byte_order"] = "motorola", "motorola"
    motion["qualifier"]["start_bit"] = 15
    for message, starts in ((motion, (23, 39, 55)), (command, (23, 39))):
        names = [name for name, signal in message.items() if isinstance(signal, dict) and "factor" in signal]
        for name, start in zip(names, starts, strict=True):
            message[name]["start_bit"] = start
    command["status"]["start_bit"], command["diagnostics"]["start_bit"] = 15, 55
    command["id"], command["data_id"] = 0x3A0, 0x1234
    command["rear_angle"].update(signed=False, offset=-1.6)
    config = configuration.parse(data, "test")
    return builds.build_of(solve_case(config, builds.CASE), config, prefix="rear2")


@functools.cache
def placed() -> Folder:
    """Return a build with another prefix, chosen breakpoints and 16-bit tables."""
    request = Request(math.radians(0.5), None, "int16", "--max-error 0.5deg/s --storage int16")
    config = builds.config_of("tracking")
    return builds.build_of(solve_case(config, builds.CASE), config, prefix="rear_axle", request=request)


BUILDS = {
    **{kind: functools.partial(builds.made, kind) for kind in builds.KINDS},
    "uneven": functools.partial(builds.made, "pi", "uneven"),
    "stack": functools.partial(builds.made, "tracking", "uneven", layers=True),
    "double": functools.partial(builds.made, "pi", precision="double"),
    "double stack": functools.partial(builds.made, "tracking", "uneven", layers=True, precision="double"),
    "other car": other_car,
    "profile 1C": lambda: e2e_profiles.built("1C").folder,
    "profile 2": lambda: e2e_profiles.built("2").folder,
    "profile 5": lambda: e2e_profiles.built("5").folder,
    "29 bits": lambda: frame_kinds.built("29 bits").folder,
    "FD, 64 bytes, profile 5": lambda: frame_kinds.built("FD, 64 bytes, profile 5").folder,
    "other frames": other_frames,
    "placed": placed,
}
NOT_RUN = {(check, name) for check in ("budgets", "contracts") for name in ("double", "double stack")}
"""Checks that support single precision only."""


def case(check: str, name: str) -> object:
    is_long = check not in QUICK or name != "stack"
    return pytest.param(check, name, marks=[pytest.mark.long] if is_long else [], id=f"{check}-{name}")


@pytest.mark.parametrize(("check", "name"), [case(check, name) for check in MODULES for name in BUILDS])
def test_nothing_is_found(check: str, name: str) -> None:
    subject = planted.subject_of(BUILDS[name]())
    outcome = importlib.import_module(MODULES[check]).check(subject, Effort(quick=True))
    if (check, name) in NOT_RUN:
        assert outcome.verdict is Verdict.NOT_RUN
        return
    assert outcome.findings == ()
    assert outcome.verdict is Verdict.PASSED
    if check == "budgets":
        # 1650 instructions of two cycles are a third of a percent of 10 ms at 100 MHz.
        step = outcome.figures["functions"]["controller_step"]["instructions_with_limiter"]["max"]
        assert step <= (1_650 if "tracking" in subject.kind else 900)


@pytest.mark.long
@pytest.mark.parametrize("check", ["processor-in-the-loop", "budgets", "sanitizers"])
def test_outcomes_are_repeatable(check: str) -> None:
    subject = planted.subject_of(builds.made("pi", "uneven"))
    first, second = (importlib.import_module(MODULES[check]).check(subject, Effort(quick=True)) for _ in range(2))
    assert first == second

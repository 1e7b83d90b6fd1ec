"""Generate and verify C for active rear steering (ARS) from vehicle data: the public library.

    import codegen as ars

    m = ars.tune(ars.solve(ars.preset("recommended"), case="4ws-2"))
    b = ars.build(m, "generated/4ws2")
    run = ars.run(b, "step-steer", speed_km_h=60.0)
    run.plot("run.png")

The names in `__all__` are public, and nothing else is. Paths may be texts or `pathlib.Path`. `CodegenError` is the only
exception of bad input. Functions that take long accept `progress`, a callable of a share from 0 to 1.
"""

from __future__ import annotations

import sys
from types import ModuleType

TYPE_CHECKING = False  # avoids importing typing
if TYPE_CHECKING:
    from codegen.configuration import Config as Config
    from codegen.errors import CheckFailed as CheckFailed
    from codegen.errors import CodegenError as CodegenError
    from codegen.library.building import NewBuild as NewBuild
    from codegen.library.building import build as build
    from codegen.library.builds import Build as Build
    from codegen.library.builds import load_build as load_build
    from codegen.library.calibration import Calibration as Calibration
    from codegen.library.calibration import calibrate as calibrate
    from codegen.library.campaigns import Campaign as Campaign
    from codegen.library.campaigns import Replay as Replay
    from codegen.library.campaigns import replay as replay
    from codegen.library.campaigns import sweep as sweep
    from codegen.library.checks import Check as Check
    from codegen.library.checks import Faults as Faults
    from codegen.library.checks import check as check
    from codegen.library.checks import faults as faults
    from codegen.library.comparisons import Difference as Difference
    from codegen.library.comparisons import FlashSizes as FlashSizes
    from codegen.library.comparisons import Paper as Paper
    from codegen.library.comparisons import compare as compare
    from codegen.library.comparisons import flash_sizes as flash_sizes
    from codegen.library.comparisons import paper as paper
    from codegen.library.configurations import NewConfig as NewConfig
    from codegen.library.configurations import init as init
    from codegen.library.configurations import load_config as load_config
    from codegen.library.configurations import preset as preset
    from codegen.library.configurations import schema as schema
    from codegen.library.exports import Export as Export
    from codegen.library.exports import export as export
    from codegen.library.identification import DrivePlan as DrivePlan
    from codegen.library.identification import Drives as Drives
    from codegen.library.identification import Identification as Identification
    from codegen.library.identification import identify as identify
    from codegen.library.identification import plan_drives as plan_drives
    from codegen.library.identification import read_drives as read_drives
    from codegen.library.imports import ImportedMap as ImportedMap
    from codegen.library.imports import ImportedTyres as ImportedTyres
    from codegen.library.imports import import_map as import_map
    from codegen.library.imports import import_tyres as import_tyres
    from codegen.library.logs import Log as Log
    from codegen.library.logs import log as log
    from codegen.library.maps import Map as Map
    from codegen.library.maps import load_map as load_map
    from codegen.library.reports import Report as Report
    from codegen.library.reports import report as report
    from codegen.library.result import Progress as Progress
    from codegen.library.result import Result as Result
    from codegen.library.runs import Run as Run
    from codegen.library.runs import run as run
    from codegen.library.solving import SolvedMap as SolvedMap
    from codegen.library.solving import solve as solve
    from codegen.library.suites import Scenarios as Scenarios
    from codegen.library.suites import Suite as Suite
    from codegen.library.suites import scenarios as scenarios
    from codegen.library.suites import suite as suite
    from codegen.library.tuning import TunedMap as TunedMap
    from codegen.library.tuning import tune as tune
    from codegen.library.verification import Verification as Verification
    from codegen.library.verification import verify as verify

__version__ = "0.1.0"

DISTRIBUTION = "ars-codegen"
"""Name of the distribution. `ars_codegen` recognises this package by this line."""

_NAMES = {
    "configuration": ("Config",),
    "errors": ("CheckFailed", "CodegenError"),
    "library.building": ("NewBuild", "build"),
    "library.builds": ("Build", "load_build"),
    "library.calibration": ("Calibration", "calibrate"),
    "library.campaigns": ("Campaign", "Replay", "replay", "sweep"),
    "library.checks": ("Check", "check", "Faults", "faults"),
    "library.comparisons": ("Difference", "FlashSizes", "compare", "flash_sizes", "Paper", "paper"),
    "library.configurations": ("NewConfig", "init", "load_config", "preset", "schema"),
    "library.exports": ("Export", "export"),
    "library.identification": ("DrivePlan", "Drives", "Identification", "identify", "plan_drives", "read_drives"),
    "library.imports": ("ImportedMap", "ImportedTyres", "import_map", "import_tyres"),
    "library.logs": ("Log", "log"),
    "library.maps": ("Map", "load_map"),
    "library.solving": ("SolvedMap", "solve"),
    "library.reports": ("Report", "report"),
    "library.result": ("Progress", "Result"),
    "library.runs": ("Run", "run"),
    "library.suites": ("Suite", "suite", "Scenarios", "scenarios"),
    "library.tuning": ("TunedMap", "tune"),
    "library.verification": ("Verification", "verify"),
}
"""Module -> public names. A module is imported when one of its names is used, so `import codegen` is fast."""
_MODULES = {name: module for module, names in _NAMES.items() for name in names}

__all__ = sorted(_MODULES)


def __getattr__(name: str) -> object:
    """Import a public name on first use."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value = globals()[name] = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


class _Package(ModuleType):
    """The type of this module: importing a subpackage does not replace the function of the same name, such as `report`.

    Modules of the subpackage are imported as ever: `from codegen.figures.draw import save`.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _MODULES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package

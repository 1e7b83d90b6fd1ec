"""Builds with chosen breakpoints, stored as real numbers or as int16, of maps with the linear and the nonlinear tyre."""

import functools
import math
from typing import Any, Literal
from unittest import mock

from benchmarks.nonlinear_map import nonlinear
from codegen.configuration import Kind
from codegen.ecu_map import placement_grip
from codegen.ecu_map.placement import Placed, Request, choose
from codegen.ecu_map.storage import Storage
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.text import Precision
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case, solve_stack
from tests import builds, shared
from tests.sil.case import Case, compiled, made_case
from tests.sil.checks_lookup import check_map_functions, numbers_of
from tests.sil.suite import Judge, whole

BOUND = math.radians(0.5)
"""Requested bound on the error of the yaw rate, rad/s."""

Which = Literal["linear", "stack", "nonlinear", "nonlinear stack"]


@functools.cache
def map_of(which: Which) -> ReferenceMap:
    """Return a map, solved once for all workers."""
    if which == "linear":
        return builds.paper_map()
    config = nonlinear(builds.CONFIG, "4ws-2") if which.startswith("nonlinear") else builds.CONFIG

    def solve() -> ReferenceMap:
        return solve_case(config, "4ws-2") if which == "nonlinear" else solve_stack(config, "4ws-2", [0.4, 0.65, 0.9])

    solved: ReferenceMap = shared.once(f"map {which}", solve)
    return solved


@functools.cache
def placed(kind: Kind, precision: Precision, storage: Storage, which: Which = "linear") -> tuple[Case, Placed]:
    """Return the compiled case and its breakpoints; nonlinear maps use a coarser grid than in practice."""
    config, reference_map = builds.CONFIGS[kind], map_of(which)
    request = Request(BOUND, None, storage, f"--max-error 0.5deg/s --storage {storage}")
    options = BuildOptions("sample", precision=precision, request=request)
    chosen: list[Placed] = []

    def choosing(*arguments: Any) -> Placed:
        chosen.append(choose(*arguments))
        return chosen[0]

    with mock.patch.object(placement_grip, "HALVINGS", 1), mock.patch("codegen.emit.build.choose", choosing):
        folder = build(reference_map, config, options, BuildInputs("sample.npz", "0" * 64, "preset"))
    name = f"{kind} {precision} {storage} {which}"
    return compiled(name, functools.partial(made_case, name, folder, chosen[0].total, config)), chosen[0]


def judges_of_map(case: Case) -> list[Judge]:
    """Return the lookup checks of a placed build that do not write its calibration."""
    is_plain = not case.built.total.layers and case.built.total.grip is None
    return [judge for judge in whole(case.kind, ("map",)) if not judge.of_single and (is_plain or not judge.of_one_layer)]


def check_placed(case: Case, found: Placed) -> None:
    """Check that checksum, flash size and self-test cover tables, scales, axes and grip tables."""
    check_map_functions(case.built)
    facts = case.built.folder.manifest["map"]
    assert facts["flash_bytes"] == found.flash_bytes == sum(part.nbytes for part in numbers_of(case.built))
    assert case.built.software.function("map_valid")()

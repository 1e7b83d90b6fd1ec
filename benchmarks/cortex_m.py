"""Instructions on a Cortex-M4F: a step of each kind of controller, ways to compute a tyre's curve, E2E protection.

Counted, not timed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from benchmarks import e2e_profiles
from benchmarks.images import flash_bytes
from benchmarks.tables import CountReport, Row
from benchmarks.tyre_curves import Candidate, Shape, candidates
from codegen import configuration
from codegen.configuration import Config, Kind
from codegen.design.gains import tune
from codegen.ecu_map.placement import Request
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder
from codegen.optimum.solve import solve_case, solve_stack
from codegen.verify.machine_code import Program
from codegen.verify.outcomes import Effort, Subject
from codegen.verify.resource_usage import Count, measure_step
from codegen.verify.target import DATA, Processor, compile_image
from hil_sim.suite.requirements import STEP_INSTRUCTIONS_MAX

CASE = "4ws-2"
CHOSEN = Request(math.radians(1.5), None, "int16", "--max-error 1.5deg/s --storage int16")
"""Breakpoints chosen for an error. A map that bends towards its cap has no much smaller one."""

FRICTIONS = (0.3, 0.5, 0.7)
UNEVEN = {
    "speed_breakpoints_km_h": [20.0, 23.0, 30.0, 42.5, 60.0, 61.0, 90.0, 120.0],
    "front_angle_breakpoints_deg": [0.1, 0.5, 1.0, 2.0, 2.5, 4.0, 6.75, 10.0],
}

SMALL_SLIP = 0.1
"""Argument of the curve up to which the tyre is linear and a relative error is one of its cornering stiffness."""

POINTS, QUICK_POINTS = 20_000, 2_000
FRAME = """#include <stdint.h>
float curve(float x);
void frame(const float *x, float *y, uint32_t count);
void frame(const float *x, float *y, uint32_t count)
{
    for (uint32_t k = 0u; k < count; k++) {
        y[k] = curve(x[k]);
    }
}
"""


def run(quick: bool, say: Callable[[str], None]) -> CountReport:
    """Count everything."""
    say("designing the gains")
    config = _tuned()
    steps = []
    for name, folder, at_most in _builds(config, quick):
        say(f"counting the steps of {name}")
        step = measure_step(Subject(name, folder.files, folder.manifest), Effort(quick))
        steps.append(step_row(name, step, at_most))
    tyre, folder = config.tyre.front, _folder(config)
    shape = Shape(tyre.shape_factor_c, tyre.curvature_factor_e)
    say("counting tyre curves")
    curves = [curve_row(candidate, shape, QUICK_POINTS if quick else POINTS) for candidate in candidates(shape, folder.files)]
    say("counting the E2E profiles")
    profiles = e2e_profiles.rows()
    return CountReport(
        (
            (
                "A step of the controller, instructions on a Cortex-M4F",
                ("build", "worst", "without the limiter", "mean", "required"),
                tuple(steps),
            ),
            (
                f"A tyre's curve with C = {shape.C:g} and E = {shape.E:g}, instructions of a call",
                ("computed by", "worst", "mean", "flash bytes", "largest error", "of small slip"),
                tuple(curves),
            ),
            ("E2E protection of a frame of eight bytes, instructions of a call", e2e_profiles.HEADER, profiles),
        ),
        (
            "clang -O2 of the package ziglang, run in unicorn. Worst: the longest step that was found, a measured maximum.",
            "Mean: over the first seconds of the built-in scenarios in closed loop.",
            "Errors: in single precision on the target, of a curve whose peak is 1; of small slip: the largest one below",
            f"x = {SMALL_SLIP:g}, as a share of the value there. The libm has its sinf in software doubles.",
        ),
    )


def _tuned() -> Config:
    config = configuration.preset("recommended")
    tracking = config.controller.tracking.model_copy(update={"schedule": tune(config)})
    return config.model_copy(update={"controller": config.controller.model_copy(update={"tracking": tracking})})


def _builds(config: Config, quick: bool) -> Iterator[tuple[str, Folder, int | None]]:
    """Yield name, build, and the limit of its longest step."""
    uneven = config.model_copy(update={"grid": config.grid.model_copy(update=UNEVEN)})
    yield "tracking", _folder(config), STEP_INSTRUCTIONS_MAX
    yield "tracking, uneven axes", _folder(uneven), None
    yield "tracking, map for 4 frictions", _folder(config, FRICTIONS), None
    yield "tracking, both", _folder(uneven, FRICTIONS), None
    if not quick:
        kinds: tuple[Kind, ...] = ("pi", "feedforward", "proportional")
        for kind in kinds:
            controller = config.controller.model_copy(update={"kind": kind})
            yield kind, _folder(config.model_copy(update={"controller": controller})), None
        yield "tracking, chosen for 1.5 deg/s, int16", _folder(config, request=CHOSEN), None
        yield "the same for 4 frictions", _folder(config, FRICTIONS, CHOSEN), None


def _folder(config: Config, frictions: Sequence[float] = (), request: Request | None = None) -> Folder:
    stack = (*frictions, config.road.friction)
    reference_map = solve_stack(config, CASE, stack) if frictions else solve_case(config, CASE)
    options = BuildOptions(CASE, request=request)
    return build(reference_map, config, options, BuildInputs(f"{CASE}.npz", "0" * 64, "preset"))


def step_row(name: str, step: Count, at_most: int | None) -> Row:
    """Return the row of one build; `at_most` None for no limit."""
    whole = step.instructions_with_limiter or step.instructions
    met = at_most is None or whole.max <= at_most
    required = "-" if at_most is None else f"<= {at_most:,}: {'met' if met else 'MISSED'}"
    return Row((name, f"{whole.max:,}", f"{step.instructions.max:,}", f"{whole.mean:,.0f}", required), met)


def curve_row(candidate: Candidate, shape: Shape, points: int) -> Row:
    """Return the row of one way to compute a tyre's curve, at so many arguments."""
    image = compile_image({**candidate.sources, "frame.c": FRAME}, ("frame", "curve"), ("-O2", "-fdata-sections"))
    core, program = Processor(image), Program(image)
    place = np.linspace(0.0, 1.0, points, endpoint=False)
    x = (2.0 * place / (1.0 - place)).astype(np.float32)
    results = DATA + x.nbytes
    core.write(DATA, x.tobytes())
    blocks = core.traced(lambda: core.call("frame", DATA, results, points))
    y = np.frombuffer(core.read(results, x.nbytes), dtype=np.float32)
    exact = shape(x.astype(np.float64))
    error, small = float(np.abs(y - exact).max()), (x > 0.0) & (x < SMALL_SLIP)
    slope = 100.0 * float(np.abs(y[small] / exact[small] - 1.0).max())
    frame = program.named("frame")
    inside = (blocks.address < frame.start) | (blocks.address >= frame.end)
    call = np.cumsum(blocks.address == program.named("curve").start) - 1
    counts = np.bincount(call[inside], weights=blocks.instructions[inside])
    flash = flash_bytes(image) - (frame.end - frame.start)
    return Row(
        (candidate.name, f"{counts.max():,.0f}", f"{counts.mean():,.0f}", f"{flash:,}", f"{error:.1e}", f"{slope:.2g} %")
    )

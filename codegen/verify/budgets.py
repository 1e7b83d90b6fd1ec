"""Check the budgets of the code on a Cortex-M4F: instructions, stack, memory of an instance, flash.

A largest number of instructions exists because every loop ends after a fixed number of rounds.
"""

from __future__ import annotations

import importlib.metadata
import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from codegen.configuration.budgets import KEY_OF_FUNCTION, MapShape
from codegen.ecu_map.storage import Axis
from codegen.errors import BuildError
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.resource_usage import CYCLE, NOT_SINGLE, ResourceUsage, measure

SHOWS = (
    "With clang -O2 for a Cortex-M4F, the longest calls found, the stack, the memory of an instance and the flash are within "
    "their budgets; every loop has a fixed number of iterations; there are no writable static objects"
)
LIMITS = (
    "The longest calls are measured maxima over drives, with the default parameters and with limits so tight that all of them "
    "act. They are not a proof. The task's figure is the sum of its longest cycle without packing and the longest packing of a "
    "frame, which seldom coincide.",
    "The instructions are those of clang with -O2 -fomit-frame-pointer. Other compilers and flags, and the stack frame of an "
    "interrupt, are not included.",
)
NOT_IN_CLOSED_LOOP = "Without a compiler for this machine, calls of the closed loop are not among those that were counted."

TOOLS = ("ziglang", "unicorn", "capstone", "pyelftools")


def check(subject: Subject, effort: Effort) -> Outcome:
    """Check 4. Raises MissingTool: a package of the extra is not installed."""
    if not subject.is_single:
        return Outcome(SHOWS, "not for a Cortex-M4F", Verdict.NOT_RUN, (NOT_SINGLE,))
    try:
        if subject.unbounded:  # it might not terminate
            findings = tuple(f"{each}: instructions without a bound" for each in subject.unbounded)
            return Outcome(SHOWS, "instructions without a bound", Verdict.FAILED, findings)
        usage = measure(subject, effort)
    except BuildError as error:
        return Outcome(SHOWS, "it cannot be measured", Verdict.FAILED, (str(error),))
    budgets = _budgets(subject)
    findings = (*_exceeded(usage, budgets), *_stacks(usage, budgets), *_memory(subject, usage, budgets))
    return Outcome(
        shows=SHOWS,
        figure=_figure(usage),
        verdict=Verdict.FAILED if findings else Verdict.PASSED,
        findings=findings,
        figures={"budgets": budgets, **_figures(usage)},
        limits=(*LIMITS, *(() if usage.in_closed_loop else (NOT_IN_CLOSED_LOOP,))),
        tools={tool: importlib.metadata.version(tool) for tool in TOOLS},
    )


def _budgets(subject: Subject) -> dict[str, int]:
    config = subject.config
    table = subject.manifest["map"]
    grip = table.get("grip")
    axes = [
        Axis.from_breakpoints(np.array(of[name]))
        for of in (table, *([grip] if grip else []))
        for name in ("speed_m_s", "front_angle_rad")
    ]
    rounds = sum(len(axis.search_steps) for axis in axes if not axis.even)
    moving = table.get("longitudinal_accelerations")
    shape = MapShape(rounds, len(moving or table["frictions"]), grip is not None, "storage" in table, moving is not None)
    return config.budgets.resolved(config.controller.kind, shape, config.can.frame_bytes)


def _exceeded(usage: ResourceUsage, budgets: Mapping[str, int]) -> Iterator[str]:
    """Yield the functions that exceed their budget of instructions."""
    for name, key in KEY_OF_FUNCTION.items():
        count = usage.counts.get(name)
        if count is not None and count.compared > budgets[key]:
            remark = " without the limiter" if count.instructions_with_limiter else ""
            remark = f" ({count.instructions.max:,} measured)" if count.instructions_bound else remark
            yield f"{name}: {count.compared:,} instructions{remark}, {_allowed(key, budgets)}; at {count.worst_input}"


def _allowed(key: str, budgets: Mapping[str, int]) -> str:
    return f"budgets.{key} is {budgets[key]:,}"


def _stacks(usage: ResourceUsage, budgets: Mapping[str, int]) -> Iterator[str]:
    for name, (watermark, bound) in usage.stacks.items():
        if watermark > bound.bytes:
            yield f"{name}: {watermark} bytes of stack were used; the bound from the compiler's frames is {bound.bytes}"
        if name == CYCLE and bound.bytes > budgets["task_stack_bytes_max"]:
            chain = " > ".join(bound.chain)
            yield f"{name}: {bound.bytes} bytes of stack, {_allowed('task_stack_bytes_max', budgets)}; deepest in {chain}"


def _memory(subject: Subject, usage: ResourceUsage, budgets: Mapping[str, int]) -> Iterator[str]:
    state = usage.structs["controller"]
    if state > budgets["state_bytes_max"]:
        yield f"{subject.prefix}_controller_t: {state} bytes, {_allowed('state_bytes_max', budgets)}"
    flash = sum(sizes.flash for sizes in usage.sizes.values())
    if flash > budgets.get("flash_bytes_max", flash):
        yield f"all objects: {flash:,} bytes of flash, {_allowed('flash_bytes_max', budgets)}"
    for path, sizes in usage.sizes.items():
        total = sizes.sections["data"] + sizes.sections["bss"]
        for name, size in (sizes.written or (("without a name", total),)) if total else ():
            place = _place(subject, path, name)
            yield f"{place}: {size} bytes of RAM of its own ({name}); state is the caller's, and maps lie in flash"


def _place(subject: Subject, path: str, name: str) -> str:
    """Return file and line of the first definition of a variable; objects name one in a function `function.name`."""
    word = re.compile(rf"\b{re.escape(name.rpartition('.')[2])}\b")
    lines = subject.files[path].decode("ascii", "replace").splitlines()
    return next((f"{path}:{number}" for number, line in enumerate(lines, start=1) if word.search(line)), path)


def _figure(usage: ResourceUsage) -> str:
    counts = usage.counts
    step, limiter = counts["controller_step"].compared, counts["limiter_step"].compared
    lookup = counts["map_yaw_rate_on_road"].compared
    task = f"task {counts[CYCLE].instructions.max:,} (at most {counts[CYCLE].compared:,})"
    return f"lookup {lookup:,}, step {step:,} + limiter {limiter:,}, {task} instructions"


def _figures(usage: ResourceUsage) -> dict[str, Any]:
    return {
        "mean_over": "the built-in scenarios in closed loop" if usage.in_closed_loop else "drawn inputs",
        "functions": {name: count.to_dict() for name, count in usage.counts.items()},
        "stack_bytes": {
            name: {"watermark": watermark, "bound": bound.bytes, "deepest": list(bound.chain)}
            for name, (watermark, bound) in usage.stacks.items()
        },
        "objects": {path: dict(sizes.sections) for path, sizes in usage.sizes.items()},
        "flash_bytes": sum(sizes.flash for sizes in usage.sizes.values()),
        "struct_bytes": dict(usage.structs),
    }

"""Every helper of one float, called with all 2^32 of them: NaN of every kind, infinities, denormals, both zeros.

Each is held against what it is for, said another way, in double precision where there is arithmetic.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from codegen.sil.toolchain import compiler_command, compiler_identity, require_success, run as run_program
from codegen.verify.check import Effort, Outcome, Subject, Verdict

SHOWS = "Helpers of one float do what they are for with every float there is"
ALL = 1 << 32
QUICK_STRIDE = 1021
"""A prime: every exponent, and low bits of all kinds."""
PARTS = 2
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-Iinclude")

_SIGNAL = re.compile(r"to_code\(signals->(\w+), ([\w.]+), (-?\w+), (-?\w+), (-?\w+)\)")

_MAIN = """
int main(int count, char **texts)
{
    const uint64_t first = strtoull(texts[1], NULL, 10);
    const uint64_t last = strtoull(texts[2], NULL, 10);
    const uint64_t stride = strtoull(texts[3], NULL, 10);
    uint64_t broken = 0u;
    uint64_t example = 0u;

    (void)count;
    for (uint64_t bits = first; bits < last; bits += stride) {
        const uint32_t stored = (uint32_t)bits;
        float x;
        memcpy(&x, &stored, sizeof(x));
        if (!holds(x)) {
            example = (broken == 0u) ? bits : example;
            broken++;
        }
    }
    printf("%llu %llu\\n", (unsigned long long)broken, (unsigned long long)example);
    return 0;
}
"""


@dataclass(frozen=True)
class Helper:
    """A helper under test.

    Attributes:
        name: of it, with what it is given beside the float.
        unit: the source that holds it, which the harness includes: it may be static.
        body: of `bool holds(float x)`.
        beside: what the body needs before it.
    """

    name: str
    unit: str
    body: str
    beside: str = ""


@dataclass(frozen=True)
class Tried:
    """What came of a helper: how many floats broke it, and the bits of one."""

    helper: Helper
    inputs: int
    broken: int
    example: int


def run(folders: Sequence[Path], effort: Effort) -> Outcome:
    """The part of the campaign.

    Raises:
        BuildError: no compiler, or a harness that does not compile.
    """
    findings: list[str] = []
    figures: dict[str, object] = {}
    inputs = 0
    for folder in folders:
        subject = Subject.read(folder)
        tried = try_all(subject, QUICK_STRIDE if effort.quick else 1)
        inputs += sum(each.inputs for each in tried)
        figures[subject.name] = {each.helper.name: each.inputs for each in tried}
        findings += [
            f"{subject.name}: {each.helper.unit}: {each.helper.name}: {each.broken:,} floats, bits {each.example:#010x} among them"
            for each in tried
            if each.broken
        ]
    helpers = sum(len(each) for each in figures.values() if isinstance(each, dict))
    verdict = Verdict.FAILED if findings else Verdict.PASSED
    version = compiler_identity(compiler_command(), ())[0]
    return Outcome(SHOWS, f"{helpers} helpers, {inputs:,} calls", verdict, tuple(findings), figures, tools={"cc": version})


def try_all(subject: Subject, stride: int, only: str = "") -> list[Tried]:
    """Every helper of a build, or those whose name begins so, with every float or every so manieth."""
    chosen = [helper for helper in helpers_of(subject) if helper.name.startswith(only)]
    with tempfile.TemporaryDirectory(prefix="ars-exhaustive-") as folder:
        tree = Path(folder)
        for path, content in subject.sources().items():
            (tree / path).parent.mkdir(parents=True, exist_ok=True)
            (tree / path).write_bytes(content)
        with ThreadPoolExecutor(PARTS) as pool:
            return [_tried(tree, helper, stride, pool) for helper in chosen]


def _tried(tree: Path, helper: Helper, stride: int, pool: ThreadPoolExecutor) -> Tried:
    program = _built(tree, helper)
    step = -(-ALL // PARTS // stride) * stride
    parts = [(first, min(first + step, ALL)) for first in range(0, ALL, step)]
    answers = pool.map(lambda part: run_program([str(program), *map(str, part), str(stride)]), parts)
    broken, examples = 0, []
    for answer in answers:
        require_success(answer, helper.name)
        number, example = map(int, answer.stdout.split())
        broken += number
        examples += [example] if number else []
    return Tried(helper, sum(len(range(*part, stride)) for part in parts), broken, min(examples, default=0))


def _built(tree: Path, helper: Helper) -> Path:
    harness, program = tree / "harness.c", tree / "harness"
    head = "\n".join(f"#include <{name}.h>" for name in ("math", "stdbool", "stdint", "stdio", "stdlib", "string"))
    test = f"{helper.beside}\nstatic bool holds(float x)\n{{\n{helper.body}\n}}\n"
    harness.write_text(f'{head}\n#include "{helper.unit}"\n{test}{_MAIN}', encoding="ascii")
    others = [str(path.relative_to(tree)) for path in sorted((tree / "src").glob("*.c")) if path != tree / helper.unit]
    command = [*compiler_command(), *FLAGS, harness.name, *others, "-lm", "-o", program.name]
    require_success(run_program(command, tree), f"the harness for {helper.name}")
    return program


def helpers_of(subject: Subject) -> Iterator[Helper]:
    """Of a build: those that its kind has."""
    prefix = subject.prefix
    yield from _of_map(subject)
    for unit in (f"src/{prefix}_limiter.c", f"src/{prefix}_controller.c", f"src/{prefix}_reference_model.c"):
        text = subject.files.get(unit, b"").decode("ascii")
        for name, (call, body) in PLAIN.items():
            if re.search(rf"\bstatic \w+ {name}\(", text):
                yield Helper(f"{call} in {Path(unit).name}", unit, body)
    yield from _of_signals(subject)
    yield from _of_states(subject)


def _of_map(subject: Subject) -> Iterator[Helper]:
    unit, facts = f"src/{subject.prefix}_map.c", subject.manifest["map"]
    for name, key, skipped in (("speed", "speed_m_s", ""), ("front_angle", "front_angle_rad", "if (x < 0.0f) return true;")):
        points = facts[key]
        numbers = ", ".join(repr(float(point)) for point in points)
        # The constants of the axis, the steps and the fraction are rounded to single precision: a unit of the last point each.
        tolerance = repr(8.0 * 2.0**-24 * float(points[-1]))
        yield Helper(
            f"locate_{name}",
            unit,
            f"    const position_t p = locate_{name}(x);\n    double wanted = x;\n    double found;\n    {skipped}\n"
            f"    if ((p.lower > {len(points) - 2}u) || !(p.fraction >= 0.0f) || !(p.fraction <= 1.0f)) return false;\n"
            f"    if (!(wanted > points[0])) wanted = points[0];\n"
            f"    if (wanted > points[{len(points) - 1}]) wanted = points[{len(points) - 1}];\n"
            "    found = points[p.lower] + ((double)p.fraction * (points[p.lower + 1u] - points[p.lower]));\n"
            f"    return fabs(found - wanted) <= {tolerance};",
            f"static const double points[] = {{ {numbers} }};",
        )
    # Rounded once where it is capped and once where it is multiplied here.
    cap = repr(float(facts["lateral_acceleration_cap_m_s2"]) * (1.0 + 2.0**-22))
    lookup = f"{subject.prefix}_map_yaw_rate"
    asked = f"    return isfinite(r) && (r >= 0.0f) && (!isfinite(x) || (fabs((double)r * x) <= {cap}));"
    yield Helper(f"{lookup}(x, 0.05f)", unit, f"    const float r = {lookup}(x, 0.05f);\n{asked}")
    odd = f"    return isfinite(r) && (r == -{lookup}(20.0f, -x)) && (fabs((double)r * 20.0) <= {cap}) && ((x > 0.0f) || (r <= 0.0f));"
    yield Helper(f"{lookup}(20.0f, x)", unit, f"    const float r = {lookup}(20.0f, x);\n{odd}")


_CLAMPED = "x > 0.5f ? 0.5f : x >= -0.25f ? x : -0.25f"
PLAIN = {
    "clamp": ("clamp(x, -0.25f, 0.5f)", f"    return clamp(x, -0.25f, 0.5f) == ({_CLAMPED});"),
    "between": ("between(x, -0.25f, 0.5f)", f"    return isnan(x) || (between(x, -0.25f, 0.5f) == ({_CLAMPED}));"),
    "bounded": ("bounded(x, 0.5f)", "    return bounded(x, 0.5f) == (isnan(x) ? 0.0f : fmaxf(-0.5f, fminf(x, 0.5f)));"),
    "magnitude": ("magnitude(x)", "    return isnan(x) ? isnan(magnitude(x)) : magnitude(x) == fabsf(x);"),
    "is_within": ("is_within(x, 0.25f)", "    return is_within(x, 0.25f) == (!isnan(x) && (fabs((double)x) <= 0.25));"),
    "is_absent_or_within": (
        "is_absent_or_within(x, 0.25f)",
        "    return is_absent_or_within(x, 0.25f) == (isnan(x) || (fabs((double)x) <= 0.25));",
    ),
    "is_between": (
        "is_between(x, -0.25f, 0.5f)",
        "    return is_between(x, -0.25f, 0.5f) == (!isnan(x) && (fabs((double)x - 0.125) <= 0.375));",
    ),
    "toward_zero": (
        "toward_zero(x, 0.001f)",
        "    const float r = toward_zero(x, 0.001f);\n"
        "    const double exact = isnan(x) ? 0.0 : copysign(fmax(fabs((double)x) - 0.001f, 0.0), x);\n"
        "    return isinf(x) ? r == x : fabs(r - exact) <= ldexp(fabs(exact), -24);",
    ),
}
"""By the helper's name: how it is called, and what has to hold."""


def _of_signals(subject: Subject) -> Iterator[Helper]:
    """The code of each signal is the nearest one to the exact quotient; a product of a float and few digits is exact in double."""
    unit = f"src/{subject.prefix}_can.c"
    calls = dict.fromkeys(match.groups()[1:] for match in _SIGNAL.finditer(subject.files[unit].decode("ascii")))
    for steps, low, high, absent in calls:
        yield Helper(
            f"to_code(x, {steps}, {low}, {high})",
            unit,
            f"    const int32_t code = to_code(x, {steps}, {low}, {high}, {absent});\n"
            f"    const double exact = fmax({low}.0, fmin((double)x * (double){steps}, {high}.0));\n"
            f"    return code == (isnan(x) ? {absent} : (int32_t)nearbyint(exact));",
        )


def _of_states(subject: Subject) -> Iterator[Helper]:
    """What starts from a measured angle."""
    prefix = subject.prefix
    yield Helper(
        f"{prefix}_limiter_init",
        f"src/{prefix}_limiter.c",
        f"    {prefix}_limiter_t s;\n    {prefix}_limiter_init(&s, x);\n"
        "    return s.rear_angle == (fabs((double)x) <= 1.0 ? x : 0.0f);",
    )
    yield Helper(
        f"{prefix}_controller_init",
        f"src/{prefix}_controller.c",
        f"    {prefix}_controller_t s;\n    {prefix}_controller_init(&s, x);\n"
        "    return s.rear_angle == (isnan(x) ? 0.0f : fmaxf(-actuator_angle_max, fminf(x, actuator_angle_max)));",
    )
    if f"src/{prefix}_reference_model.c" in subject.files:
        for axle in ("front", "rear"):
            curve = f"{prefix}_reference_model_{axle}_curve"
            body = f"    const float r = {curve}(x);\n    return (fabsf(r) <= 1.0f) && (r == -{curve}(-x)) && ((x > 0.0f) || (r <= 0.0f));"
            yield Helper(curve, f"src/{prefix}_reference_model.c", body)

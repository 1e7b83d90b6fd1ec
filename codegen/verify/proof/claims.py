"""What is shown of which function, beside that nothing undefined happens in it.

A claim speaks of the arguments of a call, of what they point to behind it, and of its result. The same claim is shown where the
function is proven, and may be taken where it is called.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from codegen.verify.proof.c_types import Family, Scalar, Struct
from codegen.verify.proof.floats import FORMATS
from codegen.verify.proof.invariants import Path
from codegen.verify.proof.machine import Machine
from codegen.verify.proof.memory import State, Typed
from codegen.verify.proof.source import Function, Program
from codegen.verify.proof.terms import BOOL as TRUTH
from codegen.verify.proof.terms import Pool, Term

E2E_COUNTER_MAX = 14
"""AUTOSAR E2E profile 1: 15 is never sent."""
NOT_FINITE = ("_not_available", "_unpack_", "_dynamics_")
"""In names of functions whose floats may be something else: NaN for what is not available; the dynamics take and give any."""


@dataclass(frozen=True)
class Call:
    """A call, as claims see it.

    Attributes:
        scalar: a number that is an argument.
        behind: a number that an argument points to, behind the call, by the parameter's name and the path.
        before: the same before the call.
        results: the numbers of the result by their paths; () for a plain number.
    """

    pool: Pool
    scalar: Callable[[str], Term]
    behind: Callable[[str, Path], Term]
    before: Callable[[str, Path], Term]
    results: dict[Path, tuple[Scalar, Term]]


Claims = Callable[[Call], Iterator[tuple[str, Term]]]
"""In words, and what has to hold."""


Needs = Callable[[Machine, State, Mapping[str, Typed]], Iterator[tuple[str, Term]]]
"""What a caller has to see to, of the arguments."""


def of_function(program: Program, function: Function, prefix: str) -> list[Claims]:
    """All claims of a public function."""
    name = function.name.removeprefix(f"{prefix}_")
    claims: list[Claims] = []
    if not any(each in function.name for each in NOT_FINITE):
        claims.append(_finite)
    if name == "controller_step":
        claims += [_command_bounded, _status_of(program, function)]
    elif name == "limiter_step":
        claims += [_angle_bounded, _rate_bounded(program, function)]
    elif name == "e2e_protect":
        claims.append(_counter_sent)
    elif name.endswith("_not_available"):
        claims.append(_not_a_number)
    return claims


def needs_of(function: Function, prefix: str) -> list[Needs]:
    """What a caller of a public function has to see to beside the types of its arguments."""
    return [_finite_or_absent] if function.name.startswith(f"{prefix}_can_pack_") else []


def _finite_or_absent(machine: Machine, state: State, arguments: Mapping[str, Typed]) -> Iterator[tuple[str, Term]]:
    """Of the signals of a frame: a number, or NaN for what is not available."""
    signals = arguments["signals"].reference
    assert isinstance(signals.ctype, Struct)
    for name, scalar in signals.ctype.fields:
        if isinstance(scalar, Scalar) and scalar.family == Family.FLOAT:
            term = machine.read(state, machine.field(signals, name, None), None).term
            absent = machine.pool.not_(machine.pool.is_number(term))
            yield f"{name} is finite or not available", machine.pool.or_(absent, machine.pool.is_finite(term))


def _finite(call: Call) -> Iterator[tuple[str, Term]]:
    for path, (scalar, term) in call.results.items():
        if scalar.family == Family.FLOAT:
            yield f"{_name(path)} is finite", call.pool.is_finite(term)


def _name(path: Path) -> str:
    return ".".join(map(str, path)) or "the result"


def _command_bounded(call: Call) -> Iterator[tuple[str, Term]]:
    angle, largest = call.results[("rear_angle",)][1], call.before("parameters", ("rear_angle_max",))
    yield "|rear_angle| is at most rear_angle_max", call.pool.fle(call.pool.magnitude(angle), largest)


def _status_of(program: Program, function: Function) -> Claims:
    """The enumerators that the header names."""
    constants = program.units[function.unit].constants
    values = sorted({value for name, value in constants.items() if "_STATUS_" in name and "_E2E_" not in name})

    def claims(call: Call) -> Iterator[tuple[str, Term]]:
        status = call.results[("status",)][1]
        one_of = [call.pool.eq(status, call.pool.whole(value, status.sort)) for value in values]
        yield "status is one of its enumerators", call.pool.or_(*one_of)

    return claims


def _angle_bounded(call: Call) -> Iterator[tuple[str, Term]]:
    angle, largest = call.results[()][1], call.before("parameters", ("rear_angle_max",))
    yield "|rear angle| is at most rear_angle_max", call.pool.fle(call.pool.magnitude(angle), largest)


def _rate_bounded(program: Program, function: Function) -> Claims:
    """As far as its rate allows, or to the bound that it was beyond."""
    period = program.units[function.unit].objects.get("sampling_time")

    def claims(call: Call) -> Iterator[tuple[str, Term]]:
        pool, angle, before = call.pool, call.results[()][1], call.before("self", ("rear_angle",))
        largest = call.before("parameters", ("rear_angle_max",))
        rate = call.before("parameters", ("rear_rate_max",))
        width = -angle.sort
        if period is None or not hasattr(period.init, "value"):
            return
        time = pool.real(FORMATS[width].round(float(period.init.value.rstrip("fF"))), width)
        step = pool.apply("fmul", angle.sort, rate, time)
        rises = pool.fle(angle, pool.add(before, step))
        falls = pool.fle(pool.sub(before, step), angle)
        yield "it rises by at most rear_rate_max, or to -rear_angle_max", pool.or_(rises, pool.feq(angle, pool.neg(largest)))
        yield "it falls by at most rear_rate_max, or to rear_angle_max", pool.or_(falls, pool.feq(angle, largest))

    return claims


def _counter_sent(call: Call) -> Iterator[tuple[str, Term]]:
    pool = call.pool
    nibble = pool.apply("band", 8, call.behind("data", (1,)), pool.whole(0x0F, 8))
    most = pool.whole(E2E_COUNTER_MAX, 8)
    yield "the counter for the next frame is at most 14", pool.apply("ule", TRUTH, call.behind("counter", ()), most)
    was_in_range = pool.apply("ule", TRUTH, call.before("counter", ()), most)
    yield (
        "the counter in the frame is at most 14 where it was",
        pool.or_(pool.not_(was_in_range), pool.apply("ule", TRUTH, nibble, most)),
    )


def _not_a_number(call: Call) -> Iterator[tuple[str, Term]]:
    ((_, term),) = call.results.values()
    yield "it is NaN", call.pool.not_(call.pool.is_number(term))

"""What is shown of which function, beside that nothing undefined happens in it.

A claim speaks of the arguments of a call, of what they point to behind it, and of its result. The same claim is shown where the
function is proven, and may be taken where it is called.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from codegen.emit.laws import REAR_ANGLE_MAX_RAD, SAMPLE_RANGES, YAW_RATE_ERROR_MAX_RAD_S
from codegen.verify.proof.angles import commanded, limited, limiter_started, ruled
from codegen.verify.proof.boxes import Box, Real
from codegen.verify.proof.c_types import Family, Scalar, Struct
from codegen.verify.proof.calls import Call, Claims
from codegen.verify.proof.invariants import Path, in_words, within
from codegen.verify.proof.machine import Machine
from codegen.verify.proof.memory import State, Typed
from codegen.verify.proof.source import Function, ParsedProgram
from codegen.verify.proof.terms import BOOL as TRUTH
from codegen.verify.proof.terms import Term

E2E_COUNTER_MAX = 14
"""AUTOSAR E2E profile 1: 15 is never sent."""
NOT_FINITE = ("_not_available", "_unpack_", "_dynamics_")
"""In names of functions whose floats may be something else: NaN for what is not available; the dynamics take and give any."""


Needs = Callable[[Machine, State, Mapping[str, Typed]], Iterator[tuple[str, Term]]]
"""What a caller has to see to, of the arguments."""


CLAIMED = ("controller_step", "law_step", "limiter_init", "limiter_step", "e2e_protect", "can_not_available")
"""Functions, without the prefix, of which something is claimed by name."""


def of_function(program: ParsedProgram, function: Function, prefix: str, sampling_time: float) -> list[Claims]:
    """All claims of a public function. sampling_time: s between two steps."""
    name = function.name.removeprefix(f"{prefix}_")
    claims: list[Claims] = []
    if not any(each in function.name for each in NOT_FINITE):
        claims.append(_finite)
    if name == "controller_step":
        claims += [commanded(program, function, sampling_time), _status_of(program, function)]
    elif name == "law_step":
        claims.append(ruled(sampling_time))
    elif name == "limiter_init":
        claims.append(limiter_started)
    elif name == "limiter_step":
        claims.append(limited(sampling_time))
    elif name == "e2e_protect":
        claims.append(_counter_sent)
    elif name == "can_not_available":
        claims.append(_not_a_number)
    return claims


REFERENCE_MAX_RAD_S = 1000.0
"""Bound on the yaw-rate reference that the grip learns from: far above that of any law."""

PRECONDITIONS: Mapping[str, Mapping[tuple[str, Path], Box]] = {
    "law_init": {("rear_angle", ()): Real(-REAR_ANGLE_MAX_RAD, REAR_ANGLE_MAX_RAD, False)},
    "law_step": {
        **{("sample", (name,)): Real(*range_, False) for name, range_ in SAMPLE_RANGES.items()},
        ("rear_angle", ()): Real(-REAR_ANGLE_MAX_RAD, REAR_ANGLE_MAX_RAD, False),
        ("yaw_rate_error", ()): Real(-YAW_RATE_ERROR_MAX_RAD_S, YAW_RATE_ERROR_MAX_RAD_S, False),
    },
    "grip_update": {
        **{(name, ()): Real(*SAMPLE_RANGES[name], False) for name in ("speed", "yaw_rate")},
        ("yaw_rate_reference", ()): Real(-REFERENCE_MAX_RAD_S, REFERENCE_MAX_RAD_S, False),
    },
}
"""Ranges that functions, without the prefix, require of their arguments, as their headers say.

By parameter, and by the field of what it points to. They are assumed where the function is proven, and are an obligation where
it is called.
"""


def preconditions_of(
    function: Function, prefix: str, machine: Machine, state: State, arguments: Mapping[str, Typed]
) -> Iterator[tuple[str, Term, Box]]:
    """What a function requires of its arguments: in words, the number, and its range."""
    for (name, path), box in PRECONDITIONS.get(function.name.removeprefix(f"{prefix}_"), {}).items():
        argument = arguments[name]
        if path:
            argument = machine.read(state, machine.field(argument.reference, str(path[0]), None), None)
        yield in_words((name, *path), box), argument.term, box


def needs_of(function: Function, prefix: str) -> list[Needs]:
    """What a caller of a public function has to see to beside the types of its arguments."""

    def in_range(machine: Machine, state: State, arguments: Mapping[str, Typed]) -> Iterator[tuple[str, Term]]:
        for text, term, box in preconditions_of(function, prefix, machine, state, arguments):
            yield text, within(machine.pool, term, box)

    return [in_range, _finite_or_absent] if function.name.startswith(f"{prefix}_can_pack_") else [in_range]


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


def _status_of(program: ParsedProgram, function: Function) -> Claims:
    """The enumerators that the header names."""
    constants = program.units[function.unit].constants
    values = sorted({value for name, value in constants.items() if "_STATUS_" in name and "_E2E_" not in name})

    def claims(call: Call) -> Iterator[tuple[str, Term]]:
        status = call.results[("status",)][1]
        one_of = [call.pool.eq(status, call.pool.whole(value, status.sort)) for value in values]
        yield "status is one of its enumerators", call.pool.or_(*one_of)

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

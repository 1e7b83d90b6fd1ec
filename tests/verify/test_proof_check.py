"""Check `proof`: a build is proved; faults and C that cannot be judged are rejected.

tests/evidence/verify proves whole builds of every kind.
"""

import re

import pytest

from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.proof import claims
from codegen.verify.proof.check import check
from codegen.verify.proof.executor import Executor
from codegen.verify.proof.session import Session
from codegen.verify.proof.solver import Answer
from codegen.verify.proof.source import CannotJudge, ParsedProgram, Unit
from tests.verify import builds

PI = builds.made("pi", "uneven")
UNITS = ("ars_checksum", "ars_e2e", "ars_map", "ars_calibration")
"""Units that are proved in a second; the limiter and the controller take minutes."""
ROW = "yaw_rate_table[ARS_MAP_SPEED_POINTS][ARS_MAP_FRONT_ANGLE_POINTS] = {\n    /* 0 km/h */\n    {\n        "
COUNTER = "*counter = (*counter < counter_max) ? (uint8_t)(*counter + 1u) : 0u;"
FAULTS = {
    ("ars_e2e", COUNTER, "*counter = (uint8_t)(*counter + 1u);"): (
        r"src/ars_e2e\.c:\d+: ars_e2e_protect: counterexample: claim: the counter for the next frame is at most 14; with "
    ),
    ("ars_calibration", f"{ROW}0.0f", f"{ROW}11.0f"): r"yaw_rate_table: numbers from 0 to 11, the proof is for 0 to 10",
}


def checked(*changes: tuple[str, str, str]) -> Outcome:
    """Return the outcome for some units with texts replaced: unit, old, new."""
    files = {path: text for path, text in PI.files.items() if path.startswith("include/") or path[4:-2] in UNITS}
    for name, old, new in changes:
        files[f"src/{name}.c"] = builds.with_text(PI, f"src/{name}.c", old, new)[f"src/{name}.c"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(claims, "CLAIMED", ("e2e_protect",))
        return check(Subject("sample", files, PI.manifest), Effort())


def test_units_are_proved() -> None:
    outcome = checked()
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    kinds = outcome.figures["obligations"]
    assert kinds.keys() >= {"claim", "invariant", "index inside its array", "no division by zero"}
    assert outcome.figure == f"{sum(kinds.values())} of {sum(kinds.values())} obligations proved"
    assert outcome.figures["invariants"]["ars_e2e_receiver_t"]


def test_faults_are_not_proved_and_nothing_else_is_found() -> None:
    outcome = checked(*FAULTS)
    assert outcome.verdict is Verdict.FAILED
    for finding in FAULTS.values():
        assert any(re.match(finding, each) for each in outcome.findings), (finding, outcome.findings)
    assert all(re.match(r"src/ars_e2e\.c:|yaw_rate_table: ", each) for each in outcome.findings)


TYPES = """
typedef unsigned char uint8_t;
typedef signed char int8_t;
typedef unsigned short uint16_t;
typedef int int32_t;
typedef unsigned int uint32_t;
typedef _Bool bool;
"""


def proof_failures(body: str) -> str:
    """Judge one unit of C like a build, and return everything that prevents a proof."""
    try:
        program = ParsedProgram({"x.c": Unit.parse("x.c", TYPES + body)})
        report = Session(Executor(program, {}), "ars", 0.01).run()
    except CannotJudge as error:
        return f"{error.place}: cannot be judged: {error.what}"
    open_ones = [verdict.obligation for _, verdict in report.verdicts if verdict.answer is not Answer.PROVED]
    return "\n".join([*report.troubles, *(f"{each.kind}: {each.text}" for each in open_ones)])


TABLE = "static const uint8_t table[4] = {1u, 2u, 3u, 4u};"
SHORT = {"PROBE": f"uint32_t ars_probe(uint32_t x) {{ {TABLE}", "TABLE": TABLE}
"""Text shared by several cases."""


def cases(text: str) -> dict[str, tuple[str, str]]:
    """Return C and expected message by the name of the case, from text with "// name: message" before each C."""
    found = {}
    for each in text.strip().removeprefix("// ").split("\n// "):
        head, _, body = each.partition("\n")
        name, _, message = head.partition(": ")
        for word, long in SHORT.items():
            body = body.replace(word, long)
        found[name] = (body, message)
    return found


REFUSED = cases("""
// a bound that a turn changes: changes its bound
uint32_t ars_probe(uint32_t x) { uint8_t t[50]; uint32_t n = 50u; uint32_t i; for (i = 0u; i < 50u; i++) { t[i] = 0u; }
for (i = 0u; i < n; i++) { n = 60u; t[i] = (uint8_t)i; } return x; }
// const cast away: a cast to a pointer
uint32_t ars_helper(const uint32_t *p) { *(uint32_t *)p = 4000000u; return 0u; } PROBE uint32_t k = x & 3u;
(void)ars_helper(&k); return table[k]; }
// const of a pointer, not of what it leads to: index inside its array
typedef uint32_t *word_t; uint32_t ars_helper(const word_t p) { *p = 4000000u; return 0u; } PROBE uint32_t k = x & 3u;
(void)ars_helper(&k); return table[k]; }
// arguments that overlap: may overlap
uint32_t ars_helper(uint32_t *a, const uint32_t *b) { uint32_t r = 0u; TABLE if (*b < 4u) { *a = 9u; r = table[*b]; }
return r; } uint32_t ars_probe(uint32_t x) { uint32_t k = x; return ars_helper(&k, &k); }
// a part of an array: a part of one
void ars_pack_it(uint8_t d[8]) { uint32_t i; for (i = 0u; i < 8u; i++) { d[i] = 9u; } } uint32_t ars_probe(uint32_t x) {
TABLE uint8_t b[16] = {0u}; ars_pack_it(&b[8]); return table[b[8]] + x; }
// one of several structs: one of several elements
typedef struct { uint32_t k; } s_t; void ars_set(s_t *s) { s->k = 9u; } PROBE s_t s[2] = { { 0u }, { 0u } };
ars_set(&s[x & 1u]); return table[s[0].k]; }
// volatile: volatile
static const volatile uint32_t limit_of = 3u; PROBE return (x <= limit_of) ? table[x] : 0u; }
// a label that the promoted number has: index inside its array
uint32_t ars_probe(uint8_t x) { TABLE uint32_t k = 0u; switch (x) { case 256: k = 0u; break; default: k = (x == 0u) ? 9u : 1u;
break; } return table[k]; }
// side effects in operands: inside an expression
PROBE uint32_t k = x & 3u; k = k++ + 0u; return table[k]; }
// an assignment to the index of its left side: C leaves open
uint32_t ars_probe(uint32_t x) { uint32_t t[4] = {0u}; uint32_t i = 0u; t[i] = i = 3u; return t[0] + x; }
// a call that changes what another operand reads: C leaves open
static uint32_t next(uint32_t *k) { *k = *k + 1u; return *k; } PROBE uint32_t k = x & 1u; return next(&k) + k; }
// a number as an enum: between its enumerators
typedef enum { A = 0, B = 3 } e_t; uint32_t ars_probe(uint32_t x) { const e_t s = (e_t)x; return (uint32_t)s; }
// an octal number: index inside its array
PROBE return table[(x == 0u) ? 010 : 0]; }
// an initialiser that leaves something out: b is written
typedef struct { uint32_t a; uint32_t b; } s_t;
void ars_s_init(s_t *self) { self->a = 0u; } uint32_t ars_s_step(s_t *self) { return self->b; }
// what nobody thought of: cannot be judged
uint32_t ars_probe(const uint32_t *p) { return p ? 1u : 0u; }
// a conversion into too few bits: conversion defined
uint32_t ars_probe(float x) { TABLE float rest = 0.0f; if ((x >= 0.0f) && (x < 1000.0f)) { const uint8_t whole = (uint8_t)x;
rest = x - (float)whole; } return table[(rest > 1.5f) ? 4000u : 0u]; }
// a last cell below zero: index inside its array
uint32_t ars_probe(float x) { TABLE uint32_t result = 0u; if ((x >= 0.0f) && (x < 100.0f)) {
const int32_t whole = (x >= 10.0f) ? -1 : (int32_t)x; const float rest = x - (float)whole;
result = table[(rest > 1.5f) ? 4000u : 0u]; } return result; }
// a mask that leaves the sign: index inside its array
uint32_t ars_probe(float x) { TABLE union { float value; uint32_t bits; } number = { .value = x }; number.bits &= 0xFFFFFFFEu;
return table[(number.value < 0.0f) ? 9u : 1u]; }
// what is written before a break: index inside its array
PROBE uint32_t k = 0u; uint32_t i; for (i = 1u; i < 4u; i++) { if (x < i) { k = (x == 2u) ? 9u : i; break; } }
return table[k]; }
// a name that a case declares
PROBE uint32_t k = 9u; switch (x) { case 1u: ; uint32_t k = 0u; k = 1u; break; default: break; } return table[k]; }
""")


@pytest.mark.parametrize(("body", "message"), REFUSED.values(), ids=REFUSED)
def test_it_is_not_proved(body: str, message: str) -> None:
    found = proof_failures(body)
    assert found
    assert message in found


PROVED = cases("""
// the bits without the sign: the magnitude
uint32_t ars_probe(float x) { TABLE union { float value; uint32_t bits; } number = { .value = x }; number.bits &= 0x7FFFFFFFu;
return table[(number.value < 0.0f) ? 9u : 1u]; }
// a loop that is left at its cell: each way has its own value
PROBE uint32_t k = 0u; uint32_t i; for (i = 1u; i < 4u; i++) { if (x < i) { break; } k = i; } return table[k]; }
""")


@pytest.mark.parametrize("body", [body for body, _ in PROVED.values()], ids=PROVED)
def test_it_is_proved(body: str) -> None:
    assert proof_failures(body) == ""


# A contract never proves the preconditions of its call.

LIMITER = """
typedef struct { float rear_angle_max; float rear_rate_max; } ars_limiter_parameters_t;
typedef struct { float rear_angle; } ars_limiter_t;
bool ars_limiter_parameters_valid(const ars_limiter_parameters_t *parameters) { return parameters->rear_angle_max >= 0.0f; }
void ars_limiter_init(ars_limiter_t *self, float rear_angle) { self->rear_angle = (rear_angle > 0.5f) ? 0.5f : -0.5f; }
float ars_limiter_step(ars_limiter_t *self, const ars_limiter_parameters_t *parameters, float demand)
{
    const bool fits = (demand >= -0.5f) && (demand <= 0.5f) && (demand <= parameters->rear_angle_max);
    self->rear_angle = (fits && (-demand <= parameters->rear_angle_max)) ? demand : 0.0f;
    return self->rear_angle;
}
"""
PROBE = (
    "float ars_probe(float x) { ars_limiter_t s; ars_limiter_parameters_t p; p.rear_rate_max = 1.0f; %s "
    "return ars_limiter_step(&s, &p, 0.1f); }"
)
RIGHT = "p.rear_angle_max = 0.5f; ars_limiter_init(&s, 0.0f);"


PRECONDITIONS = {
    # The limiter ensures |result| <= rear_angle_max, which no number satisfies for a negative limit.
    "the parameters are valid": "p.rear_angle_max = x; ars_limiter_init(&s, 0.0f);",
    # It also ensures that the result is near its last angle, which no number satisfies for NaN.
    "rear_angle is ": f"{RIGHT} s.rear_angle = ((x > 0.5f) || (x < -0.5f)) ? 0.0f : x;",
}


@pytest.mark.parametrize(("need", "call"), PRECONDITIONS.items(), ids=("parameters", "a state"))
def test_the_contract_of_a_call_does_not_prove_its_preconditions(need: str, call: str) -> None:
    assert need in proof_failures(LIMITER + PROBE % call)
    assert need not in proof_failures(LIMITER + PROBE % RIGHT)


def test_a_missing_parameter_is_reported() -> None:
    assert "limited: what it is about is not there: " in proof_failures(LIMITER)

"""Soundness of the prover: small C texts that it proves or refuses, and facts that are never false."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest

from codegen.verify.proof import boxes, solver
from codegen.verify.proof.boxes import Real
from codegen.verify.proof.concrete import computed
from codegen.verify.proof.encode import Encoder
from codegen.verify.proof.executor import Executor
from codegen.verify.proof.facts import Bounded, Fact, Facts
from codegen.verify.proof.floats import FORMATS
from codegen.verify.proof.ranges import Scope
from codegen.verify.proof.refine import refinements
from codegen.verify.proof.semantics import Value, signed
from codegen.verify.proof.session import Session
from codegen.verify.proof.solver import Answer
from codegen.verify.proof.source import CannotJudge, Program, Unit
from codegen.verify.proof.terms import BOOL, Pool, Term, inside

TYPES = """
typedef unsigned char uint8_t;
typedef signed char int8_t;
typedef unsigned short uint16_t;
typedef int int32_t;
typedef unsigned int uint32_t;
typedef _Bool bool;
"""


@dataclass(frozen=True)
class Judged:
    """The outcome of a proof: whether everything is proved, and the obligations and troubles that are not."""

    is_proved: bool
    text: str


def judged(body: str) -> Judged:
    """Judge one unit of C as a build is judged."""
    try:
        program = Program({"x.c": Unit.parse("x.c", TYPES + body)})
        report = Session(Executor(program, {}), "ars", 0.01).run()
    except CannotJudge as error:
        return Judged(False, f"{error.place}: cannot be judged: {error.what}")
    obligations = [verdict.obligation for _, verdict in report.verdicts if verdict.answer is not Answer.PROVED]
    broken = [f"{each.kind}: {each.text}" for each in obligations]
    return Judged(not broken and not report.troubles, "\n".join([*report.troubles, *broken]))


TABLE = "static const uint8_t table[4] = {1u, 2u, 3u, 4u};"
SHORT = {
    "PROBE": f"uint32_t ars_probe(uint32_t x) {{ {TABLE}",
    "TABLE": TABLE,
    "NEXT": "static uint32_t next(uint32_t *k) { *k = *k + 1u; return *k; }",
    "ENUM": "typedef enum { A = 0, B = 3 } e_t;",
    "PAIR": "typedef struct { uint32_t a; uint32_t b; } s_t;",
}
"""Text that several cases have in common."""


def cases(text: str) -> dict[str, tuple[str, str]]:
    """Return C and expected message by the name of the case; the text has them as "// name: message", then C."""
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
// a counter that is narrower than its bound: of more than 40 turns
uint32_t ars_probe(uint32_t x) { uint8_t t[50] = {0u}; const uint32_t n = 300u; uint8_t i; for (i = 0u; i < n; i++) {
t[i] = 1u; } return x; }
// bits by a cast of a pointer: a cast to a pointer
uint32_t ars_probe(float x) { TABLE const float y = x; return table[*(const uint32_t *)&y]; }
// a pointer to another type: pointers to different types
static uint32_t of(const uint32_t *p) { return *p; } uint32_t ars_probe(float x) { const float y = x; return of(&y); }
// const cast away: a cast to a pointer
uint32_t ars_helper(const uint32_t *p) { *(uint32_t *)p = 4000000u; return 0u; } PROBE uint32_t k = x & 3u;
(void)ars_helper(&k); return table[k]; }
// const of a pointer, not of what it leads to: index inside its array
typedef uint32_t *word_t; uint32_t ars_helper(const word_t p) { *p = 4000000u; return 0u; } PROBE uint32_t k = x & 3u;
(void)ars_helper(&k); return table[k]; }
// const that is written: writes what it is given as constant
uint32_t ars_helper(const uint32_t *p) { *p = 4000000u; return 0u; }
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
// an assignment in an operand: Assignment
PROBE uint32_t k = 0u; k = x + (k = 1u); return table[k & 3u]; }
// an assignment to the index of its left side: C leaves open
uint32_t ars_probe(uint32_t x) { uint32_t t[4] = {0u}; uint32_t i = 0u; t[i] = i = 3u; return t[0] + x; }
// a call that changes what another operand reads: C leaves open
NEXT PROBE uint32_t k = x & 1u; return next(&k) + k; }
// a call that changes what is added to: C leaves open
NEXT PROBE uint32_t k = x & 1u; k += next(&k); return k; }
// a number as an enum: between its enumerators
ENUM uint32_t ars_probe(uint32_t x) { const e_t s = (e_t)x; return (uint32_t)s; }
// arithmetic with an enum: of an enum
ENUM int32_t ars_probe(bool b) { const e_t s = b ? A : B; return s - 1; }
// an octal number: index inside its array
PROBE return table[(x == 0u) ? 010 : 0]; }
// an initialiser that leaves something out: b is written
PAIR void ars_s_init(s_t *self) { self->a = 0u; } uint32_t ars_s_step(s_t *self) { return self->b; }
// a result of which something is left out: b of the result is written
PAIR s_t ars_probe(uint32_t x) { s_t s; s.a = x; return s; }
// what nobody thought of: cannot be judged
uint32_t ars_probe(const uint32_t *p) { return p ? 1u : 0u; }
// a conversion into too few bits: conversion defined
uint32_t ars_probe(float x) { TABLE float rest = 0.0f; if ((x >= 0.0f) && (x < 1000.0f)) { const uint8_t whole = (uint8_t)x;
rest = x - (float)whole; } return table[(rest > 1.5f) ? 4000u : 0u]; }
// a last cell below zero: index inside its array
uint32_t ars_probe(float x) { TABLE uint32_t result = 0u; if ((x >= 0.0f) && (x < 100.0f)) {
const int32_t whole = (x >= 10.0f) ? -1 : (int32_t)x; const float rest = x - (float)whole;
result = table[(rest > 1.5f) ? 4000u : 0u]; } return result; }
// a whole number of 64 bits as a float: as a float
float ars_probe(unsigned long long x) { return (float)x; }
// a name that a case declares
PROBE uint32_t k = 9u; switch (x) { case 1u: ; uint32_t k = 0u; k = 1u; break; default: break; } return table[k]; }
// a branch that a comparison does not decide: division
void ars_part(int32_t n, int32_t *out) { int32_t share = 0; if (n > 5) { if (n > 7) { share = 10 / n; } else {
share = 10 / (n - n); } } *out = share; }
""")

ACCEPTED = cases("""
// a branch that a comparison decides
void ars_part(int32_t n, int32_t *out) { int32_t share = 0; if (n > 5) { if (n > 3) { share = 10 / n; } else {
share = 10 / (n - n); } } *out = share; }
// chained assignments
uint32_t ars_probe(uint32_t x) { uint32_t a; uint32_t b; a = b = x & 3u; TABLE return table[a & b]; }
// a call that changes what no other operand reads
NEXT static uint32_t of(const uint32_t *k) { return *k; } uint32_t ars_probe(uint32_t x) { uint32_t k = x; uint32_t m = 1u;
return next(&k) | of(&m); }
// enums among their like
ENUM uint32_t ars_probe(bool b) { const e_t s = b ? A : B; TABLE return (s < B) ? 0u : table[s]; }
// a long loop
uint32_t ars_probe(uint32_t x) { uint8_t t[200]; uint32_t i; for (i = 0u; i < 200u; i++) { t[i] = (uint8_t)x; } return x; }
// a contract
uint32_t ars_helper(const uint32_t *p) { return *p & 3u; } uint32_t ars_probe(uint32_t x) { uint32_t k = x;
TABLE return table[ars_helper(&k)]; }
""")


@pytest.mark.parametrize(("body", "message"), REFUSED.values(), ids=REFUSED)
def test_it_is_not_proved(body: str, message: str) -> None:
    found = judged(body)
    assert not found.is_proved
    assert message in found.text


@pytest.mark.parametrize("body", [body for body, _ in ACCEPTED.values()], ids=ACCEPTED)
def test_it_is_proved(body: str) -> None:
    found = judged(body)
    assert found.is_proved, found.text


def test_a_float_literal_is_rounded_once() -> None:
    # Just above the middle of 1 and the next single; a double has only the middle, which goes to the even 1.
    unit = Unit.parse("x.c", "static const float x = 1.00000005960464477540f;")
    machine = Executor(Program({"x.c": unit}), {})
    machine.global_object("x.c", "x", None)
    value = machine.constant_at("x.c:x", ())
    assert isinstance(value, Term)
    assert value.data == 1.0 + 2.0**-23


# A contract never shows what a call needs.

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


@pytest.mark.parametrize(
    ("call", "need"),
    [
        # The limiter ensures |result| <= rear_angle_max, which no number fulfils for a limit below zero.
        pytest.param("p.rear_angle_max = x; ars_limiter_init(&s, 0.0f);", "the parameters are valid", id="parameters"),
        # It also ensures that the result is near its last angle, which no number fulfils for NaN.
        pytest.param(
            "p.rear_angle_max = 0.5f; ars_limiter_init(&s, 0.0f); s.rear_angle = ((x > 0.5f) || (x < -0.5f)) ? 0.0f : x;",
            "rear_angle is ",
            id="a state",
        ),
    ],
)
def test_the_contract_of_a_call_does_not_show_its_preconditions(call: str, need: str) -> None:
    probe = (
        "float ars_probe(float x) {{ ars_limiter_t s; ars_limiter_parameters_t p; p.rear_rate_max = 1.0f; {} "
        "return ars_limiter_step(&s, &p, 0.1f); }}"
    )
    assert need in judged(LIMITER + probe.format(call)).text
    right = probe.format("p.rear_angle_max = 0.5f; ars_limiter_init(&s, 0.0f);")
    assert need not in judged(LIMITER + right).text


def test_a_missing_parameter_is_reported() -> None:
    assert "limited: what it is about is not there: " in judged(LIMITER).text


# No fact is false, whatever numbers it is about.

SPECIAL = (
    0.0,
    -0.0,
    1.0,
    -1.0,
    math.inf,
    -math.inf,
    math.nan,
    1e-45,
    -1e-45,
    3e38,
    -3e38,
    255.0,
    256.0,
    300.0,
    65536.0,
    2.0**31,
)
SPECIAL_WIDE = (*SPECIAL, 2.0**24, 2.0**24 - 1.0, 2.0**32, 0.5, 1e-30, 9.0)


class Made:
    """Terms at random, and numbers for their variables."""

    def __init__(self, seed: int) -> None:
        self.random, self.pool = random.Random(seed), Pool()
        self.floats = [self.pool.variable(f"x{k}", -32) for k in range(4)]
        self.wholes = [self.pool.variable(f"n{width}{k}", width) for width in (8, 16, 32) for k in range(2)]
        self.truths: list[Term] = []
        self.shares: list[tuple[Term, Term]] = []
        for _ in range(self.random.randrange(4, 14)):
            self._grow()

    def _grow(self) -> None:
        choose, pool = self.random.choice, self.pool
        x, y = choose(self.floats), choose(self.floats)
        width, is_signed = choose((8, 16, 32)), choose((True, False))
        whole = pool.apply("of_real", width, x, data=is_signed)
        cut = pool.ite(pool.fle(pool.real(9.0, 32), x), pool.whole(choose((-1, 9, 255)), width), whole)
        share = choose(self.floats)
        makers: list[Callable[[], Term]] = [
            lambda: pool.add(x, y),
            lambda: pool.sub(x, y),
            lambda: pool.apply("fmul", -32, x, choose([y, pool.real(choose((0.01, 4097.0, 1e-20, 3e38)), 32)])),
            lambda: pool.apply("fdiv", -32, x, y),
            lambda: pool.apply("fdiv", -32, x, pool.add(x, y)),
            lambda: pool.apply("fdiv", -32, pool.sub(x, share), pool.sub(y, share)),
            lambda: pool.apply("fdiv", -32, pool.sub(x, share), pool.sub(y, choose(self.floats))),
            lambda: pool.add(x, pool.apply("fmul", -32, share, pool.sub(y, x))),
            lambda: pool.sub(x, pool.apply("fmul", -32, share, x)),
            lambda: pool.sub(x, pool.apply("of_whole", -32, choose((whole, cut)), data=choose((True, False)))),
            lambda: pool.magnitude(x),
            lambda: pool.apply("of_whole", -32, choose(self.wholes), data=is_signed),
        ]
        made = choose(makers)()
        if made.op == "fdiv" and made.args[1].op == "fadd" and made.args[0] is not made.args[1]:
            self.shares.append((made, pool.fle(x, y)))
        if made.op == "fdiv":  # what a quotient below a factor asks for
            self.truths.append(pool.flt(made.args[0], pool.apply("fmul", -32, made.args[1], choose(self.floats))))
        self.floats.append(made)
        self.wholes += [whole, cut, choose(self.wholes)]
        self.truths += [pool.flt(x, y), pool.fle(x, y), pool.fle(pool.real(choose((0.0, 1.0, 9.0, -2.5)), 32), x)]
        n, m = choose(self.wholes), choose(self.wholes)
        if n.sort == m.sort:
            self.wholes.append(pool.apply(choose(("add", "sub", "mul", "band", "bor", "bxor")), n.sort, n, m))
            self.truths.append(pool.apply(choose(("ult", "ule", "slt", "sle", "eq")), 0, n, m))
        self.wholes.append(pool.wider(n, choose((8, 16, 32)), is_signed))

    def inputs(self) -> dict[Term, Value]:
        choose, rounded = self.random.choice, FORMATS[32].round
        found: dict[Term, Value] = {}
        for term in (*self.floats, *self.wholes):
            if term.op == "var" and term.sort < 0:
                numbers = (choose(SPECIAL_WIDE), self.random.uniform(-12.0, 12.0), 10.0 ** self.random.uniform(-44.0, 38.0))
                found[term] = rounded(choose(numbers))
            elif term.op == "var":
                found[term] = choose((0, 1, self.random.getrandbits(term.sort), 1 << (term.sort - 1)))
        return found


def learned(made: Made) -> Facts:
    """All that is found out while terms are looked at, narrowed and taken to hold."""
    facts, choose = Facts(), made.random.choice
    scope = Scope(made.pool, facts)
    for _ in range(12):
        trial = scope.fork()
        for share, order in made.shares:
            if choose((True, False)):
                trial.assume(order, choose((True, False)))
                trial.narrow(share.args[1], Real(0.0, math.inf, False))
        for x in made.random.sample(made.floats, 3):
            low = choose((0.0, -1.0, 0.25, -20.0))
            trial.narrow(x, Real(low, low + choose((1.0, 0.5, 30.0, 1000.0)), False))
        for term in made.random.sample(made.truths, min(3, len(made.truths))):
            trial.assume(term, choose((True, False)))
        for n in made.random.sample(made.wholes, 3):
            high = choose((0, 1, 9, 99, 255))
            trial.narrow(n, boxes.unsigned(choose((0, 1)), min(high, (1 << n.sort) - 1), n.sort))
        for term in (*made.floats, *made.wholes, *made.truths):
            trial.box(term)
    return facts


def lies(bounded: Bounded, values: dict[Term, Value]) -> bool:
    value = values[bounded.term]
    if bounded.term.sort > 0 and bounded.signed:
        value = signed(value, bounded.term.sort)
    return bounded.low <= value <= bounded.high


def is_false(fact: Fact, values: dict[Term, Value]) -> bool:
    if not all(values[each] for each in fact.conditions) or not all(lies(each, values) for each in fact.premises):
        return False
    conclusion = values[fact.conclusion.term]
    return conclusion == conclusion and not lies(fact.conclusion, values)


def named(fact: Fact) -> Iterator[Term]:
    yield from fact.conditions
    yield from (each.term for each in (*fact.premises, fact.conclusion))


@pytest.mark.parametrize("seed", range(12))
def test_no_fact_is_false(seed: int) -> None:
    made = Made(seed)
    kept = learned(made)
    facts = [fact for term in inside([*made.floats, *made.wholes, *made.truths]) for fact in kept.about(term)]
    assert facts
    terms = {term for fact in facts for term in named(fact)}
    for number in range(200):
        inputs = made.inputs()
        if number % 2:  # at the corner of some fact
            for bounded in made.random.choice(facts).premises:
                end = made.random.choice((bounded.low, bounded.high))
                if bounded.term in inputs and bounded.term.sort < 0 and math.isfinite(end):
                    inputs[bounded.term] = end
        values = computed(terms, inputs)
        false = [fact for fact in facts if is_false(fact, values)]
        assert not false, (false[0], [(term, values[term]) for term in inside(named(false[0]))])


@pytest.mark.parametrize("seed", range(12))
def test_no_refinement_is_false(seed: int) -> None:
    made = Made(seed)
    cone = inside([*made.floats, *made.wholes])
    for _ in range(20):
        inputs = made.inputs()
        believed = computed(cone, inputs)
        for term in cone:  # what z3 might believe instead; when a result is NaN it knows
            if term.op in ("fadd", "fmul", "fdiv", "of_whole") and believed[term] == believed[term]:
                believed[term] = made.random.choice((0.0, 1.0, -7.0, 1e30, believed[term]))
            elif term.op == "of_real":
                believed[term] = made.random.choice((0, 1, believed[term]))
        facts = refinements(cone, believed, inputs)
        for _ in range(10):
            values = computed([*cone, *(term for fact in facts for term in named(fact))], made.inputs())
            false = [fact for fact in facts if is_false(fact, values)]
            assert not false, (false[0], [(term, values[term]) for term in inside(named(false[0]))])


def test_assumptions_that_share_no_input_with_a_goal_are_left_out() -> None:
    """Also by way of others, and of facts; all others stay, for they may be what the goal rests on."""
    pool = Pool()
    a, b, c, d = (pool.variable(name, 32) for name in "abcd")
    ten = pool.whole(10, 32)
    of_a, of_b_and_c, of_c, of_d = (pool.apply("ult", BOOL, *pair) for pair in ((a, ten), (b, c), (c, ten), (d, ten)))
    facts = Facts()
    facts.add(Fact((Bounded(d, 0.0, 9.0),), Bounded(a, 0.0, 9.0)))
    prover = solver.Prover(pool, Encoder(facts))
    together = pool.and_(of_a, pool.and_(of_b_and_c, of_c))
    assert prover.about([together, of_d], [pool.apply("ult", BOOL, b, ten)]) == [of_b_and_c, of_c]
    assert prover.about([together, of_d], [pool.apply("ult", BOOL, a, ten)]) == [of_a, of_d]

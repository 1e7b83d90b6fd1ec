"""Contracts in ACSL: each condition states what the C condition computes, and none is left out without a reason."""

import re

import pytest

from codegen.configuration import Kind
from codegen.emit.contracts.acsl import Conditions, NotExpressibleError, Translation
from codegen.emit.text import Precision
from tests.emit.rendered import EACH_KIND_AND_DOUBLE, rendered

HEADERS = """
typedef struct {
    const float *table;
    float angle;    /* rad */
    float steps[4];
    uint8_t counter;
    bool known;
} state_t;
"""
SCOPE = {"self": "state_t", "x": "float", "n": "uint32_t", "k": "integer", "data": "uint8_t", "result": "bool"}
TRANSLATED = {
    "x != x": r"\is_NaN(x)",
    "x == x": r"!\is_NaN(x)",
    "x < 0.5f": r"\lt_float(x, (float)0.5f)",
    "-0.5f <= self->angle": r"\le_float((float)-0.5f, self->angle)",
    "x <= (self->angle + (x * 0.01f))": r"\le_float(x, (float)(self->angle + (float)(x * 0.01f)))",
    "self_before->steps[1] == -x": r"\eq_float(\old(self->steps[1]), (float)(-x))",
    "*self_before->table >= x": r"\ge_float(\old(*self->table), x)",
    "x == (self->known ? 0.0f : self->angle)": (
        r"(self->known != 0 ==> \eq_float(x, (float)0.0f)) && (self->known == 0 ==> \eq_float(x, self->angle))"
    ),
    "!result || (x < x)": r"\result != 0 ==> \lt_float(x, x)",
    "!self->known || (x < x) || (n == 1u)": r"self->known == 0 || \lt_float(x, x) || n == 1u",
    "!((x < x) && self->known)": r"!(\lt_float(x, x) && self->known != 0)",
    "self->known == (self_before->known || lies_within(x, 1.0f))": (
        r"(self->known != 0) <==> (\old(self->known) != 0 || lies_within(x, 1.0f))"
    ),
    "(n - 1u) == 4294967295u": "(uint32_t)(n - 1u) == 4294967295u",
    "((uint32_t)data[1] & 0x0Fu) == ((self->counter + 1u) % 15u)": (
        "((uint32_t)data[1] & 0x0Fu) == ((uint32_t)(self->counter + 1u) % 15u)"
    ),
    "(k == 0u) || (self->steps[k - 1u] < self->steps[k])": r"k == 0u || \lt_float(self->steps[k - 1u], self->steps[k])",
    "magnitude_of(x) <= magnitude_of(self_before->angle)": r"\le_float(magnitude_of(x), magnitude_of(\old(self->angle)))",
    "is_flag(self->known) && ((n == 1u) || (n == 2u))": "is_flag(self->known) && (n == 1u || n == 2u)",
    "lies_within(x, (n == 1u) ? 1.0f : 2.0f)": "(n == 1u ==> lies_within(x, 1.0f)) && (!(n == 1u) ==> lies_within(x, 2.0f))",
    "holds(any_row, n)": r"\forall integer any_row; any_row >= 0 ==> (holds(any_row, n))",
}
REJECTED = {"crc(data) == data[0]": "crc()", "(uint32_t)x == n": "conversion", "other == n": "other"}


def translated(condition: str) -> str:
    translation = Translation("float", HEADERS, {})
    translation.predicates.add("holds")
    return Conditions(translation, SCOPE).translated(condition)


@pytest.mark.parametrize("condition", TRANSLATED)
def test_a_condition_states_what_the_c_computes(condition: str) -> None:
    assert translated(condition) == TRANSLATED[condition]


@pytest.mark.parametrize("condition", REJECTED)
def test_a_condition_without_a_counterpart_is_rejected(condition: str) -> None:
    with pytest.raises(NotExpressibleError, match=re.escape(REJECTED[condition])):
        translated(condition)


@pytest.mark.parametrize(("kind", "precision"), EACH_KIND_AND_DOUBLE)
def test_every_function_has_its_contract_and_only_claims_on_the_crc_are_left_out(kind: Kind, precision: Precision) -> None:
    files = rendered(kind, precision).files
    header, in_c = (files[f"verify/ars_{name}.h"].decode("ascii") for name in ("acsl", "contracts"))
    assert set(re.findall(r"// Left out, since (\w+)", header)) == {"ars_e2e_crc"}
    declared = re.findall(r"^\*/\n\w+ (\w+)\(", header, re.M)
    assert declared == re.findall(r"^static inline void (\w+)_requires\(", in_c, re.M)

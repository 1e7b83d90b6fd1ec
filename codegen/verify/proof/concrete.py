"""Terms computed for inputs that are known: what decides whether an answer of z3 is a counterexample."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from codegen.verify.proof.semantics import Value, compute
from codegen.verify.proof.terms import BOOL, Table, Term, inside


def computed(roots: Iterable[Term], inputs: Mapping[Term, Value]) -> dict[Term, Value]:
    """Every term inside, exactly as the program computes it. An input that is not given is zero."""
    values: dict[Term, Value] = {}
    for term in inside(roots):
        values[term] = value_of(term, [values[each] for each in term.args], inputs)
    return values


def value_of(term: Term, args: list[Value], inputs: Mapping[Term, Value]) -> Value:
    """Of one term from its operands' values."""
    if term.op == "const":
        return term.data  # type: ignore[no-any-return]
    if term.op == "ite":
        return args[1] if args[0] else args[2]
    if term.op == "entry" and isinstance(term.data, Table) and not term.data.is_free:
        found = term.data.at([int(each) for each in args])
        return 0 if found is None else found
    if term.op in ("var", "entry"):
        return inputs.get(term, False if term.sort == BOOL else 0 if term.sort > 0 else 0.0)
    return compute(term.op, term.sort, term.data, [each.sort for each in term.args], args)

"""Proof of the shipped C with z3: for every input, every valid parameter set, every table in range and every reachable state.

The way of a build through it:

- `source` parses the preprocessed units (`c_types` has the types of C);
- `executor` runs a function once for all inputs and keeps what has to hold, as terms (`terms`);
- `ranges` knows between which numbers each term lies and writes down why, as facts that hold by themselves: rounding keeps
  the order;
- `encode` turns terms and facts into z3's bit vectors, where floats are ordered whole numbers; `solver` asks;
- `contracts` proves one function after the other, callees first, and finds what every state keeps; `claims` says what is shown;
- `check` is the check of `codegen verify`.

What is trusted: the parser, the executor, single facts about rounding, the encoding, z3. Not trusted: the search for bounds and
invariants; a wrong one proves nothing.
"""

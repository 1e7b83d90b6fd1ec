"""A contract: the arguments of a function, what it requires of them, and what it ensures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, Self

from codegen.emit.contracts.proof import FOLDER, Proof

Role = Literal["value", "in", "out", "new", "state", "parameter", "bytes in", "bytes out"]
"""Use of an argument.

value: a number. in, out: a struct that is read, or written. new, state: a struct whose invariant holds after the call, or
before and after it. parameter: a struct that is read and whose invariant holds. bytes in, bytes out: a frame.
"""


@dataclass(frozen=True)
class Claim:
    """A condition in C and its meaning in words."""

    text: str
    condition: str

    @property
    def of_objects(self) -> str:
        """The condition where arguments are objects instead of pointers."""
        return self.condition.replace("->", ".")


class Bound(str):
    """A condition that a number is in a range.

    Attributes:
        number: C expression of the number.
    """

    __slots__ = ("number",)
    number: str

    def __new__(cls, condition: str, number: str) -> Self:
        """Return the condition with its number."""
        made = super().__new__(cls, condition)
        made.number = number
        return made


@dataclass(frozen=True)
class Argument:
    """One argument; `ctype` is the type of the number or of the struct, `size` the number of bytes of a frame."""

    name: str
    ctype: str
    role: Role = "value"
    size: int = 8

    @property
    def is_pointer(self) -> bool:
        """Whether the function receives an address."""
        return self.role != "value"

    @property
    def is_written(self) -> bool:
        """Whether the function may write what the argument points to."""
        return self.role in ("out", "new", "state", "bytes out")

    @property
    def declaration(self) -> str:
        """Declaration in the prototype of the function."""
        return self._declared("" if self.is_written or not self.is_pointer else "const ")

    @property
    def read_only(self) -> str:
        """Declaration in a predicate, which writes nothing."""
        return self._declared("const " if self.is_pointer else "")

    @property
    def local(self) -> str:
        """Declaration of an object for the argument."""
        return f"{self.ctype} {self.name}{f'[{self.size}]' if self.role.startswith('bytes') else ''};"

    @property
    def passed(self) -> str:
        """The object as it is passed."""
        return f"&{self.name}" if self.is_pointer and not self.role.startswith("bytes") else self.name

    def _declared(self, const: str) -> str:
        if self.role.startswith("bytes"):
            return f"{const}{self.ctype} {self.name}[{self.size}]"
        return f"{const}{self.ctype} {'*' if self.is_pointer else ''}{self.name}"


@dataclass(frozen=True)
class Invariant:
    """Conditions on the members of the struct `value`; those of an array are checked for each of its `points` indices `k`."""

    ctype: str
    claims: tuple[str, ...]
    arrays: tuple[tuple[str, tuple[str, ...]], ...] = ()

    @property
    def predicate(self) -> str:
        """Name of the C function."""
        return f"{self.ctype.removesuffix('_t')}_holds"


@dataclass(frozen=True)
class Lemma:
    """A fact that is proved alone, for all values of its arguments, and assumed in the proofs of functions.

    Attributes:
        unit: the unit of the build whose static functions it uses; "" for none.
        linked: units of the build whose C is part of the proof.
        before: statements of the harness that apply other lemmas.
    """

    name: str
    arguments: tuple[Argument, ...] = ()
    unit: str = ""
    linked: tuple[str, ...] = ()
    before: tuple[str, ...] = ()
    unwind: int = 16

    @property
    def proof(self) -> Proof:
        """Proof of the lemma."""
        return Proof(name=self.name, files=tuple(f"src/{each}.c" for each in self.linked), unwind=self.unwind)


@dataclass(frozen=True)
class ProvedFunction:
    """A function with its contract, and how it is proved.

    Attributes:
        function: its name. result: type of its result; "" for none. result_is_struct: the result has members.
        before, facts: statements of the harness before and after the call, which apply lemmas.
        more: claims of the harness that no caller uses; arguments are objects there, not pointers.
        part: end of the name of a further harness of the function, which proves `more` alone.
        includes: the harness includes the C of the unit, so that the facts can use its static functions.
        stand_in: macro of `lemmas.j2` with functions that replace the static ones `replaced` of the unit.
        callees: functions that are replaced by their contracts.
        linked: further units of the build whose C is part of the proof.
        unwind: loop rounds, one more than the longest loop has.
        conversions: conversions from float to integer are checked; signed numbers that become unsigned would count as faults.
        only_claims: undefined behaviour is checked by another harness of the function.
        big_endian: the proof is for a big-endian target.
        open: reason why the contract is not proved; "" for one that is.
    """

    function: str
    unit: str
    arguments: tuple[Argument, ...] = ()
    result: str = ""
    result_is_struct: bool = False
    requires: tuple[Claim, ...] = ()
    ensures: tuple[Claim, ...] = ()
    before: tuple[str, ...] = ()
    facts: tuple[str, ...] = ()
    more: tuple[Claim, ...] = ()
    part: str = ""
    includes: bool = False
    stand_in: str = ""
    replaced: tuple[str, ...] = ()
    callees: tuple[str, ...] = ()
    linked: tuple[str, ...] = ()
    unwind: int = 16
    conversions: bool = True
    only_claims: bool = False
    big_endian: bool = False
    open: str = ""

    @property
    def name(self) -> str:
        """Name of the harness."""
        return self.function + self.part

    @property
    def proof(self) -> Proof:
        """Proof of the function."""
        units = (*self.linked, *(() if self.includes else (self.unit,)))
        return Proof(
            name=self.name,
            files=(*(f"src/{each}.c" for each in units), *(f"{FOLDER}/assume_{each}.c" for each in self.callees)),
            unwind=self.unwind,
            undefined=not self.only_claims,
            conversions=self.conversions and not self.only_claims,
            big_endian=self.big_endian,
            replaced=self.replaced,
            open=self.open,
        )

    @property
    def prototype(self) -> str:
        """Result and arguments of the function."""
        return f"{self.result or 'void'} {self.function}({self._listed('declaration')})"

    @property
    def requires_arguments(self) -> str:
        """Arguments of the precondition."""
        return self._listed("read_only")

    @property
    def ensures_arguments(self) -> str:
        """Arguments of the postcondition: those of the call, its result, and each state before the call."""
        result = f"const {self.result} *result" if self.result_is_struct else f"{self.result} result"
        more = [result] if self.result else []
        more += [f"const {each.ctype} *{each.name}_before" for each in self.states]
        return ", ".join([*(each.read_only for each in self.arguments), *more]) or "void"

    @property
    def states(self) -> tuple[Argument, ...]:
        """Arguments whose earlier value the postcondition may name."""
        return tuple(each for each in self.arguments if each.role == "state")

    @property
    def written(self) -> tuple[Argument, ...]:
        """Arguments that the call may change."""
        return tuple(each for each in self.arguments if each.is_written)

    def invariants(self, known: dict[str, Invariant], before: bool) -> Iterator[Claim]:
        """Yield the invariants that hold before, or after, the call."""
        roles = ("state", "parameter") if before else ("new", "state")
        for each in self.arguments:
            if each.role in roles and each.ctype in known:
                yield Claim(f"{each.name} is within its invariant", f"{known[each.ctype].predicate}({each.name})")

    def _listed(self, attribute: str) -> str:
        return ", ".join(getattr(each, attribute) for each in self.arguments) or "void"

"""Decode Thumb instructions of an Armv7E-M core with a single-precision FPU, with their cycles on a Cortex-M4F.

Cycles are those of the Cortex-M4 Technical Reference Manual r0p1 (ARM DDI 0439), tables 3-1 (processor) and 7-1 (FPU), for
memory without wait states. They are an estimate, mostly too high: an integer division takes 2 to 12 cycles and counts 12, the
refill of the pipeline after a jump takes 1 to 3 and counts 3, a load next to another one takes 1 and counts 2. Not included is
one more cycle for an FPU result that the next instruction uses.

Encodings: Armv7-M Architecture Reference Manual (ARM DDI 0403), chapter A5.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

REFILL = 3
"""Additional cycles of a jump: P of the manual, 1 to 3."""

DIVISION, FLOAT_DIVISION, FLOAT_ROOT, FLOAT_MULTIPLY_ACCUMULATE = 12, 14, 14, 3
ACCESS, FLOAT_DOUBLE_ACCESS, TABLE_BRANCH, TO_CORE_REGISTER = 2, 3, 2, 2

PC, LR = 15, 14
NOP = 0xBF00


class Flow(Enum):
    """Control flow after an instruction."""

    NEXT = auto()
    CALL = auto()  # of `target`, then next
    BRANCH = auto()  # to `target`
    CONDITIONAL = auto()  # to `target`, or next
    RETURN = auto()
    TABLE = auto()  # to a place in a table next to the code
    POINTER = auto()  # a call of, or a jump to, what a register holds


@dataclass(frozen=True, slots=True)
class Instruction:
    """One instruction.

    Attributes:
        address: address of its first byte.
        size: 2 or 4 bytes.
        cycles: cycles without a jump, which adds REFILL.
        flow: control flow, if its condition in an IT block holds.
        target: target of a call or branch, else None.
    """

    address: int
    size: int
    cycles: int = 1
    flow: Flow = Flow.NEXT
    target: int | None = None
    is_nop: bool = False

    @property
    def end(self) -> int:
        """Address of what follows it."""
        return self.address + self.size


def decode(code: bytes, address: int) -> list[Instruction]:
    """Return the instructions of a piece of code that starts at an address and ends with an instruction."""
    found, place = [], 0
    while place < len(code):
        first = int.from_bytes(code[place : place + 2], "little")
        if first >> 11 in (0b11101, 0b11110, 0b11111):
            second = int.from_bytes(code[place + 2 : place + 4], "little")
            found.append(_wide(first, second, address + place))
        else:
            found.append(_narrow(first, address + place))
        place += found[-1].size
    return found


def _narrow(word: int, address: int) -> Instruction:
    """Decode a 16-bit instruction, section A5.2."""
    cycles, flow, target = 1, Flow.NEXT, None
    if word & 0xFF00 == 0x4700:  # BX, BLX
        register = word >> 3 & 0xF
        flow = Flow.RETURN if register == LR and not word & 0x0080 else Flow.POINTER
    elif word & 0xFC00 == 0x4400 and word & 0x0300 != 0x0100:  # ADD, MOV of any register
        flow = Flow.POINTER if (word >> 4 & 8) | (word & 7) == PC else Flow.NEXT
    elif word & 0xF500 == 0xB100:  # CBZ, CBNZ
        flow, target = Flow.CONDITIONAL, address + 4 + ((word >> 3 & 0x40) | (word >> 2 & 0x3E))
    elif word & 0xF000 == 0xD000 and word & 0x0E00 != 0x0E00:  # B<cond>
        flow, target = Flow.CONDITIONAL, address + 4 + _signed((word & 0xFF) << 1, 9)
    elif word & 0xF800 == 0xE000:  # B
        flow, target = Flow.BRANCH, address + 4 + _signed((word & 0x7FF) << 1, 12)
    elif word & 0xF600 == 0xB400:  # PUSH, POP
        cycles = 1 + (word & 0x1FF).bit_count()
        flow = Flow.RETURN if word & 0xFF00 == 0xBD00 else Flow.NEXT
    elif word & 0xF000 == 0xC000:  # LDM, STM
        cycles = 1 + (word & 0xFF).bit_count()
    elif word & 0xF800 == 0x4800 or word >> 12 in (0x5, 0x6, 0x7, 0x8, 0x9):  # single load or store
        cycles = ACCESS
    return Instruction(address, 2, cycles, flow, target, word == NOP)


def _wide(first: int, second: int, address: int) -> Instruction:
    """Decode a 32-bit instruction, section A5.3."""
    if first & 0xFE00 == 0xE800:
        cycles, flow = _multiple_or_double(first, second)
    elif first & 0xFE00 == 0xF800:
        cycles, flow = _single_access(first, second)
    elif first & 0xF800 == 0xF000 and second & 0x8000:
        return _branch(first, second, address)
    elif first & 0xEC00 == 0xEC00:
        cycles, flow = _floating_point(first, second), Flow.NEXT
    else:
        cycles, flow = (DIVISION if first & 0xFFD0 == 0xFB90 and second & 0xF0 == 0xF0 else 1), Flow.NEXT
    return Instruction(address, 4, cycles, flow)


def _multiple_or_double(first: int, second: int) -> tuple[int, Flow]:
    """Decode LDM and STM; LDRD, STRD, exclusive access and table branch."""
    if not first & 0x0040:
        to_pc = bool(first & 0x0010) and bool(second >> PC)
        return 1 + second.bit_count(), Flow.RETURN if to_pc else Flow.NEXT
    if first & 0xFFF0 == 0xE8D0 and second & 0xFFE0 == 0xF000:
        return TABLE_BRANCH, Flow.TABLE
    exclusive = first & 0x0120 == 0
    return (ACCESS, Flow.NEXT) if exclusive else (1 + 2, Flow.NEXT)


def _single_access(first: int, second: int) -> tuple[int, Flow]:
    """Decode a load. A load of the program counter from the stack is a return."""
    if first & 0xFF70 == 0xF850 and second >> 12 == PC:
        return ACCESS, Flow.RETURN if first & 0xF == 13 else Flow.POINTER
    return ACCESS, Flow.NEXT


def _branch(first: int, second: int, address: int) -> Instruction:
    """Decode B, B<cond> and BL. The other instructions here take one cycle (MRS, MSR, hints)."""
    sign, j1, j2 = first >> 10 & 1, second >> 13 & 1, second >> 11 & 1
    if second & 0x5000 == 0:
        if first >> 7 & 7 == 7:
            return Instruction(address, 4)
        offset = sign << 20 | j2 << 19 | j1 << 18 | (first & 0x3F) << 12 | (second & 0x7FF) << 1
        return Instruction(address, 4, 1, Flow.CONDITIONAL, address + 4 + _signed(offset, 21))
    i1, i2 = 1 - (j1 ^ sign), 1 - (j2 ^ sign)
    offset = sign << 24 | i1 << 23 | i2 << 22 | (first & 0x3FF) << 12 | (second & 0x7FF) << 1
    flow = Flow.CALL if second & 0x4000 else Flow.BRANCH
    return Instruction(address, 4, 1, flow, address + 4 + _signed(offset, 25))


def _floating_point(first: int, second: int) -> int:
    """Return the cycles of an FPU instruction, sections A6.4 to A6.7."""
    if first & 0xFE00 == 0xEC00:
        if first & 0xFFE0 == 0xEC40:  # two registers of the core
            return TO_CORE_REGISTER
        if first & 0xFF20 == 0xED00:  # VLDR, VSTR
            return FLOAT_DOUBLE_ACCESS if second & 0x0100 else ACCESS
        return 1 + (second & 0xFF)  # VLDM, VSTM, VPUSH, VPOP
    if first & 0xFF00 != 0xEE00:
        return 1
    if second & 0x0010:
        return 1 if first & 0x00E0 == 0x00E0 else TO_CORE_REGISTER  # VMRS, VMSR; VMOV
    operation = (first >> 5 & 4) | (first >> 4 & 3)
    if operation in (0, 1, 5, 6):  # VMLA, VMLS, VNMLA, VNMLS; VFNMA, VFNMS; VFMA, VFMS
        return FLOAT_MULTIPLY_ACCUMULATE
    if operation == 4:
        return FLOAT_DIVISION
    return FLOAT_ROOT if operation == 7 and first & 0xF == 1 and second & 0xC0 == 0xC0 else 1


def _signed(value: int, bits: int) -> int:
    return value - (1 << bits) if value >> (bits - 1) else value

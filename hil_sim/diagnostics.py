"""Texts of the bits of `Diagnostics`."""

from __future__ import annotations

from collections.abc import Mapping

from codegen.emit import can_view

DIAGNOSTICS: Mapping[int, tuple[str, str]] = {cause.bit: (cause.name, cause.words) for cause in can_view.DIAGNOSTICS}
"""Bit: name as in the generated C, and a few words."""


def causes(diagnostics: int) -> tuple[str, ...]:
    """Return the texts of the bits that are set, from the lowest; "bit 20" for one without a name."""
    bits = [bit for bit in range(diagnostics.bit_length()) if diagnostics >> bit & 1]
    return tuple(DIAGNOSTICS[bit][1] if bit in DIAGNOSTICS else f"bit {bit}" for bit in bits)

"""Rows for a batch, and the comparison of their results on two machines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.verify.pil.batches import WHOLE, Batch, Rows
from codegen.verify.pil.runners import Runner


@dataclass(frozen=True)
class Stream:
    """Rows for one batch.

    Attributes:
        name: name in messages.
        row: word for one row in messages.
        batch: batch to run.
        rows: words, (rows, inputs of the batch).
    """

    name: str
    row: str
    batch: Batch
    rows: Rows

    def format_row(self, row: int) -> str:
        """Format the inputs of a row."""
        words = self.rows[row]
        if self.batch.name == "task":
            return _format_frames([int(word) for word in words])
        return ", ".join(
            f"{name} = {int(word) if name in WHOLE else format_word(word)}"
            for name, word in zip(self.batch.inputs, words, strict=True)
        )


def differences(stream: Stream, here: Runner, there: Runner, expected: Rows) -> tuple[int, tuple[str, ...]]:
    """Run a stream on another machine and return the number of rows that differ, with the first as text."""
    found = there.run(stream.batch, stream.rows)
    wrong = (found != expected).any(axis=1)
    if not wrong.any():
        return 0, ()
    row = int(wrong.argmax())
    column = int((found[row] != expected[row]).argmax())
    output = stream.batch.outputs[column]
    values = [format_word(words[row, column]) if output.is_number else hex(words[row, column]) for words in (found, expected)]
    return int(wrong.sum()), (
        f"{there.name}: {stream.name}, {stream.row} {row}: {output.name} is {values[0]}, and {values[1]} on {here.name}; "
        f"{stream.format_row(row)}",
    )


def format_word(word: Any) -> str:
    """Format the number whose bits a word holds, and the bits."""
    bits = 8 * word.itemsize
    number = word.view(np.float32 if bits == 32 else np.float64)
    return f"{number:.{9 if bits == 32 else 17}g} (0x{int(word):0{bits // 4}x})"


def _format_frames(words: list[int]) -> str:
    frames = []
    for frame in range(words[1]):
        identifier, length, low, high = words[2 + 4 * frame : 6 + 4 * frame]
        frames.append(f"0x{identifier:x} [{length}] {(low | high << 32).to_bytes(8, 'little')[:length].hex()}")
    return f"restart = {words[0]}, frames {', '.join(frames) or 'none'}"

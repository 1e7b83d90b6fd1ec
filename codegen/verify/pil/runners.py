"""Runners of batches: this machine and emulated cores."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol

import numpy as np

from codegen.sil.compile import compile_library
from codegen.verify.on_host import HOST_FLAGS
from codegen.verify.pil.batches import FOLDER, Batch, Program, Rows
from codegen.verify.target.cross import CORTEX_M4F, Core, compile_image
from codegen.verify.target.emulator import DATA, DATA_BYTES, Processor


class Runner(Protocol):
    """Runner of batches."""

    name: str

    def run(self, batch: Batch, rows: Rows) -> Rows:
        """Run rows (n, inputs) and return rows (n, outputs)."""


class OnHost:
    """Runner in this process, compiled by the user's compiler. All runners of one program share its states.

    Raises:
        BuildError: no compiler, or C that does not compile.
    """

    name = "this machine"

    def __init__(self, program: Program) -> None:
        self._program = program
        library = compile_library(
            f"{program.prefix}_batches",
            program.sources,
            [f"{FOLDER}/batches.h"],
            include_folders=("include", FOLDER),
            flags=HOST_FLAGS,
        )
        self._ffi, self._lib = library.ffi, library.lib

    def run(self, batch: Batch, rows: Rows) -> Rows:
        """Run rows (n, inputs) and return rows (n, outputs)."""
        ffi, word = self._ffi, self._program.word
        given = np.ascontiguousarray(rows, dtype=word)
        results = np.empty((len(rows), len(batch.outputs)), dtype=word)
        getattr(self._lib, f"verify_batch_{batch.name}")(
            ffi.cast("verify_word_t *", ffi.from_buffer(given)),
            ffi.cast("verify_word_t *", ffi.from_buffer(results, require_writable=True)),
            len(rows),
        )
        return results


class OnTarget:
    """Runner on an emulated core.

    Args:
        sources: additional sources, such as a library.

    Attributes:
        name: name of the core.
        processor: the core.

    Raises:
        CodegenError: a package of the extra is missing.
        BuildError: C that does not compile; in `run`, C that leaves its memory or does not return.
    """

    def __init__(self, program: Program, core: Core = CORTEX_M4F, sources: Mapping[str, bytes] | None = None) -> None:
        entries = [f"verify_batch_{name}" for name in program.batches] + list(program.entries)
        self.name, self._program = core.name, program
        self.processor = Processor(compile_image({**program.sources, **(sources or {})}, entries, ("-O2",), core), core)
        self._word = np.dtype(f"{self.processor.byte_order}u{np.dtype(program.word).itemsize}")

    def run(self, batch: Batch, rows: Rows) -> Rows:
        """Run rows (n, inputs) and return rows (n, outputs)."""
        return np.concatenate([self._chunk(batch, part) for part in self._chunks(batch, rows)])

    def _chunks(self, batch: Batch, rows: Rows) -> Iterator[Rows]:
        size = DATA_BYTES // ((len(batch.inputs) + len(batch.outputs)) * self._word.itemsize)
        for start in range(0, max(len(rows), 1), size):
            yield rows[start : start + size]

    def _chunk(self, batch: Batch, rows: Rows) -> Rows:
        given, results = rows.astype(self._word).tobytes(), len(rows) * len(batch.outputs) * self._word.itemsize
        self.processor.write(DATA, given)
        self.processor.call(f"verify_batch_{batch.name}", DATA, DATA + len(given), len(rows))
        words = np.frombuffer(self.processor.read(DATA + len(given), results), dtype=self._word)
        return words.astype(self._program.word).reshape(len(rows), len(batch.outputs))

"""Streams of rows for the batches: generated inputs, and the comparison of their results on two machines.

Inputs are samples over the whole input range, special numbers, and valid and damaged CAN frames. The same configuration and
seed give the same rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.configuration.signals import SignalDefinition
from codegen.sil.software import Measurement
from codegen.units import KM_H
from codegen.verify.drives import DRIVE_COLUMNS, GAPS, HELD, Samples, Thresholds, drawn, moving
from codegen.verify.emulated_batches import (
    FRAME_WORD_BYTES,
    FRICTION_FIELDS,
    WHOLE_FIELDS,
    Batch,
    Program,
    Rows,
    Runner,
    Word,
    frame_columns,
    outside_drives,
    real_of,
    rows_of_cycles,
)
from codegen.verify.unit_drives import Drive

BATCH = 36_000
"""Maximum rows of a part of a drive."""
REPLACED_FRACTIONS = (0.0, 0.01, 0.0, 0.3, 0.0, 1.0)
"""Fraction of the numbers that are replaced by arbitrary ones, in consecutive stretches: each kind of damage, and time to
recover."""

STRETCH = 60
"""Samples of a stretch, more than most recoveries take."""

RESTART = 0.005
"""Probability that a sample restarts the controller."""

WHOLE_DRIVES = ((0.0, 1.0),) * len(HELD)
"""Gap probabilities of drives without gaps."""

TOUR_MAX = 2_500
"""Maximum samples of one leg of the tour."""


@dataclass(frozen=True)
class Source:
    """Generator of rows for the thresholds of a build, in words of a NumPy type."""

    thresholds: Thresholds
    word: Word
    generator: np.random.Generator

    def words(self, numbers: npt.ArrayLike) -> Rows:
        """Return the bits of numbers."""
        with np.errstate(over="ignore"):
            return np.ascontiguousarray(numbers, dtype=real_of(self.word)).view(self.word)

    def steps(self, batch: Batch, count: int) -> Rows:
        """Draw rows for the controller: a tour through every status, drawn drives, and drives with special numbers."""
        tour = _tour(self.thresholds.config)[:count]
        left = count - len(tour)
        tame = self._drawn(left // 2)
        wild = self._drawn(left - len(tame), WHOLE_DRIVES)
        rows = self.recordings(batch, (tour, tame, wild))
        rows[len(tour) :, 0] |= self.generator.random(count - len(tour)) < RESTART
        rows[:, 1] = self.words(self.generator.uniform(-0.2, 0.2, count))
        first = count - len(wild)
        self.overlay(rows[first:, 2:8])
        for signal in self._outside_drives:
            rows[:, batch.inputs.index(signal.role)] = self._carried(signal, count)
        self.replace(rows[first:, 1:2], self.generator.random((len(wild), 1)) < 0.5)
        return rows

    def numbers(self, batch: Batch, count: int) -> Rows:
        """Draw rows for another batch, each column from its signal's range; a third of the rows has arbitrary numbers."""
        drive = self._drawn(count)
        columns: dict[str, npt.NDArray[Any]] = {name: drive[:, DRIVE_COLUMNS.index(name)] for name in DRIVE_COLUMNS}
        steered = np.where(np.isnan(drive[:, 3]), 0.05, drive[:, 3])
        columns |= {"demand": steered * self.generator.choice([1.0, 3.0], count), "start_angle": steered}
        columns |= {"x": 10.0 * self.generator.standard_normal(count), "rear_angle": steered}
        columns |= {name: columns["friction"] * share for name, share in zip(FRICTION_FIELDS, (0.9, 0.7), strict=True)}
        rows = np.empty((count, len(batch.inputs)), dtype=self.word)
        whole = {
            "restart": self.generator.random(count) < RESTART,
            "inhibit": self.generator.integers(2, size=count),
            "status": self.generator.integers(256, size=count),
            "diagnostics": self.generator.integers(65536, size=count),
        }
        for signal in self._outside_drives:
            whole[signal.role] = self._carried(signal, count)
        for place, name in enumerate(batch.inputs):
            rows[:, place] = whole[name] if name in whole else self.words(columns[name])
        places = [place for place, name in enumerate(batch.inputs) if name not in WHOLE_FIELDS]
        taken = self.generator.random((count, len(places))) < np.where(self.generator.random((count, 1)) < 0.33, 0.5, 0.0)
        found = rows[:, places]
        self.replace(found, taken)
        rows[:, places] = found
        if "restart" in batch.inputs:
            rows[0, batch.inputs.index("restart")] = 1
        return rows

    @property
    def _outside_drives(self) -> tuple[SignalDefinition, ...]:
        return outside_drives(self.thresholds.config.can.measured)

    def _carried(self, signal: SignalDefinition, count: int) -> Rows:
        """Draw words for a signal that no drive has."""
        if signal.is_flag:
            return self.generator.integers(2, size=count, dtype=self.word)
        return self.words(10.0 * self.generator.standard_normal(count))

    def overlay(self, rows: Rows) -> None:
        """Replace numbers by arbitrary ones, in stretches of different density."""
        level = np.resize(np.repeat(REPLACED_FRACTIONS, STRETCH), len(rows))[:, None]
        self.replace(rows, self.generator.random(rows.shape) < level)

    def replace(self, rows: Rows, taken: npt.NDArray[np.bool_]) -> None:
        """Replace selected words by arbitrary ones."""
        count = int(taken.sum())
        special = self.generator.choice(specials(self.word), count)
        raw = self.generator.integers(np.iinfo(self.word).max, size=count, dtype=self.word, endpoint=True)
        # All magnitudes, so that some saturate and some vanish.
        sized = self.words(self.generator.choice([-1.0, 1.0], count) * 10.0 ** self.generator.uniform(-40.0, 40.0, count))
        rows[taken] = np.choose(self.generator.integers(3, size=count), [special, raw, sized])

    def recordings(self, batch: Batch, drives: Sequence[Samples]) -> Rows:
        """Convert drives to rows for the controller, each from a restart."""
        rows = np.concatenate([np.zeros((len(drive), len(batch.inputs)), dtype=self.word) for drive in drives])
        samples = np.concatenate(drives)
        rows[:, 2:8], rows[:, 8] = self.words(samples[:, :6]), samples[:, 6] != 0.0
        rows[np.cumsum([0, *(len(drive) for drive in drives[:-1])]), 0] = 1
        return rows

    def _drawn(self, count: int, gaps: Sequence[tuple[float, float]] = GAPS) -> Samples:
        drives = drawn(self.thresholds, -(-count // len(HELD)), int(self.generator.integers(2**32)), gaps)
        return np.concatenate(drives)[:count]


def specials(word: Word) -> Rows:
    """Return the words of numbers that are easily mishandled, of both signs: zero, subnormal, smallest and largest numbers,
    infinity, one, and quiet and signalling NaN with several payloads."""
    digits, width = (23, 32) if word is np.uint32 else (52, 64)
    exponent = ((1 << (width - 1 - digits)) - 1) << digits
    quiet = 1 << (digits - 1)
    found = [0, 1, (1 << digits) - 1, 1 << digits, exponent - 1, exponent, (exponent >> 1) & ~((1 << digits) - 1)]
    found += [exponent | quiet, exponent | quiet | 0x12345, exponent | ((1 << digits) - 1)]
    found += [exponent | 1, exponent | (quiet >> 1), exponent | (quiet - 1), exponent | 0x12345]
    return np.array(found + [bits | 1 << (width - 1) for bits in found], dtype=word)


def _tour(config: Config) -> Samples:
    """Return samples that take the controller through every status, for the times configured."""
    controller, inputs = config.controller, config.controller.inputs
    speed = min(2.0 * controller.feedback_speeds_km_h[1], inputs.speed_max_km_h) * KM_H
    lost = controller.fail_safe.degraded_samples_max
    wait = controller.fail_safe.recovery_samples
    straight = (speed, 0.0, 0.0, 0.0, math.nan, math.nan, 0.0)
    # A large front angle without yaw rate, so that the demand reaches its limit.
    steered = (speed, 0.5 * config.steering.front_angle_stop, 0.0, math.nan, math.nan, math.nan, 0.0)
    slow = (0.5 * controller.feedback_speeds_km_h[0] * KM_H, 0.0, 0.0, 0.0, math.nan, math.nan, 0.0)
    no_speed = (math.nan, 0.0, 0.0, 0.0, math.nan, math.nan, 0.0)
    gone = (math.nan, math.nan, math.nan, 0.0, math.nan, math.nan, 0.0)
    beyond = (speed, *(1.1 * np.radians([inputs.front_angle_max_deg, inputs.yaw_rate_max_deg_s])), 0.0, math.nan, math.nan, 0.0)
    first = ((slow, 3), (straight, STRETCH), (steered, 2 * STRETCH), (straight, STRETCH))
    last = ((slow, wait + 3), (straight, STRETCH), (steered, STRETCH))
    return np.concatenate(
        [
            _legs(((no_speed, 0 if controller.waits_for_speed else wait),)),
            moving(_legs(first), config),
            _legs(((beyond, lost + 3), (straight, wait + STRETCH), (gone, lost + 3))),
            moving(_legs(last), config),
        ]
    )


def _legs(legs: Sequence[tuple[Any, int]]) -> Samples:
    return np.concatenate([np.tile(np.array(sample, dtype=np.float32), (min(length, TOUR_MAX), 1)) for sample, length in legs])


@dataclass(frozen=True)
class Stream:
    """Rows for one batch, (rows, inputs). `name`, and `row`, the word for one of them, are for messages."""

    name: str
    row: str
    batch: Batch
    rows: Rows

    def format_row(self, row: int) -> str:
        """Format the inputs of a row."""
        words = self.rows[row]
        if self.batch.name == "task":
            return _format_frames([int(word) for word in words], frame_columns(self.batch))
        return ", ".join(
            f"{name} = {int(word) if name in WHOLE_FIELDS else format_word(word)}"
            for name, word in zip(self.batch.inputs, words, strict=True)
        )


def streams_of(drive: Drive, program: Program) -> Iterator[Stream]:
    """Yield a drive in parts of at most BATCH rows. The drives of the inputs run in the controller."""
    batch = program.batches["controller" if drive.unit == "inputs" else drive.unit]
    row = "cycle" if drive.unit == "task" else "sample"
    first, *others = drive.stretches
    yield Stream(drive.name, row, batch, _rows(first.samples, batch, program.word, drive.restarts, drive.start))
    for samples, rounds in ((first.samples, first.rounds - 1), *((each.samples, each.rounds) for each in others)):
        rows = _rows(samples, batch, program.word)
        at_once = max(BATCH // len(rows), 1)
        for done in range(0, rounds, at_once):
            yield Stream(drive.name, row, batch, np.tile(rows, (min(at_once, rounds - done), 1)))


def _rows(samples: Sequence[Any], batch: Batch, word: Word, restarts: Sequence[int] = (), start: float = 0.0) -> Rows:
    """Convert samples of a drive to rows."""
    if batch.name == "task":
        return rows_of_cycles(samples, batch, word, restarts)
    names = batch.inputs[2:]
    numbers = [[getattr(sample, name) for name in names] if isinstance(sample, Measurement) else sample for sample in samples]
    values = np.array(numbers, dtype=np.float64)
    rows = np.zeros((len(samples), len(batch.inputs)), dtype=word)
    with np.errstate(over="ignore"):
        rows[:, 2:] = values.astype(real_of(word)).view(word)
        rows[:, 1] = np.array(start, dtype=real_of(word)).view(word)
    for place, name in enumerate(names):
        if name in WHOLE_FIELDS:
            rows[:, 2 + place] = values[:, place].astype(word)
    rows[[*restarts], 0] = 1
    return rows


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


def _format_frames(words: list[int], columns: int) -> str:
    frames = []
    for start in range(2, 2 + words[1] * columns, columns):
        identifier, length, *data = words[start : start + columns]
        content = b"".join(word.to_bytes(FRAME_WORD_BYTES, "little") for word in data)
        frames.append(f"0x{identifier:x} [{length}] {content[:length].hex()}")
    return f"restart = {words[0]}, frames {', '.join(frames) or 'none'}"

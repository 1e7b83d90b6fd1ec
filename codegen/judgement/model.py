"""A judgement as data: rows that compare the car with its controller with the same car without, and a sentence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from codegen.configuration import Config
from codegen.map_file import judged
from codegen.map_file.map import ReferenceMap
from codegen.text import text_table

Verdict = Literal["better", "equal", "worse", "missed", "stated"]
"""Better or worse than the passive car by more than the tolerance, equal within it; "missed": beyond a criterion, although not
worse than the passive car; "stated": a figure that is not judged."""
FAULTS: tuple[Verdict, ...] = ("worse", "missed")
WORDS: dict[Verdict, str] = {"better": "better", "equal": "as good", "worse": "worse", "missed": "missed", "stated": ""}
DIGITS = 4
"""Significant digits of stored figures: rounding differs between machines far behind them."""


class _Stored(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class Row(_Stored):
    """One figure of the car.

    Attributes:
        key: name in JSON.
        title: what it is.
        value, passive: with and without the controller, in `unit`; None where the car spins or no driver passes.
        unit: unit of both.
        digits: digits after the point in texts.
        at: speed, and what else belongs to the worst case.
        required: the limit as text.
        verdict: see `Verdict`.
        remedy: end of the warning, if there is one.
    """

    key: str
    title: str
    value: float | None
    passive: float | None = None
    unit: str = ""
    digits: int = Field(default=2, ge=0, le=6)
    at: str = ""
    required: str = ""
    verdict: Verdict = "stated"
    remedy: str = ""

    @property
    def value_text(self) -> str:
        """The value with its unit."""
        return self._text(self.value, self.unit)

    @property
    def passive_text(self) -> str:
        """Value of the passive car with its unit; "" if the figure has none."""
        return "" if self.key.startswith(MAP_ONLY) else self._text(self.passive, self.unit.partition(" of ")[0])

    def _text(self, value: float | None, unit: str) -> str:
        return "spins" if value is None else f"{round(value, self.digits) + 0.0:.{self.digits}f} {unit}".rstrip()

    @property
    def short(self) -> str:
        """The figure in a few words, for a sentence."""
        return f"{self.title} {self.value_text}{f' (passive {self.passive_text})' if self.passive_text else ''}"

    @property
    def warning(self) -> str:
        """The warning of a fault; "" for other rows."""
        if self.verdict not in FAULTS:
            return ""
        what = "worse with the controller than without" if self.verdict == "worse" else "beyond a criterion"
        place, remedy = (f"{sign}{text}" if text else "" for sign, text in ((", ", self.at), ("; ", self.remedy)))
        return f"{what}: {self.short}{place}; required: {self.required}{remedy}"


MAP_ONLY = ("dead_steering", "yaw_rate", "yaw_gain", "dwell_sweep")
"""Beginnings of the keys of figures that the passive car does not have, or that are relative to it."""


JUDGEMENT_HEADER = ("", "with", "passive", "verdict", "where", "required")
"""Header of the table of a judgement."""


class Judgement(_Stored):
    """The judgement of a car.

    Attributes:
        definition: version of the judgement, see `map_file.judged`.
        inputs_sha256: hash of its inputs, see `map_file.judged`; "" where the map is not known.
        sentence: whether the car is better with the controller than without, and where it is not.
        rows: the figures.
        binding_percent: share of the feasible cells of the map by what binds in them.
        notes: what was not driven, and why.
    """

    definition: int = judged.DEFINITION_VERSION
    inputs_sha256: str = ""
    sentence: str
    rows: tuple[Row, ...]
    binding_percent: dict[str, float] = {}
    notes: tuple[str, ...] = ()

    @property
    def faults(self) -> tuple[Row, ...]:
        """Rows with a warning."""
        return tuple(row for row in self.rows if row.verdict in FAULTS)

    @property
    def warnings(self) -> tuple[str, ...]:
        """A warning for each fault."""
        return tuple(row.warning for row in self.faults)

    def row(self, key: str) -> Row | None:
        """Return a row by its key; None if the judgement does not have it."""
        return next((row for row in self.rows if row.key == key), None)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return self.model_dump(mode="json")

    def lines(self) -> Iterator[str]:
        """Yield the sentence, the table without what is required, and what binds, for a terminal."""
        header, rows = self.table()
        yield self.sentence
        yield f"\n{text_table(header[:-1], [row[:-1] for row in rows])}\n"
        if self.binding_percent:
            yield f"what binds in the map's cells: {self.binding_text}"
        yield from self.notes

    @property
    def binding_text(self) -> str:
        """Shares of what binds, from half a percent on."""
        shares = sorted(self.binding_percent.items(), key=lambda item: -item[1])
        return ", ".join(f"{name} {share:.0f} %" for name, share in shares if share >= 0.5)

    def table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Return a header and the rows as texts."""
        return JUDGEMENT_HEADER, [
            (row.title, row.value_text, row.passive_text, WORDS[row.verdict], row.at, row.required) for row in self.rows
        ]


def _read(found: Any) -> Judgement | None:
    try:
        return Judgement.model_validate(found)
    except ValidationError:
        return None


State = Literal["current", "missing", "out of date"]
DRIVE = "`codegen check --drive` makes it"
NOTES: dict[State, str] = {
    "current": "",
    "missing": f"whether the car is better with the controller than without is not judged; {DRIVE}",
    "out of date": f"the judgement of the car is out of date, for its map or its configuration has changed; {DRIVE}",
}
"""A note where there is no valid judgement."""


@dataclass(frozen=True)
class Stored:
    """The judgement in a file: None unless it is valid for what the file holds."""

    state: State
    judgement: Judgement | None = None

    @property
    def note(self) -> str:
        """A note that names the remedy; "" for a valid judgement."""
        return NOTES[self.state]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of a valid judgement."""
        return () if self.judgement is None else self.judgement.warnings

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return {"state": self.state, **({} if self.judgement is None else self.judgement.to_dict())}


MISSING_RECORD = Stored("missing")


def of_map(reference_map: ReferenceMap, config: Config) -> Stored:
    """Return the judgement that `codegen tune` stored in a map, for a configuration."""
    if judged.stored(reference_map) is None:
        return MISSING_RECORD
    found = _read(judged.current(reference_map, config))
    return Stored("out of date") if found is None else Stored("current", found)


def of_manifest(manifest: Mapping[str, Any], is_edited: bool = False) -> Stored:
    """Return the judgement in a build's manifest. It is not one of a build whose files have been edited."""
    if manifest.get(judged.KEY) is None:
        return MISSING_RECORD
    found = _read(manifest[judged.KEY])
    if found is None or found.definition != judged.DEFINITION_VERSION or is_edited:
        return Stored("out of date")
    return Stored("current", found)

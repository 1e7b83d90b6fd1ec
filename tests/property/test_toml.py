"""The loaders of TOML (`ars.toml`, scenario files) with repeatedly damaged texts.

The result must be one line of error or a complete configuration.
"""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from codegen import configuration
from codegen.errors import CodegenError
from hil_sim import scenario_files
from tests.property.guard import bounded

SCENARIO = """name = "wet-lane-change"
base = "sine-with-dwell"
speed_km_h = 70.0
[[faults]]
kind = "delay"
start_s = 2.5
duration_s = 0.2
message = "VehicleMotion"
cycles = 2
"""


def load_configuration(path: Path) -> None:
    loaded = configuration.load(path)
    assert configuration.parse(json.loads(loaded.to_json()), "again") == loaded


Loader = Callable[[Path], object]
LOADERS: dict[str, tuple[Loader, tuple[str, ...]]] = {
    "configuration": (load_configuration, (configuration.preset_text("paper"), configuration.preset_text("recommended"))),
    "scenario": (scenario_files.load, (SCENARIO,)),
}


def check(path: Path, content: bytes, load: Loader) -> None:
    path.write_bytes(content)
    with bounded():
        try:
            load(path)
        except CodegenError as error:
            assert str(error).startswith(str(path))
            assert "\n" not in str(error)
            assert error.remedy


NUMBERS = "0 -1 1e400 -1e-400 nan inf -inf 0x7fffffffffffffff 0o777 0b1 1_000 true 1979-05-27T07:32:00Z 07:32:00"
TEXTS = ('""', '"off"', '"\\u0000"', '"\\uFFFF"', '"x\\ny"', "'''\n'''", f'"{"x" * 500}"')
NESTED = ("[]", "[1, 2]", "[[1], [2]]", '["a"]', "[1, true]", "[nan, 1]", "{}", "{a = 1}", "{a.b.c = 1}", "[" * 90 + "]" * 90)
VALUES = st.sampled_from([*NUMBERS.split(), "9" * 400, *TEXTS, *NESTED])
KEYS = st.sampled_from(["x", "mass_kg", '""', '"a b"', '"\\u001b[31m"', "a.b.c", "vehicle", "vehicle.mass_kg", "1", "cases"])
LINES = st.builds("{} = {}".format, KEYS, VALUES) | st.builds("[{}]".format, KEYS) | st.builds("[[{}]]".format, KEYS)
ANYTHING = st.text(max_size=30)
"""Includes control characters and characters of other planes."""


class ChangedText(RuleBasedStateMachine):
    """One text with changing lines; each change is checked."""

    lines: list[str]
    load: Loader
    path: Path

    @initialize(name=st.sampled_from(sorted(LOADERS)), data=st.data())
    def begin(self, name: str, data: st.DataObject) -> None:
        self.load, texts = LOADERS[name]
        self.lines = data.draw(st.sampled_from(texts)).splitlines()

    @rule(place=st.integers(0, 10**4), value=VALUES)
    def give_another_value(self, place: int, value: str) -> None:
        settable = [k for k, line in enumerate(self.lines) if "=" in line and not line.startswith("#")]
        if settable:
            k = settable[place % len(settable)]
            self.lines[k] = f"{self.lines[k].partition('=')[0]}= {value}"

    @rule(place=st.integers(0, 10**4), removed=st.integers(0, 5), line=LINES | ANYTHING)
    def replace(self, place: int, removed: int, line: str) -> None:
        at = place % max(len(self.lines), 1)
        self.lines[at : at + removed] = [line]

    @rule(place=st.integers(0, 10**4), to=st.integers(0, 10**4))
    def repeat(self, place: int, to: int) -> None:
        if self.lines:
            self.lines.insert(to % len(self.lines), self.lines[place % len(self.lines)])

    @invariant()
    def is_read_or_refused(self) -> None:
        if hasattr(self, "lines"):
            check(self.path, "\n".join(self.lines).encode("utf-8", errors="surrogatepass"), self.load)


def test_changed_texts(tmp_path: Path) -> None:
    ChangedText.path = tmp_path / "fuzz.toml"
    changed = ChangedText.TestCase()
    changed.settings = settings(max_examples=12, stateful_step_count=8, deadline=None)
    changed.runTest()


LARGE = {  # below the size limit of a file
    "dotted key": "a" + ".a" * 500_000 + " = 1",
    "nested tables": "a = " + "{a = " * 200_000,
    "hexadecimal digits of a known key": "[vehicle]\nmass_kg = 0x" + "f" * 5_000,
    "decimal digits": "speed_km_h = " + "9" * 900_000,
}


@pytest.mark.parametrize("name", LOADERS)
@pytest.mark.parametrize("what", LARGE)
def test_large_values(name: str, what: str, tmp_path: Path) -> None:
    check(tmp_path / "fuzz.toml", LARGE[what].encode(), LOADERS[name][0])

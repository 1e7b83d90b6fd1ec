"""The lookup of every map, precision, kind of controller and storage."""

import re
from dataclasses import replace

import numpy as np
import pytest

from codegen.configuration import Kind
from codegen.ecu_map.storage import RAW_MAX, Storage
from codegen.emit.text import Precision
from codegen.sil.software import compile_build
from tests import builds
from tests.sil.case import case
from tests.sil.placed import Which, check_placed, judges_of_map, placed
from tests.sil.suite import SANITIZED, whole

PLACED: tuple[tuple[Kind, Precision, Storage, Which], ...] = (
    ("pi", "single", "float", "linear"),
    ("pi", "single", "int16", "linear"),
    ("pi", "double", "int16", "linear"),
    ("tracking", "single", "int16", "linear"),
    ("tracking", "single", "int16", "stack"),
    ("pi", "single", "float", "nonlinear"),
    ("tracking", "double", "float", "nonlinear stack"),
    ("tracking", "single", "int16", "nonlinear stack"),
)
STACKS = [name for name in builds.MAPS if "stack" in name]
KINDS: tuple[Kind, ...] = ("tracking", "feedforward", "proportional", "pi")


@pytest.mark.long
@pytest.mark.parametrize("name", builds.MAPS)
@pytest.mark.parametrize("kind", ["pi", "tracking"])
def test_each_map(kind: Kind, name: str) -> None:
    """Checks that write the calibration need axes with many cells: `make test` runs them on such maps."""
    if kind == "tracking" and builds.MAPS[name]().rear_angle is None:
        return  # not from the optimum: it has no rear angle
    found = case(f"{kind} {name}")
    for judge in (*whole(kind, ("map",)), SANITIZED):
        if not judge.of_single and not (judge.of_one_layer and name in STACKS):
            judge.run(found)


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=[] if kind == "tracking" else pytest.mark.long) for kind in KINDS])
def test_every_check_of_a_kind_in_double_precision(kind: Kind) -> None:
    for judge in (*whole(kind), SANITIZED):
        if not judge.of_single:
            judge.run(case(f"{kind} double"))


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_stack_behind_every_kind(kind: Kind) -> None:
    """Only the second implementation is compared; other checks of the controller know a map for one friction."""
    judges = [judge for judge in whole(kind, ("controller",)) if judge.name.startswith("model: ")]
    assert judges
    for judge in judges:
        judge.run(case(f"{kind} rough stack"))


@pytest.mark.long
@pytest.mark.parametrize("which", PLACED, ids=" ".join)
def test_placed(which: tuple[Kind, Precision, Storage, Which]) -> None:
    found, chosen = placed(*which)
    for judge in judges_of_map(found):
        judge.run(found)
    check_placed(found, chosen)


@pytest.mark.long
@pytest.mark.parametrize("share", ["1.5f", "(0.0f / 0.0f)", "-1.0f"])
def test_a_damaged_grip_entry_fails_the_self_test_and_raises_no_cap(share: str) -> None:
    built, path = placed(*PLACED[5])[0].built, "src/ars_calibration.c"
    text = built.folder.files[path].decode("ascii")
    begin = text.index("grip_share_table[")
    numbers = list(re.compile(r"\d\.\d+f").finditer(text, begin, text.index("};", begin)))
    lost = numbers[len(numbers) // 2]
    files = {**built.folder.files, path: (text[: lost.start()] + share + text[lost.end() :]).encode("ascii")}
    software = compile_build(files, built.folder.manifest)
    assert not software.function("selftest")()
    speed, front_angle = np.meshgrid(np.linspace(1.0, 40.0, 120), np.linspace(0.0, 0.7, 120))
    yaw_rate = software.map_yaw_rate(speed.astype(np.float32), front_angle.astype(np.float32))
    assert (yaw_rate >= 0.0).all() and (yaw_rate * speed <= built.total.lateral_acceleration_cap).all()


def test_a_negative_entry_is_invalid() -> None:
    folder, path = placed(*PLACED[1])[0].built.folder, "src/ars_calibration.c"
    head, found, tail = folder.files[path].decode("ascii").rpartition(f" {RAW_MAX}")
    assert found
    software = compile_build({**folder.files, path: f"{head} -{RAW_MAX}{tail}".encode("ascii")}, folder.manifest)
    assert not software.function("map_valid")() and not software.function("selftest")()


@pytest.mark.long
def test_the_self_test_covers_each_number_of_a_stack() -> None:
    """One number of either table of a layer, or a friction of the stack, is changed by the smallest step."""
    folder = case("feedforward rough stack").built.folder
    text = folder.files["src/ars_calibration.c"].decode("ascii")
    tables = [match.start() for match in re.finditer("const float ars_map_(yaw_rate|rear_angle)_table", text)]
    layers = [match.start() for match in re.finditer("/\\* friction", text)]
    changed = []
    for begin in (layers[0], layers[3], *(layer for layer in layers if layer > tables[1])):
        number = re.compile(r"-?\d\.\d{5,}f").search(text, begin)
        assert number is not None
        wrong = float(np.nextafter(np.float32(float(number[0].rstrip("f"))), np.float32(10.0)))
        changed.append(("src/ars_calibration.c", text[: number.start()] + f"{wrong!r}f" + text[number.end() :]))
    assert text.count("0.2f, 0.21f, 0.6f, 0.9f") == 1
    changed.append(("src/ars_calibration.c", text.replace("0.2f, 0.21f, 0.6f, 0.9f", "0.2f, 0.21000002f, 0.6f, 0.9f")))
    for path, wrong_text in changed:
        faulty = replace(folder, files={**folder.files, path: wrong_text.encode("ascii")})
        assert not compile_build(faulty.files, faulty.manifest).selftest()

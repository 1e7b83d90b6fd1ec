"""The look-up of every map, precision, kind of controller and storage."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from codegen.config import Kind
from codegen.emit.text import Precision
from codegen.refmap.axis import Axis
from codegen.refmap.extend import extend
from codegen.refmap.lookup import error_bound
from codegen.refmap.storage import RAW_MAX, Storage
from codegen.refmap.total import GripTable
from codegen.sil.software import Software, compile_build
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
PLAIN = [name for name in builds.MAPS if "stack" not in name]
KINDS: tuple[Kind, ...] = ("tracking", "feedforward", "proportional", "pi")


def test_the_maps_have_every_kind_of_axis() -> None:
    kinds = set()
    for name in PLAIN:
        total = extend(builds.MAPS[name](), builds.CONFIG)
        for values in (total.speed, total.front_angle):
            axis = Axis.from_breakpoints(values)
            kinds.add((axis.even, axis.has_first_cell, axis.has_last_cell))
    assert kinds == {(False, False, False), (True, False, False), (True, True, False), (True, False, True), (True, True, True)}


@pytest.mark.long
@pytest.mark.parametrize("name", builds.MAPS)
@pytest.mark.parametrize("kind", ["pi", "tracking"])
def test_each_map(kind: Kind, name: str) -> None:
    """The checks that write the calibration need axes of many cells: `make test` runs them on such maps."""
    if kind == "tracking" and builds.MAPS[name]().rear_angle is None:
        return  # not the optimum's: it has no rear angle
    found = case(f"{kind} {name}")
    for judge in (*whole(kind, ("map",)), SANITIZED):
        if not judge.of_single and not (judge.of_one_layer and name in STACKS):
            judge.run(found)


@pytest.mark.parametrize("kind", KINDS)
def test_every_check_of_a_kind_in_double_precision(kind: Kind) -> None:
    for judge in (*whole(kind), SANITIZED):
        if not judge.of_single:
            judge.run(case(f"{kind} double"))


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_stack_behind_every_kind(kind: Kind) -> None:
    found = case(f"{kind} rough stack")
    for judge in whole(kind, ("controller",)):
        judge.run(found)


@pytest.mark.long
@pytest.mark.parametrize("which", PLACED, ids=" ".join)
def test_placed(which: tuple[Kind, Precision, Storage, Which]) -> None:
    found, chosen = placed(*which)
    for judge in judges_of_map(found):
        judge.run(found)
    check_placed(found, chosen)


@pytest.mark.long
@pytest.mark.parametrize("friction", [math.nan, 0.9, 0.5, 0.2])
def test_the_share_of_grip_is_kept_in_exact_arithmetic(friction: float) -> None:
    """No yaw rate is above the share of the cap at its speed and front angle, and many are at it."""
    built = placed("pi", "single", "float", "nonlinear")[0].built
    total, grip = built.total, built.total.grip
    assert grip is not None
    rng = np.random.default_rng(5)
    speed, front_angle = (
        rng.uniform(0.3 * axis[-1], axis[-1], 4_000).astype(built.real) for axis in (total.speed, total.front_angle)
    )
    found = built.software.function("map_yaw_rate_on_road")
    share = _interpolated(grip, speed.astype(np.float64), front_angle.astype(np.float64))
    slippery = 1.0 if math.isnan(friction) else min(friction / total.friction, 1.0)
    allowed = slippery * total.lateral_acceleration_cap * share / speed
    yaw_rate = np.array([found(float(v), float(angle), friction) for v, angle in zip(speed, front_angle, strict=True)])
    # Rounding moves a position, and with it a share, as `lookup.error_bound` counts.
    off = error_bound(total, built.real)
    assert (yaw_rate <= allowed + off).all()
    assert np.mean(np.abs(yaw_rate - allowed) <= off) > 0.5


def _interpolated(grip: GripTable, speed: np.ndarray, front_angle: np.ndarray) -> np.ndarray:
    """Return the shares at pairs of a speed and a front angle."""
    corners, weights = [], []
    for axis, x in ((grip.speed, speed), (grip.front_angle, front_angle)):
        cell = np.clip(np.searchsorted(axis, x, side="right") - 1, 0, axis.size - 2)
        corners.append(cell)
        weights.append((x - axis[cell]) / (axis[cell + 1] - axis[cell]))
    (i, j), (u, w) = corners, weights
    along = [(1.0 - u) * grip.share[i, j + k] + u * grip.share[i + 1, j + k] for k in (0, 1)]
    return np.asarray((1.0 - w) * along[0] + w * along[1])


def _changed(which: tuple[Kind, Precision, Storage, Which], path: str, old: str, new: str) -> Software:
    """Return a placed build with the last occurrence of a text in its C changed."""
    folder = placed(*which)[0].built.folder
    head, found, tail = folder.files[path].decode("ascii").rpartition(old)
    assert found
    return compile_build({**folder.files, path: f"{head}{new}{tail}".encode("ascii")}, folder.manifest)


@pytest.mark.long
@pytest.mark.parametrize("share", ["1.5f", "(0.0f / 0.0f)", "-1.0f"])
def test_a_share_that_flash_lost_fails_the_self_test_and_lifts_no_cap(share: str) -> None:
    built = placed(*PLACED[5])[0].built
    text = built.folder.files["src/ars_map.c"].decode("ascii")
    begin = text.index("grip_share_table[")
    numbers = list(re.compile(r"\d\.\d+f").finditer(text, begin, text.index("};", begin)))
    lost = numbers[len(numbers) // 2]
    files = {**built.folder.files, "src/ars_map.c": (text[: lost.start()] + share + text[lost.end() :]).encode("ascii")}
    software = compile_build(files, built.folder.manifest)
    assert not software.function("selftest")()
    speed, front_angle = np.meshgrid(np.linspace(1.0, 40.0, 120), np.linspace(0.0, 0.7, 120))
    yaw_rate = software.map_yaw_rate(speed.astype(np.float32), front_angle.astype(np.float32))
    assert (yaw_rate * speed <= built.total.lateral_acceleration_cap).all()
    assert (yaw_rate >= 0.0).all()


@pytest.mark.long
@pytest.mark.parametrize(
    ("number", "old", "new"),
    [
        (7, "road->lateral_acceleration_max * share;", "road->lateral_acceleration_max;"),
        (7, "locate_grip_speed(speed), locate_grip", "locate_speed(speed), locate_grip"),
        (
            7,
            "interpolate_grip(grip_share_table[road->layer.lower + 1u]",
            "interpolate_grip(grip_share_table[road->layer.lower]",
        ),
        (7, "grip_share_scale = ", "grip_share_scale = 1.01f * "),
        (1, "return (float)raw * scale;", "return (float)(raw + 1) * scale;"),
    ],
)
def test_a_fault_in_a_placed_look_up_is_seen(number: int, old: str, new: str) -> None:
    original, _ = placed(*PLACED[number])
    software = _changed(PLACED[number], "src/ars_map.c", old, new)
    speed, angle = np.meshgrid(np.linspace(1.0, 40.0, 50), np.linspace(0.0, 0.7, 50))
    arguments = speed.astype(np.float32), angle.astype(np.float32), 0.55
    assert not np.array_equal(software.map_yaw_rate(*arguments), original.built.lookup(*arguments))


def test_a_negative_entry_is_invalid() -> None:
    software = _changed(PLACED[1], "src/ars_calibration.c", f" {RAW_MAX}", f" -{RAW_MAX}")
    assert not software.function("map_valid")()
    assert not software.function("selftest")()


def test_the_self_test_covers_each_number_of_a_stack() -> None:
    """One number of a layer of either table, and a friction of the stack, off by the smallest step."""
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
    code = folder.files["src/ars_map.c"].decode("ascii")
    assert code.count("0.2f, 0.21f, 0.6f, 0.9f") == 1
    changed.append(("src/ars_map.c", code.replace("0.2f, 0.21f, 0.6f, 0.9f", "0.2f, 0.21000002f, 0.6f, 0.9f")))
    for path, wrong_text in changed:
        faulty = replace(folder, files={**folder.files, path: wrong_text.encode("ascii")})
        assert not compile_build(faulty.files, faulty.manifest).selftest()

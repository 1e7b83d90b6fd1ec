"""The `.npz` contract: valid content, rejected content with its message, and atomic, repeatable saving."""

import io
import json
import math
import os
import stat
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen import configuration, load_map
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.write import write_folder
from codegen.errors import MapError
from codegen.importing.toml_edit import whole
from codegen.judgement.facts import check_path
from codegen.map_file import archive
from codegen.map_file import map as refmap
from codegen.map_file.bounds import Binding
from codegen.map_file.map import ReferenceMap, choose_config
from codegen.optimum.solve import solve_case

Arrays = dict[str, Any]
Change = Callable[[Arrays], None]
CONFIG = configuration.preset()
TABLES = ("speed", "front_angle", "yaw_rate", "feasible", "sideslip", "rear_angle", "active")


def plain_arrays() -> Arrays:
    """Return a small map from another tool: 4 speeds, 3 front angles, the passive car with a cap at 5 m/s^2."""
    speed = np.array([5.0, 10.0, 20.0, 30.0])
    front_angle = np.array([0.01, 0.05, 0.1])
    yaw_rate = np.minimum(np.outer(speed / 3.14, front_angle), 5.0 / speed[:, np.newaxis])
    return {"vx": speed, "delta_f": front_angle, "yaw_rate": yaw_rate}


def solved_arrays() -> Arrays:
    """Return the same map with everything that the optimisation adds; the last cell is infeasible."""
    arrays = plain_arrays()
    feasible = np.ones((4, 3), dtype=bool)
    feasible[3, 2] = False
    arrays["yaw_rate"][3, 2] = np.nan
    arrays["beta"] = np.where(feasible, -0.02, np.nan)
    arrays["delta_r"] = np.where(feasible, 0.03, np.nan)
    arrays["feasible"] = feasible
    arrays["active"] = np.where(feasible, int(Binding.SLIP_FRONT | Binding.SLIP_REAR), 0).astype(np.uint8)
    arrays["meta"] = np.array(json.dumps(refmap.make_meta(CONFIG, "4ws-2", "exact")))
    return arrays


def solved_map() -> ReferenceMap:
    return refmap.from_arrays(solved_arrays(), "test")


def write(path: Path, arrays: Arrays) -> Path:
    np.savez(path, **arrays)
    return path


def packed(members: list[tuple[str, bytes]], compression: int = zipfile.ZIP_STORED) -> bytes:
    """Return an archive with these members."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about a duplicate name
        for name, data in members:
            file.writestr(name, data)
    return stream.getvalue()


def npy(array: Any) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.asarray(array), allow_pickle=True)
    return stream.getvalue()


PLAIN = [(f"{key}.npy", npy(array)) for key, array in plain_arrays().items()]


def test_three_arrays_are_a_map(tmp_path: Path) -> None:
    arrays = plain_arrays()
    loaded = refmap.load(write(tmp_path / "map.npz", arrays))
    for values, key in ((loaded.speed, "vx"), (loaded.front_angle, "delta_f"), (loaded.yaw_rate, "yaw_rate")):
        np.testing.assert_array_equal(values, arrays[key])
    assert loaded.feasible.dtype == np.bool_ and loaded.feasible.shape == (4, 3) and loaded.feasible.all()
    assert (loaded.sideslip, loaded.rear_angle, loaded.active, loaded.config, loaded.case) == (None,) * 5
    assert loaded.meta == {} and not loaded.solved


def test_a_solved_map_is_read_completely() -> None:
    arrays = solved_arrays()
    loaded = refmap.from_arrays(arrays, "test")
    for name, key in zip(TABLES, ("vx", "delta_f", "yaw_rate", "feasible", "beta", "delta_r", "active"), strict=True):
        np.testing.assert_array_equal(getattr(loaded, name), arrays[key])
        with pytest.raises(ValueError, match="read-only"):
            getattr(loaded, name)[...] = 0
        assert arrays[key].flags.writeable
    assert loaded.active is not None and loaded.active.dtype == np.uint8
    assert (loaded.config, loaded.case, loaded.tyre_model) == (CONFIG, "4ws-2", "linear")
    assert loaded.meta["method"] == "exact" and loaded.solved


@pytest.mark.parametrize("dtype", ["<f4", ">f8", np.longdouble, np.uint8, ">i2"])
def test_numbers_of_any_kind_order_and_compression_become_float64(dtype: Any, tmp_path: Path) -> None:
    """Infeasible cells may have any content."""
    arrays = solved_arrays()
    arrays["vx"], arrays["feasible"] = arrays["vx"].astype(dtype), arrays["feasible"].astype(dtype)
    arrays["yaw_rate"][3, 2], arrays["beta"][3, 2] = np.inf, 1e9
    arrays["yaw_rate"] = np.asfortranarray(arrays["yaw_rate"])
    np.savez_compressed(tmp_path / "map.npz", **arrays)
    loaded = refmap.load(tmp_path / "map.npz")
    np.testing.assert_array_equal(loaded.speed, arrays["vx"].astype(np.float64))
    np.testing.assert_array_equal(loaded.yaw_rate, solved_map().yaw_rate)
    np.testing.assert_array_equal(loaded.sideslip, solved_map().sideslip)
    assert loaded.speed.dtype == loaded.yaw_rate.dtype == np.dtype("=f8")
    assert loaded.feasible.tolist() == solved_map().feasible.tolist()


def test_another_key_in_a_table_without_meta_is_ignored_with_a_note(tmp_path: Path) -> None:
    np.savez(tmp_path / "map.npz", **plain_arrays(), notes=np.array([{"a": 1}], dtype=object))
    loaded = refmap.load(tmp_path / "map.npz")
    assert loaded.ignored == ("notes",)
    assert "notes: not a key of a map; ignored" in choose_config(loaded, None).notes
    assert load_map(tmp_path / "map.npz").notes == ("notes: not a key of a map; ignored",)
    refmap.save(loaded, tmp_path / "saved.npz")
    assert refmap.load(tmp_path / "saved.npz").ignored == ()


@pytest.mark.parametrize("name", ["notes", "mata", "xmeta.npy"])
def test_another_key_in_a_map_with_meta_is_rejected(name: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "map.npz", **solved_arrays(), **{name: np.zeros(1)})
    with pytest.raises(MapError, match=f"{name}: not a key of a map"):
        refmap.load(tmp_path / "map.npz")


def test_no_flipped_bit_in_the_name_of_a_member_turns_a_solved_map_into_another_one(tmp_path: Path) -> None:
    whole = refmap.to_bytes(solved_map())
    expected = solved_map().meta
    for name in (b"meta.npy", b"active.npy", b"feasible.npy", b"beta.npy"):
        at = whole.rindex(name)  # in the directory at the end, which decides
        for place in range(at, at + len(name)):
            for bit in range(8):
                damaged = bytearray(whole)
                damaged[place] ^= 1 << bit
                with pytest.raises(MapError):
                    refmap.from_bytes(bytes(damaged), tmp_path / "map.npz")
    assert refmap.from_bytes(whole, "whole").meta == expected


def cell(key: str, index: Any, value: float) -> Change:
    return lambda arrays: arrays[key].__setitem__(index, value)


def put(key: str, value: Callable[[Any], Any]) -> Change:
    return lambda arrays: arrays.__setitem__(key, value(arrays[key]))


def drop(key: str) -> Change:
    return lambda arrays: arrays.__delitem__(key)


def meta_with(**changes: Any) -> Change:
    """Replace top-level keys of meta; `...` removes one."""

    def new(array: Any) -> Any:
        meta = json.loads(array.item()) | changes
        return np.array(json.dumps({key: value for key, value in meta.items() if value is not ...}))

    return put("meta", new)


def text_meta(text: Any) -> Change:
    return put("meta", lambda _: np.array(text))


REFUSED: list[tuple[Change, str, str, str]] = [
    # (change, place after the file name, words of the fault, words of the remedy)
    (drop("delta_f"), "delta_f", "missing", "rad; the file holds vx, yaw_rate"),
    (put("yaw_rate", lambda a: a.astype(object)), "yaw_rate", "never read", "numpy.savez"),
    (put("yaw_rate", lambda a: a + 0j), "yaw_rate", "complex values", "plain numbers"),
    (put("vx", lambda a: a.astype(str)), "vx", "text values", "plain numbers"),
    (put("vx", lambda a: a[:, None]), "vx", "one dimension", "ravel"),
    (put("vx", lambda a: a[:1]), "vx", "1 points", "at least two"),
    (put("yaw_rate", lambda a: a.T), "yaw_rate", "(3, 4), where (4, 3)", "transpose"),
    (put("delta_r", lambda a: a[..., None]), "delta_r", "shape (4, 3, 1)", "a row for each vx"),
    (cell("vx", 2, math.nan), "vx[2]", "nan on an axis", "finite"),
    (cell("yaw_rate", (1, 2), math.nan), "yaw_rate[1, 2]", "nan in a feasible cell", "false in an array 'feasible'"),
    (cell("delta_r", (2, 1), -math.inf), "delta_r[2, 1]", "-inf in a feasible cell", "mark the cell"),
    (cell("vx", 2, 9.0), "vx[2]", "9 is not above the breakpoint before it (10)", "sort"),
    (cell("vx", 0, -5.0), "vx[0]", "-5 is outside 0 to 150 m/s", "reverse"),
    (cell("delta_f", 0, -0.01), "delta_f[0]", "outside 0 to 1.2 rad", "symmetric"),
    (put("vx", lambda a: a * 7.2), "vx[3]", "216 is outside", "km/h, divide by 3.6"),
    (put("delta_f", np.rad2deg), "delta_f[1]", "2.86479 is outside", "multiply by pi/180"),
    (put("yaw_rate", lambda a: a * 60), "yaw_rate[1, 2]", "outside 0 to 10 rad/s", "pi/180"),
    (put("yaw_rate", lambda a: np.rad2deg(a) / 2.0), "yaw_rate[1, 2]", " g of lateral acceleration, above 5 g", "deg/s"),
    (put("delta_r", np.rad2deg), "delta_r[0, 0]", "1.71887 is outside -0.5 to 0.5 rad", "multiply by pi/180"),
    (put("feasible", lambda a: a * 2.0), "feasible[0, 0]", "2 is neither true nor false", "booleans"),
    (put("active", lambda a: a + np.uint16(256)), "active[0, 0]", "is no set", "0 to 255"),
    (put("meta", lambda _: np.zeros(3)), "meta", "numeric of shape (3,)", "json.dumps"),
    (text_meta('{"schema_version": NaN}'), "meta", "NaN is no JSON number", "leave the key out"),
    (text_meta('{"case": '), "meta", "not JSON text", "leave the key out"),
    (meta_with(schema_version=...), "meta.schema_version", "None is not a version", "leave the key"),
    (meta_with(configuration={"vehicle": {"mass_kg": -1}}), "meta.configuration: vehicle.mass_kg", "-1 is outside", "check"),
    (meta_with(case="4ws-3"), "meta.case", "no case '4ws-3'", "did you mean '4ws-"),
    (meta_with(case="a*/b", configuration=...), "meta.case", "not allowed in C", "ASCII letters"),
]


def fail_with(error: BaseException) -> None:
    raise error


def check_refused(path: Path, place: str, fault: str, remedy: str) -> None:
    """Check that loading fails with one line that starts with the file name, and leaves the file unchanged."""
    with pytest.raises(MapError) as caught:
        refmap.load(path)
    error = caught.value
    assert "\n" not in str(error)
    assert error.where == (f"{path}: {place}" if place else str(path))
    assert fault in error.what and remedy in error.remedy


@pytest.mark.parametrize(("change", "place", "fault", "remedy"), REFUSED)
def test_refused_with_place_and_remedy(change: Change, place: str, fault: str, remedy: str, tmp_path: Path) -> None:
    arrays = solved_arrays()
    change(arrays)
    check_refused(write(tmp_path / "map.npz", arrays), place, fault, remedy)


def test_unreadable_files_are_rejected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check_refused(tmp_path / "none.npz", "", "No such file", "codegen solve")
    check_refused(tmp_path, "", "not a file", ".npz")
    os.mkfifo(tmp_path / "pipe.npz")  # opening it would wait for a writer
    check_refused(tmp_path / "pipe.npz", "", "not a file", ".npz")
    path = write(tmp_path / "map.npz", plain_arrays())
    # Removing the permission would not stop root.
    monkeypatch.setattr(Path, "open", lambda *_: fail_with(PermissionError(13, "Permission denied")))
    check_refused(path, "", "Permission denied", "path")


def changed_bytes(data: bytes, signature: bytes, offset: int, new: bytes) -> bytes:
    """Return data with bytes replaced at an offset from the first occurrence of a signature."""
    start = data.index(signature) + offset
    return data[:start] + new + data[start + len(new) :]


DAMAGED: list[tuple[bytes, str, str]] = [
    # (file, place, words of the fault); headers are damaged in tests/property
    (b"", "", "not an .npz file"),
    (changed_bytes(packed(PLAIN), plain_arrays()["yaw_rate"].tobytes(), 0, b"\xff"), "yaw_rate", "CRC"),
    (packed([*PLAIN, PLAIN[0]]), "vx", "twice"),
    (packed(PLAIN, zipfile.ZIP_BZIP2), "vx", "compressed in a way"),
    (changed_bytes(packed(PLAIN), b"PK\x01\x02", 8, b"\x01"), "vx", "encrypted"),
    (packed([("vx.npy", b"not npy at all"), *PLAIN[1:]]), "vx", "damaged"),
]


@pytest.mark.parametrize(("data", "place", "fault"), DAMAGED, ids=range(len(DAMAGED)))
def test_damaged_files_are_refused(data: bytes, place: str, fault: str, tmp_path: Path) -> None:
    (tmp_path / "map.npz").write_bytes(data)
    check_refused(tmp_path / "map.npz", place, fault, "")


def test_over_64_mib_unpacked_is_refused_from_the_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file has a few kilobytes and unpacks to 65 MiB: it is rejected before anything is unpacked, whatever the key."""
    path = tmp_path / "map.npz"
    path.write_bytes(packed([*PLAIN, ("extra.npy", bytes(65 * 2**20))], zipfile.ZIP_DEFLATED))
    monkeypatch.setattr(zipfile.ZipFile, "open", None)
    check_refused(path, "", "over 64 MiB unpacked", "fewer breakpoints")


@pytest.mark.parametrize("arrays", [plain_arrays, solved_arrays])
def test_round_trip(arrays: Callable[[], Arrays], tmp_path: Path) -> None:
    first, path = refmap.from_arrays(arrays(), "test"), tmp_path / "map.npz"
    path.write_bytes(b"old")
    refmap.save(first, path)
    second = refmap.load(path)
    for name in TABLES:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert (first.config, first.case, first.meta, first.solved) == (second.config, second.case, second.meta, second.solved)
    (tmp_path / "other").write_bytes(b"")
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE((tmp_path / "other").stat().st_mode)
    assert sorted(os.listdir(tmp_path)) == ["map.npz", "other"]


def test_the_same_map_gives_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The file is independent of the clock, the memory layout, the sign of a NaN and the order of meta."""
    first = solved_map()
    assert first.sideslip is not None
    meta = dict(reversed(list(first.meta.items())))
    yaw_rate = np.asfortranarray(np.where(first.feasible, first.yaw_rate, np.copysign(np.nan, -1.0)))
    second = replace(first, yaw_rate=yaw_rate, sideslip=first.sideslip.astype(">f8"), meta=meta)
    expected = refmap.to_bytes(first)
    monkeypatch.setattr("time.time", lambda: 2e9)
    monkeypatch.setattr("time.localtime", lambda *_: (2033, 5, 18, 3, 33, 20, 2, 138, 0))
    assert refmap.to_bytes(second) == expected


@pytest.mark.parametrize("failing", ["os.fsync", "os.replace"])
@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_failed_save_leaves_the_old_file(
    failing: str, failure: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "map.npz"
    path.write_bytes(b"old")
    monkeypatch.setattr(failing, lambda *_: fail_with(failure))
    with pytest.raises(MapError if isinstance(failure, OSError) else KeyboardInterrupt, match=r"No space left.*space|^$"):
        refmap.save(solved_map(), path)
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["map.npz"]
    with pytest.raises(MapError, match=r"none/map\.npz: .*cannot be written.*folder"):
        refmap.save(solved_map(), tmp_path / "none" / "map.npz")


def test_a_map_that_breaks_the_contract_is_not_saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    yaw_rate = np.array(solved_map().yaw_rate)
    yaw_rate[1, 1] = np.nan
    with pytest.raises(MapError, match=r"^the map to save: yaw_rate\[1, 1\]: "):
        refmap.save(replace(solved_map(), yaw_rate=yaw_rate), tmp_path / "map.npz")
    assert os.listdir(tmp_path) == []
    with pytest.raises(MapError, match="make_meta"):
        refmap.to_bytes(replace(solved_map(), case="fws"))
    monkeypatch.setattr(archive, "UNPACKED_BYTES_MAX", len(refmap.to_bytes(solved_map())) // 2)
    with pytest.raises(MapError, match="fewer breakpoints"):
        refmap.to_bytes(solved_map())


def test_a_map_that_leaves_its_grip_unused_has_a_note(tmp_path: Path) -> None:
    """Of the map, where there is one, and else of all cases; the build and its check have it too."""
    note = (
        "without limits.grip_use_max, a map of the nonlinear tyre ({}) keeps to its linear range; "
        "set the key, such as 0.98, to use its grip"
    )
    small = {"grid": {"speed_points": 3, "front_angle_points": 3}}
    config = configuration.preset().with_tyre_model("magic-formula").replace(small)
    file, path, folder = tmp_path / "ars.toml", tmp_path / "map.npz", tmp_path / "build"
    file.write_text(whole(config, "a test"), encoding="utf-8")
    solved = solve_case(config, "4ws-2")
    refmap.save(solved, path)
    assert choose_config(None, file).notes == (note.format("fws, 4ws-1, 4ws-2"),)
    mine = note.format("4ws-2")
    assert choose_config(solved, None).notes == choose_config(solved, file).notes == (mine,)
    write_folder(build(solved, config, BuildOptions("test"), BuildInputs("map.npz", "0" * 64, "map")), folder)
    assert mine in check_path(path).notes and mine in check_path(folder).notes and mine not in check_path(path).warnings
    for other in (configuration.preset("recommended"), configuration.preset()):
        assert choose_config(solve_case(other.replace(small), "4ws-2"), None).notes == ()

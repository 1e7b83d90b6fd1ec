"""Damaged files: every loader reads them or rejects them in one line. `make evidence PART=loaders` tests 100,000 cases."""

import functools
import json
import operator
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.hostile_files import HOSTILE
from tests.loader_cases import Loader, damaged, fault_apart, fault_of, fault_of_file, loaders

CASES = 30
"""Cases for each loader of full weight."""
LOADERS = loaders()
DELETED = object()


@pytest.mark.parametrize("name", LOADERS)
def test_damaged_files_are_read_or_rejected_in_one_line(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    loader, generator = LOADERS[name], np.random.default_rng(1)
    path = tmp_path / loader.name
    path.write_bytes(loader.seed)
    if loader.weight > 0.1:  # the tests of slow readers read sound files
        loader.load(path)
    for case in range(max(1, round(CASES * loader.weight))):
        assert fault_of(loader, damaged(loader.seed, generator), tmp_path) == "", case
    assert capfd.readouterr().err == "", "output of a reader in addition to its error"


def test_a_manifest_with_a_missing_or_mistyped_entry_is_read_or_rejected_in_one_line(tmp_path: Path) -> None:
    loader = LOADERS["manifest"]
    for path in entries(json.loads(loader.seed)):
        for value in (DELETED, [], "x", None, 1e308, -1):
            manifest = json.loads(loader.seed)
            *above, last = path
            inside = functools.reduce(operator.getitem, above, manifest)
            if value is DELETED:
                del inside[last]
            else:
                inside[last] = value
            assert fault_of(loader, json.dumps(manifest).encode(), tmp_path) == "", (path, value)


def entries(found: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every entry down to the third level; of lists and files only the first.

    The configuration is left out, because its keys have tests of their own, and so are symbols.
    """
    items = list(found.items() if isinstance(found, dict) else enumerate(found[:1]) if isinstance(found, list) else ())
    for key, inside in items[:1] if path == ("files",) else items:
        yield (*path, key)
        if len(path) < 2 and key not in ("configuration", "symbols"):
            yield from entries(inside, (*path, key))


def test_pipes_devices_endless_lines_and_links_to_themselves_are_rejected_in_one_line(tmp_path: Path) -> None:
    for name in ("run.parquet", "run.mf4", "bus.asc", "bus.log", "bus.blf", "faults.json"):
        loader = next(each for each in LOADERS.values() if each.name == name)
        path = tmp_path / name
        os.mkfifo(path)
        assert fault_of_file(loader, path) == ""
        path.unlink()
        path.symlink_to("/dev/zero")
        assert fault_of_file(loader, path) == ""
        path.unlink()
        path.symlink_to(path.name)
        assert fault_of_file(loader, path) == ""
        path.unlink()
        with path.open("wb") as file:
            file.truncate(2**23 if name.endswith(("asc", "log")) else 2**33)
        assert fault_of_file(loader, path) == ""


QUICK = ("BLF, zeros", "BLF, endless object", "CDF, default values", "CDF, entities", "ARXML, default values", "ELF, types")
QUICK += ("S-record, pieces",)
"""Kinds that take no second to make. The evidence has all, and the sizes of others."""


@pytest.mark.parametrize("kind", QUICK)
def test_hostile_files_are_rejected_within_their_limits(kind: str, tmp_path: Path) -> None:
    hostile = HOSTILE[kind]
    size = 0.02 if kind == "S-record, pieces" else 1.0
    assert fault_apart(LOADERS[hostile.loader], hostile.make(size), tmp_path) == ""


def crash(_: Path) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def work_for_ever(_: Path) -> None:
    while True:
        pass


@pytest.mark.parametrize(("load", "fault"), [(crash, "ended by signal 9"), (work_for_ever, "HangError: no "), (str, "took 0.")])
def test_a_crash_endless_work_and_much_memory_are_faults(
    load: Any, fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.loader_cases.HANG_S", 1)
    monkeypatch.setattr("tests.loader_cases.MEMORY_BYTES", 10**6)
    assert fault_apart(Loader("file", b"", load), b"content", tmp_path).startswith(fault)

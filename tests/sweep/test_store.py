"""The folder of a campaign: parts are removed only when the file is on the disk, and damage is reported."""

from __future__ import annotations

import os
import shutil
import stat
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from codegen.errors import CodegenError
from codegen.sweep import store
from codegen.sweep.plan import Plan
from tests.sweep.conftest import damage


def stored_parts(folder: Path, plan: Plan) -> None:
    """Store the parts of a campaign that nobody drove."""
    store.prepare(folder)
    store.open_folder(folder, plan)
    for chunk in range(plan.chunk_count):
        samples = np.array(plan.samples_of(chunk))
        none = np.zeros(samples.size, dtype=int)
        table = {"run": samples, "sample": samples, "scenario": none, "controller": none, "spun_at_s": np.sqrt(samples)}
        store.save_part(folder, chunk, {**table, "settled": samples % 2.0}, plan)


def test_the_file_is_on_the_disk_before_its_parts_go(plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stored_parts(tmp_path, plan)
    happened: list[str] = []
    synced: list[int] = []
    fsync, replace, remove = os.fsync, os.replace, shutil.rmtree

    def noted_fsync(descriptor: int) -> None:
        status = os.fstat(descriptor)
        happened.append("sync folder" if stat.S_ISDIR(status.st_mode) else "sync file")
        synced.append(status.st_ino)
        fsync(descriptor)

    def noted_replace(source: Path, target: Path) -> None:
        happened.append("replace")
        replace(source, target)

    def noted_remove(*given: Any, **options: Any) -> None:
        happened.append("remove parts")
        remove(*given, **options)

    monkeypatch.setattr(os, "fsync", noted_fsync)
    monkeypatch.setattr(os, "replace", noted_replace)
    monkeypatch.setattr(shutil, "rmtree", noted_remove)
    target = store.merge(tmp_path, plan)
    assert happened == ["sync file", "replace", "sync folder", "remove parts"]
    assert synced == [target.stat().st_ino, tmp_path.stat().st_ino]


@pytest.mark.parametrize("content", [b"\xff\xfe{}", b"{", b"[" * 1_000_000])
def test_unreadable_facts_are_another_campaign(plan: Plan, tmp_path: Path, content: bytes) -> None:
    (tmp_path / store.FACTS).write_bytes(content)
    for refuse in (store.open_folder, store.check_same):
        with pytest.raises(CodegenError, match=r"it holds another campaign: campaign\.json has been changed since"):
            refuse(tmp_path, plan)


def test_a_damaged_page_is_reported(plan: Plan, tmp_path: Path) -> None:
    stored_parts(tmp_path / "out", plan)
    path = store.merge(tmp_path / "out", plan)
    content, metadata = path.read_bytes(), pq.read_metadata(path)
    assert len(list(store.read_batches(path))) == metadata.num_row_groups == 1
    for place in range(metadata.num_columns):
        damage(path, place)
        with pytest.raises(CodegenError, match=r"runs\.parquet: it is damaged; remove it, and run the same command again"):
            list(store.read_batches(path))
        path.write_bytes(content)

"""Damaged files: every loader reads them or rejects them in one line. `make evidence PART=loaders` tests 100,000 cases."""

from pathlib import Path

import numpy as np
import pytest

from tests.loader_cases import damaged, fault_of, loaders

CASES = 60
"""Cases for each loader of full weight."""
LOADERS = loaders()


@pytest.mark.parametrize("name", LOADERS)
def test_damaged_files_are_read_or_rejected_in_one_line(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    loader, generator = LOADERS[name], np.random.default_rng(1)
    path = tmp_path / loader.name
    path.write_bytes(loader.seed)
    loader.load(path)
    for case in range(max(2, round(CASES * loader.weight))):
        assert fault_of(loader, damaged(loader.seed, generator), tmp_path) == "", case
    assert capfd.readouterr().err == "", "output of a reader in addition to its error"

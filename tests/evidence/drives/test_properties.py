"""The property tests of loaders with more examples than in the fast tier."""

from pathlib import Path

import pytest
from hypothesis import settings

from tests.property import test_archives as archives
from tests.property import test_toml as toml
from tests.property.guard import examples

pytestmark = pytest.mark.long

TestChangedArchive = type("TestChangedArchive", (archives.ChangedArchive.TestCase,), {})
TestChangedArchive.settings = settings(max_examples=240, stateful_step_count=8, deadline=None)
test_wrong_headers = examples(archives.check_header, 800, **archives.HEADER_INPUTS)


def test_changed_texts(tmp_path: Path) -> None:
    toml.check_changed_texts(tmp_path, 240)


@pytest.mark.parametrize("name", toml.LOADERS)
def test_many_tables(name: str, tmp_path: Path) -> None:
    toml.check(tmp_path / "fuzz.toml", b"[[a]]\n" * 150_000, toml.LOADERS[name][0])

"""The generated self-test alone, with stand-ins for all that it asks."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from codegen.sil.compile import compile_library
from tests import builds
from tests.sil.checks_selftest import CHECKS, PATH, STUBS, Alone

Check = Callable[[Alone], None]


def alone(old: str = "", new: str = "") -> Alone:
    """The self-test of the paper's build with its stand-ins, one place of it changed."""
    folder = builds.paper().folder
    if old:
        folder = builds.altered_folder(folder, PATH, old, new)
    sources = {path: content for path, content in folder.files.items() if path.startswith("include/") or path == PATH}
    headers = ["include/ars_controller.h", "include/ars_e2e.h", "include/ars_map.h", "stub/stub.h"]
    library = compile_library("ars_selftest", {**sources, **STUBS}, headers, include_folders=("include", "stub"), mode="abi")
    return Alone.of(library, folder)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_selftest_alone(check: Check) -> None:
    check(alone())


@pytest.mark.parametrize(
    ("check", "old", "new"),
    [
        (CHECKS[0], "tolerance = 1.0e-05f", "tolerance = -1.0e-05f"),
        (CHECKS[1], "== 0xCCu;", "!= 0u;"),
        (CHECKS[1], "&& ars_parameters_valid(&ars_parameters_default)", ""),
        (CHECKS[2], "tolerance = 1.0e-05f", "tolerance = 1.1e-05f"),
        (CHECKS[2], "passed = passed &&", "passed ="),
        (CHECKS[3], "if (ars_map_expected_checksum == 0x", "if (ars_map_expected_checksum != 0x"),
        (CHECKS[3], "&& (ars_map_checksum() == ars_map_expected_checksum)", ""),
    ],
)
def test_a_fault_in_it_is_seen(check: Check, old: str, new: str) -> None:
    with pytest.raises(AssertionError):
        check(alone(old, new))

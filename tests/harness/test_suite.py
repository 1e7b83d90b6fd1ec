"""Which tests judge: all of a module for all of their parameters, none by a name that is gone; and the sanitized program."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from codegen.sil.toolchain import compiler_command
from tests.builds import Built
from tests.evidence.part import FOLDERS
from tests.sil import (
    checks_tracking,
    suite,
    test_closed_loop,
    test_controller,
    test_edges_task,
    test_faults_in_the_loop,
    test_supervision,
    test_task,
)
from tests.sil.case import Case, case_of
from tests.sil.library import Compiler
from tests.sil.suite_memory import check_memory
from tests.sil.tests_of import each_test

MODULES = (test_closed_loop, test_controller, test_edges_task, test_faults_in_the_loop, test_supervision, test_task)


def made(tmp_path: Path, number: int = 0, **changed: str) -> Case:
    """A committed build, one place of a unit changed: the text before and after " -> "."""
    folder = FOLDERS[number]
    files = {}
    for unit, change in changed.items():
        path, (old, new) = f"src/ars_{unit}.c", change.split(" -> ")
        text = (folder / path).read_text(encoding="ascii")
        assert text.count(old) == 1, f"{path} holds {text.count(old)} times: {old}"
        files[path] = text.replace(old, new).encode()
    return case_of(folder, tmp_path, Compiler(compiler_command()), files)


class Sample(ModuleType):
    """A module of tests."""

    seen: list[object]


@pytest.fixture
def sample() -> Sample:
    module = Sample("sample")
    seen: list[object] = []
    module.seen = seen

    def test_plain() -> None:
        seen.append("plain")

    @pytest.mark.parametrize("one", [1, pytest.param(2, id="two")])
    @pytest.mark.parametrize(("left", "right"), [("a", "b"), ("c", "d")])
    def test_many(either: object, one: int, left: str, right: str) -> None:
        seen.append((either, one, left, right))

    def test_asks_for_more(tmp_path: Path) -> None:
        raise NotImplementedError

    class TestClass:
        def test_inside(self, paper: object) -> None:
            seen.append(("inside", paper))

    for value in (test_plain, test_many, test_asks_for_more, TestClass):
        setattr(module, value.__name__, value)
    return module


def test_each_test_is_called_for_all_of_its_parameters(sample: Sample, monkeypatch: pytest.MonkeyPatch) -> None:
    built: Built = object()  # type: ignore[assignment]
    for _, test in each_test(sample):
        test(built)
    many = {(built, one, left, right) for one in (1, 2) for left, right in (("a", "b"), ("c", "d"))}
    assert set(map(str, sample.seen)) == set(map(str, {"plain", ("inside", built), *many}))
    names = [name for name, _ in each_test(sample, but=("many",))]
    assert names == ["test_plain", "TestClass.test_inside"]


@pytest.mark.parametrize("left_out", [*suite.NOT_OF_ONE_BUILD, *suite.OF_THE_PAPER_S_LAW])
def test_what_is_left_out_is_there(left_out: str) -> None:
    """By another name it would be asked, or be left out unseen."""
    assert len(left_out) > 5
    assert any(left_out in name for name, _ in each_test(*MODULES)) or any(left_out in dir_name(module) for module in MODULES)


def dir_name(module: ModuleType) -> str:
    """Names of all that a module and its classes hold."""
    inner = [name for value in vars(module).values() if isinstance(value, type) for name in vars(value)]
    return " ".join([*vars(module), *inner])


@pytest.mark.parametrize("left_out", suite.OF_THE_TESTS_OWN_SCHEDULE)
def test_what_is_left_out_of_the_checks_is_there(left_out: str) -> None:
    assert hasattr(checks_tracking, left_out)


@pytest.mark.parametrize("number", [0, 1])
def test_the_sanitized_program_passes(number: int, tmp_path: Path) -> None:
    check_memory(made(tmp_path, number))


@pytest.mark.parametrize(
    ("number", "changed"),
    [
        (0, {"map": "place->row.lower + 1u] -> place->row.lower + 2u]"}),
        (0, {"can": "index < 8u -> index < 9u"}),
        (0, {"dynamics": "column < 4u -> column < 5u"}),
        (1, {"reference_model": "= cells - 1u; -> = cells;"}),
        (1, {"controller": "k < ((uint32_t)ARS_SCHEDULE_POINTS - 1u) -> k < (uint32_t)ARS_SCHEDULE_POINTS"}),
    ],
)
def test_the_sanitized_program_sees_an_address_out_of_bounds(number: int, changed: dict[str, str], tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=r"ERROR|runtime error"):
        check_memory(made(tmp_path, number, **changed))


def test_most_tests_are_asked(tmp_path: Path) -> None:
    """How many judges a build has: fewer would be a slip."""
    for number, least in ((0, 190), (1, 140)):
        case = made(tmp_path / str(number), number)
        case.compiler.compile_all(case.tree)
        case.open(tmp_path / f"{number}.so")
        assert len(suite.whole(case)) >= least

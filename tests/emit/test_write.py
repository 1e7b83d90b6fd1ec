"""Writing a generated folder: complete or not at all, without touching files of the user."""

import errno
import itertools
import json
import os
import shutil
import signal
import stat
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from codegen.emit import write
from codegen.emit.folder import (
    MANIFEST,
    MANIFEST_BYTES_MAX,
    VERIFICATION_FILES,
    Folder,
    differences,
    read_manifest,
    render_manifest,
    verify_hashes,
)
from codegen.emit.write import write_folder
from codegen.errors import BuildError

OLD = Folder({"README.md": b"old\n", "src/ars_map.c": b"int a;\n", "src/gone.c": b"int gone;\n"}, {"prefix": "ars"})
NEW = Folder({"README.md": b"new\n", "src/ars_map.c": b"int b;\n", "include/deep/ars.h": b"/* */\n"}, {"prefix": "ars"})

Tree = dict[str, bytes | str | None]


def tree(folder: Path) -> Tree:
    """Return the content of `folder`: bytes of files, targets of links, None for folders."""
    found: Tree = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink():
            found[name] = os.readlink(path)
        else:
            found[name] = None if path.is_dir() else path.read_bytes()
    return found


def expected(folder: Folder, siblings: dict[str, bytes] | None = None) -> Tree:
    files: Tree = {**folder.content(), **(siblings or {})}
    return dict.fromkeys((str(parent) for path in folder.files for parent in Path(path).parents[:-1]), None) | files


def stamps(folder: Path) -> dict[str, tuple[int, int, int]]:
    """Return inode and times of `folder` and its content: they change with any write, even of the same bytes."""
    facts = {str(path): os.lstat(path) for path in (folder, *folder.rglob("*"))}
    return {path: (fact.st_ino, fact.st_mtime_ns, fact.st_ctime_ns) for path, fact in facts.items()}


@pytest.fixture
def target(tmp_path: Path) -> Path:
    """Return a folder with the old build, in a folder with no other content."""
    place = tmp_path / "out" / "4ws2"
    write_folder(OLD, place)
    return place


def finished_process() -> int:
    """Return the number of a finished process."""
    process = subprocess.Popen(["true"])
    process.wait()
    return process.pid


def siblings(target: Path) -> list[str]:
    return sorted(path.name for path in target.parent.iterdir() if path != target)


def no_exchange(one: Path, other: Path) -> None:
    raise OSError(errno.ENOSYS, "unsupported call")


@pytest.fixture(params=["exchange", "renames"])
def swap(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Select how folders are swapped: by one system call, or by two renames where that call is missing."""
    if request.param == "renames":
        monkeypatch.setattr(write, "_exchange", no_exchange)
    return str(request.param)


# Content


def test_a_path_or_fact_that_is_reserved_or_leaves_the_folder_is_a_fault_of_the_program() -> None:
    for path in (
        "",
        ".",
        "/etc/passwd",
        "../x",
        "a/../b",
        "./a",
        "a//b",
        "a/",
        "a\\b",
        "a\nb",
        "ä",
        MANIFEST,
        *VERIFICATION_FILES,
    ):
        with pytest.raises(ValueError, match="cannot be the path"):
            Folder({path: b""}, {})
    with pytest.raises(ValueError, match="'a/b'"):
        Folder({"a/b": b"", "a/b/c": b""}, {})
    for key in ("files", "generator"):
        with pytest.raises(ValueError, match=key):
            Folder({}, {key: 1})


# Writing


def test_new_folder_with_missing_parents(tmp_path: Path, swap: str) -> None:
    place = tmp_path / "a" / "b" / "4ws2"
    assert write_folder(OLD, place) is True
    assert tree(place) == expected(OLD)
    assert siblings(place) == []
    plain = tmp_path / "plain"
    plain.mkdir(0o750)
    assert write_folder(OLD, plain) is True  # an empty folder is used and keeps its mode
    assert (tree(plain), stat.S_IMODE(plain.stat().st_mode)) == (expected(OLD), 0o750)


def test_unchanged_build_touches_nothing_and_a_changed_one_replaces_all(target: Path, swap: str) -> None:
    for name in VERIFICATION_FILES:
        (target / name).write_bytes(b"{}")
    before = stamps(target.parent)
    assert write_folder(OLD, target) is False
    assert stamps(target.parent) == before
    assert write_folder(NEW, target) is True
    assert tree(target) == expected(NEW)  # without the stale verification
    assert siblings(target) == []
    (target / "README.md").write_bytes(b"odd\n")  # same size as before
    assert write_folder(NEW, target) is True
    assert tree(target) == expected(NEW)
    assert write_folder(Folder(NEW.files, {"prefix": "other"}), target) is True
    assert read_manifest(target)["prefix"] == "other"


def test_a_link_to_a_folder_is_followed(target: Path, tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(target)
    assert write_folder(NEW, link) is True
    assert link.is_symlink() and tree(target) == expected(NEW)


# Files of others


def plant_file(place: Path, name: str) -> None:
    (place / name).parent.mkdir(parents=True, exist_ok=True)
    (place / name).write_bytes(b"dear to its owner\n")


FOREIGN_CONTENT: dict[str, Callable[[Path], object]] = {
    "file": lambda path: path.write_bytes(b"dear to its owner\n"),
    "folder": Path.mkdir,
    "link to a file": lambda path: path.symlink_to("../README.md"),
    "link to a folder": lambda path: path.symlink_to(path.parent),
    "pipe": os.mkfifo,
}
NAMES = ("a/b/c/mine.c", "src/verify.json", "src/manifest.json")


@pytest.mark.parametrize(
    ("name", "thing"), [*(("src/mine", thing) for thing in FOREIGN_CONTENT), *((name, "file") for name in NAMES)]
)
def test_foreign_content_is_named_and_kept(target: Path, name: str, thing: str) -> None:
    (target / name).parent.mkdir(parents=True, exist_ok=True)
    FOREIGN_CONTENT[thing](target / name)
    before = stamps(target.parent)
    for folder in (NEW, OLD):  # even if the build would change nothing
        with pytest.raises(BuildError) as caught:
            write_folder(folder, target)
        assert f"contains '{name}'," in caught.value.what
        assert (
            caught.value.where == str(target) and "choose another folder" in caught.value.remedy and caught.value.exit_code == 2
        )
    assert stamps(target.parent) == before


@pytest.mark.parametrize("thing", ["link to a file", "pipe", "link to a folder of files"])
def test_a_name_of_ours_does_not_make_other_content_ours(target: Path, tmp_path: Path, thing: str) -> None:
    plant_file(tmp_path, "user/ars_map.c")
    shutil.rmtree(target / "src")
    if thing == "link to a folder of files":
        (target / "src").symlink_to(tmp_path / "user")
    else:
        (target / "src").mkdir()
        FOREIGN_CONTENT[thing](target / "src" / "ars_map.c")
    before = stamps(tmp_path)
    with pytest.raises(BuildError, match="contains 'src"):
        write_folder(NEW, target)
    assert stamps(tmp_path) == before


def manifest_text(**changes: object) -> bytes:
    return json.dumps({**json.loads(render_manifest(OLD)), **changes}).encode()


FOREIGN_MANIFESTS = {
    "huge": render_manifest(OLD),
    "cut short": render_manifest(OLD)[:-30],
    "not text": b"\xff\xfe\x00\xd8",
    "a list": b"[]",
    "nested without end": b"[" * 200_000,
    "of another tool": manifest_text(generator="webpack"),
    "hash missing": manifest_text(files={"a": {}}),
    "leaves the folder": manifest_text(files={"../victim": {"sha256": "0"}}),
    "unpaired surrogate": manifest_text(files={"\ud800": {"sha256": "0"}}),
}


@pytest.mark.parametrize("kind", FOREIGN_MANIFESTS)
def test_a_manifest_that_is_not_ours_owns_nothing(target: Path, kind: str) -> None:
    (target / MANIFEST).write_bytes(FOREIGN_MANIFESTS[kind])
    if kind == "huge":
        os.truncate(target / MANIFEST, MANIFEST_BYTES_MAX + 1)  # sparse: takes no space, and is not read completely
    before = stamps(target.parent)
    for call in (lambda: read_manifest(target), lambda: verify_hashes(target)):
        with pytest.raises(BuildError, match="codegen build") as caught:
            call()
        assert caught.value.where == str(target / MANIFEST)
    with pytest.raises(BuildError, match="contains"):
        write_folder(NEW, target)
    assert stamps(target.parent) == before


def test_a_manifest_that_is_missing_or_no_file_is_refused_without_waiting(target: Path) -> None:
    (target / MANIFEST).unlink()
    with pytest.raises(BuildError, match=r"contains 'README\.md'"):  # even with our names, the folder is not ours
        write_folder(OLD, target)
    for place in (target, target / "nowhere", target / "README.md"):
        with pytest.raises(BuildError, match=r"not a generated folder.*codegen build"):
            read_manifest(place)
    os.mkfifo(target / MANIFEST)
    with pytest.raises(BuildError, match="not a regular file"):
        read_manifest(target)


@pytest.mark.parametrize("thing", ["file", "pipe", "link to a file"])
def test_target_that_is_no_folder(tmp_path: Path, thing: str) -> None:
    place = tmp_path / "out" / "4ws2"
    place.parent.mkdir()
    (tmp_path / "README.md").write_bytes(b"dear to its owner\n")
    FOREIGN_CONTENT[thing](place)
    before = stamps(tmp_path)
    for target in (place, Path("/")):
        with pytest.raises(BuildError, match="not a folder"):
            write_folder(OLD, target)
    for below in (place / "4ws2", place / "a" / "4ws2"):
        with pytest.raises(BuildError, match=r"\A[^\n]*cannot be written[^\n]*\Z"):
            write_folder(OLD, below)
    assert stamps(tmp_path) == before


def test_content_that_appears_at_the_last_moment_is_restored(target: Path, monkeypatch: pytest.MonkeyPatch, swap: str) -> None:
    exchange, calls = write._exchange, []

    def late(one: Path, other: Path) -> None:
        calls.append(one)
        if len(calls) == 1:
            plant_file(target, "src/late.c")
        exchange(one, other)

    monkeypatch.setattr(write, "_exchange", late)
    with pytest.raises(BuildError, match=r"contains 'src/late\.c'"):
        write_folder(NEW, target)
    assert tree(target) == expected(OLD, {"src/late.c": b"dear to its owner\n"})
    assert siblings(target) == []


# Failing builds


def test_every_file_and_folder_is_on_the_disk_before_the_swap(target: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: set[int] = set()
    swapped: list[set[int]] = []
    exchange = write._exchange

    def check(one: Path, other: Path) -> None:
        swapped.append({path.stat().st_ino for path in (one, *one.rglob("*"))} - synced)
        exchange(one, other)

    monkeypatch.setattr(os, "fsync", lambda descriptor: synced.add(os.fstat(descriptor).st_ino))
    monkeypatch.setattr(write, "_exchange", check)
    write_folder(NEW, target)
    assert swapped == [set()]


STEPS = ("mkdir", "fsync", "rename", "unlink", "rmdir")
"""Functions of `os` that change the disk. `write._exchange` and half of `write._write_file` are steps as well."""


def step_by_step(patch: Callable[[Any, str, Any], None], at_step: Callable[[], None]) -> None:
    """Make each step of `write_folder` call `at_step` first; writing a file calls it after half of the content."""

    def before(call: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*args: Any, **kwargs: Any) -> Any:
            at_step()
            return call(*args, **kwargs)

        return wrapped

    write_file = write._write_file

    def in_halves(path: Path, content: bytes) -> None:
        path.write_bytes(content[: len(content) // 2])
        at_step()
        path.unlink()
        write_file(path, content)

    for name in STEPS:
        patch(os, name, before(getattr(os, name)))
    patch(write, "_exchange", before(write._exchange))
    patch(write, "_write_file", in_halves)


def fail_at(step: int, error: BaseException, target: Path) -> tuple[bool, BaseException | None]:
    """Write the new build with `error` raised at `step`, counted from 1; return whether it got that far, and the exception."""
    steps = mock.Mock(side_effect=[*[None] * (step - 1), error, *[None] * 1000])
    with pytest.MonkeyPatch.context() as patch:
        step_by_step(patch.setattr, steps)
        try:
            write_folder(NEW, target)
        except BaseException as raised:
            return True, raised
    return steps.call_count >= step, None


NO_SPACE = OSError(errno.ENOSPC, "No space left on device")
FULL = "cannot be written (No space left on device); the previous content is unchanged; free some space and try again"


@pytest.mark.parametrize("error", [NO_SPACE, KeyboardInterrupt()], ids=["ENOSPC", "interrupt"])
def test_failure_at_any_step(tmp_path: Path, swap: str, error: BaseException) -> None:
    was_old = was_new = 0
    reached, step = True, 0
    while reached:
        step += 1
        target = tmp_path / str(step) / "4ws2"
        write_folder(OLD, target)
        (target / "verify.json").write_bytes(b"{}")
        reached, raised = fail_at(step, error, target)
        found = tree(target)
        if found == expected(OLD, {"verify.json": b"{}"}):
            was_old += 1
            assert isinstance(raised, BuildError if isinstance(error, OSError) else type(error))
            assert type(error) is not OSError or str(raised) == f"{target}: {FULL}"
            assert siblings(target) == [], f"step {step} leaves files"
        else:
            # The new folder is in its place: only the removal of the old one can have failed.
            was_new += 1
            assert found == expected(NEW), f"step {step} leaves a mixed folder"
            assert raised is None if isinstance(error, OSError) else raised is None or type(raised) is type(error)
            write_folder(NEW, target)
            assert siblings(target) == [], f"the files left at step {step} are not removed"
    # Before the swap there is at least one step for the manifest, each of three files and their folders; after it, a removal
    # for each file.
    assert was_old >= 10 and was_new >= 5
    for step in range(1, 12):  # parents created for a failing build are removed
        (tmp_path / f"kept {step}").mkdir()
        _, raised = fail_at(step, error, tmp_path / f"kept {step}" / "a" / "b" / "4ws2")
        assert raised is None or tree(tmp_path / f"kept {step}") == {}, f"step {step}"


# Killed builds


def kill_at(step: int) -> Callable[[], None]:
    steps = itertools.count(1)
    return lambda: os.kill(os.getpid(), signal.SIGKILL) if next(steps) == step else None


@pytest.mark.parametrize("way", ["exchange", "renames"])
def test_kill_at_any_step(tmp_path: Path, way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if way == "renames":
        monkeypatch.setattr(write, "_exchange", no_exchange)
    old, standing, status = expected(OLD, {"verify.json": b"{}"}), [], signal.SIGKILL
    while status == signal.SIGKILL:
        target = tmp_path / str(len(standing)) / "4ws2"
        write_folder(OLD, target)
        (target / "verify.json").write_bytes(b"{}")
        child = os.fork()
        if child == 0:
            step_by_step(setattr, kill_at(len(standing) + 1))
            write_folder(NEW, target)
            os._exit(0)
        status = os.waitpid(child, 0)[1]
        found, left = tree(target), siblings(target)
        standing.append("old" if found == old else "new" if found == expected(NEW) else "a mixture" if found else "none")
        assert all(name.startswith(".4ws2.codegen-tmp-") for name in left)
        assert found or any(tree(target.parent / name) == old for name in left), "the old folder is lost"
        write_folder(NEW, target)
        assert tree(target) == expected(NEW)
        assert siblings(target) == []
    assert status == 0
    # In order: the old folder up to the swap, the new one after it; between two renames, and only there, none.
    none = ["none"] if way == "renames" else []
    was_old, was_new = standing.count("old"), standing.count("new")
    assert standing == ["old"] * was_old + none + ["new"] * was_new
    assert was_old >= 10 and was_new >= 5


def test_folder_moved_aside_by_a_killed_build_comes_back_even_if_the_next_build_fails(target: Path) -> None:
    target.rename(target.with_name(f".4ws2.codegen-tmp-{finished_process()}-old"))
    _, raised = fail_at(6, NO_SPACE, target)
    assert isinstance(raised, BuildError)
    assert tree(target) == expected(OLD)
    assert siblings(target) == []


def test_leftovers_of_dead_builds_go_and_other_things_stay(target: Path, tmp_path: Path) -> None:
    dead, other, out = finished_process(), tmp_path / "other build", target.parent
    for name in (f"{dead}", f"{dead}-old", f"{os.getpid()}"):  # the last: the same process number in a container
        write_folder(NEW, out / f".4ws2.codegen-tmp-{name}")
    stay = [f".other.codegen-tmp-{dead}", ".4ws2.codegen-tmp-x", f"4ws2.codegen-tmp-{dead}", ".4ws2.codegen-tmp-0"]
    with subprocess.Popen(["cat"], stdin=subprocess.PIPE) as alive:
        stay.append(f".4ws2.codegen-tmp-{alive.pid}")
        for name in stay:
            write_folder(NEW, out / name)
        for folder in (OLD, NEW):  # the first changes nothing
            write_folder(folder, target)
            assert siblings(target) == sorted(stay)
            assert tree(target) == expected(folder)
        assert all(tree(out / name) == expected(NEW) for name in stay)
    write_folder(NEW, target)
    assert siblings(target) == sorted(stay[:-1])
    leftover, link = (out / f".4ws2.codegen-tmp-{dead}{end}" for end in ("", "-old"))
    for place in (leftover, other):
        write_folder(OLD, place)
    plant_file(leftover, "src/mine.c")
    link.symlink_to(other)
    write_folder(OLD, target)
    assert tree(leftover) == {"src": None, "src/mine.c": b"dear to its owner\n", MANIFEST: render_manifest(OLD)}
    (out / f".4ws2.codegen-tmp-{os.getpid()}").symlink_to(other)
    with pytest.raises(BuildError, match="cannot be written"):
        write_folder(NEW, target)
    assert tree(target) == tree(other) == expected(OLD)


# Concurrent builds


def test_concurrent_builds_leave_one_complete(tmp_path: Path, swap: str) -> None:
    target = tmp_path / "4ws2"
    folders = [Folder({f"src/{n}.c": b"%d" % n, f"only{n}/x.h": b"%d" % n, "both": b"%d" % n}, {}) for n in range(4)]

    def build(first: int) -> None:
        for turn in range(8):
            write_folder(folders[(first + turn) % 4], target)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(build, range(4)))
    assert tree(target) in [expected(folder) for folder in folders]
    assert siblings(target) == []


# Checking


def test_each_difference_has_its_line(target: Path, tmp_path: Path) -> None:
    (target / "verify.md").write_bytes(b"fine")
    assert differences(OLD, target) == verify_hashes(target) == []
    plant_file(target, "notes.txt")
    (target / "link").symlink_to("README.md")
    before = stamps(target.parent)
    assert differences(NEW, target) == [
        "README.md: differs",
        "include/deep/ars.h: missing",
        "link: not named by the manifest",
        "manifest.json: differs",
        "notes.txt: not named by the manifest",
        "src/ars_map.c: differs",
        "src/gone.c: not named by the manifest",
    ]
    assert stamps(target.parent) == before
    assert differences(OLD, tmp_path / "4ws2") == [f"{tmp_path / '4ws2'}: missing"]
    source = target / "src" / "ars_map.c"
    for damage in (lambda: source.write_bytes(b"int c;\n"), source.unlink, lambda: os.mkfifo(source)):
        damage()
        assert verify_hashes(target) == ["src/ars_map.c"]
        assert any(line.startswith("src/ars_map.c: ") for line in differences(OLD, target))

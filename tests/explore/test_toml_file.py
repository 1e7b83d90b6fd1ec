"""The button that writes a file: its content, and the files that it never overwrites."""

import hashlib
from pathlib import Path

import pytest

from codegen import configuration
from codegen.errors import CodegenError
from codegen.explore.controls import ExploreError
from codegen.explore.explorer import Explorer
from codegen.explore.toml_file import Existing, Target, preset_bases
from codegen.importing.toml_edit import whole

from .conftest import GENERATED, Client

MOVED = {"lambda": 500.0, "limits.rear_angle_max_deg": 2.5, "road.friction": 0.7}


def sha(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def refusal(target: Target, config: configuration.Config) -> Existing:
    """Return the question before a file is replaced, and check that the file is unchanged."""
    before = target.path.read_bytes()
    with pytest.raises(Existing) as caught:
        target.write(config, None)
    assert target.path.read_bytes() == before
    return caught.value


def test_the_file_holds_exactly_the_settings(pi: Explorer, tracking: Explorer, tmp_path: Path) -> None:
    for number, (explorer, bases) in enumerate([(pi, preset_bases()), (pi, ()), (tracking, preset_bases())]):
        path, config = tmp_path / f"{number}.toml", explorer.configured(MOVED)
        Target(path, bases).write(config, None)
        assert configuration.load(path) == config


def test_an_existing_file_is_replaced_only_on_confirmation_and_keeps_its_comments(tracking: Explorer, tmp_path: Path) -> None:
    target = Target(tmp_path / "ars.toml")
    own = whole(tracking.start, "codegen explore").replace("[limits]", "# Measured by Ann.\n[limits]")
    target.path.write_text(own, encoding="utf-8")
    config = tracking.configured({"limits.rear_angle_max_deg": 2.5, "integral_percent": 50.0})
    question = refusal(target, config)
    assert "comments stay" in question.text
    assert "limits.rear_angle_max_deg: 3.5 → 2.5" in question.changes
    target.write(config, question.sha256)
    assert configuration.load(target.path) == config
    assert "# Measured by Ann.\n[limits]" in target.path.read_text(encoding="utf-8")


def test_a_confirmation_holds_only_for_the_unchanged_file(pi: Explorer, tmp_path: Path) -> None:
    target = Target(tmp_path / "ars.toml")
    target.path.write_text("old", encoding="utf-8")
    seen = sha(target.path)
    target.path.write_text("written meanwhile", encoding="utf-8")
    with pytest.raises(Existing):
        target.write(pi.start, seen)
    assert target.path.read_text(encoding="utf-8") == "written meanwhile"
    target.path.unlink()
    with pytest.raises(ExploreError, match="gone"):
        target.write(pi.start, seen)
    assert not target.path.exists()


def test_a_file_written_between_the_comparison_and_the_rename_is_kept(
    pi: Explorer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = Target(tmp_path / "ars.toml")
    text = Target._text

    def other_explorer_writes(*given: object) -> object:
        made = text(*given)  # type: ignore[arg-type]
        target.path.write_text("written meanwhile", encoding="utf-8")
        return made

    for before in (None, "old"):
        target.path.unlink(missing_ok=True)
        if before is not None:
            target.path.write_text(before, encoding="utf-8")
        seen = None if before is None else sha(target.path)
        monkeypatch.setattr(Target, "_text", other_explorer_writes)
        with pytest.raises(Existing) as caught:
            target.write(pi.start, seen)
        assert target.path.read_text(encoding="utf-8") == "written meanwhile"
        assert caught.value.sha256 == sha(target.path)


def test_a_file_of_another_car_is_replaced_completely(pi: Explorer, tmp_path: Path) -> None:
    target = Target(tmp_path / "ars.toml")
    target.path.write_text(configuration.preset_text().replace("2335.07", "1500.0"), encoding="utf-8")
    question = refusal(target, pi.start)
    assert "All of it would be replaced" in question.text
    assert "vehicle.mass_kg: 1500.0 → 2335.07" in question.changes
    for content in (target.path.read_bytes(), b"not toml [", b"\xff\xfe", b""):
        target.path.write_bytes(content)
        target.write(pi.start, refusal(target, pi.start).sha256)
        assert configuration.load(target.path) == pi.start


def test_links_folders_and_builds_are_refused(pi: Explorer, tmp_path: Path) -> None:
    outside, path = tmp_path / "outside.toml", tmp_path / "ars.toml"
    outside.write_text("mine", encoding="utf-8")
    path.symlink_to(outside)
    with pytest.raises(CodegenError, match="a link"):
        Target(path).write(pi.start, sha(outside))
    assert outside.read_text(encoding="utf-8") == "mine"
    path.unlink()
    path.mkdir()
    build = GENERATED / "4ws2-paper" / "ars.toml"
    for wrong, expected in ((path, "not a file"), (build, "inside a build"), (tmp_path / "gone/ars.toml", "does not exist")):
        with pytest.raises(CodegenError, match=expected):
            Target(wrong).write(pi.start, None)
    assert not build.exists()


def test_the_server_writes_the_file(client: Client, tmp_path: Path) -> None:
    written = client.post("/api/write", {"values": MOVED, "replaces": None})
    assert written.status == 200
    path = tmp_path / "ars.toml"
    assert written.data == {"file": str(path), "next": "codegen solve --config ars.toml --case 4ws-2 -o small.npz"}
    assert configuration.load(path) == client.server.explorer.configured(MOVED)
    again = client.post("/api/write", {"values": {}, "replaces": None})
    assert (again.status, again.data["sha256"]) == (409, sha(path))
    assert client.post("/api/write", {"values": {}, "replaces": again.data["sha256"]}).status == 200
    assert configuration.load(path) == client.server.explorer.start

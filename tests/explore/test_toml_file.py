"""The button: what is written, what is kept, and what is never written over."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from codegen import config as configuration
from codegen.errors import CodegenError
from codegen.explore.controls import ExploreError
from codegen.explore.explorer import Explorer
from codegen.explore.toml_file import Existing, Target, preset_bases, whole

from .conftest import Client

MOVED = {"lambda": 500.0, "limits.rear_angle_max_deg": 2.5, "road.friction": 0.7}


def sha(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("kind", ["pi", "tracking"])
@pytest.mark.parametrize("bases", [(), preset_bases()], ids=["bare", "presets"])
def test_the_file_says_exactly_what_was_explored(
    kind: str, bases: tuple[str, ...], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    explorer: Explorer = request.getfixturevalue(kind)
    config = explorer.configured(MOVED)
    target = Target(tmp_path / "ars.toml", bases)
    target.write(config, None)
    assert configuration.load(target.path) == config
    assert [path.name for path in tmp_path.iterdir()] == ["ars.toml"]


def test_a_preset_that_fits_brings_its_comments(tmp_path: Path) -> None:
    """The paper's car on the paper's grid: the commented preset with other numbers."""
    start = configuration.preset()
    config = start.model_copy(update={"limits": start.limits.model_copy(update={"rear_angle_max_deg": 2.5})})
    target = Target(tmp_path / "ars.toml", preset_bases())
    target.write(config, None)
    before, after = configuration.preset_text().splitlines(), target.path.read_text(encoding="utf-8").splitlines()
    assert [line for line in before if line not in after] == [
        "rear_angle_max_deg = 3.5      # in the map; the actuator's own limit stands in [rear_actuator]"
    ]
    assert "rear_angle_max_deg = 2.5      # in the map; the actuator's own limit stands in [rear_actuator]" in after


def test_an_existing_file_is_left_until_the_user_says_so_and_keeps_its_comments(tracking: Explorer, tmp_path: Path) -> None:
    target = Target(tmp_path / "ars.toml")
    own = whole(tracking.start).replace("[limits]", "# Measured by Ann.\n[limits]")
    target.path.write_text(own, encoding="utf-8")
    config = tracking.configured({"limits.rear_angle_max_deg": 2.5, "integral_percent": 50.0})
    with pytest.raises(Existing) as caught:
        target.write(config, None)
    assert target.path.read_text(encoding="utf-8") == own
    assert "comments stay" in caught.value.text
    assert "limits.rear_angle_max_deg: 3.5 → 2.5" in caught.value.changes
    target.write(config, caught.value.sha256)
    assert configuration.load(target.path) == config
    assert "# Measured by Ann.\n[limits]" in target.path.read_text(encoding="utf-8")


def test_the_user_s_word_is_for_the_file_that_was_seen(pi: Explorer, tmp_path: Path) -> None:
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


def test_a_file_of_another_car_is_told_to_be_replaced_whole(pi: Explorer, tmp_path: Path) -> None:
    target = Target(tmp_path / "ars.toml")
    target.path.write_text(configuration.preset_text().replace("2335.07", "1500.0"), encoding="utf-8")
    with pytest.raises(Existing) as caught:
        target.write(pi.start, None)
    assert "All of it would be replaced" in caught.value.text
    assert "vehicle.mass_kg: 1500.0 → 2335.07" in caught.value.changes
    target.write(pi.start, caught.value.sha256)
    assert configuration.load(target.path) == pi.start


@pytest.mark.parametrize("content", [b"not toml [", b"\xff\xfe", b"", b"[vehicle]\nwheels = 4\n"])
def test_what_is_no_configuration_is_replaced_only_on_the_user_s_word(pi: Explorer, tmp_path: Path, content: bytes) -> None:
    target = Target(tmp_path / "ars.toml")
    target.path.write_bytes(content)
    with pytest.raises(Existing) as caught:
        target.write(pi.start, None)
    assert target.path.read_bytes() == content
    target.write(pi.start, caught.value.sha256)
    assert configuration.load(target.path) == pi.start


def test_a_link_a_folder_and_a_build_are_refused(pi: Explorer, tmp_path: Path) -> None:
    outside = tmp_path / "outside.toml"
    outside.write_text("mine", encoding="utf-8")
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "ars.toml").symlink_to(outside)
    with pytest.raises(CodegenError, match="a link"):
        Target(inner / "ars.toml").write(pi.start, sha(outside))
    assert outside.read_text(encoding="utf-8") == "mine"
    (inner / "ars.toml").unlink()
    (inner / "ars.toml").mkdir()
    with pytest.raises(CodegenError, match="not a file"):
        Target(inner / "ars.toml").write(pi.start, None)
    build = Path(__file__).resolve().parents[2] / "generated" / "4ws2"
    with pytest.raises(CodegenError, match="inside a build"):
        Target(build / "ars.toml").write(pi.start, None)
    assert not (build / "ars.toml").exists()


def test_a_folder_that_is_gone_is_one_line(pi: Explorer, tmp_path: Path) -> None:
    with pytest.raises(CodegenError, match="folder does not exist"):
        Target(tmp_path / "gone" / "ars.toml").write(pi.start, None)


def test_odd_names_and_lists_survive(pi: Explorer) -> None:
    import tomllib

    data = pi.start.model_dump(mode="json")
    data["cases"]["a.b"] = data["cases"].pop("fws")
    data["grid"]["speed_breakpoints_km_h"] = [20.0, 45.5, 120.0]
    config = configuration.parse(data, "test")
    assert configuration.parse(tomllib.loads(whole(config)), "test") == config


def test_the_button_through_the_server(client: Client, tmp_path: Path) -> None:
    written = client.post("/api/write", {"values": MOVED, "replaces": None})
    assert written.status == 200
    path = tmp_path / "ars.toml"
    assert written.data == {"file": str(path), "next": "codegen solve --config ars.toml --case 4ws-2 -o small.npz"}
    assert configuration.load(path) == client.server.explorer.configured(MOVED)
    before = path.read_bytes()
    again = client.post("/api/write", {"values": {}, "replaces": None})
    assert (again.status, again.data["sha256"]) == (409, sha(path))
    assert client.post("/api/write", {"values": {}, "replaces": "0" * 64}).status == 409
    assert path.read_bytes() == before
    assert client.post("/api/write", {"values": {}, "replaces": again.data["sha256"]}).status == 200
    assert configuration.load(path) == client.server.explorer.start
    assert client.post("/api/write", {"values": {}, "replaces": 1}).status == 400

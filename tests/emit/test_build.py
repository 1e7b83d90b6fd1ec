"""A build as a whole: its example runs, its id depends on the C alone. `tests/verify` compiles it strictly."""

import subprocess
from pathlib import Path
from typing import Any

import pytest

from codegen.configuration import Config, Kind
from codegen.emit import build
from codegen.emit.folder import read_manifest
from codegen.emit.text import Precision
from codegen.sil.toolchain import compiler_command
from tests import builds
from tests.emit.rendered import EACH_KIND_AND_DOUBLE, laid_out, rendered


@pytest.mark.parametrize(("kind", "precision"), EACH_KIND_AND_DOUBLE)
def test_the_example_runs(tmp_path: Path, kind: Kind, precision: Precision) -> None:
    folder, program = laid_out(rendered(kind, precision), tmp_path / "build"), tmp_path / "example"
    sources = [*(folder / "src").iterdir(), folder / "example" / "example_main.c"]
    subprocess.run([*compiler_command(), "-std=c99", f"-I{folder / 'include'}", *sources, "-o", program, "-lm"], check=True)
    result = subprocess.run([program], check=True, capture_output=True, text=True)
    assert "yaw rate" in result.stdout and "reference" in result.stdout
    assert result.stderr == ""


@pytest.mark.parametrize("name", ["4ws2-paper", "4ws2"])
def test_the_id_of_a_committed_build_is_the_hash_of_its_c_with_the_id_blank(name: str) -> None:
    folder = Path(__file__).resolve().parents[2] / "generated" / name
    manifest = read_manifest(folder)
    identity = manifest["build_id"]
    texts = (path for path in manifest["files"] if path != build.MAP_FILE)
    assert [path for path in texts if build.BLANK_ID.encode() in (folder / path).read_bytes()] == []
    paths = [path for path in manifest["files"] if path.endswith((".c", ".h")) and not path.startswith("verify/")]
    blank = {path: (folder / path).read_bytes().replace(identity.encode(), build.BLANK_ID.encode()) for path in paths}
    assert build._build_id(blank) == identity
    assert build._build_id({**blank, paths[0]: blank[paths[0]] + b"\n"}) != identity


def test_the_id_changes_with_the_c_and_with_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    def made(config: Config = builds.CONFIG, digest: str = "0" * 64, **options: Any) -> str:
        given = build.BuildInputs("4ws2.npz", digest, "map"), build.BuildOptions(**{"name": "4ws2", **options})
        folder = build.build_code(builds.paper_map(), config, given[1], given[0])
        identity: str = folder.manifest["build_id"]
        assert all(identity in text.decode() for path, text in folder.files.items() if "sections" not in path)
        return identity

    first = made()
    assert made(digest="1" * 64) == first, "the same table in another file"
    budgets = builds.CONFIG.budgets.model_copy(update={"flash_bytes_max": 10**6})
    assert made(builds.CONFIG.model_copy(update={"budgets": budgets})) == first, "a key that the C does not depend on"
    others = [made(name="x"), made(prefix="x"), made(precision="double"), made(builds.TRACKING_CONFIG)]
    render = build.render
    for template in ("src/law.c.j2", "include/can.h.j2", "linux/ars_ecu.c.j2"):
        monkeypatch.setattr(build, "render", lambda name, context, it=template: render(name, context) + b"\n" * (name == it))
        others.append(made())
    assert len({first, *others}) == 8

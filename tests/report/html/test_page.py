"""The page: whole, deterministic, and closed against what its data hold and against the network."""

from __future__ import annotations

import base64
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from codegen.config import parse, preset
from codegen.emit.folder import read_manifest
from codegen.report.html import build, page
from codegen.report.html.blocks import Chart, Section, Table, Text
from codegen.report.html.gather import Request, gather, read
from codegen.report.html.loop import margins_chart
from codegen.report.html.report import Material, sections
from codegen.verify.runner import CHECKS

GENERATED = Path(__file__).resolve().parents[3] / "generated"
EVIL = "</script><script>alert(1)</script><!-- & 'x' \"y\""


def nothing(done: int, total: int) -> None: ...


@pytest.fixture(scope="module")
def material() -> Material:
    """Of a committed build, without a run."""
    return gather(read(Request(GENERATED / "4ws2.npz", build=GENERATED / "4ws2", simulate=False)), nothing)


def test_the_same_input_gives_the_same_bytes(material: Material) -> None:
    first, second = (page.render("report", list(sections(material))) for _ in range(2))
    assert first == second


def test_nothing_comes_from_the_network(material: Material) -> None:
    """All that could load something, outside of Plotly's own code, which the browser's test watches."""
    text = page.render("report", list(sections(material))).decode("utf-8")
    own = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert not re.findall(r"""(?:src|href)=["'](?!#|data:)""", own)
    assert not re.findall(r"url\(|@import", own)
    assert "default-src 'none'" in own


def test_no_text_can_leave_its_place() -> None:
    figure = {"data": [{"type": "scatter", "name": EVIL}], "layout": {}}
    blocks = (Text(EVIL), Table(EVIL, (EVIL, "b"), [(EVIL, "c")]), Chart("x", figure, EVIL, EVIL))
    text = page.render(EVIL, [Section("s", EVIL, blocks)]).decode("utf-8")
    assert "<script>alert" not in text
    assert text.count("<script") == text.count("</script>") == 3
    assert page.prose("`a` <b>") == "<code>a</code> &lt;b&gt;"


def test_ids_are_unique_and_links_lead_somewhere(material: Material) -> None:
    text = page.render("report", list(sections(material))).decode("utf-8")
    own = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    ids = re.findall(r'\bid="([^"]+)"', own)
    assert len(ids) == len(set(ids))
    assert set(re.findall(r'href="#([^"]+)"', own)) <= set(ids)
    assert set(re.findall(r'(?:aria-labelledby|for)="([^"]+)"', own)) <= set(ids)


def test_the_record_of_verify_is_told_in_full(material: Material) -> None:
    blocks = list(build.verification_blocks(GENERATED / "4ws2"))
    table = next(block for block in blocks if isinstance(block, Table))
    assert [row[3] for row in table.rows] == ["passed"] * len(CHECKS)
    captions = [block.caption.partition(" (")[0] for block in blocks if isinstance(block, Table)]
    assert captions[1:] == ["Budgets on a Cortex-M4F", "Stack", "Memory map", "What the caller provides", "What is not shown"]


def test_a_build_without_a_record_or_with_an_older_one_is_told(tmp_path: Path) -> None:
    for name in ("manifest.json", "verify.json"):
        (tmp_path / name).write_bytes((GENERATED / "4ws2" / name).read_bytes())
    with (tmp_path / "manifest.json").open("ab") as file:
        file.write(b"\n")
    first = next(iter(build.verification_blocks(tmp_path)))
    assert isinstance(first, Text)
    assert "of an older build" in first.text
    for content in ("{}", "junk"):
        (tmp_path / "verify.json").write_text(content, encoding="utf-8")
        (only,) = build.verification_blocks(tmp_path)
        assert isinstance(only, Text)
        assert "verify.json beside this build is damaged" in only.text
    (tmp_path / "verify.json").unlink()
    (only,) = build.verification_blocks(tmp_path)
    assert isinstance(only, Text)
    assert "Nothing is recorded" in only.text


def test_an_edited_file_is_told(tmp_path: Path) -> None:
    folder = tmp_path / "4ws2"
    shutil.copytree(GENERATED / "4ws2", folder)
    (folder / "ars.dbc").write_text("edited", encoding="utf-8")
    first = next(iter(build.manifest_blocks(folder)))
    assert isinstance(first, Text)
    assert first.text == "Edited since it was made: ars.dbc."


def test_margins_are_those_of_the_design() -> None:
    """The recommended controller keeps what it was designed for; the paper's does not, at speed."""
    manifest = read_manifest(GENERATED / "4ws2-tracking")
    config = parse(manifest["configuration"], "manifest")
    chart = margins_chart({"tracking": config, "pi": preset()})
    assert chart is not None

    def least(name: str, axis: str) -> float:
        trace = next(each for each in chart.figure["data"] if each["name"] == name and each["yaxis"] == axis)
        return float(np.nanmin(np.frombuffer(base64.b64decode(trace["y"]["bdata"]), "<f4")))

    # Half a decibel and two degrees are what the points between the breakpoints of the design may lack.
    assert least("tracking, worst of the family", "y") > config.tuning.gain_margin_db - 0.5
    assert least("tracking, worst of the family", "y2") > config.tuning.phase_margin_deg - 2.0
    assert least("pi, worst of the family", "y2") == 0.0
    feedforward = preset().model_copy(update={"controller": preset().controller.model_copy(update={"kind": "feedforward"})})
    assert margins_chart({"feedforward": feedforward}) is None


def test_a_map_of_the_users_own_makes_a_report(tmp_path: Path) -> None:
    np.savez(tmp_path / "own.npz", vx=[10.0, 20.0], delta_f=[0.02, 0.04], yaw_rate=[[0.1, 0.2], [0.15, 0.25]])
    found = gather(read(Request(tmp_path / "own.npz")), nothing)
    assert not found.configured
    made = {section.name: section for section in sections(found)}
    assert "compared" not in made
    assert page.render("own", list(made.values()))

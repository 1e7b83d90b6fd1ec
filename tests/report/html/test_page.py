"""The page of a report and its input files."""

import hashlib
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from codegen.configuration import preset
from codegen.errors import CodegenError
from codegen.export import runs as exported
from codegen.figures.data import Chart
from codegen.report.bus_tables import FaultEntry
from codegen.report.html import build, page, verdict
from codegen.report.html.gather import Request, _scenario_of, gather, read
from codegen.report.html.inputs import named, read_files
from codegen.report.html.page import Section, Table, Text
from codegen.report.html.report import sections
from codegen.sil.software import RECORD_COLUMNS
from hil_sim.codec import Frame
from hil_sim.logs import BusLog
from hil_sim.scenario_files import find
from tests.hil_sim.made import record as drive
from tests.importing.conftest import in_this_process
from tests.report.html.test_charts import record

__all__ = ["in_this_process"]

GENERATED = Path(__file__).resolve().parents[3] / "generated"
INJECTION = "</script><script>alert(1)</script><!-- & 'x' \"y\""
CAN = preset().can


def nothing(done: int, total: int) -> None: ...


def test_the_page_of_a_build_is_reproducible_self_contained_and_linked() -> None:
    """It covers everything that could load a resource except Plotly's code, which a browser test monitors."""
    material = gather(read(Request(GENERATED / "4ws2-paper.npz", build=GENERATED / "4ws2-paper", simulate=False)), nothing)
    first, second = (page.render("report", list(sections(material))) for _ in range(2))
    assert first == second
    own = re.sub(r"<script>.*?</script>", "", first.decode("utf-8"), flags=re.DOTALL)
    assert not re.findall(r"""(?:src|href)=["'](?!#|data:)""", own)
    assert not re.findall(r"url\(|@import", own)
    assert "default-src 'none'" in own
    ids = re.findall(r'\bid="([^"]+)"', own)
    assert set(re.findall(r'href="#([^"]+)"', own)) <= set(ids)
    assert set(re.findall(r'(?:aria-labelledby|for)="([^"]+)"', own)) <= set(ids)


def test_text_is_escaped() -> None:
    figure = {"data": [{"type": "scatter", "name": INJECTION}], "layout": {}}
    blocks = (Text(INJECTION), Table(INJECTION, (INJECTION, "b"), [(INJECTION, "c")]), Chart("x", figure, INJECTION, INJECTION))
    text = page.render(INJECTION, [Section("s", INJECTION, blocks)]).decode("utf-8")
    assert "<script>alert" not in text
    assert text.count("<script") == text.count("</script>") == 3


def test_an_incomplete_or_outdated_verification_record_is_named(tmp_path: Path) -> None:
    folder = shutil.copytree(GENERATED / "4ws2", tmp_path / "4ws2")
    recorded = json.loads((GENERATED.parent / "tests/verify/record.json").read_bytes())
    recorded["build"]["manifest_sha256"] = hashlib.sha256((folder / "manifest.json").read_bytes()).hexdigest()
    (folder / "verify.json").write_text(json.dumps(recorded), encoding="utf-8")
    tables = [block for block in build.verification_blocks(folder) if isinstance(block, Table)]
    assert [row[3] for row in tables[0].rows] == ["passed"] * len(recorded["checks"])
    cost = {tile.title: tile.value for tile in verdict._verification(folder)}["Cost on a Cortex-M4F"]
    assert cost == "1,324 instructions"  # of one step; the sum of both maxima is 1,348
    captions = [block.caption.partition(" (")[0] for block in tables[1:]]
    assert captions == [
        "Requirements",
        "Budgets on a Cortex-M4F",
        "Stack",
        "Memory map",
        "What the caller provides",
        "What is not shown",
    ]
    with (folder / "manifest.json").open("ab") as file:
        file.write(b"\n")
    for content, words in (
        (None, "belongs to an older build"),
        ("{}", "is damaged"),
    ):
        if content is not None:
            (folder / "verify.json").write_text(content, encoding="utf-8")
        assert words in next(iter(build.verification_blocks(folder))).text
    (folder / "verify.json").unlink()
    assert "has no verification record" in next(iter(build.verification_blocks(folder))).text


def test_a_record_with_a_check_that_no_longer_exists_is_shown(tmp_path: Path) -> None:
    """Older versions ran the fuzz harnesses in a check of their own."""
    folder = shutil.copytree(GENERATED / "4ws2-paper", tmp_path / "4ws2", ignore=shutil.ignore_patterns("verify.*"))
    check = {"shows": "No input crashes", "verdict": "passed", "figure": "8,000 inputs", "findings": [], "limits": ["All."]}
    digest = hashlib.sha256((folder / "manifest.json").read_bytes()).hexdigest()
    old = {"build": {"manifest_sha256": digest}, "counts": {"passed": 1, "failed": 0}, "checks": {"fuzzing": check}}
    (folder / "verify.json").write_text(json.dumps(old), encoding="utf-8")
    checks, limits = build.verification_blocks(folder)
    assert isinstance(checks, Table) and isinstance(limits, Table)
    assert list(checks.rows) == [("fuzzing", "No input crashes", "8,000 inputs", "passed")]
    assert list(limits.rows) == [("fuzzing", "All.")]


def test_a_bare_map_makes_a_report(tmp_path: Path) -> None:
    np.savez(tmp_path / "own.npz", vx=[10.0, 20.0], delta_f=[0.02, 0.04], yaw_rate=[[0.1, 0.2], [0.15, 0.25]])
    found = gather(read(Request(tmp_path / "own.npz")), nothing)
    assert not found.configured
    made = {section.name: section for section in sections(found)}
    assert "compared" not in made
    assert page.render("own", list(made.values()))


LoggedFrame = tuple[int, float, bool]  # identifier, time in s, and whether the frame was received


def log(path: Path, frames: list[LoggedFrame]) -> Path:
    with BusLog(path) as bus_log:
        for identifier, time, received in frames:
            bus_log.write(Frame(identifier, bytes(8), time), received=received)
    return path


def cycles(periods: tuple[float, ...], delay: float = 0.004) -> list[LoggedFrame]:
    """Return the frames of cycles that begin after `periods` (s), each answered after `delay`."""
    frames: list[LoggedFrame] = []
    for now in np.cumsum((0.0, *periods)):
        frames += [(0x101, now, False), (0x102, now, False), (CAN.rear_steer_command.id, now + delay, True)]
    return frames


def test_a_log_gives_periods_and_answer_times(tmp_path: Path) -> None:
    """A frame received by its own sender counts once, when sent; a late answer belongs to the next sample.

    A log resolves at least microseconds. In lock-step a command has the time of its sample, so the log contains no response
    times.
    """
    late = enumerate((0.0, 0.002, 0.0))
    echo: list[LoggedFrame] = [
        each for k, late in late for each in ((0x101, 0.01 * k, False), (0x101, 0.01 * k + 1e-3 + late, True))
    ]
    for name, frames, periods, answers in (
        ("bus.blf", cycles((0.01, 0.012, 0.008)), [10.0, 12.0, 8.0], [4.0] * 4),
        ("echo.blf", echo, [10.0, 10.0], []),
        ("lock-step.asc", cycles((0.01,) * 5, delay=0.0), [10.0] * 5, [0.0] * 6),
    ):
        (found,) = read_files([str(log(tmp_path / name, frames))], CAN).logs
        np.testing.assert_allclose(found.periods["VehicleMotion"], periods, atol=2e-3)
        np.testing.assert_allclose(found.answers, answers, atol=2e-3)
        assert found.cycle == 10.0
        assert len(answers) < 4 or found.is_simulated == (name == "lock-step.asc"), name  # too few to decide


@pytest.mark.parametrize("time", ["nan", "inf", "1e308"])
def test_a_frame_with_an_invalid_time_is_an_error(tmp_path: Path, time: str) -> None:
    path = log(tmp_path / "bus.asc", cycles((0.01,)))
    text = path.read_text(encoding="ascii")
    path.write_text(text.replace(" 0.010000 ", f" {time} ", 1), encoding="ascii")
    line = text[: text.index(" 0.010000 ")].count("\n") + 1
    with pytest.raises(CodegenError) as error:
        read_files([str(path)], CAN)
    assert str(error.value).startswith(f"{path}, line {line}: a frame has an invalid time, {time};")


def test_one_frame_has_no_period_and_is_not_simulated(tmp_path: Path) -> None:
    (found,) = read_files([str(log(tmp_path / "one.blf", [(0x101, 0.0, False)]))], CAN).logs
    assert not found.periods and not found.is_simulated


@pytest.mark.usefixtures("in_this_process")
def test_runs_of_all_formats_are_evaluated_alike(tmp_path: Path) -> None:
    """Without --scenario, a run is a recording of its speed and steering."""
    config, wanted, driven = preset(), None, drive(2.0, front_angle_rad=lambda time: 0.02 * time)
    for suffix in (".csv", ".parquet", ".mf4"):
        path = tmp_path / f"run{suffix}"
        exported.save(driven, path, "Step steer: 80 km/h")
        scenario = _scenario_of(read_files([str(path)], CAN), Request(Path("map.npz")), config)
        inputs = scenario.inputs(config)
        wanted = find(str(path), config).inputs(config) if wanted is None else wanted
        np.testing.assert_array_equal(inputs, wanted)
        assert (scenario.kind, scenario.subject) == ("recording", "Recording run")
    driven[3, RECORD_COLUMNS.index("speed_m_s")] = 200.0
    exported.save(driven, path)
    with pytest.raises(CodegenError, match=r"run\.mf4, sample 4, column speed_m_s: 200 is outside 0 to 150 m/s"):
        _scenario_of(read_files([str(path)], CAN), Request(Path("map.npz")), config)


@pytest.mark.parametrize("value", [1e308, -np.inf])
def test_a_value_too_large_to_compute_with_is_an_error(tmp_path: Path, value: float) -> None:
    wrong = record()
    wrong[2, RECORD_COLUMNS.index("sideslip_rad")] = value
    exported.save(wrong, tmp_path / "run.csv")
    with pytest.raises(CodegenError, match=rf"sample 3, column sideslip_rad: {value:g} is beyond 1e\+09".replace("e+", r"e\+")):
        read_files([str(tmp_path / "run.csv")], CAN)


def test_fault_markers_and_run_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fault: dict[str, object] = dict.fromkeys(FaultEntry.__annotations__, 0.0)
    fault |= {"name": "x", "injected": "a frame lost", "seen": [], "reached": "A", "defined": "A", "violations": []}
    path = tmp_path / "faults.json"
    path.write_text(json.dumps({"faults": [fault]}), encoding="utf-8")
    found = read_files([str(path)], CAN).faults
    assert [entry["injected"] for entry in found] == ["a frame lost"]
    for key, wrong in (("seen", "text"), ("rear_rate_max_deg_s", "NaN"), ("violations", [1]), ("reached", None)):
        path.write_text(json.dumps({"faults": [fault | {key: wrong}]}), encoding="utf-8")
        with pytest.raises(CodegenError, match=rf"faults\[0\]\.{key}.*: not what codegen faults prints as JSON"):
            read_files([str(path)], CAN)
    monkeypatch.chdir(tmp_path)
    assert named("C1=a/b.csv") == ("C1", Path("a/b.csv"))
    assert named("a/b.csv") == ("", Path("a/b.csv"))
    Path("x=y.csv").touch()  # a valid file name
    assert named("x=y.csv") == ("", Path("x=y.csv"))
    exported.save(record(), tmp_path / "run.csv")
    np.testing.assert_array_equal(read_files(["mine=run.csv"], CAN).runs["mine"], record())
    Path("other").mkdir()
    exported.save(record(), Path("other/run.csv"))
    assert list(read_files(["run.csv", "other/run.csv"], CAN).runs) == ["run.csv", "other/run.csv"]
    with pytest.raises(CodegenError, match=r"a second run called 'run\.csv'"):
        read_files(["run.csv", "run.csv"], CAN)


@pytest.mark.usefixtures("in_this_process")
def test_a_scaled_channel_has_physical_values_and_invalid_ones_are_noted(tmp_path: Path) -> None:
    from asammdf import MDF, Signal

    count = 5
    columns = {name: np.zeros(count) for name in RECORD_COLUMNS} | {"time_s": 0.01 * np.arange(count)}
    signals = [Signal(values, columns["time_s"], name=name) for name, values in columns.items() if name != "speed_m_s"]
    raw, invalid = np.full(count, 2000, np.uint16), np.arange(count) == 3
    scaling = {"a": 0.01, "b": 0.0}
    signals.append(Signal(raw, columns["time_s"], name="speed_m_s", conversion=scaling, invalidation_bits=invalid))
    with MDF(version="4.10") as mdf:
        mdf.append(signals)
        mdf.save(tmp_path / "run.mf4")
    files = read_files([str(tmp_path / "run.mf4")], CAN)
    speed = files.runs["run"][:, RECORD_COLUMNS.index("speed_m_s")]
    np.testing.assert_allclose(speed, np.where(invalid, np.nan, 20.0))
    assert files.notes == ["run: 1 of 5 samples of speed_m_s are marked as invalid."]


@pytest.mark.usefixtures("in_this_process")
def test_texts_in_a_scaled_channel_are_no_values(tmp_path: Path) -> None:
    """Raw counts of such a channel were shown as m/s."""
    from asammdf import MDF, Signal

    columns = {name: np.zeros(5) for name in RECORD_COLUMNS} | {"time_s": 0.01 * np.arange(5)}
    signals = [Signal(values, columns["time_s"], name=name) for name, values in columns.items() if name != "speed_m_s"]
    raw = np.array([2000, 2000, 65535, 2000, 2000], np.uint16)
    reserved = {"val_0": 65535.0, "text_0": b"not available", "default_addr": {"a": 0.01, "b": 0.0}}
    signals.append(Signal(raw, columns["time_s"], name="speed_m_s", conversion=reserved))
    with MDF(version="4.10") as mdf:
        mdf.append(signals)
        mdf.save(tmp_path / "run.mf4")
    speed = read_files([str(tmp_path / "run.mf4")], CAN).runs["run"][:, RECORD_COLUMNS.index("speed_m_s")]
    np.testing.assert_allclose(speed, np.where(raw == 65535, np.nan, 20.0))


@pytest.mark.usefixtures("in_this_process")
def test_a_missing_channel_of_a_run_is_named(tmp_path: Path) -> None:
    from asammdf import MDF, Signal

    time = 0.01 * np.arange(5)
    with MDF(version="4.10") as mdf:
        mdf.append([Signal(time, time, name=name) for name in RECORD_COLUMNS[:3]])
        mdf.save(tmp_path / "run.mf4")
    expected = f"it has no channel {', '.join(RECORD_COLUMNS[3:])}; its channels are .*{', '.join(RECORD_COLUMNS[1:3])}"
    with pytest.raises(CodegenError, match=expected):
        read_files([str(tmp_path / "run.mf4")], CAN)


def test_messages_for_files_of_another_kind(tmp_path: Path) -> None:
    exported.save(np.vstack([record(), np.where(np.arange(12) == 0, np.inf, 0.0)]), tmp_path / "endless.csv")
    structs = pa.array([{"x": 1.0}] * 2)
    pq.write_table(pa.table(dict.fromkeys(RECORD_COLUMNS, structs)), tmp_path / "structs.parquet")
    log(tmp_path / "foreign.blf", [(0x77, 0.0, False), (0x77, 0.01, False)])
    for name, content, expected in (
        ("none.csv", None, "No such file"),
        ("endless.csv", None, "time_s is not finite"),
        ("foreign.blf", None, "no frame with an id of the build (0x101"),
        ("header.csv", "a,b\n1,2\n", "not the header of a run"),
        ("x.blf", "not a log", "not a readable log of a CAN bus"),
        ("x.mf4", "not MF4", "not a readable run"),
        ("entry.json", '{"faults": [{"injected": 1}]}', "not what codegen faults prints as JSON"),
        ("deep.json", "[" * 100_000, "not what codegen faults prints as JSON"),
        ("structs.parquet", None, "not a readable run"),
    ):
        if content is not None:
            (tmp_path / name).write_text(content, encoding="utf-8")
        with pytest.raises(CodegenError) as error:
            read_files([str(tmp_path / name)], CAN)
        assert expected in error.value.what
        assert error.value.remedy

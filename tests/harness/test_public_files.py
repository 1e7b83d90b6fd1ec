"""The account of public files: what a reader loses, and what it refuses in another way than in one line, is a fault."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest

from codegen import limits
from codegen.errors import CodegenError
from codegen.logs import account
from codegen.verify.outcomes import Effort, Verdict
from tests.evidence.progress import Progress
from tests.evidence.public import counts, files
from tests.identify import made
from tests.importing.conftest import in_this_process
from tests.logs.test_databases import DBC

__all__ = ["in_this_process"]

LONG = f"Name_of_{'x' * 30}"
LONG_NAMES = f'''BO_ 2 Long: 8 A
 SG_ Short : 0|8@1+ (1,0) [0|0] "" A
BA_DEF_ SG_ "SystemSignalLongSymbol" STRING ;
BA_DEF_ BO_ "SystemMessageLongSymbol" STRING ;
BA_ "SystemMessageLongSymbol" BO_ 2 "{LONG}_M";
BA_ "SystemSignalLongSymbol" SG_ 2 Short "{LONG}_S";
'''
OTHER = 'BO_ 1073741824 Beyond: 8 A\n SG_ Any : 0|8@1+ (1,0) [0|0] "" A\nCM_ "\nBO_ 9 no message: 8 A\n";\n'


def written(folder: Path) -> Path:
    """Write a file of each kind that python-can and a text editor write; one message and two kinds of logs are refused."""
    (folder / "deep").mkdir()
    (folder / "deep" / "car.DBC").write_text(DBC + OTHER, encoding="utf-8")
    for kind in ("asc", "blf", "log", "trc"):
        with can.Logger(folder / f"drive.{kind}") as log:
            for k in range(3):
                log(can.Message(timestamp=1.0 + k, arbitration_id=0x100 + k, is_extended_id=False, data=bytes([k]), channel=1))
            if kind != "trc":  # which has none
                log(can.Message(timestamp=4.0, is_error_frame=True, channel=1))
    return folder


def test_every_entry_is_read_or_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = files.run((written(tmp_path),), Effort(), Progress())
    assert (found.verdict, found.findings) == (Verdict.PASSED, ())
    assert found.figure == "5 files: 3 messages and 16 entries of logs, 0 faults"
    assert found.figures[".dbc"] == {"files": 1, "entries": 3, "read": 2, "refused": 1, "other": 0, "faults": 0}
    assert found.figures[".trc"] == {"files": 1, "entries": 3, "read": 0, "refused": 3, "other": 0, "faults": 0}
    assert "not a log; give .mf4" in capsys.readouterr().out


def test_names_of_over_32_characters_are_counted_by_their_whole_names(tmp_path: Path) -> None:
    path = tmp_path / "car.dbc"
    path.write_text(DBC + LONG_NAMES, encoding="utf-8")
    messages, signals, _ = counts.statements(path)
    assert (2, f"{LONG}_M") in messages and any(signal[:2] == (f"{LONG}_M", f"{LONG}_S") for signal in signals)
    assert files.account_of(path).faults == ()


def losing(real: Callable[..., Any], what: Callable[[Any], None]) -> Callable[..., Any]:
    """Return a reader whose result has lost something."""

    def read(*arguments: Any) -> Any:
        result = real(*arguments)
        what(result)
        return result

    return read


@pytest.mark.parametrize(
    ("function", "loss", "fault"),
    [
        ("load_database", lambda loaded: loaded.database.messages.pop(), "2 messages are not read, 1 are refused"),
        ("load_database", lambda loaded: loaded.database.messages[0].signals.pop(), "3 signals, 1 read, 1 refused"),
        ("load_database", lambda loaded: loaded.left_out.clear(), "1 messages are not read, 0 are refused"),
        ("open_log", lambda log: log.file.others.clear(), "entries by a plain count"),
        ("open_log", lambda log: log.frames.data.__setitem__(0, b"\x07"), "1 frames that python-can reads are not in"),
    ],
)
def test_a_loss_is_a_fault(
    function: str, loss: Callable[[Any], None], fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, function, losing(getattr(files, function), loss))
    found = files.run((written(tmp_path),), Effort(), Progress())
    assert found.verdict is Verdict.FAILED
    assert any(fault in line for line in found.findings), found.findings


@pytest.mark.parametrize("error", [KeyError(".trc"), CodegenError("two\nlines"), CodegenError("it names no file")])
def test_a_refusal_is_one_line_that_names_the_file(error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise error

    monkeypatch.setattr(files, "load_database", refuse)
    (tmp_path / "car.dbc").write_text(DBC, encoding="utf-8")
    assert files.account_of(tmp_path / "car.dbc").faults


def endless(path: Path) -> None:
    """Read for ever."""
    while path.exists():
        pass


@pytest.mark.parametrize("kind", ["asc", "mf4"])
def test_a_refusal_by_the_time_limit_is_a_fault(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In this process, and in that of a library: the limit of either is over before the file is read."""
    path = tmp_path / f"drive.{kind}"
    with can.Logger(path) as log:
        log(can.Message(timestamp=1.0, arbitration_id=0x100, is_extended_id=False, data=b"1", channel=1))
    monkeypatch.setattr(limits, "SECONDS", 0.05)
    monkeypatch.setitem(account.LOG_READERS, ".asc", endless)
    found = files.run((tmp_path,), Effort(), Progress())
    assert found.verdict is Verdict.FAILED
    assert any("its time is over, the machine may be too slow or too busy" in line for line in found.findings), found.findings


def test_objects_of_a_blf_are_counted_in_containers_and_outside(tmp_path: Path) -> None:
    with can.BLFWriter(tmp_path / "drive.blf") as log:
        for k in range(3):
            log(can.Message(timestamp=1.0 + k, arbitration_id=0x100))
    packed = (tmp_path / "drive.blf").read_bytes()
    (tmp_path / "drive.blf").write_bytes(packed + b"LOBJ" + bytes([16, 0, 1, 0, 16, 0, 0, 0, 115, 0, 0, 0]))
    assert counts.entries(tmp_path / "drive.blf") == 4


def test_a_folder_without_such_files_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(CodegenError, match="no file of the kinds"):
        files.run((tmp_path,), Effort(), Progress())


@pytest.mark.usefixtures("in_this_process")
def test_rows_of_a_measurement_are_compared_with_the_samples_of_its_groups(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = made.write_mf4(tmp_path / "drive.mf4")
    whole = files.account_of(path)
    assert whole.faults == () and whole.entries == whole.read == sum(counts.samples(path))
    monkeypatch.setattr(files, "open_log", losing(files.open_log, lambda account: account.groups.pop()))
    assert "samples in its groups" in files.account_of(path).faults[0]

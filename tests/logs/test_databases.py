"""Databases as they are in use: encodings, lines that break the rules, identifiers that occur twice, addresses of J1939."""

import contextlib
import re
from pathlib import Path

import pytest

from codegen.errors import CodegenError
from codegen.export.arxml import export
from codegen.logs.databases import Databases, load_database

GENERATED = Path(__file__).resolve().parents[2] / "generated"
DBC = """VERSION ""
NS_ :
BS_:
BU_: A
BO_ 256 Motion: 8 A
 SG_ YawRate : 16|16@1- (0.005,0) [0|0] "°/s" A
BO_ 257 Other: 8 A
 SG_ Level : 0|16@1- (0.005,0) [0|0] "" A
"""


def write(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "car.dbc"
    path.write_text(text, encoding=encoding)
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
def test_units_survive_every_encoding(encoding: str, tmp_path: Path) -> None:
    found = load_database(write(tmp_path, DBC, encoding))
    assert found.database.get_message_by_name("Motion").signals[0].unit == "°/s"
    assert not found.findings


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (' SG_ 0_COUNTER : 35|4@0+ (1,0) [0|255] "" A', "it breaks the grammar of a DBC"),
        ('CM_ SG_ 256 "no name of the signal";', "it breaks the grammar of a DBC"),
        ('CM_ "no end"', "it does not end with a semicolon"),
        ('VAL_ 256 Nothing 1 "on" ;', "there is no such signal"),
        ("SIG_VALTYPE_ 256 Nothing : 1;", "there is no such signal"),
        ('BO_ 1073741824 A: 8 A\n SG_ B : 0|8@1+ (1,0) [0|0] "" A', "the identifier of its message has more than 29 bits"),
        ('BO_ 3221225473 A: 8 A\n SG_ B : 0|8@1+ (1,0) [0|0] "" A', "the identifier of its message has more than 29 bits"),
        ('BA_ "Undefined" BO_ 256 20;', "its attribute or its value is not defined"),
        ('BA_REL_ "Undefined" BU_SG_REL_ A SG_ 256 YawRate 3;', "its attribute or its value is not defined"),
        ('VAL_ 256 YawRate 1.5 "x" ;', "cantools rejects it (invalid literal for int() with base 10: '1.5')"),
    ],
)
def test_a_line_that_breaks_the_rules_is_left_out_with_its_reason(line: str, reason: str, tmp_path: Path) -> None:
    found = load_database(write(tmp_path, f'{DBC}{line}\nCM_ "the end";\n'))
    assert [message.name for message in found.database.messages] == ["Motion", "Other"]
    texts = line.splitlines()
    assert [(each.number, each.text, each.reason) for each in found.left_out] == [
        (number, text.strip(), reason) for number, text in enumerate(texts, start=9)
    ]
    count = "1 line is" if len(texts) == 1 else f"{len(texts)} lines are"
    assert found.findings[0] == f"{count} left out: {reason} (first: line 9: {texts[0].strip()})"


def test_a_file_that_is_cut_short_says_so_at_each_place(tmp_path: Path) -> None:
    """cantools discards a last statement that is not whole, without an error."""
    text = DBC + 'VAL_ 257 Level 1 "on" ;\n'
    for end in range(len(DBC.splitlines()[0]) + 50, len(text) - 1):
        *whole, last = text[:end].split("\n")
        is_whole = (last.startswith("BO_ ") and last.endswith(": 8 A")) or (last.startswith(" SG_ ") and last.endswith('" A'))
        with contextlib.suppress(CodegenError):
            found = load_database(write(tmp_path, text[:end]))
            assert [each.number for each in found.left_out] == ([] if is_whole or not last.strip() else [len(whole) + 1]), last


ATTRIBUTE = """BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 257 {};
BA_ "VFrameFormat" BO_ 256 {};
"""


def test_values_that_an_attribute_cannot_have_are_left_out(tmp_path: Path) -> None:
    found = load_database(write(tmp_path, DBC + ATTRIBUTE.format(1, 14)))
    assert [each.number for each in found.left_out] == [12]
    found = load_database(write(tmp_path, DBC + ATTRIBUTE.format('"J1939PG"', 14)))
    assert [each.number for each in found.left_out] == [11, 12]
    assert len(found.database.messages) == 2


BYTE_ORDER = "its byte order is {}; write 0 (Motorola) or 1 (Intel) behind the @"


@pytest.mark.parametrize(
    ("lines", "reasons"),
    [
        ([' SG_ Speed : 0|16@1+ (0,0) [0|0] "km/h" A'], {1: "its factor is 0"}),
        ([' SG_ Speed : 0|16@2+ (1,0) [0|0] "km/h" A'], {1: BYTE_ORDER.format(2)}),
        ([' SG_ Speed : 0|16@-1+ (1,0) [0|0] "km/h" A'], {1: BYTE_ORDER.format(-1)}),
        ([' SG_ Speed : 0|16@1+ (1e999,0) [0|0] "km/h" A'], {1: "its factor is 1e999; give a finite number"}),
        ([' SG_ Speed : 0|16@1+ (nan,0) [0|0] "km/h" A'], {1: "its factor is nan; give a finite number"}),
        ([' SG_ Speed : 0|16@1+ (1,-inf) [0|0] "km/h" A'], {1: "its offset is -inf; give a finite number"}),
        ([' SG_ Speed : 0|16@1+ (0,01,0) [0|0] "km/h" A'], {1: "it breaks the grammar of a DBC"}),
        (
            [' SG_ Speed : 0|16@1+ (1,0) [0|0] "km/h" A', ' SG_ Speed : 0|16@1+ (2,0) [0|0] "km/h" A'],
            dict.fromkeys((1, 2), "another signal of its message has its name"),
        ),
        (
            [' SG_ Speed : 0|16@1+ (1,0) [0|0] "km/h" A', "SIG_VALTYPE_ 300 Speed : 1;"],
            {1: "it is a float of 16 bits", 2: "there is no such signal"},
        ),
        ([' SG_ M M : 32|8@1+ (1,0) [0|0] "" A', *(f' SG_ S m{key} : 0|8@1+ (1,0) [0|0] "" A' for key in (0, 1))], {}),
        ([' SG_ Speed : 0|32@1- (1,0) [0|0] "km/h" A', "SIG_VALTYPE_ 300 Speed : 1;"], {}),
    ],
)
def test_signals_whose_values_would_be_wrong_are_left_out(lines: list[str], reasons: dict[int, str], tmp_path: Path) -> None:
    text = "\n".join([DBC + "BO_ 300 Bad: 8 A", *lines, ""])
    found = load_database(write(tmp_path, text))
    assert {each.number - 9: each.reason for each in found.left_out} == reasons


@pytest.mark.parametrize("place", ["60|16@1+", "63|16@0+"])
def test_a_signal_beyond_its_message_does_not_hide_the_others(place: str, tmp_path: Path) -> None:
    text = DBC.replace(" SG_ YawRate", f' SG_ Far : {place} (1,0) [0|0] "" A\n SG_ YawRate')
    message = load_database(write(tmp_path, text)).database.get_message_by_name("Motion")
    assert message.decode(bytes([0, 0, 100, 0, 0, 0, 0, 0]), allow_truncated=True) == {"YawRate": 0.5}
    assert message.decode(bytes([0, 0, 100, *[0] * 7]), allow_truncated=True) == {"YawRate": 0.5, "Far": 0}


@pytest.fixture(scope="session")
def arxml() -> str:
    folder = export(GENERATED / "4ws2", "transformer")
    return folder.folder.files[folder.arxml].decode()


@pytest.mark.parametrize(
    ("numbers", "reason"), [("0 INF 1", "factor is inf"), ("NaN 1 1", "offset is nan"), ("0 1 INF", "factor is 0")]
)
def test_a_signal_of_an_arxml_with_a_wrong_scale_is_left_out(numbers: str, reason: str, arxml: str, tmp_path: Path) -> None:
    path, values = tmp_path / "car.arxml", iter(numbers.split())
    path.write_text(re.sub(r"(?<=<V>)[^<]*", lambda match: next(values, match[0]), arxml), encoding="utf-8")
    found = load_database(path)
    assert any(f"VehicleMotion.Motion_Crc is left out: its {reason}; " in finding for finding in found.findings)
    names = [signal.name for signal in found.database.get_message_by_name("VehicleMotion").signals]
    assert "Motion_Crc" not in names and "Speed" in names


def test_an_arxml_in_utf_16_is_read_with_its_mark_and_named_without(arxml: str, tmp_path: Path) -> None:
    path = tmp_path / "car.arxml"
    path.write_text(arxml, encoding="utf-16")
    assert len(load_database(path).database.messages) == 3
    path.write_text(arxml, encoding="utf-16-le")
    with pytest.raises(CodegenError, match="it is in UTF-16; save it as UTF-8"):
        load_database(path)
    path.write_text('<!DOCTYPE a [<!ENTITY b "c">]>' + arxml.partition("?>")[2], encoding="utf-16")
    with pytest.raises(CodegenError, match="declares"):
        load_database(path)


def test_signals_of_no_message_are_left_out_with_a_finding(tmp_path: Path) -> None:
    """They are in use: tools keep signals there that a message had once."""
    none = 'BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 Vector__XXX\n SG_ Old : 0|8@1+ (1,0) [0|0] "" A\n'
    found = load_database(write(tmp_path, DBC + none))
    assert [message.name for message in found.database.messages] == ["Motion", "Other"]
    text = 'SG_ Old : 0|8@1+ (1,0) [0|0] "" A'
    assert found.findings == (f"1 line is left out: a signal of no message (first: line 10: {text})",)


def test_what_is_no_dbc_is_refused_with_the_first_error(tmp_path: Path) -> None:
    with pytest.raises(CodegenError, match="not a readable database of a CAN bus"):
        load_database(write(tmp_path, "hello\nworld\n"))


def test_unmarked_identifiers_of_29_bits_are_extended_ones(tmp_path: Path) -> None:
    text = DBC.replace("257", "418119424") + 'VAL_ 418119424 Level 1 "on" ;\n'
    databases = Databases([write(tmp_path, text)])
    (other,) = databases.messages[418119424, True]
    assert other.message.signals[0].choices == {1: "on"}
    assert "1 identifiers of 29 bits are not marked" in databases.findings[0]


def test_two_messages_with_one_identifier_are_both_offered(tmp_path: Path) -> None:
    text = DBC + 'BO_ 256 MotionB: 8 A\n SG_ YawRate : 16|16@1- (0.01,0) [0|0] "°/s" A\n'
    databases = Databases([write(tmp_path, text)])
    assert databases.names_of((256, False)) == ["Motion", "MotionB"]
    assert databases.conflicts == {(256, False): "the identifier 0x100 is in Motion (car.dbc) and MotionB (car.dbc)"}
    assert databases.findings == ["car.dbc: the messages Motion and MotionB have the same identifier 0x100"]


def test_a_message_name_that_is_there_twice_is_a_finding(tmp_path: Path) -> None:
    """The findings are not those of the library, which speaks of its dictionaries."""
    text = DBC + 'BO_ 260 Motion: 8 A\n SG_ YawRate : 16|16@1- (0.01,0) [0|0] "°/s" A\n'
    databases = Databases([write(tmp_path, text)])
    finding = "car.dbc: the message name Motion is there twice; its messages differ by their identifiers"
    assert databases.findings == [finding]
    assert {(256, False), (260, False)} <= set(databases.messages)


@pytest.mark.parametrize(
    ("first", "second", "overlap"),
    [
        ("One : 0|16@1+", "Two : 8|8@1+", True),
        ("One : 0|16@1+", "Two : 16|8@1+", False),
        ("One : 7|16@0+", "Two : 8|8@1+", True),
        ("One : 7|16@0+", "Two : 23|8@0+", False),
        ("One : 3|12@0+", "Two : 0|4@1+", True),
        ("One : 3|12@0+", "Two : 4|4@1+", False),
        ("One m0 : 8|8@1+", "Two m1 : 8|8@1+", False),
        ("One m1 : 8|16@1+", "Two m1 : 16|8@1+", True),
        ("One m1 : 8|8@1+", "Two : 8|8@1+", True),
    ],
)
def test_signals_that_overlap_in_one_frame_are_a_finding(first: str, second: str, overlap: bool, tmp_path: Path) -> None:
    selector = "" if " m" not in first else ' SG_ Select M : 56|8@1+ (1,0) [0|0] "" A\n'
    text = f'{DBC}BO_ 300 Mixed: 8 A\n{selector} SG_ {first} (1,0) [0|0] "" A\n SG_ {second} (1,0) [0|0] "" A\n'
    findings = Databases([write(tmp_path, text)]).findings
    expected = "car.dbc: signals of 1 message overlap; check their start bits (first: Mixed: One and Two)"
    assert findings == ([expected] if overlap else [])


def test_equal_messages_of_two_databases_are_one(tmp_path: Path) -> None:
    first = write(tmp_path, DBC)
    second = tmp_path / "second.dbc"
    second.write_text(DBC, encoding="utf-8")
    databases = Databases([first, second])
    assert not databases.conflicts
    assert databases.names_of((256, False)) == ["Motion"]


def test_the_null_address_of_j1939_is_any_source(tmp_path: Path) -> None:
    """EEC1 (PDU2), and TSC1 (PDU1), whose lower byte is a destination, of another priority."""
    text = DBC.replace("256", str(0x8CF004FE)).replace("257", str(0x8C0000FE))
    databases = Databases([write(tmp_path, text)])
    assert databases.key_of(0x18F0040B, True) == (0x0CF004FE, True)
    assert databases.key_of(0x0C00030B, True) == (0x0C0000FE, True)
    assert databases.key_of(0x18F0050B, True) is None
    assert databases.key_of(0x0CF004FE, False) is None

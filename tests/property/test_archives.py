"""The loader of maps with repeatedly damaged bytes and with well-formed but wrong headers."""

import re
import struct
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from codegen.errors import CodegenError, MapError
from codegen.map_file import map as refmap
from codegen.map_file.map import Layer, ReferenceMap
from codegen.map_file.tables import FRICTION_STACK
from tests.map_file.test_map import npy, packed, solved_arrays
from tests.property.guard import MEMORY_MAX, bounded

ARRAYS = solved_arrays()
PLAIN = ("vx", "delta_f", "yaw_rate")
SOLVED = refmap.from_arrays(ARRAYS, "test")
LAYERS = tuple(Layer(FRICTION_STACK, friction, SOLVED) for friction in (0.3, 0.6))
STACKED = ReferenceMap(**{**vars(SOLVED), "layers": LAYERS})


def archive(members: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    return packed([(f"{key}.npy", content) for key, content in members.items()], compression)


MEMBERS = {key: npy(array) for key, array in ARRAYS.items()}
OURS = tuple(map(refmap.to_bytes, (SOLVED, STACKED)))
ARCHIVES = (archive({key: MEMBERS[key] for key in PLAIN}), archive(MEMBERS, zipfile.ZIP_DEFLATED), *OURS)


def check(data: bytes) -> None:
    """Load a map. The result must be a complete map or one line of error."""
    with bounded():
        try:
            loaded = refmap.from_bytes(data, "fuzz")
        except MapError as error:
            assert error.remedy
            assert "\n" not in str(error)
            return
        for found in (loaded, *(layer.map for layer in loaded.layers)):
            assert found.yaw_rate.shape == found.feasible.shape == (loaded.speed.size, loaded.front_angle.size)
            np.testing.assert_array_equal(np.isnan(found.yaw_rate), ~found.feasible)
            assert found.feasible.any()
        assert refmap.to_bytes(refmap.from_bytes(refmap.to_bytes(loaded), "again")) == refmap.to_bytes(loaded)


PLACE = st.floats(0.0, 1.0, exclude_max=True)
SIGNATURES = (b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06", b"\x93NUMPY", b"'descr'", b"'shape'")
"""Beginnings of the fields that hold sizes."""
SHORT = (0, 1, 2, 0x7FFF, 0xFFFF)
FIELDS = [struct.pack("<H", one) for one in SHORT]
FIELDS += [struct.pack("<I", one) for one in (*SHORT, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF)]


class ChangedArchive(RuleBasedStateMachine):
    """One archive, changed at random places. Each change is checked."""

    data = bytearray(ARCHIVES[0])

    @initialize(start=st.sampled_from(ARCHIVES))
    def begin(self, start: bytes) -> None:
        self.data = bytearray(start)

    @rule(place=PLACE, removed=st.integers(0, 400) | st.just(1), new=st.binary(max_size=12) | st.binary(min_size=1, max_size=1))
    def replace(self, place: float, removed: int, new: bytes) -> None:
        at = int(place * len(self.data))
        self.data[at : at + removed] = new

    @rule(start=st.sampled_from(SIGNATURES), which=st.integers(0, 9), offset=st.integers(0, 46), field=st.sampled_from(FIELDS))
    def change_a_size(self, start: bytes, which: int, offset: int, field: bytes) -> None:
        places = [found.end() for found in re.finditer(re.escape(start), self.data)]
        if places:
            where = places[which % len(places)] + offset
            if where + len(field) <= len(self.data):
                self.data[where : where + len(field)] = field

    @invariant()
    def is_read_or_refused(self) -> None:
        check(bytes(self.data))


TestChangedArchive = ChangedArchive.TestCase
TestChangedArchive.settings = settings(max_examples=10, stateful_step_count=8, deadline=None)


TYPES = "<f8 >f8 <f4 <f2 <i8 |i1 |u1 |b1 <c16 |O |V8 |S0 <U1 <U100000000 <M8[s] <f16 f8,f8"
OTHERS = ("[('a', '<f8')]", "[('a', '|O')]", "('<f8', (2,))", "None", "8")
DESCRIPTIONS = st.sampled_from([*map(repr, TYPES.split()), *OTHERS])
SIZES = st.sampled_from([-1, 0, 1, 2, 3, 6, 2**16, 2**31, 2**32, 2**62, 2**63, 2**64])
HEADERS = st.builds(
    "{{'descr': {}, 'fortran_order': {}, 'shape': {}, {}}}".format,
    DESCRIPTIONS,
    st.sampled_from(["True", "False", "None", "2"]),
    st.lists(SIZES, max_size=4).map(tuple) | st.sampled_from(["[3]", "3", "(3.0,)", "((3,),)", "'x'"]),
    st.sampled_from(["", "'x': 1", "'shape': (3,)", "(", "'a'*9"]),
)


@settings(max_examples=40, deadline=None)
@given(
    key=st.sampled_from(sorted(MEMBERS)),
    header=HEADERS,
    version=st.sampled_from([b"\1\0", b"\2\0", b"\3\0", b"\0\0", b"\xff\1"]),
    claimed=st.none() | st.integers(0, 2**16 - 1),
    content=st.sampled_from([b"", *(ARRAYS[key].tobytes() for key in ("vx", "yaw_rate")), bytes(100)]) | st.binary(max_size=64),
    compression=st.sampled_from([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED]),
)
def test_wrong_headers(key: str, header: str, version: bytes, claimed: int | None, content: bytes, compression: int) -> None:
    text = header.encode() + b"\n"
    length = struct.pack("<H" if version[0] == 1 else "<I", len(text) if claimed is None else claimed)
    check(archive({**MEMBERS, key: b"\x93NUMPY" + version + length + text + content}, compression))


@pytest.mark.parametrize(("key", "kind"), [("vx", np.int8), ("feasible", np.bool_)])
def test_narrow_numbers_do_not_unpack_to_more_than_the_limit(key: str, kind: type) -> None:
    """A file of some kB unpacks to 60 MiB of one-byte numbers; as real numbers they would need eight times as many bytes.

    The limit covers the bytes read and the arrays made from them; 4 MiB are for the rest.
    """
    arrays = {key: ARRAYS[key] for key in PLAIN} | {key: np.ones(60 * 2**20, dtype=kind)}
    data = archive({key: npy(array) for key, array in arrays.items()}, zipfile.ZIP_DEFLATED)
    assert len(data) < 2**20
    with bounded(2 * MEMORY_MAX + 2**22), pytest.raises(CodegenError):
        refmap.from_bytes(data, "fuzz")

"""Small files that ask for much work or memory: packed zeros, names of names, types inside types."""

from __future__ import annotations

import functools
import io
import struct
import subprocess
import tempfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import savemat

from codegen.sil.toolchain import compiler_command

MIB = 2**20
OBJECT = struct.Struct("<4sHHLL")
HEAD = b"LOGG" + struct.pack("<L", 144) + bytes(136)


@dataclass(frozen=True)
class Hostile:
    """A kind of hostile file.

    Attributes:
        loader: name of its loader in `tests.loader_cases`.
        make: returns the content for a size from 0 to 1; 1 is the largest one.
    """

    loader: str
    make: Callable[[float], bytes]


# --- BLF -----------------------------------------------------------------------------------------------------------------


def _container(content: bytes, level: int = 1) -> bytes:
    packed = struct.pack("<H6xL4x", 2, len(content)) + zlib.compress(content, level)
    size = OBJECT.size + len(packed)
    return OBJECT.pack(b"LOBJ", OBJECT.size, 1, size, 10) + packed + bytes(size % 4)


@functools.cache
def _zeros(first: bytes = b"") -> bytes:
    return _container(first + bytes(64 * MIB - len(first)))


def blf_of_zeros(size: float) -> bytes:
    """6 GiB of zeros."""
    return HEAD + _zeros() * round(1 + 95 * size)


def blf_with_an_endless_object(size: float) -> bytes:
    """An object over all containers."""
    length = 64 * MIB * round(1 + 63 * size) - 16
    return HEAD + _zeros(OBJECT.pack(b"LOBJ", OBJECT.size, 1, length, 65)) + _zeros() * round(95 * size)


@functools.cache
def _objects() -> bytes:
    return _container(OBJECT.pack(b"LOBJ", OBJECT.size, 1, OBJECT.size, 65) * (4 * MIB), 9)


def blf_of_empty_objects(size: float) -> bytes:
    """400 million objects."""
    return HEAD + _objects() * round(1 + 95 * size)


# --- tables --------------------------------------------------------------------------------------------------------------


@functools.cache
def parquet_of_many_rows(size: float) -> bytes:
    """200 million rows."""
    import pyarrow as pa
    from pyarrow import parquet

    buffer = io.BytesIO()
    column = pa.array(np.zeros(2_000_000))
    names = ("time_s", "vx_m_s", "yaw_rate_rad_s", "lateral_acceleration_m_s2", "front_angle_rad", "rear_angle_rad")
    names += ("rear_angle_command_rad", "sideslip_rad")
    table = pa.table(dict.fromkeys(names, column))
    with parquet.ParquetWriter(buffer, table.schema, compression="zstd") as writer:
        for _ in range(round(2 + 98 * size)):
            writer.write_table(table)
    return buffer.getvalue()


def table_of_many_columns(size: float) -> bytes:
    """A line of 16 million cells."""
    count = round(1000 + 1.6e7 * size)
    return b"vx" + b";1" * count + b"\n1" + b";2" * count + b"\n"


def table_of_many_rows(size: float, names: bytes = b"vx_m_s;delta_f_rad;yaw_rate_rad_s") -> bytes:
    """10 million lines."""
    return names + b"\n" + b"1;2;3\n" * round(1000 + 1e7 * size)


def drive_of_many_rows(size: float) -> bytes:
    """10 million samples."""
    return table_of_many_rows(size, b"time_s;vx_m_s;yaw_rate_rad_s")


@functools.cache
def mat_of_zeros(size: float) -> bytes:
    """A packed matrix of 512 MB."""
    buffer, count = io.BytesIO(), round(100 + 7900 * size)
    savemat(
        buffer, {"vx": np.zeros(count), "delta_f": np.zeros(count), "yaw_rate": np.zeros((count, count))}, do_compression=True
    )
    return buffer.getvalue()


@functools.cache
def mf4_of_zeros(size: float) -> bytes:
    """20 million packed samples."""
    from asammdf import MDF, Signal

    with tempfile.TemporaryDirectory() as folder, MDF() as mdf:
        time = np.arange(round(1000 + 2e7 * size), dtype=np.float64)
        for name in ("vx_m_s", "yaw_rate_rad_s"):
            mdf.append([Signal(np.zeros(time.size), time, name=name, unit="m/s")])
        return Path(mdf.save(Path(folder) / "zeros.mf4", compression=2)).read_bytes()


# --- XML and databases ---------------------------------------------------------------------------------------------------


def _cdf(declarations: str, content: str) -> bytes:
    return f"<?xml version='1.0'?><!DOCTYPE MSRSW [{declarations}]><MSRSW><CATEGORY>CDF20</CATEGORY>{content}</MSRSW>".encode()


def cdf_with_default_values(size: float) -> bytes:
    """20,000 elements that get an attribute of 100 kB each: 2 GB."""
    return _cdf(f'<!ATTLIST V a CDATA "{"x" * 100_000}">', "<V/>" * round(20_000 * size))


def cdf_with_entities(size: float) -> bytes:
    """Names of names: 10^9 letters."""
    names = "".join(f'<!ENTITY a{k + 1} "{f"&a{k};" * 10}">' for k in range(round(1 + 8 * size)))
    return _cdf(f'<!ENTITY a0 "x">{names}', "&a1;")


def cdf_of_many_elements(size: float) -> bytes:
    """16 million elements."""
    return _cdf("", "<V/>" * round(1.6e7 * size))


def arxml_with_default_values(size: float) -> bytes:
    """See `cdf_with_default_values`."""
    return cdf_with_default_values(size).replace(b"MSRSW", b"AUTOSAR")


def dbc_of_many_signals(size: float) -> bytes:
    """200,000 messages."""
    lines = [f'BO_ {k} M{k}: 8 A\n SG_ S : 0|8@1+ (1,0) [0|0] "" A\n' for k in range(round(10 + 2e5 * size))]
    return ('VERSION ""\nBS_:\nBU_: A\n' + "".join(lines)).encode()


# --- programs ------------------------------------------------------------------------------------------------------------


@functools.cache
def _program(source: str) -> bytes:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "program"
        path.with_suffix(".c").write_text(source, encoding="ascii")
        command = [*compiler_command(), "-g", "-no-pie", str(path.with_suffix(".c")), "-o", str(path)]
        subprocess.run(command, check=True)
        return path.read_bytes()


@functools.cache
def program_with_types_inside_types(size: float) -> bytes:
    """Structs with 12 structs with 12 structs: 36 million members in some lines."""
    levels = round(1 + 6 * size)
    types = ["typedef struct { float x; } L0;"]
    types += [f"typedef struct {{ {' '.join(f'L{k} m{m};' for m in range(12))} }} L{k + 1};" for k in range(levels)]
    return _program("\n".join([*types, f"L{levels} bomb;", "int main(void) { return 0; }"]))


@functools.cache
def program_with_packed_zeros(size: float) -> bytes:
    """Debug information of 3 GiB, packed into 13 MB."""
    from elftools.elf.elffile import ELFFile

    content = bytearray(_program("int counter = 1;\nint main(void) { return counter; }\n"))
    file = ELFFile(io.BytesIO(bytes(content)))
    index = next(k for k, section in enumerate(file.iter_sections()) if section.name == ".debug_info")
    length = round(MIB + 3 * 2**30 * size)
    packer, piece = zlib.compressobj(1), bytes(MIB)
    packed = b"".join(packer.compress(piece) for _ in range(length // MIB)) + packer.flush()
    header = file["e_shoff"] + index * file["e_shentsize"]
    flags, place, total = header + 8, header + 24, header + 32  # of a 64-bit section header
    struct.pack_into("<Q", content, flags, 0x800)
    struct.pack_into("<QQ", content, place, len(content), 24 + len(packed))
    assert total == place + 8
    return bytes(content) + struct.pack("<LLQQ", 1, 0, length // MIB * MIB, 1) + packed


def records_in_many_pieces(size: float) -> bytes:
    """300,000 S-records with a gap after each, in any order."""
    lines = []
    for place in np.random.default_rng(1).permutation(round(10 + 3e5 * size)).tolist():
        data = struct.pack(">BIB", 6, 16 * place, 1)
        lines.append(f"S3{data.hex().upper()}{~sum(data) & 0xFF:02X}\n")
    return "".join(lines).encode()


def hex_records_in_many_pieces(size: float) -> bytes:
    """300,000 records of Intel HEX with a gap after each."""

    def line(address: int, kind: int, data: bytes) -> str:
        content = struct.pack(">BHB", len(data), address, kind) + data
        return f":{(content + bytes([-sum(content) & 0xFF])).hex().upper()}\n"

    lines = []
    for place in range(0, 16 * round(10 + 3e5 * size), 16):
        if not place & 0xFFFF:
            lines.append(line(0, 4, struct.pack(">H", place >> 16)))
        lines.append(line(place & 0xFFFF, 0, b"\1"))
    return "".join(lines).encode()


HOSTILE: Mapping[str, Hostile] = {
    "BLF, zeros": Hostile("drive, blf", blf_of_zeros),
    "BLF, endless object": Hostile("log, blf", blf_with_an_endless_object),
    "BLF, empty objects": Hostile("drive, blf", blf_of_empty_objects),
    "Parquet, rows": Hostile("drive, parquet", parquet_of_many_rows),
    "table, columns": Hostile("text table", table_of_many_columns),
    "table, rows": Hostile("text table", table_of_many_rows),
    "drive, rows": Hostile("drive, csv", drive_of_many_rows),
    "MATLAB, zeros": Hostile("MATLAB file", mat_of_zeros),
    "MF4, zeros": Hostile("drive, mf4", mf4_of_zeros),
    "CDF, default values": Hostile("calibration, .cdfx", cdf_with_default_values),
    "CDF, entities": Hostile("calibration, .cdfx", cdf_with_entities),
    "CDF, elements": Hostile("calibration, .cdfx", cdf_of_many_elements),
    "ARXML, default values": Hostile("database, ARXML", arxml_with_default_values),
    "DBC, messages": Hostile("database", dbc_of_many_signals),
    "ELF, types": Hostile("program", program_with_types_inside_types),
    "ELF, packed zeros": Hostile("program", program_with_packed_zeros),
    "S-record, pieces": Hostile("image, S-record", records_in_many_pieces),
    "Intel HEX, pieces": Hostile("image, Intel HEX", hex_records_in_many_pieces),
}

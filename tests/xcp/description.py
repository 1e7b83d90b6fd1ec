"""Content of an A2L that a calibration tool needs before it connects, read by pya2l: slave, bus, lists, pages, objects."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FORMATS = {"UBYTE": "B", "UWORD": "H", "ULONG": "I", "FLOAT32_IEEE": "f", "FLOAT64_IEEE": "d"}
"""Types of numbers in the notation of `struct`."""


def tools() -> dict[str, str]:
    """Return the environment with the programs installed with this Python."""
    return {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}


def read_module(path: Path) -> dict[str, Any]:
    """Return the module of an A2L as read by pya2l."""
    read = path.with_suffix(".json")
    subprocess.run(["pya2l", str(path), "to_json", "-o", str(read)], check=True, capture_output=True, env=tools())
    module: dict[str, Any] = json.loads(read.read_text())["PROJECT"]["MODULE"][0]
    return module


class Block:
    """A block of IF_DATA: its values, and the blocks in it by name."""

    def __init__(self, elements: list[dict[str, Any]]) -> None:
        self.values: list[int | float | str] = []
        self._blocks: list[tuple[str, Block]] = []
        for element in elements:
            ((kind, content),) = element.items()
            if kind == "Generic":
                self._blocks.append((content["Name"]["Value"], Block(content.get("Element", []))))
            else:  # pya2l omits the value 0
                self.values.append(int(content.get("Value", "0"), 0) if kind == "Long" else content.get("Value", ""))

    def after(self, keyword: str) -> int | float | str:
        """Return the value after a keyword that occurs once."""
        assert self.values.count(keyword) == 1, keyword
        return self.values[self.values.index(keyword) + 1]

    def blocks(self, name: str) -> Iterator["Block"]:
        return (block for found, block in self._blocks if found == name)

    def __getitem__(self, name: str) -> "Block":
        (block,) = self.blocks(name)
        return block


def if_data(holder: dict[str, Any]) -> Block:
    """Return the IF_DATA XCP of a module, a memory segment or a measurement."""
    (found,) = holder["IF_DATA"]
    assert found["Name"]["Value"] == "XCP"
    return Block(found["Blob"])


@dataclass(frozen=True)
class Measured:
    """Address, type in the notation of `struct`, and default event of a measurement."""

    address: int
    format: str
    event: int


@dataclass(frozen=True)
class Description:
    """An A2L, read by pya2l."""

    module: dict[str, Any]

    @classmethod
    def read(cls, path: Path) -> "Description":
        """Read a file."""
        return cls(read_module(path))

    @property
    def xcp(self) -> Block:
        """The IF_DATA XCP of the module."""
        return if_data(self.module)

    @property
    def bus(self) -> dict[str, int]:
        """Identifiers and bit rates by the names of pyxcp."""
        names = {"can_id_master": "CAN_ID_MASTER", "can_id_slave": "CAN_ID_SLAVE", "bitrate": "BAUDRATE"}
        on_can = self.xcp["XCP_ON_CAN"]
        found = {name: int(on_can.after(keyword)) for name, keyword in names.items()}
        for fd in on_can.blocks("CAN_FD"):
            found |= {"fd": True, "data_bitrate": int(fd.after("CAN_FD_DATA_TRANSFER_BAUDRATE"))}
        return found

    @property
    def order(self) -> str:
        """Byte order, in the notation of `struct`."""
        return "<" if "BYTE_ORDER_MSB_LAST" in self.xcp["PROTOCOL_LAYER"].values else ">"

    @property
    def commands(self) -> list[str]:
        """The optional commands."""
        values = self.xcp["PROTOCOL_LAYER"].values
        return [str(values[k + 1]) for k, value in enumerate(values) if value == "OPTIONAL_CMD"]

    @property
    def segment(self) -> dict[str, Any]:
        """The memory segment of the calibration."""
        (found,) = self.module["MOD_PAR"]["MEMORY_SEGMENT"]
        return dict(found)

    @property
    def measured(self) -> dict[str, Measured]:
        """Every measurement by name."""
        return {
            each["Name"]["Value"]: Measured(
                int(each["ECU_ADDRESS"]["Address"].get("Value", "0"), 0),
                FORMATS[each["DataType"]["Value"]],
                int(if_data(each)["DAQ_EVENT"]["DEFAULT_EVENT_LIST"].after("EVENT")),
            )
            for each in self.module["MEASUREMENT"]
        }

    def value(self, name: str) -> tuple[int, str]:
        """Return address and type, in the notation of `struct`, of a characteristic that is one number."""
        (found,) = (each for each in self.module["CHARACTERISTIC"] if each["Name"]["Value"] == name)
        (layout,) = (each for each in self.module["RECORD_LAYOUT"] if each["Name"]["Value"] == found["Deposit"]["Value"])
        return int(found["Address"].get("Value", "0"), 0), FORMATS[layout["FNC_VALUES"]["DataType"]["Value"]]

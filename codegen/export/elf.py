"""Addresses and types of the variables of a program, read from ELF and DWARF with pyelftools."""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path, PurePath
from typing import Any, Literal, Self

from codegen.errors import BuildError, CodegenError
from codegen.files import read_file, refuse_empty
from codegen.limits import SMALL_SLOW_BYTES, Limits
from codegen.requirements import missing

ELF_BYTES_MAX = 2**30
"""Largest program file with debug information, in bytes."""
_SHF_ALLOC = 2
_SHF_EXECINSTR = 4

Kind = Literal["float", "unsigned", "signed"]

_STEP = re.compile(r"(?P<name>[A-Za-z_]\w*)|\.(?P<field>[A-Za-z_]\w*)|\[(?P<index>\d+)\]")
_ADDRESS_OF, _ADDRESS_AT = 0x03, 0xA1  # DW_OP_addr, DW_OP_addrx: DWARF 5, section 7.7.1
_KINDS: dict[int, Kind] = {0x02: "unsigned", 0x04: "float", 0x05: "signed", 0x06: "signed", 0x07: "unsigned", 0x08: "unsigned"}
"""Kind by DW_AT_encoding (section 7.8): boolean, float, signed, signed char, unsigned, unsigned char."""
_SPLIT_NAMES = "DW_AT_dwo_name", "DW_AT_GNU_dwo_name"
"""Attributes of a unit that only names the file with its content: DWARF 5, section 3.1.2; and GCC before."""
_STRUCTS = ("DW_TAG_structure_type", "DW_TAG_class_type", "DW_TAG_union_type")
_FUNCTIONS = ("DW_TAG_subprogram", "DW_TAG_lexical_block")
_C = (0x01, 0x02, 0x0C, 0x1D, 0x2C, 0x3E)
"""Values of DW_AT_language for the C standards of 1989 to 2023 (table 7.17, and later additions)."""
_TRANSPARENT = ("DW_TAG_typedef", "DW_TAG_const_type", "DW_TAG_volatile_type")
DEPTH_MAX = 8
"""Nesting depth of structs that are searched for an object of a type."""


@dataclass(frozen=True)
class MemoryObject:
    """An object in memory, or a part of one.

    Attributes:
        address: address on the target.
        size: bytes of one number.
        count: number of consecutive numbers.
    """

    address: int
    size: int
    kind: Kind
    count: int

    @property
    def bytes(self) -> int:
        """Return the size of all elements."""
        return self.size * self.count


@dataclass(frozen=True)
class _Variable:
    """A variable of the program. unit: name of its source file."""

    address: int
    type: Any
    unit: str


class Elf:
    """A linked program.

    Attributes:
        name: file name.
        content: bytes of the file.
        is_little: whether the target is little-endian.

    A shared library is accepted with `shared`; its addresses are relative to its base.
    """

    def __init__(self, name: str, content: bytes, *, shared: bool = False) -> None:
        self.name, self.content, self._type = name, content, "ET_DYN" if shared else "ET_EXEC"
        self._limits = Limits.of(len(content), SMALL_SLOW_BYTES)
        with self._reading():
            self._read()

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Limit time and memory of pyelftools, and convert its exceptions to BuildError."""
        with self._limits.enforced(self.name, BuildError), _whole(self.name):
            yield

    def _read(self) -> None:
        self._file = _parsed(self.name, self.content)
        if self._file["e_type"] != self._type:
            raise BuildError(
                "no program with addresses of its own",
                where=self.name,
                remedy="give the linked program; on a PC, link it with -no-pie",
            )
        if any(each["sh_flags"] & _SHF_EXECINSTR and each["sh_type"] == "SHT_NOBITS" for each in self._file.iter_sections()):
            raise BuildError(
                "it has debug information alone, without code and values (objcopy --only-keep-debug)",
                where=self.name,
                remedy="give the linked program itself",
            )
        self.is_little: bool = self._file.little_endian
        self._symbols = self._read_symbols()
        self._variables = self._read_variables()

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a program. Raises BuildError: not an ELF, not linked, or without symbols or debug information."""
        content = read_file(path, ELF_BYTES_MAX, "give the linked program", BuildError)
        refuse_empty(len(content), path, BuildError)
        return cls(str(path), content)

    def is_stripped_to(self, other: bytes) -> bool:
        """Return whether another file of the program has the same sections in memory, at the same addresses."""

        def loaded(file: Any) -> list[tuple[str, int, bytes]]:
            sections = [each for each in file.iter_sections() if each["sh_flags"] & _SHF_ALLOC]
            return [(each.name, each["sh_addr"], each.data()) for each in sections]

        with self._reading():
            return loaded(self._file) == loaded(_parsed(self.name, other))

    def place(self, path: str) -> MemoryObject | None:
        """Return the place of `name.field[2]`, or of `file.c:name` if several files have the name; None if the program has
        none.

        Raises BuildError: the name is ambiguous, has no such part, or the part is not a number.
        """
        with self._reading():
            return self._place(path)

    def _place(self, path: str) -> MemoryObject | None:
        unit, _, inside = path.rpartition(":")
        steps = list(_STEP.finditer(inside))
        if not steps or "".join(step[0] for step in steps) != inside:
            return None
        found = [each for each in self._variables.get(steps[0]["name"] or "", ()) if unit in ("", each.unit)]
        if len({each.address for each in found}) > 1:
            units = ", ".join(sorted(each.unit for each in found))
            raise BuildError(
                f"several variables {steps[0][0]}: in {units}", where=self.name, remedy="name one as file.c:variable"
            )
        if not found:
            return None
        if found[0].type is None:
            raise BuildError(
                f"{steps[0][0]} has no type in its debug information", where=self.name, remedy="compile with -g, not with -g1"
            )
        address, (lengths, element) = found[0].address, _dimensions(found[0].type)
        for step in steps[1:]:
            if step["index"] and lengths and int(step["index"]) < lengths[0]:
                lengths = lengths[1:]
                address += int(step["index"]) * math.prod(lengths) * int(element.attributes["DW_AT_byte_size"].value)
                continue
            member = None if lengths else _member(element, step["field"])
            if member is None:
                raise BuildError(f"{path} has no {step[0]}", where=self.name, remedy="link the program with this build")
            address += _offset(member)
            lengths, element = _dimensions(_referenced(member, "DW_AT_type"))
        kind: Kind | None = "unsigned" if element.tag == "DW_TAG_enumeration_type" else None
        if element.tag == "DW_TAG_base_type":
            kind = _KINDS.get(element.attributes["DW_AT_encoding"].value)
        if kind is None:
            raise BuildError(f"{path} is not a number", where=self.name, remedy="link the program with this build")
        return MemoryObject(address, element.attributes["DW_AT_byte_size"].value, kind, math.prod(lengths))

    def instances(self, type_name: str) -> list[str]:
        """Return the paths of all objects of a named type, including members of structs."""
        paths: set[str] = set()
        search = _Search(type_name)
        with self._reading():
            units = self._units_with(type_name)
            for name, variables in self._variables.items():
                several = len({each.address for each in variables}) > 1
                for each in variables:
                    if units is not None and each.type is not None and each.type.cu.cu_offset not in units:
                        continue
                    for path in search.paths(each.type, f"{each.unit}:{name}" if several else name, DEPTH_MAX):
                        paths.add(path)
                        if len(paths) > INSTANCES_MAX:
                            raise BuildError(
                                f"more than {INSTANCES_MAX:,} objects of the type {type_name}",
                                where=self.name,
                                remedy="link the program without the arrays and structs of so many",
                            )
        return sorted(paths)

    def _units_with(self, type_name: str) -> set[int] | None:
        """Return the offsets of the units with a named type; None if types of one unit may be in another one."""
        tops = [unit.get_top_DIE() for unit in self._units]
        if self._file.get_section_by_name(".debug_types") or any(top.tag != "DW_TAG_compile_unit" for top in tops):
            return None
        return {
            top.cu.cu_offset
            for top in tops
            if any(each.tag == "DW_TAG_typedef" and _name(each) == type_name for each in children(top))
        }

    def bytes_at(self, address: int, size: int) -> bytes | None:
        """Return the initial bytes at an address; None if the file does not contain them, as for zeroed memory."""
        found = self._loaded(address, size)
        return None if found is None else self.content[found[0] : found[0] + size]

    def replaced(self, parts: Mapping[int, bytes]) -> bytes:
        """Return the file with other initial bytes at addresses that it contains. Raises ValueError: it does not."""
        content = bytearray(self.content)
        for address, data in parts.items():
            found = self._loaded(address, len(data))
            if found is None:
                raise ValueError(f"no bytes at 0x{address:X}")
            content[found[0] : found[0] + len(data)] = data
        return bytes(content)

    def load_address(self, address: int, size: int) -> int:
        """Return the address at which a programmer writes the initial bytes, in flash for data that is copied to RAM."""
        found = self._loaded(address, size)
        return address if found is None else found[1]

    def _loaded(self, address: int, size: int) -> tuple[int, int] | None:
        """Return offset in the file and load address of initial bytes; None if the file does not contain them."""
        with self._reading():
            for segment in self._file.iter_segments("PT_LOAD"):
                offset = address - segment["p_vaddr"]
                if offset >= 0 and offset + size <= segment["p_filesz"]:
                    return segment["p_offset"] + offset, segment["p_paddr"] + offset
        return None

    def _read_symbols(self) -> dict[str, set[int]]:
        table = self._file.get_section_by_name(".symtab")
        if table is None:
            raise BuildError("no symbols", where=self.name, remedy="take the ELF as linked, before it is stripped")
        found: dict[str, set[int]] = {}
        self._own: dict[str, set[int]] = {}
        source: set[int] = set()
        for symbol in table.iter_symbols():
            info = symbol["st_info"]
            if info["type"] == "STT_FILE":
                source = self._own.setdefault(symbol.name, set())
            elif info["type"] == "STT_OBJECT" and symbol["st_shndx"] != "SHN_UNDEF":
                # A variable inside a function is `name.number`.
                found.setdefault(symbol.name.partition(".")[0], set()).add(symbol["st_value"])
                if info["bind"] == "STB_LOCAL":
                    source.add(symbol["st_value"])
        return found

    def _read_variables(self) -> dict[str, list[_Variable]]:
        if not self._file.has_dwarf_info(strict=True):
            raise BuildError("no debug information", where=self.name, remedy="compile with -g: it takes no memory of the ECU")
        found: dict[str, list[_Variable]] = {}
        self._taken: set[int] = set()
        dwarf = self._file.get_dwarf_info()
        self._units = list(dwarf.iter_CUs())
        _make_types_known(dwarf, self._units)
        for unit in self._units:
            top = unit.get_top_DIE()
            if split := next((_name(top, each) for each in _SPLIT_NAMES if each in top.attributes), ""):
                raise BuildError(
                    f"its debug information is in files of its own, such as {PurePath(split).name}",
                    where=self.name,
                    remedy="compile without -gsplit-dwarf",
                )
            source = PurePath(_name(top)).name
            own = self._own.get(source) if _language(top) in _C else None
            functions: list[Any] = []
            self._take(_variables_below(top, functions), source, found)
            # Most entries are inside functions, but few variables with an address are, and those are local symbols.
            if own is None or not own <= self._taken:
                while functions:
                    self._take(_variables_below(functions.pop(), functions), source, found)
        return found

    def _take(self, entries: Iterable[Any], source: str, found: dict[str, list[_Variable]]) -> None:
        """Add the variables of a source file that are in the program."""
        for entry in entries:
            declared = _referenced(entry, "DW_AT_specification") or _referenced(entry, "DW_AT_abstract_origin") or entry
            name, linked = _name(declared), _name(declared, "DW_AT_linkage_name")
            # What the linker left out has no symbol.
            known = self._symbols.get(name, set()) | self._symbols.get(linked, set())
            address = self._address(entry, known)
            if address in known:
                self._taken.add(address)
                found.setdefault(name, []).append(_Variable(address, _referenced(declared, "DW_AT_type"), source))

    def _address(self, entry: Any, known: set[int]) -> int | None:
        location = entry.attributes["DW_AT_location"].value
        order: Literal["little", "big"] = "little" if self.is_little else "big"
        if isinstance(location, list) and location and location[0] == _ADDRESS_OF:
            return int.from_bytes(bytes(location[1:]), order)
        if isinstance(location, list) and location and location[0] == _ADDRESS_AT:
            return next(iter(known)) if len(known) == 1 else None
        return None


@contextmanager
def _whole(name: str) -> Iterator[None]:
    """Convert the exceptions of pyelftools for truncated or damaged files to BuildError."""
    try:
        yield
    except CodegenError:
        raise
    except Exception as error:
        raise BuildError(
            f"damaged, or no ELF as a linker writes it ({type(error).__name__})", where=name, remedy="link the program again"
        ) from error


def _parsed(name: str, content: bytes) -> Any:
    try:
        elffile = importlib.import_module("elftools.elf.elffile")
        exceptions = importlib.import_module("elftools.common.exceptions")
    except ImportError:
        raise missing("pyelftools", "reads ELF", "codegen a2l") from None
    try:
        return elffile.ELFFile(BytesIO(content))
    except exceptions.ELFError:
        raise BuildError("not an ELF", where=name, remedy="give the linked program, such as firmware.elf") from None


def _make_types_known(dwarf: Any, units: Sequence[Any]) -> None:
    """Make references to type units work: DWARF 5 has them among the other units, where pyelftools does not search."""
    types = {unit["type_signature"]: unit for unit in units if unit.header.get("unit_type") == "DW_UT_type"}
    if types:
        dwarf.get_DIE_by_sig8 = lambda key: types[key].get_DIE_from_refaddr(types[key].cu_offset + types[key]["type_offset"])


def children(entry: Any) -> Iterator[Any]:
    """Yield the direct children of an entry.

    Raises:
        ValueError: the file is damaged: a reference to a sibling (DW_AT_sibling) leads back, so the entries never end.
    """
    last = entry.offset
    for child in entry.iter_children():
        if child.offset <= last:
            raise ValueError(f"the entry at {last} is followed by the one at {child.offset}")
        last = child.offset
        yield child


def _variables_below(entry: Any, functions: list[Any]) -> Iterator[Any]:
    """Yield the variables with an address, including those in namespaces. Functions and blocks are added to `functions`."""
    for child in children(entry):
        if child.tag == "DW_TAG_variable" and "DW_AT_location" in child.attributes:
            yield child
        elif child.tag == "DW_TAG_namespace":
            yield from _variables_below(child, functions)
        elif child.tag in _FUNCTIONS:
            functions.append(child)


def _language(unit: Any) -> int:
    found = unit.attributes.get("DW_AT_language")
    return 0 if found is None else int(found.value)


def _member(struct: Any, name: str | None) -> Any:
    """Return a member of a struct; None if the type is none or has no such member."""
    members = children(struct) if name and struct.tag in _STRUCTS else ()
    return next((each for each in members if each.tag == "DW_TAG_member" and _name(each) == name), None)


def _offset(member: Any) -> int:
    """Return the offset of a member in its struct: a number, or before DWARF 3 an expression (DW_OP_plus_uconst)."""
    if "DW_AT_data_member_location" not in member.attributes:
        return 0
    location = member.attributes["DW_AT_data_member_location"].value
    if not isinstance(location, list):
        return int(location)
    return sum((byte & 0x7F) << (7 * k) for k, byte in enumerate(location[1:]))


def _name(entry: Any, attribute: str = "DW_AT_name") -> str:
    found = entry.attributes.get(attribute)
    return "" if found is None else found.value.decode("utf-8", "replace")


def _referenced(entry: Any, attribute: str) -> Any:
    return entry.get_DIE_from_attribute(attribute) if attribute in entry.attributes else None


ALIASES_MAX = 100
LENGTH_MAX = 100_000
"""Largest array of tasks; a larger one indicates a damaged file."""
INSTANCES_MAX = 100_000
"""Largest number of objects of one type."""


def aliases(ctype: Any) -> Iterator[Any]:
    """Yield a type and the types that it is an alias of, down to the underlying type.

    Raises:
        ValueError: the file is damaged: the types form a circle.
    """
    for _ in range(ALIASES_MAX):
        yield ctype
        if ctype is None or ctype.tag not in _TRANSPARENT:
            return
        ctype = _referenced(ctype, "DW_AT_type")
    raise ValueError("types are names of each other")


def _dimensions(ctype: Any) -> tuple[list[int], Any]:
    """Return the lengths of an array, outermost first, and the type of its elements; no length for another type.

    Raises:
        ValueError: the file is damaged: arrays are elements of each other.
    """
    lengths: list[int] = []
    for _ in range(ALIASES_MAX):
        *_, ctype = aliases(ctype)
        if ctype.tag != "DW_TAG_array_type":
            return lengths, ctype
        lengths += _lengths(ctype)
        ctype = _referenced(ctype, "DW_AT_type")
    raise ValueError("arrays are elements of each other")


def _lengths(array: Any) -> list[int]:
    found = []
    for child in children(array):
        if child.tag == "DW_TAG_subrange_type":
            if "DW_AT_count" in child.attributes:
                found.append(int(child.attributes["DW_AT_count"].value))
            else:  # an array without a length has no bound
                bound = child.attributes.get("DW_AT_upper_bound")
                found.append(bound.value + 1 if bound is not None and isinstance(bound.value, int) else 0)
    return found


class _Search:
    """Search for objects of a named type in other types.

    A type is entered only if it contains such an object, which is decided once for each type: nested structs can have more
    paths than a program has bytes.
    """

    def __init__(self, type_name: str) -> None:
        self._type_name = type_name
        self._holds: dict[tuple[int, int, int], bool] = {}

    def paths(self, ctype: Any, path: str, depth: int) -> Iterator[str]:
        """Yield the paths of all objects of the type in an object of type `ctype` at `path`, down to a depth."""
        named, ctype = self._underlying(ctype)
        if named:
            yield path
        elif self._contains(ctype, depth):
            if ctype.tag in _STRUCTS:
                for name, member in self._members(ctype):
                    yield from self.paths(member, f"{path}.{name}", depth - 1)
            else:
                for index in range(_lengths(ctype)[0]):
                    yield from self.paths(_referenced(ctype, "DW_AT_type"), f"{path}[{index}]", depth - 1)

    def _underlying(self, ctype: Any) -> tuple[bool, Any]:
        """Return whether a type has the name, and the type that it is an alias of."""
        for each in aliases(ctype):
            if each is not None and each.tag == "DW_TAG_typedef" and _name(each) == self._type_name:
                return True, each
            ctype = each
        return False, ctype

    def _contains(self, ctype: Any, depth: int) -> bool:
        if ctype is None or depth == 0:
            return False
        key = id(ctype.cu), ctype.offset, depth  # offsets are those of a section, and types may be in a section of their own
        if key not in self._holds:
            self._holds[key] = self._looked_into(ctype, depth)
        return self._holds[key]

    def _looked_into(self, ctype: Any, depth: int) -> bool:
        if ctype.tag in _STRUCTS:
            return any(self._is_or_contains(member, depth - 1) for _, member in self._members(ctype))
        if ctype.tag != "DW_TAG_array_type" or len(lengths := _lengths(ctype)) != 1:
            return False
        holds = self._is_or_contains(_referenced(ctype, "DW_AT_type"), depth - 1)
        if holds and lengths[0] > LENGTH_MAX:
            raise ValueError(f"an array of {lengths[0]} tasks")
        return holds

    def _is_or_contains(self, ctype: Any, depth: int) -> bool:
        named, ctype = self._underlying(ctype)
        return named or self._contains(ctype, depth)

    @staticmethod
    def _members(struct: Any) -> Iterator[tuple[str, Any]]:
        for member in children(struct):
            if member.tag == "DW_TAG_member":
                yield _name(member), _referenced(member, "DW_AT_type")

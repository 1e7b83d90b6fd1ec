"""Syntax tree of a unit of C, from which mutants are made. Read by the compiler's preprocessor and pycparser.

The tree is printed again for each mutant. Tests compile the printed and the original C to identical machine code.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pycparser import c_ast, c_generator, c_parser

from codegen.errors import BuildError
from codegen.sil.toolchain import compiler_command

# Types are placeholders and macros stay names, so that the printed C keeps its meaning.
TYPES = [f"{sign}int{bits}_t" for sign in ("", "u") for bits in (8, 16, 32, 64)]
STUB_HEADERS = {
    "stdint.h": "".join(f"typedef int {name};\n" for name in TYPES),
    "stdbool.h": "typedef int bool;\n",
    "stddef.h": "typedef int size_t;\n",
    "string.h": "typedef int size_t;\nvoid *memcpy(void *to, const void *from, size_t size);\n",
    "math.h": "",
}
INCLUDE = re.compile(r"^\s*#\s*include\b.*$", re.MULTILINE)


@dataclass(frozen=True)
class Unit:
    """A source file as a tree: its path in the build, its include lines, and its own top-level definitions in order, without
    those of its headers."""

    path: str
    includes: str
    nodes: tuple[Any, ...]

    @classmethod
    def read(cls, path: str, files: Mapping[str, bytes]) -> Unit:
        """Parse a file of a build. Raises BuildError if it cannot be preprocessed or parsed."""
        with tempfile.TemporaryDirectory(prefix="ars-tree-") as name:
            root = Path(name)
            for own, content in files.items():
                if own == path or own.startswith("include/"):
                    (root / own).parent.mkdir(parents=True, exist_ok=True)
                    (root / own).write_bytes(content)
            (root / "stubs").mkdir()
            for own, text in STUB_HEADERS.items():
                (root / "stubs" / own).write_text(text, encoding="ascii")
            command = [*compiler_command(), "-std=c99", "-E", "-nostdinc", "-Istubs", "-Iinclude", path]
            done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise BuildError(done.stderr.strip().partition("\n")[0], where=path)
        try:
            tree = c_parser.CParser().parse(done.stdout, path)
        except c_parser.ParseError as error:
            raise BuildError(f"not plain C99: {error}", where=path) from error
        text = files[path].decode("ascii")
        own_nodes = tuple(node for node in tree.ext if node.coord is not None and node.coord.file == path)
        return cls(path, "".join(f"{line.strip()}\n" for line in INCLUDE.findall(text)), own_nodes)

    def text(self) -> str:
        """Return the C of the whole unit."""
        return self.includes + "".join(printed(node) for node in self.nodes)


def printed(node: Any) -> str:
    """Return the C of a top-level node."""
    text: str = c_generator.CGenerator().visit(node)
    return text if isinstance(node, c_ast.FuncDef) else f"{text};\n"


def name_of(node: Any) -> str:
    """Return the name that a top-level node defines; empty if it defines none."""
    declared = node.decl if isinstance(node, c_ast.FuncDef) else node
    return str(getattr(declared, "name", None) or "")

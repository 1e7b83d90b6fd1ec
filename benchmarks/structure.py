"""`python -m benchmarks.structure [REVISION]`: compare size and structure of this tree with an earlier revision."""

from __future__ import annotations

import argparse
import ast
import io
import re
import subprocess
import tarfile
import tempfile
import tokenize
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("ars_codegen", "codegen", "hil_sim", "tests", "benchmarks")
LAYOUT = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
"""Tokens that hold no code."""


def figures_of(root: Path) -> dict[str, int]:
    """Return the figures of a source tree by name.

    Of the product (codegen and hil_sim): lines of code without blanks, comments and docstrings; modules; modules that exactly
    one other module imports; view classes, whose names end with View, with fields and properties. Of the tests without
    tests/oracle: lines; modules of the product that they name, in an import or in a string (a patched name). Then templates,
    those without an expression, and lines and modules of Python for each package and sub-package.
    """
    sources = {path.relative_to(root): path.read_text() for package in PACKAGES for path in (root / package).rglob("*.py")}
    trees = {path: ast.parse(text, str(path)) for path, text in sources.items()}
    product = [path for path in sources if path.parts[0] in ("codegen", "hil_sim")]
    tests = [path for path in sources if path.parts[0] == "tests" and path.parts[1] != "oracle"]
    importers = Counter(name for path in [*product, *_in("ars_codegen", sources)] for name in set(_imports(trees[path])))
    modules = {_module(path) for path in product}
    views = [each for path in product for each in ast.walk(trees[path]) if isinstance(each, ast.ClassDef)]
    members = [each for view in views if view.name.endswith("View") for each in view.body]
    named = {name for path in tests for name in (*_imports(trees[path]), *_named(trees[path]))}
    templates = [path.read_text() for path in (root / "templates").rglob("*.j2")]
    found = {
        "product: lines of code": sum(_lines_of_code(sources[path], trees[path]) for path in product),
        "product: modules": len(product),
        "product: modules with one importer": sum(importers[name] == 1 for name in modules),
        "product: view classes": sum(view.name.endswith("View") for view in views),
        "product: fields of view classes": sum(isinstance(each, ast.AnnAssign) for each in members),
        "product: properties of view classes": sum(
            isinstance(each, ast.FunctionDef) and _is_property(each) for each in members
        ),
        "tests without oracle: lines": sum(sources[path].count("\n") for path in tests),
        "tests without oracle: modules of the product that they name": len(named & modules),
        "templates": len(templates),
        "templates without an expression": sum(not re.search(r"\{\{|\{%", text) for text in templates),
    }
    for name in sorted({"/".join(path.parts[:depth]) for path in sources for depth in (1, 2) if len(path.parts) > depth}):
        inside = _in(name, sources)
        found[f"{name}: lines"] = sum(sources[path].count("\n") for path in inside)
        found[f"{name}: modules"] = len(inside)
    return found


def _in(folder: str, sources: Mapping[Path, str]) -> list[Path]:
    return [path for path in sources if path.as_posix().startswith(f"{folder}/")]


def _lines_of_code(text: str, tree: ast.Module) -> int:
    """Return the lines that hold a token of code. A string that is a statement by itself is a docstring."""
    docstrings: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            docstrings.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in LAYOUT:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines - docstrings)


def _is_property(function: ast.FunctionDef) -> bool:
    return any("property" in ast.unparse(each) for each in function.decorator_list)


def _named(tree: ast.Module) -> Iterator[str]:
    """Yield each dotted name in a string, and what leads to its last part."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and re.fullmatch(r"[a-z_]\w*(\.\w+)+", node.value):
            yield from (node.value, node.value.rpartition(".")[0])


def _module(path: Path) -> str:
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def _imports(tree: ast.Module) -> Iterator[str]:
    """Yield the modules that an import may name: for `from a import b`, both a and a.b."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def table(now: Mapping[str, int], before: Mapping[str, int]) -> Iterator[str]:
    """Yield a line for each figure: its name, before, now."""
    yield f"{'':60}{'before':>10}{'now':>10}" if before else f"{'':60}{'now':>10}"
    for name in (*now, *sorted(before.keys() - now)):
        earlier = f"{before.get(name, 0):>10,}" if before else ""
        yield f"{name:60}{earlier}{now.get(name, 0):>10,}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.structure", description=__doc__.split(": ", 1)[1])
    parser.add_argument("revision", nargs="?", metavar="REVISION", help="a revision of git")
    revision = parser.parse_args().revision
    before: dict[str, int] = {}
    if revision:
        archive = subprocess.run(
            ["git", "archive", revision, *PACKAGES, "templates"], cwd=ROOT, capture_output=True, check=True
        )
        with tempfile.TemporaryDirectory() as folder, tarfile.open(fileobj=io.BytesIO(archive.stdout)) as content:
            content.extractall(folder, filter="data")
            before = figures_of(Path(folder))
    print("\n".join(table(figures_of(ROOT), before)))


if __name__ == "__main__":
    main()

"""`python -m benchmarks.structure [REVISION]`: compare size and structure of this tree with an earlier revision."""

from __future__ import annotations

import argparse
import ast
import io
import re
import subprocess
import tarfile
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("ars_codegen", "codegen", "hil_sim", "tests", "benchmarks")


def figures_of(root: Path) -> dict[str, int]:
    """Return the figures of a source tree by name.

    Lines and modules of Python for each package and sub-package, view classes, templates, templates without an expression, and
    modules of codegen and hil_sim that exactly one other module imports.
    """
    found: dict[str, int] = {}
    sources = {path.relative_to(root): path.read_text() for package in PACKAGES for path in (root / package).rglob("*.py")}
    for name in sorted({"/".join(path.parts[:depth]) for path in sources for depth in (1, 2) if len(path.parts) > depth}):
        inside = [text for path, text in sources.items() if path.as_posix().startswith(f"{name}/")]
        found[f"{name}: lines"] = sum(text.count("\n") for text in inside)
        found[f"{name}: modules"] = len(inside)
    classes = [node.name for text in sources.values() for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ClassDef)]
    found["view classes"] = sum(name.endswith("View") for name in classes)
    templates = [path.read_text() for path in (root / "templates").rglob("*.j2")]
    found["templates"] = len(templates)
    found["templates without an expression"] = sum(not re.search(r"\{\{|\{%", text) for text in templates)
    product = {path: text for path, text in sources.items() if path.parts[0] in ("ars_codegen", "codegen", "hil_sim")}
    importers = Counter(module for path, text in product.items() for module in set(_imports(path, text)))
    names = {_module(path) for path in product}
    found["modules with one importer"] = sum(importers[name] == 1 for name in names)
    return found


def _module(path: Path) -> str:
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def _imports(path: Path, text: str) -> Iterator[str]:
    """Return the modules that an import may name: for `from a import b`, both a and a.b."""
    for node in ast.walk(ast.parse(text, str(path))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def table(now: Mapping[str, int], before: Mapping[str, int]) -> Iterator[str]:
    """Yield a line for each figure: its name, before, now."""
    yield f"{'':44}{'before':>10}{'now':>10}" if before else f"{'':44}{'now':>10}"
    for name in sorted({*now, *before}):
        earlier = f"{before.get(name, 0):>10,}" if before else ""
        yield f"{name:44}{earlier}{now.get(name, 0):>10,}"


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

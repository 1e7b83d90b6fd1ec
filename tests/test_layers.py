"""The order of the layers, read from the imports in the source."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("codegen", "hil_sim")

LEVELS = (
    ("codegen",),  # the package itself: its version
    ("codegen.errors", "codegen.interrupts"),
    ("codegen.files", "codegen.sections"),
    ("codegen.can_sections", "codegen.controller_sections", "codegen.sensor_sections"),
    ("codegen.budget_sections",),
    ("codegen.config",),
    ("codegen.vehicle",),
    ("codegen.design",),
    ("codegen.refmap",),
    ("codegen.emit", "codegen.importing"),
    ("codegen.sil",),
    ("hil_sim",),
    ("codegen.sweep",),
    ("codegen.verify", "codegen.export", "codegen.report", "codegen.doctor"),
    ("codegen.explore",),
    ("codegen.console",),
    ("codegen.cli",),
    ("codegen.__main__",),
)
LEVEL = {layer: level for level, layers in enumerate(LEVELS) for layer in layers}


class Import(NamedTuple):
    line: int
    module: str


def source_files(root: Path) -> dict[str, Path]:
    """Return the file of each module of both packages."""
    found = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports_of(module: str, path: Path) -> Iterator[Import]:
    """Yield every import of a file, those inside functions and `import_module("literal")` too.

    `from package import name` gives `package.name`, be it a module or not: the layer is the same or the right one.
    """
    package = module.split(".") if path.name == "__init__.py" else module.split(".")[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(node.lineno, alias.name)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base += [node.module] if node.module else []
            for alias in node.names:
                yield Import(node.lineno, ".".join([*base, alias.name]))
        elif isinstance(node, ast.Call) and node.args:
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            target = node.args[0]
            if name in ("import_module", "__import__") and isinstance(target, ast.Constant):
                yield Import(node.lineno, str(target.value))


def layer_of(module: str, files: dict[str, Path]) -> str:
    """Return the layer of a module, or of a name in one. A module without a level is its own layer."""
    parts = module.split(".")
    if parts[0] == "hil_sim":
        return "hil_sim"
    second = ".".join(parts[:2])
    is_module = second in LEVEL or any(name == second or name.startswith(f"{second}.") for name in files)
    return second if is_module else "codegen"


def violations(root: Path) -> list[str]:
    """Return a line for each import that neither goes to a lower layer nor stays inside its own."""
    files = source_files(root)
    found = []
    for module, path in files.items():
        layer = layer_of(module, files)
        if layer not in LEVEL:
            found.append(f"{module} has no layer; name it in LEVELS")
            continue
        for line, target in imports_of(module, path):
            if target.split(".")[0] in ("tests", "benchmarks"):
                found.append(f"{module}:{line} imports {target}, which is not installed")
            if target.split(".")[0] not in PACKAGES:
                continue
            other = layer_of(target, files)
            if other != layer and LEVEL.get(other, len(LEVELS)) >= LEVEL[layer]:
                found.append(f"{module}:{line} imports {target}, which is not below {layer}")
    return found


def reachable(module: str, root: Path) -> set[str]:
    """Return the modules of the project that importing `module` may bring in, itself included."""
    files = source_files(root)
    seen: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in files or name in seen:
            continue
        seen.add(name)
        for _, target in imports_of(name, files[name]):
            # Importing a.b.c runs a and a.b as well.
            parts = target.split(".")
            waiting += [".".join(parts[:end]) for end in range(1, len(parts) + 1)]
    return seen


def plant(root: Path, module: str, text: str) -> None:
    path = root.joinpath(*module.split(".")).with_suffix(".py")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def test_every_module_imports_only_from_lower_layers() -> None:
    assert len(source_files(ROOT)) > 10
    assert violations(ROOT) == []


def test_the_reference_lookup_is_independent_of_the_generated_c() -> None:
    reached = reachable("codegen.refmap.lookup", ROOT)
    assert "codegen.refmap.lookup" in reached
    assert {name for name in reached if name.startswith(("codegen.emit", "codegen.sil"))} == set()


@pytest.mark.parametrize(
    ("module", "text", "words"),
    [
        ("codegen.config", "from codegen import refmap", "codegen.config:1 imports codegen.refmap, "),
        ("codegen.vehicle.tyre", "from ..emit import render", "codegen.vehicle.tyre:1 imports codegen.emit.render, "),
        ("codegen.refmap.lookup", "class A:\n    def f(self):\n        import codegen.sil.compile", "codegen.refmap.lookup:3 "),
        ("codegen.emit.render", "import importlib\nimportlib.import_module('codegen.sil')", "codegen.emit.render:2 "),
        ("codegen.emit.render", "import tests.helpers", "codegen.emit.render:1 imports tests.helpers, which is not installed"),
        ("codegen.extra", "", "codegen.extra has no layer; name it in LEVELS"),
        ("codegen.emit.render", "from codegen import __version__\nfrom codegen import config as c", ""),
        ("codegen.emit.__init__", "from .text import literal\nfrom . import text\nimport numpy", ""),
        ("codegen.cli", "def f():\n    import codegen.verify, hil_sim.plant", ""),
    ],
)
def test_imports_are_judged(tmp_path: Path, module: str, text: str, words: str) -> None:
    plant(tmp_path, module, text)
    found = violations(tmp_path)
    assert len(found) == bool(words)
    assert words in "".join(found)

"""The order of the layers, read from the imports in the source: nothing is run."""

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
    """Dotted module name -> file, of both packages."""
    found = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports_of(module: str, path: Path) -> Iterator[Import]:
    """Every import of a file, those inside functions and `import_module("literal")` too.

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
    """The layer that a module (or a name taken from one) belongs to; a module without a level is its own."""
    parts = module.split(".")
    if parts[0] == "hil_sim":
        return "hil_sim"
    second = ".".join(parts[:2])
    is_module = second in LEVEL or any(name == second or name.startswith(f"{second}.") for name in files)
    return second if is_module else "codegen"


def violations(root: Path) -> list[str]:
    """One line for each import that does not go to a lower layer or stay inside its own."""
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
    """Modules of the project that importing `module` may bring in, itself included, however far."""
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


def test_the_reference_lookup_is_independent_of_what_it_judges() -> None:
    reached = reachable("codegen.refmap.lookup", ROOT)
    assert "codegen.refmap.lookup" in reached
    assert {name for name in reached if name.startswith(("codegen.emit", "codegen.sil"))} == set()


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("codegen.config", "import codegen.refmap.map"),
        ("codegen.config", "from codegen import refmap"),
        ("codegen.config", "from codegen.vehicle import tyre"),
        ("codegen.vehicle.tyre", "from ..emit import render"),
        ("codegen.vehicle.tyre", "from .. import sil"),
        ("codegen.refmap.lookup", "def f():\n    from codegen.emit import render"),
        ("codegen.refmap.lookup", "class A:\n    def f(self):\n        import codegen.sil.compile"),
        ("codegen.emit.render", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import hil_sim.bus"),
        ("codegen.emit.render", "import importlib\nimportlib.import_module('codegen.sil')"),
        ("codegen.verify.strict", "import codegen.report.plots"),
        ("codegen.report.plots", "from codegen.cli import main"),
        ("hil_sim.plant", "from codegen.export import fmu"),
        ("codegen.errors", "import codegen.cli"),
        ("codegen.emit.render", "import tests.helpers"),
    ],
)
def test_an_import_from_a_higher_layer_is_seen(tmp_path: Path, module: str, text: str) -> None:
    plant(tmp_path, module, text)
    (message,) = violations(tmp_path)
    assert message.startswith(f"{module}:")


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("codegen.emit.render", "from codegen import __version__\nfrom codegen import config as c"),
        ("codegen.emit.render", "from .text import literal\nfrom . import text\nimport numpy"),
        ("codegen.emit.__init__", "from .text import literal"),
        ("hil_sim.plant", "from codegen.sil import compile\nfrom hil_sim import bus"),
        ("codegen.cli", "def f():\n    import codegen.verify, hil_sim.plant"),
    ],
)
def test_an_import_from_a_lower_layer_is_allowed(tmp_path: Path, module: str, text: str) -> None:
    plant(tmp_path, module, text)
    assert violations(tmp_path) == []


def test_a_module_without_a_layer_is_seen(tmp_path: Path) -> None:
    plant(tmp_path, "codegen.extra", "")
    plant(tmp_path, "codegen.cli", "from codegen import extra")
    assert violations(tmp_path) == [
        "codegen.cli:1 imports codegen.extra, which is not below codegen.cli",
        "codegen.extra has no layer; name it in LEVELS",
    ]


def test_an_indirect_import_is_reached(tmp_path: Path) -> None:
    plant(tmp_path, "codegen.refmap.lookup", "from codegen.refmap import axis")
    plant(tmp_path, "codegen.refmap.axis", "def f():\n    from codegen.emit.text import literal")
    plant(tmp_path, "codegen.emit.text", "")
    assert "codegen.emit.text" in reachable("codegen.refmap.lookup", tmp_path)

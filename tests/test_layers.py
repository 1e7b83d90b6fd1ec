"""The order of the layers, read from the imports in the source."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import codegen

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("ars_codegen", "codegen", "hil_sim")

LEVELS = (
    ("codegen",),  # the package itself: its version. Its public names belong to codegen.library.
    ("codegen.errors", "codegen.interrupts"),
    ("codegen.limits",),
    (
        "codegen.requirements",
        "codegen.files",
        "codegen.programs",
        "codegen.arrays",
        "codegen.text",
        "codegen.units",
    ),
    ("codegen.cache",),
    ("codegen.configuration",),
    ("codegen.vehicle", "codegen.metrics"),
    ("codegen.map_file",),
    ("codegen.optimum",),
    ("codegen.ecu_map", "codegen.design"),
    ("codegen.emit", "codegen.importing"),
    ("codegen.logs",),
    ("codegen.sil",),
    # These two drive the generated C; builds use the rest of the package.
    ("codegen.design.lead",),
    ("codegen.design.tune",),
    ("hil_sim",),
    ("codegen.judgement",),
    ("codegen.identify", "codegen.sweep"),
    ("codegen.figures",),
    ("codegen.verify", "codegen.export", "codegen.report"),
    ("codegen.explore", "codegen.doctor"),
    ("codegen.console",),
    ("codegen.library",),
    ("codegen.cli",),
    ("codegen.__main__",),
    ("ars_codegen",),
)
PUBLIC = {f"codegen.{name}" for name in codegen.__all__} - {layer for layers in LEVELS for layer in layers}
"""Functions of the library, but for those with the name of a subpackage."""
LEVEL = {layer: level for level, layers in enumerate(LEVELS) for layer in layers}


def source_files(root: Path) -> dict[str, Path]:
    """Return the file of each module of the packages."""
    found = {}
    for path in sorted(path for package in PACKAGES for path in (root / package).rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def statements(*nodes: Any) -> Iterator[ast.AST]:
    """Yield all statements without their expressions, which are ten times as many."""
    for node in nodes:
        yield node
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            yield from statements(*getattr(node, part, ()))


def imports_of(module: str, path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and target of every import in a file, including those in functions and `import_module("literal")`.

    `from package import name` yields `package.name` whether it is a module or not: the layer is the same or the right one.
    """
    package = module.split(".") if path.name == "__init__.py" else module.split(".")[:-1]
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text, str(path))
    for node in ast.walk(tree) if re.search("import_module|__import__", text) else statements(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base += [node.module] if node.module else []
            yield from ((node.lineno, ".".join([*base, alias.name])) for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in ("import_module", "__import__"):
            yield from ((node.lineno, str(target.value)) for target in node.args[:1] if isinstance(target, ast.Constant))


def start_of(module: str) -> str:
    """Return the layer of a module by its name: its own, where LEVELS names the module, else that of its package."""
    own, package = (".".join(module.split(".")[:depth]) for depth in (3, 2))
    return "hil_sim" if module.startswith("hil_sim") else own if own in LEVEL else package


def violations(root: Path) -> list[str]:
    """Return a line for each import that neither targets a lower layer nor stays in its own."""
    files = source_files(root)
    del files["codegen"]  # imports the library when a name is used
    layers = set(map(start_of, (*LEVEL, *files)))

    def layer_of(module: str) -> str:
        """Return the layer of a module, or of a name in one. A module without a level is its own layer."""
        if module in PUBLIC:
            return "codegen.library"
        return start_of(module) if start_of(module) in layers else "codegen"

    found = []
    for module, path in files.items():
        layer = layer_of(module)
        if layer not in LEVEL:
            found.append(f"{module} has no layer; name it in LEVELS")
            continue
        for line, target in imports_of(module, path):
            if target.split(".")[0] in ("tests", "benchmarks"):
                found.append(f"{module}:{line} imports {target}, which is not installed")
            other = layer_of(target) if target.split(".")[0] in PACKAGES else layer
            if other != layer and LEVEL.get(other, len(LEVELS)) >= LEVEL[layer]:
                found.append(f"{module}:{line} imports {target}, which is not below {layer}")
    return found


def test_every_module_imports_only_from_lower_layers() -> None:
    assert len(source_files(ROOT)) > 10
    assert violations(ROOT) == []
    # The reference lookup does not depend on the C that it tests.
    assert LEVEL["codegen.optimum"] < min(LEVEL["codegen.emit"], LEVEL["codegen.sil"])

"""Generated files of every kind of controller, not compiled; rendered once for all workers."""

import functools
from pathlib import Path

from codegen.configuration import Kind
from codegen.emit.folder import Folder
from codegen.emit.text import Precision
from codegen.emit.write import write_folder
from tests import builds

KINDS: tuple[Kind, ...] = tuple(builds.CONFIGS)
EACH_KIND_AND_DOUBLE: tuple[tuple[Kind, Precision], ...] = (*((kind, "single") for kind in KINDS), ("tracking", "double"))


@functools.cache
def rendered(kind: Kind, precision: Precision = "single") -> Folder:
    """Return the build of a kind with the paper's map."""
    return builds.render(builds.paper_map(), builds.CONFIGS[kind], precision)


def laid_out(folder: Folder, at: Path) -> Path:
    """Write a folder and return its path."""
    write_folder(folder, at)
    return at

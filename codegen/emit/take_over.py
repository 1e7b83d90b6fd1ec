"""Files that integrate a build into a C project: CMake, GNU make, Zephyr."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

from codegen.emit.render import render


@dataclass(frozen=True)
class TakeOver:
    """Names that the templates of the integration files use in addition to the build.

    Attributes:
        sources: files of the controller and its task, relative to the build.
        dynamics_source: the file that needs the mathematical library; no other file needs it.
        zephyr_name: name of the Zephyr module and its library.
        ZEPHYR_NAME: its Kconfig symbol, long enough not to collide with a symbol of Zephyr for any prefix.
    """

    sources: tuple[str, ...]
    dynamics_source: str
    zephyr_name: str
    ZEPHYR_NAME: str

    @classmethod
    def of(cls, prefix: str, sources: Iterable[str]) -> Self:
        """Return the names for all sources of a build with this prefix."""
        dynamics, name = f"src/{prefix}_dynamics.c", f"{prefix}_rear_steering"
        return cls(tuple(source for source in sources if source != dynamics), dynamics, name, name.upper())


def take_over_files(context: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the integration files, content by path.

    Args:
        context: template context of a build; "build" and "dynamics" are used.
    """
    build = context["build"]
    known = {**context, "take_over": TakeOver.of(build.prefix, build.sources)}
    return {
        "CMakeLists.txt": render("CMakeLists.txt.j2", known),
        f"{build.prefix}.mk": render("makefile.mk.j2", known),
        "zephyr/CMakeLists.txt": render("zephyr/CMakeLists.txt.j2", known),
        "zephyr/Kconfig": render("zephyr/Kconfig.j2", known),
        "zephyr/module.yml": render("zephyr/module.yml.j2", known),
    }

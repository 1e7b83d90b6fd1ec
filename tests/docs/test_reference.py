"""The reference pages are made from the code: nothing of the code is missing, and nothing is left over."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import BaseModel

from codegen.cli import cli
from codegen.config import preset_text
from tests.docs.blocks import ROOT


@pytest.fixture
def extensions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs/_ext"))


@pytest.mark.usefixtures("extensions")
def test_every_key_of_ars_toml_is_told() -> None:
    import config_tables

    text = config_tables.markdown()
    every = {key for _, model in every_section() for key in model.model_fields}
    told = set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE))
    nested = {key for key, model in every_section_by_key() if model is not None}
    assert every - nested <= told
    assert "| – | – |" not in text


def every_section() -> Iterator[tuple[str, type[BaseModel]]]:
    import config_tables

    yield from config_tables.sections()


def every_section_by_key() -> Iterator[tuple[str, type[BaseModel] | None]]:
    import config_tables

    for _, model in config_tables.sections():
        for key, field in model.model_fields.items():
            yield key, config_tables._section_of(field.annotation)
    yield "cases", BaseModel


@pytest.mark.usefixtures("extensions")
def test_every_word_about_a_key_is_used() -> None:
    import config_tables

    said = config_tables.comments()
    used: set[str] = set()
    for name, model in config_tables.sections():
        for key in model.model_fields:
            path = f"{name}.{key}" if name else key
            used |= {path, config_tables._shared(path)}
    used |= {f"signal.{key}" for _, model in config_tables.inline_tables() for key in model.model_fields}
    assert sorted(set(config_tables.MEANINGS) - used) == []
    assert said["vehicle.cg_height_m"] == "centre of gravity above the road"
    assert said["can.e2e.sync_counter_init"].startswith("by so many")


@pytest.mark.usefixtures("extensions")
def test_a_key_without_a_word_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    import config_tables

    monkeypatch.delitem(config_tables.MEANINGS, "vehicle.mass_kg")
    with pytest.raises(LookupError, match=r"vehicle\.mass_kg"):
        config_tables.markdown()


def test_the_interface_names_every_command() -> None:
    text = (ROOT / "docs/interface.md").read_text(encoding="utf-8")
    synopsis = text.split("```text", 1)[1].split("```", 1)[0]
    assert set(re.findall(r"^codegen (\w+)", synopsis, re.MULTILINE)) == set(cli.commands)


@pytest.mark.usefixtures("extensions")
def test_the_tables_are_those_of_the_code() -> None:
    import interface_tables

    matrix = interface_tables.can_matrix()
    assert "| `Speed` | 16 | 16 | Intel | signed | 0.005 | -163.835 to 163.835 m/s | -32768 |" in matrix
    assert "0 TRACKING, 1 LIMITED, 2 STANDBY, 3 DEGRADED, 4 FAIL_SAFE" in matrix
    assert "`ars_controller_step`" in interface_tables.c_functions("ars_controller.h")
    assert interface_tables.run_columns().count("\n| `") == 12
    assert "| 129, 130, 143 |" in interface_tables.exit_codes()
    for header in sorted(Path(interface_tables.BUILD / "include").glob("*.h")):
        if header.name != "ars_sections.h":
            assert interface_tables.c_functions(header.name)


def test_the_presets_are_read_as_they_stand() -> None:
    # The comments of the presets are part of the guide: one behind each key where its name does not say all.
    assert preset_text("paper").count("#") > 40

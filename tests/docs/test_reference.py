"""The reference pages are made from the code: nothing of the code is missing, and nothing is left over."""

import re

import pytest

from codegen.cli import cli
from tests.docs.blocks import ROOT


@pytest.fixture(autouse=True)
def extensions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs/_ext"))


def test_every_key_of_ars_toml_has_its_meaning_and_no_other() -> None:
    import config_tables

    text = config_tables.markdown()
    fields = [(name, key, field) for name, model in config_tables.sections() for key, field in model.model_fields.items()]
    plain = {key for _, key, field in fields if config_tables._section_of(field.annotation) is None} - {"cases"}
    assert plain <= set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE))
    assert "| – | – |" not in text
    paths = {f"{name}.{key}" if name else key for name, key, _ in fields}
    used = paths | set(map(config_tables._shared, paths))
    used |= {f"signal.{key}" for _, model in config_tables.inline_tables() for key in model.model_fields}
    assert sorted(set(config_tables.MEANINGS) - used) == []
    assert config_tables.comments()["vehicle.cg_height_m"] == "centre of gravity above the road"


def test_the_interface_names_every_command() -> None:
    text = (ROOT / "docs/interface.md").read_text(encoding="utf-8")
    synopsis = text.split("```text", 1)[1].split("```", 1)[0]
    assert set(re.findall(r"^codegen (\w+)", synopsis, re.MULTILINE)) == set(cli.commands)


def test_the_tables_are_those_of_the_code() -> None:
    import interface_tables

    matrix = interface_tables.can_matrix()
    assert "| `Speed` | 16 | 16 | Intel | signed | 0.005 | -163.835 to 163.835 m/s | -32768 |" in matrix
    assert "0 TRACKING, 1 LIMITED, 2 STANDBY, 3 DEGRADED, 4 FAIL_SAFE" in matrix
    assert "`ars_controller_step`" in interface_tables.c_functions("ars_controller.h")
    assert interface_tables.run_columns().count("\n| `") == 12
    assert "| 129, 130, 143 |" in interface_tables.exit_codes()

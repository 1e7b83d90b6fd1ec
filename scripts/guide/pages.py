"""Regions of the pages of docs/ that come from the code. Each stands in its page between two comments:

<!-- from the code: NAME [ARGUMENT] -->

the text that `REGIONS` makes, plain Markdown, which reads well on a code host too

<!-- end -->
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

from scripts.guide import commands, config_tables, evidence_tables, interface_tables, map_choice, python_names, suite_tables

DOCS = Path(__file__).resolve().parents[2] / "docs"
REGIONS: Mapping[str, Callable[..., str]] = {
    "ars-toml": config_tables.markdown,
    "cars-results": suite_tables.cars,
    "c-functions": interface_tables.c_functions,
    "can-matrix": interface_tables.can_matrix,
    "commands": commands.markdown,
    "diagnostics": interface_tables.diagnostics,
    "supervision": interface_tables.supervision,
    "evidence-details": evidence_tables.details,
    "evidence-summary": evidence_tables.summary,
    "exit-codes": interface_tables.exit_codes,
    "identified-quantities": config_tables.quantities_markdown,
    "judgement": interface_tables.judgement,
    "map-comparison": map_choice.comparison,
    "map-file": interface_tables.map_file,
    "map-keys": map_choice.keys,
    "names-toml": config_tables.names_markdown,
    "planted-faults": evidence_tables.planted_faults,
    "python": python_names.markdown,
    "references-comparison": suite_tables.references,
    "run-columns": interface_tables.run_columns,
    "tracking-clocks": suite_tables.clocks,
    "tracking-missed": suite_tables.missed,
    "tracking-paths": suite_tables.paths,
    "tracking-results": suite_tables.results,
}
_REGION = re.compile(
    r"(?P<begin>^<!-- from the code: (?P<name>\S+)(?P<argument> \S+)? -->\n).*?(?=^<!-- end -->$)", re.M | re.S
)


def pages() -> dict[Path, str]:
    """Return the current text of every page with such a region."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(DOCS.glob("*.md"))}
    return {path: _REGION.sub(_current, text) for path, text in texts.items() if _REGION.search(text)}


def _current(region: re.Match[str]) -> str:
    made = REGIONS[region["name"]](*(region["argument"] or "").split())
    return f"{region['begin']}\n{made.strip()}\n\n"

"""The guide: `python -m sphinx -W --keep-going -b html docs build/docs`. Needs no network, and the pages contain no time.

The pages are plain Markdown, which a code host shows as well.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS.parent), str(DOCS / "_ext"), str(DOCS)]

import codegen  # noqa: E402

project = "ars-codegen"
author = "The ars-codegen authors"
project_copyright = author
release = version = codegen.__version__
language = "en"
smartquotes = False

extensions = [
    "myst_parser",
    "sphinx_copybutton",
    "from_code",
    "math_as_mathml",
]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_ext", "_static", "Thumbs.db"]
nitpicky = True

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
# Pages are also read where there is no Sphinx: Pygments does not know every kind of block that they name.
suppress_warnings: list[str] = []

html_theme = "furo"
html_title = f"ars-codegen {release}"
html_static_path = ["_static"]
html_css_files = ["guide.css"]
html_math_renderer = "mathml"
html_last_updated_fmt = None
html_show_sphinx = False
html_copy_source = False
html_show_sourcelink = False
html_use_index = False
html_theme_options = {"navigation_with_keys": True, "source_view_link": ""}
# Only the command of a line that starts with a dollar sign is copied, and none of what it prints.
copybutton_prompt_text = "$ "
copybutton_only_copy_prompt_lines = True
copybutton_exclude = ".linenos, .gp, .go"


def _add_navigation(app: Any, page: str, source: list[str]) -> None:
    """Add a table of contents to the start page for each list of pages in it, with its heading."""
    if page == app.config.root_doc:
        for heading, pages in re.findall(r"^## (.+)\n\n((?:- .+\n)+)", source[0], re.MULTILINE):
            names = "\n".join(re.findall(r"^- \[.+?\]\((.+?)\.md\)", pages, re.MULTILINE))
            source[0] += f"\n```{{toctree}}\n:caption: {heading}\n:hidden:\n\n{names}\n```\n"


def setup(app: Any) -> None:
    """Register what is above."""
    app.connect("source-read", _add_navigation)

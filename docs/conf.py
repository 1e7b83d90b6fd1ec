"""The guide: `python -m sphinx -W --keep-going -b html docs build/docs`. Needs no network, and asks no clock."""

from __future__ import annotations

import sys
from pathlib import Path

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
    "sphinx_click",
    "sphinx_copybutton",
    "sphinx_design",
    "from_code",
    "math_as_mathml",
]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_ext", "_static", "_figures", "Thumbs.db"]
nitpicky = True

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
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

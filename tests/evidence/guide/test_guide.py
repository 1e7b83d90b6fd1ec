"""The guide as built by Sphinx: without warnings, complete, and usable offline."""

import os
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.docs.blocks import PAGES, ROOT

LOADING_ATTRIBUTES = {
    "script": "src",
    "img": "src",
    "source": "srcset",
    "iframe": "src",
    "video": "src",
    "audio": "src",
    "object": "data",
}
"""Elements that load a resource, and the attribute with its address; `link` depends on its `rel`."""


class Page(HTMLParser):
    """Text of an HTML page, and the resources it loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.text = path.read_text(encoding="utf-8")
        self.loads: list[str] = []
        self.feed(self.text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        if tag == "link" and not {"next", "prev", "search", "canonical", "index"} & set(given.get("rel", "").split()):
            self.loads.append(given.get("href", ""))
        if tag in LOADING_ATTRIBUTES and LOADING_ATTRIBUTES[tag] in given:
            self.loads.append(given[LOADING_ATTRIBUTES[tag]])


def build(target: Path) -> Path:
    """Build the guide in a folder; warnings are errors."""
    options = ["-W", "--keep-going", "-q", "-E", "-b", "html", "-d"]
    command = [sys.executable, "-m", "sphinx", *options, target / "doctrees", ROOT / "docs", target / "html"]
    environment = os.environ | {"http_proxy": "http://127.0.0.1:9", "https_proxy": "http://127.0.0.1:9"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=target.parent, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    return target / "html"


@pytest.fixture(scope="module")
def guide(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("guide") / "one")


@pytest.fixture(scope="module")
def pages(guide: Path) -> dict[str, Page]:
    return {path.name: Page(path) for path in sorted(guide.glob("*.html"))}


def test_every_source_is_a_page(pages: dict[str, Page]) -> None:
    sources = [Path(page).stem for page in PAGES if page.startswith("docs/")]
    assert sources
    assert [name for name in sources if f"{name}.html" not in pages] == []


def test_nothing_is_loaded_from_a_network(pages: dict[str, Page], guide: Path) -> None:
    loaded = {(name, what) for name, page in pages.items() for what in page.loads}
    assert loaded
    assert [(name, what) for name, what in loaded if urlsplit(what).scheme not in ("", "data") or what.startswith("//")] == []
    assert [what for _, what in loaded if not what.startswith("data:") and not (guide / urlsplit(what).path).is_file()] == []
    for style in guide.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert "url(http" not in text.replace('"', "").replace("'", ""), style
        assert "@import" not in text, style


def test_formulae_need_no_script(pages: dict[str, Page]) -> None:
    assert pages["theory-map.html"].text.count("<math ") > 20
    for name, page in pages.items():
        assert "mathjax" not in page.text.lower().replace("mathjax_ignore", ""), name
        assert "merror" not in page.text, name

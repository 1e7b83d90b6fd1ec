"""Screenshots for review: the report, the explorer and the guide at three widths, light and dark.

`python scripts/screenshots.py DIR` needs the output of `make sil` and `make docs` under build/, Playwright and Chromium.
Pages that are longer than LENGTH continue in a second picture.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
WIDTHS = (390, 820, 1440)
SCHEMES = ("light", "dark")
LENGTH = 6000
REPORT, GUIDE = ROOT / "build" / "report.html", ROOT / "build" / "docs"
MAP = ROOT / "generated" / "4ws2.npz"
PAGES = ("index.html", "tutorial.html", "theory-map.html", "ars-toml.html")


def main() -> int:
    """Take all screenshots."""
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build" / "screenshots"
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    missing = [str(path) for path in (REPORT, GUIDE / "index.html") if not path.is_file()]
    if chromium is None or missing:
        print(f"error: missing: {', '.join(missing) or 'chromium'}; run make sil docs, and install chromium", file=sys.stderr)
        return 2
    from playwright.sync_api import sync_playwright

    target.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright, explorer() as address:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--enable-unsafe-swiftshader"])
        shown = {"report": (REPORT.as_uri(), "html[data-drawn=yes]"), "explore": (address, "#pictures[data-drawn]")}
        shown |= {f"guide-{page.partition('.')[0]}": ((GUIDE / page).as_uri(), "[role=main]") for page in PAGES}
        for width in WIDTHS:
            for scheme in SCHEMES:
                for name, (url, ready) in shown.items():
                    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
                    page.goto(url)
                    page.wait_for_selector(ready, state="attached", timeout=120_000)
                    for path in pictures(page, target / f"{name}-{width}-{scheme}"):
                        print(path)
                    page.close()
        browser.close()
    return 0


def pictures(page: Any, stem: Path) -> Iterator[Path]:
    """Yield screenshots of the whole page, in pieces of legible size."""
    width, height = page.evaluate("[document.documentElement.clientWidth, document.documentElement.scrollHeight]")
    for number, top in enumerate(range(0, height, LENGTH), start=1):
        path = stem.with_name(f"{stem.name}-{number}.png")
        piece = {"x": 0, "y": top, "width": width, "height": min(LENGTH, height - top)}
        page.screenshot(path=path, full_page=True, clip=piece)
        yield path


@contextmanager
def explorer() -> Iterator[str]:
    """Run `codegen explore` on a free port and yield its address."""
    words = [sys.executable, "-m", "codegen", "explore", "--map", str(MAP), "--no-browser"]
    process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        address = next((word for line in process.stdout for word in line.split() if word.startswith("http://")), None)
        if address is None:
            raise SystemExit("error: codegen explore did not start: run it by hand")
        yield address
    finally:
        process.terminate()
        process.wait()


if __name__ == "__main__":
    sys.exit(main())

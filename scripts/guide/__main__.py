"""Write the parts of docs/ that come from the code: `python -m scripts.guide`, with `--figures` the figures as well."""

import sys

from codegen.files import write_atomically
from scripts.guide import pages

for path, text in pages.pages().items():
    if path.read_text(encoding="utf-8") != text:
        write_atomically(path, text.encode())
        print(path)
if "--figures" in sys.argv:
    from scripts.guide import figures

    for path in figures.draw_all(pages.DOCS / "images"):
        print(path)

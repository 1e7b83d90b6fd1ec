"""Write the parts of docs/ that come from the code: `python -m scripts.guide [--figures] [--suite JSON] [--cars JSON]`.

With `--figures` the figures as well. With `--suite` and `--cars`, the records of the suites are made first, from the output of
`codegen suite tracking --build generated/4ws2 --json` and of `codegen suite cars --cars 40 --seed 4 --json`.
"""

import argparse
from pathlib import Path

from codegen.files import write_atomically
from scripts.guide import pages, suite_tables

parser = argparse.ArgumentParser(
    prog="python -m scripts.guide", description="Write the parts of docs/ that come from the code."
)
parser.add_argument("--figures", action="store_true", help="draw the figures too")
parser.add_argument("--suite", type=Path, metavar="JSON", help="make the record of the suite from its output first")
parser.add_argument("--cars", type=Path, metavar="JSON", help="make the record of the random cars from its output first")
given = parser.parse_args()
if given.suite is not None:
    print(suite_tables.write_record(given.suite))
if given.cars is not None:
    print(suite_tables.write_cars(given.cars))
for path, text in pages.pages().items():
    if path.read_text(encoding="utf-8") != text:
        write_atomically(path, text.encode())
        print(path)
if given.figures:
    from scripts.guide import figures

    for path in figures.draw_all(pages.DOCS / "images"):
        print(path)

"""`python -m benchmarks [NAME…] [--quick]`: measure, print, and leave with 1 where a required ratio is missed.

A wrong option is one line and exit code 2.
"""

from __future__ import annotations

import argparse
import importlib
import math
import sys
from pathlib import Path
from typing import Any, NoReturn

NAMES = {
    "solve": "solving",
    "loop": "closed_loop",
    "start": "processes",
    "lookup": "lookup",
    "can": "on_can",
    "cortex-m": "cortex_m",
    "newcomer": "newcomer",
    "explore": "explore",
    "nonlinear": "nonlinear_map",
    "agreement": "agreement",
    "flash": "flash",
    "batch": "batch",
    "campaign": "campaign",
    "minimal-error": "minimal_error",
    "signal-faults": "signal_faults",
    "stability": "stability",
    "response": "response",
    "identify": "identify",
    "plan": "drive_plan",
    "better": "better",
    "law": "law",
}
"""Name of a benchmark on the command line -> its module."""

ON_REQUEST = (
    "can",
    "cortex-m",
    "newcomer",
    "agreement",
    "minimal-error",
    "signal-faults",
    "stability",
    "response",
    "identify",
    "plan",
    "better",
    "law",
)
"""Only where named: they need what not every machine has, or measure no time."""

OPTIONS = {
    "better": ("cars", "seed", "plant"),
    "law": ("cars", "seed", "plant", "only", "shown", "maps", "changes", "straight"),
    "identify": ("plants",),
}
"""Options of a benchmark; without them it has defaults of its own."""
PLANTS = ("foreign",)
"""Values of --plants. The results of each have a section of their own."""
SECTIONS = tuple(each for name in NAMES for each in (name, *(f"{name}-{plants}" for plants in PLANTS if name == "identify")))
STRAIGHT_MAX_S = 600.0

READING = "Times: median (smallest–largest). Times faster: time of the peer over ours, median over pairs taken side by side."


class Parser(argparse.ArgumentParser):
    """Parser that reports a wrong option in one line."""

    def error(self, message: str) -> NoReturn:
        """Exit with code 2."""
        self.exit(2, f"{self.prog}: {message}; see --help\n")


def _count(text: str) -> int:
    if not text.isascii() or not text.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} must be a whole number from 0 on")
    return int(text)


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= STRAIGHT_MAX_S:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number of seconds from 0 to {STRAIGHT_MAX_S:g}")
    return value


def _page(text: str) -> Path:
    path = Path(text)
    if path.is_dir() or not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"{text!r} must be a file in a folder that exists")
    return path


def main() -> int:
    """Run the chosen benchmarks one after the other."""
    parser = Parser(prog="python -m benchmarks", description="Measure against peers, in one run.")
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"{', '.join(NAMES)}; by default all but {', '.join(ON_REQUEST)}"
    )
    parser.add_argument("--quick", action="store_true", help="fewer repeats, and IPOPT on a part of the grid")
    both = parser.add_argument_group("better and law")
    both.add_argument("--cars", type=_count, metavar="N", help="number of random cars; 0 for none")
    both.add_argument("--seed", type=_count, metavar="N", help="of the random cars")
    both.add_argument("--plant", metavar="NAMES", help="better: two-track, roll; law: ideal, real, roll; several with commas")
    law = parser.add_argument_group("law")
    law.add_argument("--only", metavar="ROWS", help="numbers of rows, with commas")
    law.add_argument("--shown", metavar="CARS", help="letters of the cars that are driven, such as PS")
    law.add_argument("--maps", type=Path, metavar="FOLDER", help="keep tuned maps there, and read those of an earlier call")
    law.add_argument(
        "--straight", type=_seconds, metavar="S", help="drive straight ahead for so long before the drives of row 7"
    )
    law.add_argument("--set", dest="changes", action="append", metavar="KEY=VALUE", help="change a key of ars.toml in all cars")
    parser.add_argument(
        "--plants", choices=PLANTS, help="identify: only cars that the model does not describe, and the coverage of intervals"
    )
    parser.add_argument("--write", type=_page, metavar="FILE", help="put what is measured into this page, too")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in NAMES]
    if unknown:
        parser.error(f"there is no benchmark {unknown[0]!r}; known: {', '.join(NAMES)}")

    names = options.names or [name for name in NAMES if name not in ON_REQUEST]
    for key in {key: None for keys in OPTIONS.values() for key in keys}:
        owners = [name for name in NAMES if key in OPTIONS.get(name, ())]
        if getattr(options, key) is not None and not {*owners} & {*names}:
            parser.error(f"--{'set' if key == 'changes' else key} is an option of {' and '.join(owners)}")

    from benchmarks import machine, results
    from benchmarks.choices import WrongOption
    from codegen.errors import CodegenError

    described = machine.description()
    missed = measured = 0
    for name in names:
        given = {key: value for key in OPTIONS.get(name, ()) if (value := getattr(options, key)) is not None}
        module: Any = importlib.import_module(f"benchmarks.{NAMES[name]}")
        try:
            report = module.run(options.quick, lambda text: print(f"... {text}", file=sys.stderr, flush=True), **given)
        except WrongOption as error:
            parser.error(f"{name}: {error}")
        except CodegenError as error:
            print(f"\n{name}: not measured: {error}", flush=True)
            missed += 1
            continue
        print(f"\n{report}", flush=True)
        measured += 1
        if options.write is not None:
            title = "-".join(filter(None, (name, given.get("plants"))))
            results.update(options.write, {title: results.section(title, report.markdown(), described)}, SECTIONS, READING)
        missed += sum(not comparison.met for comparison in report.comparisons)
    print(f"\n{READING}")
    print(f"At the beginning: {described}")
    print(f"At the end: {machine.load()}.")
    if options.write is not None and measured:
        print(f"written: {options.write}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())

"""Bitwuzla as a command that solves one SMT-LIB file."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python"))
import bitwuzla

commands = Path(sys.argv[-1]).read_text(encoding="ascii").replace("(exit)", "")
# The answer goes out before the model is requested: without a model that request is an error.
head, check, values = commands.partition("(check-sat)")
terms, options = bitwuzla.TermManager(), bitwuzla.Options()
options.set(bitwuzla.Option.PRODUCE_MODELS, True)
parser = bitwuzla.Parser(terms, options, "smt2")
parser.parse(head + check, False, False)
sys.stdout.flush()
try:
    parser.parse(values, False, False)
except bitwuzla.BitwuzlaException as error:
    print(error, file=sys.stderr)

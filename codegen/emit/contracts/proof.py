"""A proof: a harness in the folder `verify/` of a build, and the command with which CBMC proves it. The manifest lists them."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

FOLDER = "verify"
CHECKS = "--bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check"
CONVERSIONS = "--conversion-check"
SOLVER = "--undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla"
"""Without slicing, CBMC copies structs of floats whole, which its SMT encoding does not support."""

# The words of a command from a manifest: a shell runs nothing else for them, and none is an option.
Name = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")]
Path = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_./]*$")]


class Proof(BaseModel):
    """How CBMC proves a harness.

    Attributes:
        name: name of the harness, such as "ars_limiter_step".
        files: paths of the C that belongs to the proof, beside the harness.
        unwind: loop rounds, one more than the longest loop has.
        undefined: undefined behaviour is checked.
        conversions: conversions from float to integer are checked.
        big_endian: the target is big-endian.
        replaced: functions whose calls go to those of the same name with `_of_lemma`.
        open: reason why there is no proof; "" if there is one.
    """

    model_config = ConfigDict(frozen=True, strict=True)

    name: Name
    files: Annotated[tuple[Path, ...], Field(strict=False)] = ()
    unwind: int = 16
    undefined: bool = True
    conversions: bool = True
    big_endian: bool = False
    replaced: Annotated[tuple[Name, ...], Field(strict=False)] = ()
    open: str = ""

    @property
    def path(self) -> str:
        """Path of the harness in the build."""
        return f"{FOLDER}/prove_{self.name}.c"

    def command(self, *options: str) -> str:
        """Return the command for a shell in the folder of the build, with options for the preprocessor."""
        entry = f"prove_{self.name}"
        given = " ".join((self.path, *self.files, *options, "-Iinclude", f"-I{FOLDER}"))
        before = ""
        if self.replaced:
            program = f'"${{TMPDIR:-/tmp}}/{entry}.goto"'
            calls = " ".join(f"--replace-calls {name}:{name}_of_lemma" for name in self.replaced)
            before = f"goto-cc -o {program} {given} && goto-instrument {calls} {program} {program} >/dev/null && "
            given = program
        chosen = {"--big-endian": self.big_endian, CHECKS: self.undefined, CONVERSIONS: self.conversions, SOLVER: True}
        checks = " ".join(option for option, is_chosen in chosen.items() if is_chosen)
        return f"{before}cbmc {given} --function {entry} --unwind {self.unwind} {checks}"

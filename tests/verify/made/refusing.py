"""A check that cannot use the build."""

from codegen.errors import BuildError


def check(*_: object) -> None:
    raise BuildError("the C does not compile", where="src/x.c:3")

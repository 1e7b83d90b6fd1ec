"""A check that raises an unexpected error."""


def check(*_: object) -> None:
    raise RuntimeError("a fault of the program")

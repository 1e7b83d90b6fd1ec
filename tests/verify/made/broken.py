"""A check with a fault of its own."""


def check(*_: object) -> None:
    raise RuntimeError("a fault of the program")

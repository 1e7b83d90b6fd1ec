"""A check without its tool."""

from codegen.verify.tools import MissingTool


def check(*_: object) -> None:
    raise MissingTool("it is not installed", where="nothing", remedy="install it")

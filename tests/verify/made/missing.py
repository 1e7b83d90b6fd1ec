"""A check without its tool."""

from __future__ import annotations

from codegen.verify.check import Effort, Outcome, Subject
from codegen.verify.packages import MissingTool


def check(subject: Subject, effort: Effort) -> Outcome:
    raise MissingTool("it is not installed", where="nothing", remedy="install it")

"""Warnings of the libraries that read logs and databases: they go into the account instead of being lost."""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Iterator

from codegen.errors import one_line

LIBRARIES = ("can", "cantools", "asammdf")


@contextlib.contextmanager
def collected() -> Iterator[list[str]]:
    """Yield a list that gets each warning of the libraries in the block, once."""
    found: list[str] = []

    def keep(text: object) -> None:
        line = one_line(text)
        if line and line not in found:
            found.append(line)

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            keep(record.getMessage())

    handler = Handler(logging.WARNING)
    loggers = [logging.getLogger(name) for name in LIBRARIES]
    propagated, disabled = [logger.propagate for logger in loggers], logging.root.manager.disable
    logging.disable(logging.NOTSET)  # the command line disables all logging
    for logger in loggers:
        logger.addHandler(handler)
        logger.propagate = False
    try:
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always", UserWarning)
            yield found
        for each in raised:
            if issubclass(each.category, UserWarning):
                keep(each.message)
    finally:
        logging.disable(disabled)
        for logger, is_propagated in zip(loggers, propagated, strict=True):
            logger.removeHandler(handler)
            logger.propagate = is_propagated

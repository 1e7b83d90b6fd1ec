"""Finished steps of a part, kept on disk so that a full run resumes after a kill."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any


class Progress:
    """Results of finished steps by key, one JSON line each in a file; without a file they are not kept."""

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self.done: dict[str, Any] = {}
        for line in path.read_text(encoding="utf-8").splitlines() if path and path.is_file() else ():
            try:
                key, self.done[key] = json.loads(line)
            except ValueError:
                continue  # a line truncated by a kill

    def keep(self, key: str, value: Any) -> None:
        """Store the result (JSON values only) of a finished step."""
        self.done[key] = value
        if self._path is not None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a", encoding="utf-8") as stream:
                stream.write(f"{json.dumps([key, value])}\n")

    def once(self, key: str, make: Callable[[], Any]) -> Any:
        """Return the stored result of a step, or run the step and store it."""
        if key not in self.done:
            self.keep(key, make())
        return self.done[key]

"""Finished steps of a part of the evidence, kept on disk so that a part resumes after a kill."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any


class Progress:
    """Results of finished steps by key, one JSON line each, in a file named by the hash of all inputs."""

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self._done: dict[str, Any] = {}
        if path is not None and path.is_file():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    step = json.loads(line)
                except ValueError:
                    continue  # a line truncated by a kill
                self._done[step["key"]] = step["value"]

    def get(self, key: str) -> Any:
        """Return the result of a finished step, None if it has not finished."""
        return self._done.get(key)

    def keep(self, key: str, value: Any) -> None:
        """Store the result (JSON values only) of a finished step."""
        self._done[key] = value
        if self._path is not None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps({"key": key, "value": value}) + "\n")

    def once(self, key: str, make: Callable[[], Any]) -> Any:
        """Return the stored result of a step, or run the step and store it."""
        if key not in self._done:
            self.keep(key, make())
        return self._done[key]

"""What has been measured, one file for each run: a comparison that was stopped goes on from there."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np


class Results:
    """A folder of results; without one nothing is kept."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    def _path(self, key: str, suffix: str) -> Path | None:
        return None if self.folder is None else self.folder / (re.sub(r"[^\w.+-]+", "_", key) + suffix)

    def once(self, key: str, make: Callable[[], Any]) -> Any:
        """A value that JSON can hold: from its file, or made and kept."""
        path = self._path(key, ".json")
        if path is not None and path.exists():
            return json.loads(path.read_text(encoding="utf-8"))
        value = make()
        if path is not None:
            partial = path.with_suffix(".part")
            partial.write_text(json.dumps(value), encoding="utf-8")
            partial.replace(path)
        return value

    def array(self, key: str, make: Callable[[], np.ndarray]) -> np.ndarray:
        """The same for an array."""
        path = self._path(key, ".npy")
        if path is not None and path.exists():
            return np.load(path)
        value = make()
        if path is not None:
            partial = path.with_suffix(".part.npy")
            np.save(partial, value)
            partial.replace(path)
        return value

"""Perceived episodes as files: finished ones are neither lost nor run again, and another protocol needs no new run."""

from __future__ import annotations

import io
import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.bench.detect.perceived.perceived import Perceived
from coopsim.errors import StoreError
from coopsim.support.files import make_folder, write_durably

_PLAIN = ("region_m", "frames", "messages", "sent_bytes", "ms")
_ABOUT = "about"


class PerceivedFiles:
    """Episodes by key, in a folder of compressed NumPy files without pickles.

    Raises:
        InvalidValueError: the folder cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        make_folder(folder)

    def get(self, key: str) -> Perceived | None:
        """Return an episode; None if there is none of that key.

        Raises:
            StoreError: the file is broken.
        """
        path = self._path(key)
        try:
            with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as arrays:
                about = json.loads(bytes(arrays[_ABOUT]).decode())
                columns = {each.name: arrays[each.name] for each in fields(Perceived) if each.name not in _PLAIN}
            return Perceived(**columns, **about | {"region_m": tuple(about["region_m"])})
        except FileNotFoundError:
            return None
        except Exception as error:  # a changed byte makes zipfile, zlib and numpy raise almost anything
            raise StoreError(f"{path} is broken: {type(error).__name__}: {error}") from error

    def put(self, key: str, perceived: Perceived) -> None:
        """Store an episode durably.

        Raises:
            InvalidValueError: the file cannot be written.
        """
        columns: dict[str, Any] = {each.name: getattr(perceived, each.name) for each in fields(Perceived)}
        about = json.dumps({name: columns.pop(name) for name in _PLAIN}).encode()
        content = io.BytesIO()
        columns[_ABOUT] = np.frombuffer(about, np.uint8)
        np.savez_compressed(content, **columns)
        write_durably(self._path(key), content.getvalue())

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.npz"

"""The folder of an entry: `entry.yaml`, `card.md`, code, and the scores of its fixed runs."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Self

from coopsim.bench.store.fingerprint import package_digest
from coopsim.catalog import PolicySpec
from coopsim.config.spec import parse_spec, spell_spec
from coopsim.config.yaml_file import read_yaml
from coopsim.errors import InvalidValueError, LeaderboardEntryError

ABOUT, CARD, RUNS = "entry.yaml", "card.md", "runs"
"""Names in an entry's folder: its description, its card, and the store of unfinished runs."""

HEADINGS = ("Method", "Source", "Differences from the paper", "Training and tuning")
"""Headings of a card, each with a text."""

OURS = "coopsim"
"""Key of the library's own digest. It changes with every version, so scores say if it matters."""

_REQUIRED, _OPTIONAL = ("name", "policy", "authors", "license"), ("url",)
_NO_SOURCE = hashlib.sha256(b"").hexdigest()


@dataclass(frozen=True, slots=True)
class EntryFolder:
    """An entry as its folder describes it.

    Attributes:
        folder: path of the folder.
        name: name in the table.
        policy: text of the policy; files in it are relative to the folder.
        authors: names of the authors.
        license: licence of the code.
        url: address of a paper or of sources; empty for none.
    """

    folder: Path
    name: str
    policy: str
    authors: tuple[str, ...]
    license: str
    url: str = ""

    @classmethod
    def read(cls, folder: str | Path) -> Self:
        """Read an entry's description.

        Raises:
            InvalidValueError: there is no such folder.
            LeaderboardEntryError: `entry.yaml` is missing or broken; names the line.
        """
        if not Path(folder).is_dir():
            raise InvalidValueError(f"entry must be a folder with {ABOUT}, got {str(folder)!r}")
        root = read_yaml(Path(folder, ABOUT), LeaderboardEntryError)
        given = root.fields(_REQUIRED, _OPTIONAL)
        texts = {key: entry.text().strip() for key, entry in given.items() if key != "authors"}
        for key in ("name", "policy", "license"):
            if not texts[key]:
                raise given[key].error(f"{key} must be a text, got nothing")
        authors = tuple(each.text().strip() for each in given["authors"].entries(" of names"))
        if not authors or not all(authors):
            raise given["authors"].error("authors must be at least one name")
        if texts.get("url") and not re.match(r"https?://", texts["url"]):
            raise given["url"].error(f"url must begin with https:// or http://, got {texts['url']!r}")
        return cls(Path(folder), authors=authors, **texts)

    def spec(self) -> PolicySpec:
        """Return the policy, with paths from here.

        Raises:
            CoopsimError: it has another shape, or names a file that is not in the folder.
        """
        target, parameters = parse_spec("policy", self.policy)
        place, _, kind = target.rpartition(":")
        if place.endswith(".py"):
            target = f"{self._inside(place)}:{kind}"
        paths = {key: str(self._inside(each)) for key, each in parameters.items() if _is_path(each)}
        return PolicySpec.parse(spell_spec(target, parameters | paths))

    def code(self) -> dict[str, str]:
        """Return the digest of every file of the folder that is code or data, and of the package that the policy names.

        Nothing of the entry is imported.

        Raises:
            CoopsimError: the policy has no source that can be read.
        """
        spec = self.spec()
        found = {path.relative_to(self.folder).as_posix(): _digest(path.read_bytes()) for path in self._files()}
        if spec.source is None:
            module = spec.place or spec.policy_class().__module__
            package = module.partition(".")[0]
            digest = package_digest(package) if find_spec(package) else _NO_SOURCE
            if digest == _NO_SOURCE:
                raise LeaderboardEntryError(f"policy {self.policy!r} has no source here: there is none of {package!r}")
            found[package] = digest
        return found

    def card(self) -> dict[str, str]:
        """Return the text below each heading of the card, without comments. Raises `LeaderboardEntryError`."""
        path = self.folder / CARD
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise LeaderboardEntryError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
        parts = re.split(r"^#+ +(.+?) *$", re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL), flags=re.MULTILINE)
        return {heading: below.strip() for heading, below in zip(parts[1::2], parts[2::2], strict=True)}

    def _inside(self, name: str) -> Path:
        path = self.folder / name
        if not path.resolve().is_relative_to(self.folder.resolve()):
            raise LeaderboardEntryError(f"policy must name files of its folder, got {name!r}")
        if not path.is_file():
            raise LeaderboardEntryError(f"policy names {name!r}, and there is no such file in {self.folder}")
        return path

    def _files(self) -> Iterator[Path]:
        apart = (ABOUT, CARD, RUNS, "warm_up.json", "scores.json")
        for path in sorted(self.folder.rglob("*")):
            parts = path.relative_to(self.folder).parts
            hidden = any(part.startswith(".") or part == "__pycache__" for part in parts)
            if path.is_file() and not hidden and parts[0] not in apart:
                yield path


def digest_of(code: dict[str, str]) -> str:
    """Return one digest of all code of an entry, 64 hexadecimal digits."""
    return _digest(json.dumps(code, sort_keys=True).encode())


def _is_path(value: object) -> bool:
    return isinstance(value, str) and ("/" in value or value.endswith(".safetensors"))


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()

"""The folder of an entry: `entry.yaml`, `card.md`, code, and the scores of its fixed runs."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Self

from coopsim.bench.entries.entry_files import copy_files, digest_of_file, files_of, read_text
from coopsim.bench.store.packages import package_digest
from coopsim.catalog import PolicySpec
from coopsim.config.spec import parse_spec, spell_spec
from coopsim.config.yaml_file import read_yaml
from coopsim.errors import InvalidValueError, LeaderboardEntryError

ABOUT, CARD, SCORES = "entry.yaml", "card.md", ("warm_up.json", "scores.json")
"""Names in an entry's folder: its description, its card, and the scores that it reports of itself."""

HEADINGS = ("Method", "Source", "Differences from the paper", "Training and tuning")
"""Headings of a card, each with a text."""

OURS = "coopsim"
"""Package whose digest changes with every version, so scores say if it matters."""

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
            LeaderboardEntryError: it has something else than files, or too much; or `entry.yaml` is missing or broken,
                and the line is named.
        """
        if not Path(folder).is_dir() or Path(folder).is_symlink():
            raise InvalidValueError(f"entry must be a folder with {ABOUT}, and no link, got {str(folder)!r}")
        if ABOUT in files_of(Path(folder)):
            read_text(Path(folder, ABOUT))  # which refuses what is too large
        root = read_yaml(Path(folder, ABOUT), LeaderboardEntryError)
        given = root.fields(_REQUIRED, _OPTIONAL)
        texts = {key: entry.text().strip() for key, entry in given.items() if key != "authors"}
        for key in ("name", "policy", "license"):
            if not texts[key]:
                raise given[key].error(f"{key} must be a text, got nothing")
        for key, entry in given.items():
            if key != "authors" and not texts[key].isprintable():
                raise entry.error(f"{key} must be of printable characters, got {texts[key]!a}")
        authors = tuple(each.text().strip() for each in given["authors"].entries(" of names"))
        if not authors or not all(name and name.isprintable() for name in authors):
            raise given["authors"].error("authors must be at least one name, of printable characters")
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
        """Return the digest of every file of the folder but its scores, by name. Raises `LeaderboardEntryError`."""
        return {name: digest_of_file(path) for name, path in self._read().items()}

    def packages(self) -> dict[str, str]:
        """Return the digests of coopsim and of the package that the policy names; nothing is imported.

        Raises:
            CoopsimError: the policy has no source that can be read.
        """
        spec, found = self.spec(), {OURS: package_digest(OURS)}
        package = OURS if spec.source is not None else (spec.place or spec.policy_class().__module__).partition(".")[0]
        if package not in found:
            found[package] = package_digest(package) if find_spec(package) else _NO_SOURCE
        if _NO_SOURCE in found.values():
            raise LeaderboardEntryError(f"policy {self.policy!r} has no source here: there is none of {package!r}")
        return found

    @property
    def digest(self) -> str:
        """Digest of all that is the entry's own, 64 hexadecimal digits. Raises as `packages` does."""
        theirs = {name: digest for name, digest in self.packages().items() if name != OURS}
        return hashlib.sha256(json.dumps([self.policy, self.code(), theirs], sort_keys=True).encode()).hexdigest()

    def copy_to(self, folder: Path) -> Self:
        """Copy all files but the scores, and return the copy: what was digested is what runs."""
        copy_files(self._read(), folder)
        return replace(self, folder=folder)

    def card(self) -> dict[str, str]:
        """Return the text below each heading of the card, without comments. Raises `LeaderboardEntryError`."""
        text, *commented = read_text(self.folder / CARD).split("<!--")
        text += "".join(part.partition("-->")[2] for part in commented)
        parts = re.split(r"^#+ +(.+?) *$", text, flags=re.MULTILINE)
        return {heading: below.strip() for heading, below in zip(parts[1::2], parts[2::2], strict=True)}

    def _inside(self, name: str) -> Path:
        path = self.folder / name
        if not path.resolve().is_relative_to(self.folder.resolve()):
            raise LeaderboardEntryError(f"policy must name files of its folder, got {name!r}")
        if not path.is_file():
            raise LeaderboardEntryError(f"policy names {name!r}, and there is no such file in {self.folder}")
        return path

    def _read(self) -> dict[str, Path]:
        return {name: path for name, path in files_of(self.folder).items() if name not in SCORES}


def _is_path(value: object) -> bool:
    return isinstance(value, str) and ("/" in value or value.endswith(".safetensors"))

"""What an export is to contain: everything that decides its bytes."""

from __future__ import annotations

import hashlib
import json
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from coopsim import __version__
from coopsim.catalog import is_scenario_file
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_count
from coopsim.support.rng import require_seed

_PACKAGES = ("numpy", "numba", "scipy", "pillow")


@dataclass(frozen=True, slots=True)
class ExportPlan:
    """The arguments of an export.

    Attributes:
        format: the format's spec, as "opv2v" or "kitti(agent=cav_1)".
        environment: name, or path of a scenario file.
        seeds: of the episodes, in order, each once.
        frames: of each episode.
        options: further options of the environment; plain data.
    """

    format: str
    environment: str
    seeds: tuple[int, ...]
    frames: int
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_count(1, frames=self.frames)
        for seed in self.seeds:
            require_seed(seed)
        if not self.seeds or len(set(self.seeds)) < len(self.seeds):
            raise InvalidValueError(f"seeds must be distinct, at least one, got {reprlib.repr(self.seeds)}")
        try:
            json.dumps(dict(self.options))
        except TypeError as error:
            raise InvalidValueError(f"options must be plain data (numbers, texts, lists, mappings): {error}") from error

    @property
    def name(self) -> str:
        """The environment's name as a part of names of folders and scenes, as "crossing" or "rush_hour"."""
        name = Path(self.environment).stem if is_scenario_file(self.environment) else self.environment
        return "".join(letter if letter.isalnum() else "_" for letter in name.rpartition("/")[2])

    def episode_name(self, seed: int) -> str:
        """Return the name of an episode, as "crossing_0007"; names sort as seeds do up to 9999."""
        return f"{self.name}_{seed:04d}"

    def facts(self) -> dict[str, Any]:
        """Return the plan and the versions that decide its bytes, as JSON has them."""
        facts: dict[str, Any] = {
            "format": self.format,
            "environment": self.environment,
            "seeds": list(self.seeds),
            "frames": self.frames,
            "options": dict(self.options),
            "versions": {"coopsim": __version__, **{name: version(name) for name in _PACKAGES}},
        }
        if is_scenario_file(self.environment) and Path(self.environment).is_file():
            facts["scenario_file_sha256"] = hashlib.sha256(Path(self.environment).read_bytes()).hexdigest()
        loaded: dict[str, Any] = json.loads(json.dumps(facts))
        return loaded

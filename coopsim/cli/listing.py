"""Everything that is registered or shipped, by kind, with a line of description each."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import coopsim
from coopsim.errors import MissingDependencyError
from coopsim.support.registry import Registry

Entry = dict[str, Any]
"""An entry: `name` and `description`; where there are any, `aliases`; `uplink` of a policy, `content` of a codec."""


def listing() -> dict[str, Callable[[], list[Entry]]]:
    """Return the functions that list the entries of each kind."""
    from coopsim.bench.detect.protocols import PROTOCOLS
    from coopsim.catalog import REWARDS, scenario_folder
    from coopsim.comms.codecs.codec import CODECS
    from coopsim.comms.uplinks.uplink import UPLINKS
    from coopsim.data.export.export_format import EXPORT_FORMATS
    from coopsim.data.maps.export.map_format import MAP_FORMATS
    from coopsim.detection.detector import DETECTORS
    from coopsim.detection.embedder import EMBEDDERS
    from coopsim.episode import RECORDERS
    from coopsim.interfaces.attack import ATTACKS
    from coopsim.interfaces.defense import DEFENSES
    from coopsim.interfaces.planner import PLANNERS
    from coopsim.recordings.formats import RECORDINGS
    from coopsim.world.scenario import SCENARIOS
    from coopsim.world.situations.situation import SITUATIONS

    return {
        "policies": lambda: [entry | {"uplink": _uplink(entry["name"])} for entry in _registered(coopsim.POLICIES)],
        "environments": _environments,
        "places": lambda: [_entry(name, _of_place(name)) for name in SCENARIOS],
        "situations": partial(_registered, SITUATIONS),
        "scenario files": lambda: _files(scenario_folder()),
        "detectors": partial(_registered, DETECTORS),
        "embedders": partial(_registered, EMBEDDERS),
        "uplinks": partial(_registered, UPLINKS),
        "fusions": _fusions,
        "codecs": lambda: [entry | {"content": CODECS.get(entry["name"]).content} for entry in _registered(CODECS)],
        "camera rigs": _rigs,
        "planners": partial(_registered, PLANNERS),
        "attacks": partial(_registered, ATTACKS),
        "defenses": lambda: [_with_needs(entry, DEFENSES.get(entry["name"])) for entry in _registered(DEFENSES)],
        "metrics": _metrics,
        "recorders": partial(_registered, RECORDERS),
        "rewards": partial(_registered, REWARDS),
        "protocols": partial(_registered, PROTOCOLS),
        "recordings": partial(_registered, RECORDINGS),
        "export formats": partial(_registered, EXPORT_FORMATS),
        "map formats": partial(_registered, MAP_FORMATS),
        "presets": lambda: _files(_package_folder() / "bench" / "grid" / "presets", suffix=""),
        "recipes": lambda: _files(_package_folder() / "learn" / "recipes", suffix=""),
        "weights": _weights,
    }


def _registered(registry: Registry[Any]) -> list[Entry]:
    return [_entry(name, _first_sentence(registry.get(name)), registry.aliases_of(name)) for name in registry]


def _entry(name: str, description: str, aliases: Iterable[str] = ()) -> Entry:
    return {"name": name, "description": description, **({"aliases": list(aliases)} if aliases else {})}


def _with_needs(entry: Entry, defense: Any) -> Entry:
    """Add to a defence what it needs besides messages."""
    needs = ["a LiDAR"] * defense.needs_lidar + ["the truth"] * defense.needs_truth
    said = f" (needs {' and '.join(needs)})" if needs else ""
    return entry | {"description": f"{entry['description']}{said}"}


def _first_sentence(thing: Any) -> str:
    """Return the first sentence of a docstring, in one line."""
    text = inspect.getdoc(thing.func if isinstance(thing, partial) else thing) or ""
    return _sentence(text.split("\n\n")[0])


def _sentence(text: str) -> str:
    """Return the first sentence of a text without its period, and without references for programmers."""
    # A period ends a sentence before a capital, not within "et al.," or "sec. III".
    first = re.split(r"(?<![ (][A-Za-z])(?<!sec)(?<!al)\.(?= [A-Z]|$)", " ".join(text.split()))[0]
    return re.split(r"; (see `|the layout|it has no)", first)[0]


def _uplink(policy: str) -> str:
    return str(coopsim.POLICIES.get(policy).needs.uplink)


def _of_place(name: str) -> str:
    """Describe a place: what its maker does, or that it is described."""
    from coopsim.world.scenario import SCENARIOS

    place = SCENARIOS.get(name)
    return _first_sentence(place.make_layout) if place.description is None else "Drive in a described place"


def _environments() -> list[Entry]:
    from coopsim.world.drawn_places import TOWN
    from coopsim.world.scenario import SCENARIOS
    from coopsim.world.situations.situation import SITUATIONS

    def described(name: str) -> str:
        bare = name.rpartition("-v")[0]
        if bare in SCENARIOS:
            return _of_place(bare)
        if bare in SITUATIONS:
            return _first_sentence(SITUATIONS.get(bare))
        return "Draw a town for each episode" if bare == TOWN else _first_sentence(coopsim.ENVIRONMENTS.get(name))

    return [_entry(name, described(name)) for name in coopsim.ENVIRONMENTS]


def _fusions() -> list[Entry]:
    """Return the fusions of feature maps; none where torch, which they are made of, is not installed."""
    try:
        from coopsim.nn.fusion import FUSIONS
    except MissingDependencyError:
        return []
    return _registered(FUSIONS)


def _metrics() -> list[Entry]:
    from coopsim.metrics.built_in import all_metrics

    return [_entry(name, metric.meaning) for name, metric in sorted(all_metrics().items())]


def _rigs() -> list[Entry]:
    from coopsim.sensors.camera.camera import RIG_HEADINGS_RAD

    return [_entry(name, f"cameras {', '.join(cameras)}") for name, cameras in RIG_HEADINGS_RAD.items()]


def _files(folder: Path, suffix: str = ".yaml") -> list[Entry]:
    """Describe YAML files by the comment that each begins with."""
    found = []
    for path in sorted(folder.glob("*.yaml")):
        comment = re.match(r"(#.*\n)*", path.read_text(encoding="utf-8"))
        text = "" if comment is None else comment[0].replace("#", "")
        found.append(_entry(path.stem + suffix, _sentence(text)))
    return found


def _weights() -> list[Entry]:
    """Describe the weights that ship by their cards, also where torch is not installed."""
    folder = _package_folder() / "weights"
    cards = {path.stem: path.with_suffix(".json") for path in sorted(folder.glob("*.safetensors"))}
    return [_entry(name, _of_card(json.loads(card.read_text()))) for name, card in cards.items()]


def _of_card(card: Mapping[str, Any]) -> str:
    return f"{card['parameters']:,} parameters, made by `{card['command']}`"


def _package_folder() -> Path:
    return Path(str(coopsim.__file__)).parent

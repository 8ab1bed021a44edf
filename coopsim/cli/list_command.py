"""`coopsim list`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import coopsim
from coopsim.cli.arguments import Command

if TYPE_CHECKING:
    from coopsim.support.registry import Registry


def _add_list(parser: argparse.ArgumentParser) -> None:
    """Declare no arguments."""


def _run_list(options: argparse.Namespace) -> int:
    from coopsim.attacks.attack import ATTACKS
    from coopsim.bench.grid.grid_file import PRESETS
    from coopsim.catalog import REWARDS, scenario_files
    from coopsim.comms.codecs.codec import CODECS
    from coopsim.comms.uplinks.uplink import UPLINKS
    from coopsim.data.export.export_format import EXPORT_FORMATS
    from coopsim.defenses.defense import DEFENSES
    from coopsim.detection.detector import DETECTORS
    from coopsim.detection.embedder import EMBEDDERS
    from coopsim.learn.recipe import RECIPES
    from coopsim.metrics.metric import METRICS
    from coopsim.planning.planner import PLANNERS
    from coopsim.sensors.camera.camera import RIG_NAMES

    listed = {
        "policies": [_with_aliases(coopsim.POLICIES, name) for name in coopsim.POLICIES],
        "environments": coopsim.ENVIRONMENTS.names(),
        "scenario files": scenario_files(),
        "detectors": DETECTORS.names(),
        "embedders": EMBEDDERS.names(),
        "uplinks": UPLINKS.names(),
        "codecs": [f"{name} ({CODECS.get(name).content})" for name in CODECS],
        "camera rigs": RIG_NAMES,
        "planners": PLANNERS.names(),
        "attacks": ATTACKS.names(),
        "defenses": [_with_aliases(DEFENSES, name) for name in DEFENSES],
        "metrics": METRICS.names(),
        "rewards": REWARDS.names(),
        "export formats": [_with_aliases(EXPORT_FORMATS, name) for name in EXPORT_FORMATS],
        "presets": PRESETS,
        "recipes": RECIPES,
        "weights": _weights(),
    }
    for kind, names in listed.items():
        print(f"{kind + ':':<16}{', '.join(names) or '(none)'}")
    return 0


def _with_aliases(registry: Registry[Any], name: str) -> str:
    return f"{name} (or {', '.join(aliases)})" if (aliases := registry.aliases_of(name)) else name


def _weights() -> list[str]:
    """Return the names of the weights that come along, also where torch is not installed."""
    import coopsim.weights

    return sorted(path.stem for path in Path(coopsim.weights.__path__[0]).glob("*.safetensors"))


LIST = Command(
    "list the names of all that is registered or shipped: policies, environments, detectors, uplinks, codecs, ...",
    _add_list,
    _run_list,
)

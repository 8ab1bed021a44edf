"""`coopsim list`."""

from __future__ import annotations

import argparse

import coopsim

HELP = "list the names of policies, environments, scenario files, detectors, codecs, camera rigs, metrics, presets"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare no arguments."""


def run(options: argparse.Namespace) -> int:
    """Run the command. Return the exit status."""
    from coopsim.bench.grid.grid_file import PRESETS
    from coopsim.catalog import scenario_files
    from coopsim.comms.codecs.codec import codecs_of
    from coopsim.detection.detector import DETECTORS
    from coopsim.metrics.metric import METRICS
    from coopsim.sensors.camera.rig_names import RIG_NAMES

    listed = {
        "policies": coopsim.POLICIES.names(),
        "environments": coopsim.ENVIRONMENTS.names(),
        "scenario files": scenario_files(),
        "detectors": DETECTORS.names(),
        "codecs": codecs_of("detections"),
        "camera rigs": RIG_NAMES,
        "metrics": METRICS.names(),
        "presets": PRESETS,
    }
    for kind, names in listed.items():
        print(f"{kind + ':':<16}{', '.join(names)}")
    return 0

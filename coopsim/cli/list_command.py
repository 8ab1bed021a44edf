"""`coopsim list`."""

from __future__ import annotations

import argparse

import coopsim

HELP = "names of policies, environments, scenario files, detectors, codecs, camera rigs and presets"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """It takes nothing."""


def run(options: argparse.Namespace) -> int:
    """Run it; the exit status."""
    from coopsim.bench.grid.grid_file import PRESETS
    from coopsim.catalog import scenario_files
    from coopsim.comms.codecs.codec import codecs_of
    from coopsim.detection.detector import DETECTORS
    from coopsim.sensors.camera.rig_names import RIG_NAMES

    listed = {
        "policies": coopsim.POLICIES.names(),
        "environments": coopsim.ENVIRONMENTS.names(),
        "scenario files": scenario_files(),
        "detectors": DETECTORS.names(),
        "codecs": codecs_of("detections"),
        "camera rigs": RIG_NAMES,
        "presets": PRESETS,
    }
    for kind, names in listed.items():
        print(f"{kind + ':':<16}{', '.join(names)}")
    return 0

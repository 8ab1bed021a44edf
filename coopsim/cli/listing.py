"""`coopsim list`."""

from __future__ import annotations

import argparse

import coopsim

HELP = "names of policies, environments and camera rigs"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """It takes nothing."""


def run(options: argparse.Namespace) -> int:
    """Run it; the exit status."""
    from coopsim.sensors.rigs import RIG_NAMES

    print("policies:     " + ", ".join(coopsim.POLICIES.names()))
    print("environments: " + ", ".join(coopsim.ENVIRONMENTS.names()))
    print("camera rigs:  " + ", ".join(RIG_NAMES))
    return 0

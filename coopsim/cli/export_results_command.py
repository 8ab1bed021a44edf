"""`coopsim export-results`."""

from __future__ import annotations

import argparse
from pathlib import Path

from coopsim.cli.arguments import add_options, named_options, policy

HELP = "run a policy on what `export nuscenes` wrote, and write its tracks for nuScenes' official tools"

_FLAGS = {"uplink": "--policy", "max_cycles": "the export's --frames", "seed": "the export's --seeds"}
"""Options that must be given otherwise, and how."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("folder", type=Path, metavar="DIR", help="what `export nuscenes` wrote; it stays as it is")
    add("--policy", type=policy, default="late_fusion", metavar="A(x=1)", help="as in `bench` (default: %(default)s)")
    add("--out", type=Path, required=True, metavar="DIR", help="gets tracking.json and detection.json")
    add_options(parser, "of the environment, beyond the export's, as loss=0.3 or detector=coalign")


def run(options: argparse.Namespace) -> int:
    """Run the command. Return the exit status."""
    from tqdm import tqdm

    from coopsim.data.export.nuscenes_tables.nuscenes_results import TRACKING, read_plan, write_results
    from coopsim.data.export.nuscenes_tables.nuscenes_score import as_table, score_results

    given = named_options(options, _FLAGS)
    plan, _ = read_plan(options.folder)
    with tqdm(total=plan.frames * len(plan.seeds), unit="frame", disable=None, desc=options.policy) as bar:
        write_results(options.folder, options.policy, options.out, progress=bar.update, **given)
    print(as_table(score_results(options.folder, options.out / TRACKING)))
    print(f"written: {options.out}")
    return 0

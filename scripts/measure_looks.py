"""Measure how well YOLOO's looks of points tell objects apart: AUC by LiDAR returns.

    python scripts/measure_looks.py --out results [--weights point_identity] [--seeds 0-5] [--dt 0.1,0.5]
        [--places crossing,urban_grid]

AUC is the share of pairs of sightings in the right order, of one agent within three frames and of two agents at once,
by the LiDAR returns of the sighting that has fewer. No command looks at single sightings; what tracks gain by them is
`coopsim bench`'s. Clips are kept in the folder: the same command goes on where it stopped. Into the folder goes
looks.md.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from tabulate import tabulate

from coopsim.cli.argument_types import names, numbers, seeds
from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.simulated import SimulatedClips
from coopsim.learn.clips.world_recipe import WorldRecipe
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.sightings import ComparedSightings, compare_sightings
from coopsim.learn.tasks.identity_task import PointIdentityTask
from coopsim.learn.weights import digest
from coopsim.metrics.average_precision import separation
from coopsim.nn.detector.decode import GROUPS
from coopsim.support.files import write_whole
from coopsim.support.rng import stream

KINDS = ("within an agent", "across agents")
CLASSES = {"all": range(255), "vehicles": GROUPS[0], "people": GROUPS[2]}
RETURNS = ((5, 10), (10, 20), (20, 50), (50, 100), (100, 10**9), (5, 10**9))


def main() -> None:
    """Measure, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder")
    parser.add_argument("--weights", default="point_identity", help="by name or path")
    parser.add_argument("--seeds", type=seeds, default=tuple(range(6)))
    parser.add_argument("--places", type=names, default=("crossing", "urban_grid"))
    parser.add_argument("--dt", type=numbers, default=(0.1, 0.5), help="times between two frames, s")
    parser.add_argument("--clip-frames", type=int, default=6)
    given = parser.parse_args()
    text = looks(given) + "\n"
    write_whole(given.out / "looks.md", text)
    print(text)


def looks(given: argparse.Namespace) -> str:
    """Return the table, of all clips together."""
    found: dict[str, list[ComparedSightings]] = {kind: [] for kind in KINDS}
    for place in given.places:
        for dt_s in given.dt:
            for seed in given.seeds:
                for kind, each in _compared(place, dt_s, seed, given).items():
                    found[kind].append(each)
    rows = []
    for kind in KINDS:
        similarity, same, label, returns = (
            np.concatenate([getattr(each, name) for each in found[kind]])
            for name in ("similarity", "same", "label", "returns")
        )
        for classes, labels in CLASSES.items():
            cells = []
            for least, most in RETURNS:
                chosen = (returns >= least) & (returns < most) & np.isin(label, [int(each) for each in labels])
                cells.append(_share(separation(similarity[chosen], same[chosen]), int(same[chosen].sum())))
            rows.append([kind, classes, *cells])
    heads = [f"{least} to {most - 1}" if most < 10**9 else f"{least} or more" for least, most in RETURNS]
    text = tabulate(rows, ["pairs", "of", *heads], tablefmt="github", disable_numparse=True)
    return f"{text}\n\nIn brackets: pairs of the same object."


def _compared(place: str, dt_s: float, seed: int, given: argparse.Namespace) -> dict[str, ComparedSightings]:
    """Return pairs of sightings of a clip of a named scenario, and how similar they look; from the folder if known."""
    name = f"{digest(given.weights)[:12]} {place} {dt_s:g} {seed} {given.clip_frames}.npz".replace("/", "_")
    kept = given.out / "looks" / name
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        task = PointIdentityTask(TrainingRecipe("looks", "point_identity", start=given.weights), 0)
        world = WorldRecipe.for_validation(
            environments=(place,), dt_s=(dt_s,), frames=given.clip_frames, allow_test_places=True
        )
        clip = SimulatedClips(world, seed).clip(0)
        arrays: dict[str, Floats] = {}
        for group in task.cut_held_out(clip, stream(0, "looks", place, str(seed))):
            batch = task.collate([group])
            with torch.no_grad():
                vectors = task.net.encoder.eval()(batch.inputs).numpy()
            pairs = batch.seen.within_agents(task.settings.frames), batch.seen.across_agents()
            for kind, mask in zip(KINDS, pairs, strict=True):
                made = compare_sightings(vectors, batch.seen, mask)
                arrays |= {f"{kind} {part}": getattr(made, part) for part in ComparedSightings.__slots__}
        partial = kept.with_suffix(".part.npz")
        np.savez(partial, **arrays)
        partial.replace(kept)
        print(f"looks, {place}, dt {dt_s:g} s, seed {seed}: done", flush=True)
    with np.load(kept) as read:
        return {
            kind: ComparedSightings(*(read[f"{kind} {part}"] for part in ComparedSightings.__slots__))
            for kind in KINDS
            if f"{kind} same" in read
        }


def _share(auc: float, same: int) -> str:
    return "-" if np.isnan(auc) else f"{auc:.3f} ({same})"


if __name__ == "__main__":
    main()

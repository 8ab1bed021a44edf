"""Measure what YOLOO's looks of points are worth: how well they tell objects apart, and what tracking gains by them.

    python scripts/measure_yoloo.py --out results [--weights point_identity] [--only looks,tracks] [--seeds 0-5]
        [--places crossing,urban_grid] [--densities 2,3] [--dt 0.1,0.5] [--frames 60] [--detector pillars]

Looks: the share of pairs of sightings in the right order (AUC), of one agent within three frames and of two agents at
once, by the LiDAR returns of the sighting that has fewer. Tracks: `yoloo` with and without them. Half widths are of 95
% intervals over seeds; differences are paired by seed. Episodes and clips are kept in the folder: the same command goes
on where it stopped. Into the folder goes yoloo.md.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from tabulate import tabulate

import coopsim
from coopsim.bench.results.statistics import Interval, mean_interval
from coopsim.cli.arguments import names, seeds
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
POLICIES = {"with looks": "yoloo(weights='{weights}')", "without": "yoloo(appearance=false)"}
SCORES = ("IDS", "AssA", "IDF1", "HOTA")


def main() -> None:
    """Measure, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder")
    parser.add_argument("--weights", default="point_identity", help="by name or path")
    parser.add_argument("--only", type=names, default=("looks", "tracks"))
    parser.add_argument("--seeds", type=seeds, default=tuple(range(6)))
    parser.add_argument("--places", type=names, default=("crossing", "urban_grid"))
    parser.add_argument("--densities", type=_numbers, default=(2.0, 3.0))
    parser.add_argument("--dt", type=_numbers, default=(0.1, 0.5), help="times between two frames, s")
    parser.add_argument("--frames", type=int, default=60, help="of an episode")
    parser.add_argument("--clip-frames", type=int, default=6)
    parser.add_argument("--detector", default=None, help="another one than the environments' own")
    given = parser.parse_args()
    parts = []
    if "looks" in given.only:
        parts.append("## Same or different: AUC by LiDAR returns\n\n" + _looks(given))
    if "tracks" in given.only:
        parts.append("## Tracks with and without looks\n\n" + _tracks(given))
    text = "\n\n".join(parts) + "\n"
    write_whole(given.out / "yoloo.md", text)
    print(text)


def _looks(given: argparse.Namespace) -> str:
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
    return _table(rows, ["pairs", "of", *heads]) + "\n\nIn brackets: pairs of the same object."


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


def _tracks(given: argparse.Namespace) -> str:
    rows = []
    for place in given.places:
        for density in given.densities:
            for dt_s in given.dt:
                case = f"{place}, density {density:g}, {1 / dt_s:g} Hz"
                episodes = {
                    name: [_episode(policy, place, density, dt_s, seed, given) for seed in given.seeds]
                    for name, policy in POLICIES.items()
                }
                values = {
                    name: np.array([[each[score] for score in SCORES] for each in runs])
                    for name, runs in episodes.items()
                }
                rows += [[case, name, *_cells(each), _counts(episodes[name])] for name, each in values.items()]
                rows.append([case, "gain", *_cells(values["with looks"] - values["without"], sign=True), ""])
                for row in rows[-3:]:
                    print(" | ".join(row), flush=True)
    return _table(rows, ["", "", *SCORES, "pairs by geometry alone"])


def _episode(
    policy: str, place: str, density: float, dt_s: float, seed: int, given: argparse.Namespace
) -> dict[str, float]:
    """Return the scores of an episode, and what the policy counted; from the folder if known."""
    looks = digest(given.weights)[:12] if "weights" in policy else "none"
    name = f"{coopsim.__version__} {looks} {place} {density:g} {dt_s:g} {seed} {given.frames} {given.detector}.json"
    kept = given.out / "tracks" / name.replace("/", "_")
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        options = {} if given.detector is None else {"detector": given.detector}
        made = coopsim.evaluate(
            policy.format(weights=given.weights),
            place,
            seed=seed,
            density=density,
            dt_s=dt_s,
            max_cycles=given.frames,
            **options,
        )
        write_whole(kept, json.dumps({score: float(made.score[score]) for score in SCORES} | dict(made.counts)))
        print(
            f"tracks, {policy.split('(')[0]} {looks}, {place}, {density:g}, {dt_s:g} s, seed {seed}: done", flush=True
        )
    return dict(json.loads(kept.read_text(encoding="utf-8")))


def _cells(values: Floats, *, sign: bool = False) -> list[str]:
    return [_interval(mean_interval(column), sign) for column in values.T]


def _interval(interval: Interval, sign: bool) -> str:
    half = "" if np.isnan(interval.half_width) else f" ± {interval.half_width:.1f}"
    return f"{interval.mean:{'+' if sign else ''}.1f}{half}"


def _share(auc: float, same: int) -> str:
    return "-" if np.isnan(auc) else f"{auc:.3f} ({same})"


def _counts(episodes: Sequence[dict[str, float]]) -> str:
    alone = sum(each.get("pairs compared by geometry alone", 0) for each in episodes)
    both = sum(each.get("pairs compared by looks and geometry", 0) for each in episodes)
    return f"{alone / (alone + both):.1%}" if alone + both else ""


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(map(float, text.split(",")))


def _table(cells: Sequence[Sequence[str]], heads: Sequence[str]) -> str:
    return tabulate(cells, heads, tablefmt="github", disable_numparse=True)


if __name__ == "__main__":
    main()

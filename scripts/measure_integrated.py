"""Measure the counterpart of Table II of the paper on integrated tracking (Hu, Wang and Wang) in the simulator.

    python scripts/measure_integrated.py --out results --weights runs/vic/vic_integrated.safetensors
        [--fusion ff_tracking] [--giou runs/giou/vic_integrated.safetensors] [--frames 40] [--seeds 0-1]

All rows see the same fused maps: --fusion are the weights that the integrated network was trained on, in use tracked by
detection. With --giou, weights whose boxes were taught by GIoU, there is a row more. Axial XIOU is XIOU in which front
and back are alike: the directions of the paper are looked for in it, as its detector knows front from back. Episodes
are kept in the folder: the same command goes on where it stopped. Into the folder goes integrated.md.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from tabulate import tabulate

import coopsim
from coopsim.cli.arguments import names, seeds
from coopsim.learn.weights import digest, read_config
from coopsim.support.files import write_whole

PLACES = ("crossing", "roundabout", "highway")
SCORES = ("AMOTA", "MOTA", "AMOTP", "IDS", "FP", "FN")

PAPER = {
    "by detection, AB3DMOT": (54.75, 222),
    "by detection, axial XIOU, four stages": (55.13, 208),
    "integrated, GIoU, four stages": (56.72, 214),
    "integrated, axial XIOU, one stage": (55.38, 215),
    "integrated, axial XIOU, four stages": (57.23, 206),
}
"""MOTA and IDS of the paper's Table II; where we take GIoU it says IoU, and where we take axial XIOU, XIOU."""

DIRECTIONS = (
    ("integrated for by detection", "by detection, axial XIOU, four stages", "integrated, axial XIOU, four stages"),
    ("four stages for one", "integrated, axial XIOU, one stage", "integrated, axial XIOU, four stages"),
    ("axial XIOU for GIoU", "integrated, GIoU, four stages", "integrated, axial XIOU, four stages"),
)
"""What is compared, without it and with it."""


def main() -> None:
    """Measure, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder")
    parser.add_argument("--weights", default="vic_integrated", help="of the integrated network, by name or path")
    parser.add_argument("--fusion", default="ff_tracking", help="of the cooperative network, by name or path")
    parser.add_argument("--giou", help="of an integrated network taught by GIoU")
    parser.add_argument("--detection-score", type=float, default=0.3, help="m_d of all rows but AB3DMOT's")
    parser.add_argument("--track-score", type=float, default=0.2, help="m_t of these rows")
    parser.add_argument("--frames", type=int, default=40, help="of each place and seed")
    parser.add_argument("--seeds", type=seeds, default=(0, 1))
    parser.add_argument("--latency-s", type=float, default=0.0, help="of all messages; the paper's table has none")
    parser.add_argument("--places", type=names, default=PLACES)
    given = parser.parse_args()
    sure = f"detection_score={given.detection_score:g}, track_score={given.track_score:g}"
    cases = policies(given.weights, given.fusion, given.giou, sure)
    found = {name: [_episode(name, policy, place, seed, given) for place in given.places for seed in given.seeds]
             for name, policy in cases.items()}  # fmt: skip
    text = f"{_scores(found)}\n\n{_directions(found)}\n"
    write_whole(given.out / "integrated.md", text)
    print(text)


def policies(weights: str, fusion: str, giou: str | None, sure: str) -> dict[str, str]:
    """Return the specs of the policies to compare, by what they are.

    Args:
        weights: of the integrated network.
        fusion: of the cooperative network.
        giou: of an integrated network taught by GIoU; None: there is none.
        sure: parameters of the four stages: from which scores on detections and tracks are sure.
    """
    policy = read_config(fusion)["fusion"]
    ours, detector = f"vic_integrated(weights='{weights}'", f"{policy}(weights='{fusion}'"
    stages, axial_stages = (
        f"tracker='vic_fscm_association({sure}, affinity={each})'" for each in ("xiou", "axial_xiou")
    )
    cases = {
        "by detection, AB3DMOT": f"{detector})",
        "by detection, XIOU, four stages": f"{detector}, {stages})",
        "by detection, axial XIOU, four stages": f"{detector}, {axial_stages})",
        "detection branch, axial XIOU, four stages": f"{ours}, {axial_stages})",
        "integrated, GIoU, four stages": f"{ours}, {sure}, affinity=giou)",
        "integrated, XIOU, four stages": f"{ours}, {sure}, affinity=xiou)",
        "integrated, axial XIOU, one stage": f"{ours}, {sure}, stages=1)",
        "integrated, axial XIOU, four stages": f"{ours}, {sure})",
    }
    if giou is not None:
        cases["taught by GIoU, GIoU, four stages"] = f"vic_integrated(weights='{giou}', {sure}, affinity=giou)"
    return cases


def _episode(name: str, policy: str, place: str, seed: int, given: argparse.Namespace) -> dict[str, float]:
    """Return the scores of an episode, from the folder if they are there."""
    used = [each for each in (given.weights, given.fusion, given.giou) if each and each in policy]
    networks = "-".join(digest(each)[:8] for each in used)
    key = f"{coopsim.__version__} {name} {place} {seed} {given.frames} {given.latency_s:g} "
    key += f"{given.detection_score:g} {given.track_score:g} {networks}"
    kept = given.out / "episodes" / f"{key}.json"
    if not kept.exists():
        made = coopsim.evaluate(
            policy, place, seed=seed, max_cycles=given.frames, connected_cars=3, rsus=1, latency_s=given.latency_s
        )
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_whole(kept, json.dumps({each: float(made.score[each]) for each in SCORES}))
        print(f"{name}: {place}, seed {seed}: done", flush=True)
    return dict(json.loads(kept.read_text(encoding="utf-8")))


def _scores(found: Mapping[str, Sequence[Mapping[str, float]]]) -> str:
    """Return the table of mean scores, with the paper's beside them."""
    rows = []
    for name, episodes in found.items():
        mota, switches = PAPER.get(name, ("-", "-"))
        rows.append([name, *(f"{np.mean([each[score] for each in episodes]):.1f}" for score in SCORES), mota, switches])
    return tabulate(rows, ("", *SCORES, "paper: MOTA", "paper: IDS"), tablefmt="github", disable_numparse=True)


def _directions(found: Mapping[str, Sequence[Mapping[str, float]]]) -> str:
    """Return the table of differences by episode, mean and standard error, and whether they go the paper's way."""
    rows = []
    for title, without, with_it in DIRECTIONS:
        for score, number in (("MOTA", 0), ("IDS", 1)):
            apart = [b[score] - a[score] for a, b in zip(found[without], found[with_it], strict=True)]
            paper = PAPER[with_it][number] - PAPER[without][number]
            error = float(np.std(apart, ddof=1)) / len(apart) ** 0.5 if len(apart) > 1 else float("nan")
            ours = float(np.mean(apart))
            agrees = "as the paper" if ours * paper > 0 else "against it" if ours * paper < 0 else "no difference"
            rows.append([title, score, f"{ours:+.2f} ± {error:.2f}", f"{paper:+.2f}", agrees])
    return tabulate(rows, ("", "score", "here", "paper", "direction"), tablefmt="github", disable_numparse=True)


if __name__ == "__main__":
    main()

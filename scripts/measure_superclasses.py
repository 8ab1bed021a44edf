"""Measure tracks by superclass: Tables III and V of DINO-CoDT (He et al., 2025), and its ablation of re-identification.

    python scripts/measure_superclasses.py dino_codt --out results --places crossing,urban_grid,highway --frames 30
    python scripts/measure_superclasses.py reid --out results --dt 0.2 --seeds 0-5

`coopsim bench` keeps no scores of superclasses, and no detector of the library knows who is who, as the ceiling's does.
Brackets hold half of Student's 95 % interval, and round ones the mean difference to the first row. Episodes are kept in
the folder: the same command goes on where it stopped. The table goes to STUDY.md.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from tabulate import tabulate

import coopsim
from coopsim.bench.grid.cell import Cell, Condition
from coopsim.bench.results.statistics import mean_interval
from coopsim.bench.store.fingerprint import fingerprint, key_of
from coopsim.catalog import PolicySpec
from coopsim.cli.argument_types import names, seeds
from coopsim.detection.oracle import Oracle, OracleDetector
from coopsim.detection.presets import DEFAULT_DETECTOR, make_detector
from coopsim.support.files import write_whole
from coopsim.support.rng import stream
from coopsim.types import AgentSpec, Detections, SensorView

METRICS = ("sAMOTA", "AMOTA", "AMOTP", "MOTA", "IDS", "IDF1", "AssA")
_DIM, _NOISE, _NEAR_M = 64, 0.1, 2.5


class KnownIdentities(OracleDetector):
    """The usual detector, whose boxes have vectors that differ by object: the truth, and noise a tenth as long.

    A box belongs to the nearest object, or else to none, and looks like nothing else.

    Args:
        detector: detector of the boxes; None: the environments' own.
        seed: seed of the noise.
    """

    embedding_dim = _DIM

    def __init__(self, detector: OracleDetector | None = None, seed: int = 0) -> None:
        usual: Any = detector or make_detector(DEFAULT_DETECTOR)
        self._detector, self._rng = usual, stream(seed, "known identities")
        self.states_covariance, self._known = usual.states_covariance, dict[int, Any]()

    def begin(self, specs: Mapping[str, AgentSpec], seed: int) -> Self:
        return type(self)(self._detector.begin(specs, seed), seed)

    def detect(self, view: SensorView, oracle: Oracle, rng: np.random.Generator) -> Detections:
        return self.detect_all({view.agent: view}, {view.agent: oracle}, {view.agent: rng})[view.agent]

    def detect_all(
        self, views: Mapping[str, SensorView], oracles: Mapping[str, Oracle], rngs: Mapping[str, np.random.Generator]
    ) -> dict[str, Detections]:
        found = self._detector.detect_all(views, oracles, rngs)
        return {agent: replace(each, embedding=self._looks(each, oracles[agent])) for agent, each in found.items()}

    def _looks(self, found: Detections, oracle: Oracle) -> np.ndarray:
        looks = self._rng.normal(size=(len(found), _DIM)) / np.sqrt(_DIM)
        actors = oracle.actors
        if len(actors) and len(found):
            away_m = np.linalg.norm(found.boxes.center[:, None, :2] - actors.boxes.center[None, :, :2], axis=-1)
            for row in np.flatnonzero(away_m.min(axis=1) < _NEAR_M):
                identity = int(actors.id[away_m[row].argmin()])
                if identity not in self._known:
                    self._known[identity] = stream(0, "looks of", str(identity)).normal(size=_DIM) / np.sqrt(_DIM)
                looks[row] = self._known[identity] + _NOISE * looks[row]
        return looks


@dataclass(frozen=True)
class Study:
    """A table of a page.

    Attributes:
        policies: policies by title; the others are compared with the first.
        superclasses: superclasses of the tables.
        places: named environments.
        pooled: True for one table of all places together.
        frames: frames of an episode.
        options: options of the environments.
        ceiling: titles that see with `KnownIdentities`.
    """

    policies: Mapping[str, str]
    superclasses: tuple[str, ...]
    places: tuple[str, ...]
    pooled: bool
    frames: int
    options: Mapping[str, Any]
    ceiling: Sequence[str] = field(default_factory=tuple)


_BY_SPEED = "age_per_m_s=1.1"  # frames of age more per m/s: the paper finds 1.0 to 1.2 best
_BOXES, _AGED = "dino_codt_tracking(age_per_m_s=0)", f"dino_codt_tracking({_BY_SPEED})"
_LOOKS = "embedder='{embedder}', similarity={similarity}, cross_similarity={similarity}"
STUDIES = {
    "dino_codt": Study(
        {
            "F-Cooper": "fcooper",
            "AttFuse": "attfuse",
            "V2X-ViT": "v2x_vit",
            "GSAF, AB3DMOT": "gsaf",
            "DINO-CoDT": "dino_codt",
            "V2X-ViT, rules by class and age by speed": f"v2x_vit(tracker='{_AGED}')",
            "all": f"dino_codt(tracker='{_AGED}')",
        },
        ("Vehicle", "Pedestrian", "Truck"),
        ("crossing", "urban_grid", "t_junction", "highway", "merge", "roundabout", "parking_street",
         "occluded_crossing", "platoon"),
        pooled=True,
        frames=60,
        options={"connected_cars": 3, "rsus": 1},
    ),
    "reid": Study(
        {
            "boxes": _BOXES,
            "+ Re-ID": f"dino_codt_tracking(age_per_m_s=0, {_LOOKS})",
            "+ VATM": _AGED,
            "+ both": f"dino_codt_tracking({_BY_SPEED}, {_LOOKS})",
            "ceiling of Re-ID": _BOXES,
            "ceiling of both": _AGED,
        },
        ("Vehicle", "Pedestrian"),
        ("crossing", "occluded_crossing"),
        pooled=False,
        frames=40,
        options={"density": 2.0, "lidar": None},
        ceiling=("ceiling of Re-ID", "ceiling of both"),
    ),
}  # fmt: skip


def main() -> None:
    """Measure, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=tuple(STUDIES))
    parser.add_argument("--out", type=Path, required=True, help="folder")
    parser.add_argument("--frames", type=int, help="of each place and seed")
    parser.add_argument("--seeds", type=seeds, default=(0,))
    parser.add_argument("--places", type=names)
    parser.add_argument("--rows", type=names, help="titles")
    parser.add_argument("--dt", type=float, default=0.1, help="seconds between two frames")
    parser.add_argument("--embedder", default="picture_identity", help="as picture_identity(weights=PATH)")
    parser.add_argument("--similarity", type=float, default=0.9)
    given = parser.parse_args()
    study = STUDIES[given.study]
    places = given.places or study.places
    policies = {
        title: policy.format(embedder=given.embedder, similarity=given.similarity)
        for title, policy in study.policies.items()
        if given.rows is None or title in given.rows
    }
    found = {
        (title, place, seed): episode(study, title, policy, place, seed, given)
        for seed in given.seeds
        for place in places
        for title, policy in policies.items()
    }
    groups = [places] if study.pooled else [(place,) for place in places]
    text = "\n\n".join(
        f"## {', '.join(group)}: {name.lower()}s\n\n{table(list(policies), group, name, found)}"
        for group in groups
        for name in study.superclasses
    )
    write_whole(given.out / f"{given.study}.md", text + "\n")
    print(text)


def episode(
    study: Study, title: str, policy: str, place: str, seed: int, given: argparse.Namespace
) -> dict[str, dict[str, float]]:
    """Return the metrics by superclass, and what the policy counted; run the episode unless it is kept."""
    options = {**study.options, "dt_s": given.dt}
    spec, ceiling = PolicySpec.parse(policy), title in study.ceiling
    cell = Cell(spec.text, Condition(place), seed, given.frames or study.frames)
    kept = given.out / "episodes" / f"{key_of(fingerprint(cell, {**options, 'ceiling': ceiling}, spec))}.json"
    if not kept.exists():
        detector = {"detector": KnownIdentities()} if ceiling else {}
        made = coopsim.evaluate(spec.make(), place, seed=seed, max_cycles=cell.frames, **options, **detector)
        parts = made.score.superclasses
        scores = {name: {each: score.values[each] for each in METRICS} for name, score in parts.items()}
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_whole(kept, json.dumps({**scores, "counts": dict(made.counts)}))
        print(f"{title}, {place}, seed {seed}: done", flush=True)
    return dict(json.loads(kept.read_text(encoding="utf-8")))


def table(
    titles: Sequence[str], places: Sequence[str], superclass: str, found: Mapping[tuple[str, str, int], Any]
) -> str:
    """Return means with intervals and the differences to the first row, over episodes with such objects."""
    rows = []
    for title in titles:
        mine = {key[1:]: each for key, each in found.items() if key[0] == title and key[1] in places}
        values = {key: each[superclass] for key, each in mine.items() if superclass in each}
        plain = {key: found[titles[0], *key].get(superclass) for key in values}
        cells = []
        for metric in METRICS:
            mean = mean_interval(np.array([each[metric] for each in values.values()]))
            gained = [each[metric] - before[metric] for key, each in values.items() if (before := plain[key])]
            half = "" if np.isnan(mean.half_width) else f" ± {mean.half_width:.1f}"
            less = f" ({np.mean(gained):+.1f})" if gained and title != titles[0] else ""
            cells.append(f"{mean.mean:.1f}{half}{less}")
        counts = [item for each in mine.values() for item in each["counts"].items()]
        looked = sum(count for name, count in counts if "embedding" in name)
        rows.append([title, *cells, f"{looked / max(sum(count for _, count in counts), 1):.0%}"])
    return tabulate(rows, ("", *METRICS, "boxes with embeddings"), tablefmt="github", disable_numparse=True)


if __name__ == "__main__":
    main()

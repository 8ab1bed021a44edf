"""Measure what re-identification by pictures and ages by speed bring: the ablation of DINO-CoDT (He et al., 2025).

    python scripts/measure_reid.py --out results [--embedder "picture_identity(weights=PATH)"] [--similarity 0.8]
        [--seeds 0-5] [--frames 100] [--density 2] [--minutes 25]

The rows are the paper's: boxes alone, with Re-ID, with ages by speed (VATM), with both; vehicles and people apart, in
crowded places. Beside them is the ceiling: embeddings that know who is who but for a little noise. All rows have the
same detections. Episodes are kept in the folder: the same command goes on where it stopped. Into the folder goes
reid.md.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from tabulate import tabulate

import coopsim
from coopsim.bench.results.statistics import mean_interval
from coopsim.cli.arguments import names, seeds
from coopsim.config.spec import parse_spec, spell_spec
from coopsim.detection.oracle import Oracle, OracleDetector
from coopsim.detection.presets import DEFAULT_DETECTOR, make_detector
from coopsim.learn.weights import digest
from coopsim.support.files import write_whole
from coopsim.support.rng import stream
from coopsim.types import AgentSpec, Detections, SensorView

PLACES = ("crossing", "occluded_crossing")
METRICS = ("IDS", "IDF1", "AssA", "sAMOTA", "MOTA")
SUPERCLASSES = ("Vehicle", "Pedestrian")
ALPHA = 1.1
"""Frames of age more per m/s: the paper finds 1.0 to 1.2 best."""

_DIM, _NOISE, _NEAR_M = 64, 0.1, 2.5


@dataclass(frozen=True)
class Row:
    """A row of the ablation.

    Attributes:
        looks: "none"; "pictures": an embedder's; "known": of the truth, but for noise.
        vatm: tracks of fast objects are kept longer.
    """

    looks: str
    vatm: bool


ROWS = {
    "boxes": Row("none", vatm=False),
    "+ Re-ID": Row("pictures", vatm=False),
    "+ VATM": Row("none", vatm=True),
    "+ both": Row("pictures", vatm=True),
    "ceiling of Re-ID": Row("known", vatm=False),
    "ceiling of both": Row("known", vatm=True),
}


class KnownIdentities(OracleDetector):
    """The usual detector, whose boxes have vectors that differ by object: the truth, and noise a tenth as long.

    A box belongs to the nearest object, or else to none, and looks like nothing else.

    Args:
        detector: gives the boxes.
        seed: of the noise.
    """

    embedding_dim = _DIM

    def __init__(self, detector: OracleDetector, seed: int = 0) -> None:
        self._detector, self._rng = detector, stream(seed, "known identities")
        self.states_covariance, self._known = detector.states_covariance, dict[int, Any]()

    def begin(self, specs: Mapping[str, AgentSpec], seed: int) -> Self:
        begun: Any = self._detector.begin(specs, seed)
        return type(self)(begun, seed)

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


def main() -> None:
    """Measure what there is time for, and write what is finished."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder")
    parser.add_argument("--embedder", default="picture_identity", help="of the rows with pictures")
    parser.add_argument("--similarity", type=float, default=0.9, help="from which the embedder's vectors are alike")
    parser.add_argument("--seeds", type=seeds, default=tuple(range(6)))
    parser.add_argument("--frames", type=int, default=100, help="of each place and seed")
    parser.add_argument("--places", type=names, default=PLACES)
    parser.add_argument("--rows", type=names, default=tuple(ROWS), help=", ".join(ROWS))
    parser.add_argument("--density", type=float, default=2.0, help="factor on the numbers of vehicles and people")
    parser.add_argument("--dt", type=float, default=0.1, help="seconds between two frames")
    parser.add_argument("--minutes", type=float, default=25.0)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    ends = time.monotonic() + 60 * given.minutes
    measured: dict[tuple[str, str, int], dict[str, Any]] = {}
    for seed in given.seeds:  # a seed of all rows before the next: intervals become shorter as it goes
        for place in given.places:
            for title in given.rows:
                if time.monotonic() < ends or _kept(title, place, seed, given).exists():
                    measured[title, place, seed] = episode(title, place, seed, given)
    text = "\n\n".join(table(place, superclass, measured) for place in given.places for superclass in SUPERCLASSES)
    write_whole(given.out / "reid.md", text + "\n")
    print(text)


def episode(title: str, place: str, seed: int, given: argparse.Namespace) -> dict[str, Any]:
    """Return the metrics by superclass, and what was counted; run the episode unless it is kept."""
    kept = _kept(title, place, seed, given)
    if not kept.exists():
        policy, options = _policy(ROWS[title], given), _options(ROWS[title], given)
        began = time.monotonic()
        made = coopsim.evaluate(policy, place, seed=seed, **options)
        parts = {
            name: {each: score.values[each] for each in METRICS} for name, score in made.score.superclasses.items()
        }
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_whole(kept, json.dumps({"scores": parts, "counts": dict(made.counts)}))
        ids = {name: round(values["IDS"], 1) for name, values in parts.items()}
        print(f"{title}, {place}, seed {seed}: IDS {ids}, {time.monotonic() - began:.0f} s", flush=True)
    return dict(json.loads(kept.read_text(encoding="utf-8")))


def table(place: str, superclass: str, measured: Mapping[tuple[str, str, int], Mapping[str, Any]]) -> str:
    """Return means over seeds with 95 % intervals, and the mean difference to boxes alone, of one place."""
    lines = []
    for title in ROWS:
        mine = {seed: each for (row, where, seed), each in measured.items() if (row, where) == (title, place)}
        known = {seed: each["scores"][superclass] for seed, each in mine.items() if superclass in each["scores"]}
        if not known:
            continue
        cells = []
        for metric in METRICS:
            values = np.array([each[metric] for each in known.values()])
            found = mean_interval(values)
            plain = {seed: measured.get(("boxes", place, seed), {"scores": {}}) for seed in known}
            gained = [
                known[seed][metric] - each["scores"][superclass][metric]
                for seed, each in plain.items()
                if superclass in each["scores"]
            ]
            less = f" ({np.mean(gained):+.1f})" if gained and title != "boxes" else ""
            ends = "" if np.isnan(found.low) else f" [{found.low:.1f}, {found.high:.1f}]"
            cells.append(f"{found.mean:.1f}{ends}{less}")
        looked = [sum(n for name, n in each["counts"].items() if "embedding" in name) for each in mine.values()]
        all_boxes = [sum(each["counts"].values()) for each in mine.values()]
        lines.append([title, len(known), *cells, f"{100 * sum(looked) / max(sum(all_boxes), 1):.0f} %"])
    heads = ("", "seeds", *METRICS, "boxes with embeddings")
    return f"## {place}, {superclass.lower()}s\n\n" + tabulate(lines, heads, tablefmt="github", disable_numparse=True)


def _policy(row: Row, given: argparse.Namespace) -> str:
    parameters: dict[str, Any] = {"age_per_m_s": ALPHA if row.vatm else 0}
    if row.looks == "pictures":
        parameters |= {
            "embedder": given.embedder,
            "similarity": given.similarity,
            "cross_similarity": given.similarity,
        }
    return spell_spec("dino_codt_tracking", parameters)


def _options(row: Row, given: argparse.Namespace) -> dict[str, Any]:
    options = {"max_cycles": given.frames, "density": given.density, "dt_s": given.dt, "lidar": None}
    if row.looks == "known":
        usual = make_detector(DEFAULT_DETECTOR)
        assert isinstance(usual, OracleDetector)
        options["detector"] = KnownIdentities(usual)
    return options


def _kept(title: str, place: str, seed: int, given: argparse.Namespace) -> Path:
    """Return the file of an episode; its name tells all that decides it."""
    row = ROWS[title]
    looks = _looks(given) if row.looks == "pictures" else row.looks
    said = f"{place} seed {seed} {given.frames} x {given.dt} s density {given.density} {looks} vatm {row.vatm}"
    return Path(given.out, "episodes", f"{coopsim.__version__} {said}.json".replace("/", "_"))


def _looks(given: argparse.Namespace) -> str:
    name, parameters = parse_spec("embedder", given.embedder)
    if name == "picture_identity":
        name = f"{name} {digest(parameters.get('weights', name))[:12]}"
        parameters = {key: value for key, value in parameters.items() if key != "weights"}
    return f"{spell_spec(name, parameters)} {given.similarity}"


if __name__ == "__main__":
    main()

"""`coopsim`: what this project's own tables mean by average precision.

| question | answer |
|---|---|
| truth | objects that any agent's LiDAR has a return from, centre in the evaluation region |
| detections | all, whatever their score, centre in the region |
| match | by falling score, each to the free object of its kind of largest IoU (BEV or 3D), from 0.3, 0.5, 0.7 |
| left out | detections on an object that does not count (3D IoU 0.25, more than on one that does), as in the scores |
| rank | all frames together; equal scores are one step of the curve; area of all points |
| kinds | vehicles (car, van, truck, bus) as one; `people` (pedestrian, child) |
| | `riders` (motorcycle, bicycle, scooter); `vulnerable` (people and riders as one); each class by itself |
| `own`, `others_only` | vehicles that the receiver has returns from, or only others |
| bands | vehicles by distance of their centre over ground: `0-30m`, `30-50m`, `50-100m` |

Of a part of the vehicles: they are matched among all vehicles; detections on the others are left out, and detections
on nothing all count against the part, or in a band those within it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from coopsim.bench.detect.protocols.protocol import PEOPLE, PROTOCOLS, RIDERS, VEHICLES, Protocol, among, ranked
from coopsim.bench.detect.ranking.overlaps import Overlaps
from coopsim.bench.detect.ranking.ranking import Ranking
from coopsim.geometry.se3 import Floats
from coopsim.metrics.average_precision import AP_THRESHOLDS
from coopsim.types import Ints, Mask, ObjectClass

BANDS_M = ((0.0, 30.0), (30.0, 50.0), (50.0, 100.0))

_IGNORED_IOU = 0.25
_KINDS: dict[str, tuple[ObjectClass, ...]] = {
    "": VEHICLES,
    " people": PEOPLE,
    " riders": RIDERS,
    " vulnerable": (*PEOPLE, *RIDERS),
    **{f" {each.title}": (each,) for each in ObjectClass},
}
_SEEN_BY = {" own": 0, " others_only": 1}


@PROTOCOLS.register("coopsim")
class CoopsimProtocol(Protocol):
    """Average precision, recall and false boxes as in coopsim's tables."""

    def rankings(self, overlaps: Overlaps) -> dict[str, Ranking]:
        """Match one episode; see the module's table."""
        made: dict[str, Ranking] = {}
        for kind, classes in _KINDS.items():
            found, truth = _of_kind(overlaps, classes)
            for view in ("BEV", "3D"):
                for least in AP_THRESHOLDS:
                    object_of = overlaps.matched_by_score(found, truth, view, least, listed=False)
                    name = f"AP{view}@{least:g}"
                    made[name + kind] = ranked(overlaps, object_of, found, int(truth.sum()))
                    if not kind:
                        parts = _parts(overlaps, object_of, found, truth)
                        made |= {name + part: ranking for part, ranking in parts.items()}
        return made

    def values(self, rankings: Mapping[str, Ranking]) -> dict[str, float]:
        """Return the areas, and recall and false boxes of detections above score 0.3 at BEV IoU 0.5 (people 0.3)."""
        areas = {name: ranking.area() for name, ranking in rankings.items()}
        return {
            **areas,
            **{f"recall{part}": rankings[f"APBEV@0.5{part}"].recall() for part in ("", *_SEEN_BY)},
            "recall people": rankings["APBEV@0.3 people"].recall(),
            "false_per_frame": rankings["APBEV@0.5"].false_per_frame(),
            "false_per_frame people": rankings["APBEV@0.3 people"].false_per_frame(),
        }


def _of_kind(overlaps: Overlaps, classes: tuple[ObjectClass, ...]) -> tuple[Mask, Mask]:
    """Return the masks of the detections (N,) and objects (M,) of some classes that count."""
    there = overlaps.perceived
    of_kind = among(there.true_label, classes)
    truth = of_kind & there.true_counts
    ignored = overlaps.best_on(of_kind & ~there.true_counts, "3D")
    on_ignored = (ignored >= _IGNORED_IOU) & (ignored > overlaps.best_on(truth, "3D"))
    return among(there.found_label, classes) & there.found_in_region & ~on_ignored, truth


def _parts(overlaps: Overlaps, object_of: Ints, found: Mask, truth: Mask) -> dict[str, Ranking]:
    """Return the rankings of parts of the vehicles, by the end of their metrics' names."""
    there, hit = overlaps.perceived, object_of >= 0
    away_m, found_away_m = _away_m(there.true_box), _away_m(there.found_box)
    parts = {part: (there.true_seen_by == number, np.ones(len(hit), np.bool_)) for part, number in _SEEN_BY.items()}
    for near_m, far_m in BANDS_M:
        within = (away_m >= near_m) & (away_m < far_m)
        parts[f" {near_m:g}-{far_m:g}m"] = within, (found_away_m >= near_m) & (found_away_m < far_m)
    made = {}
    for name, (of_part, against) in parts.items():
        on_part = hit & of_part[object_of] if len(of_part) else hit
        kept = found & (on_part | (~hit & against))
        made[name] = ranked(overlaps, object_of, kept, int((truth & of_part).sum()))
    return made


def _away_m(boxes: Floats) -> Floats:
    distance: Floats = np.hypot(boxes[:, 0], boxes[:, 1])
    return distance

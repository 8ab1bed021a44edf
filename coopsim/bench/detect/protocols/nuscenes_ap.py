"""`nuscenes`: as the nuScenes detection task (Caesar et al., CVPR 2020, sec. 3.1, and its development kit).

| question | answer |
|---|---|
| kinds | each class by itself |
| truth | with at least one return (here of some agent), within the class's range: vehicles 50 m, others 40 m |
| detections | any score, within the range of their class |
| match | by falling score, each to the nearest free object of the class, centres less than 0.5, 1, 2, 4 m apart |
| rank | all frames together |
| area | mean of max(precision - 0.1, 0) / 0.9 at recalls 0.11, 0.12, ... 1, interpolated, not raised to later values |
| mean | over the four distances, and over the classes that have objects: `mAP` |

The classes are ours: van, scooter and child are none of nuScenes', whose trailers, cones, ... we lack. `APBEV@0.5` is
not part of it: it is coopsim's, so that rows of all protocols have one number in common.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from coopsim.bench.detect.protocols.coopsim_ap import CoopsimProtocol
from coopsim.bench.detect.protocols.protocol import PROTOCOLS, VEHICLES, Protocol, ranked
from coopsim.bench.detect.ranking.overlaps import Overlaps
from coopsim.bench.detect.ranking.ranking import Ranking
from coopsim.geometry.se3 import Floats
from coopsim.types import Mask, ObjectClass

DISTANCES_M = (0.5, 1.0, 2.0, 4.0)
_COMMON = "APBEV@0.5"


@PROTOCOLS.register("nuscenes")
class NuscenesProtocol(Protocol):
    """The detection task's average precision by distance of centres."""

    def rankings(self, overlaps: Overlaps) -> dict[str, Ranking]:
        """Match one episode; see the module's table."""
        there, made = overlaps.perceived, {_COMMON: CoopsimProtocol().rankings(overlaps)[_COMMON]}
        for kind in ObjectClass:
            range_m = 50.0 if kind in VEHICLES else 40.0
            truth = (there.true_label == kind) & there.true_counts & _within(there.true_box, range_m)
            found = (there.found_label == kind) & there.found_in_region & _within(there.found_box, range_m)
            for far_m in DISTANCES_M:
                nearer_m = np.nextafter(far_m, 0.0)  # the distance itself is too far
                object_of = overlaps.matched_by_score(found, truth, "distance", -nearer_m)
                made[f"AP@{far_m:g}m {kind.title}"] = ranked(overlaps, object_of, found, int(truth.sum()))
        return made

    def values(self, rankings: Mapping[str, Ranking]) -> dict[str, float]:
        """Return the area of each class and distance, their means over classes and over distances, and `mAP`."""
        areas = {name: ranking.area_of_101_points() for name, ranking in rankings.items() if name != _COMMON}
        by_class = {kind.title: [areas[f"AP@{far_m:g}m {kind.title}"] for far_m in DISTANCES_M] for kind in ObjectClass}
        return {
            "mAP": _mean([_mean(values) for values in by_class.values()]),
            **{f"AP {kind}": _mean(values) for kind, values in by_class.items()},
            **{f"mAP@{far_m:g}m": _mean([row[k] for row in by_class.values()]) for k, far_m in enumerate(DISTANCES_M)},
            **areas,
            _COMMON: rankings[_COMMON].area(),
        }


def _within(boxes: Floats, range_m: float) -> Mask:
    within: Mask = np.hypot(boxes[:, 0], boxes[:, 1]) < range_m
    return within


def _mean(values: list[float]) -> float:
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else float("nan")

"""`v2x-real`: as V2X-Real (Xiang et al., ECCV 2024), whose nine classes ours are, in three superclasses.

| question | answer |
|---|---|
| kinds | Vehicle (car); Truck (van, truck, bus); Pedestrian (people and riders): `coopsim.types.taxonomy.Superclass` |
| truth, detections | seen by some agent; corners within x +-100 m, y +-40 m; score above 0.2 |
| match, rank, area | OpenCOOD's, BEV IoU from 0.3 and 0.5: see `coopsim.bench.detect.protocols.opencood_ap` |
| mean | over the superclasses that have objects: `mAPBEV@0.5` |

`APBEV@0.5` without a suffix is of Vehicle and Truck as one class.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from coopsim.bench.detect.protocols.opencood_ap import LEAST_SCORE, corners_within
from coopsim.bench.detect.protocols.protocol import PROTOCOLS, VEHICLES, AreaProtocol, among, ranked
from coopsim.bench.detect.ranking.overlaps import Overlaps
from coopsim.bench.detect.ranking.ranking import Ranking
from coopsim.types.taxonomy import Superclass

REGION_M = (100.0, 40.0)
THRESHOLDS = (0.3, 0.5)
_KINDS = {"": VEHICLES, **{f" {each.title}": each.classes for each in Superclass}}


@PROTOCOLS.register("v2x-real")
class V2xRealProtocol(AreaProtocol):
    """V2X-Real's average precision of superclasses."""

    _area = "area_by_frame"
    ranks_frames_together = False

    def rankings(self, overlaps: Overlaps) -> dict[str, Ranking]:
        """Match one episode; see the module's table."""
        there, made = overlaps.perceived, {}
        countable = there.true_counts & corners_within(there.true_box, REGION_M)
        believed = (there.found_score > LEAST_SCORE) & there.found_in_region & corners_within(there.found_box, REGION_M)
        for kind, classes in _KINDS.items():
            truth, found = countable & among(there.true_label, classes), believed & among(there.found_label, classes)
            for least in THRESHOLDS:
                object_of = overlaps.matched_by_score(found, truth, "BEV", least)
                made[f"APBEV@{least:g}{kind}"] = ranked(overlaps, object_of, found, int(truth.sum()))
        return made

    def values(self, rankings: Mapping[str, Ranking]) -> dict[str, float]:
        """Return the areas, and their means over the superclasses."""
        areas = super().values(rankings)
        means = {}
        for least in THRESHOLDS:
            values = [areas[f"APBEV@{least:g} {each.title}"] for each in Superclass]
            known = [value for value in values if not np.isnan(value)]
            means[f"mAPBEV@{least:g}"] = float(np.mean(known)) if known else float("nan")
        return {**areas, **means}

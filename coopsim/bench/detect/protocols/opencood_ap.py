"""`opencood`: as OpenCOOD and what derives from it (V2X-ViT, V2V4Real, CoBEVT, Where2comm) evaluate OPV2V and V2XSet.

| question | answer |
|---|---|
| truth | vehicles as one class, all corners within x +-140 m, y +-40 m; here also in the evaluation region, |
| | whose default of +-100 m is narrower, and seen by some agent (OPV2V lists what lies within 70 m of one) |
| detections | score above 0.2, corners as above |
| match | in each frame by falling score, each to the free object of largest BEV IoU, from 0.3, 0.5, 0.7 |
| rank | within each frame; frames one after another, as `--global_sort_detections` is off by default |
| equal scores | in the order of the list, each a step of the curve, as OpenCOOD's code takes them |
| area | all points, each precision raised to the best beyond it (PASCAL VOC 2010) |

The rank makes all values lower than a common one: false boxes of early frames stand before hits of later frames
(OpenCOOD issues 101 and 104). CoAlign's and HEAL's tables rank all frames together: see `coopsim`.
"""

from __future__ import annotations

import numpy as np

from coopsim.bench.detect.protocols.protocol import PROTOCOLS, VEHICLES, AreaProtocol, among, ranked
from coopsim.bench.detect.ranking.overlaps import Overlaps
from coopsim.bench.detect.ranking.ranking import Ranking
from coopsim.geometry.se3 import Floats
from coopsim.metrics.average_precision import AP_THRESHOLDS
from coopsim.types import Mask

LEAST_SCORE = 0.2
REGION_M = (140.0, 40.0)


@PROTOCOLS.register("opencood")
class OpencoodProtocol(AreaProtocol):
    """OpenCOOD's average precision of vehicles in the bird's-eye view."""

    _area = "area_by_frame"
    ranks_frames_together = False

    def rankings(self, overlaps: Overlaps) -> dict[str, Ranking]:
        """Match one episode; see the module's table."""
        there = overlaps.perceived
        truth = among(there.true_label, VEHICLES) & there.true_counts & corners_within(there.true_box, REGION_M)
        found = among(there.found_label, VEHICLES) & (there.found_score > LEAST_SCORE) & there.found_in_region
        found &= corners_within(there.found_box, REGION_M)
        return {
            f"APBEV@{least:g}": ranked(
                overlaps, overlaps.matched_by_score(found, truth, "BEV", least), found, int(truth.sum())
            )
            for least in AP_THRESHOLDS
        }


def corners_within(boxes: Floats, region_m: tuple[float, float]) -> Mask:
    """Return the mask (N,) of boxes (N, 7) whose corners all lie within a half length and width of a region, m."""
    cos, sin = np.abs(np.cos(boxes[:, 6])), np.abs(np.sin(boxes[:, 6]))
    reach_x = (boxes[:, 3] * cos + boxes[:, 4] * sin) / 2
    reach_y = (boxes[:, 3] * sin + boxes[:, 4] * cos) / 2
    within: Mask = (np.abs(boxes[:, 0]) + reach_x <= region_m[0]) & (np.abs(boxes[:, 1]) + reach_y <= region_m[1])
    return within

"""`dair`: as OpenDAIRV2X evaluates DAIR-V2X (Yu et al., CVPR 2022).

| question | answer |
|---|---|
| kinds | car (car, van, truck and bus as one) from IoU 0.3, 0.5, 0.7; cyclist and pedestrian from 0.25, 0.5 |
| truth, detections | those of coopsim: seen by some agent, in the region; detections of any score |
| match | objects in the order of the file, each the free detection of largest IoU (3D or BEV), whatever the score |
| rank | all frames together; area of all points, each precision raised to the best beyond it |
| quirk | the sum begins at the second detection: a hit at the very first adds nothing; at best 1 - 1 / objects |

DAIR-V2X's own region is x 0 to 100 m of the vehicle; here it is the environment's. The metrics of cars have no suffix.
"""

from __future__ import annotations

from coopsim.bench.detect.protocols.protocol import PEOPLE, PROTOCOLS, RIDERS, VEHICLES, AreaProtocol, among, ranked
from coopsim.bench.detect.ranking.overlaps import Overlaps
from coopsim.bench.detect.ranking.ranking import Ranking

_KINDS = {
    "": (VEHICLES, (0.3, 0.5, 0.7)),
    " pedestrian": (PEOPLE, (0.25, 0.5)),
    " cyclist": (RIDERS, (0.25, 0.5)),
}


@PROTOCOLS.register("dair")
class DairProtocol(AreaProtocol):
    """DAIR-V2X's average precision, in 3D and in the bird's-eye view."""

    _area = "area_without_first_step"

    def rankings(self, overlaps: Overlaps) -> dict[str, Ranking]:
        """Match one episode; see the module's table."""
        there, made = overlaps.perceived, {}
        for kind, (classes, thresholds) in _KINDS.items():
            truth = among(there.true_label, classes) & there.true_counts
            found = among(there.found_label, classes) & there.found_in_region
            for view in ("BEV", "3D"):
                for least in thresholds:
                    object_of = overlaps.matched_by_object(found, truth, view, least)
                    made[f"AP{view}@{least:g}{kind}"] = ranked(overlaps, object_of, found, int(truth.sum()))
        return made

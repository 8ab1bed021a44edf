"""Protocols of average precision by name: `coopsim`, and those of other benchmarks.

A protocol says which boxes count, how they are matched, and how the ranking becomes a number; each class has a table.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from coopsim.bench.detect.ranking import Overlaps, Ranking
from coopsim.geometry.se3 import Floats
from coopsim.metrics.average_precision import AP_THRESHOLDS
from coopsim.support.registry import Registry
from coopsim.types import Ints, Mask, ObjectClass
from coopsim.types.taxonomy import Superclass

VEHICLES = (ObjectClass.CAR, ObjectClass.VAN, ObjectClass.TRUCK, ObjectClass.BUS)
PEOPLE = (ObjectClass.PEDESTRIAN, ObjectClass.CHILD)
RIDERS = (ObjectClass.MOTORCYCLE, ObjectClass.BICYCLE, ObjectClass.SCOOTER)
"""A rider and the ridden vehicle are one object here. Motorcycles are no vehicles, as in V2X-Real's superclasses."""


class Protocol(ABC):
    """A way of computing average precision, as some benchmark does it.

    It is in two steps, so that episodes can be pooled and resampled without matching them again.

    Attributes:
        ranks_frames_together: the detections of all frames are ranked together, not frame after frame.
    """

    ranks_frames_together: ClassVar[bool] = True

    @abstractmethod
    def rankings(self, overlaps: Overlaps) -> dict[str, Ranking]:
        """Match one episode. Return the ranking behind each metric; of every episode the same names."""

    @abstractmethod
    def values(self, rankings: Mapping[str, Ranking]) -> dict[str, float]:
        """Return the metrics of the joined rankings, in [0, 1] where they are ratios; NaN where nothing was there."""


PROTOCOLS: Registry[type[Protocol]] = Registry("protocol", group="coopsim.protocols")
"""Protocols by name. Installed packages add theirs through the entry-point group `coopsim.protocols`."""


@PROTOCOLS.register("coopsim")
class CoopsimProtocol(Protocol):
    """Average precision, recall and false boxes as in coopsim's own tables.

    | question | answer |
    |---|---|
    | truth | objects that any agent's LiDAR has a return from, centre in the evaluation region |
    | detections | all, whatever their score, centre in the region |
    | match | by falling score, each to the free object of its kind of largest IoU (BEV or 3D), from 0.3, 0.5, 0.7 |
    | left out | detections on an object that does not count (3D IoU 0.25, more than on one that does), as in scores |
    | rank | all frames together; equal scores are one step of the curve; area of all points |
    | kinds | vehicles (car, van, truck, bus) as one; `people` (pedestrian, child) |
    | | `riders` (motorcycle, bicycle, scooter); `vulnerable` (people and riders as one); each class by itself |
    | `own`, `others_only` | vehicles, people or riders that the receiver has returns from, or only others |
    | `5_returns` | those with five returns or more of all agents together: less can hardly be placed by anybody |
    | `backwards` | found vehicles of score above 0.3 and BEV IoU 0.5 or more whose front is at the true rear |
    | bands | these by distance of their centre over ground: `0-30m`, `30-50m`, `50-100m` |

    Of a part of a kind: its objects are matched among all of the kind; detections on the others are left out, and
    detections on nothing all count against the part, or in a band those within it.
    """

    kinds: ClassVar[Mapping[str, tuple[ObjectClass, ...]]] = {
        "": VEHICLES,
        " people": PEOPLE,
        " riders": RIDERS,
        " vulnerable": (*PEOPLE, *RIDERS),
        **{f" {each.title}": (each,) for each in ObjectClass},
    }
    parted = ("", " people", " riders")
    seen_by: ClassVar[Mapping[str, int]] = {" own": 0, " others_only": 1}
    least_returns = 5
    bands_m = ((0.0, 30.0), (30.0, 50.0), (50.0, 100.0))
    ignored_iou = 0.25

    def rankings(self, overlaps: Overlaps) -> dict[str, Ranking]:
        made: dict[str, Ranking] = {}
        for kind, classes in self.kinds.items():
            found, truth = self._of_kind(overlaps, classes)
            for view in ("BEV", "3D"):
                for least in AP_THRESHOLDS:
                    object_of = overlaps.matched_by_score(found, truth, view, least, listed=False)
                    name = f"AP{view}@{least:g}"
                    made[name + kind] = ranked(overlaps, object_of, found, truth)
                    if name + kind == "APBEV@0.5":
                        made["backwards"] = _backwards(overlaps, object_of)
                    if kind in self.parted:
                        parts = self._parts(overlaps, object_of, found, truth)
                        made |= {name + kind + part: ranking for part, ranking in parts.items()}
        return made

    def values(self, rankings: Mapping[str, Ranking]) -> dict[str, float]:
        """Return the areas, and recall and false boxes of detections above score 0.3 at BEV IoU 0.5 (people 0.3)."""
        areas = {name: ranking.area() for name, ranking in rankings.items() if name != "backwards"}
        return {
            **areas,
            "backwards": rankings["backwards"].share(),
            **{f"recall{part}": rankings[f"APBEV@0.5{part}"].recall() for part in ("", *self.seen_by)},
            "recall people": rankings["APBEV@0.3 people"].recall(),
            "false_per_frame": rankings["APBEV@0.5"].false_per_frame(),
            "false_per_frame people": rankings["APBEV@0.3 people"].false_per_frame(),
        }

    def _of_kind(self, overlaps: Overlaps, classes: tuple[ObjectClass, ...]) -> tuple[Mask, Mask]:
        """Return the masks of the detections (N,) and objects (M,) of some classes that count."""
        there = overlaps.perceived
        of_kind = among(there.true_label, classes)
        truth = of_kind & there.true_counts
        ignored = overlaps.best_on(of_kind & ~there.true_counts, "3D")
        on_ignored = (ignored >= self.ignored_iou) & (ignored > overlaps.best_on(truth, "3D"))
        return among(there.found_label, classes) & there.found_in_region & ~on_ignored, truth

    def _parts(self, overlaps: Overlaps, object_of: Ints, found: Mask, truth: Mask) -> dict[str, Ranking]:
        """Return the rankings of parts of a kind of objects, by the end of their metrics' names."""
        there, hit = overlaps.perceived, object_of >= 0
        away_m, found_away_m = distances(there.true_box), distances(there.found_box)
        everywhere = np.ones(len(hit), np.bool_)
        parts = {part: (there.true_seen_by == number, everywhere) for part, number in self.seen_by.items()}
        parts[f" {self.least_returns}_returns"] = there.true_returns[:, 0] >= self.least_returns, everywhere
        for near_m, far_m in self.bands_m:
            within = (away_m >= near_m) & (away_m < far_m)
            parts[f" {near_m:g}-{far_m:g}m"] = within, (found_away_m >= near_m) & (found_away_m < far_m)
        made = {}
        for name, (of_part, against) in parts.items():
            on_part = hit & of_part[object_of] if len(of_part) else hit
            made[name] = ranked(overlaps, object_of, found & (on_part | (~hit & against)), truth & of_part)
        return made


@PROTOCOLS.register("opencood")
class OpencoodProtocol(Protocol):
    """OpenCOOD's average precision of vehicles, also of V2X-ViT, V2V4Real, CoBEVT, Where2comm; on OPV2V and V2XSet.

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

    ranks_frames_together = False
    least_score = 0.2
    region_m = (140.0, 40.0)
    thresholds: ClassVar[tuple[float, ...]] = AP_THRESHOLDS
    kinds: ClassVar[Mapping[str, tuple[ObjectClass, ...]]] = {"": VEHICLES}

    def rankings(self, overlaps: Overlaps) -> dict[str, Ranking]:
        there, made = overlaps.perceived, {}
        countable = there.true_counts & corners_within(there.true_box, self.region_m)
        believed = (there.found_score > self.least_score) & there.found_in_region
        believed &= corners_within(there.found_box, self.region_m)
        for kind, classes in self.kinds.items():
            truth, found = countable & among(there.true_label, classes), believed & among(there.found_label, classes)
            for least in self.thresholds:
                object_of = overlaps.matched_by_score(found, truth, "BEV", least)
                made[f"APBEV@{least:g}{kind}"] = ranked(overlaps, object_of, found, truth)
        return made

    def values(self, rankings: Mapping[str, Ranking]) -> dict[str, float]:
        return {name: ranking.area_by_frame() for name, ranking in rankings.items()}


@PROTOCOLS.register("v2x-real")
class V2xRealProtocol(OpencoodProtocol):
    """V2X-Real's average precision of superclasses (Xiang et al., ECCV 2024), whose nine classes ours are.

    | question | answer |
    |---|---|
    | kinds | Vehicle (car); Truck (van, truck, bus); Pedestrian (people and riders): `taxonomy.Superclass` |
    | truth, detections | seen by some agent; corners within x +-100 m, y +-40 m; score above 0.2 |
    | match, rank, area | OpenCOOD's, BEV IoU from 0.3 and 0.5 |
    | mean | over the superclasses that have objects: `mAPBEV@0.5` |

    `APBEV@0.5` without a suffix is of Vehicle and Truck as one class.
    """

    region_m = (100.0, 40.0)
    thresholds = (0.3, 0.5)
    kinds: ClassVar[Mapping[str, tuple[ObjectClass, ...]]] = {
        "": VEHICLES,
        **{f" {each.title}": each.classes for each in Superclass},
    }

    def values(self, rankings: Mapping[str, Ranking]) -> dict[str, float]:
        """Return the areas, and their means over the superclasses."""
        areas = super().values(rankings)
        names = [each.title for each in Superclass]
        means = {f"mAPBEV@{at:g}": _mean([areas[f"APBEV@{at:g} {name}"] for name in names]) for at in self.thresholds}
        return {**areas, **means}


@PROTOCOLS.register("dair")
class DairProtocol(Protocol):
    """Average precision as OpenDAIRV2X evaluates DAIR-V2X (Yu et al., CVPR 2022), in 3D and in the bird's-eye view.

    | question | answer |
    |---|---|
    | kinds | car (car, van, truck and bus as one) from IoU 0.3, 0.5, 0.7; cyclist and pedestrian from 0.25, 0.5 |
    | truth, detections | those of coopsim: seen by some agent, in the region; detections of any score |
    | match | objects in the order of the file, each the free detection of largest IoU (3D or BEV), whatever the score |
    | rank | all frames together; area of all points, each precision raised to the best beyond it |
    | quirk | the sum begins at the second detection: a hit at the very first adds nothing; at best 1 - 1 / objects |

    DAIR-V2X's own region is x 0 to 100 m of the vehicle; here it is the environment's. The metrics of cars have no
    suffix.
    """

    kinds: ClassVar[Mapping[str, tuple[tuple[ObjectClass, ...], tuple[float, ...]]]] = {
        "": (VEHICLES, (0.3, 0.5, 0.7)),
        " pedestrian": (PEOPLE, (0.25, 0.5)),
        " cyclist": (RIDERS, (0.25, 0.5)),
    }

    def rankings(self, overlaps: Overlaps) -> dict[str, Ranking]:
        there, made = overlaps.perceived, {}
        for kind, (classes, thresholds) in self.kinds.items():
            truth = among(there.true_label, classes) & there.true_counts
            found = among(there.found_label, classes) & there.found_in_region
            for view in ("BEV", "3D"):
                for least in thresholds:
                    object_of = overlaps.matched_by_object(found, truth, view, least)
                    made[f"AP{view}@{least:g}{kind}"] = ranked(overlaps, object_of, found, truth)
        return made

    def values(self, rankings: Mapping[str, Ranking]) -> dict[str, float]:
        return {name: ranking.area_without_first_step() for name, ranking in rankings.items()}


@PROTOCOLS.register("nuscenes")
class NuscenesProtocol(Protocol):
    """The nuScenes detection task's average precision (Caesar et al., CVPR 2020, sec. 3.1, and its development kit).

    | question | answer |
    |---|---|
    | kinds | each class by itself |
    | truth | with at least one return (here of some agent), within the class's range: vehicles 50 m, others 40 m |
    | detections | any score, within the range of their class |
    | match | by falling score, each to the nearest free object of the class, centres less than 0.5, 1, 2, 4 m apart |
    | rank | all frames together |
    | area | mean of max(precision - 0.1, 0) / 0.9 at recalls 0.11, 0.12, ... 1, interpolated, not raised |
    | mean | over the four distances, and over the classes that have objects: `mAP` |

    The classes are ours: van, scooter and child are none of nuScenes', whose trailers, cones, ... we lack. `APBEV@0.5`
    is not part of it: it is coopsim's, so that rows of all protocols have one number in common.
    """

    distances_m = (0.5, 1.0, 2.0, 4.0)
    common = "APBEV@0.5"

    def rankings(self, overlaps: Overlaps) -> dict[str, Ranking]:
        there, made = overlaps.perceived, {self.common: CoopsimProtocol().rankings(overlaps)[self.common]}
        for kind in ObjectClass:
            range_m = 50.0 if kind in VEHICLES else 40.0
            truth = (there.true_label == kind) & there.true_counts & (distances(there.true_box) < range_m)
            found = (there.found_label == kind) & there.found_in_region & (distances(there.found_box) < range_m)
            for far_m in self.distances_m:
                nearer_m = np.nextafter(far_m, 0.0)  # the distance itself is too far
                object_of = overlaps.matched_by_score(found, truth, "distance", -nearer_m)
                made[f"AP@{far_m:g}m {kind.title}"] = ranked(overlaps, object_of, found, truth)
        return made

    def values(self, rankings: Mapping[str, Ranking]) -> dict[str, float]:
        """Return the area of each class and distance, their means over classes and over distances, and `mAP`."""
        areas = {name: ranking.area_of_101_points() for name, ranking in rankings.items() if name != self.common}
        far = self.distances_m
        by_class = {kind.title: [areas[f"AP@{each:g}m {kind.title}"] for each in far] for kind in ObjectClass}
        return {
            "mAP": _mean([_mean(values) for values in by_class.values()]),
            **{f"AP {kind}": _mean(values) for kind, values in by_class.items()},
            **{f"mAP@{each:g}m": _mean([row[k] for row in by_class.values()]) for k, each in enumerate(far)},
            **areas,
            self.common: rankings[self.common].area(),
        }


def among(label: Ints, classes: tuple[ObjectClass, ...]) -> Mask:
    """Return the mask (N,) of labels that are among some classes."""
    return np.isin(label, [int(each) for each in classes])


def ranked(overlaps: Overlaps, object_of: Ints, kept: Mask, truth: Mask) -> Ranking:
    """Rank the detections `kept` (N,), matched to the objects `object_of` (N,); those in `truth` (M,) count."""
    there = overlaps.perceived
    return Ranking.of(there.found_start, there.found_score, object_of >= 0, kept, int(truth.sum()))


def _backwards(overlaps: Overlaps, object_of: Ints) -> Ranking:
    """Rank the detections that are matched to the objects `object_of` (N,); a hit is one that points backwards."""
    there, matched = overlaps.perceived, object_of >= 0
    wrong = np.zeros(len(matched), np.bool_)
    wrong[matched] = np.cos(there.found_box[matched, 6] - there.true_box[object_of[matched], 6]) < 0
    return Ranking.of(there.found_start, there.found_score, wrong, matched, 0)


def distances(boxes: Floats) -> Floats:
    """Return the distances (N,) over ground of boxes (N, 7), m."""
    away_m: Floats = np.hypot(boxes[:, 0], boxes[:, 1])
    return away_m


def corners_within(boxes: Floats, region_m: tuple[float, float]) -> Mask:
    """Return the mask (N,) of boxes (N, 7) whose corners all lie within a half length and width of a region, m."""
    cos, sin = np.abs(np.cos(boxes[:, 6])), np.abs(np.sin(boxes[:, 6]))
    reach_x = (boxes[:, 3] * cos + boxes[:, 4] * sin) / 2
    reach_y = (boxes[:, 3] * sin + boxes[:, 4] * cos) / 2
    within: Mask = (np.abs(boxes[:, 0]) + reach_x <= region_m[0]) & (np.abs(boxes[:, 1]) + reach_y <= region_m[1])
    return within


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else float("nan")

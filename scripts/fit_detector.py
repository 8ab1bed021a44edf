"""Fit the simulated detector to real detections, and write the preset that ships with coopsim.

    python scripts/fit_detector.py DATA [--out coopsim/detection/fitted/pointpillars_v2v4real.yaml]

DATA has v2v4real/train with labels/ and detections/. Recording 0000 is left out: it is one of those for testing.
Fitted are the detections of the car that owns the recordings' frame. See docs/reference/detector.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from detector_matches import GATE_M, NEAR_M, OWN_M, ClutterMotion, Matches, Recurrence, read_matches
from scipy.optimize import brentq, least_squares
from scipy.special import logit, ndtr, ndtri, roots_hermitenorm
from scipy.stats import rankdata

from coopsim.detection.presets import FITTED
from coopsim.detection.simulated.clutter import ClutterConfig
from coopsim.detection.simulated.correlated import ERRORS, CorrelatedDetectorConfig
from coopsim.detection.simulated.curves import ClassConfusion, Curve, DetectionModel, ErrorModel, ScoreModel
from coopsim.detection.simulated.persistence import Persistence
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.types import Ints, Mask

PRESET = FITTED / "pointpillars_v2v4real.yaml"
WITHOUT = ("0000",)
FRAME_S = 0.1
LAGS = np.array([1, 2, 3, 5, 10, 20, 40, 80])
CLUTTER_LAGS = np.array([1, 2, 3, 5, 8, 12, 20])
RANGES_M = np.array([OWN_M, 10, 20, 30, 40, 50, 60, 66, 72])
RETURNS = np.array([1, 3, 6, 12, 25, 50, 100, 200, 400, 10_000])
QUARTER, TAIL = ndtri(0.84), ndtri(0.975)
DIGITS = 3

CONFUSION = ClassConfusion(
    {
        "car": {"van": 0.02},
        "van": {"car": 0.15, "truck": 0.05},
        "truck": {"van": 0.05, "bus": 0.05},
        "bus": {"truck": 0.1},
        "motorcycle": {"bicycle": 0.1, "scooter": 0.05},
        "bicycle": {"pedestrian": 0.033, "motorcycle": 0.05, "scooter": 0.02},
        "scooter": {"pedestrian": 0.033, "bicycle": 0.05, "motorcycle": 0.05},
        "pedestrian": {"bicycle": 0.038, "child": 0.02},
        "child": {"pedestrian": 0.1, "bicycle": 0.038},
    },
    Persistence(constant=0.4, lasting=0.4, lasting_s=1.0),
)
"""Confusion of the fitted detector.

Measured: people and cyclists taken for each other, and the persistence, by PointRCNN on KITTI's 15 training sequences
with detections (`scripts/detector_matches.py`): 44 of 1,171 pedestrians were reported as cyclists, 14 of 420 cyclists
as pedestrians; a wrong label is wrong again in the next frame (0.1 s later) with probability 0.48, as a Gaussian copula
with correlation 0.8 gives. Assumed, because no detections here tell these classes apart: all other shares, which are
between classes of neighbouring sizes. The detector's own recordings (V2V4Real) have one class only.
"""


def main() -> None:
    """Read the arguments, fit, write."""
    parser = argparse.ArgumentParser(description="Fit the simulated detector to V2V4Real's detections.")
    parser.add_argument("data", type=Path, help="folder with v2v4real/train")
    parser.add_argument("--out", type=Path, default=PRESET)
    args = parser.parse_args()
    args.out.write_text(fit_text(args.data), encoding="utf-8")


def fit_text(data: Path) -> str:
    """Return the text of the preset's file."""
    folder = data / "v2v4real" / "train"
    head = "# Written by scripts/fit_detector.py from V2V4Real's training recordings; see docs/reference/detector.md.\n"
    return head + to_yaml(fit(*read_matches(folder, WITHOUT).values()))


def to_yaml(config: CorrelatedDetectorConfig) -> str:
    """Write a configuration as YAML text for `read_config`."""
    text: str = yaml.safe_dump(_plain(asdict(config)), default_flow_style=None, sort_keys=False, width=120)
    return text


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _plain(part) for name, part in value.items()}
    return [_plain(part) for part in value] if isinstance(value, tuple) else value


def fit(real: Matches, other: Matches) -> CorrelatedDetectorConfig:
    """Fit all parameters to the matches of the frame's owner and the other car's false detections in the same frame."""
    reach = _reach(real)
    seen = {name: column[real.within(reach)] for name, column in real.objects.items()}
    detection = _detection(seen)
    return CorrelatedDetectorConfig(
        reach_x_m=reach[0],
        reach_y_m=reach[1],
        detection=detection,
        score=_score(seen, detection),
        errors={name: _error(seen, name) for name in ERRORS},
        clutter=_clutter(real, other, reach),
        heading_from_rad=_heading_from(seen),
        confusion=CONFUSION,
    )


def _reach(real: Matches) -> tuple[float, float]:
    """Return the distances along x and y within which 99.5 % of all detections are."""
    detected = real.objects["found"]
    sides = (np.concatenate([real.objects[axis][detected], real.false[axis]]) for axis in "xy")
    along, across = (round(float(np.quantile(np.abs(side), 0.995)), 1) for side in sides)
    return along, across


def _detection(seen: dict[str, Floats]) -> DetectionModel:
    """Fit recall over the logarithm of the returns, and the persistence of misses to pairs of frames."""
    logs = np.log(seen["returns"])
    chance = _curve(logs, np.log(RETURNS), seen["found"], np.mean)
    probability = chance(logs)
    at, weight = [], []
    for lag in LAGS:
        first, second = _pairs(seen, lag)
        together = float(np.mean(seen["found"][first] & seen["found"][second]))
        # Objects that stay long are found more often, so both frames are compared with the recall in the same pairs.
        chances = [_shifted(probability[rows], seen["found"][rows].mean()) for rows in (first, second)]
        at.append(_latent(*chances, together))
        weight.append(len(first))
    return DetectionModel(chance, _persistence(np.array(at), np.array(weight)))


def _score(seen: dict[str, Floats], detection: DetectionModel) -> ScoreModel:
    """Fit the scores of detected objects: distribution by range, and correlation with the evidence for them."""
    floor = round(float(np.nanmin(seen["score"])), 2)
    hit = seen["found"]
    score, range_m = _unfloored(seen["score"], floor), seen["range"]
    mean, spread = _middle_and_spread(range_m[hit], score[hit])
    normal = _normal_scores(range_m, np.where(hit, score, np.nan))
    # The stronger the correlation with the evidence, the lower are scores before a miss.
    first, second = _pairs(seen, 1)
    before_miss = hit[first] & ~hit[second]
    observed = float(np.mean(normal[first][before_miss]) - np.mean(normal[first][hit[first] & hit[second]]))
    kept = _autocorrelation(detection.persistence, 1)
    probability = detection.probability(np.log(seen["returns"][first]))
    margin_correlation = float(np.clip(observed / _margin_gap(probability, kept), -1, 1))
    at, weight = [], []
    for lag in LAGS:
        own = (
            _correlation(seen, normal, lag) - margin_correlation**2 * _autocorrelation(detection.persistence, lag)
        ) / (1 - margin_correlation**2)
        at.append(np.clip(own, 0, 1))
        weight.append(len(_pairs(seen, lag)[0]))
    persistence = _persistence(np.array(at), np.array(weight))
    return ScoreModel(floor, mean, spread, round(margin_correlation, DIGITS), persistence)


def _error(seen: dict[str, Floats], name: str) -> ErrorModel:
    """Fit Tukey's h-distribution by quantiles: spread from the middle 68 %, tail from the middle 95 %."""
    error, range_m, hit = seen[name], seen["range"], seen["found"]
    wide, narrow, middles = [], [], []
    for inside in _bins(range_m[hit], RANGES_M):
        low, lower, middle, upper, high = np.quantile(error[hit][inside], ndtr([-TAIL, -QUARTER, 0, QUARTER, TAIL]))
        wide.append((high - low) / 2)
        narrow.append((upper - lower) / 2)
        middles.append(middle)
    # The spread varies within a bin, which adds a tail, but a slight one.
    tails = np.log(np.array(wide) / np.array(narrow) * QUARTER / TAIL) * 2 / (TAIL**2 - QUARTER**2)
    tail = round(float(np.clip(np.median(tails), 0, 0.5)), DIGITS)
    spreads = np.array(narrow) / (QUARTER * np.exp(tail * QUARTER**2 / 2))
    normal = _normal_scores(range_m, np.where(hit, error, np.nan))
    at = np.array([_correlation(seen, normal, lag) for lag in LAGS])
    weight = np.array([len(_pairs(seen, lag)[0]) for lag in LAGS])
    places = _middles(range_m[hit])
    return ErrorModel(
        Curve(places, _rounded(spreads)), Curve(places, _rounded(middles)), tail, _persistence(at, weight)
    )


def _heading_from(seen: dict[str, Floats]) -> float:
    """Return the start of the half turn that holds most reported headings, in steps of pi / 32."""
    steps = np.arange(-32, 32) * np.pi / 32
    turned = seen["turned"][seen["found"]]
    inside = [np.mean((turned - start) % (2 * np.pi) < np.pi) for start in steps]
    return round(float(steps[int(np.argmax(inside))]), DIGITS)


def _clutter(real: Matches, other: Matches, reach: tuple[float, float]) -> ClutterConfig:
    """Fit false detections as phantoms, whose number follows from the share that both cars report."""
    false = {name: column[_inside(real.false, reach)] for name, column in real.false.items()}
    reported = _shared(real, other)
    counted = [len(inside) for inside in _bins(false["range"], RANGES_M)]
    per_m2 = np.array(counted) / real.frames / _areas_m2(reach)
    density = len(false["x"]) / real.frames / _areas_m2(reach).sum() / reported
    chance = Curve(_middles(false["range"]), _rounded(np.clip(per_m2 / density, 0, 1)))
    floor = round(float(false["score"].min()), 2)
    score = _unfloored(false["score"], floor)
    mean, spread = _middle_and_spread(false["range"], score)
    sizes = np.log(np.column_stack([false[name] for name in ("length", "width", "height")]))
    narrow = np.subtract(*np.quantile(sizes, [0.84, 0.16], axis=0)).mean() / (2 * QUARTER)
    motion = ClutterMotion(false, reach)
    after = [motion.after(int(lag)) for lag in CLUTTER_LAGS]
    lasting, score_lasting, life_s = _clutter_lasting(after, false, chance)
    apart_m = after[0].apart_m
    spread_m = np.subtract(*np.quantile(apart_m, [0.84, 0.16], axis=0)).mean() / (2 * QUARTER)
    return ClutterConfig(
        density_per_m2=float(f"{density:.3g}"),
        density_spread=round(_spread_of_density(real, reach), DIGITS),
        detection=DetectionModel(chance, lasting),
        score=ScoreModel(floor, mean, spread, 0.0, score_lasting),
        life_s=life_s,
        size_m=_rounded(np.exp(np.median(sizes, axis=0))),
        size_noise=round(float(narrow), DIGITS),
        jitter_m=round(float(spread_m / np.sqrt(2)), DIGITS),
        heading_quantiles_rad=_rounded(np.quantile(false["yaw"], np.linspace(0, 1, 17))),
    )


def _clutter_lasting(
    after: Sequence[Recurrence], false: dict[str, Floats], chance: Curve
) -> tuple[Persistence, Persistence, float]:
    """Fit the persistence of the evidence for phantoms and of their scores, and the life of a phantom, s.

    A phantom with an age uniform in its life is still there after the time t with probability 1 - t / life, and is then
    reported again according to the persistence of its evidence.
    """
    normal = _normal_scores(false["range"], false["score"])
    probability = np.maximum(chance(false["range"]), 1e-3)
    share, weight = np.array([again.share for again in after]), np.array([again.count for again in after])
    grid = np.linspace(0, 0.99, 34)  # of correlations: the probability is smooth in between
    reported = [_both(probability, probability, correlation, 1 / probability) for correlation in grid]

    def off(parts: Floats) -> Floats:
        whole, constant_share, lasting_s, life_s = parts
        time_s = CLUTTER_LAGS * FRAME_S
        kept = whole * (constant_share + (1 - constant_share) * np.exp(-time_s / lasting_s))
        alive = np.clip(1 - time_s / life_s, 0, 1)
        return (alive * np.interp(kept, grid, reported) - share) * np.sqrt(weight / weight.sum())

    fitted = least_squares(off, [0.6, 0.3, 0.5, 4.0], bounds=([0, 0, 0.05, 2.1], [0.99, 1, 10, 60])).x
    scores = np.array([float(np.mean(normal[again.first] * normal[again.second])) for again in after])
    return _as_persistence(*fitted[:3]), _persistence(scores, weight, CLUTTER_LAGS), round(float(fitted[3]), DIGITS)


def _shared(real: Matches, other: Matches) -> float:
    """Return the share of false detections that the other car reports, too, within its reach, less chance matches."""
    near, ring, count = 0, 0, 0
    theirs = _frames_of(other.false)
    for key, place in _frames_of(real.false).items():
        if key not in theirs:
            continue
        low, high = theirs[key].min(axis=0) - GATE_M, theirs[key].max(axis=0) + GATE_M
        inside = place[((place > low) & (place < high)).all(axis=1)]
        distance = np.linalg.norm(inside[:, None] - theirs[key], axis=2)
        near += (distance.min(axis=1) < NEAR_M).sum()
        # A ring of the same area a little farther out counts the chance matches.
        ring += ((distance > 2 * NEAR_M) & (distance < np.sqrt(5) * NEAR_M)).any(axis=1).sum()
        count += len(inside)
    return float((near - ring) / (count - ring))


def _spread_of_density(real: Matches, reach: tuple[float, float]) -> float:
    """Return the relative standard deviation over recordings of their mean number of false detections."""
    inside = _inside(real.false, reach)
    means = [
        inside[real.false["episode"] == episode].sum()
        / np.ptp(real.objects["frame"][real.objects["episode"] == episode])
        for episode in np.unique(real.objects["episode"])
    ]
    return float(np.std(means) / np.mean(means))


def _areas_m2(reach: tuple[float, float]) -> Floats:
    """Return the area within reach in each bin of `RANGES_M`, by a grid of half metres."""
    x, y = (np.arange(-side + 0.25, side, 0.5) for side in reach)
    range_m = np.hypot(*np.meshgrid(x, y)).ravel()
    return np.array([0.25 * len(inside) for inside in _bins(range_m, RANGES_M)])


def _margin_gap(probability: Floats, kept: float) -> float:
    """Return the mean margin before a miss less that before a detection, in standard deviations, by simulation."""
    rng = stream(0, "clearness")  # the name decides the draws
    chosen = rng.choice(probability, 400_000)
    now, fresh = rng.standard_normal((2, len(chosen)))
    after = kept * now + np.sqrt(1 - kept**2) * fresh
    found = DetectionModel(Curve((0.0,), (0.0,)))
    first, margin = found.decide(chosen, now)
    second, _ = found.decide(chosen, after)
    return float(margin[first & ~second].mean() - margin[first & second].mean())


def _shifted(probability: Floats, mean: float) -> Floats:
    """Shift all probabilities (N,) alike in normal quantiles so that they have this mean."""
    level = ndtri(probability)
    shift = brentq(lambda by: float(ndtr(level + by).mean()) - mean, -5, 5)
    shifted: Floats = ndtr(level + shift)
    return shifted


def _latent(first: Floats, second: Floats, together: float) -> float:
    """Return the correlation, in [0, 1], of two standard normal evidences that suffice with probabilities `first` and
    `second` (N,), such that the mean probability that both do is `together`.
    """

    def gap(correlation: float) -> float:
        return _both(first, second, correlation) - together

    least, most = 0.0, 0.995
    return least if gap(least) >= 0 else most if gap(most) <= 0 else float(brentq(gap, least, most))


def _both(first: Floats, second: Floats, correlation: float, weight: Floats | float = 1.0) -> float:
    """Return the weighted mean probability that two correlated evidences suffice (one-factor model, Gauss-Hermite)."""
    rows = np.linspace(0, len(first) - 1, min(len(first), 2000)).astype(np.int64)  # a sample, for speed
    level = ndtri(np.clip(np.stack([first, second])[:, rows], 1e-9, 1 - 1e-9))
    node, share = roots_hermitenorm(48)
    both = ndtr((level[..., None] + np.sqrt(correlation) * node) / np.sqrt(1 - correlation)).prod(axis=0)
    return float(np.mean(np.broadcast_to(weight, np.shape(first))[rows] * (both @ (share / share.sum()))))


def _persistence(at: Floats, weight: Ints, lags: Ints = LAGS) -> Persistence:
    """Fit a persistence by least squares to autocorrelations after `lags` frames."""

    def off(parts: Floats) -> Floats:
        whole, constant_share, lasting_s = parts
        curve = constant_share + (1 - constant_share) * np.exp(-lags * FRAME_S / lasting_s)
        return (whole * curve - at) * np.sqrt(weight / weight.sum())

    return _as_persistence(*least_squares(off, [0.7, 0.4, 1.0], bounds=([0, 0, 0.05], [1, 1, 10])).x)


def _as_persistence(whole: float, constant_share: float, lasting_s: float) -> Persistence:
    constant = round(float(whole * constant_share), DIGITS)
    lasting = min(round(float(whole * (1 - constant_share)), DIGITS), round(1 - constant, DIGITS))
    return Persistence(constant, lasting, round(float(lasting_s), DIGITS))


def _autocorrelation(persistence: Persistence, lag: int) -> float:
    kept = np.exp(-lag * FRAME_S / persistence.lasting_s)
    return float(persistence.constant + persistence.lasting * kept)


def _pairs(seen: dict[str, Floats], lag: int) -> tuple[Ints, Ints]:
    """Return rows of the same objects now and `lag` frames later."""
    key = (seen["episode"].astype(np.int64) * 2**20 + seen["object"].astype(np.int64)) * 2**20 + seen["frame"].astype(
        np.int64
    )
    order = np.argsort(key)
    place = np.minimum(np.searchsorted(key[order], key + lag), len(key) - 1)
    there = key[order][place] == key + lag
    return np.flatnonzero(there), order[place[there]]


def _correlation(seen: dict[str, Floats], normal: Floats, lag: int) -> float:
    first, second = _pairs(seen, lag)
    product = normal[first] * normal[second]
    return float(np.nanmean(product))


def _normal_scores(range_m: Floats, value: Floats) -> Floats:
    """Map values (N,) by their ranks within a bin of range to standard normal numbers; NaN stays."""
    normal = np.full(len(value), np.nan)
    for inside in _bins(range_m, RANGES_M):
        rows = inside[np.isfinite(value[inside])]
        normal[rows] = ndtri((rankdata(value[rows]) - 0.5) / max(len(rows), 1))
    return normal


def _middle_and_spread(range_m: Floats, score: Floats) -> tuple[Curve, Curve]:
    """Return the median and the spread (half the middle 68 %, in standard deviations) by range."""
    quantiles = [np.quantile(score[inside], ndtr([-QUARTER, 0, QUARTER])) for inside in _bins(range_m, RANGES_M)]
    at = _middles(range_m)
    middle = Curve(at, _rounded([each[1] for each in quantiles]))
    return middle, Curve(at, _rounded([(each[2] - each[0]) / 2 / QUARTER for each in quantiles]))


def _unfloored(score: Floats, floor: float) -> Floats:
    unfloored: Floats = logit(np.clip((score - floor) / (1 - floor), 1e-6, 1 - 1e-6))
    return unfloored


def _curve(at: Floats, edges: Floats, value: Floats, of: Callable[[Floats], float]) -> Curve:
    bins = [inside for inside in _bins(at, edges) if len(inside)]
    return Curve(_rounded([np.mean(at[inside]) for inside in bins]), _rounded([of(value[inside]) for inside in bins]))


def _bins(at: Floats, edges: Floats) -> list[Ints]:
    """Return the rows between each two edges; those beyond the ends are in the first and last bin."""
    number = np.clip(np.searchsorted(edges, at, "right") - 1, 0, len(edges) - 2)
    return [np.flatnonzero(number == k) for k in range(len(edges) - 1)]


def _middles(range_m: Floats) -> tuple[float, ...]:
    return _rounded([np.mean(range_m[inside]) for inside in _bins(range_m, RANGES_M)])


def _frames_of(false: dict[str, Floats]) -> dict[tuple[int, int], Floats]:
    """Return positions (N, 2) by episode and frame."""
    key = np.column_stack([false["episode"], false["frame"]]).astype(np.int64)
    order = np.lexsort((key[:, 1], key[:, 0]))
    unique, starts = np.unique(key[order], axis=0, return_index=True)
    places = np.split(np.column_stack([false["x"], false["y"]])[order], starts[1:])
    return {(int(episode), int(frame)): place for (episode, frame), place in zip(unique, places, strict=True)}


def _inside(table: dict[str, Floats], reach: tuple[float, float]) -> Mask:
    inside: Mask = (np.abs(table["x"]) <= reach[0]) & (np.abs(table["y"]) <= reach[1])
    return inside


def _rounded(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(round(float(value), DIGITS) for value in values)


if __name__ == "__main__":
    main()

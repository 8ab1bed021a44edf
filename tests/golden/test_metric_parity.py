"""Our metrics against TrackEval and motmetrics, to 1e-6 where the definitions agree, and where they do not, why."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import motmetrics
import numpy as np
import pytest
from metric_sequences import Frame, evaluate, for_motmetrics, for_trackeval, generate, on_a_line, without_rivals
from trackeval.metrics import CLEAR, HOTA, Identity

import coopsim
from coopsim.geometry.se3 import Floats
from coopsim.metrics.evaluator import Evaluator, FrameCounts
from coopsim.metrics.score import Score, summarize
from coopsim.types import GroundTruth, Tracks

TOLERANCE = 1e-6
SEEDS = range(12)
SETTINGS = [(seed, match_iou) for seed in SEEDS for match_iou in (0.25, 0.5)]

HOTA_NAMES = {"HOTA": "HOTA", "DetA": "DetA", "AssA": "AssA", "LocA": "LocA"}
IDENTITY_NAMES = {"IDF1": "IDF1", "IDP": "IDP", "IDR": "IDR"}
CLEAR_COUNTS = {"TP": "CLR_TP", "FP": "CLR_FP", "FN": "CLR_FN", "IDS": "IDSW", "FRAG": "Frag"}
CLEAR_NAMES = {
    "MOTA": "MOTA",
    "MOTP": "MOTP",
    "sMOTA": "sMOTA",
    "MODA": "MODA",
    "recall": "CLR_Re",
    "precision": "CLR_Pr",
    "MT": "MTR",
    "PT": "PTR",
    "ML": "MLR",
}
MOT_COUNTS = {"TP": "num_detections", "FP": "num_false_positives", "FN": "num_misses", "IDS": "num_switches"}


def trackeval(metric: Any, sequences: Sequence[list[Frame]], similarity: str = "overlap") -> dict[str, float]:
    """What TrackEval says of pooled sequences; a mean over thresholds where it gives one value for each."""
    each = {str(k): metric.eval_sequence(for_trackeval(frames, similarity)) for k, frames in enumerate(sequences)}
    return {name: float(np.mean(value)) for name, value in metric.combine_sequences(each).items()}


def at(metric: type[CLEAR] | type[Identity], match_iou: float) -> Any:
    return metric({"THRESHOLD": match_iou, "PRINT_CONFIG": False})


def same(ours: Any, theirs: dict[str, float], names: dict[str, str], scale: float = 100) -> None:
    """Each of our values is theirs, times what turns it into our unit."""
    expected = {name: scale * theirs[there] for name, there in names.items()}
    assert {name: ours[name] for name in names} == pytest.approx(expected, abs=TOLERANCE)


def same_as_trackeval(score: Score, sequences: Sequence[list[Frame]], match_iou: float) -> None:
    same(score, trackeval(HOTA(), sequences), HOTA_NAMES)
    near = {f"{name}@2m": name for name in HOTA_NAMES}
    same(score, trackeval(HOTA(), sequences, "nearness"), near)
    same(score, trackeval(at(Identity, match_iou), sequences), IDENTITY_NAMES)
    clear = trackeval(at(CLEAR, match_iou), sequences)
    same(score.all_tracks, clear, CLEAR_COUNTS, scale=1)
    same(score.all_tracks, clear, CLEAR_NAMES)


@pytest.mark.parametrize(("seed", "match_iou"), SETTINGS)
def test_crowds_as_trackeval(seed: int, match_iou: float) -> None:
    frames = generate(seed)
    assert not any(frame.one_sided for frame in frames)
    same_as_trackeval(summarize([evaluate(frames, match_iou)]), [frames], match_iou)


def test_pooled_sequences_as_trackeval() -> None:
    sequences = [generate(seed, frames=10 + 7 * seed, objects=3 + seed) for seed in range(5)]
    same_as_trackeval(summarize([evaluate(frames) for frames in sequences]), sequences, 0.25)


@pytest.mark.parametrize("seed", SEEDS)
def test_empty_frames_as_trackeval(seed: int) -> None:
    """TrackEval's CLEAR passes over a frame in which nothing is there, or nothing is reported, as if there were none:
    it remembers pairs over it, and sees no interruption. A definition that speaks of the frame before has no
    exception for it, and neither do we. Without those frames, both say the same."""
    frames = generate(seed, empty=0.2)
    assert any(frame.one_sided for frame in frames)
    score = summarize([evaluate(frames)])
    same(score, trackeval(HOTA(), [frames]), HOTA_NAMES)
    same(score, trackeval(at(Identity, 0.25), [frames]), IDENTITY_NAMES)
    full = summarize([evaluate([frame for frame in frames if not frame.one_sided])])
    clear = trackeval(at(CLEAR, 0.25), [frames])
    same(full.all_tracks, clear, {name: CLEAR_COUNTS[name] for name in ("TP", "IDS", "FRAG")}, scale=1)
    same(full.all_tracks, clear, {"MOTP": "MOTP"})


def test_nothing_is_reported() -> None:
    sequence = on_a_line([({1: 0.0}, {})] * 3)
    score = summarize([evaluate(sequence)])
    same(score, trackeval(HOTA(), [sequence]), HOTA_NAMES)
    same(score, trackeval(at(Identity, 0.25), [sequence]), IDENTITY_NAMES)
    same(score.all_tracks, trackeval(at(CLEAR, 0.25), [sequence]), CLEAR_COUNTS, scale=1)


def test_nothing_is_there() -> None:
    """Counts agree. Ratios are 0 in TrackEval (LocA and ML 1), and undefined here."""
    sequence = on_a_line([({}, {9: 0.0})] * 3)
    score = summarize([evaluate(sequence)])
    same(score.all_tracks, trackeval(at(CLEAR, 0.25), [sequence]), CLEAR_COUNTS, scale=1)
    assert np.isnan([score[name] for name in (*HOTA_NAMES, *IDENTITY_NAMES, *CLEAR_NAMES)]).all()


def mot(sequence: list[Frame], names: Sequence[str], match_iou: float = 0.25) -> dict[str, float]:
    """What motmetrics says of a sequence."""
    table = motmetrics.metrics.create().compute(for_motmetrics(sequence, match_iou), metrics=list(names))
    return {name: float(table[name].iloc[0]) for name in names}


def same_as_motmetrics(score: Score, frames: list[Frame], match_iou: float) -> None:
    """All but FRAG and the objects' shares."""
    theirs = mot(frames, [*MOT_COUNTS.values(), "mota", "motp", "precision", "recall"], match_iou)
    same(score.all_tracks, theirs, MOT_COUNTS, scale=1)
    same(score.all_tracks, theirs, {"MOTA": "mota", "precision": "precision", "recall": "recall"})
    assert score.all_tracks["MOTP"] == pytest.approx(100 * (1 - theirs["motp"]), abs=TOLERANCE)


@pytest.mark.parametrize(("seed", "match_iou"), SETTINGS)
def test_identity_as_motmetrics(seed: int, match_iou: float) -> None:
    frames = generate(seed, empty=0.1)
    score = summarize([evaluate(frames, match_iou)])
    same(score, mot(frames, ["idf1", "idp", "idr"], match_iou), {"IDF1": "idf1", "IDP": "idp", "IDR": "idr"})


@pytest.mark.parametrize(("seed", "match_iou"), SETTINGS)
def test_tracks_without_rivals_as_motmetrics(seed: int, match_iou: float) -> None:
    """Where an object has at most one candidate, nobody has a choice. Objects are always there, and for a number
    of frames of which no share is exactly 80 %."""
    frames = without_rivals(generate(seed, absences=0, empty=0.1), match_iou)
    frames = [frame for frame in frames if len(frame.truth)]
    frames = frames[: len(frames) - (len(frames) % 5 == 0)]
    score = summarize([evaluate(frames, match_iou)])
    assert score.all_tracks["IDS"] > 0
    same_as_motmetrics(score, frames, match_iou)
    objects = score["objects"]
    theirs = mot(frames, ["num_fragmentations", "mostly_tracked", "partially_tracked", "mostly_lost"], match_iou)
    same(score.all_tracks, theirs, {"FRAG": "num_fragmentations"}, scale=1)
    shares = {"MT": "mostly_tracked", "PT": "partially_tracked", "ML": "mostly_lost"}
    same(score.all_tracks, theirs, shares, scale=100 / objects)


DIFFERENT: dict[str, tuple[list[Any], str, str, float, float]] = {
    # motmetrics tries an object's last pair again however long ago it was; Bernardin and Stiefelhagen, and TrackEval,
    # only if it was in the frame before.
    "an old track returns after a gap, but another is nearer": (
        [({1: 0.0}, {9: 0.0}), ({1: 0.0}, {}), ({1: 0.0}, {9: 1.0, 8: 0.0})],
        "IDS",
        "num_switches",
        1,
        0,
    ),
    # motmetrics matches as many pairs as it can; TrackEval, and we, for the largest sum of IoU.
    "two poor pairs or a good one": (
        [({1: 0.0, 2: 2.2}, {8: 2.2, 9: 4.5})],
        "TP",
        "num_detections",
        1,
        2,
    ),
    # motmetrics has no gap where the object itself is not there.
    "an object is away": (
        [({1: 0.0}, {9: 0.0}), ({2: 50.0}, {7: 50.0}), ({1: 0.0}, {9: 0.0})],
        "FRAG",
        "num_fragmentations",
        1,
        0,
    ),
    # Mostly tracked is at least 80 % there; here and in TrackEval it is more.
    "exactly 80 %": ([({1: 0.0}, {9: 0.0})] * 4 + [({1: 0.0}, {})], "MT", "mostly_tracked", 0, 1),
}
"""Frames; our name and theirs; our value and theirs."""


@pytest.mark.parametrize(("frames", "name", "there", "ours", "theirs"), DIFFERENT.values(), ids=DIFFERENT)
def test_where_motmetrics_differs(frames: list[Any], name: str, there: str, ours: float, theirs: float) -> None:
    sequence = on_a_line(frames)
    assert summarize([evaluate(sequence, 0.2)]).all_tracks[name] == ours
    assert mot(sequence, [there], 0.2)[there] == theirs


def devkit_averages(frames: list[Frame]) -> tuple[float, float]:
    """nuScenes' AMOTA and AMOTP (m), step by step as its development kit takes them, with motmetrics at each."""
    ids = np.concatenate([frame.tracks.id for frame in frames])
    scores = np.concatenate([frame.tracks.score for frame in frames])
    mean = {track: scores[ids == track].mean() for track in np.unique(ids)}

    def accumulate(threshold: float) -> motmetrics.MOTAccumulator:
        found = motmetrics.MOTAccumulator(auto_id=True)
        for frame in frames:
            sure = np.array([mean[track] >= threshold for track in frame.tracks.id], dtype=bool)
            near = np.where((frame.distance() < 2) & (frame.same_class() > 0), frame.distance(), np.nan)
            found.update(frame.truth.id, frame.tracks.id[sure], near[:, sure])
        return found

    truth = sum(len(frame.truth) for frame in frames)
    events = accumulate(-np.inf).mot_events
    matched: Floats = np.sort([mean[track] for track in events[events.Type == "MATCH"].HId])[::-1]
    recall = np.arange(1, len(matched) + 1) / truth
    motar, distance = [], []
    for level in np.linspace(0.1, 1, 40).round(12):
        if level > recall[-1]:
            motar.append(0.0)
            distance.append(2.0)
            continue
        events = accumulate(float(np.interp(level, recall, matched))).mot_events
        kinds = events.Type.value_counts()
        kept, switches, false = (int(kinds.get(kind, 0)) for kind in ("MATCH", "SWITCH", "FP"))
        motar.append(max(0.0, 1 - (truth - kept + false - (1 - kept / truth) * truth) / kept))
        distance.append(events[events.Type.isin(["MATCH", "SWITCH"])].D.sum() / (kept + switches))
    return float(np.mean(motar)), float(np.mean(distance))


@pytest.mark.parametrize("seed", range(3))
def test_averages_as_the_nuscenes_kit(seed: int) -> None:
    frames = without_rivals(generate(seed, gap_m=15), 0, similarity="nearness")
    score = summarize([evaluate(frames)])
    amota, amotp_m = devkit_averages(frames)
    assert 0 < amota < 1
    assert score["AMOTA@2m"] == pytest.approx(100 * amota, abs=TOLERANCE)
    assert score["AMOTP@2m"] == pytest.approx(amotp_m, abs=TOLERANCE)


@pytest.mark.heavy("AB3DMOT tracks 1,134 recorded frames")
def test_real_recordings(v2v4real: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """AB3DMOT on all recordings: pooled as TrackEval says, and without rivals every third as motmetrics says."""
    recorded: dict[int, tuple[Evaluator, list[Frame]]] = {}
    update = Evaluator.update

    def record(self: Evaluator, truth: GroundTruth, tracks: Tracks, in_region: None = None) -> FrameCounts:
        recorded.setdefault(id(self), (self, []))[1].append(Frame(truth, tracks))
        return update(self, truth, tracks)

    with monkeypatch.context() as patch:
        patch.setattr(Evaluator, "update", record)
        coopsim.evaluate_recordings("ab3dmot", v2v4real, ["cobevt"])
    sequences = [frames for _, frames in recorded.values() if len(frames) > 1]  # one frame only warms up
    assert sum(map(len, sequences)) == 1134
    same_as_trackeval(summarize([evaluate(frames) for frames in sequences]), sequences, 0.25)
    for frames in sequences[::3]:
        names = {"IDF1": "idf1", "IDP": "idp", "IDR": "idr"}
        same(summarize([evaluate(frames)]), mot(frames, list(names.values())), names)
        alone = without_rivals(frames, 0.25)
        same_as_motmetrics(summarize([evaluate(alone)]), alone, 0.25)

"""coop_fuse's tracks: two hypotheses of one object stay two, and each keeps its own likelihood."""

from __future__ import annotations

import numpy as np
from some_tracks import cars

import coopsim
from coopsim.agents.coop_fuse import CALIBRATION, CoopFuse
from coopsim.detection.detector import Detector, Rng, SensorNeeds
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import AgentSpec, Detections, SensorView, Tracks

NS_PER_FRAME = 100_000_000
HIGHER_M = 0.3


def one_above_the_other(likely: float, unlikely: float, likelier_above: bool) -> Detections:
    """Two boxes that exclude each other, as one object of two heights."""
    above, below = (likely, unlikely) if likelier_above else (unlikely, likely)
    boxes = [[10, 2, z, 4.5, 1.9, 1.6, 0.1] for z in (0.8, 0.8 + HIGHER_M)]
    return Detections(Boxes3D.from_array(boxes), [below, above], [0, 0])


def tracked(frames: list[Detections], **settings: float) -> list[Tracks]:
    tracker = CoopFuse(**settings).make_tracker()
    return [tracker.step(frame, number * NS_PER_FRAME) for number, frame in enumerate(frames)]


def test_a_track_stays_with_the_box_that_is_as_likely_as_it() -> None:
    before = one_above_the_other(0.9, 0.1, likelier_above=False)
    reports = tracked([before, before, before, one_above_the_other(0.9, 0.1, likelier_above=True)], least=0)
    first, last = reports[-2], reports[-1]
    likelier = {int(each.id[each.score.argmax()]) for each in (first, last)}
    assert len(likelier) == 1  # the places have changed, the hypotheses have not
    assert last.boxes.center[last.score.argmax(), 2] > 0.8 + HIGHER_M / 2
    assert sorted(first.id) == sorted(last.id)


def test_where_the_boxes_are_far_apart_place_counts_more_than_likelihood() -> None:
    boxes = Boxes3D.from_array([[10, 2, 0.8, 4.5, 1.9, 1.6, 0], [10, 8, 0.8, 4.5, 1.9, 1.6, 0]])
    likely, swapped = (Detections(boxes, scores, [0, 0]) for scores in ([0.9, 0.1], [0.1, 0.9]))
    reports = tracked([likely, likely, swapped], least=0)
    places = [dict(zip(each.id.tolist(), each.boxes.center[:, 1].round(), strict=True)) for each in reports[1:]]
    assert places[0] == places[1]


def test_what_is_less_likely_than_asked_for_is_not_reported() -> None:
    frames = [one_above_the_other(0.9, 0.02, likelier_above=False)] * 3
    assert [len(each.id) for each in tracked(frames, least=0)] == [2, 2, 2]
    assert len(tracked(frames, least=0.1)[-1].id) == 1
    assert not len(tracked(frames, least=1)[-1].id)


class Silent(Detector):
    needs, calibration = SensorNeeds(), "pillars"

    def detect(self, view: SensorView, rng: Rng) -> Detections:
        return Detections.empty()


def test_weights_are_those_learned_for_the_detector_of_the_episode() -> None:
    """A score of 0.5 means a real object of one detector, and most likely none of another."""
    chance = dict[str | None, float]()
    for detector in (None, "pillars", "unheard of"):
        policy = CoopFuse()
        policy.begin(AgentSpec("cav_0", "cav", 0.1, calibration=detector), np.random.default_rng(0))
        (found,) = policy.fuse([cars(20.0, score=0.5)])
        chance[detector] = float(found.score[0])
    assert abs(chance["pillars"] - chance[None]) > 0.1 and chance["unheard of"] == chance[None]
    given = CoopFuse(calibration=CALIBRATION, least=0.5)
    given.begin(AgentSpec("cav_0", "cav", 0.1, calibration="pillars"), np.random.default_rng(0))
    assert given.fuse([cars(20.0, score=0.5)])[0].score[0] == chance[None]


def test_an_environment_says_whose_boxes_its_agents_have() -> None:
    for detector, calibration in ((Silent(), "pillars"), ("simulated", None)):
        env = coopsim.parallel_env("crossing", detector=detector, lidar=None)
        assert {spec.calibration for spec in env.agent_specs.values()} == {calibration}
        env.close()

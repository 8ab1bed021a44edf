"""The network of integrated tracking whole: what a fresh one finds, frames in a row, and the rules of tracks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from coopsim.errors import InvalidValueError  # noqa: E402
from coopsim.nn.cooperative.cooperative_net import CooperativeConfig  # noqa: E402
from coopsim.nn.integrated.integrated_net import IntegratedConfig, IntegratedNet  # noqa: E402
from coopsim.nn.integrated.perceiver import TrackRules, updated_tracks  # noqa: E402
from coopsim.nn.queries.instances import UNNUMBERED, Instances  # noqa: E402
from coopsim.tracking.affinity import xiou  # noqa: E402
from coopsim.tracking.cascade import four_stages  # noqa: E402
from coopsim.tracking.lifecycle import HitsAndAge  # noqa: E402
from coopsim.types import BevGrid  # noqa: E402

torch.set_num_threads(1)
GRID = BevGrid((-24.0, 24.0), (-24.0, 24.0), 1.2)
FUSED = torch.rand(8, *GRID.shape, generator=torch.Generator().manual_seed(7))
RULES = TrackRules(four_stages(xiou, 0.4, 0.4, 0.5), HitsAndAge(3, 20, coast=1), 0.5, 8)


def some_net(fresh: bool = False) -> IntegratedNet:
    torch.manual_seed(0)
    cooperative = CooperativeConfig("fcooper", message_channels=3, features=8)
    net = IntegratedNet(IntegratedConfig(cooperative, width=16, heads=2, points=2, decoder_layers=1))
    if not fresh:
        with torch.no_grad():
            for branch in (net.detection, net.prediction):
                for layer in (branch.heads.classes[-1], branch.heads.box[-1]):
                    torch.nn.init.normal_(layer.weight, std=0.1)
            torch.nn.init.normal_(net.encoder.added.weight)
    return net.eval().requires_grad_(False)


def cars(places: list[list[float]], **changes: Any) -> Instances:
    xy = torch.tensor(places, dtype=torch.float32).reshape(-1, 2)
    box = torch.cat([xy, torch.tensor([0.8, 4.5, 1.9, 1.6, 0.0]).expand(len(xy), 5)], dim=1)
    seen = Instances.seen(box, torch.full((len(xy),), 0.8), torch.zeros(len(xy), dtype=torch.int64), 16, 0)
    return replace(seen, **changes)


def test_a_fresh_network_finds_the_peaks_and_moves_tracks_by_their_velocities() -> None:
    net, peaks = some_net(fresh=True), cars([[3.0, 4.0], [-9.0, 2.0]])
    tracks = cars([[0.0, 8.0]], velocity=torch.tensor([[10.0, 0.0]]), number=torch.tensor([5]))
    step = net(FUSED, GRID, peaks, tracks, None, 0.2)
    assert torch.allclose(step.detected.box, peaks.box) and torch.allclose(step.detected.score, peaks.score, atol=1e-4)
    assert torch.allclose(step.predicted.box[0, :2], torch.tensor([2.0, 8.0])) and int(step.predicted.number) == 5
    assert float(step.predicted.score) == pytest.approx(0.8, abs=1e-4)


def test_what_branches_find_depends_on_the_map_and_on_the_features_of_the_frame_before() -> None:
    net, peaks = some_net(), cars([[3.0, 4.0], [-9.0, 2.0]])
    first = net(FUSED, GRID, peaks, net.nothing(), None, 0.0)
    tracks = first.detected
    one = net(FUSED, GRID, peaks, tracks, first.prior, 0.1)
    other = net(FUSED, GRID, peaks, replace(tracks, semantic=tracks.semantic.flip(1)), first.prior, 0.1)
    later = net(FUSED, GRID, peaks, replace(tracks, velocity=torch.zeros(2, 2)), first.prior, 0.4)
    elsewhere = net(FUSED.flip(1), GRID, peaks, tracks, first.prior, 0.1)
    assert torch.equal(one.detected.box, other.detected.box)
    for changed in (other, later, elsewhere):
        assert not torch.allclose(one.predicted.box, changed.predicted.box, atol=1e-4)
    assert not torch.allclose(one.detected.box, elsewhere.detected.box, atol=1e-4)


def test_a_box_that_faces_the_other_way_is_turned_around() -> None:
    net, peaks = some_net(fresh=True), cars([[3.0, 4.0]])
    net.detection.turn.bias.fill_(1.0)
    step = net(FUSED, GRID, peaks, peaks, None, 0.1)
    assert float(step.detected.box[0, 6]) == pytest.approx(torch.pi) and float(step.detected_turn) == pytest.approx(1.0)
    assert float(step.predicted.box[0, 6]) == pytest.approx(0.0, abs=1e-6) and float(step.predicted_turn) < 0


def test_nothing_seen_and_nothing_known_work_and_long_ago_is_forgotten() -> None:
    net = some_net()
    step = net(FUSED, GRID, net.nothing(), net.nothing(), None, 0.0)
    assert len(step.detected) == len(step.predicted) == 0
    late = net(FUSED, GRID, net.nothing(), cars([[1.0, 1.0]]), step.prior, 3.0)
    assert len(late.predicted) == 0


def test_a_network_that_says_no_numbers_leaves_tracks_where_they_were() -> None:
    net = some_net()
    net.prediction.heads.box[-1].bias.fill_(torch.nan)
    step = net(FUSED, GRID, net.nothing(), cars([[1.0, 1.0]]), None, 0.1)
    assert torch.isfinite(step.predicted.box).all() and torch.allclose(step.predicted.box[0, :2], torch.ones(2))


@pytest.mark.parametrize(("sizes", "match"), [({"width": 30}, "divisible by 4"), ({"points": 0}, "points must be")])
def test_wrong_sizes_are_refused(sizes: dict[str, int], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        IntegratedConfig(**sizes)  # type: ignore[arg-type]


def test_pairs_are_where_they_are_detected_and_learn_their_velocities() -> None:
    known = cars([[0.0, 0.0], [20.0, 0.0]], number=torch.tensor([4, 7]), hits=torch.tensor([2, 2]))
    detected = cars([[1.0, 0.0], [9.0, 9.0]], score=torch.tensor([0.6, 0.7]))
    born = torch.tensor([False, True])
    pairs = (np.array([0]), np.array([0]))
    tracks = updated_tracks(known, detected, pairs, born, 0.5)
    assert tracks.number.tolist() == [4, 7, UNNUMBERED]
    assert tracks.hits.tolist() == [3, 2, 1] and tracks.missed.tolist() == [0, 1, 0]
    assert torch.equal(tracks.box[:, :2], torch.tensor([[1.0, 0.0], [20.0, 0.0], [9.0, 9.0]]))
    assert 0 < float(tracks.velocity[0, 0]) <= 2.0 and float(tracks.score[0]) == pytest.approx(0.6)


@pytest.mark.parametrize("detected_rad", [0.2, 0.2 + np.pi])
@pytest.mark.parametrize(("speed_m_s", "expected_rad"), [(10.0, 0.2), (-10.0, 0.2 + np.pi), (0.0, 0.2)])
def test_a_pair_faces_where_it_goes_and_else_as_it_did(
    detected_rad: float, speed_m_s: float, expected_rad: float
) -> None:
    velocity = torch.tensor([[speed_m_s, 0.0]])
    known, detected = cars([[0.0, 0.0]], velocity=velocity), cars([[0.0, 0.0]])
    detected.box[0, 6] = detected_rad
    pair = updated_tracks(known, detected, (np.array([0]), np.array([0])), torch.tensor([False]), 0.1)
    assert np.cos(float(pair.box[0, 6]) - expected_rad) == pytest.approx(1.0)


def test_sure_detections_begin_tracks_and_doubtful_ones_go_on_with_them() -> None:
    tracks, number = RULES.step(cars([]), cars([[0, 0], [9, 0]], score=torch.tensor([0.9, 0.3])), 0.1, 1)
    assert tracks.number.tolist() == [1] and number == 2
    tracks, number = RULES.step(tracks, cars([[0.3, 0]], score=torch.tensor([0.3])), 0.1, number)
    assert tracks.number.tolist() == [1] and tracks.hits.tolist() == [2] and number == 2
    for missed in range(1, 20):
        tracks, number = RULES.step(tracks, cars([]), 0.1, number)
        assert tracks.missed.tolist() == [missed]
        assert RULES.reported(tracks, 1).tolist() == [missed <= 1]
    assert len(RULES.step(tracks, cars([]), 0.1, number)[0]) == 0


def test_a_sure_track_takes_the_detection_before_a_doubtful_one() -> None:
    """The score of the prediction decides: one stage would pair the nearer, doubtful track."""
    predicted = cars([[0.0, 0.0], [1.0, 0.0]], number=torch.tensor([1, 2]), score=torch.tensor([0.2, 0.9]))
    found = cars([[0.2, 0.0]])
    tracks, _ = RULES.step(predicted, found, 0.1, 3)
    assert tracks.number[tracks.missed == 0].tolist() == [2]

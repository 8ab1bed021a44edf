"""What shipped networks learned: the larger errors of poses are, the more they harm; a known delay harms less."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from coopsim.learn.clips.clip import Clip  # noqa: E402
from coopsim.learn.clips.simulated import SimulatedClips  # noqa: E402
from coopsim.learn.clips.world_recipe import WorldRecipe  # noqa: E402
from coopsim.learn.loop.validation import VEHICLES, precision_of  # noqa: E402
from coopsim.learn.losses.fused_losses import fused_features  # noqa: E402
from coopsim.learn.losses.head_losses import head_loss, sum_of  # noqa: E402
from coopsim.learn.samples.cloud_samples import SampleSettings  # noqa: E402
from coopsim.learn.samples.fused_samples import scene_samples  # noqa: E402
from coopsim.learn.tasks.cooperative_task import find_fused, sent_maps  # noqa: E402
from coopsim.learn.weights import load_cooperative, load_detector  # noqa: E402

PLAIN: dict[str, Any] = {"dropout": 0.0, "thinned": 0.0, "mirrored": 0.0, "late": 0.0}
FUSION = "where2comm"

pytestmark = pytest.mark.long  # it says what weights learned, which change only when they are trained anew


@pytest.fixture(scope="module")
def clips() -> list[Clip]:
    """Two scenes, 300 ms apart, in each of some towns that no network was trained in."""
    source = SimulatedClips(WorldRecipe.for_validation(frames=2, dt_s=(0.3,)), 7)
    return [source.clip(number) for number in range(4)]


def samples(clips: Sequence[Clip], **settings: float) -> list[Any]:
    """The second scene of each clip; the same draws of chance for the same settings, but for their size."""
    return [
        scene_samples(clip, np.random.default_rng(number), SampleSettings(**{**PLAIN, **settings}))[-1]
        for number, clip in enumerate(clips)
    ]


def test_the_larger_the_errors_of_poses_the_worse(clips: list[Clip]) -> None:
    torch.set_num_threads(1)
    detector = load_detector("pillars")
    net = load_cooperative(FUSION, detector)
    found = []
    for noise in (0.0, 0.4, 0.8, 1.2):  # the largest of each; half of it on average
        maps = find_fused(detector, net, samples(clips, noise_m=noise, noise_deg=noise))
        found.append(precision_of(maps, VEHICLES, 0.5))
    assert found == sorted(found, reverse=True) and found[0] - found[-1] > 0.1


def test_a_late_message_changes_the_result_and_does_less_harm_if_its_delay_is_told(clips: list[Clip]) -> None:
    torch.set_num_threads(1)
    detector = load_detector("pillars")
    net = load_cooperative(FUSION, detector)
    told, untold, changed = [], [], []
    for late, fresh in zip(samples(clips, late=1.0), samples(clips), strict=True):
        with torch.no_grad():
            maps = [sent_maps(detector, net, each) for each in (late, fresh)]
            for view, same in zip(late.views, fresh.views, strict=True):
                assert (view.delay_s == 0.3).all() and not same.delay_s.any()
                silent = replace(view, delay_s=torch.zeros_like(view.delay_s))
                now = replace(same, grid=view.grid)
                fused = [
                    fused_features(net, sent, seen)[0]
                    for sent, seen in ((maps[0], view), (maps[0], silent), (maps[1], now))
                ]
                losses = [float(sum_of(head_loss(net.head, each, view.targets))) for each in fused]
                told.append(losses[0])
                untold.append(losses[1])
                changed.append(float((fused[0] - fused[2]).abs().max()))
    assert np.median(changed) > 0.1  # where a sender's map does not reach a view, nothing changes
    assert np.mean(told) < np.mean(untold)

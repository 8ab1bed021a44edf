"""Queries under attack: the features of a spare query at a target, or of the queries around it, change.

No norm bounds a reference box: a sender may state any. So for a spoofed object the attacker copies its surest query,
because receivers keep the surest alone, and states the target's box, class and velocity in it. The stated score stays
that of the copied query. The features, which may change by `eps`, make the network surer of the stated class. For a
removal only features change: boxes, classes, velocities and stated scores stay.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from coopsim.attacks.aims import Aim, Goal, Values
from coopsim.geometry.boxes import Boxes3D
from coopsim.interfaces.attack import AttackerView
from coopsim.types import InstanceQueries, Mask
from coopsim.types.features import FAST_M_S

_SAME_WITHIN_M = 3.0
"""Distance between the places of one object in two frames: more than the 2.5 m of a car with 25 m/s in 0.1 s, and less
than the width of a lane."""


class QueryAim(Aim[InstanceQueries]):
    """Queries of which some change in their features. The next frame goes on by the objects' places in the world.

    The network is asked for what the message shows to the victim, whose place the attacker knows from its messages.
    """

    def __init__(self, view: AttackerView, content: InstanceQueries, goal: Goal) -> None:
        self.goal, self._content, self._view = goal, content, view
        if goal.spoof and len(content):
            self._content = _with_spare(content, goal)
        count = len(self._content)
        self.target: Mask = np.arange(count) >= len(content) if goal.spoof else goal.removed(content.boxes)
        self.others, self.boxes = ~self.target, self._content.boxes[self.target]
        self.mask = self.target[:, None] & (np.arange(content.feature.shape[1]) < content.feature.shape[1] - 2)
        self._places_m = self.boxes.transform(view.world_SE3_base).center[:, :2]

    def start(self, last: Any) -> Values:
        start = np.zeros_like(self._content.feature)
        if last is not None:
            places_m, changes = last
            apart_m = np.linalg.norm(self._places_m[:, None] - places_m, axis=2)
            same = (apart_m.min(axis=1) <= _SAME_WITHIN_M)[:, None]
            start[self.target] = np.where(same, changes[apart_m.argmin(axis=1)], np.float32(0.0))
        return start

    def memory(self, change: Values) -> Any:
        return self._places_m, change[self.target]

    def seen(self, change: Any) -> tuple[Any, Any]:
        import torch

        view = self._view
        victim = view.victim(view.against)
        assert victim is not None  # by whose place the goal's was found
        offset_m = view.world_SE3_base.translation - victim.world_SE3_base.translation
        vectors = torch.tensor(self._content.feature) + change
        logits, boxes = view.network.shown(self._content, vectors, view.world_SE3_base.yaw, offset_m)
        if not self.goal.spoof:
            return logits.T, 0.0
        place = boxes.new_tensor(self.goal.box.center[:, :2])
        return logits.T, (boxes[torch.from_numpy(self.target), :2] - place).norm(dim=1).mean()

    def changed(self, change: Values) -> InstanceQueries:
        content = self._content
        rows = np.arange(len(content))
        if self.goal.spoof:  # not at the end, which would tell
            rows = self._view.rng.permutation(rows)
        made = InstanceQueries(
            content.feature + change, content.boxes, content.score, content.label, space=content.space
        )
        return made[rows]


def _with_spare(content: InstanceQueries, goal: Goal) -> InstanceQueries:
    """Return the queries, and behind them a copy of the surest one that states the goal's object."""
    surest = int(np.argmax(content.score))
    vector = np.concatenate([content.feature[surest, :-2], goal.velocity[0] / FAST_M_S])
    return InstanceQueries(
        np.concatenate([content.feature, vector[None]]).astype(np.float32),
        Boxes3D.concatenate([content.boxes, goal.box]),
        np.append(content.score, content.score[surest]),
        np.append(content.label, int(goal.label)),
        space=content.space,
    )

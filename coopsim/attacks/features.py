"""Maps of features under attack: the cells around a target change."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from coopsim.attacks.aims import Aim, Goal, Values
from coopsim.interfaces.attack import AttackerView
from coopsim.types import FeatureMap


class MapAim(Aim[FeatureMap]):
    """A map whose cells around a target change, in all channels. The next frame goes on by the world's cells."""

    def __init__(self, view: AttackerView, content: FeatureMap, goal: Goal) -> None:
        self.goal, self._content, self._network = goal, content, view.network
        own = view.observation.detections.boxes
        self.boxes = goal.box if goal.spoof else own[goal.removed(own)]
        world_m = view.world_SE3_base.translation[:2]
        middles = self.boxes.transform(view.world_SE3_base).center[:, :2] - world_m  # the map has the world's axes
        places = content.grid.cell_centers()
        apart = np.abs(places[:, :, None] - middles).max(axis=3)
        self.target, window = (apart <= content.grid.cell_m).any(axis=2), (apart <= goal.window_m).any(axis=2)
        self.mask, self.others = window[None], window & ~self.target
        self._rows, self._columns = np.nonzero(window)
        # Numbers of the world's cells: they are the same in each frame.
        cells = np.rint((places + world_m) / content.grid.cell_m - 0.5).astype(np.int64)
        self._cells: list[tuple[int, int]] = [(x, y) for x, y in cells[self._rows, self._columns].tolist()]

    def start(self, last: Any) -> Values:
        start, known = np.zeros_like(self._content.values), last or {}
        for row, column, cell in zip(self._rows, self._columns, self._cells, strict=True):
            start[:, row, column] = known.get(cell, 0.0)
        return start

    def memory(self, change: Values) -> Any:
        return dict(zip(self._cells, change[:, self._rows, self._columns].T, strict=True))

    def seen(self, change: Any) -> tuple[Any, Any]:
        import torch

        return self._network.heat(torch.tensor(self._content.values) + change), 0.0

    def changed(self, change: Values) -> FeatureMap:
        sure = self._content.confidence
        if sure is not None:  # a cell without confidence may not be sent
            sure = np.where(self.target, np.float32(self.goal.spoof), sure)
        return replace(self._content, values=self._content.values + change, confidence=sure)

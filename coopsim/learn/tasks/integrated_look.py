"""A look at what integrated detection and tracking finds at held-out places."""

from __future__ import annotations

import numpy as np
import torch

from coopsim.learn.losses.integrated_losses import TaughtFrame
from coopsim.learn.losses.overlap_losses import xiou_of_pairs
from coopsim.learn.tasks.query_look import SURE, QueryLook
from coopsim.nn.queries.query_net import QueryStep


class IntegratedLook:
    """What the detection branch finds, and how well the prediction branch finds it again, over frames."""

    def __init__(self) -> None:
        self._detected = QueryLook()
        self._xiou: list[float] = []
        self._seen: list[float] = []
        self._hidden: list[float] = []

    def add(self, taught: TaughtFrame) -> None:
        """Count a frame of one receiver."""
        step, truth, same = taught.step, taught.truth, taught.same
        self._detected.add(QueryStep(step.detected, step.detected_logits, []), truth)
        with torch.no_grad():
            xiou = xiou_of_pairs(step.predicted.box[same.rows], truth.box[same.objects])
        self._xiou += xiou.tolist()
        sure, shown = (step.predicted.score[same.rows] >= SURE).float(), truth.shown[same.objects]
        self._seen += sure[shown].tolist()
        self._hidden += sure[~shown].tolist()

    def values(self) -> dict[str, float]:
        """Return what was detected; the mean XIOU of predictions; and the shares of sure ones, seen and hidden."""
        predicted = {"predicted XIOU": self._xiou, "sure if seen": self._seen, "sure if hidden": self._hidden}
        means = {name: round(float(np.mean(each)), 4) if each else 0.0 for name, each in predicted.items()}
        return self._detected.values() | means

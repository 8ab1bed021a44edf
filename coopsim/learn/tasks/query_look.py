"""A look at what a network of instance queries finds at held-out places."""

from __future__ import annotations

from collections import Counter

import numpy as np

from coopsim.learn.losses.query_losses import TrueObjects, labelled
from coopsim.nn.queries.instance_pairs import sure_pairs
from coopsim.nn.queries.query_net import QueryStep, kept_instances

SURE = 0.3
"""Instances with a smaller score do not count as found."""


class QueryLook:
    """Counts of what was found, and what there is, over frames."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._place_m: list[float] = []
        self._speed_m_s: list[float] = []

    def add(self, step: QueryStep, truth: TrueObjects) -> None:
        """Count a frame of one agent."""
        found = kept_instances(step.instances)
        found = found[found.score >= SURE]
        labels = labelled(found, truth)
        shown = truth.shown[labels.objects]
        rows, objects = labels.rows[shown], labels.objects[shown]
        ignored = len(labels.rows) - len(rows)
        self._counts += Counter(there=int(truth.shown.sum()), right=len(rows), found=len(found) - ignored)
        self._place_m += (found.box[rows, :2] - truth.box[objects, :2]).norm(dim=1).tolist()
        self._speed_m_s += (found.velocity[rows] - truth.velocity[objects]).norm(dim=1).tolist()
        for each in step.compared:
            mine = labelled(each.own, truth).by_row(len(each.own)).numpy()
            theirs = labelled(each.others, truth).by_row(len(each.others)).numpy()
            pairs = sure_pairs(each.logits, 0.5)
            right = (mine[pairs[0]] == theirs[pairs[1]]) & (mine[pairs[0]] >= 0)
            both = len(np.intersect1d(mine[mine >= 0], theirs[theirs >= 0]))
            self._counts += Counter(pairs=len(pairs[0]), pairs_right=int(right.sum()), pairs_there=both)

    def values(self) -> dict[str, float]:
        """Return what was found, as shares of what is there, mean errors, and the same of pairs of two agents."""
        count = self._counts
        values = {
            "recall": _share(count["right"], count["there"]),
            "precision": _share(count["right"], count["found"]),
            "place error (m)": float(np.mean(self._place_m)) if self._place_m else 0.0,
            "velocity error (m/s)": float(np.mean(self._speed_m_s)) if self._speed_m_s else 0.0,
        }
        if count["pairs_there"]:
            values["pairs recall"] = _share(count["pairs_right"], count["pairs_there"])
            values["pairs precision"] = _share(count["pairs_right"], count["pairs"])
        return {name: round(value, 4) for name, value in values.items()}


def _share(part: int, whole: int) -> float:
    return part / whole if whole else 0.0

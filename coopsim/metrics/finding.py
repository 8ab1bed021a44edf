"""Metrics of finding senders that lie, by the receivers' trust. None where a policy has no defence."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.metrics.metric import Metric, PoolMetric
from coopsim.metrics.trust_log import LEAST_TRUST, TrustLog
from coopsim.types import Mask


def area_under_curve(doubt: Floats, lies: Mask) -> float:
    """Return the chance that a liar is doubted more than an honest sender, ties counted half; NaN without both.

    It is the area under the curve of true over false positive rates (Hanley and McNeil, 1982).
    """
    liars, honest = int(lies.sum()), int((~lies).sum())
    if not liars or not honest:
        return math.nan
    _, inverse, counts = np.unique(doubt, return_inverse=True, return_counts=True)
    rank = (np.cumsum(counts) - (counts - 1) / 2)[inverse]
    return float((rank[lies].sum() - liars * (liars + 1) / 2) / (liars * honest))


_RECORDER = "trust"


def _metric(
    of: Callable[[Sequence[TrustLog]], float], meaning: str, unit: str = "%", form: str = ".1f", less: bool = False
) -> Metric:
    """Return the metric that a function computes from the logs of trust."""
    return PoolMetric(
        lambda pool: of(pool.records[_RECORDER]), meaning, unit, form, less, whole_only=True, recorders=(_RECORDER,)
    )


def _columns(logs: Sequence[TrustLog]) -> tuple[Floats, Mask]:
    """Return trust and flag of lying of all frames and senders."""
    trust = np.array([value for log in logs for value in log.trust])
    return trust, np.array([lie for log in logs for lie in log.lies], dtype=np.bool_)


def _doubted(lying: bool, logs: Sequence[TrustLog]) -> float:
    trust, lies = _columns(logs)
    of_kind = trust[lies == lying]
    return 100.0 * float((of_kind < LEAST_TRUST).mean()) if len(of_kind) else math.nan


def _curve(logs: Sequence[TrustLog]) -> float:
    trust, lies = _columns(logs)
    return 100.0 * area_under_curve(1 - trust, lies)


def _found(logs: Sequence[TrustLog]) -> float:
    found = [math.isfinite(each) for log in logs for each in log.found_after.values()]
    return 100.0 * float(np.mean(found)) if found else math.nan


def _until_found(logs: Sequence[TrustLog]) -> float:
    frames = [each for log in logs for each in log.found_after.values() if math.isfinite(each)]
    return float(np.mean(frames)) if frames else math.nan


def _passes(logs: Sequence[TrustLog]) -> float:
    return sum(log.passes for log in logs) / sum(log.frames for log in logs)


FINDING: Mapping[str, Metric] = {
    "attacker_TPR": _metric(partial(_doubted, True), "frames of lying senders in which they are not believed"),
    "attacker_FPR": _metric(
        partial(_doubted, False), "frames of honest senders in which they are not believed", less=True
    ),
    "attacker_AUC": _metric(_curve, "chance that a lying sender is trusted less than an honest one"),
    "attackers_found": _metric(_found, "lying senders that were not believed at least once"),
    "frames_until_found": _metric(
        _until_found, "frames from the first lie until its sender is not believed, if ever", "frames", ".1f", True
    ),
    "defense_passes": _metric(_passes, "passes of the policy that a defense asks for in a frame", "", ".2f", True),
}
"""The metrics of finding attackers by name, in the order of tables."""

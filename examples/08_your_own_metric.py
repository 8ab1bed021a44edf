"""Plug in a custom metric with one method. Its value is in every score, table, report and stored result."""

import numpy as np

import coopsim
from coopsim.metrics import METRICS, LogPool, Metric
from coopsim.testing import check_metric


@METRICS.register("delay")
class FirstTrackDelay(Metric):
    """Delay of an object's first track; an object without any track counts with its whole life."""

    meaning, unit, less_is_better = "mean frames from an object's first box to its first track", "frames", True

    def value(self, pool: LogPool) -> float | None:
        frames = []
        for log in pool.logs:
            tracked = log.matches.track_of >= 0  # a row per ground-truth box, in order of time
            for number in np.unique(log.truth_id):
                life = tracked[log.truth_id == number]
                frames.append(life.argmax() if life.any() else len(life))
        return float(np.mean(frames)) if frames else None


check_metric("delay")
for policy in ("no_fusion", "late_fusion"):
    score = coopsim.evaluate(policy, "crossing", seed=1, max_cycles=50).score
    print(f"{policy:>12}: {score['delay']:.1f} frames without a track; nearby {score.bands['0-30 m']['delay']:.1f}")

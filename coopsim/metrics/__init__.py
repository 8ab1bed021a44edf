"""Tracking and detection metrics: from reports and ground truth to scores.

Reported tracks and the truth of each frame come in (`evaluator`), are kept as ids, scores and candidate pairs
(`track_log`), and go out as a `score` with a value for every registered `metric`. Start with `built_in`, the table of
all metrics; each family is computed in a file of its own.
"""

from coopsim.metrics.average_precision import average_precision_of
from coopsim.metrics.drive_events import DriveEvents
from coopsim.metrics.drive_log import Drive, DriveFrame, DriveLog
from coopsim.metrics.evaluator import Evaluator, FrameCounts
from coopsim.metrics.log_pool import LogPool
from coopsim.metrics.metric import METRICS, Metric, PoolMetric, SweepMetric
from coopsim.metrics.score import Score, summarize
from coopsim.metrics.track_log import FlatLog, TrackLog

__all__ = [
    "METRICS",
    "Drive",
    "DriveEvents",
    "DriveFrame",
    "DriveLog",
    "Evaluator",
    "FlatLog",
    "FrameCounts",
    "LogPool",
    "Metric",
    "PoolMetric",
    "Score",
    "SweepMetric",
    "TrackLog",
    "average_precision_of",
    "summarize",
]

"""Tracking and detection metrics: from logs of reports and ground truth to scores."""

from coopsim.metrics.average_precision import average_precision_of
from coopsim.metrics.evaluator import Evaluator, FrameCounts
from coopsim.metrics.log_pool import LogPool
from coopsim.metrics.metric import METRICS, Metric, SweepMetric
from coopsim.metrics.score import Score, summarize
from coopsim.metrics.track_log import FlatLog, TrackLog

__all__ = [
    "METRICS",
    "Evaluator",
    "FlatLog",
    "FrameCounts",
    "LogPool",
    "Metric",
    "Score",
    "SweepMetric",
    "TrackLog",
    "average_precision_of",
    "summarize",
]

"""Conformance checks for users' plug-ins; each raises `AssertionError` with the violation."""

from coopsim.testing.codec import check_codec
from coopsim.testing.detector import check_detector
from coopsim.testing.embedder import check_embedder
from coopsim.testing.metric import check_metric
from coopsim.testing.policy import check_policy
from coopsim.testing.uplink import check_uplink

__all__ = ["check_codec", "check_detector", "check_embedder", "check_metric", "check_policy", "check_uplink"]

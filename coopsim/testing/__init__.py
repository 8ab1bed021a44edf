"""Conformance checks for users' plug-ins; each raises `AssertionError` with the violation."""

from coopsim.testing.codec_checks import check_codec
from coopsim.testing.detector_checks import check_detector
from coopsim.testing.embedder_checks import check_embedder
from coopsim.testing.fusion_checks import check_fusion
from coopsim.testing.metric_checks import check_metric
from coopsim.testing.policy_checks import check_policy
from coopsim.testing.uplink_checks import check_uplink

__all__ = [
    "check_codec",
    "check_detector",
    "check_embedder",
    "check_fusion",
    "check_metric",
    "check_policy",
    "check_uplink",
]

"""Conformance checks for users' plug-ins; each raises `AssertionError` with the violation."""

from coopsim.testing.fusion_checks import check_fusion
from coopsim.testing.message_checks import check_codec, check_uplink
from coopsim.testing.metric_checks import check_metric
from coopsim.testing.perception_checks import check_detector, check_embedder
from coopsim.testing.policy_checks import check_policy

__all__ = [
    "check_codec",
    "check_detector",
    "check_embedder",
    "check_fusion",
    "check_metric",
    "check_policy",
    "check_uplink",
]

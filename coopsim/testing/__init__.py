"""Conformance checks for what users plug in; each raises `AssertionError` with what is wrong."""

from coopsim.testing.detector import check_detector
from coopsim.testing.embedder import check_embedder
from coopsim.testing.metric import check_metric

__all__ = ["check_detector", "check_embedder", "check_metric"]

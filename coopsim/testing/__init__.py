"""Conformance checks for what users plug in; each raises `AssertionError` with what is wrong."""

from coopsim.testing.metric import check_metric

__all__ = ["check_metric"]

"""Cooperative-perception policies, one short file per documented method. Importing registers them."""

from coopsim.agents import ab3dmot, late_fusion, no_fusion, sequential_kf
from coopsim.agents.base import Policy

__all__ = ["Policy", "ab3dmot", "late_fusion", "no_fusion", "sequential_kf"]

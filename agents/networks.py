"""The policies with networks. Importing registers them; none loads torch before it is made."""

from coopsim.agents import appearance, early_fusion, maps, queries, vic_integrated

__all__ = ["appearance", "early_fusion", "maps", "queries", "vic_integrated"]

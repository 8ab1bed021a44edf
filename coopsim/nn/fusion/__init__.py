"""Fusions of several agents' feature maps, one file each. Importing registers them in `FUSIONS`."""

from coopsim.nn.fusion.attfuse import AttFuse
from coopsim.nn.fusion.fcooper import FCooper
from coopsim.nn.fusion.feature_fusion import FUSIONS, FeatureFusion, Foreground, FusionContext, as_batch
from coopsim.nn.fusion.pyramid import Pyramid
from coopsim.nn.fusion.where2comm import Where2comm

__all__ = [
    "FUSIONS",
    "AttFuse",
    "FCooper",
    "FeatureFusion",
    "Foreground",
    "FusionContext",
    "Pyramid",
    "Where2comm",
    "as_batch",
]

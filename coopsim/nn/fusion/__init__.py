"""Fusions of feature maps, each in a file of its own. They are found by name in `FUSIONS`."""

from coopsim.nn.fusion.attfuse import AttFuse
from coopsim.nn.fusion.fcooper import FCooper
from coopsim.nn.fusion.feature_fusion import FUSIONS, FeatureFusion, Foreground, FusionContext

__all__ = ["FUSIONS", "AttFuse", "FCooper", "FeatureFusion", "Foreground", "FusionContext"]

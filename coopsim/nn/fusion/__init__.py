"""Fusions of several agents' feature maps, one file each. Importing registers them in `FUSIONS`.

In: the receiver's map and the others', warped and expanded. Out: one map. Start reading at `feature_fusion`.
"""

from coopsim.nn.fusion.attfuse import AttFuse
from coopsim.nn.fusion.cobevt import CoBEVT
from coopsim.nn.fusion.disconet import DiscoNet
from coopsim.nn.fusion.fcooper import FCooper
from coopsim.nn.fusion.feature_fusion import FUSIONS, FeatureFusion, Foreground, FusionContext, as_batch
from coopsim.nn.fusion.ff_tracking import FFTracking
from coopsim.nn.fusion.gsaf import GSAF
from coopsim.nn.fusion.pyramid import Pyramid
from coopsim.nn.fusion.v2vnet import V2VNet
from coopsim.nn.fusion.v2x_vit import V2XViT
from coopsim.nn.fusion.where2comm import Where2comm

__all__ = [
    "FUSIONS",
    "GSAF",
    "AttFuse",
    "CoBEVT",
    "DiscoNet",
    "FCooper",
    "FFTracking",
    "FeatureFusion",
    "Foreground",
    "FusionContext",
    "Pyramid",
    "V2VNet",
    "V2XViT",
    "Where2comm",
    "as_batch",
]

"""Train a fusion of your own on the shipped encoder: four steps, or, with the argument 1500, for ten minutes."""

import sys

try:
    import torch
    from torch import Tensor, nn
except ImportError:
    print("this example needs torch: pip install 'coopsim[learn]'")
    raise SystemExit(0) from None

import coopsim
from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.learn.recipe import find_recipe
from coopsim.learn.train import train
from coopsim.nn.fusion import FUSIONS, FeatureFusion, FusionContext
from coopsim.testing import check_fusion


@FUSIONS.register("gated")
class GatedSum(FeatureFusion):
    """Add the others' features, weighted by a gate computed from both maps."""

    def __init__(self, features: int = 64) -> None:
        super().__init__()
        self.gate = nn.Conv2d(2 * features, features, 1)

    def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        both = torch.cat([own.expand_as(others), others], dim=1)
        gate = torch.sigmoid(self.gate(both)) * mask[:, None]
        return own + (gate * others).sum(dim=0)


check_fusion(GatedSum)
steps = int(sys.argv[1]) if len(sys.argv) > 1 else 4
recipe = find_recipe("attfuse").changed(name="gated", steps=steps, **{"network.fusion": "gated"})
if steps < 100:  # to see that it runs
    recipe = recipe.changed(block=1, validate_every=0, **{"world.frames": 2, "world.cars": [2, 2]})
weights = train(recipe, f"gated-{steps}", show=lambda now: print(f"step {now.step}: loss {now.losses['loss']:.2f}"))

options = {"seed": 0, "lidar": "HDL-32E", "max_cycles": 3 if steps < 100 else 100}
for policy, detector in ((LearnedFusion(weights=str(weights)), "none"), ("no_fusion", "pillars")):
    score = coopsim.evaluate(policy, "crossing", detector=detector, **options).score
    print(f"{policy if isinstance(policy, str) else 'gated'}: HOTA {score['HOTA']:.1f}, recall {score['recall']:.1f} %")

"""White-box attacks on maps of features: `fgsm`, `bim`, `pgd` and `cw`, through the network that receivers run.

An attacker with the weights changes its own message so that the network sees an object at a target, or none. The
change is at most `eps` in each number (L-infinity), and only around the target. The loss is the network's heat there,
as the message alone shows it: the attacker does not know the receivers' own maps. torch is loaded when an attack acts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from coopsim.attacks.attack import ATTACKS, AttackerView
from coopsim.attacks.ghost import PlacedClaim
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice, require_count, require_positive
from coopsim.types import BevGrid, FeatureMap, Mask
from coopsim.types.taxonomy import ObjectClass

Values = NDArray[np.float32]

GOALS, KNOWN = ("spoof", "remove"), ("nothing", "agreement")


@dataclass(kw_only=True)
class FeatureAttack(PlacedClaim):
    """A change of features by the gradient of the receivers' network.

    Attributes:
        goal: "spoof" (an object before the victim, as `ghost` places it) or "remove" (the objects that the attacker
            detects within 20 m of that place).
        eps: largest change of a number. ROBOSAC takes 0.5, MADE 0.05 to 0.5.
        steps: number of gradient steps in a frame; each frame goes on from the last one's change.
        window_m: half the edge of the square around a target in which numbers are changed.
        knows: "nothing", or "agreement": the attacker knows that receivers compare what it sends with what others see,
            and so keeps the heat outside of the target as it was.
    """

    goal: str = "spoof"
    eps: float = 0.5
    steps: int = 10
    window_m: float = 5.0
    knows: str = "nothing"
    knowledge: ClassVar[str] = "weights"
    contents: ClassVar[tuple[str, ...]] = ("features",)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice("goal", self.goal, GOALS)
        require_choice("knows", self.knows, KNOWN)
        require_positive(eps=self.eps, window_m=self.window_m)
        require_count(1, 1000, steps=self.steps)
        self._change: dict[tuple[int, int], Values] = {}  # by cell of the world, of the last frame

    def encode(self, view: AttackerView, content: FeatureMap) -> FeatureMap:
        placed = self.placed(view)
        if placed is None:
            return content
        number, boxes, _ = placed
        if self.goal == "remove":
            own = view.observation.detections.boxes
            boxes = own[np.hypot(*(own.center[:, :2] - boxes.center[0, :2]).T) <= _REMOVED_WITHIN_M]
        if not len(boxes):
            return content
        if self.goal == "remove":
            view.deny(boxes)
        else:
            view.claim(np.array([number]), boxes)
        target, window = self._cells(view, content.grid, boxes)
        if not target.any():
            return content
        return self._changed(view, content, target, window)

    def optimized(self, loss: Any, start: Any, mask: Any, rng: np.random.Generator) -> Any:
        """Return a change (C, H, W) within `eps` that lessens a differentiable `loss` of it, from a `start`."""
        raise NotImplementedError

    def _cells(self, view: AttackerView, grid: BevGrid, boxes: Boxes3D) -> tuple[Mask, Mask]:
        """Return the cells (H, W) of the targets and of the windows around them; the map has the world's axes."""
        world = boxes.transform(view.world_SE3_base).center[:, :2] - view.world_SE3_base.translation[:2]
        apart = np.abs(grid.cell_centers()[:, :, None] - world).max(axis=3)
        return (apart <= grid.cell_m).any(axis=2), (apart <= self.window_m).any(axis=2)

    def _changed(self, view: AttackerView, content: FeatureMap, target: Mask, window: Mask) -> FeatureMap:
        import torch

        honest = torch.tensor(content.values)
        mask, goal = torch.from_numpy(window)[None], torch.from_numpy(target)
        sign = 1.0 if self.goal == "spoof" else -1.0
        with torch.no_grad():
            before = view.network.heat(honest)

        def loss(change: Any) -> Any:
            heat = view.network.heat(honest + change * mask)
            wanted = heat[int(ObjectClass.CAR)][goal] if self.goal == "spoof" else heat.amax(0)[goal]
            others = ((heat - before)[:, mask[0] & ~goal] ** 2).mean() if self.knows == "agreement" else 0.0
            return -sign * wanted.mean() + others

        rows, columns = np.nonzero(window)
        cells = _world_cells(view, content.grid)[rows, columns].tolist()
        start = np.zeros_like(content.values)
        for row, column, (x, y) in zip(rows, columns, cells, strict=True):
            start[:, row, column] = self._change.get((x, y), 0.0)
        change = self.optimized(loss, torch.from_numpy(start), mask, view.rng) * mask
        found = change.detach().numpy().astype(np.float32)
        self._change = {(x, y): found[:, row, column] for row, column, (x, y) in zip(rows, columns, cells, strict=True)}
        sure = content.confidence
        if sure is not None:  # a cell without confidence may not be sent
            sure = np.where(target, np.float32(self.goal == "spoof"), sure)
        return replace(content, values=content.values + found, confidence=sure)


_REMOVED_WITHIN_M = 20.0
"""Distance from the target within which objects are removed: about two lanes and four lengths of a car."""


def _world_cells(view: AttackerView, grid: BevGrid) -> Floats:
    """Return the numbers (H, W, 2) of the world's cells that a map's cells are: they are the same in each frame."""
    place = grid.cell_centers() + view.world_SE3_base.translation[:2]
    cells: Floats = np.rint(place / grid.cell_m - 0.5).astype(np.int64)
    return cells


@ATTACKS.register("fgsm")
@dataclass(kw_only=True)
class Fgsm(FeatureAttack):
    """Take one step of `eps` along the gradient's sign (Goodfellow et al., 2015, section 4); `steps` has no effect."""

    def optimized(self, loss: Any, start: Any, mask: Any, rng: np.random.Generator) -> Any:
        return _descended(loss, 0 * start, self.eps, self.eps, 1)


@ATTACKS.register("bim")
@dataclass(kw_only=True)
class Bim(FeatureAttack):
    """Take `steps` steps of eps / steps along the gradient's sign (Kurakin et al., 2017, section 2.2)."""

    def optimized(self, loss: Any, start: Any, mask: Any, rng: np.random.Generator) -> Any:
        return _descended(loss, start, self.eps, self.eps / self.steps, self.steps)


@ATTACKS.register("pgd")
@dataclass(kw_only=True)
class Pgd(FeatureAttack):
    """Take `steps` steps of 2.5 eps / steps, projected, first from a random start (Madry et al., 2018, appendix)."""

    def optimized(self, loss: Any, start: Any, mask: Any, rng: np.random.Generator) -> Any:
        import torch

        if not start.any():
            drawn = rng.uniform(-self.eps, self.eps, tuple(start.shape)).astype(np.float32)
            start = torch.from_numpy(drawn) * mask
        return _descended(loss, start, self.eps, 2.5 * self.eps / self.steps, self.steps)


@ATTACKS.register("cw")
@dataclass(kw_only=True)
class CarliniWagner(FeatureAttack):
    """Minimize the squared change and `weight` times the loss by Adam (Carlini and Wagner, 2017, section V), in `eps`.

    Attributes:
        weight: factor on the loss, c in the paper.
    """

    weight: float = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(weight=self.weight)

    def optimized(self, loss: Any, start: Any, mask: Any, rng: np.random.Generator) -> Any:
        import torch

        change = start.clone().requires_grad_()
        adam = torch.optim.Adam([change], lr=self.eps / 5)
        for _ in range(self.steps):
            adam.zero_grad()
            (((change * mask) ** 2).sum() + self.weight * loss(change)).backward()
            adam.step()
            with torch.no_grad():
                change.clamp_(-self.eps, self.eps)
        return change.detach()


def _descended(loss: Any, start: Any, eps: float, step: float, steps: int) -> Any:
    """Return the change after `steps` steps along the sign of the loss's gradient, each kept within `eps`."""
    change = start.clone()
    for _ in range(steps):
        change.requires_grad_()
        (gradient,) = _torch().autograd.grad(loss(change), change)
        change = (change.detach() - step * gradient.sign()).clamp(-eps, eps)
    return change


def _torch() -> Any:
    import torch

    return torch

"""White-box attacks by gradients: `fgsm`, `bim`, `pgd` and `cw`, through the network that receivers run.

An attacker with the weights changes numbers of its own message so that the network sees an object at a target, or none.
The change is at most `eps` in each number (L-infinity). The loss is the network's heat or score there, as the message
alone shows it: the attacker does not know what receivers see themselves. An `Aim` says what of a message may change and
what the network makes of it: `features.py` for maps, `queries.py` for queries. torch is loaded when an attack acts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from coopsim.attacks.aims import Aim, Goal
from coopsim.attacks.features import MapAim
from coopsim.attacks.ghost import PlacedClaim
from coopsim.attacks.queries import QueryAim
from coopsim.interfaces.attack import ATTACKS, AttackerView
from coopsim.support.checks import require_choice, require_count, require_positive
from coopsim.types import FeatureMap, InstanceQueries
from coopsim.types.taxonomy import ObjectClass

Content = FeatureMap | InstanceQueries

GOALS, KNOWN = ("spoof", "remove"), ("nothing", "agreement")


@dataclass(kw_only=True)
class GradientAttack(PlacedClaim):
    """A change of features or queries by the gradient of the receivers' network.

    Attributes:
        goal: "spoof" (an object before the victim, as `ghost` places it) or "remove" (the objects within 20 m of that
            place which the attacker detects, or sends as queries).
        eps: largest change of a number. ROBOSAC takes 0.5, MADE 0.05 to 0.5.
        steps: number of gradient steps in a frame; each frame goes on from the last one's change.
        window_m: half the edge of the square around a target in which numbers of a map are changed.
        knows: "nothing", or "agreement": the attacker knows that receivers compare what it sends with what others see,
            and so keeps the heat outside of the target as it was. Queries refuse it: they hardly show in each other.
    """

    goal: str = "spoof"
    eps: float = 0.5
    steps: int = 10
    window_m: float = 5.0
    knows: str = "nothing"
    knowledge: ClassVar[str] = "weights"
    contents: ClassVar[tuple[str, ...]] = ("features", "queries")

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice("goal", self.goal, GOALS)
        require_choice("knows", self.knows, KNOWN)
        require_positive(eps=self.eps, window_m=self.window_m)
        require_count(1, 1000, steps=self.steps)
        self._last: Any = None  # the last frame's change, as an aim remembers it

    def accepted(self) -> tuple[str, ...]:
        return ("features",) if self.knows == "agreement" else super().accepted()

    def encode(self, view: AttackerView, content: Content) -> Content:
        placed = self.placed(view)
        if placed is None:
            return content
        number, box, velocity = placed
        goal = Goal(self.goal == "spoof", box, velocity, ObjectClass[self.label.upper()], self.window_m)
        aim = MapAim(view, content, goal) if isinstance(content, FeatureMap) else QueryAim(view, content, goal)
        if not len(aim.boxes):
            return content
        if goal.spoof:
            view.claim(np.array([number]), aim.boxes)
        else:
            view.deny(aim.boxes)
        return self._changed(view, aim) if aim.target.any() else content

    def optimized(self, loss: Any, start: Any, mask: Any, rng: np.random.Generator) -> Any:
        """Return a change within `eps` that lessens a differentiable `loss` of it, from a `start`, where `mask` is."""
        raise NotImplementedError

    def _changed(self, view: AttackerView, aim: Aim[Content]) -> Content:
        import torch

        mask, target, others = (torch.from_numpy(each) for each in (aim.mask, aim.target, aim.others))
        sign = 1.0 if aim.goal.spoof else -1.0
        start = torch.from_numpy(aim.start(self._last))
        with torch.no_grad():
            before, _ = aim.seen(0 * start)

        def loss(change: Any) -> Any:
            heat, beside_m = aim.seen(change * mask)
            wanted = heat[int(aim.goal.label)][target] if aim.goal.spoof else heat.amax(0)[target]
            apart: Any = 0.0
            if self.knows == "agreement" and others.any():
                apart = ((heat - before)[:, others] ** 2).mean()
            return -sign * wanted.mean() + beside_m + apart

        found = (self.optimized(loss, start, mask, view.rng) * mask).detach().numpy().astype(np.float32)
        self._last = aim.memory(found)
        return aim.changed(found)


@ATTACKS.register("fgsm")
@dataclass(kw_only=True)
class Fgsm(GradientAttack):
    """Take one step of `eps` along the gradient's sign (Goodfellow et al., 2015, section 4); `steps` has no effect."""

    def optimized(self, loss: Any, start: Any, mask: Any, rng: np.random.Generator) -> Any:
        return _descended(loss, 0 * start, self.eps, self.eps, 1)


@ATTACKS.register("bim")
@dataclass(kw_only=True)
class Bim(GradientAttack):
    """Take `steps` steps of eps / steps along the gradient's sign (Kurakin et al., 2017, section 2.2)."""

    def optimized(self, loss: Any, start: Any, mask: Any, rng: np.random.Generator) -> Any:
        return _descended(loss, start, self.eps, self.eps / self.steps, self.steps)


@ATTACKS.register("pgd")
@dataclass(kw_only=True)
class Pgd(GradientAttack):
    """Take `steps` steps of 2.5 eps / steps, projected, first from a random start (Madry et al., 2018, appendix)."""

    def optimized(self, loss: Any, start: Any, mask: Any, rng: np.random.Generator) -> Any:
        import torch

        if not start.any():
            drawn = rng.uniform(-self.eps, self.eps, tuple(start.shape)).astype(np.float32)
            start = torch.from_numpy(drawn) * mask
        return _descended(loss, start, self.eps, 2.5 * self.eps / self.steps, self.steps)


@ATTACKS.register("cw")
@dataclass(kw_only=True)
class CarliniWagner(GradientAttack):
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

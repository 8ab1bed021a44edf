"""V2VNet: agents as nodes of a graph, which send each other messages and remember them in a convolutional GRU (Wang et
al., "V2VNet: Vehicle-to-Vehicle Communication for Joint Perception and Prediction", ECCV 2020).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from coopsim.nn.fusion.feature_fusion import FUSIONS, FeatureFusion, FusionContext, as_batch, start_as_zeros
from coopsim.support.checks import require_choice, require_count

_ROUNDS = {"small": 1, "reference": 3}


@FUSIONS.register("v2vnet")
class V2VNet(FeatureFusion):
    """Fuse by rounds of messages between all agents (section 3.3, algorithm 1).

    The state h_i of agent i begins as its features. In each round, with j any agent but i, valid in a cell,

        m_ji = relu(conv([h_j ; h_i])),    m_i = mean_j m_ji,    h_i <- GRU(h_i, m_i)

    where nobody but i is valid h_i stays. After the last one, out = h_0 + MLP(h_0). In the last round only the receiver
    is computed.

    The published code averages over all agents, i itself and those not valid among them, and hides from the GRU in each
    call what came before; here i hears the others alone, and the state is what it fuses. The GRU's candidate ends in a
    ReLU, not in tanh, since the state is features, and its weights start so that the first state of i is half its own
    features, half the mean of the others'. The compensation of delays is that of the cooperative network.

    Args:
        features: number of channels.
        size: "small", of one round, or "reference", of three.
        rounds: their number; None: by the size.

    Raises:
        InvalidValueError: a count is not accepted.
        UnknownNameError: there is no such size.
    """

    def __init__(self, features: int = 64, *, size: str = "small", rounds: int | None = None) -> None:
        super().__init__(features)
        require_choice("size", size, _ROUNDS)
        self.rounds = _ROUNDS[size] if rounds is None else rounds
        require_count(1, 16, rounds=self.rounds)
        self.send = nn.Conv2d(features, features, 3, padding=1, bias=False)
        self.hear = nn.Conv2d(features, features, 3, padding=1)
        self.memory = ConvGRU(features)
        self.read = nn.Sequential(nn.Conv2d(features, features, 1), nn.ReLU(), nn.Conv2d(features, features, 1))
        _lean_on(self.send.weight)
        with torch.no_grad():
            self.hear.weight.mul_(_FAINT)
        start_as_zeros(self.read[-1])

    def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse; see `FeatureFusion.forward`."""
        valid = torch.cat([own_mask[None], mask])[:, None]
        states = [as_batch(own), *torch.split(others * mask[:, None].to(others.dtype), 1)]
        for number in range(self.rounds):
            last = number == self.rounds - 1
            states = self._round(states, valid.to(own.dtype), 1 if last else len(states))
        fused = states[0] + self.read(states[0])
        return torch.where(mask.any(0), fused[0], own)

    def _round(self, states: list[Tensor], valid: Tensor, nodes: int) -> list[Tensor]:
        """Return the new states (1, C, H, W) of the first `nodes` agents."""
        sent = [self.send(state) for state in states] if nodes > 1 else [None, *map(self.send, states[1:])]
        found = []
        for i, state in enumerate(states[:nodes]):
            heard, total = self.hear(state), torch.zeros_like(state)
            for j, message in enumerate(sent):
                if j != i:
                    total = torch.addcmul(total, torch.relu(message + heard), valid[j])
            count = valid.sum(0) - valid[i]
            found.append(torch.where(count > 0, self.memory(state, total / count.clamp_min(1)), state))
        return found


class ConvGRU(nn.Module):
    """Gated recurrent unit whose layers are 3 x 3 convolutions (Ballas et al., ICLR 2016).

    With z and r of the state h and the input m, h <- (1 - z) h + z relu(conv([r h ; m])).
    """

    def __init__(self, features: int) -> None:
        super().__init__()
        self.gates = nn.Conv2d(2 * features, 2 * features, 3, padding=1)
        self.candidate = nn.Conv2d(2 * features, features, 3, padding=1)
        _lean_on(self.candidate.weight, features)
        with torch.no_grad():
            self.gates.weight.mul_(_FAINT)

    def forward(self, state: Tensor, given: Tensor) -> Tensor:
        """Return the new state, (B, C, H, W) as state and input."""
        update, reset = self.gates(torch.cat([state, given], 1)).sigmoid().chunk(2, 1)
        candidate = self.candidate(torch.cat([reset * state, given], 1)).relu()
        return torch.lerp(state.to(candidate.dtype), candidate, update)


_FAINT = 0.1


def _lean_on(weights: Tensor, first: int = 0) -> None:
    """Let a convolution start as the copy of its input channels from `first` on, but for a little noise."""
    features = len(weights)
    with torch.no_grad():
        weights.mul_(_FAINT)
        weights[:, first : first + features, 1, 1] += torch.eye(features)

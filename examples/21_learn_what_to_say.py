"""Train agents by PPO to say what others need within a budget of bytes, and compare with rules at equal bytes.

`python 21_learn_what_to_say.py 40` trains for 40 minutes, or goes on where it stopped, draws its curve, and compares on
towns that are new to it. Without a number it shows the way in seconds, and the senders have learned next to nothing.
"""

import sys
import time
from pathlib import Path

import numpy as np

import coopsim
from coopsim.bench.results.statistics import mean_interval
from coopsim.comms.envelope import decode_detections
from coopsim.comms.uplinks.budget import SELECTIONS, Selection
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks
from coopsim.wire.observation_format import ObservationFormat

try:
    import torch
    from torch import nn
except ImportError:
    print("this example needs torch: pip install 'coopsim[learn]'")
    raise SystemExit(0) from None

BUDGET, RECEIVER = 150, "late_fusion"
OPTIONS = {"lidar": None, "budget_bytes": BUDGET, "max_cycles": 50}
SILENT, FEATURES = pack_tracks(Tracks.empty()), 7
FILE = Path(f"what_to_say_{BUDGET}_{RECEIVER}.pt")


class Sender(nn.Module):
    """A utility of each detection, and the value of an agent's situation."""

    def __init__(self):
        super().__init__()
        self.utility = nn.Sequential(nn.Linear(FEATURES, 32), nn.Tanh(), nn.Linear(32, 1))
        self.value = nn.Sequential(nn.Linear(FEATURES, 32), nn.Tanh(), nn.Linear(32, 1))
        self.log_std = nn.Parameter(torch.zeros(1))

    def forward(self, rows, mask):
        """Return utilities (B, N), and values (B,) of rows (B, N, FEATURES)."""
        mean = (self.value(rows)[..., 0] * mask).sum(-1) / mask.sum(-1).clamp(min=1)
        return self.utility(rows)[..., 0], mean


class Learned(Selection):
    """The ranking that the network has learned, for any policy with a budget."""

    net = Sender()

    def __init__(self, rng):
        super().__init__(rng)
        self.heard, self.before = {}, (np.zeros((0, 2)), np.zeros(0))

    def hear(self, observation, decoded):
        """Remember where others are, and what they reported, in the world frame."""
        for message in observation.inbox:
            place, found = message.pose.world_SE3_base, decoded(message, decode_detections)
            self.heard[message.sender] = place.translation[:2], found.boxes.transform(place).center[:, :2], found.score

    def rows(self, observation):
        """Return a row of FEATURES for each detection, and its place in the world."""
        found, place = observation.detections, observation.pose.world_SE3_base
        at = found.boxes.transform(place).center[:, :2]
        others, away, surest = list(self.heard.values()), np.full(len(at), 100.0), np.zeros(len(at))
        for where, reported, score in others:
            away = np.minimum(away, np.hypot(*(at - where).T))
            same = np.hypot(*(at[:, None] - reported).transpose(2, 0, 1)) < 2.5
            surest = np.maximum(surest, (same * score).max(axis=1, initial=0.0))
        own = np.hypot(*found.boxes.center[:, :2].T)
        same = np.hypot(*(at[:, None] - self.before[0]).transpose(2, 0, 1)) < 2.5
        last = (same * self.before[1]).max(axis=1, initial=0.0)
        length = found.boxes.size[:, 0]
        return np.column_stack([found.score, own / 50, away / 50, surest, last, length / 5, own > 50]), at

    def remember(self, at, utility):
        """Remember the utilities of this frame: what is repeated is tracked better."""
        self.before = at, 1 / (1 + np.exp(-utility))

    def utility(self, sender, observation):
        """Return the utility of each detection."""
        rows, at = self.rows(observation)
        with torch.no_grad():
            utility = self.net.utility(torch.tensor(rows, dtype=torch.float32))[:, 0].numpy()
        self.remember(at, utility)
        return utility.astype(float)


SELECTIONS.register("learned_here")(Learned)


def episode(net, seed):
    """Return one town's experience: padded rows, masks, drawn utilities, rewards, by step and agent."""
    env = coopsim.parallel_env("town", uplink="action", reward=f"message_gain(receiver={RECEIVER})", **OPTIONS)
    observations, _ = env.reset(seed=seed)
    unpack = ObservationFormat.to_unpack(env.agent_specs)
    agents = {name: Learned(np.random.default_rng(0)) for name in env.agents}
    generator, history = torch.Generator().manual_seed(seed), []
    while env.agents:
        seen, actions, step = unpack.unpack_all(observations), {}, []
        for name, agent in agents.items():
            agent.hear(seen[name], lambda message, decode: decode(message))
            rows, at = agent.rows(seen[name])
            count = min(len(rows), 64)
            padded = torch.zeros(64, FEATURES)
            padded[:count] = torch.tensor(rows[:count], dtype=torch.float32)
            mask = (torch.arange(64) < count).float()
            with torch.no_grad():
                mean, value = net(padded[None], mask[None])
                drawn = mean[0] + net.log_std.exp() * torch.randn(64, generator=generator)
            agent.remember(at[:count], drawn[:count].numpy())
            actions[name] = {"tracks": SILENT, "message": {"score": (torch.sigmoid(drawn) * mask).numpy()}}
            step.append((padded, mask, drawn, value[0]))
        observations, rewards, *_ = env.step(actions)
        history.append((*map(torch.stack, zip(*step, strict=True)), torch.tensor([rewards[name] for name in agents])))
    env.close()
    return [torch.stack(each).float() for each in zip(*history, strict=True)]


def log_probability(net, rows, mask, drawn):
    """Return the log-probability of the drawn utilities, and the value."""
    mean, value = net(rows, mask)
    normal = torch.distributions.Normal(mean, net.log_std.exp())
    return (normal.log_prob(drawn) * mask).sum(-1) / mask.sum(-1).clamp(min=1), value


def update(net, optimizer, history, discount=0.9, smooth=0.9):
    """Take PPO's steps on one episode: clipped at 0.2, with generalised advantages (Schulman et al., 2016, 2017)."""
    rows, mask, drawn, value, reward = history
    following = torch.cat([value[1:], torch.zeros_like(value[:1])])
    advantage, carried = torch.zeros_like(reward), torch.zeros_like(reward[0])
    for t in reversed(range(len(reward))):
        carried = reward[t] + discount * following[t] - value[t] + discount * smooth * carried
        advantage[t] = carried
    wanted, scaled = advantage + value, (advantage - advantage.mean()) / (advantage.std() + 1e-6)
    with torch.no_grad():
        before, _ = log_probability(net, rows, mask, drawn)
    for _ in range(4):
        now, valued = log_probability(net, rows, mask, drawn)
        ratio = (now - before).exp()
        gain = torch.minimum(ratio * scaled, ratio.clamp(0.8, 1.2) * scaled).mean()
        loss = -gain + 0.5 * (valued - wanted).square().mean()
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 0.5)
        optimizer.step()


def draw(curve):
    """Write the mean reward by episode as an SVG."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 3))
    width = min(20, len(curve))
    axes.plot(np.convolve(curve, np.ones(width) / width, "valid"))
    axes.set(xlabel="episode", ylabel=f"reward, mean of {width}")
    figure.savefig(FILE.with_suffix(".svg"))


def train(minutes, episodes):
    """Train for so long, or at most so many episodes; what a file has is gone on with."""
    torch.manual_seed(0)
    net, curve = Sender(), []
    optimizer = torch.optim.Adam(net.parameters(), 1e-3)
    if episodes is None and FILE.exists():
        saved = torch.load(FILE, weights_only=True)
        net.load_state_dict(saved["net"])
        optimizer.load_state_dict(saved["optimizer"])
        curve = saved["curve"]
    until = time.monotonic() + 60 * minutes
    while time.monotonic() < until and (episodes is None or len(curve) < episodes):
        history = episode(net, seed=10_000 + len(curve))
        update(net, optimizer, history)
        curve.append(float(history[-1].mean()))
        if episodes is None:
            saved = {"net": net.state_dict(), "optimizer": optimizer.state_dict(), "curve": curve}
            torch.save(saved, FILE.with_suffix(".new"))
            FILE.with_suffix(".new").replace(FILE)
    if episodes is None:
        draw(curve)
    print(f"{len(curve)} episodes, mean reward of the last ten: {np.mean(curve[-10:]):.4f}")
    return net


def compare(seeds):
    """Print sAMOTA of each rule, and the difference to the learned one, on the same towns."""
    score = {}
    for rule in ("learned_here", "random", "score", "need"):
        runs = [coopsim.evaluate(RECEIVER, "town", seed=seed, selection=rule, **OPTIONS).score for seed in seeds]
        score[rule] = np.array([run["sAMOTA"] for run in runs])
        sent = np.mean([run["bytes_per_s"] for run in runs])
        gain = mean_interval(score["learned_here"] - score[rule])
        print(f"{rule:>12}: sAMOTA {score[rule].mean():.1f}, {sent:.0f} bytes/s per agent", end="")
        print(f", learned {gain.mean:+.2f} [{gain.low:+.2f}, {gain.high:+.2f}]")


if __name__ == "__main__":
    given = len(sys.argv) > 1
    if not given:
        OPTIONS["max_cycles"] = 10
    Learned.net = train(float(sys.argv[1]), None) if given else train(1, 2)
    compare(range(20) if given else range(2))

"""Train agents to say what others need within a budget of bytes, and compare with rules at equal bytes.

`python 21_learn_what_to_say.py 5 1` trains for 5 minutes with seed 1, or goes on where it stopped, draws its curve, and
compares on towns that are new to it. Without numbers it shows the way in seconds; little is learned then.

In training the actions are the messages. The gain of an object for a receiver is a counterfactual: 1 if the receiver,
hearing all but this sender, misses the object, and -1 if nothing is there. So each frame tells the gain of each object
that was said, or could have been. A reward for a whole message tells much less.
"""

import sys
import time
from contextlib import chdir
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import coopsim
from coopsim.bench.results.statistics import mean_interval
from coopsim.comms.uplinks.budget import SELECTIONS, Listening
from coopsim.geometry.iou import iou_3d
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks
from coopsim.wire.observation_format import ObservationFormat

try:
    import torch
    from torch import nn

    from coopsim.comms.uplinks.learned_selection import Learned
    from coopsim.learn.weights import make_network, save_weights
except ImportError:
    print("this example needs torch: pip install 'coopsim[learn]'")
    raise SystemExit(0) from None

RECEIVER, BUDGETS, OPTIONS = "late_fusion", (150, 400), {"lidar": None, "max_cycles": 50}
SILENT, MATCH_IOU, MOST = pack_tracks(Tracks.empty()), 0.25, 12
RULES = ("learned_here", "when2com", "need", "score", "random")


class Handshake(nn.Module):
    """When2com's match of a receiver's query with the keys of the agents, itself the first."""

    def __init__(self):
        super().__init__()
        self.query, self.key = nn.Linear(5, 8), nn.Linear(5, 8)

    def forward(self, query, keys):
        """Return the scores (B, K) of queries (B, 5) and keys (B, K, 5); a key of zeros is of no agent."""
        score = (self.key(keys) * self.query(query)[:, None]).sum(-1)
        return score.masked_fill((keys == 0).all(-1), -torch.inf)


def described(at, score):
    """Return the five numbers of a query or key: of objects at (N, 3) in the receiver's frame, and their scores."""
    if not len(at):
        return [1.0, 0, 0, 0, 0]
    return [1.0, len(at) / 10, score.mean(), np.abs(at[:, 0]).mean() / 50, np.abs(at[:, 1]).mean() / 50]


class When2com(Listening):
    """The rule of When2com (Liu et al., CVPR 2020), for boxes: speak if a receiver's handshake chooses the sender.

    Each receiver's query meets the keys of all agents, its own too; of the softmax what is above 1 / K is a link. A
    sender with a link sends its objects, the highest scores first, another sends none.

    It deviates from the paper. Queries and keys describe boxes, not images. A receiver's query is made from its last
    message, which the sender has anyway, so it costs no bytes; so are the keys of third agents. Thus the sender decides
    alone, without a second exchange. Links are taught by counted gains, not through the receiver's loss. A broadcast
    reaches those without a link, too.
    """

    net = Handshake()

    def utility(self, sender, observation):
        """Return the scores."""
        return observation.detections.score

    def order(self, sender, observation):
        """Return all rows, the highest scores first, or none without a link."""
        asked = [self.handshake(name, observation) for name in self.reports]
        if asked:
            query, keys = (torch.tensor(np.array(each), dtype=torch.float32) for each in zip(*asked, strict=True))
            with torch.inference_mode():
                chosen = self.net(query, keys).softmax(-1)[:, 1] > 1 / (len(asked) + 1)
            if not chosen.any():
                return np.zeros(0, dtype=np.int64)
        return super().order(sender, observation)

    def handshake(self, receiver, observation):
        """Return a receiver's query, and the keys (MOST, 5) of itself, this sender, and the others by name."""
        found, to_local = observation.detections, self.reports[receiver].world_SE3_base.inverse()

        def told(name):
            report = self.reports[name]
            return described(to_local.apply(np.column_stack([report.position, 0 * report.score])), report.score)

        own = described(to_local.apply(found.boxes.transform(observation.pose.world_SE3_base).center), found.score)
        keys = np.zeros((MOST, 5))
        others = [told(name) for name in sorted(self.reports) if name != receiver]
        keys[: 2 + len(others)] = [told(receiver), own, *others]
        return told(receiver), keys


SELECTIONS.register("when2com")(When2com)


def without(observation, sender):
    """Return an observation without the messages of a sender."""
    return observation.with_inbox(tuple(each for each in observation.inbox if each.sender != sender))


def gains(found, local_SE3_sender, tracks, truth):
    """Return what a receiver gains by hearing of each detection (N,): 1, 0 or -1."""
    boxes = found.boxes.transform(local_SE3_sender)
    if not len(boxes):
        return np.zeros(0)
    known = iou_3d(boxes.array, tracks.boxes.array).max(axis=1, initial=0.0) >= MATCH_IOU
    overlap = iou_3d(boxes.array, truth["box"])
    real = overlap.max(axis=1, initial=0.0) >= MATCH_IOU
    missed = iou_3d(truth["box"], tracks.boxes.array).max(axis=1, initial=0.0) < MATCH_IOU
    wanted = np.append(missed & truth["counts"] & truth["in_region"], False)
    which = overlap.argmax(axis=1) if len(truth["box"]) else np.full(len(boxes), -1)
    inside = (np.abs(boxes.center[:, :2]) <= [100.0, 40.0]).all(axis=1)
    return np.where(real, wanted[which].astype(float), -1.0 * (inside & ~known))


def frame(agents, seen, receivers, infos):
    """Return a frame's rows and gains, by pairs of sender and receiver, and its handshakes with the best choice."""
    rows, gained, hands, worth = [], [], [], {}
    for sender, agent in agents.items():
        tracks = receivers[sender].track_all({name: without(each, sender) for name, each in seen.items()})
        found, pose = seen[sender].detections, seen[sender].pose.world_SE3_base
        for receiver, row in zip(agent.reports, agent.rows(seen[sender]), strict=True):
            local_SE3_sender = seen[receiver].pose.world_SE3_base.inverse().compose(pose)
            gain = gains(found, local_SE3_sender, tracks[receiver], infos[receiver]["ground_truth"])
            rows.append(row)
            gained.append(gain)
            worth[sender, receiver] = np.maximum(gain, 0).sum()
            hands.append((sender, receiver, *When2com.handshake(agent, receiver, seen[sender])))
    asked = []
    for sender, receiver, query, keys in hands:
        third = [name for name in sorted(agents[sender].reports) if name != receiver]
        options = [0.5] + [worth.get((name, receiver), 0.0) for name in (sender, *third)]
        asked.append((query, keys, int(np.argmax(options))))
    return rows, gained, asked


def episode(file, seed, budget):
    """Return one town's rows, their gains, and its handshakes, with senders that rank by the weights of a file."""
    env = coopsim.parallel_env("town", uplink="action", expose_ground_truth=True, budget_bytes=budget, **OPTIONS)
    observations, infos = env.reset(seed=seed)
    unpack, rng = ObservationFormat.to_unpack(env.agent_specs), np.random.default_rng(seed)
    agents = {name: Learned(rng, file) for name in env.agents}
    receivers = {name: coopsim.make_policy(RECEIVER) for name in env.agents}
    for receiver in receivers.values():
        receiver.reset(env.agent_specs, seed=seed)
    history = [], [], []
    while env.agents:
        seen = unpack.unpack_all(observations)
        for name, agent in agents.items():
            agent.hear(seen[name], lambda message, decode: decode(message))
            for message in seen[name].inbox:
                agents[message.sender].sent(message, lambda message, decode: decode(message))
        for kept, new in zip(history, frame(agents, seen, receivers, infos), strict=True):
            kept += new
        actions = {}
        for name, agent in agents.items():
            utility = agent.utility(name, seen[name]) + 0.05 * rng.standard_normal(len(seen[name].detections))
            score = np.zeros(64)
            score[np.argsort(-utility)[:64]] = np.linspace(1, 0.1, len(utility))[:64]
            actions[name] = {"tracks": SILENT, "message": {"score": score}}
        observations, _, _, _, infos = env.step(actions)
    env.close()
    return history


def update(net, optimizer, inputs, targets, loss, steps):
    """Take steps of gradient descent on random batches."""
    for _ in range(steps):
        batch = torch.randint(len(targets), (512,))
        optimizer.zero_grad()
        loss(net(*(each[batch] for each in inputs)), targets[batch]).backward()
        optimizer.step()


def score_of(seeds, **options):
    """Return sAMOTA and bytes a second of an agent, by town."""
    runs = [coopsim.evaluate(RECEIVER, "town", seed=seed, **OPTIONS, **options).score for seed in seeds]
    return np.array([run["sAMOTA"] for run in runs]), np.mean([run["bytes_per_s"] for run in runs])


def choose_keep(file, net, towns):
    """Keep the bonus of repeated objects with the highest sAMOTA on towns of the training."""
    tried = {}
    for keep in (0.0, 0.1, 0.2, 0.4):
        net.keep.data.fill_(keep)
        save(file, net)
        tried[keep] = np.mean([score_of(towns, selection="learned_here", budget_bytes=size)[0] for size in BUDGETS])
    net.keep.data.fill_(max(tried, key=tried.get))
    save(file, net)
    print("keep: " + ", ".join(f"{keep} {value:.2f}" for keep, value in tried.items()), flush=True)


def save(file, net):
    """Write the weights of the ranking."""
    save_weights(file, net, {"kind": "ranking", "config": asdict(net.config)})


def tensors(history):
    """Return rows, gains, and handshakes as tensors."""
    rows, gained, asked = history
    query, keys, best = zip(*asked, strict=True)
    as_float = [np.concatenate(rows), np.concatenate(gained), np.array(query), np.array(keys)]
    return *(torch.tensor(each, dtype=torch.float32) for each in as_float), torch.tensor(best)


def train(minutes, seed, towns):
    """Train for so long, or on so many towns; what a file has is gone on with. Return the file, and the net."""
    torch.manual_seed(seed)
    file = Path(f"what_to_say_{seed}.safetensors")
    resume = file.with_suffix(".pt")
    net, hands, curve, data = make_network("ranking", {}, seed), When2com.net, [], []
    both = [torch.optim.Adam(each.parameters(), 1e-3) for each in (net, hands)]
    if resume.exists():
        saved = torch.load(resume, weights_only=True)
        for each, state in zip((net, hands, *both), saved["states"], strict=True):
            each.load_state_dict(state)
        curve, data = saved["curve"], saved["data"]
    net.keep.data.fill_(0.2)
    save(file, net)
    until = time.monotonic() + 60 * minutes
    while time.monotonic() < until and len(curve) < towns:
        town = 10_000 + 1000 * seed + len(curve)
        new = tensors(episode(file, town, BUDGETS[len(curve) % 2]))
        with torch.no_grad():
            curve.append(float(nn.functional.mse_loss(net(new[0]), new[1]) / new[1].var(correction=0)))
        data.append(new)
        rows, gained, query, keys, best = (torch.cat(each) for each in zip(*data, strict=True))
        update(net, both[0], [rows], gained, nn.MSELoss(), 300)
        update(hands, both[1], [query, keys], best, nn.CrossEntropyLoss(), 100)
        save(file, net)
        states = [each.state_dict() for each in (net, hands, *both)]
        torch.save({"states": states, "curve": curve, "data": data}, resume.with_suffix(".new"))
        resume.with_suffix(".new").replace(resume)
    print(f"{len(curve)} towns; share of the gains' variance that is not foreseen: {curve[0]:.2f} -> {curve[-1]:.2f}")
    draw(curve, file.with_suffix(".svg"))
    return file, net


def draw(curve, file):
    """Write the curve of new towns as an SVG."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 3))
    axes.plot(range(1, len(curve) + 1), curve)
    axes.set(xlabel="towns", ylabel="variance of gains not foreseen")
    figure.savefig(file, bbox_inches="tight")


def equal_bytes(budget, towns):
    """Return the least budget with which When2com sends no fewer bytes than the others, by towns of the training."""
    wanted = score_of(towns, selection="score", budget_bytes=budget)[1]
    sizes = range(budget, 3 * budget, 33)  # an object takes 33 bytes
    enough = (size for size in sizes if score_of(towns, selection="when2com", budget_bytes=size)[1] >= wanted)
    return next(enough, sizes[-1])


def compare(towns, training_towns):
    """Print sAMOTA of each rule, and the difference to the learned one, on the same towns."""
    for budget in BUDGETS:
        first = None
        for rule in RULES:
            size = equal_bytes(budget, training_towns) if rule == "when2com" else budget
            score, sent = score_of(towns, selection=rule, budget_bytes=size)
            first = score if first is None else first
            gain = mean_interval(first - score)
            print(f"{budget} bytes, {rule:>12}: sAMOTA {score.mean():.1f}, {sent:.0f} bytes/s per agent", end="")
            print(f", learned {gain.mean:+.2f} [{gain.low:+.2f}, {gain.high:+.2f}]", flush=True)


def load_handshake(file):
    """Take the handshake of an earlier training."""
    When2com.net.load_state_dict(torch.load(file, weights_only=True))


def main(minutes, seed, towns, judged):
    """Train, choose the bonus, and compare."""
    file, net = train(minutes, seed, towns)
    torch.save(When2com.net.state_dict(), f"handshake_{seed}.pt")
    SELECTIONS.register("learned_here")(lambda rng: Learned(rng, file))
    known = range(10_000 + 1000 * seed, 10_000 + 1000 * seed + min(3, towns))
    choose_keep(file, net, known)
    compare(range(judged), known[:1])


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0, towns=100, judged=20)
    else:
        OPTIONS["max_cycles"] = 10
        with TemporaryDirectory() as folder, chdir(folder):
            main(1.0, 0, towns=1, judged=2)

"""Train agents to say what others need within a budget of bytes, and compare with rules at equal bytes.

`python 21_learn_what_to_say.py 5 1` trains for 5 minutes with seed 1, or goes on where it stopped, draws its curve, and
compares on towns that are new to it. Without numbers it shows the way in seconds; little is learned then.

What an object is worth depends on when it was said last, so the ranking is searched by the score of whole episodes:
of some rhythms, "need" the first, the best in all towns and cases so far is kept. The handshake of When2com learns from
the gain of each object for each receiver, by a counterfactual: 1 if the receiver, hearing all but this sender, misses
it.
"""

import json
import sys
import time
from contextlib import chdir
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
CASES = (
    ("late_fusion", {"budget_bytes": 150}),
    ("coop_fuse", {"budget_bytes": 150}),
    ("late_fusion", {"budget_bytes": 400}),
    ("late_fusion", {"budget_bytes": 150, "loss": 0.5}),
)
OFTEN, PAUSE = (1.1, 1.1, 0.0, 0.0), (1.1, -3.0, 3.0, 3.0)
RHYTHMS = (  # where few objects fit, and where most do: said last and new, last and often, before, third last
    (OFTEN, OFTEN),  # as "need"
    (PAUSE, OFTEN),
    (PAUSE, (1.1, 0.0, 1.0, 1.0)),
    ((1.1, -1.5, 3.0, 3.0), OFTEN),
    ((1.1, -3.0, 2.0, 4.0), OFTEN),
    ((0.0, -3.0, 3.0, 3.0), OFTEN),
    ((-1.0, -3.0, 3.0, 3.0), OFTEN),
    (PAUSE, PAUSE),
)
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
    """Return a frame's handshakes, with the best choice of each."""
    hands, worth = [], {}
    for sender, agent in agents.items():
        tracks = receivers[sender].track_all({name: without(each, sender) for name, each in seen.items()})
        found, pose = seen[sender].detections, seen[sender].pose.world_SE3_base
        for receiver in agent.reports:
            local_SE3_sender = seen[receiver].pose.world_SE3_base.inverse().compose(pose)
            gain = gains(found, local_SE3_sender, tracks[receiver], infos[receiver]["ground_truth"])
            worth[sender, receiver] = np.maximum(gain, 0).sum()
            hands.append((sender, receiver, *agent.handshake(receiver, seen[sender])))
    asked = []
    for sender, receiver, query, keys in hands:
        third = [name for name in sorted(agents[sender].reports) if name != receiver]
        options = [0.5] + [worth.get((name, receiver), 0.0) for name in (sender, *third)]
        asked.append((query, keys, int(np.argmax(options))))
    return asked


def episode(seed, budget):
    """Return one town's handshakes, with senders that say their highest scores, and act by messages."""
    env = coopsim.parallel_env("town", uplink="action", expose_ground_truth=True, budget_bytes=budget, **OPTIONS)
    observations, infos = env.reset(seed=seed)
    unpack = ObservationFormat.to_unpack(env.agent_specs)
    agents = {name: When2com(np.random.default_rng(seed)) for name in env.agents}
    receivers = {name: coopsim.make_policy(RECEIVER) for name in env.agents}
    for receiver in receivers.values():
        receiver.reset(env.agent_specs, seed=seed)
    asked = []
    while env.agents:
        seen = unpack.unpack_all(observations)
        for name, agent in agents.items():
            agent.hear(seen[name], lambda message, decode: decode(message))
        asked += frame(agents, seen, receivers, infos)
        actions = {}
        for name, each in seen.items():
            score = np.zeros(64)
            score[: len(each.detections)] = each.detections.score[:64]
            actions[name] = {"tracks": SILENT, "message": {"score": score}}
        observations, _, _, _, infos = env.step(actions)
    env.close()
    return asked


def train_handshake(towns):
    """Teach the handshake to choose the sender from which a receiver gains most, on towns of the training."""
    asked = [each for k, town in enumerate(towns) for each in episode(town, BUDGETS[k % 2])]
    query, keys, best = zip(*asked, strict=True)
    query, keys = (torch.tensor(np.array(each), dtype=torch.float32) for each in (query, keys))
    best, optimizer = torch.tensor(best), torch.optim.Adam(When2com.net.parameters(), 1e-3)
    for _ in range(100 * len(towns)):
        batch = torch.randint(len(best), (512,))
        optimizer.zero_grad()
        nn.functional.cross_entropy(When2com.net(query[batch], keys[batch]), best[batch]).backward()
        optimizer.step()


def load_handshake(file):
    """Take the handshake of an earlier training."""
    When2com.net.load_state_dict(torch.load(file, weights_only=True))


def score_of(seeds, receiver=RECEIVER, **options):
    """Return sAMOTA and bytes a second of an agent, by town."""
    runs = [coopsim.evaluate(receiver, "town", seed=seed, **OPTIONS, **options).score for seed in seeds]
    return np.array([run["sAMOTA"] for run in runs]), np.mean([run["bytes_per_s"] for run in runs])


def save(file, rhythm):
    """Write the weights of the ranking: those of "need" with another rhythm."""
    net = make_network("ranking", {})
    net.weight.data[3:] = torch.tensor([*rhythm[0], *rhythm[1]])
    save_weights(file, net, {"kind": "ranking", "config": {}})


def train(minutes, seed, towns):
    """Try all rhythms for so long, or in so many towns; what a file has is gone on with. Keep the best."""
    file = Path(f"what_to_say_{seed}.safetensors")
    resume = file.with_suffix(".json")
    SELECTIONS.register("learned_here")(lambda rng: Learned(rng, file))
    tried = json.loads(resume.read_text()) if resume.exists() else []
    until = time.monotonic() + 60 * minutes
    while not tried or (time.monotonic() < until and len(tried) < len(CASES) * towns):
        receiver, options = CASES[len(tried) % len(CASES)]
        town, scores = first_town(seed) + len(tried) // len(CASES), []
        for rhythm in RHYTHMS:
            save(file, rhythm)
            scores.append(float(score_of([town], receiver, selection="learned_here", **options)[0].mean()))
        tried.append(scores)
        resume.write_text(json.dumps(tried))
    leads = np.cumsum(np.array(tried) - np.array(tried)[:, :1], axis=0) / np.arange(1, len(tried) + 1)[:, None]
    best = int(leads[-1].argmax())
    save(file, RHYTHMS[best])
    draw(leads[:, best], file.with_suffix(".svg"))
    print(f"{len(tried)} cases; lead over need: " + ", ".join(f"{each:+.2f}" for each in leads[-1]), flush=True)


def first_town(seed):
    """Return the first town of a training."""
    return 500 + 10 * seed


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


def draw(curve, file):
    """Write the curve of the training as an SVG."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 3))
    axes.plot(range(1, len(curve) + 1), curve)
    axes.set(xlabel="cases", ylabel="mean sAMOTA less that of need")
    figure.savefig(file, bbox_inches="tight")


def main(minutes, seed, towns, judged):
    """Train both, and compare."""
    torch.manual_seed(seed)
    train(minutes, seed, towns)
    known = range(first_town(seed), first_town(seed) + towns)
    train_handshake(known)
    torch.save(When2com.net.state_dict(), f"handshake_{seed}.pt")
    compare(range(judged), known[:1])


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0, towns=4, judged=20)
    else:
        OPTIONS["max_cycles"] = 10
        with TemporaryDirectory() as folder, chdir(folder):
            main(0.0, 0, towns=1, judged=2)

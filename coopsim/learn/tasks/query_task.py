"""The training of instance queries on a frozen encoder and head: first of each agent alone, then of agents together."""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import torch
from torch import Tensor

from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.instance_losses import association_loss, instance_losses, labelled
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.query_streams import QueryStream, StreamCutter, TrueObjects, true_objects
from coopsim.learn.tasks.training_task import TrainingTask, mean_losses, weights_metadata
from coopsim.learn.weights import load_detector, load_queries, make_network
from coopsim.nn.queries.cooptrack_fusion import ReceivedInstances
from coopsim.nn.queries.instance_fusion import sure_pairs
from coopsim.nn.queries.instances import Instances
from coopsim.nn.queries.perceiver import seen_map
from coopsim.nn.queries.query_net import QueryConfig, QueryNet, QueryStep, SeenMap, kept_instances
from coopsim.types import BevGrid

_LEAST_SHARED = 0.2
"""Smallest score of an instance that is sent, as policies have it by default."""


@dataclass(frozen=True, slots=True, eq=False)
class TaughtStep:
    """A frame of an agent: the network's step, and the objects around."""

    step: QueryStep
    truth: TrueObjects


class QueryTask(TrainingTask[QueryNet]):
    """The training of a `QueryNet`: stage 1 with the fusion "none", stage 2 with another one.

    In stage 2 the network of one agent begins as that of `start`. Messages are made without gradients, and so are
    instances that are carried over frames. Instances are paired by the rule, not by the network's own logits.
    """

    net: QueryNet

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        self._settings: SampleSettings = load(SampleSettings, recipe.samples, "samples")
        detector = load_detector(recipe.detector)
        self.net = make_network("queries", {"features": detector.config.features, **recipe.network}, seed)
        if self.net.config.features != detector.config.features:
            raise InvalidValueError(f"network features must be the detector's {detector.config.features}")
        if recipe.start is not None:
            self._start(load_queries(recipe.start, detector))
        self.detector = copy.deepcopy(detector).eval().requires_grad_(False)
        self._streams = StreamCutter(self._settings, seed, recipe.block, self.detector, self._see)
        self.frozen = [self.detector]
        self.metadata = weights_metadata("queries", self.net.config, recipe, detector)

    def _start(self, start: QueryNet) -> None:
        mine, given = (_of_one_agent(each.config) for each in (self.net, start))
        if mine != given:
            raise InvalidValueError(f"network must have the sizes of start, {asdict(given)}, got {asdict(mine)}")
        self.net.agent.load_state_dict(start.agent.state_dict())

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[QueryStream]:
        return self._streams.cut(clip, rng)

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[QueryStream]:
        return self._streams.cut_held_out(clip, rng, replace(self._settings, receivers=None))

    def _see(self, features: Tensor, grid: BevGrid) -> SeenMap:
        return seen_map(self.net, self.detector.head, features, grid)

    def evaluate(self, net: QueryNet, batches: Sequence[Sequence[QueryStream]]) -> dict[str, float]:
        found = QueryEvaluation()
        with torch.no_grad():
            for sample in (sample for batch in batches for sample in batch):
                for taught in taught_steps(net, sample, by_rule=False):
                    found.add(taught.step, taught.truth)
        return found.values()

    def losses(self, batch: Sequence[QueryStream]) -> dict[str, Tensor]:
        return mean_losses(
            [mean_losses([_losses(each) for each in taught_steps(self.net, sample)]) for sample in batch]
        )


def _of_one_agent(config: QueryConfig) -> QueryConfig:
    """Return the sizes of the network of one agent."""
    return replace(config, fusion="none", motion=True, alignment=True, graph=True)


def _losses(taught: TaughtStep) -> dict[str, Tensor]:
    step, truth = taught.step, taught.truth
    parts = instance_losses(step.instances, step.logits, truth, labelled(step.instances, truth))
    if step.compared:
        each = [association_loss(one, labelled(one.own, truth), labelled(one.others, truth)) for one in step.compared]
        parts["association"] = torch.stack(each).mean()
    return parts


def taught_steps(net: QueryNet, sample: QueryStream, *, by_rule: bool = True) -> Iterator[TaughtStep]:
    """Yield the frames of all receivers that are taught, in order of time.

    With the fusion "none" receivers are alone. Instances are paired by distance (`by_rule`) or by the network.
    """
    clip, alone = sample.clip, net.config.fusion == "none"
    sent: dict[tuple[int, int], Instances] = {}
    before: dict[tuple[str, int], Instances] = {}
    for number in range(len(clip.scenes)):
        if not alone:
            with torch.no_grad():
                for agent in sample.members:
                    step = net(
                        _carried(net, before, ("own", agent), sample, number), clip.dt_s, _seen(sample, number, agent)
                    )
                    sent[number, agent] = before["own", agent] = kept_instances(step.instances)
        for agent in sample.receivers:
            received = [] if alone else _received(sample, number, agent, sent)
            carried = _carried(net, before, ("fused", agent), sample, number)
            step = net(carried, clip.dt_s, _seen(sample, number, agent), received, by_rule=by_rule)
            before["fused", agent] = kept_instances(step.instances.detached())
            yield TaughtStep(step, true_objects(sample, number, agent, alone=alone))


def _received(
    sample: QueryStream, number: int, agent: int, sent: dict[tuple[int, int], Instances]
) -> list[ReceivedInstances]:
    """Return the instances that an agent has received in a scene, the nearest sender first."""
    received = []
    for sender in sample.members:
        then = number - int(sample.late[sender])
        if sender != agent and then >= 0:
            placed, delay_s = (
                sample.receiver_SE3_sender(number, agent, sender, then),
                (number - then) * sample.clip.dt_s,
            )
            known = sent[then, sender]
            received.append(ReceivedInstances(known[known.score >= _LEAST_SHARED].as_received(), placed, delay_s))
    return sorted(received, key=lambda each: float(np.abs(each.receiver_SE3_sender.translation).max()))


def _carried(
    net: QueryNet, before: dict[tuple[str, int], Instances], who: tuple[str, int], sample: QueryStream, number: int
) -> Instances:
    """Return the instances of an agent after the scene before, in its compass frame of now."""
    if who not in before:
        return net.nothing()
    then, now = (sample.clip.scenes[k].place_m[who[1]] for k in (number - 1, number))
    return before[who].moved(SE3.from_xyz_yaw(then - now, 0.0))


def _seen(sample: QueryStream, number: int, agent: int) -> SeenMap:
    seen = sample.clip.scenes[number].seen[agent]
    return replace(seen, features=seen.features.float())


SURE = 0.3
"""Instances with a smaller score do not count as found."""


class QueryEvaluation:
    """Values of validation: counts of found and true objects, and errors, over frames."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._place_m: list[float] = []
        self._speed_m_s: list[float] = []

    def add(self, step: QueryStep, truth: TrueObjects) -> None:
        """Count a frame of one agent."""
        found = kept_instances(step.instances)
        found = found[found.score >= SURE]
        labels = labelled(found, truth)
        rows, objects = labels.shown(truth).rows, labels.shown(truth).objects
        ignored = len(labels.rows) - len(rows)
        self._counts += Counter(there=int(truth.shown.sum()), right=len(rows), found=len(found) - ignored)
        self._place_m += (found.box[rows, :2] - truth.box[objects, :2]).norm(dim=1).tolist()
        self._speed_m_s += (found.velocity[rows] - truth.velocity[objects]).norm(dim=1).tolist()
        for each in step.compared:
            mine = labelled(each.own, truth).by_row(len(each.own)).cpu().numpy()
            theirs = labelled(each.others, truth).by_row(len(each.others)).cpu().numpy()
            pairs = sure_pairs(each.logits, 0.5)
            right = (mine[pairs[0]] == theirs[pairs[1]]) & (mine[pairs[0]] >= 0)
            both = len(np.intersect1d(mine[mine >= 0], theirs[theirs >= 0]))
            self._counts += Counter(pairs=len(pairs[0]), pairs_right=int(right.sum()), pairs_there=both)

    def values(self) -> dict[str, float]:
        """Return recall, precision and mean errors, and the same for pairs of two agents."""
        count = self._counts
        values = {
            "recall": _share(count["right"], count["there"]),
            "precision": _share(count["right"], count["found"]),
            "place error (m)": float(np.mean(self._place_m)) if self._place_m else 0.0,
            "velocity error (m/s)": float(np.mean(self._speed_m_s)) if self._speed_m_s else 0.0,
        }
        if count["pairs_there"]:
            values["pairs recall"] = _share(count["pairs_right"], count["pairs_there"])
            values["pairs precision"] = _share(count["pairs_right"], count["pairs"])
        return {name: round(value, 4) for name, value in values.items()}


def _share(part: int, whole: int) -> float:
    return part / whole if whole else 0.0

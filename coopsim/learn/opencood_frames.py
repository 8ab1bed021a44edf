"""Samples in OpenCOOD's layout from the simulator as it runs, or from recordings, as a data set of torch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch.utils.data import IterableDataset, get_worker_info

from coopsim.catalog import parallel_env
from coopsim.learn.opencood import Batch, Layout, collate, make_sample
from coopsim.support.checks import as_runs
from coopsim.types import PointCloud

if TYPE_CHECKING:
    from coopsim.envs.frames import AgentFrame, Frame


class CooperativeFrames(IterableDataset[Batch]):
    """Samples of every connected car in every frame of some episodes; see `coopsim.learn.opencood` for the keys.

    Use it with `torch.utils.data.DataLoader(frames, batch_size=2, collate_fn=join)`; workers share the episodes. Points
    of other agents are placed by estimated poses, so options such as `position_noise_m` disturb them; messages are
    neither late nor lost. Boxes are those of all vehicles around a receiver that count in scores.

    Args:
        environment: name, or path of a scenario file or of a folder of recordings with sweeps.
        seeds: an episode each; of recordings, every sequence is one, and seeds decide noise.
        layout: choices of the network.
        **options: further options of the environment, such as `max_cycles=40` or `lidar="HDL-64E"`.

    Raises:
        CoopsimError: a name is unknown or a value is not accepted.
    """

    def __init__(
        self, environment: str | Path, seeds: Sequence[int] = (0,), layout: Layout | None = None, **options: Any
    ) -> None:
        self._environment, self._seeds = environment, as_runs(seeds=seeds)
        self._layout = Layout() if layout is None else layout
        self._options = {"detector": "none", "uplink": "none", **options, "expose_ground_truth": True}
        self._sequences = self._make().sequences or (None,)

    def __iter__(self) -> Iterator[Batch]:
        env, worker = self._make(), get_worker_info()
        episodes = [(seed, sequence) for sequence in self._sequences for seed in self._seeds]
        for seed, sequence in episodes if worker is None else episodes[worker.id :: worker.num_workers]:
            for frame in env.frames(seed, sequence):
                for agent, each in frame.agents.items():
                    if env.agent_specs[agent].kind == "cav" and each.observation.sweeps:
                        yield as_tensors(_sample(self._layout, frame, agent))
        env.close()

    def _make(self) -> Any:
        given = dict(self._options)
        if Path(self._environment).is_dir():
            given.pop("detector")
        return parallel_env(self._environment, **given)


def _sample(layout: Layout, frame: Frame, receiver: str) -> Batch:
    """Return the sample of a receiver: its points and those of all other agents with a LiDAR, and the vehicles."""
    own = frame.agents[receiver]
    others = [each for name, each in frame.agents.items() if name != receiver and each.observation.sweeps]
    base_SE3_world = own.observation.pose.world_SE3_base.inverse()
    placed = [base_SE3_world.compose(each.observation.pose.world_SE3_base) for each in (own, *others)]
    boxes, ids = _vehicles(own)
    return make_sample(layout, [_cloud(each) for each in (own, *others)], placed, boxes, ids)


def _cloud(agent: AgentFrame) -> PointCloud:
    return PointCloud.of(*agent.observation.sweeps.values())


def _vehicles(agent: AgentFrame) -> tuple[Any, Sequence[int]]:
    from coopsim.types import ObjectClass

    truth = agent.truth
    wanted = np.isin(truth.label, [ObjectClass.CAR, ObjectClass.VAN, ObjectClass.TRUCK, ObjectClass.BUS])
    if truth.counts is not None:
        wanted &= truth.counts
    return truth.boxes[wanted], truth.id[wanted].tolist()


def as_tensors(batch: Batch, device: str | torch.device = "cpu") -> Batch:
    """Return a batch with tensors for arrays, on a device; other values stay as they are."""
    return _changed(batch, lambda value: torch.from_numpy(value).to(device) if isinstance(value, np.ndarray) else value)


def join(samples: Sequence[Batch]) -> Batch:
    """Join samples to a batch: the function `collate_fn` of a loader."""
    return as_tensors(collate([_changed(sample, _as_array) for sample in samples]))


def _as_array(value: Any) -> Any:
    return value.numpy() if isinstance(value, torch.Tensor) else value


def _changed(batch: Batch, change: Callable[[Any], Any]) -> Batch:
    """Return a batch with changed values; those in inner mappings, too."""
    return {
        name: _changed(value, change) if isinstance(value, dict) else change(value) for name, value in batch.items()
    }

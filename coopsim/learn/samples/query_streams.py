"""Samples for instance queries: clips as their agents see them, frame after frame, through a frozen detector."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from coopsim.geometry.se3 import SE3, Floats
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.query_losses import TrueObjects
from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.fused_samples import LATEST_S
from coopsim.learn.samples.sample_frames import mirror, moved, rotated, sweeps_of, thin
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.detector.pillars import collate, pillarize
from coopsim.nn.inference.perceiver import way_to_world_cells
from coopsim.nn.queries.query_net import SeenMap
from coopsim.support.rng import stream
from coopsim.types import BevGrid
from coopsim.types.units import Ints, Mask

_SHORTEST_S = 0.1
"""Least time between two scenes of a clip that is played quicker."""


@dataclass(frozen=True, slots=True, eq=False)
class WatchedScene:
    """One frame of A agents, in the axes of the clip, which are turned and perhaps mirrored.

    Attributes:
        seen: by each agent, in its compass frame; features as 16 bit floats.
        place_m: (A, 3) where the agents are.
        object_id: (N,).
        box: (N, 7) where the objects are, float32.
        velocity: (N, 2) m/s.
        label: (N,) int64.
        returns: (N, A) bool, who has returns of what.
    """

    seen: tuple[SeenMap, ...]
    place_m: Floats
    object_id: Ints
    box: Tensor
    velocity: Tensor
    label: Tensor
    returns: Mask


@dataclass(frozen=True, slots=True, eq=False)
class WatchedClip:
    """A clip as its agents see it.

    Attributes:
        dt_s: time between two scenes.
        scenes: in order of time.
    """

    dt_s: float
    scenes: tuple[WatchedScene, ...]

    @property
    def agents(self) -> int:
        """Number of agents."""
        return len(self.scenes[0].seen)

    def quicker(self, factor: float) -> WatchedClip:
        """Return the same scenes in less time, with everything so many times as fast."""
        scenes = tuple(replace(scene, velocity=factor * scene.velocity) for scene in self.scenes)
        return WatchedClip(self.dt_s / factor, scenes)


@dataclass(frozen=True, slots=True, eq=False)
class QueryStream:
    """A clip with what is drawn for one use of it.

    Attributes:
        clip: what is seen.
        members: numbers of the agents that take part.
        receivers: those of them whose view is taught.
        late: by how many scenes each agent's messages are late, (A,).
        error: (A, 3) of the agents' estimates of where they are, x and y m, and of their headings, rad.
    """

    clip: WatchedClip
    members: tuple[int, ...]
    receivers: tuple[int, ...]
    late: Ints
    error: Floats

    def receiver_SE3_sender(self, scene: int, receiver: int, sender: int, then: int) -> SE3:
        """Return a sender's compass frame of an earlier scene in a receiver's of now, as they believe it to be.

        An error of a heading turns what its agent says, and how it sees what others say.
        """
        places = [self.clip.scenes[k].place_m[agent] for k, agent in ((then, sender), (scene, receiver))]
        believed = [
            SE3.from_xyz_yaw(place + np.array([*self.error[agent, :2], 0.0]), float(self.error[agent, 2]))
            for place, agent in zip(places, (sender, receiver), strict=True)
        ]
        return believed[1].inverse().compose(believed[0])


See = Callable[[Tensor, BevGrid], SeenMap]
"""Tells what an agent sees, from its map of features (1, C, h, w) and its cells."""


@torch.no_grad()
def watch(
    clip: Clip, rng: np.random.Generator, settings: SampleSettings, detector: DetectorNet, see: See
) -> WatchedClip:
    """Return a clip as its agents see it by a detector.

    Args:
        clip: the scenes.
        rng: decides the axes, the mirror, and whose points are thinned.
        settings: of samples; `reach_m`, `thinned` and `mirrored` matter.
        detector: with encoder and head, frozen.
        see: tells what an agent sees on its map.
    """
    axes_rad, mirrored = float(rng.uniform(-np.pi, np.pi)), rng.random() < settings.mirrored
    flip = np.array([1.0, -1.0 if mirrored else 1.0])
    scenes = []
    for number, scene in enumerate(clip.scenes):
        seen, places = [], []
        for member, agent in enumerate(scene.agents):
            place = rotated(agent.xyz_yaw[None, :2], -axes_rad)[0] * flip
            frame = np.array([*agent.xyz_yaw[:3], axes_rad])
            points = thin(sweeps_of(clip, number, member, detector.config.sweeps), rng, settings.thinned)
            points = moved(points, agent.xyz_yaw, frame)
            if mirrored:
                mirror(points, np.zeros((0, 7)), np.zeros((0, 2)))
            x_m, y_m = way_to_world_cells(place, STRIDE * detector.config.cell_m)
            reach_m = settings.reach_m
            canvas = BevGrid((x_m - reach_m, x_m + reach_m), (y_m - reach_m, y_m + reach_m), detector.config.cell_m)
            features = detector.encoder(collate([pillarize(points, canvas)])).float()
            map_ = see(features, canvas.coarser(STRIDE))
            seen.append(replace(map_, features=map_.features.half()))
            places.append([*place, agent.xyz_yaw[2]])
        box = scene.boxes.copy()
        box[:, :2] = rotated(box[:, :2], -axes_rad) * flip
        box[:, 6] = (box[:, 6] - axes_rad) * flip[1]
        velocity = rotated(scene.velocity, -axes_rad) * flip
        scenes.append(
            WatchedScene(
                tuple(seen), np.array(places), scene.object_id, torch.from_numpy(box).float(),
                torch.from_numpy(velocity).float(), torch.from_numpy(np.array(scene.label, np.int64)),
                scene.returns > 0,
            )
        )  # fmt: skip
    return WatchedClip(clip.dt_s, tuple(scenes))


def draw_stream(clip: WatchedClip, rng: np.random.Generator, settings: SampleSettings) -> QueryStream | None:
    """Return a use of a clip: who takes part, whose messages are how late, and who errs by how much; None: nobody does.

    Args:
        clip: what is seen.
        rng: decides it.
        settings: of samples; `dropout`, `receivers`, `late`, `noisy`, `noise_m`, `noise_deg` and `quickest` matter.
    """
    agents, quickest = clip.agents, max(1.0, min(settings.quickest, clip.dt_s / _SHORTEST_S))
    if quickest > 1:
        clip = clip.quicker(quickest ** rng.random())
    members = np.flatnonzero(rng.random(agents) >= settings.dropout)
    if not len(members):
        return None
    most = len(members) if settings.receivers is None else min(settings.receivers, len(members))
    receivers = np.sort(rng.choice(members, most, replace=False))
    latest = min(len(clip.scenes) - 1, int(LATEST_S / clip.dt_s + 1e-6))
    late = np.where(rng.random(agents) < settings.late, rng.integers(0, latest + 1, agents), 0)
    strength = rng.random() * float(rng.random() < settings.noisy)
    noise = strength * np.array([settings.noise_m, settings.noise_m, np.radians(settings.noise_deg)])
    return QueryStream(
        clip, tuple(members.tolist()), tuple(receivers.tolist()), late, rng.normal(size=(agents, 3)) * noise
    )


class StreamCutter:
    """Cuts streams out of clips, for training and for a look. A clip of a block is watched once for all its passes.

    Args:
        settings: of samples.
        seed: of the training.
        most: clips that are kept, those of a block.
        detector: with encoder and head, frozen.
        see: tells what an agent sees on its map.
    """

    def __init__(self, settings: SampleSettings, seed: int, most: int, detector: DetectorNet, see: See) -> None:
        self._settings, self._seed, self._most = settings, seed, most
        self._detector, self._see = detector, see
        self._watched: OrderedDict[str, WatchedClip] = OrderedDict()

    def cut(self, clip: Clip, rng: np.random.Generator) -> list[QueryStream]:
        """Draw a use of a clip; none is possible."""
        return _as_list(draw_stream(self._watch(clip), rng, self._settings))

    def cut_held_out(self, clip: Clip, rng: np.random.Generator, settings: SampleSettings) -> list[QueryStream]:
        """Draw a use of a held-out clip with other settings, without what is there only to make training harder."""
        plain = replace(settings, thinned=0.0, mirrored=0.0, dropout=0.0)
        return _as_list(draw_stream(watch(clip, rng, plain, self._detector, self._see), rng, plain))

    def _watch(self, clip: Clip) -> WatchedClip:
        if clip.key not in self._watched:
            rng = stream(self._seed, "training.watch", clip.key)  # the same after an interruption
            self._watched[clip.key] = watch(clip, rng, self._settings, self._detector, self._see)
            while len(self._watched) > self._most:
                self._watched.popitem(last=False)
        return self._watched[clip.key]


def _as_list(drawn: QueryStream | None) -> list[QueryStream]:
    return [] if drawn is None else [drawn]


def true_objects(sample: QueryStream, number: int, agent: int, *, alone: bool) -> TrueObjects:
    """Return the objects around an agent in a scene; to be found are those that it, or what it has heard, shows.

    Args:
        sample: the clip.
        number: of the scene.
        agent: its number.
        alone: it hears nobody.
    """
    scene = sample.clip.scenes[number]
    shown = scene.returns[:, agent].copy()
    for sender in () if alone else sample.members:
        then = number - int(sample.late[sender])
        if then >= 0:
            earlier = sample.clip.scenes[then]
            shown |= np.isin(scene.object_id, earlier.object_id[earlier.returns[:, sender]])
    box = scene.box.clone()
    box[:, :3] -= torch.from_numpy(scene.place_m[agent]).to(box)
    return TrueObjects(box, scene.velocity, scene.label, torch.from_numpy(shown))

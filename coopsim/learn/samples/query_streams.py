"""Samples for instance queries: maps of all agents of a clip, frame after frame, through a frozen detector."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from coopsim.geometry.se3 import SE3, Floats
from coopsim.learn.clips.clip import Clip
from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.fused_samples import LATEST_S
from coopsim.learn.samples.sample_frames import mirror, moved, rotated, sweeps_of, thin
from coopsim.nn.cooperative.cooperative_net import LONGEST_S, CooperativeNet, moved_on
from coopsim.nn.cooperative.warp import warp
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.detector.pillars import collate, pillarize
from coopsim.nn.fusion import FusionContext, as_batch
from coopsim.nn.inference.backend import to_device
from coopsim.nn.inference.canvas import way_to_world_cells
from coopsim.nn.queries.query_net import SeenMap
from coopsim.support.rng import stream
from coopsim.types import BevGrid, stack_xyz_yaw
from coopsim.types.units import Ints, Mask

_SHORTEST_S = 0.1
"""Least time between two scenes of a clip that is played quicker."""


@dataclass(frozen=True, slots=True, eq=False)
class EncodedScene:
    """A frame of A agents and N objects, in the axes of the clip, which are turned and perhaps mirrored.

    Attributes:
        seen: map of each agent, in its compass frame; features as 16 bit floats.
        place_m: (A, 3) positions of the agents.
        object_id: (N,) ids.
        box: (N, 7) float32.
        velocity: (N, 2) m/s.
        label: (N,) int64.
        returns: (N, A) bool, true where the agent has returns from the object.
    """

    seen: tuple[SeenMap, ...]
    place_m: Floats
    object_id: Ints
    box: Tensor
    velocity: Tensor
    label: Tensor
    returns: Mask


@dataclass(frozen=True, slots=True, eq=False)
class EncodedClip:
    """A clip as its agents see it: scenes in order of time."""

    dt_s: float
    scenes: tuple[EncodedScene, ...]

    @property
    def agents(self) -> int:
        """Number of agents."""
        return len(self.scenes[0].seen)

    def quicker(self, factor: float) -> EncodedClip:
        """Return the same scenes with all speeds multiplied by a factor."""
        scenes = tuple(replace(scene, velocity=factor * scene.velocity) for scene in self.scenes)
        return EncodedClip(self.dt_s / factor, scenes)


@dataclass(frozen=True, slots=True, eq=False)
class QueryStream:
    """A clip with the draws for one use of it.

    Attributes:
        clip: the clip.
        members: numbers of the agents that take part.
        receivers: members whose view is taught.
        late: (A,) delay of the agents' messages, in scenes.
        error: (A, 3) errors of the agents' positions, x and y m, and of their headings, rad.
    """

    clip: EncodedClip
    members: tuple[int, ...]
    receivers: tuple[int, ...]
    late: Ints
    error: Floats

    def receiver_SE3_sender(self, scene: int, receiver: int, sender: int, then: int) -> SE3:
        """Return a sender's compass frame of an earlier scene in a receiver's of now, by their estimates of poses.

        An error of a heading turns the messages of its agent, and its view of others' messages.
        """
        places = [self.clip.scenes[k].place_m[agent] for k, agent in ((then, sender), (scene, receiver))]
        estimated = [
            SE3.from_xyz_yaw(place + np.array([*self.error[agent, :2], 0.0]), float(self.error[agent, 2]))
            for place, agent in zip(places, (sender, receiver), strict=True)
        ]
        return estimated[1].inverse().compose(estimated[0])


See = Callable[[Tensor, BevGrid], SeenMap]
"""Function from an agent's map of features (1, C, h, w) and its cells to its `SeenMap`."""


@torch.no_grad()
def encode_clip(
    clip: Clip, rng: np.random.Generator, settings: SampleSettings, detector: DetectorNet, see: See
) -> EncodedClip:
    """Return a clip as its agents see it by a frozen detector.

    The stream decides the axes, the mirror, and the thinning of points, by `reach_m`, `thinned` and `mirrored`.
    """
    axes_rad, mirrored = float(rng.uniform(-np.pi, np.pi)), rng.random() < settings.mirrored
    flip = np.array([1.0, -1.0 if mirrored else 1.0])
    device = next(detector.parameters()).device
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
            pillars = pillarize(points, canvas, detector.config.pillars)
            features = detector.encoder(to_device(collate([pillars]), device)).float()
            map_ = see(features, canvas.coarser(STRIDE))
            seen.append(replace(map_, features=map_.features.half()))
            places.append([*place, agent.xyz_yaw[2]])
        box = scene.boxes.copy()
        box[:, :2] = rotated(box[:, :2], -axes_rad) * flip
        box[:, 6] = (box[:, 6] - axes_rad) * flip[1]
        velocity = rotated(scene.velocity, -axes_rad) * flip
        scenes.append(
            EncodedScene(
                tuple(seen), np.array(places), scene.object_id, torch.from_numpy(box).float(),
                torch.from_numpy(velocity).float(), torch.from_numpy(np.array(scene.label, np.int64)),
                scene.returns > 0,
            )
        )  # fmt: skip
    return EncodedClip(clip.dt_s, tuple(scenes))


def draw_stream(clip: EncodedClip, rng: np.random.Generator, settings: SampleSettings) -> QueryStream | None:
    """Draw a sample of a clip: participants, delays of messages, errors of poses. None if no agent takes part.

    It depends on `dropout`, `receivers`, `late`, `noisy`, `noise_m`, `noise_deg` and `quickest`.
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
    """Cutter of streams out of clips, for training and for validation, with a frozen detector.

    A clip of a block is encoded once for all its passes: the last `most` ones are kept.
    """

    def __init__(self, settings: SampleSettings, seed: int, most: int, detector: DetectorNet, see: See) -> None:
        self._settings, self._seed, self._most = settings, seed, most
        self._detector, self._see = detector, see
        self._encoded: OrderedDict[str, EncodedClip] = OrderedDict()

    def cut(self, clip: Clip, rng: np.random.Generator) -> list[QueryStream]:
        """Draw a use of a clip; none is possible."""
        return _as_list(draw_stream(self._encode(clip), rng, self._settings))

    def cut_held_out(self, clip: Clip, rng: np.random.Generator, settings: SampleSettings) -> list[QueryStream]:
        """Draw a use of a held-out clip with other settings, without what only makes training harder."""
        plain = replace(settings, thinned=0.0, mirrored=0.0, dropout=0.0)
        return _as_list(draw_stream(encode_clip(clip, rng, plain, self._detector, self._see), rng, plain))

    def _encode(self, clip: Clip) -> EncodedClip:
        if clip.key not in self._encoded:
            rng = stream(self._seed, "training.watch", clip.key)  # the same after an interruption
            self._encoded[clip.key] = encode_clip(clip, rng, self._settings, self._detector, self._see)
            while len(self._encoded) > self._most:
                self._encoded.popitem(last=False)
        return self._encoded[clip.key]


def _as_list(drawn: QueryStream | None) -> list[QueryStream]:
    return [] if drawn is None else [drawn]


@dataclass(frozen=True, slots=True, eq=False)
class TrueObjects:
    """The objects around an agent in a frame, in its compass frame.

    Attributes:
        box: (N, 7).
        velocity: (N, 2) m/s.
        label: (N,) int64.
        shown: (N,) bool, the objects that are to be found; an instance of another one is neither right nor wrong.
    """

    box: Tensor
    velocity: Tensor
    label: Tensor
    shown: Tensor


def true_objects(sample: QueryStream, number: int, agent: int, *, alone: bool) -> TrueObjects:
    """Return the objects around an agent in a scene; its points, and messages unless `alone`, say which are shown."""
    scene = sample.clip.scenes[number]
    shown = scene.returns[:, agent].copy()
    for sender in () if alone else sample.members:
        then = number - int(sample.late[sender])
        if then >= 0:
            earlier = sample.clip.scenes[then]
            shown |= np.isin(scene.object_id, earlier.object_id[earlier.returns[:, sender]])
    box = scene.box.clone()
    box[:, :3] -= torch.from_numpy(scene.place_m[agent]).to(box)
    return TrueObjects(box, scene.velocity, scene.label, torch.from_numpy(shown).to(box.device))


_ROUNDING_S = 1e-6


@torch.no_grad()
def fused_view(
    net: CooperativeNet, sample: QueryStream, number: int, receiver: int, crop_cells: int | None
) -> tuple[Tensor, BevGrid]:
    """Return a receiver's fused map (C, h, w) of its own and the messages in a scene, and its cells.

    Late messages are moved to now by the network's flow, if it has one. Agents are all taken for cars. The view around
    the receiver has an edge of `crop_cells` cells of the features, or the edge of its own map.
    """
    own = sample.clip.scenes[number].seen[receiver]
    grid, features = _middle(own.grid, crop_cells), own.features.float()
    inside, own_mask = warp(features[None], own.grid, grid, np.zeros((1, 3)))
    parts, delays = [], []
    for sender in sample.members:
        then = number - int(sample.late[sender])
        if sender != receiver and then >= 0:
            delays.append((number - then) * sample.clip.dt_s)
            values, cells = _message(net, sample, then, sender, delays[-1])
            way = sample.receiver_SE3_sender(number, receiver, sender, then).inverse()
            parts.append(warp(values, cells, grid, stack_xyz_yaw(way)[[0, 1, 3]][None]))
    if not parts:
        return inside[0], grid
    received, mask = torch.cat([each for each, _ in parts]), torch.cat([each for _, each in parts])
    kinds = torch.zeros(len(parts), dtype=torch.long, device=features.device)
    sure, _ = warp(net.confidence(as_batch(features))[None], own.grid, grid, np.zeros((1, 3)))
    context = FusionContext(torch.tensor(delays, device=features.device), kinds, received[:, -1], sure[0, 0])
    return net(inside[0], own_mask[0], received[:, :-1], mask, context), grid


def _message(
    net: CooperativeNet, sample: QueryStream, then: int, sender: int, delay_s: float
) -> tuple[Tensor, BevGrid]:
    """Return a sender's message of a scene, a delay later, (1, C + 1, h, w) with confidences, and its cells."""
    seen = sample.clip.scenes[then].seen[sender]
    values, sure = net.message(as_batch(seen.features.float()))
    dt_s = sample.clip.dt_s
    if net.flow is not None and delay_s > 0 and then > 0 and dt_s <= LONGEST_S + _ROUNDING_S:
        earlier = sample.clip.scenes[then - 1].seen[sender]
        before, _ = net.message(as_batch(earlier.features.float()))
        placed, known = warp(before, earlier.grid, seen.grid, _before_SE2_then(sample, then, sender)[None])
        change = net.flow(values, placed, known, torch.tensor([dt_s], device=values.device))
        values = moved_on(values, change, torch.tensor([delay_s], device=values.device))
    return torch.cat([values, sure[:, None]], dim=1), seen.grid


def _before_SE2_then(sample: QueryStream, then: int, sender: int) -> Floats:
    """Return a sender's compass frame of a scene in that of the scene before, without error of odometry."""
    shift = sample.clip.scenes[then].place_m[sender] - sample.clip.scenes[then - 1].place_m[sender]
    return np.array([shift[0], shift[1], 0.0])


def _middle(grid: BevGrid, cells: int | None) -> BevGrid:
    """Return the square of `cells` cells in the middle of a square grid."""
    left = 0 if cells is None else max(0, grid.shape[0] - cells) // 2
    reach_m = left * grid.cell_m
    (x_low, x_high), (y_low, y_high) = grid.x_m, grid.y_m
    return BevGrid((x_low + reach_m, x_high - reach_m), (y_low + reach_m, y_high - reach_m), grid.cell_m)

"""Detections and truth of one episode: what the receivers of a policy perceived in the measured frames."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from coopsim.bench.detect.part_clock import PartClock
from coopsim.bench.detect.perceived import Perceived
from coopsim.catalog import is_recordings_folder
from coopsim.episode import Episode, Recorder, run_episode
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D, covers
from coopsim.provided import listening_env
from coopsim.support.checks import require_choice
from coopsim.types import NS_PER_S, Detections, GroundTruth, seconds_to_ns
from coopsim.types.valid_detections import drop_invalid

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy
    from coopsim.envs.parallel import CooperativeEnv


@dataclass(frozen=True, slots=True)
class Pace:
    """Frames of an episode that are measured.

    Attributes:
        frames: number of measured frames.
        every: number of the environment's frames from one to the next.
        warm_up: frames before the first, until messages have arrived.
    """

    frames: int
    every: int = 1
    warm_up: int = 1

    @property
    def cycles(self) -> int:
        """Number of the environment's frames."""
        return self.warm_up + (self.frames - 1) * self.every + 1

    def measures(self, frame: int) -> bool:
        """Return whether the environment's frame of this number is measured."""
        return frame >= self.warm_up and (frame - self.warm_up) % self.every == 0


def pace_of(frames: int, every_s: float, delay_s: float, fixed_s: float | None = None) -> tuple[float, Pace]:
    """Choose the time between an environment's frames, s, and the measured ones.

    The delay of messages is a whole number of frames, so that they are as old as it says. Before the first measured
    frame a message has gone there and its answer has come back: some methods send what others ask for.

    Args:
        frames: number of measured frames.
        every_s: least time between them.
        delay_s: delay of messages.
        fixed_s: time between frames, where it is given.
    """
    if fixed_s is not None:
        step_ns = seconds_to_ns(fixed_s)
    elif delay_s:
        delay_ns = seconds_to_ns(delay_s)
        step_ns = -(-delay_ns // math.ceil(delay_s / every_s - 1e-9))
    else:
        step_ns = seconds_to_ns(every_s)
    step_s = step_ns / NS_PER_S
    ticks = math.ceil(delay_s / step_s - 1e-6)
    return step_s, Pace(frames, max(1, math.ceil(every_s / step_s - 1e-6)), 1 + 2 * ticks)


Receivers = Literal["cars", "all"]
Boxes = Literal["detections", "tracks"]
RECEIVERS, BOXES = ("cars", "all"), ("detections", "tracks")


@dataclass(frozen=True, slots=True)
class Selection:
    """Receivers and boxes that are measured.

    Attributes:
        receivers: "cars", or "all" agents.
        boxes: "detections", or the reported "tracks".
        without: names of agents that are no receivers here.

    Raises:
        UnknownNameError: `receivers` or `boxes` is not accepted.
    """

    receivers: Receivers = "cars"
    boxes: Boxes = "detections"
    without: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require_choice("receivers", self.receivers, RECEIVERS)
        require_choice("boxes", self.boxes, BOXES)

    def as_dict(self) -> dict[str, Any]:
        """Return the fields by name, `without` only where it names any: keys are made from them."""
        return {name: value for name, value in asdict(self).items() if name != "without" or value}


def perceive_episode(
    policy: Policy,
    environment: str,
    seed: int,
    options: Mapping[str, Any],
    pace: Pace,
    selection: Selection | None = None,
    recorders: Sequence[Recorder] = (),
) -> Perceived:
    """Run a policy through one episode, and collect what its receivers perceived and what was there.

    Detections are those of the policy's method `detections(agent)`, which policies of tracking have, else the tracks
    that it reports. Boxes over the receiver are left out: it is not its own object.

    Raises:
        CoopsimError: a name is unknown or a value is not accepted; the message says what is accepted.
    """
    selection = selection or Selection()
    clock = PartClock(max(pace.warm_up, 1))
    made = {"max_cycles": pace.cycles, **options, "expose_ground_truth": True}
    with closing(listening_env(environment, policy, made)) as env:
        pace = pace_in(environment, env, pace)
        kept = PerceivedRecorder(pace, receiving(env, selection), selection.boxes)
        episode = run_episode(env, policy, (clock, kept, *recorders), seed=seed, most_steps=pace.cycles)
        if not kept.frames:
            raise InvalidValueError(f"{environment} has an episode of {episode.steps} frames, too short to be measured")
        messages, sent_bytes = _broadcasts(env)
        return Perceived.of(
            kept.found,
            kept.truth,
            env.region_m,
            frames=kept.frames,
            messages=messages,
            sent_bytes=sent_bytes,
            ms=clock.ms,
        )


class PerceivedRecorder(Recorder):
    """Recorder of detections: those of some receivers in the measured frames, beside the truth.

    Args:
        pace: says which frames are measured.
        receivers: names of agents.
        boxes: "detections", or the reported "tracks".

    Attributes:
        found: boxes of each receiver and frame.
        truth: truth around the same receiver in the same frame.
        frames: number of measured frames.
    """

    def __init__(self, pace: Pace, receivers: Sequence[str], boxes: Boxes) -> None:
        self._pace, self._receivers, self._boxes = pace, receivers, boxes
        self.found: list[Detections] = []
        self.truth: list[GroundTruth] = []
        self.frames = 0

    def on_report(self, episode: Episode) -> None:
        if not self._pace.measures(episode.steps):
            return
        self.frames += 1
        given, specs = episode.observations, episode.env.agent_specs
        there = [name for name in self._receivers if name in given]  # a recording need not have all
        for name in (each for each in there if given[each].get("sensed", 1)):
            seen = _detections(episode.policy, name, episode.actions[name], self._boxes)
            self.found.append(_without_itself(seen) if specs[name].is_object else seen)
            self.truth.append(_truth(episode.infos[name]["ground_truth"]))


def pace_in(environment: str, env: CooperativeEnv, pace: Pace) -> Pace:
    """Return the pace in an environment: in recordings of one agent no message is waited for, so no frame is lost."""
    alone = is_recordings_folder(environment) and len(env.possible_agents) == 1
    return replace(pace, warm_up=0) if alone else pace


def receiving(env: CooperativeEnv, selection: Selection) -> list[str]:
    """Return the names of the measured agents.

    Raises:
        InvalidValueError: there is no such agent.
    """
    everyone = selection.receivers == "all"
    cars = [name for name, spec in env.agent_specs.items() if everyone or spec.kind == "cav"]
    names = [name for name in cars if name not in selection.without]
    if cars and not names:
        raise InvalidValueError(
            f"receivers must have an agent that does not lie, and {', '.join(cars)} do. Accepted: receivers 'all', or "
            "fewer liars"
        )
    if not names:
        kinds = ", ".join(sorted({spec.kind for spec in env.agent_specs.values()}))
        raise InvalidValueError(f"receivers 'cars' need a connected car, and the agents are: {kinds}. Accepted: 'all'")
    return names


def _detections(policy: object, agent: str, action: Mapping[str, Any], boxes: str) -> Detections:
    perceived = getattr(policy, "detections", None)
    if boxes == "detections" and callable(perceived):
        seen: Detections = perceived(agent)
        return drop_invalid(seen)
    tracks = action["tracks"]
    return Detections(Boxes3D.from_array(tracks["box"]), tracks["score"][:, 0], tracks["label"])


def _without_itself(found: Detections) -> Detections:
    return found[~covers(found.boxes, np.zeros(2))]


def _truth(columns: Mapping[str, Any]) -> GroundTruth:
    return GroundTruth(
        columns["id"],
        Boxes3D.from_array(columns["box"]),
        columns["label"],
        columns.get("visible_to"),
        returns=columns.get("returns"),
        counts=columns["counts"],
    )


def _broadcasts(env: CooperativeEnv) -> tuple[int, int]:
    """Return the number of broadcasts of the episode so far, and their bytes together."""
    copies: defaultdict[str, list[int]] = defaultdict(list)
    for (sender, _), counts in env.link_counts.items():
        copies[sender].append(counts.sent)
    dt_s = next(iter(env.agent_specs.values())).dt_s
    on_air_s = env.time_ns / NS_PER_S + dt_s
    sent_bytes = sum(env.bytes_per_s(name) * on_air_s for name in env.possible_agents)
    return sum(max(counts) for counts in copies.values()), round(sent_bytes)

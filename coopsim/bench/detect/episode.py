"""Episode of a policy, run at a pace and timed by parts, with everything that its receivers perceived."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from coopsim.bench.detect.perceived import Perceived
from coopsim.bench.evaluate import listening_env
from coopsim.catalog import is_recordings_folder
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D, covers
from coopsim.support.checks import require_choice
from coopsim.support.rng import derived_seed
from coopsim.types import NS_PER_S, Detections, GroundTruth, seconds_to_ns
from coopsim.types.valid_detections import drop_invalid

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy
    from coopsim.comms.uplinks.uplink import Uplink
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


class PartClock:
    """Wall time by part. Time within a part is taken from the part around it.

    The making of messages, `uplink`, runs within the environment's step and is counted by itself: a network's encoder
    is there. The parts of a policy's mapping `timings` (seconds by part since its making) are counted as well. From its
    making on, the clock times the uplinks of `policy`; `running` says whether time is counted now.
    """

    def __init__(self, policy: Policy) -> None:
        self.running = False
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._inner_s = 0.0
        self._frames = 0
        self._policy, self._before = policy, dict[str, float]()
        make = policy.make_uplink if hasattr(policy, "make_uplink") else None
        if make is not None:
            with suppress(AttributeError):  # an object without room for attributes is not clocked by part
                policy.make_uplink = self._clocked(make)  # type: ignore[method-assign]

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Count the time of a block."""
        outer_s, self._inner_s = self._inner_s, 0.0
        started = time.perf_counter()
        try:
            yield
        finally:
            spent_s = time.perf_counter() - started
            if self.running:
                self._seconds[name] += spent_s - self._inner_s
            self._inner_s = outer_s + spent_s

    def tick(self) -> None:
        """End a frame."""
        own = dict(getattr(self._policy, "timings", None) or {})
        if self.running:
            self._frames += 1
            for name, seconds in own.items():
                self._seconds[name] += seconds - self._before.get(name, 0.0)
        self._before = own

    @property
    def ms(self) -> dict[str, float]:
        """Mean milliseconds a frame, by part."""
        return {name: 1000 * seconds / max(self._frames, 1) for name, seconds in self._seconds.items()}

    def _clocked(self, make: Callable[..., Uplink]) -> Callable[..., Uplink]:
        clocked: set[int] = set()

        def make_clocked(*arguments: Any) -> Uplink:
            uplink = make(*arguments)
            if id(uplink) not in clocked:
                clocked.add(id(uplink))
                for name in ("messages", "contents"):  # with a budget the environment asks for contents
                    self._wrap(uplink, name)
            return uplink

        return make_clocked

    def _wrap(self, uplink: Uplink, name: str) -> None:
        method = getattr(uplink, name, None)
        if method is None:
            return

        def timed(observations: Any) -> Any:
            with self.part("uplink"):
                return method(observations)

        with suppress(AttributeError):
            setattr(uplink, name, timed)


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
) -> Perceived:
    """Run a policy through one episode, and collect what its receivers perceived and what was there.

    Detections are those of the policy's method `detections(agent)`, which policies of tracking have, else the tracks
    that it reports. Boxes over the receiver are left out: it is not its own object.

    Raises:
        CoopsimError: a name is unknown or a value is not accepted; the message says what is accepted.
    """
    selection = selection or Selection()
    clock = PartClock(policy)
    made = {**options, "max_cycles": pace.cycles, "expose_ground_truth": True}
    env = listening_env(environment, policy, made)
    try:
        pace = pace_in(environment, env, pace)
        names = receiving(env, selection)
        observations, infos = env.reset(seed=seed)
        policy.reset(env.agent_specs, seed=derived_seed(seed, "policy"))
        found: list[Detections] = []
        truth: list[GroundTruth] = []
        measured = 0
        for frame in range(pace.cycles):
            clock.running = frame >= max(pace.warm_up, 1)
            with clock.part("policy"):
                actions = policy.act(observations)
            if pace.measures(frame):
                measured += 1
                there = [name for name in names if name in observations]  # a recording need not have all
                for name in (each for each in there if observations[each].get("sensed", 1)):
                    seen = _detections(policy, name, actions[name], selection.boxes)
                    found.append(_without_itself(seen) if env.agent_specs[name].is_object else seen)
                    truth.append(_truth(infos[name]["ground_truth"]))
            with clock.part("environment"):
                observations, _, _, _, infos = env.step(actions)
            clock.tick()
            if not env.agents:
                break
        if not measured:
            raise InvalidValueError(f"{environment} has an episode of {frame + 1} frames, too short to be measured")
        messages, sent_bytes = _broadcasts(env)
        return Perceived.of(
            found, truth, env.region_m, frames=measured, messages=messages, sent_bytes=sent_bytes, ms=clock.ms
        )
    finally:
        env.close()


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


def _detections(policy: Policy, agent: str, action: Mapping[str, Any], boxes: str) -> Detections:
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

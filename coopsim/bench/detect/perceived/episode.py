"""One episode of a policy, with everything that its receivers perceived."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from coopsim.bench.detect.perceived.pace import Pace
from coopsim.bench.detect.perceived.part_clock import PartClock
from coopsim.bench.detect.perceived.perceived import Perceived
from coopsim.bench.evaluate import listening_env
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D, covers
from coopsim.support.checks import require_choice
from coopsim.support.rng import derived_seed
from coopsim.types import NS_PER_S, Detections, GroundTruth
from coopsim.types.valid_detections import drop_invalid

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy
    from coopsim.envs.parallel import CooperativeEnv

Receivers = Literal["cars", "all"]
Boxes = Literal["detections", "tracks"]
RECEIVERS, BOXES = ("cars", "all"), ("detections", "tracks")


def perceive_episode(
    policy: Policy,
    environment: str,
    *,
    seed: int,
    options: Mapping[str, Any],
    pace: Pace,
    receivers: Receivers = "cars",
    boxes: Boxes = "detections",
) -> Perceived:
    """Run a policy through one episode, and collect what its receivers perceived and what was there.

    Detections are those that the policy says it perceived: a method `detections(agent)`, which policies of tracking
    have. Of another policy they are the tracks that it reports. Boxes over the receiver are left out: it is not its own
    object.

    Args:
        policy: the policy.
        environment: name of the environment, or path of a scenario file or a folder of recordings.
        seed: decides everything in the episode.
        options: of the environment.
        pace: the frames that are measured.
        receivers: "cars", or "all" agents.
        boxes: "detections", or "tracks" for the reported ones of any policy.

    Raises:
        CoopsimError: a name is unknown or a value is not accepted; the message says what is accepted.
    """
    require_choice("boxes", boxes, BOXES)
    clock = PartClock(policy)
    made = {**options, "max_cycles": pace.cycles, "expose_ground_truth": True}
    env = listening_env(environment, policy, made)
    try:
        names = receiving(env, receivers)
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
                    seen = _detections(policy, name, actions[name], boxes)
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


def receiving(env: CooperativeEnv, receivers: str) -> list[str]:
    """Return the names of the agents that are measured.

    Raises:
        UnknownNameError: `receivers` is not one of `RECEIVERS`.
        InvalidValueError: there is no such agent.
    """
    require_choice("receivers", receivers, RECEIVERS)
    names = [name for name, spec in env.agent_specs.items() if receivers == "all" or spec.kind == "cav"]
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

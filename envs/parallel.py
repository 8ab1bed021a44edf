"""The environment: PettingZoo's parallel API around a source of frames, a channel and a scorer.

| step | what happens |
|---|---|
| 1 | the actions are checked, all of them, before anything changes |
| 2 | the reported tracks are scored against the truth of the frame they were computed for |
| 3 | the source advances by one frame: traffic, sensors, localization, detection |
| 4 | every agent's message is encoded and sent; every message that is due is delivered |
| 5 | observations, rewards and infos are returned |
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from coopsim.comms.channel.channel import ChannelCounts
from coopsim.envs.episode_scores import EpisodeScores
from coopsim.envs.exchange import Exchange, make_uplinks, message_parts, network_of
from coopsim.envs.frames import Frame, FrameSource, actor_rows
from coopsim.envs.infos import EpisodeInfos
from coopsim.envs.options import CommonOptions
from coopsim.envs.rewards import RewardOption, total
from coopsim.envs.scoring import Rewards, ScoredView
from coopsim.episode import Episode, policy_seed
from coopsim.errors import EpisodeStateError, InvalidValueError, RecordingError, UnknownNameError
from coopsim.metrics.score import Score
from coopsim.metrics.track_log import TrackLog
from coopsim.support.checks import require_choice
from coopsim.support.rng import fresh_seed, require_seed
from coopsim.types import NS_PER_S, AgentSpec, CameraImage, Observation, Tracks
from coopsim.types.driving import CarState
from coopsim.types.messages import MOST_STRANGERS
from coopsim.viz.bev import BevFrame
from coopsim.wire.actions import action_spaces, idle, unpack_actions
from coopsim.wire.columns import LaterSpaces
from coopsim.world.snapshot import RoadMap, StaticPart

Packed = dict[str, Any]
Stepped = tuple[dict[str, Packed], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]


class CooperativeEnv(ParallelEnv[str, Packed, Packed]):  # type: ignore[misc]  # pettingzoo is untyped
    """An environment in which agents perceive, exchange messages and report tracks, and are scored.

    Observation (dict, per agent; base frame: x forward, y left, z up, origin on the ground under the agent):

    | key | shape | meaning |
    |---|---|---|
    | time_ns | int | now, since the episode's start |
    | pose | (4,) | estimated x, y, z m and heading rad in the world frame |
    | odometry | (4,) | estimated motion since the last observation, in its base frame |
    | detections | box (N, 7), score (N, 1), label (N,) | the agent's own, base frame |
    | | embedding (N, D) | only if the detector gives any; of length 1, zeros for none |
    | | covariance (N, 7, 7) | only if the detector states any: of a box; zeros for none |
    | sweeps | per LiDAR (P, 5) | x, y, z m, intensity, beam |
    | cameras | per camera rgb (H, W, 3), depth (H, W) m | empty unless `cameras` says which |
    | inbox | sender, codec, captured_ns (M,), pose (M, 4), payload_bytes (M,) | messages that arrived since |
    | inbox_payload | (B, 1) | their payloads, end to end |
    | pose_covariance | (3, 3), in the inbox (M, 3, 3) | only where some agent states one; zeros for none |
    | signals, signals_payload | payload_bytes (M,), (B, 1) | with `signal_messages` or `uplink="intents"`: of ETSI's |
    | sensed | 0 or 1 | only with `sense_every` > 1: whether sensors and detector ran in this frame |

    Action (dict, per agent): `tracks` (id, box, velocity, score, label) in the agent's base frame, and for a car that
    the action drives `maneuver` (see `MANEUVERS`) or `acceleration_m_s2`. With `uplink="action"` it has `message`, too:
    what the agent sends of its observation. `coopsim.Policy` packs and unpacks these.

    The reward is `MotaReward` unless another is given. An episode is truncated at its last frame. With
    `ends_on_crash` it terminates, for all agents, when a driven car crashes; otherwise crashes do not end it.
    """

    def __init__(self, source: FrameSource, options: CommonOptions, reward: RewardOption = None) -> None:
        self._source, self._options = source, options
        # Made now, too, so that a wrong setting is refused here, not at the first episode.
        uplinks = make_uplinks(options, source.specs, seed=0)
        self._contents = {name: each.content for name, each in uplinks.items()}
        self._parts = message_parts(uplinks)
        self._specified: tuple[Mapping[str, AgentSpec], dict[str, AgentSpec]] = ({}, {})
        for option, agents in options.channel_config.agents_by_option.items():
            for agent in agents:
                require_choice(f"agent in {option}", agent, source.specs)
        dt_s = next(iter(source.specs.values())).dt_s
        self._rewards = Rewards(reward, dt_s, drives=len(source.driven) > 0, specs=self.agent_specs)
        self.has_default_reward = self._rewards.is_default  # rewards are then of the reported tracks
        self.possible_agents = list(source.specs)
        self.agents: list[str] = []
        self.render_mode = options.render_mode
        self.metadata = {
            "name": source.name,
            "render_modes": ["rgb_array", "human"],
            "is_parallelizable": True,
            "render_fps": max(1, round(1 / dt_s)),
        }
        if any(uplink.beside for uplink in uplinks.values()):
            source.format = replace(source.format, signals=True)
        form = replace(source.format, strangers=MOST_STRANGERS if options.attacks else 0)
        self._observation_spaces = LaterSpaces(source.specs, form.space)
        self._action_spaces = action_spaces(self.agent_specs, any_score=source.any_score)
        self.state_space = spaces.Box(-np.inf, np.inf, (source.capacity, 11), np.float64)
        self._episode: Episode | None = None
        self._halfway = False  # a call began to change things and did not come to its end
        self._exchange: Exchange
        self._scores: EpisodeScores
        self._infos: EpisodeInfos
        self._view = ScoredView(options.render_tracks == "all")

    def __repr__(self) -> str:
        episode = "no episode" if self._episode is None else f"seed {self._episode.seed}"
        return f"<{type(self).__name__} {self._source.name}: agents {', '.join(self.possible_agents)}; {episode}>"

    @property
    def agent_specs(self) -> Mapping[str, AgentSpec]:
        """Facts that a policy may know before an episode's first frame, for every possible agent.

        Sensors are mounted on cars, which differ in height from episode to episode: ask after `reset`.
        """
        given, specs = self._specified
        if given is not self._source.specs:
            given = self._source.specs
            specs = {
                name: replace(
                    spec, uplink=self._contents[name], codec=self._options.codec, message=self._parts.get(name)
                )
                for name, spec in given.items()
            }
            self._specified = given, specs
        return specs

    @property
    def sequences(self) -> tuple[str, ...]:
        """Names that `reset(options={"sequence": name})` can play, sorted; empty in a simulation."""
        return self._source.sequences

    @property
    def default_seed(self) -> int | None:
        """The option `seed`: of every episode for which `reset` is given none; None: a fresh one each time."""
        return self._options.seed

    def observation_space(self, agent: str) -> spaces.Dict:
        """Return the space of an agent's observations; always the same object.

        Raises:
            UnknownNameError: there is no such agent; the message lists those that there are.
        """
        return self._observation_spaces.of(agent)

    def action_space(self, agent: str) -> spaces.Dict:
        """Return the space of an agent's actions; always the same object.

        Raises:
            UnknownNameError: there is no such agent; the message lists those that there are.
        """
        return self._action_spaces.of(agent)

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Packed], dict[str, dict[str, Any]]]:
        """Begin an episode; return observations and infos by agent.

        Args:
            seed: integer >= 0 that decides everything; None takes the option `seed`, or without that a fresh seed (it
                is in the infos).
            options: options that the source understands (a replay: `{"sequence": "0003"}`); others raise a warning.

        Raises:
            InvalidValueError: the seed or the options have a wrong type or value. The environment is as it was before.
            UnknownNameError: an option's value is unknown. The environment is as it was before.
            RecordingError: the recording to replay is broken. The environment is as it was before.
        """
        seed = self.default_seed if seed is None else seed
        seed = fresh_seed() if seed is None else seed
        require_seed(seed)
        known = self._source.known_options(options)
        before, self._halfway, source = self._halfway, True, self._source
        try:
            frame = source.start(seed, known)
        except (UnknownNameError, RecordingError):  # what was asked for is not there, and nothing has begun
            self._halfway = before
            raise
        self._exchange = Exchange(self._options, source, seed)
        self.agents = list(frame.agents)
        self._rewards.begin(self.agent_specs, self._options.match_iou, source.region_m, seed)
        received, observations = self._observe(frame)
        self._infos, lies = EpisodeInfos(frame, self._options, staged=source.staged), self._exchange.lies
        infos = self._infos.of_reset(frame, {"seed": seed, **source.episode_infos}, lies)
        facts, policy = {**source.facts, **self._exchange.facts}, network_of(self._options)
        self._episode = Episode(self, seed, frame, received, observations, infos, lies, facts, policy)
        self._scores = EpisodeScores(self._episode, self._options.false_positives, self._view)
        self._show_if_human()
        self._halfway = False
        return observations, infos

    def step(self, actions: dict[str, Packed]) -> Stepped:
        """Score the tracks reported for this frame, and go to the next frame.

        Args:
            actions: one action for every agent in `agents`, no more and no less.

        Raises:
            EpisodeStateError: before `reset`, after the episode's end, or after an error in the middle of a step (of a
                detector or a reward, say), which leaves no whole frame to go on from.
            PlannerError: a planner raised, took too long, or returned no number; call `reset` to go on.
            InvalidActionError: names the agent and what is wrong. The environment is as it was before.
        """
        frame = self._running()
        cars = {name: spec.command for name, spec in self.agent_specs.items() if spec.command is not None}
        any_score = self._source.any_score
        tracks, commands, said = unpack_actions(self.agents, actions, cars, self._parts, any_score=any_score)
        messages = self._exchange.compose(frame, said)
        self._halfway, episode = True, self.episode
        episode.report(actions, tracks)
        self._scores.on_report(episode)
        counts = self._scores.tracks.counts
        over = episode.frame = frame.without_probe()  # frees the scene that is over
        self._exchange.tell(over, messages, said)
        frame = self._source.advance(commands, tracks)
        received, packed = self._observe(frame)
        self.agents = [] if frame.last else list(frame.agents)
        parts = self._rewards.of_step(counts, over, frame)
        rewards = {name: total(each) for name, each in parts.items()}
        lies, uplink_s = self._exchange.lies, self._exchange.uplink_s
        infos = self._infos.of_step(over, frame, counts, parts, lies)
        episode.go_on(frame, received, observations=packed, rewards=rewards, infos=infos, lies=lies, uplink_s=uplink_s)
        self._scores.on_step(episode)
        self._show_if_human()
        terminated = dict.fromkeys(counts, frame.terminal)
        truncated = dict.fromkeys(counts, frame.last and not frame.terminal)
        self._halfway = False
        return packed, rewards, terminated, truncated, infos

    def frames(self, seed: int, sequence: str | None = None) -> Iterator[Frame]:
        """Yield the frames of an episode as its sensors make them, without exchange and scores: for export.

        They hold the truth, so this needs `expose_ground_truth`. Cars that the action would drive keep their lane, and
        planners get no tracks. The episode that was running is over.

        Args:
            seed: decides everything.
            sequence: sequence of a recording; None: the source's own choice.

        Raises:
            InvalidValueError: the truth is not exposed, or the seed has a wrong type or value.
            UnknownNameError: there is no such sequence.
        """
        if not self._options.expose_ground_truth:
            raise InvalidValueError("frames hold the truth: they need expose_ground_truth=True")
        require_seed(seed)
        self._episode, self.agents, self._halfway = None, [], False
        idling = {name: idle(spec.command) for name, spec in self.agent_specs.items() if spec.drives}
        frame = self._source.start(seed, {} if sequence is None else {"sequence": sequence})
        yield frame
        while not frame.last:
            frame = self._source.advance(idling, {name: Tracks.empty() for name in frame.agents})
            yield frame

    def score(self) -> Score:
        """Return the episode's score so far: each agent's and their mean."""
        self._require_episode()
        return self._scores.score(self.bytes_per_s)

    @property
    def episode(self) -> Episode:
        """The running episode, as recorders see it."""
        return self._require_episode()

    @property
    def policy_seed(self) -> int:
        """Seed for `Policy.reset` in the running episode; it tells nothing of the world's random numbers."""
        return policy_seed(self.episode.seed)

    @property
    def records(self) -> dict[str, dict[str, Any]]:
        """Records of the episode for metrics, by the recorder's name and by agent: "drives" of driven cars, say."""
        self._require_episode()
        return self._scores.records

    @property
    def logs(self) -> dict[str, TrackLog]:
        """Reported tracks and ground truth, by agent; scores of many episodes pool these."""
        self._require_episode()
        return self._scores.tracks.records()

    @property
    def cars(self) -> dict[str, CarState]:
        """States of the cars that a planner or the action drives, by agent: what their drivers know of them."""
        return {name: agent.car for name, agent in self.episode.frame.agents.items() if agent.car is not None}

    @property
    def time_ns(self) -> int:
        """Now, since the episode's start."""
        return self.episode.frame.time_ns

    @property
    def road_map(self) -> RoadMap:
        """Outlines of the running episode's place for pictures, in the world frame."""
        return self._source.road_map

    @property
    def static(self) -> tuple[StaticPart, ...]:
        """Meshes of the running episode's place that never move, in the world frame; none in a replay."""
        return self._source.static

    @property
    def match_iou(self) -> float:
        """3D IoU from which a track can be matched with an object."""
        return self._options.match_iou

    @property
    def region_m(self) -> tuple[float, float] | None:
        """Half length and width of the evaluation region around each agent, m; None: there is no limit."""
        return self._source.region_m

    @property
    def episode_infos(self) -> Mapping[str, Any]:
        """Facts of the running episode in all agents' infos, besides its seed: a drawn place's `place_seed`."""
        self._require_episode()
        return self._source.episode_infos

    @property
    def channel_counts(self) -> ChannelCounts:
        """Numbers of this episode's messages that were sent, delivered and lost, each counted for every other agent."""
        self._require_episode()
        return self._exchange.channel.counts

    @property
    def link_counts(self) -> Mapping[tuple[str, str], ChannelCounts]:
        """The same by link: sender and receiver. A link without a message so far is absent."""
        self._require_episode()
        return self._exchange.channel.link_counts

    def bytes_per_s(self, agent: str) -> float:
        """Return the bytes that an agent has broadcast per second of simulated time, envelopes included."""
        elapsed_s = self.time_ns / NS_PER_S + self.agent_specs[agent].dt_s
        return self._exchange.channel.broadcast_bytes(agent) / elapsed_s

    def state(self) -> NDArray[np.float64]:
        """Return all actors in the world frame, (capacity, 11): id, label, x, y, z, l, w, h, yaw, vx, vy.

        For centralised training; rows beyond the last actor are zero.
        """
        return actor_rows(self.episode.frame.actors, self._source.capacity)

    def bev_frame(self, *, points: bool = True, agent: str | None = None) -> BevFrame:
        """Return the frame that was scored last, with the tracks reported for it, in the world frame.

        Args:
            points: include the points of sweeps, which takes longer than the rest.
            agent: agent whose points are included; None: all.
        """
        self._require_episode()
        return self._view.bev_frame(points=points, agent=agent)

    def photograph(self) -> Mapping[str, Mapping[str, CameraImage]]:
        """Photograph the current frame through every agent's cameras, also where `cameras` is off; for pictures.

        By agent and camera; empty where there is nothing to photograph (a replay).
        """
        return self.episode.frame.probe.photograph()

    def render(self, ego: str | None = None) -> NDArray[np.uint8] | None:
        """Draw `bev_frame()` from above: (H, W, 3) uint8 for "rgb_array", a window for "human".

        It is about the agent `ego`; None: the first driven car, else the first agent. It shows which tracks are false.
        """
        if self.render_mode is None:
            warnings.warn("render() does nothing: the environment was made without a render_mode", stacklevel=2)
            return None
        self._require_episode()
        return self._view.render(self.render_mode, ego)

    def close(self) -> None:
        """Close the window and release the sensors' resources."""
        self._view.close()
        self._source.close()

    def _require_episode(self) -> Episode:
        if self._episode is None:
            raise EpisodeStateError("there is no episode yet: call reset first")
        return self._episode

    def _running(self) -> Frame:
        frame = self.episode.frame
        if self._halfway:
            raise EpisodeStateError("the last step or reset ended halfway in an error: call reset to begin an episode")
        if not self.agents:
            raise EpisodeStateError("the episode is over: call reset to begin another")
        return frame

    def _observe(self, frame: Frame) -> tuple[dict[str, Observation], dict[str, Packed]]:
        """Exchange messages, and return every agent's observation, also packed."""
        received = self._exchange.step(frame)
        self._source.hear(received)
        # The episode keeps them until the next frame: memory freed at the end of the heap would be returned, and
        # fetched page by page.
        observations = self._source.format.pack_all(received)
        self._rewards.hear(frame, received, self._exchange.sent_bytes)
        return received, observations

    def _show_if_human(self) -> None:
        if self.render_mode == "human":
            self.render()

"""The format of actions: their gymnasium space, and tracks and commands to dicts of arrays and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from coopsim.errors import CoopsimError, InvalidActionError
from coopsim.geometry.boxes import Boxes3D
from coopsim.support.arrays import Floats, as_numbers
from coopsim.types import AgentSpec, Tracks
from coopsim.types.driving import (
    ACCELERATION,
    LARGEST_ACCELERATION_M_S2,
    LARGEST_BRAKING_M_S2,
    LARGEST_STEERING_RAD,
    MANEUVER,
    STEERING,
    Command,
)
from coopsim.types.messages import IDLE, MANEUVERS, MessagePart, Said
from coopsim.types.taxonomy import CLASS_NAMES
from coopsim.wire.columns import COUNTER, LaterSpaces, box_space, real_space, rows_space
from coopsim.wire.message_parts import message_space, unpack_message

_TRACK_COLUMNS = {
    "id": ("track id", np.dtype(np.int64)),
    "box": ("track box", np.dtype(np.float64)),
    "velocity": ("track velocity", np.dtype(np.float64)),
    "score": ("track score", np.dtype(np.float64)),
    "label": ("track label", np.dtype(np.int64)),
}
"""Names for errors, and types."""

MOST_TRACKS = 10_000
"""Tracks that an agent may report in a frame; a score looks at each together with every object."""


MESSAGE = "message"
"""Key of the part of an action that says what the agent sends."""


SCORES = (0.0, 1.0)
"""Least and largest score of a track, except where recorded detections have other scores."""

_ROUNDING = 1e-6


def action_space(
    command: str | None = None, message: MessagePart | None = None, *, any_score: bool = False
) -> spaces.Dict:
    """Return a space of one agent's actions: its tracks and, where it has them, `AgentSpec.command` and `message`.

    With `any_score` the scores of tracks are any numbers, as those of recorded detections.
    """
    tracks = rows_space(
        id=spaces.Discrete(COUNTER),
        box=box_space(),
        velocity=real_space(2),
        score=real_space(1) if any_score else spaces.Box(*SCORES, (1,), np.float64),
        label=spaces.Discrete(len(CLASS_NAMES)),
    )
    parts: dict[str, spaces.Space[Any]] = {"tracks": tracks}
    if command is not None:
        parts[command] = command_space(command)
    if message is not None:
        parts[MESSAGE] = message_space(message)
    return spaces.Dict(parts)


def action_spaces(specs: Mapping[str, AgentSpec], *, any_score: bool = False) -> LaterSpaces:
    """Return the spaces of all agents' actions, by name; `any_score` as in `action_space`."""

    def make(agent: str) -> spaces.Dict:
        return action_space(specs[agent].command, specs[agent].message, any_score=any_score)

    return LaterSpaces(specs, make)


def command_space(command: str) -> spaces.Discrete | spaces.Box:
    """Return the space of a command: `Discrete` for maneuvers, a (1,) `Box` in m/s² for accelerations.

    Steering is a (2,) `Box`: acceleration in m/s², and angle of the front wheels in rad, positive to the left.
    """
    if command == MANEUVER:
        return spaces.Discrete(len(MANEUVERS))
    return spaces.Box(*_bounds(command), dtype=np.float32)


@cache
def _bounds(command: str) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the least and greatest numbers of an acceleration (1,), or of an acceleration and an angle (2,)."""
    low, high = [-LARGEST_BRAKING_M_S2, -LARGEST_STEERING_RAD], [LARGEST_ACCELERATION_M_S2, LARGEST_STEERING_RAD]
    count = 2 if command == STEERING else 1
    return np.array(low[:count], np.float32), np.array(high[:count], np.float32)


def idle(command: str | None) -> Command:
    """Return the command that changes nothing: the lane and the speed stay, or the speed, straight on."""
    if command == STEERING:
        return (0.0, 0.0)
    return 0.0 if command == ACCELERATION else IDLE


def pack_tracks(tracks: Tracks) -> dict[str, Any]:
    """Return tracks as an action's dict of arrays."""
    return {
        "id": tracks.id,
        "box": tracks.boxes.array,
        "velocity": tracks.velocity,
        "score": tracks.score[:, None],
        "label": tracks.label,
    }


def unpack_action(
    agent: str, action: object, command: str | None = None, *, any_score: bool = False
) -> tuple[Tracks, Command | None]:
    """Return the tracks and the command in one agent's action, checked and copied; None for agents that do not drive.

    `any_score` as in `action_space`.

    Raises:
        InvalidActionError: names the agent, what is wrong, and what is accepted.
    """
    wanted = {"tracks"} if command is None else {"tracks", command}
    if not isinstance(action, Mapping) or set(action) != wanted:
        got = sorted(map(str, action)) if isinstance(action, Mapping) else repr(action)
        raise InvalidActionError(f"{agent}: an action is a dict with {sorted(wanted)}, got {got}")
    try:
        tracks = _unpack_tracks(action["tracks"])
        tracks.validate()
        if not any_score:
            _require_scores(tracks.score)
    except CoopsimError as error:
        raise InvalidActionError(f"{agent}: {error}") from error
    if command is None:
        return tracks, None
    given = action[command]
    return tracks, _maneuver(agent, given) if command == MANEUVER else checked_numbers(agent, command, given)


def _maneuver(agent: str, given: Any) -> int:
    whole = isinstance(given, (int, np.integer)) and not isinstance(given, bool)
    if not (whole and 0 <= given < len(MANEUVERS)):
        names = ", ".join(f"{number} {name}" for number, name in enumerate(MANEUVERS))
        raise InvalidActionError(f"{agent}: maneuver must be one of {names}; got {given!r}")
    return int(given)


def checked_numbers(agent: str, command: str, given: Any) -> float | tuple[float, float]:
    """Return an acceleration, m/s², or under "steering" an acceleration and an angle, rad, of an agent's action.

    Raises:
        InvalidActionError: it is another number of numbers, or one of them is not finite or beyond its bounds.
    """
    try:
        numbers = as_numbers(given, np.float64, command).ravel()
    except CoopsimError as error:
        raise InvalidActionError(f"{agent}: {error}") from error
    low, high = _bounds(command)  # a bound in float32 may be a little more than the same bound here
    if not (len(numbers) == len(low) and (low <= numbers).all() and (numbers <= high).all()):
        ranges = [f"[{least:g}, {most:g}]" for least, most in zip(low, high, strict=True)]
        accepted = f"one number in {ranges[0]}" if len(low) == 1 else f"m/s² in {ranges[0]} and rad in {ranges[1]}"
        raise InvalidActionError(f"{agent}: {command} must be {accepted}, got {given!r}")
    first, *second = numbers.tolist()
    return (first, second[0]) if second else float(first)


def require_agents(actions: object, agents: Sequence[str]) -> Mapping[str, Any]:
    """Return actions by agent, if they are of exactly these agents.

    Raises:
        InvalidActionError: an agent is unknown or missing, or they are not by agent.
    """
    if not isinstance(actions, Mapping):
        raise InvalidActionError(f"actions are a dict by agent, got {type(actions).__name__}")
    unknown, missing = set(actions) - set(agents), set(agents) - set(actions)
    if unknown or missing:
        wrong = [f"unknown: {sorted(map(str, unknown))}"] * bool(unknown)
        wrong += [f"missing: {sorted(missing)}"] * bool(missing)
        raise InvalidActionError(f"actions need exactly the agents {list(agents)}; {', '.join(wrong)}")
    return actions


def unpack_actions(
    agents: Sequence[str],
    actions: object,
    commands: Mapping[str, str],
    parts: Mapping[str, MessagePart] = MappingProxyType({}),
    *,
    any_score: bool = False,
) -> tuple[dict[str, Tracks], dict[str, Command], dict[str, Said]]:
    """Return the tracks, the commands and the messages in the actions of all agents, checked and copied.

    Args:
        agents: names of the agents that must act.
        actions: actions by agent.
        commands: `AgentSpec.command` of the agents that drive, by name.
        parts: `AgentSpec.message` of the agents whose action says what they send, by name.
        any_score: scores of tracks are any numbers, see `action_space`.

    Raises:
        InvalidActionError: an agent is unknown or missing, or its action is malformed.
    """
    actions = require_agents(actions, agents)
    tracks: dict[str, Tracks] = {}
    given: dict[str, Command] = {}
    said: dict[str, Said] = {}
    for name in agents:
        action, part = actions[name], parts.get(name)
        if part is not None:
            action, said[name] = _without_message(name, action, part)
        tracks[name], command = unpack_action(name, action, commands.get(name), any_score=any_score)
        if command is not None:
            given[name] = command
    return tracks, given, said


def _without_message(agent: str, action: object, part: MessagePart) -> tuple[dict[str, Any], Said]:
    """Return an action without its message, and what that says."""
    if not isinstance(action, Mapping) or MESSAGE not in action:
        got = sorted(map(str, action)) if isinstance(action, Mapping) else repr(action)
        raise InvalidActionError(f"{agent}: an action is a dict with '{MESSAGE}', which may be None, got {got}")
    said = unpack_message(agent, action[MESSAGE], part)
    return {key: each for key, each in action.items() if key != MESSAGE}, said


def _unpack_tracks(packed: object) -> Tracks:
    if not isinstance(packed, Mapping) or packed.keys() != _TRACK_COLUMNS.keys():
        got = sorted(map(str, packed)) if isinstance(packed, Mapping) else repr(packed)
        raise InvalidActionError(f"tracks are a dict with {list(_TRACK_COLUMNS)}, got {got}")
    count = as_numbers(packed["id"], np.int64, "track id").size
    if count > MOST_TRACKS:
        raise InvalidActionError(f"an agent may report at most {MOST_TRACKS} tracks in a frame, got {count}")
    # Copies, so that later changes of the caller's arrays do not change its report.
    track_id, box, velocity, score, label = (
        as_numbers(packed[name], dtype, what).copy() for name, (what, dtype) in _TRACK_COLUMNS.items()
    )
    if track_id.size and not 0 <= track_id.min() <= track_id.max() < COUNTER:
        raise InvalidActionError(f"track id must be in 0..{COUNTER - 1}, got {track_id.min()}..{track_id.max()}")
    score = score[:, 0] if score.ndim == 2 and score.shape[1] == 1 else score
    return Tracks(track_id, Boxes3D.from_array(box), velocity, score, label)


def _require_scores(score: Floats) -> None:
    least, most = score.min(initial=SCORES[0]), score.max(initial=SCORES[0])
    if least < SCORES[0] - _ROUNDING or most > SCORES[1] + _ROUNDING:
        wrong = most if most > SCORES[1] + _ROUNDING else least
        raise InvalidActionError(f"track score must be in [{SCORES[0]:g}, {SCORES[1]:g}], got {wrong:g}")


def tracks_of(actions: Mapping[str, Any]) -> dict[str, Tracks]:
    """Return the tracks in the actions of agents, checked and copied, whatever their scores.

    Raises:
        InvalidActionError: tracks are malformed; the message names the agent.
    """
    return {
        name: unpack_action(name, {"tracks": action["tracks"]}, any_score=True)[0] for name, action in actions.items()
    }


class _Acts(Protocol):
    """Part of a policy that `act_of` needs."""

    @property
    def needs(self) -> Any: ...
    def act(
        self, observations: Mapping[str, Mapping[str, Any]], infos: Mapping[str, Mapping[str, Any]] | None = None, /
    ) -> dict[str, dict[str, Any]]: ...


def act_of(
    policy: _Acts, observations: Mapping[str, Mapping[str, Any]], infos: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return a policy's actions. The infos, in which the truth may be, go to a policy that `needs` it alone."""
    return policy.act(observations, infos) if policy.needs.truth else policy.act(observations)

"""The format of actions: their gymnasium space, and tracks and maneuvers to dicts of arrays and back."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from coopsim.errors import CoopsimError, InvalidActionError
from coopsim.geometry.boxes import Boxes3D
from coopsim.support.arrays import as_numbers
from coopsim.types import Tracks
from coopsim.types.messages import IDLE, MANEUVERS
from coopsim.types.taxonomy import CLASS_NAMES
from coopsim.wire.columns import COUNTER, box_space, real_space, rows_space

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy

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


def action_space(*, drives: bool) -> spaces.Dict:
    """Return a space of one agent's actions: the tracks that it reports and, if it drives, a maneuver."""
    tracks = rows_space(
        id=spaces.Discrete(COUNTER),
        box=box_space(),
        velocity=real_space(2),
        score=real_space(1),
        label=spaces.Discrete(len(CLASS_NAMES)),
    )
    parts: dict[str, spaces.Space[Any]] = {"tracks": tracks}
    if drives:
        parts["maneuver"] = spaces.Discrete(len(MANEUVERS))
    return spaces.Dict(parts)


def pack_tracks(tracks: Tracks) -> dict[str, Any]:
    """Return tracks as an action's dict of arrays."""
    return {
        "id": tracks.id,
        "box": tracks.boxes.array,
        "velocity": tracks.velocity,
        "score": tracks.score[:, None],
        "label": tracks.label,
    }


def unpack_action(agent: str, action: object, *, drives: bool) -> tuple[Tracks, int]:
    """Return the tracks and the maneuver in one agent's action, checked and copied.

    Raises:
        InvalidActionError: names the agent, what is wrong, and what is accepted.
    """
    wanted = {"tracks", "maneuver"} if drives else {"tracks"}
    if not isinstance(action, Mapping) or set(action) != wanted:
        got = sorted(map(str, action)) if isinstance(action, Mapping) else repr(action)
        raise InvalidActionError(f"{agent}: an action is a dict with {sorted(wanted)}, got {got}")
    try:
        tracks = _unpack_tracks(action["tracks"])
        tracks.validate()
    except CoopsimError as error:
        raise InvalidActionError(f"{agent}: {error}") from error
    maneuver = action["maneuver"] if drives else IDLE
    whole = isinstance(maneuver, (int, np.integer)) and not isinstance(maneuver, bool)
    if not (whole and 0 <= maneuver < len(MANEUVERS)):
        names = ", ".join(f"{number} {name}" for number, name in enumerate(MANEUVERS))
        raise InvalidActionError(f"{agent}: maneuver must be one of {names}; got {maneuver!r}")
    return tracks, int(maneuver)


def unpack_actions(
    agents: Sequence[str], actions: object, drivers: Collection[str]
) -> tuple[dict[str, Tracks], dict[str, int]]:
    """Return the tracks and the maneuvers in the actions of all agents, checked and copied; those of `drivers` have
    maneuvers.

    Raises:
        InvalidActionError: an agent is unknown or missing, or its action is malformed.
    """
    if not isinstance(actions, Mapping):
        raise InvalidActionError(f"actions are a dict by agent, got {type(actions).__name__}")
    unknown, missing = set(actions) - set(agents), set(agents) - set(actions)
    if unknown or missing:
        wrong = [f"unknown: {sorted(map(str, unknown))}"] * bool(unknown)
        wrong += [f"missing: {sorted(missing)}"] * bool(missing)
        raise InvalidActionError(f"actions need exactly the agents {list(agents)}; {', '.join(wrong)}")
    tracks: dict[str, Tracks] = {}
    maneuvers: dict[str, int] = {}
    for name in agents:
        tracks[name], maneuver = unpack_action(name, actions[name], drives=name in drivers)
        if name in drivers:
            maneuvers[name] = maneuver
    return tracks, maneuvers


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


def act_of(
    policy: Policy, observations: Mapping[str, Mapping[str, Any]], infos: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return a policy's actions. The infos, in which the truth may be, go to a policy that `needs` it alone."""
    return policy.act(observations, infos) if policy.needs.truth else policy.act(observations)

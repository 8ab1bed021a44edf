"""The conformance check of an attack."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import replace
from typing import Any

from coopsim.catalog import make_policy, parallel_env
from coopsim.episode import Episode, Recorder, run_episode
from coopsim.errors import CoopsimError
from coopsim.interfaces.attack import KNOWLEDGE, Attack, contents_of, hooks_of, make_attack
from coopsim.testing.harness import SMALL, digest, name_of
from coopsim.types import NS_PER_S, Message, Observation
from coopsim.types.lies import Lie

_LIAR, _RECEIVER, _FRAMES, _SEED, _START_S = "cav_1", "cav_0", 6, 3, 0.2

_POLICIES: Mapping[str, str] = {
    "detections": "late_fusion",
    "tracks": "track_to_track",
    "points": "no_fusion",
    "features": "attfuse",
    "queries": "cooptrack",
}
"""A policy for each content of messages; points are shared by the uplink of that name."""

_OF_BOXES = "detections", "tracks"

_Frame = tuple[Mapping[str, Observation], tuple[Lie, ...]]


def check_attack(attack: str | type[Attack] | Callable[[], Attack]) -> None:
    """Check that an attack keeps what environments rely on.

    It must override a hook and state its knowledge; lie in nothing but messages of its agent, from `start_s` on, and
    note each lie; send what codecs carry; leave all other agents' observations and messages as they are to the bit;
    and do the same again with the same seed, in a new object for each episode.

    Args:
        attack: a registered name or spec, the place of a class, a class, or a function that makes one.

    Raises:
        AssertionError: a check failed; the message names it.
        CoopsimError: there is no such attack.
    """
    name = name_of(attack)
    assert not isinstance(attack, Attack), f"{name} must be a class or a name: each agent has an attack of its own"
    made = make_attack(attack)
    assert make_attack(attack) is not made, f"{name} must make a new attack for each agent and episode"
    assert made.knowledge in KNOWLEDGE, f"{name} must state its knowledge, one of {KNOWLEDGE}, got {made.knowledge!r}"
    assert hooks_of(type(made)), f"{name} must override a hook"
    contents = [each for each in contents_of(type(made)) or _OF_BOXES if each in _POLICIES]
    for content in ["points"] if "points" in contents else contents:  # of points are features, too
        _check_in(attack, name, content)


def _check_in(attack: Any, name: str, content: str) -> None:
    def begun() -> Attack:
        made = make_attack(attack)
        made.start_s = max(made.start_s, _START_S)
        return made

    honest = _play(None, content)
    try:
        attacked, again = (_play({_LIAR: begun}, content) for _ in range(2))
    except CoopsimError as error:
        raise AssertionError(f"{name} must send what codecs carry: {error}") from error
    assert [_told(frame) for frame in attacked] == [_told(frame) for frame in again], (
        f"{name} must do the same again with the same seed"
    )
    for (before, _), (after, lies) in zip(honest, attacked, strict=True):
        _check_frame(name, before, after, lies)


def _check_frame(
    name: str, before: Mapping[str, Observation], after: Mapping[str, Observation], lies: tuple[Lie, ...]
) -> None:
    for agent, seen in before.items():
        assert digest(replace(seen, inbox=())) == digest(replace(after[agent], inbox=())), (
            f"{name} must leave the world and what {agent} senses as they are"
        )
    told = {sender for lie in lies for sender in lie.senders}
    one, two = (_by_sender(seen[_RECEIVER].inbox) for seen in (before, after))
    for sender in one.keys() | two.keys():
        if one.get(sender) != two.get(sender):
            assert sender == _LIAR or sender not in before, f"{name} must change its agent's messages only"
            assert sender in told, f"{name} must note that the message of {sender} lies (view.lie, claim or deny)"
            assert after[_LIAR].time_ns >= _START_S * NS_PER_S, f"{name} must not lie before start_s"


def _by_sender(inbox: tuple[Message, ...]) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    for message in inbox:
        found.setdefault(message.sender, []).append(message.identity)
    return found


def _told(frame: _Frame) -> str:
    seen, lies = frame
    inboxes = {agent: repr(_by_sender(each.inbox)) for agent, each in seen.items()}
    return digest({"inboxes": inboxes, "lies": {str(number): lie for number, lie in enumerate(lies)}})


def _play(attacks: Any, content: str) -> list[_Frame]:
    """Return what agents observe, and the lies, in each frame of a small episode."""
    policy = make_policy(_POLICIES[content])
    uplink: Any = content if content == "points" else policy
    rays = {"lidar": None} if content in _OF_BOXES else {}
    options = {**SMALL, **rays, "max_cycles": _FRAMES, "uplink": uplink, "attacks": attacks}
    seen = _Seen()
    with closing(parallel_env("crossing", **options)) as env:
        run_episode(env, policy, (seen,), seed=_SEED)
    return seen.frames


class _Seen(Recorder):
    """Observations of all agents, and the lies, in each frame."""

    def __init__(self) -> None:
        self.frames: list[_Frame] = []

    def begin(self, episode: Episode) -> None:
        self.frames.append((episode.received, episode.lies))

    on_step = begin

"""The conformance check of a defence."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from coopsim.catalog import make_policy
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.interfaces.defense import LEAST_TRUST, Claim, Defense, Reception, Trust, make_defense
from coopsim.interfaces.guard import checked_trust
from coopsim.testing.harness import SMALL, name_of, require_own_state, untouched
from coopsim.types import Detections

_FRAMES, _HOSTILE, _MANY, _AGENT = 15, 6, 20, "cav_0"

_Answers = Sequence[tuple[Mapping[str, float], list[list[float]]]]


def check_defense(
    defense: str | Defense | type[Defense] | Callable[[], Defense], *, believes_honest: bool = True
) -> None:
    """Check that a defence keeps what policies rely on.

    It must answer `Trust` with numbers in [0, 1] for no messages, many, late ones, and such with absurd content; leave
    its input as it is; and return the same again for the same episode, in a new object and whatever others judged
    before, as no two receivers or episodes may share state. With `believes_honest` it must believe, in the end, senders
    that claim just what the receiver itself detects.

    Args:
        defense: a registered name or spec, the place of a class, a class, or a function that makes one.
        believes_honest: require that it believes senders that agree with the receiver.

    Raises:
        AssertionError: a check failed; the message names it.
        CoopsimError: there is no such defence.
    """
    name = name_of(defense)
    assert not isinstance(defense, Defense), f"{name} must be a class or a name: each receiver has a defense of its own"
    made = make_defense(defense)
    assert make_defense(defense) is not made, f"{name} must make a new defense for each receiver"
    heard = _receptions()
    honest, hostile = [_agreeing(each) for each in heard], [_absurd(each, k) for k, each in enumerate(heard[:_HOSTILE])]

    def judge(defense: Defense, episode: Sequence[Reception]) -> _Answers:
        return _judged(defense, name, episode)

    require_own_state(lambda: make_defense(defense), judge, (honest, hostile), name, ("episode", "receivers"))
    if believes_honest:
        trust, _ = _judged(make_defense(defense), name, honest)[-1]
        doubted = {sender: round(value, 2) for sender, value in trust.items() if value < LEAST_TRUST}
        assert not doubted, f"{name} must believe senders that agree with the receiver, got {doubted}"


class _Recorder(Defense):
    """A defence that keeps what one receiver is given."""

    def __init__(self, kept: list[Reception]) -> None:
        self._kept = kept

    def judge(self, reception: Reception) -> Trust:
        if reception.spec.name == _AGENT:
            self._kept.append(reception)
        return Trust({})


def _receptions() -> list[Reception]:
    """Return the receptions of one agent of the small environment, which nobody attacks."""
    from coopsim.bench.evaluate import evaluate

    kept: list[Reception] = []
    policy = make_policy("late_fusion", defense=lambda: _Recorder(kept))
    evaluate(policy, "crossing", seed=2, max_cycles=_FRAMES, **SMALL)
    return kept


def _agreeing(reception: Reception) -> Reception:
    """Return a reception in which every message claims just what the receiver detects itself."""
    own = reception.observation.detections
    claims = [replace(claim, detections=own) for claim in reception.claims]
    return replace(reception, claims=claims, find=lambda senders: own, attackers=frozenset())


def _absurd(reception: Reception, number: int) -> Reception:
    """Return a reception with no messages, many senders, late stamps, and objects that cannot be."""
    rng = np.random.default_rng(number)
    claims = [_absurd_claim(claim, rng) for claim in reception.claims] * (0, 1, _MANY)[number % 3]
    claims = [replace(c, message=replace(c.message, sender=f"{c.sender}_{k}")) for k, c in enumerate(claims)]

    def find(senders: object) -> Detections:
        return Detections.concatenate([claim.detections for claim in claims if claim.sender in set(senders)])  # type: ignore[call-overload]

    liars = frozenset(claim.sender for claim in claims[::2])
    return replace(reception, claims=claims, find=find, attackers=liars)


def _absurd_claim(claim: Claim, rng: np.random.Generator) -> Claim:
    count = int(rng.integers(0, 50))
    center = rng.normal(0, (1.0, 50.0, 5000.0)[rng.integers(3)], (count, 3))
    boxes = Boxes3D(center, rng.uniform(0.01, 50, (count, 3)), rng.uniform(-np.pi, np.pi, count))
    speeds = np.where(rng.random((count, 2)) < 0.3, np.nan, rng.normal(0, 100, (count, 2)))
    found = Detections(boxes, rng.normal(0, 3, count), rng.integers(0, 9, count), velocity=speeds)
    pose = SE3.from_xyz_yaw(rng.normal(0, 3000, 3), float(rng.uniform(-3, 3)))
    return replace(claim, detections=found, base_SE3_sender=pose, age_s=float(rng.normal(0, 100)))


def _judged(defense: Defense, name: str, episode: Sequence[Reception]) -> _Answers:
    """Return what a defence answers in each frame of an episode."""
    rng, answers = np.random.default_rng(0), []
    for each in episode:
        reception = replace(each, rng=rng)
        with untouched((reception.observation, list(reception.claims)), f"{name} must leave its input as it is"):
            trust = _answer(defense, name, reception)
        objects = [np.asarray(part).tolist() for part in trust.objects or ()]
        answers.append((dict(trust.senders), objects))
    return answers


def _answer(defense: Defense, name: str, reception: Reception) -> Trust:
    try:
        trust: Any = defense.judge(reception)
    except Exception as error:
        raise AssertionError(f"{name} must return Trust, and raised {type(error).__name__}: {error}") from error
    try:
        return checked_trust(trust, reception)
    except Exception as error:
        raise AssertionError(f"{name}: {error}") from error

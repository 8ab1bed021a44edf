"""Wall time of the parts of a frame: the policy, the making of messages, the environment."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from coopsim.episode import Episode, Recorder

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy
    from coopsim.comms.uplinks.uplink import Uplink


class PartClock(Recorder):
    """Wall time by part, from a frame on: "policy", "environment" and "uplink".

    The making of messages, `uplink`, runs within the environment's step and is counted by itself: a network's encoder
    is there. The parts of a policy's mapping `timings` (seconds by part since its making) are counted as well. From its
    making on, the clock times the uplinks of `policy`, so make it before the environment.

    Args:
        policy: the policy that will run.
        first: number of the first frame that counts.
    """

    def __init__(self, policy: Policy, first: int = 1) -> None:
        self._first, self._frames = first, 0
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._uplink_s, self._within, self._before = 0.0, False, dict[str, float]()
        make = policy.make_uplink if hasattr(policy, "make_uplink") else None
        if make is not None:
            with suppress(AttributeError):  # an object without room for attributes is not clocked by part
                policy.make_uplink = self._clocked(make)  # type: ignore[method-assign]

    def begin(self, episode: Episode) -> None:
        self._before = self._now(episode)

    def on_step(self, episode: Episode) -> None:
        now, before = self._now(episode), self._before
        self._before = now
        if episode.steps > self._first:
            self._frames += 1
            for name, seconds in now.items():
                self._seconds[name] += seconds - before.get(name, 0.0)

    @property
    def ms(self) -> dict[str, float]:
        """Mean milliseconds a frame, by part."""
        return {name: 1000 * seconds / max(self._frames, 1) for name, seconds in self._seconds.items()}

    def _now(self, episode: Episode) -> dict[str, float]:
        """Return the seconds of each part so far."""
        parts = {"policy": episode.policy_s, "environment": episode.environment_s - self._uplink_s}
        own = dict(getattr(episode.policy, "timings", None) or {})
        return parts | ({"uplink": self._uplink_s} if self._uplink_s else {}) | own

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
            if self._within:  # messages are made of contents
                return method(observations)
            started, self._within = time.perf_counter(), True
            try:
                return method(observations)
            finally:
                self._within = False
                self._uplink_s += time.perf_counter() - started

        with suppress(AttributeError):
            setattr(uplink, name, timed)

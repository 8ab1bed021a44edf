"""Wall time of the parts of a frame: the policy, the making of messages, the environment."""

from __future__ import annotations

from collections import defaultdict

from coopsim.episode import Episode, Recorder


class PartClock(Recorder):
    """Wall time by part, from a frame on: "policy", "environment" and "uplink".

    The making of messages, `uplink`, runs within the environment's step and is counted by itself: a network's encoder
    is there. The parts of a policy's mapping `timings` (seconds by part since its making) are counted as well.

    Args:
        first: number of the first frame that counts.
    """

    def __init__(self, first: int = 1) -> None:
        self._first, self._frames = first, 0
        self._seconds, self._before = defaultdict[str, float](float), dict[str, float]()

    def begin(self, episode: Episode) -> None:
        self._before = _seconds(episode)

    def on_step(self, episode: Episode) -> None:
        before, self._before = self._before, _seconds(episode)
        if episode.steps > self._first:
            self._frames += 1
            for name, seconds in self._before.items():
                self._seconds[name] += seconds - before.get(name, 0.0)

    @property
    def ms(self) -> dict[str, float]:
        """Mean milliseconds a frame, by part."""
        return {name: 1000 * seconds / max(self._frames, 1) for name, seconds in self._seconds.items()}


def _seconds(episode: Episode) -> dict[str, float]:
    """Return the seconds of each part so far."""
    own = dict(getattr(episode.policy, "timings", None) or {})
    in_env = {"environment": episode.environment_s - episode.uplink_s, "uplink": episode.uplink_s}
    return {"policy": episode.policy_s, **in_env, **own}

"""Clocks of agents: times of sending, and errors of time stamps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.comms.channel.latency import MOST_S
from coopsim.support.checks import require_between, require_number
from coopsim.types import NS_PER_S, seconds_to_ns

_MOST_PPM = 1e4
_LATEST_NS = 2**62 - 1  # the largest that fits an observation's space
_ROUNDING_NS = 2  # frames' times are rounded: a tick that falls on a frame belongs to it


@dataclass(frozen=True, slots=True)
class AgentClock:
    """Clock of an agent.

    Sensors are read in frames: after a tick between two frames an agent sends the content of the second frame, and
    after several ticks between them it sends once.

    Attributes:
        rate_hz: ticks, and so messages, per second; None: one in each frame.
        phase_s: time of the first tick since the episode's start.
        offset_s: time by which stamps are ahead of true time, in [-3600, 3600].
        drift_ppm: microseconds per second that stamps gain, in [-1e4, 1e4].
        offset_noise_s: standard deviation of the noise on `offset_s`, drawn for each episode, in [0, 3600].
        drift_noise_ppm: standard deviation of the noise on `drift_ppm`, drawn for each episode, in [0, 1e4].
    """

    rate_hz: float | None = None
    phase_s: float = 0.0
    offset_s: float = 0.0
    drift_ppm: float = 0.0
    offset_noise_s: float = 0.0
    drift_noise_ppm: float = 0.0

    def __post_init__(self) -> None:
        if self.rate_hz is not None:
            require_number("in (0, 1e+06], or None: in each frame", lambda rate: 0 < rate <= 1e6, rate_hz=self.rate_hz)
        require_between(0, MOST_S, phase_s=self.phase_s)
        require_between(-MOST_S, MOST_S, offset_s=self.offset_s)
        require_between(-_MOST_PPM, _MOST_PPM, drift_ppm=self.drift_ppm)
        require_between(0, MOST_S, offset_noise_s=self.offset_noise_s)
        require_between(0, _MOST_PPM, drift_noise_ppm=self.drift_noise_ppm)

    def sample(self, rng: np.random.Generator) -> AgentClock:
        """Draw the clock of one episode, without noise. Takes two normals from `rng`, whatever the parameters."""
        ahead, gain = rng.standard_normal(2)
        offset_s = self.offset_s + float(ahead) * self.offset_noise_s
        drift_ppm = self.drift_ppm + float(gain) * self.drift_noise_ppm
        return AgentClock(
            self.rate_hz,
            self.phase_s,
            float(np.clip(offset_s, -MOST_S, MOST_S)),
            float(np.clip(drift_ppm, -_MOST_PPM, _MOST_PPM)),
        )

    def ticks(self, before_ns: int | None, now_ns: int) -> bool:
        """Return whether it ticks in (`before_ns`, `now_ns`]: since the previous frame, None if there is none."""
        return self._count(now_ns) > (0 if before_ns is None else self._count(before_ns))

    def stamp_ns(self, true_ns: int) -> int:
        """Return the clock's reading at a true time, at least 0."""
        ahead = self.offset_s + self.drift_ppm * 1e-6 * true_ns / NS_PER_S
        return min(max(0, true_ns + seconds_to_ns(ahead)), _LATEST_NS)

    def _count(self, now_ns: int) -> int:
        """Return the number of ticks until then."""
        since_ns = now_ns + _ROUNDING_NS - seconds_to_ns(self.phase_s)
        if since_ns < 0:
            return 0
        return now_ns + 1 if self.rate_hz is None else int(since_ns * self.rate_hz / NS_PER_S) + 1

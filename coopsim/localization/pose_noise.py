"""How the global pose of one agent errs over an episode.

White noise is the protocol of the cooperative-perception papers (V2X-ViT, Xu et al. 2022, sec. 5: Gaussian noise on
position and heading). A receiver's errors are not white: they wander (an Ornstein-Uhlenbeck process), have a constant
part, jump where reflections come and go, and stop when there is no signal.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from scipy.special import ndtr

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice, require_non_negative
from coopsim.support.rng import stream


@dataclass(frozen=True, slots=True)
class PoseNoise:
    """Standard deviations and times of the global pose's errors; the default has none.

    Attributes:
        position_noise_m: of x and of y.
        heading_noise_rad: of the heading.
        distribution: of these two, "gaussian" or "laplace" (longer tails, with the same standard deviation).
        correlation_s: over which these two lose their correlation to 1/e; 0: they are white.
        position_bias_m: of a constant part of x and of y, which is drawn for each episode.
        heading_bias_rad: the same of the heading.
        jump_m: of a part of x and of y that is 0 at first, and another after each jump.
        jumps_per_s: mean number of jumps per second.
        outage_s: mean duration of an outage, in which the pose is carried on by odometry.
        outages_per_s: mean number of beginning outages per second of reception.
    """

    position_noise_m: float = 0.0
    heading_noise_rad: float = 0.0
    distribution: Literal["gaussian", "laplace"] = "gaussian"
    correlation_s: float = 0.0
    position_bias_m: float = 0.0
    heading_bias_rad: float = 0.0
    jump_m: float = 0.0
    jumps_per_s: float = 0.0
    outage_s: float = 0.0
    outages_per_s: float = 0.0

    def __post_init__(self) -> None:
        require_choice("distribution", self.distribution, ("gaussian", "laplace"))
        numbers: dict[str, Any] = asdict(self)
        del numbers["distribution"]
        require_non_negative(**numbers)
        for size, rate in (("jump_m", "jumps_per_s"), ("outage_s", "outages_per_s")):
            if (numbers[size] > 0) != (numbers[rate] > 0):
                raise InvalidValueError(
                    f"{size} and {rate} must be both 0 or both > 0, got {numbers[size]!r} and {numbers[rate]!r}"
                )


class PoseError:
    """One agent's errors over one episode; asked once in each frame, in order.

    Every part has its own stream and takes the same draws whatever its size: runs that differ only in how large the
    noise is share its shape.

    Args:
        noise: what there is.
        seed: the episode's seed.
        agent: the agent's name, which owns the streams.
        dt_s: time between two frames.
    """

    def __init__(self, noise: PoseNoise, seed: int, agent: str, dt_s: float) -> None:
        self._noise, self._dt_s = noise, dt_s
        self._white, self._jumps, self._outages = (
            stream(seed, purpose, agent) for purpose in ("pose", "pose jumps", "pose outages")
        )
        bias = [noise.position_bias_m, noise.position_bias_m, 0.0, noise.heading_bias_rad]
        self._bias = stream(seed, "pose bias", agent).standard_normal(4) * bias
        self._wander: Floats | None = None
        self._offset = np.zeros(4)
        self._dark = False

    def step(self) -> Floats | None:
        """This frame's error (4,) of x, y, z m and heading rad in the world frame; None during an outage."""
        noise = self._noise
        error = self._shape(self._correlated()) * [
            noise.position_noise_m,
            noise.position_noise_m,
            0.0,
            noise.heading_noise_rad,
        ]
        self._jump()
        # Reception and outage are the two states of a chain whose stays are exponential, as its rates say.
        leave_per_s = 1 / noise.outage_s if self._dark else noise.outages_per_s
        if self._outages.random() < self._chance(leave_per_s):
            self._dark = not self._dark
        return None if self._dark else error + self._bias + self._offset

    def _correlated(self) -> Floats:
        """(4,) standard normal numbers, an Ornstein-Uhlenbeck process sampled in frames."""
        fresh = self._white.standard_normal(4)
        if self._wander is None or not self._noise.correlation_s:
            self._wander = fresh
        else:
            kept = math.exp(-self._dt_s / self._noise.correlation_s)
            self._wander = kept * self._wander + math.sqrt(1 - kept**2) * fresh
        return self._wander

    def _shape(self, normal: Floats) -> Floats:
        """Numbers of unit variance with the distribution, from normal ones with the same ranks."""
        if self._noise.distribution == "gaussian":
            return normal
        tail = 2 * ndtr(-np.abs(normal))  # the chance to be farther out, which a Laplace's quantile is the logarithm of
        laplace: Floats = -np.sign(normal) * np.log(tail) / math.sqrt(2)
        return laplace

    def _jump(self) -> None:
        due, offset = self._jumps.random(), self._jumps.standard_normal(2)
        if due < self._chance(self._noise.jumps_per_s):
            self._offset = np.array([*offset * self._noise.jump_m, 0.0, 0.0])

    def _chance(self, per_s: float) -> float:
        """That something that happens so often happens in a frame."""
        return -math.expm1(-per_s * self._dt_s)

"""Radio: path loss, blockage, shadowing, received power, and block error curves of the LTE-V2X sidelink.

Path loss, vehicle blockage and shadowing follow 3GPP TR 37.885, section 6.2.1, as implemented in ns-3 and QuaDRiGa,
which cite its tables; shadowing is correlated over the distance that the two ends move (Gudmundson 1991), with the
decorrelation distances of table 6.2.3-1. Transmitter and receiver are WiLabV2Xsim's. The report states blockage as
max(0 dB, log-normal). Here it is normal in dB, the sense in which shadowing is called log-normal; otherwise the maximum
would never be 0. ns-3 takes it as log-normal in dB.

Error curves come from link-level simulations of blocks of 350 bytes over fading channels, shipped with WiLabV2Xsim
(Todisco et al. 2021, IEEE Access 9; folder `PERcurves`, files `G5-*/PER_LTE_MCS*_350B.txt`). Each is given here by the
normal distribution function that fits it best, which is within 0.03 of every point of its table. The curves contain
fast fading but no shadowing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.special import ndtr

from coopsim.comms.radio.obstruction import Obstruction
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice, require_count, require_finite_number, require_positive

TABLE_BLOCK_BYTES = 350
"""Size of the blocks in the tables."""


@dataclass(frozen=True, slots=True)
class ErrorCurve:
    """Probability that a block is received: a normal distribution function of SNR, 50 % at `half_db`, 84 % `spread_db`
    above.
    """

    half_db: float
    spread_db: float

    def delivery(self, snr_db: Floats) -> Floats:
        """Return the probability that a block is received, in [0, 1], elementwise."""
        probability: Floats = ndtr((snr_db - self.half_db) / self.spread_db)
        return probability


ERROR_CURVES = {
    ("urban", "free"): {4: ErrorCurve(-0.85, 1.23), 7: ErrorCurve(2.85, 1.52), 11: ErrorCurve(5.98, 1.86)},
    ("urban", "blocked"): {4: ErrorCurve(1.21, 1.23), 7: ErrorCurve(5.11, 1.37), 11: ErrorCurve(8.45, 1.57)},
    ("highway", "free"): {4: ErrorCurve(-1.58, 1.26), 7: ErrorCurve(2.09, 1.45), 11: ErrorCurve(5.20, 1.62)},
    ("highway", "blocked"): {4: ErrorCurve(1.77, 1.16), 7: ErrorCurve(5.71, 1.20), 11: ErrorCurve(9.04, 1.53)},
}
"""By scene and line of sight, then by modulation and coding scheme: the tables `G5-UrbanLOS`, `G5-CrossingNLOS`,
`G5-HighwayLOS` and `G5-HighwayNLOS`. 4 and 7 are QPSK, 11 is 16-QAM."""

SCHEMES = (4, 7, 11)
"""LTE's modulation and coding schemes for which there are curves."""


DECORRELATION_M = {"LOS": 10.0, "NLOSv": 13.0, "NLOS": 13.0}
"""Distance over which the correlation of shadowing falls to 1/e, by obstruction (table 6.2.3-1)."""

_NEAREST_M = 1.0  # the formulas diverge at a distance of 0
_SHADOWING_DB = {"LOS": 3.0, "NLOSv": 3.0, "NLOS": 4.0}
_BLOCKAGE_DB = {0: (9.0, 4.5), 1: (5.0, 4.0)}
"""Mean and standard deviation by the number of antennas above the vehicles in the way; none if both are above."""
_THERMAL_DBM_HZ = -174.0


@dataclass(frozen=True, slots=True)
class Radio:
    """Transmitter, receiver and surroundings of every link.

    Attributes:
        scene: "urban" or "highway".
        carrier_ghz: carrier frequency.
        power_dbm: transmitted power.
        gain_dbi: gain of each of the two antennas.
        width_mhz: width of the channel, over which the receiver gathers noise.
        noise_figure_db: noise figure of the receiver.
        mcs: modulation and coding scheme: 4 (robust), 7 or 11 (fast), see `coopsim.comms.radio.radio_config`.
        block_bytes: size of a coded block; a longer message is several blocks, which must all be received.
        snr_half_db: for a custom modem, instead of `mcs`: SNR at which half of the blocks are received.
        snr_spread_db: additional SNR of the custom modem at which 84 % are received.
        slots: number of slots in a frame, of which each block takes a random one; messages in the same slot interfere,
            see `RadioReception`. None: no interference. 100 slots at 10 Hz are a millisecond each.
    """

    scene: Literal["urban", "highway"] = "urban"
    carrier_ghz: float = 5.9
    power_dbm: float = 23.0
    gain_dbi: float = 3.0
    width_mhz: float = 10.0
    noise_figure_db: float = 9.0
    mcs: int = 7
    block_bytes: int = TABLE_BLOCK_BYTES
    snr_half_db: float | None = None
    snr_spread_db: float = 1.5
    slots: int | None = None

    def __post_init__(self) -> None:
        require_choice("scene", self.scene, ("urban", "highway"))
        require_positive(carrier_ghz=self.carrier_ghz, width_mhz=self.width_mhz, snr_spread_db=self.snr_spread_db)
        require_finite_number(power_dbm=self.power_dbm, gain_dbi=self.gain_dbi, noise_figure_db=self.noise_figure_db)
        require_count(1, block_bytes=self.block_bytes)
        if self.slots is not None:
            require_count(1, 10_000, slots=self.slots)
        if self.snr_half_db is not None:
            require_finite_number(snr_half_db=self.snr_half_db)
        if isinstance(self.mcs, bool) or self.mcs not in SCHEMES:
            raise InvalidValueError(
                f"mcs must be one of {', '.join(map(str, SCHEMES))}, got {self.mcs!r}; set snr_half_db for another"
            )

    def path_loss_db(self, distance_m: float, obstruction: Obstruction) -> float:
        """Return the mean path loss between the antennas, without blockage by vehicles (table 6.2.1-1)."""
        far, carrier = math.log10(max(distance_m, _NEAREST_M)), math.log10(self.carrier_ghz)
        if obstruction.state == "NLOS":
            return 36.85 + 30.0 * far + 18.9 * carrier
        if self.scene == "highway":
            return 32.4 + 20.0 * far + 20.0 * carrier
        return 38.77 + 16.7 * far + 18.2 * carrier

    def received_dbm(self, distance_m: float, obstruction: Obstruction, fading: Floats) -> float:
        """Return the power at the receiver; `fading` (2,) are standard normal shadowing and blockage."""
        loss_db = self.path_loss_db(distance_m, obstruction) + _SHADOWING_DB[obstruction.state] * float(fading[0])
        if obstruction.state == "NLOSv" and obstruction.above in _BLOCKAGE_DB:
            mean_db, sigma_db = _BLOCKAGE_DB[obstruction.above]
            mean_db += max(0.0, 15.0 * math.log10(max(distance_m, _NEAREST_M)) - 41.0)
            loss_db += max(0.0, mean_db + sigma_db * float(fading[1]))
        return self.power_dbm + 2 * self.gain_dbi - loss_db

    @property
    def noise_dbm(self) -> float:
        """Noise of the receiver over the channel's width."""
        return _THERMAL_DBM_HZ + 10 * math.log10(self.width_mhz * 1e6) + self.noise_figure_db

    def blocks(self, size_bytes: int) -> int:
        """Return the number of blocks of a message."""
        return max(1, -(-size_bytes // self.block_bytes))

    def curve(self, obstruction: Obstruction) -> ErrorCurve:
        """Return the probability that a block is received, as a function of SNR."""
        if self.snr_half_db is not None:
            return ErrorCurve(self.snr_half_db, self.snr_spread_db)
        return ERROR_CURVES[self.scene, "free" if obstruction.state == "LOS" else "blocked"][self.mcs]


@dataclass(slots=True, eq=False)
class Fading:
    """Shadowing and blockage of one pair of agents, the same in both directions, from the pair's stream."""

    rng: np.random.Generator
    _ends: Floats | None = field(default=None, init=False)
    _value: Floats = field(default_factory=lambda: np.zeros(2), init=False)

    def at(self, ends_m: Floats, decorrelation_m: float) -> Floats:
        """Return standard normal shadowing and blockage (2,) for the two ends at (2, 3) m, in the same order each time.

        Correlated with the last call by exp(-d / `decorrelation_m`), where d is the sum of both ends' movements since.
        """
        if self._ends is None:
            self._value = self.rng.standard_normal(2)
        else:
            moved_m = float(np.linalg.norm(ends_m - self._ends, axis=1).sum())
            if moved_m > 0:
                kept = math.exp(-moved_m / decorrelation_m)
                self._value = kept * self._value + math.sqrt(1 - kept**2) * self.rng.standard_normal(2)
        self._ends = ends_m
        return self._value

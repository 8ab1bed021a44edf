"""Block error curves of the LTE-V2X sidelink over SNR.

They come from link-level simulations of blocks of 350 bytes over fading channels, shipped with WiLabV2Xsim (Todisco et
al. 2021, IEEE Access 9; folder `PERcurves`, files `G5-*/PER_LTE_MCS*_350B.txt`). Each is given here by the normal
distribution function that fits it best, which is within 0.03 of every point of its table. The curves contain fast
fading but no shadowing.
"""

from __future__ import annotations

from dataclasses import dataclass

from scipy.special import ndtr

from coopsim.geometry.se3 import Floats

TABLE_BLOCK_BYTES = 350
"""Size of the blocks in the tables."""


@dataclass(frozen=True, slots=True)
class ErrorCurve:
    """Probability that a block is received: a normal distribution function of SNR.

    Attributes:
        half_db: SNR at which it is 50 %.
        spread_db: additional SNR at which it is 84 %.
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

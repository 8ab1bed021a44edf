"""What chance a message has at an SNR: block error curves of the LTE-V2X sidelink.

The curves are those of link-level simulations of blocks of 350 bytes over fading channels, as they come with
WiLabV2Xsim (Todisco et al. 2021, IEEE Access 9; its folder `PERcurves`, files `G5-*/PER_LTE_MCS*_350B.txt`). Each is
given here by the two numbers of the normal distribution function that fits it best; no point of a table is farther from
that than 0.03. Fast fading is in the curves; shadowing is not.
"""

from __future__ import annotations

from dataclasses import dataclass

from scipy.special import ndtr

from coopsim.geometry.se3 import Floats

TABLE_BLOCK_BYTES = 350
"""The block of the tables."""


@dataclass(frozen=True, slots=True)
class ErrorCurve:
    """The chance that a block is received, a normal distribution function of SNR.

    Attributes:
        half_db: where it is a half.
        spread_db: from there to where it is 84 %.
    """

    half_db: float
    spread_db: float

    def delivery(self, snr_db: Floats) -> Floats:
        """The chance that a block is received, in [0, 1], elementwise."""
        chance: Floats = ndtr((snr_db - self.half_db) / self.spread_db)
        return chance


ERROR_CURVES = {
    ("urban", "free"): {4: ErrorCurve(-0.85, 1.23), 7: ErrorCurve(2.85, 1.52), 11: ErrorCurve(5.98, 1.86)},
    ("urban", "blocked"): {4: ErrorCurve(1.21, 1.23), 7: ErrorCurve(5.11, 1.37), 11: ErrorCurve(8.45, 1.57)},
    ("highway", "free"): {4: ErrorCurve(-1.58, 1.26), 7: ErrorCurve(2.09, 1.45), 11: ErrorCurve(5.20, 1.62)},
    ("highway", "blocked"): {4: ErrorCurve(1.77, 1.16), 7: ErrorCurve(5.71, 1.20), 11: ErrorCurve(9.04, 1.53)},
}
"""By scene and line of sight, then by modulation and coding scheme: the tables `G5-UrbanLOS`, `G5-CrossingNLOS`,
`G5-HighwayLOS` and `G5-HighwayNLOS`. 4 and 7 are QPSK, 11 is 16-QAM."""

SCHEMES = (4, 7, 11)
"""Of LTE's modulation and coding schemes, those of which there are curves here."""

"""Losses of honest senders, against which MADE tests: 40 quantiles each, at levels (k + 0.5) / 40.

Those of boxes are 5760 losses of `late_fusion` in `crossing` and `roundabout`, seeds 500 to 503; those of maps are 576
losses of `attfuse` there, seeds 500 and 501. Nobody lied.
"""

from __future__ import annotations

import numpy as np

_BOXES = (
    "0 0.0912 0.125 0.152 0.174 0.196 0.213 0.229 0.244 0.255 0.268 0.281 0.293 0.303 0.313 0.325 0.333 0.342 "
    "0.35 0.359 0.369 0.378 0.387 0.396 0.405 0.416 0.426 0.434 0.444 0.456 0.465 0.477 0.491 0.501 0.514 0.53 "
    "0.548 0.571 0.6 0.66"
)
_MAPS = (
    "0.0648 0.13 0.157 0.168 0.184 0.2 0.211 0.221 0.233 0.242 0.249 0.261 0.27 0.277 0.284 0.298 0.305 0.32 "
    "0.329 0.343 0.349 0.371 0.392 0.409 0.43 0.45 0.464 0.473 0.487 0.497 0.507 0.513 0.522 0.535 0.549 0.564 "
    "0.58 0.601 0.63 0.666"
)
_RECONSTRUCTION = (
    "0.534 0.586 0.612 0.648 0.675 0.698 0.72 0.73 0.742 0.754 0.765 0.78 0.791 0.808 0.827 0.842 0.854 0.874 "
    "0.892 0.909 0.93 0.954 0.974 0.996 1.01 1.03 1.05 1.07 1.1 1.13 1.16 1.21 1.25 1.29 1.34 1.38 1.44 1.51 1.61 "
    "1.72"
)

MATCH_LOSS = {False: np.array(_BOXES.split(), float), True: np.array(_MAPS.split(), float)}
"""Match losses by whether the policy fuses more than boxes."""

RECONSTRUCTION = np.array(_RECONSTRUCTION.split(), float)
"""Reconstruction losses, relative to that of the receiver's own map."""

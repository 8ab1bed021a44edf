"""Protocols of average precision by name. Importing registers them."""

from coopsim.bench.detect.protocols import coopsim_ap, dair_ap, nuscenes_ap, opencood_ap, v2x_real_ap  # noqa: F401

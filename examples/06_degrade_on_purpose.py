"""Measure how much each degradation costs late fusion. Options are as in a YAML file; the traffic is the same."""

from typing import Any

import coopsim

WRITTEN: dict[str, dict[str, Any]] = {
    "nothing": {},
    "jitter, 200 +- 100 ms": {"channel": {"latency": {"model": "gamma", "mean_s": 0.2, "jitter_s": 0.1}}},
    "bursts of losses": {"channel": {"loss": {"model": "gilbert_elliott", "begin": 0.1, "end": 0.1}}},
    "50 kbit/s for all": {"channel": {"bandwidth": {"rate_bit_s": 5e4, "order": "newest_first", "max_wait_s": 0.5}}},
    "weak radio, in slots": {"channel": {"radio": {"power_dbm": 0, "mcs": 11, "slots": 50}}},
    "the same, unit by cable": {
        "channel": {
            "radio": {"power_dbm": 0, "mcs": 11, "slots": 50},
            "links": {"rsu_0 > *": {"wired": True}, "* > rsu_0": {"wired": True}},
        }
    },
    "poses that wander": {"localization": {"pose": {"position_noise_m": 0.5, "correlation_s": 10.0}}},
    "one agent biased": {"localization": {"cav_0": {"pose": {"position_bias_m": 1.0, "heading_bias_rad": 0.02}}}},
}

print(f"{'':<24} {'MOTA':>5} {'delivered':>10} {'worst link':>11}")
for name, options in WRITTEN.items():
    result = coopsim.evaluate("late_fusion", "crossing", seed=3, lidar=None, max_cycles=50, **options)
    shares = [counts.delivered / counts.sent for counts in result.links.values()]
    delivered = result.messages.delivered / result.messages.sent
    print(f"{name:<24} {result.score['MOTA']:5.1f} {100 * delivered:8.1f} % {100 * min(shares):9.1f} %")

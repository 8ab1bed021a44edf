"""Compare the scores of late fusion at several latencies, with the same traffic and noise."""

import coopsim

OPTIONS = {"position_noise_m": 0.1, "max_cycles": 50}

alone = coopsim.evaluate("no_fusion", "crossing", seed=3, **OPTIONS)
print(f"no_fusion              MOTA {alone.score['MOTA']:5.1f}   sAMOTA {alone.score['sAMOTA']:5.1f}")
for latency_s in (0.0, 0.1, 0.3, 0.5):
    result = coopsim.evaluate("late_fusion", "crossing", seed=3, latency_s=latency_s, **OPTIONS)
    score = result.score
    print(
        f"late_fusion at {latency_s * 1000:3.0f} ms  MOTA {score['MOTA']:5.1f}   "
        f"sAMOTA {score['sAMOTA']:5.1f}   {score['bytes_per_s']:.0f} bytes/s per agent"
    )

"""Give learners the shapes they take: rows of fixed number, a picture from above, numbers for tracks."""

import coopsim
from coopsim.envs.wrappers import BevImage, Driving, FixedSize, FixedTracks, Flatten
from coopsim.envs.wrappers.fixed_size import DETECTION_COLUMNS

SMALL = {"vehicles": 20, "lidar": "VLP-16", "lidar_columns": 256, "max_cycles": 5, "latency_s": 0.1}


def play(env):
    """Act at random for an episode; return its last observation of `cav_0`."""
    observations, _ = env.reset(seed=7)
    while env.agents:
        seen = observations["cav_0"]
        observations, *_ = env.step({agent: env.action_space(agent).sample() for agent in env.agents})
    return seen


# The agents drive, a policy tracks: an action is a maneuver.
env = coopsim.parallel_env("crossing", control="policy", reward="safe_progress", **SMALL)
rows = play(FixedSize(Driving(env, tracker="late_fusion"), detections=16, messages=4, received=8))
for name, array in rows.items():
    print(f"{name:16} {array.shape}")
nearest = dict(zip(DETECTION_COLUMNS, rows["detections"][0].tolist(), strict=True))
print({name: round(nearest[name], 1) for name in ("x", "y", "l", "w", "score", "car")})

# The same as a picture, and both of them.
picture = play(BevImage(Driving(env), size=96, metres=72, channels=("detections", "messages", "map")))
print("picture", picture.shape, picture.dtype)
print("both   ", sorted(play(BevImage(FixedSize(Driving(env)), size=64))))

# The agents track: an action is numbers in [-1, 1], for 8 tracks.
env = coopsim.parallel_env("crossing", **SMALL)
flat = Flatten(FixedSize(FixedTracks(env, tracks=8), order="surest"))
print("flat   ", play(flat).shape, "actions", flat.action_space("cav_0").shape)

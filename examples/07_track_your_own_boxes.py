"""Track and score your own boxes without an environment: from any detector, sensor or file."""

import numpy as np

from coopsim.geometry.assignment import hungarian
from coopsim.geometry.boxes import Boxes3D
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.score import summarize
from coopsim.tracking.affinity import giou_3d
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import HitsAndAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.tracker import Tracker
from coopsim.types import Detections, GroundTruth

FRAME_NS = 100_000_000

rng = np.random.default_rng(0)
start = np.array([[0.0, 0, 0.8, 4.5, 1.9, 1.6, 0], [40, 4, 0.8, 4.5, 1.9, 1.6, np.pi]])  # x, y, z, l, w, h, yaw
velocity = np.array([[10.0, 0], [-8, 0]])
ids, cars = np.array([1, 2]), np.zeros(2, dtype=int)

tracker = Tracker(ConstantVelocity(), Cascade([Stage(giou_3d, hungarian, gate=-0.2)]), HitsAndAge(hits=3, age=2))
evaluator = Evaluator(match_iou=0.25)
for k in range(50):
    there = start.copy()
    there[:, :2] += velocity * 0.1 * k
    seen = rng.random(2) < 0.9
    measured = there[seen] + rng.normal(0, 0.1, (seen.sum(), 7)) * [1, 1, 1, 0, 0, 0, 0.2]
    found = Detections(Boxes3D.from_array(measured), rng.uniform(0.6, 0.9, seen.sum()), cars[seen])
    tracks = tracker.step(found, time_ns=k * FRAME_NS)
    evaluator.update(GroundTruth(ids, Boxes3D.from_array(there), cars), tracks)

print(f"tracks {tracks.id.tolist()}, at {tracks.velocity.round(1).tolist()} m/s")
print(summarize([evaluator.log]).table())

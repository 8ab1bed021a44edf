"""Plug in a custom detector with one method, on LiDAR sweeps. This one puts a box around each cluster of points."""

import numpy as np
from scipy import ndimage

import coopsim
from coopsim.detection.detector import Detector
from coopsim.geometry.boxes import Boxes3D
from coopsim.testing import check_detector
from coopsim.types import Detections, ObjectClass, SensorView

CAR_M = np.array([3.5, 1.7, 1.5])


class Clusters(Detector):
    """Detector of clusters: points above ground in adjacent half-metre cells, no larger than a car."""

    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        points = np.concatenate([sweep.points for sweep in view.sweeps.values()])
        points = points[(points[:, 2] > 0.4) & (np.abs(points[:, :2]) < 50).all(axis=1)]
        cell = tuple((2 * points[:, :2] + 100).astype(int).T)
        occupied = np.zeros((200, 200), dtype=bool)
        occupied[cell] = True
        cluster = ndimage.label(occupied, np.ones((3, 3)))[0][cell]
        members = [points[cluster == k] for k in np.unique(cluster)]
        members = [each for each in members if len(each) >= 5 and np.ptp(each[:, :2], axis=0).max() < 7]
        low, high = (np.array([end(each, axis=0) for each in members]).reshape(-1, 3) for end in (np.min, np.max))
        size = np.maximum(high - low, CAR_M)
        center = np.column_stack([(low + high)[:, :2] / 2, size[:, 2] / 2])
        score = np.array([1 - np.exp(-len(each) / 30) for each in members])
        return Detections(Boxes3D(center, size, np.zeros(len(size))), score, np.full(len(size), ObjectClass.CAR))


check_detector(Clusters)
options = {"seed": 1, "max_cycles": 20, "lidar": "OS1-128"}
for name, detector in {"clusters": Clusters(), "simulated": "simulated"}.items():
    score = coopsim.evaluate("late_fusion", "highway", detector=detector, **options).score
    print(f"{name:>9}: recall {score['recall']:.1f} %, precision {score['precision']:.1f} %")

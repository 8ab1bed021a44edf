"""Plug in a custom embedder of each detection's appearance in camera images. This one takes the mean colour."""

import numpy as np

import coopsim
from coopsim.detection.detector import SensorNeeds
from coopsim.detection.embedder import Embedder
from coopsim.testing import check_embedder
from coopsim.types import Detections, SensorView


class MeanColour(Embedder):
    """Mean colour of the pixels around the middle of a box, in the first camera that shows it."""

    dim, needs = 3, SensorNeeds(cameras=True)

    def embed(self, detections: Detections, view: SensorView) -> np.ndarray:
        colour = np.zeros((len(detections), 3))  # zeros: appearance unknown
        for name, image in view.images.items():
            camera = view.cameras[name]
            middle = camera.base_SE3_camera.inverse().apply(detections.boxes.center)
            u, v, depth = camera.matrix @ middle.T
            for k in np.flatnonzero((depth > 1) & ~colour.any(axis=1)):
                row, column = int(v[k] / depth[k]), int(u[k] / depth[k])
                if 3 <= row < camera.size[0] - 3 and 3 <= column < camera.size[1] - 3:
                    colour[k] = image.rgb[row - 3 : row + 4, column - 3 : column + 4].mean(axis=(0, 1)) - 128
        return colour


check_embedder(MeanColour)
options = {"seed": 1, "max_cycles": 10, "cameras": True, "renderer": "raycast", "lidar": None}
for name, embedder in {"none": None, "colour": MeanColour()}.items():
    score = coopsim.evaluate("dino_codt_tracking", "crossing", embedder=embedder, **options).score
    print(f"{name:>6}: {score['bytes_per_s']:.0f} bytes/s, {score['IDS']:.1f} identity switches")

"""Decoding of maps, and targets, its inverse."""

import numpy as np
import torch

from coopsim.learn.samples.targets import make_targets
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.detector_net import MEAN_SIZE_M, CentreHead
from coopsim.types import BevGrid
from coopsim.types.taxonomy import ObjectClass

GRID = BevGrid((-48.0, 48.0), (-24.0, 24.0), 1.2)


class Told(CentreHead):
    """A head that predicts targets: its features are their heat, codes are looked up."""

    def __init__(self, targets) -> None:
        super().__init__(9)
        self.targets = targets

    def heat(self, features):
        cells = torch.arange(features.shape[-2] * features.shape[-1]).view(1, 1, *features.shape[-2:]).float()
        return cells, torch.logit(features.clamp(1e-4, 1 - 1e-4))

    def codes(self, shared_at):
        codes = torch.zeros(len(shared_at), 19)
        for row, cell in enumerate(shared_at[:, 0].long()):
            (at,) = torch.nonzero(self.targets.cell == cell, as_tuple=True)
            codes[row, :12] = self.targets.code[at[0]]
        return codes


def told(boxes: np.ndarray, label: np.ndarray, least_score: float = 0.5):
    targets = make_targets(boxes, np.zeros((len(boxes), 2)), label, GRID)
    return decode(Told(targets), targets.heat, GRID, least_score=least_score)[0]


def test_decoded_targets_are_the_boxes_of_all_classes_a_long_truck_too() -> None:
    label = np.arange(9)
    boxes = np.array([[-40 + 9.5 * k, 3.3 * (-1) ** k, 1.0, 4.6, 1.9, 1.6, 0.7 * k - 3] for k in range(9)])
    boxes[:, 3:6] = [MEAN_SIZE_M[cls] for cls in ObjectClass]
    boxes[int(ObjectClass.TRUCK), 3] = 12.0
    found = told(boxes, label)
    order = np.argsort(found.boxes.center[:, 0])
    np.testing.assert_array_equal(found.label[order], label)
    np.testing.assert_allclose(found.boxes.array[order], boxes, atol=1e-4)
    assert found.covariance is not None


def test_a_person_beside_a_car_in_the_same_cell_is_found() -> None:
    boxes = np.array([[0.6, 0.6, 0.8, 4.6, 1.9, 1.6, 0.0], [0.7, 0.5, 0.9, 0.8, 0.5, 1.7, 1.0]])
    assert len(told(boxes, np.array([0, 7]))) == 2


def test_objects_outside_the_grid_are_no_targets_and_those_on_its_edge_are() -> None:
    boxes = np.array([[60.0, 0, 1, 4, 2, 1.5, 0], [-47.9, -23.9, 1, 4, 2, 1.5, 0]])
    targets = make_targets(boxes, np.zeros((2, 2)), np.array([0, 0]), GRID)
    assert targets.objects == 1
    assert float(targets.heat[0, 0, 0, 0]) == 1


def test_no_objects() -> None:
    targets = make_targets(np.zeros((0, 7)), np.zeros((0, 2)), np.zeros(0, np.int64), GRID)
    assert targets.objects == 0
    assert not targets.heat.any()
    assert len(decode(CentreHead(8).eval(), torch.zeros(2, 8, *GRID.shape), GRID, least_score=0.5)[1]) == 0


def test_two_boxes_on_one_object_are_one_detection() -> None:
    boxes = np.array([[0.6, 0.6, 0.8, 8.0, 2.5, 3.0, 0.0], [4.2, 0.6, 0.8, 8.0, 2.5, 3.0, 0.0]])
    assert len(told(boxes, np.array([2, 2]))) == 1

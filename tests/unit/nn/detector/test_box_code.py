"""Codes of boxes: round trip, headings, covariances."""

import numpy as np
import pytest
import torch

from coopsim.nn.detector.detector_net import MEAN_SIZE_M, covariances, decode_boxes, encode_boxes, residuals
from coopsim.types.taxonomy import ObjectClass


def some_boxes(count: int = 200, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    label = rng.integers(0, len(ObjectClass), count)
    size = np.array([MEAN_SIZE_M[ObjectClass(each)] for each in label]) * rng.uniform(0.7, 1.4, (count, 3))
    boxes = np.column_stack([rng.uniform(-70, 70, (count, 2)), rng.uniform(0, 2, count), size,
                             rng.uniform(-np.pi, np.pi, count)])  # fmt: skip
    return torch.tensor(boxes), torch.tensor(rng.normal(0, 8, (count, 2))), torch.tensor(label)


def test_every_class_has_a_usual_size() -> None:
    assert set(MEAN_SIZE_M) == set(ObjectClass)


def test_decoding_is_the_inverse_of_encoding_for_all_classes_and_headings() -> None:
    boxes, velocity, label = some_boxes()
    centre = boxes[:, :2] + torch.tensor([0.4, -0.5])
    code = encode_boxes(boxes, velocity, label, centre, 1.2)
    again, speed = decode_boxes(code, label, centre.float(), 1.2)
    turned = torch.atan2(torch.sin(again[:, 6] - boxes[:, 6]), torch.cos(again[:, 6] - boxes[:, 6]))
    torch.testing.assert_close(again[:, :6], boxes[:, :6].float(), atol=1e-4, rtol=1e-5)
    assert turned.abs().max() < 1e-5
    torch.testing.assert_close(speed, velocity.float(), atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("wavering", [-0.02, 0.02])
def test_a_heading_does_not_flip_where_its_axis_wavers(wavering: float) -> None:
    boxes, velocity, label = some_boxes(40)
    boxes[:, 6] = np.pi / 2  # where the axis, a number in half a turn, jumps
    code = encode_boxes(boxes, velocity, label, boxes[:, :2], 1.2)
    code[:, 6], code[:, 7] = np.cos(np.pi + wavering), np.sin(np.pi + wavering)
    again, _ = decode_boxes(code, label, boxes[:, :2].float(), 1.2)
    assert (again[:, 6] - np.pi / 2).abs().max() < 0.02


def test_errors_are_along_and_across_the_box() -> None:
    boxes, velocity, label = some_boxes(1)
    boxes[:, 6] = np.pi / 2
    true = encode_boxes(boxes, velocity, label, boxes[:, :2], 1.2)
    found = true.clone()
    found[:, 1] += 0.5  # half a cell to the north, which is ahead
    error = residuals(found, true, boxes[:, 6].float(), 1.2)
    torch.testing.assert_close(error, torch.tensor([[0.6, 0, 0, 0, 0, 0, 0.0]]), atol=1e-5, rtol=0)


def test_covariances_are_turned_with_the_box_and_positive() -> None:
    boxes, _, _ = some_boxes(50)
    boxes = boxes.float()
    spread = torch.tensor(np.random.default_rng(1).normal(-2, 1, (50, 7)), dtype=torch.float32)
    matrix = covariances(spread, boxes)
    assert (torch.linalg.eigvalsh(matrix) > 0).all()
    ahead = torch.stack([torch.cos(boxes[:, 6]), torch.sin(boxes[:, 6])], dim=1).double()
    along = torch.einsum("ni,nij,nj->n", ahead, matrix[:, :2, :2], ahead)
    torch.testing.assert_close(along, torch.exp(spread[:, 0].double()), rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(matrix[:, 3, 3], torch.exp(spread[:, 3].double()) * boxes[:, 3].double() ** 2)

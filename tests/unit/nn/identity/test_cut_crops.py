"""Crops of one size, of the part of the picture that was asked for."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch")

from coopsim.nn.identity.picture_identity_net import cut_crops

PICTURE = np.random.default_rng(0).integers(0, 256, (20, 30, 3)).astype(np.uint8)


def test_a_crop_of_the_size_that_is_wanted_is_the_part_itself() -> None:
    crop = cut_crops(PICTURE, np.array([[3.5, 1.5, 11.5, 9.5]]), edge_px=8, margin=0.0)
    np.testing.assert_allclose(crop[0].numpy(), PICTURE[2:10, 4:12].transpose(2, 0, 1), atol=1e-4)


def test_colours_stay_however_a_part_is_resized() -> None:
    halves = np.zeros((20, 30, 3), np.uint8)
    halves[:, :15], halves[:, 15:] = (200, 10, 60), (0, 100, 0)
    left, both = cut_crops(halves, np.array([[-0.5, -0.5, 9.5, 19.5], [4.5, 3.5, 24.5, 5.5]]), 16, 0.0).numpy()
    np.testing.assert_allclose(left, np.broadcast_to([[[200]], [[10]], [[60]]], (3, 16, 16)), atol=1e-3)
    np.testing.assert_allclose(both[:, 8, 0], [200, 10, 60], atol=1e-3)
    np.testing.assert_allclose(both[:, 8, -1], [0, 100, 0], atol=1e-3)


def test_the_margin_ends_at_the_pictures_edge() -> None:
    place = np.array([[-0.5, 1.5, 9.5, 11.5]])
    with_margin = cut_crops(PICTURE, place, 8, 0.2)
    same = cut_crops(PICTURE, np.array([[-0.5, -0.5, 11.5, 13.5]]), 8, 0.0)
    np.testing.assert_array_equal(with_margin, same)


def test_the_smallest_parts() -> None:
    places = np.array([[29.4, 19.4, 29.5, 19.5], [-0.5, -0.5, -0.4, -0.4], [7.0, 7.0, 7.01, 7.01]])
    assert cut_crops(PICTURE, places, 8, 0.0).shape == (3, 3, 8, 8)
    assert np.isfinite(cut_crops(PICTURE[:1, :1], places[1:2], 8, 0.0).numpy()).all()
    assert cut_crops(PICTURE, np.zeros((0, 4)), 8, 0.1).shape == (0, 3, 8, 8)

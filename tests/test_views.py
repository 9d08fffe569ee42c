"""Boxes of masks, and the silhouette of a view."""

import numpy as np
import pytest

from gaussian_trimmer.views.view import bounding_box, box_slices


def mask_with(rows, columns, shape=(6, 9)):
    mask = np.zeros(shape, np.bool_)
    mask[rows, columns] = True
    return mask


@pytest.mark.parametrize(
    ("margin", "box"), [(0, (4, 2, 7, 5)), (1, (3, 1, 8, 6)), (2, (2, 0, 9, 6)), (99, (0, 0, 9, 6))]
)
def test_a_box_and_its_margin_stay_within_the_image(margin, box):
    mask = mask_with([2, 4, 3], [5, 4, 6])
    assert bounding_box(mask, margin) == box
    assert mask[box_slices(box)].sum() == 3
    assert mask[box_slices(bounding_box(mask))].shape == (3, 3)


@pytest.mark.parametrize("margin", [0, 3])
def test_an_empty_mask_has_the_whole_image_as_its_box(margin):
    assert bounding_box(np.zeros((6, 9), np.bool_), margin) == (0, 0, 9, 6)

"""Metrics on cases small enough to count by hand."""

import numpy as np
import pytest

from gaussian_trimmer.evaluation.metrics import (
    boundary_iou,
    extraction_psnr,
    foreground_iou,
    pixel_accuracy,
    psnr,
    soft_iou,
)

SILHOUETTE_METRICS = [foreground_iou, pixel_accuracy, boundary_iou, soft_iou]


def square(size, top, left, side):
    mask = np.zeros((size, size), np.float32)
    mask[top : top + side, left : left + side] = 1.0
    return mask


def test_metrics_of_shifted_squares_counted_by_hand():
    # Two 4 x 4 squares shifted by one column share 12 of 20 pixels, and differ in 8 of 100.
    a, b = square(10, 2, 2, 4), square(10, 2, 3, 4)
    assert foreground_iou(a, b) == pytest.approx(12 / 20) and pixel_accuracy(a, b) == pytest.approx(92 / 100)
    assert soft_iou(0.2 * a, 0.4 * a) == pytest.approx(0.5)
    assert foreground_iou(np.array([[0.5, 0.51]]), np.array([[False, True]])) == 1.0  # one half is not in


def test_boundary_iou_compares_rings():
    # The diagonal of 70 x 70 is 99 px, the band 2 px. Rings of a 20 x 20 square: 400 - 16^2 = 144 pixels; of the
    # square with two columns more: 440 - 16 * 18 = 152. The two share all but the 16 x 2 pixels of the moved side,
    # which of the smaller ring lie inside the larger square's interior.
    small, large = square(70, 10, 10, 20), square(70, 10, 10, 20)
    large[10:30, 30:32] = 1.0
    shared = 144 - 16 * 2
    assert boundary_iou(small, large) == pytest.approx(shared / (144 + 152 - shared))


def test_band_is_at_least_one_pixel_wide():
    # 7 x 7: 0.02 of the diagonal is 0.2 px. Rings of one pixel of a 5 x 5 and a 3 x 3 square do not meet.
    assert boundary_iou(square(7, 1, 1, 5), square(7, 2, 2, 3)) == 0.0
    assert boundary_iou(square(7, 1, 1, 5), square(7, 1, 1, 5)) == 1.0


def test_occluder_edge_is_no_contour():
    # Ground truth ends where an occluder begins; the object rendered alone goes on behind it.
    alone, gt, valid = square(70, 10, 10, 40), square(70, 10, 10, 40), np.ones((70, 70), np.bool_)
    gt[:, 30:] = 0.0
    valid[:, 30:] = False
    assert boundary_iou(alone, gt, valid) == 1.0
    assert boundary_iou(alone, gt) < 0.6


@pytest.mark.parametrize("metric", SILHOUETTE_METRICS)
def test_left_out_pixels_count_nowhere(metric):
    rng = np.random.default_rng(0)
    alpha, gt = rng.random((30, 40)), rng.random((30, 40))
    valid = rng.random((30, 40)) < 0.7
    elsewhere = np.where(valid, alpha, rng.random((30, 40))), np.where(valid, gt, rng.random((30, 40)))
    assert metric(alpha, gt, valid) == metric(*elsewhere, valid)
    assert metric(alpha, gt, valid) != metric(alpha, gt)


@pytest.mark.parametrize("metric", SILHOUETTE_METRICS)
def test_agreement_is_one_and_empty_pairs_agree(metric):
    mask = square(20, 3, 5, 8)
    empty = np.zeros((20, 20))
    assert metric(mask, mask) == 1.0
    assert metric(empty, empty) == 1.0
    assert metric(mask, empty, np.zeros((20, 20), np.bool_)) == 1.0
    assert metric(mask, empty) < 1.0


@pytest.mark.parametrize("metric", [foreground_iou, boundary_iou, soft_iou])
def test_overlap_metrics_are_symmetric_and_zero_against_empty(metric):
    a, b = square(20, 3, 5, 8), square(20, 5, 5, 8)
    assert metric(a, b) == metric(b, a)
    assert metric(a, np.zeros_like(a)) == 0.0


def test_psnr_needs_equal_shapes():
    assert psnr(np.ones((2, 2)), np.ones((2, 2))) == float("inf")
    with pytest.raises(ValueError, match="equal shapes"):
        psnr(np.ones((2, 2)), np.ones((2, 1)))


def test_extraction_psnr_blackens_the_surroundings():
    image, mask = np.full((60, 60, 3), 0.5), square(60, 30, 30, 4)
    assert extraction_psnr(image * mask[..., None], image, mask) == float("inf")
    # A mask of 0.51 darkens the target: the error is 0.245 on 4 x 4 pixels of a box of 44 x 44.
    assert extraction_psnr(image * mask[..., None], image, mask * 0.51) == pytest.approx(
        -10 * np.log10((0.5 * 0.49) ** 2 * 16 / 44**2)
    )


def test_extraction_psnr_counts_the_box_with_its_margin():
    image, mask = np.zeros((60, 60, 3)), square(60, 30, 30, 4)
    rendered = np.zeros((60, 60, 3))
    rendered[9, 30] = rendered[30, 54] = 1.0  # one pixel beyond the margin of 20 on each side
    assert extraction_psnr(rendered, image, mask) == float("inf")
    rendered[10, 30] = 1.0  # the first row of the box
    assert extraction_psnr(rendered, image, mask) == pytest.approx(-10 * np.log10(1 / 44**2))
    assert extraction_psnr(rendered, image, mask, margin=3) == float("inf")

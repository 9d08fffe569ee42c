"""Selections lifted from masks of small made scenes, and of the benchmark, whose coarse selections were lifted so."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import toy

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.selecting.lifting import (
    lift_by_assignment,
    lift_objects_by_assignment,
)
from gaussian_trimmer.selection_files import method_kinds
from gaussian_trimmer.selection_files.method_kinds import assign_labels

# Seven Gaussians: three at the left, two at the right, one behind the left ones, one that no camera has in its frame.
CENTRES = np.array([[-0.5, y, 0] for y in (-0.3, 0, 0.3)] + [[0.5, y, 0] for y in (-0.2, 0.2)] + [[-0.5, 0, 3.0]])
LEFT, BEHIND, OUTSIDE = [0, 1, 2], 5, 6


def scene(opacity: float = 0.997) -> Gaussians:
    return toy.gaussians(np.concatenate([CENTRES, [[9.0, 0, -9.0]]]), 0.1, (0.5, 0.5, 0.5), opacity)


def cameras(n: int = 3) -> list[Camera]:
    """Cameras side by side before the scene, which see the two groups apart."""
    K = intrinsics(0.9, 48, 40)
    return [
        Camera(look_at(np.array([x, 0, -3]), np.zeros(3), np.array([0.0, -1, 0])), K, 48, 40, f"{x:.1f}.png")
        for x in np.linspace(-0.6, 0.6, n)
    ]


def left_masks(n: int = 3) -> list[np.ndarray]:
    mask = np.zeros((40, 48), bool)
    mask[:, :24] = True
    return [mask] * n


def test_assignment_takes_what_the_masks_show() -> None:
    selected = lift_by_assignment(scene(), cameras(), left_masks())
    assert np.flatnonzero(selected).tolist() == [*LEFT, BEHIND]


def test_unseen_gaussians_stay_background_whatever_the_slackness() -> None:
    for gamma in (-1.0, -0.5, 0.0, 0.5, 1.0):
        selected = lift_by_assignment(scene(), cameras(), left_masks(), gamma)
        assert not selected[OUTSIDE]


def test_more_slackness_never_adds() -> None:
    mask = np.zeros((40, 48), bool)
    mask[18:22, :24] = True  # cuts through the middle of the left group
    found = [lift_by_assignment(scene(0.5), cameras(), [mask] * 3, g) for g in (-0.9, -0.3, 0.0, 0.3, 0.9)]
    assert found[0].sum() > found[-1].sum()
    for larger, smaller in pairwise(found):
        assert (larger | ~smaller).all()


@pytest.mark.parametrize(
    ("row", "gamma", "label"),
    [
        ([2.0, 2.0], 0.0, 0),  # a tie is background
        ([0.0, 5.0, 5.0], 0.0, 1),  # a tie of two objects goes to the lower number
        ([3.0, 4.0], 0.19, 1),  # 0.6 + gamma against 0.8
        ([3.0, 4.0], 0.21, 0),
        ([300.0, 400.0], 0.19, 1),  # the same however much it is seen
        ([0.0, 1e-30], 0.9, 1),
        ([0.0, 0.0], -1.0, 0),
    ],
)
def test_assignment_of_one_row(row: list[float], gamma: float, label: int) -> None:
    weights, numbers = np.array([row]), np.arange(1, len(row))
    assert assign_labels(1, numbers, lambda part: weights[:, [0, *part]], gamma).tolist() == [label]


def test_objects_assigned_in_passes_are_those_assigned_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    weights, numbers = np.random.default_rng(0).exponential(size=(500, 30)), np.arange(1, 30)
    found = []
    for objects in (29, 1, 7):
        monkeypatch.setattr(method_kinds, "_OBJECTS_AT_ONCE", objects)
        found.append(assign_labels(500, numbers, lambda part: weights[:, [0, *part]], -0.3))
    assert len(np.unique(found[0])) > 20
    assert (found[0] == found[1]).all() and (found[0] == found[2]).all()


def test_one_object_in_one_pass_equals_the_single_assignment() -> None:
    labels = [mask.astype(np.uint8) for mask in left_masks()]
    for gamma in (-0.7, 0.0, 0.4):
        many = lift_objects_by_assignment(scene(0.5), cameras(), labels, gamma)
        assert ((many == 1) == lift_by_assignment(scene(0.5), cameras(), left_masks(), gamma)).all()


def test_impossible_masks() -> None:
    with pytest.raises(InputError, match="2 masks for 3 cameras"):
        lift_by_assignment(scene(), cameras(), left_masks(2))
    with pytest.raises(InputError, match=r"View '-0.6.png' has a mask of 20 x 10 pixels .* 48 x 40"):
        lift_by_assignment(scene(), cameras(), [np.ones((10, 20), bool)] * 3)
    with pytest.raises(InputError, match="largest value is 1, and"):
        lift_by_assignment(scene(), cameras(), [mask.astype(np.uint8) for mask in left_masks()])
    with pytest.raises(InputError, match="nothing but background"):
        lift_objects_by_assignment(scene(), cameras(), [np.zeros((40, 48), np.uint8)] * 3)
    with pytest.raises(InputError, match="between -1 and 1"):
        lift_by_assignment(scene(), cameras(), left_masks(), gamma=float("nan"))


def test_large_object_numbers_are_lifted_as_small_ones() -> None:
    small = [np.where(mask, np.uint8(1), np.uint8(2)) for mask in left_masks()]
    large = [np.where(image == 1, 70_000, 5_000_000).astype(np.int32) for image in small]
    expected = lift_objects_by_assignment(scene(), cameras(), small)
    found = lift_objects_by_assignment(scene(), cameras(), large)
    assert np.array_equal(found, np.array([0, 70_000, 5_000_000])[expected])

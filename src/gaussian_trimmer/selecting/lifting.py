"""Coarse selections from masks of posed pictures, for scenes that no segmentation method was run on.

N Gaussians, V views, H x W pixels. Masks are boolean or coverage 0..255, cut at half; the masks of several objects
may be one image of object numbers a view. The cameras must be those of the masks' own, undistorted pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.selection_files.label_assignment import assign_labels

LabelArray = NDArray[np.uint8]
Ids = NDArray[np.integer[Any]]
_MAX_OBJECTS, _MAX_ID = 1 << 16, (1 << 31) - 1

_HALF_COVERAGE = 127
_OBJECTS_PER_PASS = 16
_WEIGHTS_PER_PASS = 1 << 25
"""Blend weights, of Gaussians times labels, that are held at a time when several objects are lifted."""


def lift_by_assignment(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    masks: Sequence[NDArray[Any]],
    renderer: Renderer,
    gamma: float = 0.0,
) -> BoolArray:
    """Gaussians that contribute more to the pixels inside the masks than to those outside, (N,).

    Args:
        masks: one (H, W) a camera, boolean or coverage 0..255.
        gamma: slackness in [-1, 1]; above zero it takes fewer Gaussians, below zero more.

    Gaussians that no view sees and ties are left out.
    The optimal assignment of FlashSplat (Shen et al. 2024) for two labels.

    Raises:
        InputError: number or sizes of masks and cameras differ, the masks are empty, or gamma is out of range.
    """
    _check_gamma(gamma)
    inside = _binary_masks(cameras, masks)
    labels = [mask.astype(np.uint8) for mask in inside]
    weights = sum_label_weights(gaussians, cameras, labels, 2, renderer)
    return np.asarray(assign_labels(weights, gamma) == 1)


def lift_objects_by_assignment(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    labels: Sequence[Ids],
    renderer: Renderer,
    gamma: float = 0.0,
) -> Ids:
    """Number of the object to whose pixels each Gaussian contributes most, (N,): of all objects together.

    Memory does not grow with the number of objects, nor time with the numbers themselves, only with how many there are.

    Args:
        labels: one image of object numbers (H, W) a camera, 0 for the background. Of 8-bit numbers 8-bit ones are made.
        gamma: slackness in [-1, 1]; above zero it favours the background.

    Gaussians that no view sees are background; of equal contributions the lowest number wins.
    The optimal assignment of FlashSplat (Shen et al. 2024) for several labels.

    Raises:
        InputError: number or sizes of images and cameras differ, all is background, or gamma is out of range.
    """
    _check_gamma(gamma)
    _check_sizes(cameras, labels)
    for camera, image in zip(cameras, labels, strict=True):
        if image.dtype.kind not in "iu" or (image.size and not 0 <= int(image.min()) <= int(image.max()) <= _MAX_ID):
            raise InputError(f"{_view(camera)} has labels of type {image.dtype}; object numbers from 0 are needed.")
    numbers = np.setdiff1d(np.unique(np.concatenate([np.unique(image) for image in labels])), 0)
    if not len(numbers):
        raise InputError("The label images hold nothing but background (0); number the objects from 1.")
    if len(numbers) > _MAX_OBJECTS:
        raise InputError(f"The label images hold {len(numbers)} objects; at most {_MAX_OBJECTS} can be lifted.")
    # Numbers may be anything; their places in the list of all of them are small.
    known = np.concatenate([[0], numbers]).astype(np.int64)
    places = [np.searchsorted(known, image).astype(np.int32) for image in labels]
    found = known[_assign_in_passes(gaussians, cameras, places, len(numbers), renderer, gamma)]
    return found.astype(np.uint8 if all(image.dtype == np.uint8 for image in labels) else np.int32)


def _assign_in_passes(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    labels: Sequence[NDArray[np.int32]],
    count: int,
    renderer: Renderer,
    gamma: float,
) -> NDArray[np.int32]:
    """The rule of `assign_labels` for object numbers 1 to `count`, few of them at a time: as many columns of blend
    weights as there are objects would not fit into memory."""
    n = len(gaussians)
    background, largest, squared_length = np.zeros(n), np.zeros(n), np.zeros(n)
    winner = np.zeros(n, np.int32)
    step = max(1, min(_OBJECTS_PER_PASS, _WEIGHTS_PER_PASS // n - 1))
    for start in range(1, count + 1, step):
        part = np.arange(start, min(start + step, count + 1), dtype=np.int32)
        renumbered = np.full(count + 1, len(part) + 1, np.uint8)  # numbers of other passes: left out by the renderer
        renumbered[0], renumbered[part] = 0, np.arange(1, len(part) + 1)
        images = [renumbered[image] for image in labels]
        weights = sum_label_weights(gaussians, cameras, images, len(part) + 1, renderer)
        background, objects = weights[:, 0], weights[:, 1:]
        squared_length += np.square(objects).sum(axis=1)
        best = objects.argmax(axis=1)
        ahead = objects[np.arange(n), best] > largest
        winner[ahead], largest[ahead] = part[best[ahead]], objects[ahead, best[ahead]]
    length = np.sqrt(squared_length + np.square(background))
    length[length == 0] = 1.0
    return np.where(largest / length > background / length + gamma, winner, 0).astype(np.int32)


def lift_by_vote(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    masks: Sequence[NDArray[Any]],
    threshold: float = 0.7,
    *,
    every_view_votes: bool = False,
) -> BoolArray:
    """Gaussians whose centres are projected into more than a share of the masks, (N,), whether they are seen or not.

    Args:
        masks: one (H, W) a camera, boolean or coverage 0..255.
        threshold: share of the votes that must be exceeded.
        every_view_votes: a view that does not have the centre in its frame votes against it instead of abstaining;
            parts that are in few pictures are then lost.

    Centres that are in no frame are left out. The label voting of SAGD (Hu et al. 2024), whose code lets every view
    vote.

    Raises:
        InputError: number or sizes of masks and cameras differ, the masks are empty, or the threshold is no share.
    """
    if not 0 <= threshold < 1:
        raise InputError(f"The vote's threshold is {threshold}; it must be at least 0 and below 1.")
    inside = _binary_masks(cameras, masks)
    centres = np.asarray(gaussians.means, np.float64)
    covered, in_frame = np.zeros(len(centres), np.int64), np.zeros(len(centres), np.int64)
    for camera, mask in zip(cameras, inside, strict=True):
        pixels, _ = camera.project(centres)
        # Centres behind the camera have NaN pixels, which no comparison lets through.
        rows = np.flatnonzero((pixels >= 0).all(axis=1) & (pixels < (camera.width, camera.height)).all(axis=1))
        columns, lines = pixels[rows].astype(np.int64).T
        in_frame[rows] += 1
        covered[rows] += mask[lines, columns]
    votes = len(cameras) if every_view_votes else in_frame
    return np.asarray((in_frame > 0) & (covered > threshold * votes))


def sum_label_weights(
    gaussians: Gaussians, cameras: Sequence[Camera], labels: Sequence[LabelArray], n_labels: int, renderer: Renderer
) -> Float64Array:
    """Blend weights of each Gaussian summed over the pixels of each label and all views, (N, n_labels)."""
    weights = np.zeros((len(gaussians), n_labels))
    for camera, image in zip(cameras, labels, strict=True):
        weights += renderer.blend_weights(gaussians, camera, image, n_labels)
    return weights


def _check_gamma(gamma: float) -> None:
    if not -1 <= gamma <= 1:
        raise InputError(f"The slackness gamma is {gamma}; it must lie between -1 and 1.")


def _binary_masks(cameras: Sequence[Camera], masks: Sequence[NDArray[Any]]) -> list[BoolArray]:
    _check_sizes(cameras, masks)
    binary = [mask if mask.dtype == np.bool_ else np.asarray(mask > _HALF_COVERAGE) for mask in masks]
    if not any(mask.any() for mask in binary):
        largest = max(float(mask.max(initial=0)) for mask in masks)
        raise InputError(f"The masks are empty: their largest value is {largest:g}, and the object's must exceed 127.")
    return binary


def _check_sizes(cameras: Sequence[Camera], images: Sequence[NDArray[Any]]) -> None:
    if len(cameras) != len(images) or not cameras:
        raise InputError(f"There are {len(images)} masks for {len(cameras)} cameras; one for each is needed.")
    for camera, image in zip(cameras, images, strict=True):
        if image.shape != (camera.height, camera.width):
            size = " x ".join(map(str, image.shape[::-1]))
            raise InputError(
                f"{_view(camera)} has a mask of {size} pixels for a camera of {camera.width} x {camera.height}; "
                "resize the masks, keeping hard edges, or the cameras."
            )


def _view(camera: Camera) -> str:
    return f"View '{camera.name}'" if camera.name else "A view without a name"

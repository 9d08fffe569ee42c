"""Selections from masks of posed pictures, for scenes that no segmentation method was run on.

N Gaussians, V views, H x W pixels. Masks are boolean or coverage 0..255, cut at half; the masks of several objects
may be one image of object numbers a view. The cameras must be those of the masks' own, undistorted pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians
from gaussian_trimmer.masks.mask_files import find_masks, ids_of, read_masks
from gaussian_trimmer.rendering.tile_renderer import label_weights
from gaussian_trimmer.selection_files.method_kinds import assign_labels
from gaussian_trimmer.views.view import HALF_COVERAGE

LabelArray = NDArray[np.uint8]
Ids = NDArray[np.integer[Any]]


def lift_by_assignment(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    masks: Sequence[NDArray[Any]],
    gamma: float = 0.0,
) -> BoolArray:
    """Return the Gaussians that contribute more to the pixels inside the masks than to those outside, (N,).

    Ties are left out.

    Args:
        masks: one (H, W) a camera, boolean or coverage 0..255.
        gamma: slackness in [-1, 1]; above zero it takes fewer Gaussians, below zero more.

    Raises:
        InputError: the masks are empty, or as `lift_objects_by_assignment`.
    """
    binary = [mask if mask.dtype == np.bool_ else np.asarray(mask > HALF_COVERAGE) for mask in masks]
    if masks and not any(mask.any() for mask in binary):
        largest = max(float(mask.max(initial=0)) for mask in masks)
        raise InputError(f"The masks are empty: their largest value is {largest:g}, and the object's must exceed 127.")
    labels = [mask.astype(np.uint8) for mask in binary]
    return np.asarray(lift_objects_by_assignment(gaussians, cameras, labels, gamma) == 1)


def lift_objects_by_assignment(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    labels: Sequence[Ids],
    gamma: float = 0.0,
) -> Ids:
    """Return the number of the object to whose pixels each Gaussian contributes most, (N,): of all objects together.

    Memory does not grow with the number of objects, nor time with the numbers themselves, only with how many there are.

    Args:
        labels: one image of object numbers (H, W) a camera, 0 for the background. Of 8-bit numbers 8-bit ones are made.
        gamma: slackness in [-1, 1]; above zero it favours the background.

    Gaussians that no view sees are background; of equal contributions the lowest number wins.
    The optimal assignment of FlashSplat (Shen et al. 2024) for several labels.

    Raises:
        InputError: number or sizes of images and cameras differ, all is background, or gamma is out of range.
    """
    if not -1 <= gamma <= 1:
        raise InputError(f"The slackness gamma is {gamma}; it must lie between -1 and 1.")
    _check_sizes(cameras, labels)
    numbers = np.unique(np.concatenate([np.unique(image) for image in labels]))
    if numbers[0] < 0 or numbers.dtype.kind not in "iu":
        raise InputError(
            f"The label images hold {numbers[0]} as type {numbers.dtype}; object numbers from 0 are needed."
        )
    numbers = numbers[numbers > 0]
    if not len(numbers):
        raise InputError("The label images hold nothing but background (0); number the objects from 1.")
    numbers = numbers.astype(np.uint8 if all(image.dtype == np.uint8 for image in labels) else np.int32)

    def weights_of(part: Ids) -> Float64Array:
        images = [_places(image, part) for image in labels]
        return sum_label_weights(gaussians, cameras, images, len(part) + 1)

    return assign_labels(len(gaussians), numbers, weights_of, gamma)


def lift_folder(
    gaussians: Gaussians, cameras: CameraSet | None, folder: Path, gamma: float = 0.0, *, ids: bool = False
) -> tuple[NDArray[Any], int]:
    """Return what a folder of masks selects or, of masks with ids, the number of each object, (N,); and how many masks.

    Raises:
        InputError: there are no cameras, a mask cannot be read, or as `lift_by_assignment`.
    """
    if cameras is None:
        raise InputError("Masks need the cameras of their pictures: --cameras PATH.")
    if ids:
        found = find_masks(cameras.pinhole_cameras(), folder)
        posed, images = [camera for camera, _ in found], [ids_of(camera, path) for camera, path in found]
        return lift_objects_by_assignment(gaussians, posed, images, gamma), len(posed)
    pairs = read_masks(folder, cameras)
    selected = lift_by_assignment(gaussians, [camera for camera, _ in pairs], [mask for _, mask in pairs], gamma)
    return selected, len(pairs)


def _places(image: Ids, numbers: Ids) -> LabelArray:
    """Find each pixel's number in a sorted list, from 1; 0 for the background, and one too many for others."""
    places = np.searchsorted(numbers, image)
    found = numbers[np.minimum(places, len(numbers) - 1)] == image
    return np.where(image == 0, 0, np.where(found, places, len(numbers)) + 1).astype(np.uint8)


def sum_label_weights(
    gaussians: Gaussians, cameras: Sequence[Camera], labels: Sequence[LabelArray], n_labels: int
) -> Float64Array:
    """Blend weights of each Gaussian summed over the pixels of each label and all views, (N, n_labels)."""
    weights = np.zeros((len(gaussians), n_labels))
    for of_view in label_weights(gaussians, cameras, labels, n_labels):
        weights += of_view
    return weights


def _check_sizes(cameras: Sequence[Camera], images: Sequence[NDArray[Any]]) -> None:
    if len(cameras) != len(images) or not cameras:
        raise InputError(f"There are {len(images)} masks for {len(cameras)} cameras; one for each is needed.")
    for camera, image in zip(cameras, images, strict=True):
        if image.shape != (camera.height, camera.width):
            size = " x ".join(map(str, image.shape[::-1]))
            raise InputError(
                f"View '{camera.name}' has a mask of {size} pixels for a camera of {camera.width} x {camera.height}; "
                "resize the masks, keeping hard edges, or the cameras."
            )

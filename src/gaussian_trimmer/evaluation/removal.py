"""How well a scene goes on where its object was: pictures against pictures of the scene without the object.

What counts are the pixels that the object covered, its mask grown by a few pixels, since its colours and its fit reach
beyond the mask. Pixels of other objects' masks are left out: what stands before the object belongs to another question.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.evaluation.ground_truth import at_size, find_picture, read_mask, read_photograph
from gaussian_trimmer.evaluation.metrics import THRESHOLD, psnr, similarity_map
from gaussian_trimmer.evaluation.scoring import HIGHEST_PSNR
from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.segmentation.segmenters.mask_files import cameras_with_masks, find_mask
from gaussian_trimmer.views import grown

IGNORED = 0.1
"""Coverage by another object above which a pixel does not count."""
INPAINT_RADIUS = 3.0
"""Pixels from which each pixel is painted over."""


@dataclass(frozen=True)
class RemovalFolders:
    """Where pictures and masks lie, each named like the picture of its camera."""

    without: Path
    """Pictures of the scene without the object."""
    masks: Path
    """Masks of the object."""
    images: Path | None = None
    """Photographs with the object."""
    ignore: Sequence[Path] = ()
    """Masks of other objects, a folder for each."""


@dataclass(frozen=True, eq=False)
class RemovalView:
    """What is known of one view without the object."""

    camera: Camera
    without: FloatArray
    """The view without the object, in [0, 1], (H, W, 3)."""
    covered: BoolArray
    """Pixels that the object covered, and those around them, (H, W)."""
    counted: BoolArray
    """Those of them that no other object covers, (H, W)."""
    photograph: FloatArray | None
    """The view with the object, in [0, 1], (H, W, 3); None if it is not known."""


@dataclass(frozen=True)
class Likeness:
    """How like the truth a picture is where the object was."""

    psnr: float
    """In dB, at most 100."""
    ssim: float


def views_without(
    cameras: Sequence[Camera], folders: RemovalFolders, grow: int
) -> tuple[list[Camera], Iterator[RemovalView]]:
    """The cameras that have both a picture without the object and a mask of it, and their views, read one by one.

    Args:
        cameras: pinhole cameras with the names of their pictures.
        folders: where pictures and masks lie.
        grow: by how many pixels the masks are grown.

    Raises:
        InputError: a folder is missing or fits no camera, or a view lacks its picture or its mask.
    """
    pictured, masked = (cameras_with_masks(cameras, folder) for folder in (folders.without, folders.masks))
    for folder in (folders.images, *folders.ignore):
        if folder is not None and not folder.is_dir():
            raise InputError(f"There is no folder '{folder}'.")
    names = {camera.name for camera in masked}
    found = [camera for camera in pictured if camera.name in names]
    if len(found) < min(len(pictured), len(masked)):
        lacks = next(camera for camera in pictured if camera.name not in names)
        raise InputError(
            f"'{folders.masks}' has no mask of the view '{clip_name(lacks.name)}', of which '{folders.without}' has a "
            "picture, and has masks of others; one of the folders must have every view of the other."
        )
    return found, (_view(camera, folders, grow) for camera in found)


def _view(camera: Camera, folders: RemovalFolders, grow: int) -> RemovalView:
    path = find_picture(folders.masks, camera)
    mask = read_mask(path)
    height, width = mask.shape
    covered = grown(mask > THRESHOLD, grow)
    counted = covered.copy()
    for folder in folders.ignore:
        other = find_mask(folder, camera)
        if other is None:
            continue
        coverage = read_mask(other)
        if coverage.shape != mask.shape:
            raise InputError(f"The masks '{path}' and '{other}' have different sizes; they must have the same.")
        counted &= coverage <= np.float32(IGNORED)
    without = read_photograph(find_picture(folders.without, camera), width, height)
    photograph = read_photograph(find_picture(folders.images, camera), width, height) if folders.images else None
    return RemovalView(at_size(camera, width, height, path), without, covered, counted, photograph)


def likeness(picture: FloatArray, view: RemovalView) -> Likeness | None:
    """How like the view without the object a picture (H, W, 3) is; None where no pixel counts."""
    if not view.counted.any():
        return None
    clipped = np.clip(picture, 0, 1)
    error = psnr(clipped[view.counted], view.without[view.counted])
    return Likeness(min(error, HIGHEST_PSNR), float(similarity_map(clipped, view.without)[view.counted].mean()))


def inpainted(view: RemovalView) -> FloatArray | None:
    """The photograph with the object painted over from its surroundings alone, (H, W, 3); None without a photograph.

    It is OpenCV's inpainting after "An Image Inpainting Technique Based on the Fast Marching Method" (Telea, 2004).
    """
    if view.photograph is None:
        return None
    picture = np.round(view.photograph * 255).astype(np.uint8)
    filled = cv2.inpaint(picture, view.covered.astype(np.uint8), INPAINT_RADIUS, cv2.INPAINT_TELEA)
    return np.asarray(filled / np.float32(255))

"""Any segmenter, shown the photographs that a scene was trained on instead of renderings of the scene.

Photographs are sharper than any rendering, most of all where a scene has few and large Gaussians. Views must be those
of training cameras, or crops of their pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians
from gaussian_trimmer.io.reading import (
    MAX_PIXELS,
    decoded_picture,
    file_bytes,
    is_file,
    path_inside,
    picture_size,
    reading,
)
from gaussian_trimmer.masks import MaskSource, Segmenter, description_of, mask_source_of
from gaussian_trimmer.views.view import View

_SUFFIXES = (".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp")
_MAX_FILE_BYTES = 1 << 28
_MAX_SIDE_PIXELS = 32_000
"""OpenCV resamples pictures up to 32,767 pixels wide and high."""
_MAX_BLURRED_SHRINK = 8.0
"""Pixels of the photograph for one of the view, along an edge, up to which the photograph is blurred as it is."""
_MAX_STRETCH = 0.02
"""Largest difference in proportions between a photograph and its camera's picture."""


class PhotoSegmenter:
    """Gives a segmenter photographs to look at.

    Args:
        segmenter: what segments.
        folder: holds the photographs, each named as its camera, with any ending.
        originals: the training cameras, uncropped.
    """

    def __init__(self, segmenter: Segmenter, folder: Path, originals: Sequence[Camera]) -> None:
        self.name = segmenter.name
        own = mask_source_of(segmenter)
        self.mask_source: MaskSource = "photographs" if own == "renderings" else own
        self._segmenter, self._folder = segmenter, folder
        self._originals = {camera.name: camera for camera in originals}

    def describe(self) -> str:
        """Return what the segmenter says of itself, and that it saw photographs."""
        described = description_of(self._segmenter)
        return f"{described}, on photographs from {self._folder}"

    def report_to(self, report: Callable[[str], None]) -> None:
        """Hand on, to a segmenter that reports its progress."""
        if hasattr(self._segmenter, "report_to"):
            self._segmenter.report_to(report)

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """Return one mask (H, W) for each view.

        Raises:
            InputError: a view is of no training camera, or its photograph cannot be used.
        """
        return self._segmenter.segment([self._with_photo(view) for view in views])

    def segment_together(self, views: Sequence[View], gaussians: Gaussians) -> list[BoolArray]:
        """Return the same, for segmenters that ask for the Gaussians."""
        if not hasattr(self._segmenter, "segment_together"):
            return self.segment(views)
        shown = [self._with_photo(view) for view in views]
        return list(self._segmenter.segment_together(shown, gaussians))

    def _with_photo(self, view: View) -> View:
        original = self._originals.get(view.camera.name)
        if original is None or not view.camera.name:
            raise InputError(f"The view '{view.camera.name}' has no photograph, since it is not a training camera's.")
        rgb = photo_of(view.camera, original, self._folder)
        return replace(view, picture=replace(view.picture, rgb=rgb), photographed=True)


def cameras_with_photos(cameras: Sequence[Camera], folder: Path) -> list[Camera]:
    """Return the cameras whose photographs are in a folder, in their order.

    Raises:
        InputError: the folder does not exist, or has no photograph of any camera.
    """
    if not folder.is_dir():
        raise InputError(f"There is no folder '{folder}' to read photographs from.")
    found = [camera for camera in cameras if _find(folder, camera) is not None]
    if not found:
        raise InputError(
            f"No picture in '{folder}' has the name of one of the {len(cameras)} cameras; --photos takes the folder of "
            "the pictures that the scene was trained on."
        )
    return found


def photo_of(camera: Camera, original: Camera, folder: Path) -> FloatArray:
    """Return what a camera, or a crop of it, sees in the photograph of the original one, (H, W, 3) in [0, 1].

    A photograph may be larger or smaller than its camera says, but must have its proportions. Black beyond its edges.

    Raises:
        InputError: there is no photograph, or it cannot be used.
    """
    path = _find(folder, original)
    if path is None:
        raise InputError(f"The folder '{folder}' has no photograph of the camera '{original.name}'.")
    picture = _read(path)
    height, width = picture.shape[:2]
    scale = np.array([width / original.width, height / original.height])
    if abs(scale[0] / scale[1] - 1) > _MAX_STRETCH:
        raise InputError(
            f"The photograph '{path}' has {width} x {height} pixels, and its camera {original.width} x "
            f"{original.height}: other proportions, so they do not belong together."
        )
    # From pixels of the crop to pixels of the photograph, both counted from their corners.
    to_photo = np.diag([*scale, 1.0]) @ original.K @ np.linalg.inv(camera.K)
    return _resampled(picture, to_photo, camera)


def _resampled(picture: NDArray[np.uint8], to_photo: Float64Array, camera: Camera) -> FloatArray:
    """Return pixels of a crop, red first, in [0, 1]; 8 bits a channel until the end, since photographs are large."""
    shrink = max(float(to_photo[0, 0]), float(to_photo[1, 1]), 1.0)
    if shrink > _MAX_BLURRED_SHRINK:  # a wide blur takes long
        factor = _MAX_BLURRED_SHRINK / shrink
        height, width = (max(round(side * factor), 1) for side in picture.shape[:2])
        to_photo = np.diag([width / picture.shape[1], height / picture.shape[0], 1.0]) @ to_photo
        picture = np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
        shrink = _MAX_BLURRED_SHRINK
    if shrink > 1:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.4 * shrink), np.uint8)
    centres = to_photo @ np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    centres[:2, 2] -= 0.5
    found = cv2.warpAffine(
        picture, centres[:2], (camera.width, camera.height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )
    return np.asarray(found[..., ::-1], np.float32) / np.float32(255)


def _find(folder: Path, camera: Camera) -> Path | None:
    named = path_inside(folder, camera.name)
    if named is None:
        return None
    stem = named.stem if named.suffix.lower() in _SUFFIXES else named.name
    names = [named.name, *(stem + suffix for suffix in _SUFFIXES)]
    paths = [named.parent / name for name in names if name.lower().endswith(_SUFFIXES)]
    return next(filter(is_file, paths), None)


def _read(path: Path) -> NDArray[np.uint8]:
    """Return a picture (H, W, 3), blue first."""
    with reading(path):
        data = file_bytes(path, _MAX_FILE_BYTES)
    size = picture_size(data)
    if size and (size[0] * size[1] > MAX_PIXELS or max(size) > _MAX_SIDE_PIXELS):
        raise InputError(
            f"The photograph '{path}' has {size[0]} x {size[1]} pixels, too many to decode; make it smaller."
        )
    # As it is stored: cameras are those of the stored pixels, whatever a viewer is told to turn.
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    picture = decoded_picture(data, flags) if size else None
    if picture is None:
        raise InputError(f"'{path}' is not a picture that can be read.")
    return np.asarray(picture, np.uint8)

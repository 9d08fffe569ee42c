"""Ground truth of one view, read from folders of masks and photographs.

A mask belongs to the camera whose picture has the same name. It may have another size than that picture: the view is
then rendered at the mask's size.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import starmap
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.io.reading import file_bytes, is_file, path_inside, reading
from gaussian_trimmer.masks.mask_files import find_mask, find_masks, read_picture
from gaussian_trimmer.views.view import HALF_COVERAGE

IGNORED = 0.1
"""Coverage by another object above which a pixel does not count."""
_MAX_PIXELS = 1 << 26
_MAX_POLYGON_BYTES = 1 << 24
_ASPECT_TOLERANCE = 0.02
"""Relative difference of aspect ratios up to which two pictures show the same: sizes are rounded to whole pixels."""
_SAME_COVERAGE = 1.5 / 255
"""Masks that differ by less show the same: one step of their 8-bit files, and rounding."""


@dataclass(frozen=True, eq=False)
class TestView:
    """One held-out view of one object."""

    __test__ = False  # pytest would collect it for its name.

    camera: Camera
    image: FloatArray | None
    """Ground-truth picture in [0, 1], (H, W, 3); None if there is none."""
    coverage: FloatArray
    """Coverage by the object rendered alone, in [0, 1], (H, W)."""
    counted: BoolArray
    """Pixels at which that coverage is known, (H, W)."""
    visible: FloatArray | None = None
    """Coverage by what is visible of the object in its scene, known everywhere, (H, W); None if it is that alone."""
    far: bool = False
    """Whether the camera is far from all training cameras."""

    @property
    def in_scene(self) -> tuple[FloatArray, BoolArray]:
        """Coverage by what is visible of the object, and the pixels at which it is known, (H, W) each."""
        if self.visible is None:
            return self.coverage, self.counted
        return self.visible, np.ones(self.visible.shape, np.bool_)

    @property
    def picture_counted(self) -> BoolArray:
        """Pixels at which the picture shows the object as if nothing were before it, (H, W)."""
        return np.asarray(self.counted & (np.abs(self.coverage - self.in_scene[0]) < _SAME_COVERAGE))


def read_mask(path: Path) -> FloatArray:
    """Return the coverage in a mask file, in [0, 1], (H, W).

    Grey values are coverage, except that a JPEG is cut at one half, since its greys are noise of the compression, and
    that a file whose only values are 0 and 1 holds labels.

    Raises:
        InputError: the file cannot be read as a picture, or has too many pixels.
    """
    grey, is_jpeg = read_picture(path, cv2.IMREAD_GRAYSCALE)
    if is_jpeg:
        return (grey > HALF_COVERAGE).astype(np.float32)
    return grey.astype(np.float32) / np.float32(1 if grey.max() == 1 else 255)


def read_polygons(path: Path) -> tuple[tuple[int, int], dict[str, list[NDArray[np.int32]]]]:
    """Return the size of a picture, and the corners (P, 2) of each object's parts by category, from LERF-OVS's .json.

    Raises:
        InputError: the file cannot be read, or holds something else.
    """
    with reading(path):
        data = file_bytes(path, _MAX_POLYGON_BYTES)
    parts: dict[str, list[NDArray[np.int32]]] = {}
    try:
        found = json.loads(data)
        height, width = int(found["info"]["height"]), int(found["info"]["width"])
        for entry in found["objects"]:
            corners = np.array(entry["segmentation"], np.float64).reshape(-1, 2)
            if not (np.abs(corners) <= _MAX_PIXELS).all():
                raise ValueError("corners that are not pixels")
            parts.setdefault(str(entry["category"]), []).append(corners.astype(np.int32))
        if min(width, height) < 1 or width * height > _MAX_PIXELS:
            raise ValueError("a picture of impossible size")
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise InputError(
            f"'{path}' holds no polygons of objects ({clip_name(str(error))}); 'info' and 'objects' of LERF-OVS are "
            "needed."
        ) from error
    return (height, width), parts


def read_photograph(path: Path, width: int, height: int) -> FloatArray:
    """Return a picture in [0, 1], brought to a size, (H, W, 3).

    Raises:
        InputError: as for `read_mask`, or the picture has another shape.
    """
    bgr, _ = read_picture(path, cv2.IMREAD_COLOR)
    picture = np.ascontiguousarray(bgr[..., ::-1].astype(np.float32) / np.float32(255))
    if not _same_shape(picture.shape[1] / picture.shape[0], width / height):
        raise InputError(
            f"The picture '{path}' has {picture.shape[1]} x {picture.shape[0]} pixels and its mask {width} x {height}; "
            "both must show the same."
        )
    if picture.shape[:2] != (height, width):
        picture = np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA))
    return picture


def at_size(camera: Camera, width: int, height: int, path: Path) -> Camera:
    """Return the camera with a picture of another size that shows the same.

    Args:
        path: the file that has the size, for the message.

    Raises:
        InputError: the picture has another shape than the camera's.
    """
    if (width, height) == (camera.width, camera.height):
        return camera
    if not _same_shape(width / height, camera.width / camera.height):
        raise InputError(
            f"The mask '{path}' has {width} x {height} pixels and its camera '{clip_name(camera.name)}' "
            f"{camera.width} x "
            f"{camera.height}, which is another shape; give the cameras of the pictures that the masks were drawn on."
        )
    K = camera.K.copy()
    K[0] *= width / camera.width
    K[1] *= height / camera.height
    return replace(camera, K=K, width=width, height=height)


def view_of(
    camera: Camera,
    mask: Path,
    image: Path | None = None,
    ignored: Sequence[Path] = (),
    category: str | None = None,
) -> TestView:
    """Return the ground truth of one camera, from files.

    Args:
        mask: coverage of the object.
        image: photograph, of any size.
        ignored: masks of pixels that do not count, of the size of the first.
        category: which object of a file of polygons is meant; None if the mask is a picture.

    Raises:
        InputError: a file cannot be used.
    """
    coverage = read_mask(mask) if category is None else _drawn(*read_polygons(mask), category)
    height, width = coverage.shape
    counted = np.ones((height, width), np.bool_)
    for path in ignored:
        left_out = read_mask(path)
        if left_out.shape != coverage.shape:
            raise InputError(f"The masks '{mask}' and '{path}' have different sizes; they must have the same.")
        counted &= left_out <= IGNORED
    picture = read_photograph(image, width, height) if image is not None else None
    return TestView(at_size(camera, width, height, mask), picture, coverage, counted)


def views_in(
    cameras: Sequence[Camera],
    masks: Path,
    images: Path | None = None,
    ignored: Sequence[Path] = (),
) -> tuple[list[Camera], Iterator[TestView]]:
    """Return the cameras that have a mask, and a photograph if a folder is given; and their ground truth, view by view.

    Args:
        cameras: pinhole cameras with the names of their pictures.
        masks: folder of masks; `IMG_7.png`, `IMG_7.JPG.png` or `IMG_7.jpg` belongs to `IMG_7.JPG`.
        images: folder of photographs of the same names.
        ignored: folders of masks of pixels that do not count; views without one count whole.

    Raises:
        InputError: the folder has no mask of any camera, or `images` no photograph of any that has one.
    """
    found: list[tuple[Camera, Path, Path | None]] = [
        (camera, path, None) for camera, path in find_masks(cameras, masks)
    ]
    check_folders(images, *ignored)
    if images:
        pictures = {camera.name: picture_of(images, camera) for camera, _, _ in found}
        if not any(pictures.values()):
            raise InputError(f"'{images}' has no picture named like one of the {len(found)} cameras that have a mask.")
        found = [(camera, path, image) for camera, path, _ in found if (image := pictures[camera.name])]

    def view(camera: Camera, path: Path, image: Path | None) -> TestView:
        others = [other for folder in ignored if (other := find_mask(folder, camera))]
        return view_of(camera, path, image, others)

    return [camera for camera, *_ in found], starmap(view, found)


def check_folders(*folders: Path | None) -> None:
    """Raise InputError if a folder that is given does not exist."""
    for folder in folders:
        if folder is not None and not folder.is_dir():
            raise InputError(f"There is no folder '{folder}'.")


def picture_of(folder: Path, camera: Camera) -> Path | None:
    """Return the photograph of a camera in a folder: its own file, or one of the same name with another ending, if any.

    Raises:
        InputError: there are several.
    """
    named = path_inside(folder, camera.name)
    return named if named is not None and is_file(named) else find_mask(folder, camera)


def find_picture(folder: Path, camera: Camera) -> Path:
    """Return the photograph of a camera in a folder, see `picture_of`; InputError if there is none."""
    found = picture_of(folder, camera)
    if found is None:
        raise InputError(
            f"'{folder}' has no picture named like the camera '{clip_name(camera.name)}', which has a mask."
        )
    return found


def _drawn(size: tuple[int, int], parts: dict[str, list[NDArray[np.int32]]], category: str) -> FloatArray:
    drawn = np.zeros(size, np.uint8)
    for corners in parts[category]:
        cv2.fillPoly(drawn, [corners], (1,))
    return drawn.astype(np.float32)


def _same_shape(a: float, b: float) -> bool:
    return abs(a - b) <= _ASPECT_TOLERANCE * min(a, b)

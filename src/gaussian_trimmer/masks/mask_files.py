"""Masks from files, for cameras whose pictures exist.

A mask belongs to the camera whose picture has the same name: `IMG_7.png` or `IMG_7.JPG.png` to `IMG_7.JPG`. In a
pattern instead of a folder, `*` stands for that name without its ending, or for the number at its end.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.io.reading import (
    MAX_PIXELS,
    decoded_picture,
    file_bytes,
    is_file,
    path_inside,
    picture_size,
    reading,
)
from gaussian_trimmer.views.view import HALF_COVERAGE, ViewMasks

_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
_MAX_FILE_BYTES = 1 << 28
_JPEG = b"\xff\xd8"
_NUMBER = re.compile(r"\d+$")


def read_masks(folder: Path, cameras: CameraSet | None) -> ViewMasks:
    """Return the cameras that have a mask in a folder, each with its mask, as `trim` takes them.

    Args:
        folder: holds the masks, each named like the picture of its camera; or a pattern such as 'out/*/chosen_cup.png',
            in which * stands for that name or the number in it. The object is bright.
        cameras: those of the masks' pictures.

    Raises:
        InputError: there are no cameras, their images are distorted, the folder has no mask for any, or one cannot be
            read or is of another size.
    """
    if cameras is None:
        raise InputError(f"The masks in '{folder}' need the cameras of their pictures: --cameras PATH.")
    return [(camera, mask_of(camera, folder)) for camera in cameras_with_masks(cameras.pinhole_cameras(), folder)]


def mask_of(camera: Camera, folder: Path) -> BoolArray:
    """Return the mask of a camera's picture, True where the file is brighter than half, (H, W).

    Raises:
        InputError: the folder has none, or it cannot be read or is of another size.
    """
    return np.asarray(_read(camera, folder, cv2.IMREAD_GRAYSCALE) > HALF_COVERAGE)


def ids_of(camera: Camera, folder: Path) -> NDArray[Any]:
    """Return the object numbers of a camera's picture, 0 for the background, (H, W), uint8 or int32.

    Grey values of 8 or 16 bits are the numbers. Of colours, the number is R + 256 G + 65536 B, as COCO's panoptic masks
    have it; black is the background, and an alpha channel is left out.

    Raises:
        InputError: as for `mask_of`, or the file has neither such grey values nor colours of 8 bits a channel.
    """
    ids = _read(camera, folder, cv2.IMREAD_UNCHANGED)
    if ids.ndim == 2 and ids.dtype in (np.uint8, np.uint16):
        return ids if ids.dtype == np.uint8 else ids.astype(np.int32)
    if ids.ndim != 3 or ids.shape[2] not in (3, 4) or ids.dtype != np.uint8:
        raise InputError(
            f"The mask of '{camera.name}' has pixels of {ids.dtype} {ids.shape[2:]}; object numbers are grey values of "
            "8 or 16 bits, or colours of 8 bits a channel."
        )
    blue, green, red = (ids[..., channel].astype(np.int32) for channel in range(3))
    if np.array_equal(red, green) and np.array_equal(green, blue):
        return np.asarray(ids[..., 0])  # grey values that were saved as colours
    return np.asarray(red + 256 * green + 65536 * blue)


def cameras_with_masks(cameras: Sequence[Camera], folder: Path) -> list[Camera]:
    """Return the cameras for whose pictures the folder has a mask, in their order.

    Raises:
        InputError: the folder does not exist, has several masks for one camera, or none for any.
    """
    if not (_is_pattern(folder) or folder.is_dir()):
        raise InputError(f"There is no folder '{folder}' to read masks from.")
    names_in = cache(_names_in)  # a camera has fourteen names that its mask may have
    found = [camera for camera in cameras if find_mask(folder, camera, names_in) is not None]
    if not found:
        example = clip_name(cameras[0].name) or "the pictures, but the cameras have no names"
        prompts = sorted({path.name for path in folder.glob("*/chosen_*.png")})
        hint = f" Of LangSplat's answers name one: '{folder}/*/{clip_name(prompts[0])}'." if prompts else ""
        inner = sorted(folder.glob("*/"))
        if objects := [path for path in inner if any(find_mask(path, camera, names_in) for camera in cameras)]:
            hint = f" Give the folder of one object, such as '{folder}/{clip_name(objects[0].name)}'."
        raise InputError(
            f"No mask in '{folder}' has the name of one of the {len(cameras)} pictures, such as {example}.{hint}"
        )
    return found


def _is_pattern(folder: Path) -> bool:
    return "*" in str(folder)


def _names_in(folder: Path) -> frozenset[str]:
    """Return the names in a folder, folded since some systems do not tell capitals apart; none if it cannot be read."""
    try:
        return frozenset(path.name.casefold() for path in folder.iterdir())
    except (OSError, ValueError):  # there is no such folder, or there can be none
        return frozenset()


def find_mask(folder: Path, camera: Camera, names_in: Callable[[Path], frozenset[str]] | None = None) -> Path | None:
    """Return the mask of a camera's picture, or None.

    Args:
        folder: of the masks, or a pattern.
        camera: the camera.
        names_in: gives the folded names in a folder, so that most masks which are not there are not looked for.

    Raises:
        InputError: there are several.
    """
    if _is_pattern(folder):
        stem = Path(camera.name).stem
        number = _NUMBER.search(stem)
        named = [Path(str(folder).replace("*", name)) for name in (stem, number[0] if number else stem) if name]
        return next((path for path in named if is_file(path)), None)
    picture = path_inside(folder, camera.name)
    if picture is None:
        return None
    names = {f"{stem}{suffix}" for stem in (picture.name, picture.stem) for suffix in _SUFFIXES}
    if names_in is not None and names_in(picture.parent).isdisjoint(map(str.casefold, names)):
        return None
    found = sorted(path for path in map(picture.parent.joinpath, names) if is_file(path))
    if len(found) > 1:
        raise InputError(f"'{camera.name}' has several masks ({', '.join(p.name for p in found)}); leave one.")
    return found[0] if found else None


def read_picture(path: Path, mode: int) -> tuple[NDArray[Any], bool]:
    """Return the pixels of a picture file as OpenCV gives them in a mode, and whether it is a JPEG.

    Raises:
        InputError: the file cannot be read as a picture, or has more than 134 million pixels.
    """
    with reading(path):
        data = file_bytes(path, _MAX_FILE_BYTES)
    size = picture_size(data)
    if size is not None and size[0] * size[1] > MAX_PIXELS:
        raise InputError(f"The picture '{path}' has {size[0]} x {size[1]} pixels, too many; make it smaller.")
    picture = decoded_picture(data, mode) if size else None
    if picture is None:
        raise InputError(f"'{path}' is not a picture that can be read; masks are best saved as PNG.")
    return picture, data.startswith(_JPEG)


def _read(camera: Camera, folder: Path, mode: int) -> NDArray[Any]:
    path = find_mask(folder, camera)
    if path is None:
        raise InputError(f"The folder '{folder}' has no mask for the view '{camera.name}'.")
    picture, _ = read_picture(path, mode)
    height, width = picture.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise InputError(
            f"The mask '{path}' has {width} x {height} pixels, but its camera has {camera.width} x {camera.height}; "
            "resize the masks, keeping hard edges, or the cameras."
        )
    return picture

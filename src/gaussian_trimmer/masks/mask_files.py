"""Masks from files, for cameras whose pictures exist.

A mask belongs to the camera whose picture has the same name, but for its ending and the word mask: `IMG_7.png`,
`IMG_7.JPG.png`, `IMG_7_mask.png`, `mask_IMG_7.png` or `img_7.mask.png` to `IMG_7.JPG`. In a pattern instead of a
folder, `*` stands for that name without its ending, or for the number at its end. A transforms.json names the masks of
its pictures itself, as `mask_path`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
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
    read_json,
    reading,
)
from gaussian_trimmer.views.view import HALF_COVERAGE, ViewMasks

_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
_ENDINGS = re.compile(rf"(?:{'|'.join(map(re.escape, _SUFFIXES))})+$")
_WORD = re.compile(r"^masks?[._-]|[._-]masks?$")
_MAX_FILE_BYTES = 1 << 28
_JPEG = b"\xff\xd8"
_NUMBER = re.compile(r"\d+$")
_NEAR_BACKGROUND = 8
"""Difference from black or white, of 255, up to which a colour is the background of a cut-out."""
_LEAST_BACKGROUND = 0.02
"""Share of a cut-out that is background, at least."""
Names = Callable[[Path], Mapping[str, list[Path]]]


def read_masks(folder: Path, cameras: CameraSet | None) -> ViewMasks:
    """Return the cameras that have a mask in a folder, each with its mask, as `trim` takes them.

    Args:
        folder: holds the masks, each named like the picture of its camera; or a pattern such as 'out/*/chosen_cup.png',
            in which * stands for that name or the number in it; or a transforms.json.
        cameras: those of the masks' pictures.

    Raises:
        InputError: there are no cameras, their images are distorted, the folder has no mask for any, one cannot be
            read or has another aspect, or all are empty.
    """
    if cameras is None:
        raise InputError(f"The masks in '{folder}' need the cameras of their pictures: --cameras PATH.")
    found = find_masks(cameras.pinhole_cameras(), folder)
    masks = [(camera, mask_of(camera, path)) for camera, path in found]
    if not any(mask.any() for _, mask in masks):
        largest = max(int(read_picture(path, cv2.IMREAD_ANYDEPTH)[0].max()) for _, path in found)
        raise InputError(
            f"The masks in '{folder}' are empty: their largest value is {largest}. The object is what is brighter than "
            "half, or the brighter of two values."
        )
    return masks


def mask_of(camera: Camera, path: Path) -> BoolArray:
    """Return the mask of a camera's picture in a file, (H, W): an alpha channel that varies, what is cut out on black
    or white, the brighter one of two grey values, or what is brighter than half.

    Raises:
        InputError: it cannot be read, is of another aspect, or is a photograph.
    """
    picture = read_picture(path, cv2.IMREAD_UNCHANGED)[0]
    if picture.ndim == 3 and picture.shape[2] == 4 and np.ptp(picture[..., 3]):
        picture = picture[..., 3]
    else:
        picture = read_picture(path, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)[0]  # upright, if it was turned
    if picture.ndim == 3 and np.ptp(picture, axis=2).any():
        mask = _cut_out(picture, path)
    else:
        grey = picture if picture.ndim == 2 else picture[..., 0]
        high = grey.max()
        of_two = grey.min() < high and not ((grey > grey.min()) & (grey < high)).any()
        half = HALF_COVERAGE * (np.iinfo(grey.dtype).max // 255) if grey.dtype.kind == "u" else 0.5
        mask = grey == high if of_two else grey > half
    if mask.shape == _fitting_shape(camera, mask.shape, path):
        return np.asarray(mask)
    smaller = mask.shape[0] > camera.height
    how = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    size = (camera.width, camera.height)
    return np.asarray(cv2.resize(mask.astype(np.float32), size, interpolation=how) > 0.5)


def _cut_out(picture: NDArray[Any], path: Path) -> BoolArray:
    """Return which pixels of a picture in colours, (H, W, 3), are not its background, which is black or white.

    Raises:
        InputError: hardly any pixel is.
    """
    top = np.iinfo(picture.dtype).max
    near = top * _NEAR_BACKGROUND // 255
    black, white = (picture <= near).all(axis=2), (picture >= top - near).all(axis=2)
    background = max(black, white, key=np.count_nonzero)
    if background.mean() < _LEAST_BACKGROUND:
        raise InputError(f"'{path}' is a picture in colours and not cut out on black or white: no mask.")
    return np.asarray(~background)


def ids_of(camera: Camera, path: Path) -> NDArray[Any]:
    """Return the object numbers of a camera's picture in a file, 0 for the background, (H, W), uint8 or int32.

    Grey values of 8 or 16 bits are the numbers. Of colours, the number is R + 256 G + 65536 B, as COCO's panoptic masks
    have it; black is the background, and an alpha channel is left out.

    Raises:
        InputError: as for `mask_of`, or the file has neither such grey values nor colours of 8 bits a channel.
    """
    ids = read_picture(path, cv2.IMREAD_UNCHANGED)[0]
    if ids.shape[:2] != _fitting_shape(camera, ids.shape, path):
        ids = cv2.resize(ids, (camera.width, camera.height), interpolation=cv2.INTER_NEAREST)
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


def find_masks(cameras: Sequence[Camera], folder: Path) -> list[tuple[Camera, Path]]:
    """Return the cameras for whose pictures there is a mask, in their order, each with the file.

    Where none lies below the folder as its picture does, masks are looked for in the folder itself, and then in the
    only folder in it that has some.

    Raises:
        InputError: the folder does not exist, has several masks for one camera, one for several, or none for any.
    """
    if folder.suffix.lower() == ".json":
        found = _named_masks(cameras, folder)
        inner = list[Path]()
    elif not (_is_pattern(folder) or folder.is_dir()):
        raise InputError(f"There is no folder '{folder}' to read masks from.")
    else:
        names_in = cache(_names_in)
        bare = [replace(camera, name=Path(_slashes(camera.name)).name) for camera in cameras]
        inner = sorted(folder.glob("*/")) if not _is_pattern(folder) else []
        found = _found(cameras, cameras, folder, names_in) or _found(cameras, bare, folder, names_in)
        inside = {} if found else {path: _found(cameras, bare, path, names_in) for path in inner}
        inner = [path for path, masks in inside.items() if masks]
        found = inside[inner[0]] if len(inner) == 1 else found
    if not found:
        example = clip_name(cameras[0].name) or "the pictures, but the cameras have no names"
        prompts = sorted({path.name for path in folder.glob("*/chosen_*.png")})
        hint = f" Of LangSplat's answers name one: '{folder}/*/{clip_name(prompts[0])}'." if prompts else ""
        if inner:
            hint = f" Give the folder of one object, such as '{folder}/{clip_name(inner[0].name)}'."
        raise InputError(
            f"No mask in '{folder}' has the name of one of the {len(cameras)} pictures, such as {example}.{hint}"
        )
    if not _is_pattern(folder) and len({path for _, path in found}) < len(found):
        raise InputError(
            f"Pictures of the same name in different folders have one mask in '{folder}'; put the masks into folders "
            "as the pictures are."
        )
    return found


def _found(
    cameras: Sequence[Camera], named: Sequence[Camera], folder: Path, names_in: Names
) -> list[tuple[Camera, Path]]:
    """Return the cameras with a mask of the name that another camera has."""
    paths = (find_mask(folder, other, names_in) for other in named)
    return [(camera, path) for camera, path in zip(cameras, paths, strict=True) if path is not None]


def _named_masks(cameras: Sequence[Camera], document: Path) -> list[tuple[Camera, Path]]:
    """Return the cameras whose pictures a transforms.json has masks for, inside its own folder."""
    frames = (read_json(document) or {}).get("frames") if is_file(document) else None
    named = {
        str(frame.get("file_path")): path_inside(document.parent, _slashes(str(frame["mask_path"])))
        for frame in (frames if isinstance(frames, list) else ())
        if isinstance(frame, dict) and frame.get("mask_path")
    }
    paths = ((camera, named.get(camera.name)) for camera in cameras)
    return [(camera, path) for camera, path in paths if path is not None]


def _slashes(name: str) -> str:
    return name.replace("\\", "/")


def _is_pattern(folder: Path) -> bool:
    return "*" in str(folder)


def _key(name: str) -> str:
    """Return what names of a picture and of its mask have in common.

    >>> {_key(name) for name in ("IMG_7.JPG", "IMG_7.jpg.png", "IMG_7_mask.png", "mask_IMG_7.tif", "img_7.mask.PNG")}
    {'img_7'}
    """
    return _WORD.sub("", _ENDINGS.sub("", name.casefold()))


def _names_in(folder: Path) -> dict[str, list[Path]]:
    """Return the pictures in a folder by what their names have in common; none if it cannot be read."""
    found: dict[str, list[Path]] = {}
    try:
        for path in sorted(folder.iterdir()):
            if path.suffix.lower() in _SUFFIXES:
                found.setdefault(_key(path.name), []).append(path)
    except (OSError, ValueError):  # there is no such folder, or there can be none
        pass
    return found


def find_mask(folder: Path, camera: Camera, names_in: Names | None = None) -> Path | None:
    """Return the mask of a camera's picture, or None; of several files, those with mask in their name.

    Args:
        folder: of the masks, or a pattern.
        camera: the camera.
        names_in: gives the pictures in a folder, by keys.

    Raises:
        InputError: there are several.
    """
    if _is_pattern(folder):
        stem = Path(camera.name).stem
        number = _NUMBER.search(stem)
        named = [Path(str(folder).replace("*", name)) for name in (stem, number[0] if number else stem) if name]
        return next((path for path in named if is_file(path)), None)
    picture = path_inside(folder, _slashes(camera.name))
    if picture is None:
        return None
    names = (names_in or _names_in)(picture.parent)
    keys = dict.fromkeys((_key(picture.name), _key(picture.stem)))
    found = [path for key in keys for path in names.get(key, ()) if is_file(path)]
    found = [path for path in found if _WORD.search(_ENDINGS.sub("", path.name.casefold()))] or found
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


def _fitting_shape(camera: Camera, shape: tuple[int, ...], path: Path) -> tuple[int, int]:
    """Return the shape (H, W) of a camera's pictures, for a mask of the same aspect to a pixel.

    Raises:
        InputError: it is of another.
    """
    height, width = shape[:2]
    if abs(width * camera.height - height * camera.width) > max(camera.width, camera.height):
        raise InputError(
            f"The mask '{path}' has {width} x {height} pixels, but its camera has {camera.width} x {camera.height}, "
            "another aspect; take the masks of the whole pictures."
        )
    return camera.height, camera.width

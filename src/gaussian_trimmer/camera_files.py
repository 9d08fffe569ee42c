"""Camera files: COLMAP models, transforms.json, Inria's cameras.json and lists of OpenCV matrices.

| what | where | pose |
|---|---|---|
| COLMAP model, binary or text | a folder, or sparse/0 or sparse below it | world to camera, OpenCV axes |
| transforms.json of nerfstudio, Instant-NGP, Blender | frames with `transform_matrix` | camera to world, OpenGL axes |
| Inria's cameras.json | a list with `position` and `rotation` | camera to world, OpenCV axes |
| OpenCV matrices | frames with `world_to_camera` and `K` | world to camera, OpenCV axes |

Poses are given in the frame that the file uses. The `applied_transform` of a transforms.json is already contained in
its matrices and is not undone. Trainers that recentre and rescale the poses once more (nerfstudio's dataparser does)
export a splat that no longer fits them.
"""

from __future__ import annotations

import json
import math
import struct
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, cast

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array, FloatArray, rotation_matrices

DISTORTION_TOLERANCE = 1e-4
"""Largest distortion coefficient that is taken for zero: it moves the corner of a 1000-pixel image by 0.05 pixels."""
_RIGID_TOLERANCE = 1e-2
_MAX_IMAGE_SIDE = 1 << 16
_MAX_NAME_BYTES = 4096
_MAX_JSON_BYTES = 1 << 28
_OPENGL_TO_OPENCV = np.array([1.0, -1.0, -1.0])
_DISTORTION_KEYS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")


@dataclass(frozen=True, eq=False)
class CameraSet:
    """The cameras of one file, in its order, and what else the file says about them."""

    cameras: tuple[Camera, ...]
    """V cameras, pinhole even where the images are distorted."""
    up: Float64Array | None
    """Unit up vector that the file states, (3,), or None."""
    train: tuple[bool, ...]
    """Which cameras took training images, (V,); all of them where the file names no split."""
    distorted: bool
    """Whether some image is distorted by its lens, so that its pixels are not where the cameras project them."""

    def pinhole_cameras(self) -> tuple[Camera, ...]:
        """The cameras for use with the pixels of their images.

        Raises:
            InputError: an image is distorted. (Poses and fields of view of `cameras` can be used all the same.)
        """
        if self.distorted:
            raise InputError(
                "The cameras have lens distortion, so masks of their images cannot be used; "
                "undistort images and cameras first (colmap image_undistorter) and give the new ones."
            )
        return self.cameras


@dataclass(frozen=True, eq=False)
class _Lens:
    """Intrinsics that several images may share."""

    K: Float64Array
    width: int
    height: int
    distorted: bool


@dataclass(frozen=True, eq=False)
class _Frame:
    """One image as read, before its name is settled."""

    path: str
    world_to_camera: Float64Array
    lens: _Lens
    train: bool = True


def read_cameras(path: str | Path) -> list[Camera]:
    """The cameras of a COLMAP folder or of a JSON file; errors as `read_camera_set`."""
    return list(read_camera_set(path).cameras)


def read_camera_set(path: str | Path) -> CameraSet:
    """Cameras, split and up vector of a COLMAP folder or of a JSON file; the kind is found by content.

    Raises:
        InputError: nothing readable is there, two kinds are, the file is damaged, or a camera is not possible.
    """
    found = _camera_file(Path(path))
    up = None
    if found.suffix == ".json":
        document = _load_json(found)
        frames = list(_json_frames(document, found))
        if isinstance(document, dict) and document.get("up") is not None:
            up = _unit_vector(document["up"], f"'{found}': the up vector")
    else:
        frames = list(_colmap_frames(found))
    if not frames:
        raise InputError(f"'{found}' holds no posed images; give the cameras of a finished reconstruction.")
    cameras = [
        Camera(frame.world_to_camera, frame.lens.K, frame.lens.width, frame.lens.height, name)
        for frame, name in zip(frames, _image_names([frame.path for frame in frames]), strict=True)
    ]
    train, distorted = tuple(frame.train for frame in frames), any(frame.lens.distorted for frame in frames)
    return CameraSet(tuple(cameras), up, train, distorted)


def _camera_file(path: Path) -> Path:
    """The JSON file, or the COLMAP images file, that a path stands for."""
    if path.is_file():
        if path.suffix.lower() == ".json":
            return path
        if path.stem in ("cameras", "images") and path.suffix in (".bin", ".txt"):
            return _camera_file(path.parent)
        raise InputError(f"'{path}' is no camera file; give a COLMAP folder, a transforms.json or a cameras.json.")
    if not path.is_dir():
        raise InputError(f"There is no file or folder '{path}' to read cameras from.")
    models = [
        folder / f"images{suffix}"
        for folder in (path, path / "sparse" / "0", path / "sparse")
        for suffix in (".bin", ".txt")
        if all((folder / f"{stem}{suffix}").is_file() for stem in ("cameras", "images"))
    ]
    documents = [path / name for name in ("transforms.json", "cameras.json") if (path / name).is_file()]
    # Binary and text twins of one COLMAP model agree; files of different kinds may use different coordinates.
    candidates = models[:1] + documents
    if len(candidates) > 1:
        names = ", ".join(str(c.relative_to(path)) for c in candidates)
        raise InputError(
            f"'{path}' holds several sets of cameras ({names}); give the one that the splat was made from."
        )
    if not candidates:
        raise InputError(
            f"'{path}' holds no cameras: neither cameras and images (.bin or .txt) of a COLMAP model, there or in "
            "sparse/0 or sparse, nor a transforms.json or cameras.json."
        )
    return candidates[0]


def _image_names(paths: Sequence[str]) -> list[str]:
    """File names of images; where two would be equal, paths without steps that lead out of a folder."""
    parts = [[part for part in path.replace("\\", "/").split("/") if part not in ("", ".", "..")] for path in paths]
    last = [part[-1] if part else "" for part in parts]
    repeated = {name for name, count in Counter(last).items() if count > 1}
    return ["/".join(part) if name in repeated else name for part, name in zip(parts, last, strict=True)]


# COLMAP -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Model:
    """A COLMAP camera model: `focals` focal lengths, the principal point, then distortion."""

    name: str
    parameters: int
    focals: int
    fisheye: bool = False


_MODELS = (  # the row number is the model's id in binary files
    _Model("SIMPLE_PINHOLE", 3, 1),
    _Model("PINHOLE", 4, 2),
    _Model("SIMPLE_RADIAL", 4, 1),
    _Model("RADIAL", 5, 1),
    _Model("OPENCV", 8, 2),
    _Model("OPENCV_FISHEYE", 8, 2, fisheye=True),
    _Model("FULL_OPENCV", 12, 2),
    _Model("FOV", 5, 2),
    _Model("SIMPLE_RADIAL_FISHEYE", 4, 1, fisheye=True),
    _Model("RADIAL_FISHEYE", 5, 1, fisheye=True),
    _Model("THIN_PRISM_FISHEYE", 12, 2, fisheye=True),
    _Model("RAD_TAN_THIN_PRISM_FISHEYE", 16, 2, fisheye=True),
)
_MODEL_NAMES = {model.name: model for model in _MODELS}


class _BinaryFile:
    """Little-endian values of a file that may end too early."""

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self.file = file
        self.path = path
        self.size = path.stat().st_size

    def values(self, layout: str) -> tuple[Any, ...]:
        data = self.file.read(struct.calcsize("<" + layout))
        if len(data) < struct.calcsize("<" + layout):
            raise self._truncated()
        return struct.unpack("<" + layout, data)

    def text(self) -> str:
        """Characters up to a NUL."""
        start = self.file.tell()
        head, nul, _ = self.file.read(_MAX_NAME_BYTES).partition(b"\0")
        if not nul:
            raise self._truncated()
        self.file.seek(start + len(head) + 1)
        return head.decode("utf-8", "replace")

    def skip(self, n_bytes: int) -> None:
        if n_bytes > self.size - self.file.tell():
            raise self._truncated()
        self.file.seek(n_bytes, 1)

    def _truncated(self) -> InputError:
        return InputError(f"'{self.path}' is truncated or damaged: it ends inside an entry; export the model again.")


def _colmap_frames(images: Path) -> Iterator[_Frame]:
    binary = images.suffix == ".bin"
    cameras = images.with_stem("cameras")
    lenses = dict(_binary_lenses(cameras) if binary else _text_lenses(cameras))
    for camera_id, name, quaternion, translation in _binary_poses(images) if binary else _text_poses(images):
        where = f"'{images}', image '{name}'"
        if camera_id not in lenses:
            raise InputError(f"{where}: its camera {camera_id} is not in '{cameras.name}'; export both files together.")
        q = _floats(quaternion, (4,), f"{where}: the quaternion")
        if np.linalg.norm(q) < 1e-6:
            raise InputError(f"{where}: the quaternion has length zero.")
        # The rotation is computed in float64; the annotation of the scene's quaternions is float32.
        rotation = rotation_matrices(cast(FloatArray, q[None]))[0]
        transform = np.column_stack([rotation, _floats(translation, (3,), f"{where}: the translation")])
        yield _Frame(name, _rigid(transform, where), lenses[camera_id])


def _binary_lenses(path: Path) -> Iterator[tuple[int, _Lens]]:
    with path.open("rb") as file:
        data = _BinaryFile(file, path)
        (count,) = data.values("Q")
        for _ in range(count):
            camera_id, model_id, width, height = data.values("IiQQ")
            where = f"'{path}', camera {camera_id}"
            if not 0 <= model_id < len(_MODELS):
                raise InputError(f"{where}: unknown camera model {model_id}; undistort to PINHOLE with COLMAP first.")
            model = _MODELS[model_id]
            yield camera_id, _model_lens(model, data.values(f"{model.parameters}d"), width, height, where)


def _text_lenses(path: Path) -> Iterator[tuple[int, _Lens]]:
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            words = line.split()
            if not words or words[0].startswith("#"):
                continue
            where = f"'{path}', line '{line.strip()[:60]}'"
            if len(words) < 5 or words[1] not in _MODEL_NAMES:
                raise InputError(f"{where}: no known camera model; undistort to PINHOLE with COLMAP first.")
            model = _MODEL_NAMES[words[1]]
            yield _integer(words[0], where), _model_lens(model, words[4:], words[2], words[3], where)


def _model_lens(model: _Model, parameters: Sequence[Any], width: Any, height: Any, where: str) -> _Lens:
    p = _floats(parameters, (model.parameters,), f"{where}: the parameters of {model.name}")
    fx, fy, (cx, cy) = p[0], p[model.focals - 1], p[model.focals : model.focals + 2]
    distorted = model.fisheye or bool((abs(p[model.focals + 2 :]) > DISTORTION_TOLERANCE).any())
    return _lens((fx, fy, cx, cy), width, height, distorted, where)


def _binary_poses(path: Path) -> Iterator[tuple[int, str, Sequence[Any], Sequence[Any]]]:
    with path.open("rb") as file:
        data = _BinaryFile(file, path)
        (count,) = data.values("Q")
        for _ in range(count):
            _, *pose, camera_id = data.values("I7dI")
            name = data.text()
            (n_points,) = data.values("Q")
            data.skip(24 * n_points)
            yield camera_id, name, pose[:4], pose[4:]


def _text_poses(path: Path) -> Iterator[tuple[int, str, Sequence[Any], Sequence[Any]]]:
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            words = line.split(maxsplit=9)
            if not words or words[0].startswith("#"):
                continue
            if len(words) < 10:
                raise InputError(f"'{path}', line '{line.strip()[:60]}': an image needs ten entries; is it damaged?")
            yield _integer(words[8], f"'{path}', image '{words[9].strip()}'"), words[9].strip(), words[1:5], words[5:8]
            next(file, "")  # the image's 2D points, a line of its own that may be empty


# JSON -------------------------------------------------------------------------------------------------------------


def _load_json(path: Path) -> Any:
    if path.stat().st_size > _MAX_JSON_BYTES:
        raise InputError(f"'{path}' has more than {_MAX_JSON_BYTES >> 20} MB, too much for a camera file.")
    try:
        return json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise InputError(f"'{path}' is not valid JSON; export the cameras again.") from error


def _json_frames(document: Any, path: Path) -> Iterator[_Frame]:
    entries = document.get("frames") if isinstance(document, dict) else document
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(f"'{path}' holds no cameras: neither a list of them nor a dict with a list of frames.")
    shared = {key: value for key, value in document.items() if key != "frames"} if isinstance(document, dict) else {}
    for i, entry in enumerate(entries):
        settings, where = {**shared, **entry}, f"'{path}', frame {i}"
        if "transform_matrix" in entry:
            if not {"w", "h"} <= settings.keys():  # Blender's files say no size; all their images have the first one's
                shared["w"], shared["h"] = settings["w"], settings["h"] = _image_size(path, settings, where)
            yield _transforms_frame(settings, where)
        elif "world_to_camera" in entry:
            yield _matrix_frame(settings, where)
        elif "position" in entry and "rotation" in entry:
            yield _inria_frame(settings, where)
        else:
            raise InputError(f"{where} has no pose: no transform_matrix, world_to_camera, or position and rotation.")


def _transforms_frame(settings: Mapping[str, Any], where: str) -> _Frame:
    """A frame of nerfstudio, Instant-NGP or Blender; focal lengths in pixels go before fields of view in radians."""
    width, height = _size(settings["w"], settings["h"], where)
    model = str(settings.get("camera_model", "PINHOLE"))
    if model.upper() in ("EQUIRECTANGULAR", "ORTHOPHOTO"):
        raise InputError(f"{where}: cameras of model {model} are not supported; give perspective images.")
    fx = _focal_length(settings, "x", width, where)
    if fx is None:
        raise InputError(f"{where} has no focal length: neither fl_x nor camera_angle_x.")
    fy = _focal_length(settings, "y", height, where)
    centre = settings.get("cx", width / 2), settings.get("cy", height / 2)
    coefficients = _floats([settings.get(key, 0.0) for key in _DISTORTION_KEYS], (8,), f"{where}: the distortion")
    distorted = bool(settings.get("is_fisheye")) or "FISHEYE" in model.upper()
    distorted |= bool((abs(coefficients) > DISTORTION_TOLERANCE).any())

    pose = _rigid(settings["transform_matrix"], where)
    pose[:3, :3] *= _OPENGL_TO_OPENCV
    lens = _lens((fx, fx if fy is None else fy, *centre), width, height, distorted, where)
    name, training = settings.get("file_path", ""), settings.get("train_filenames")
    train = name in training if isinstance(training, list) else True
    return _Frame(str(name), _inverse(pose), lens, train)


def _focal_length(settings: Mapping[str, Any], axis: str, size: int, where: str) -> float | None:
    """Focal length in pixels along one image axis, or None where neither fl_ nor camera_angle_ is given."""
    if settings.get(f"fl_{axis}") is not None:
        return float(_floats(settings[f"fl_{axis}"], (), f"{where}: fl_{axis}"))
    if settings.get(f"camera_angle_{axis}") is None:
        return None
    angle = float(_floats(settings[f"camera_angle_{axis}"], (), f"{where}: camera_angle_{axis}"))
    if not 0 < angle < math.pi:
        raise InputError(f"{where}: camera_angle_{axis} is {angle}; an angle between 0 and pi radians is needed.")
    return size / (2 * math.tan(angle / 2))


def _image_size(path: Path, settings: Mapping[str, Any], where: str) -> tuple[int, int]:
    """Width and height of a frame's image beside the file; Blender's paths have no suffix."""
    relative = PurePosixPath(str(settings.get("file_path", "")).replace("\\", "/"))
    for image in (path.parent / relative, path.parent / f"{relative}.png", path.parent / f"{relative}.jpg"):
        with suppress(OSError):  # of a path that the file system refuses
            if image.is_file() and (pixels := cv2.imread(str(image), cv2.IMREAD_UNCHANGED)) is not None:
                return pixels.shape[1], pixels.shape[0]
    raise InputError(f"{where}: the image size is neither given as w and h nor found from an image '{relative}'.")


def _inria_frame(settings: Mapping[str, Any], where: str) -> _Frame:
    """An entry of the cameras.json that 3D Gaussian Splatting writes beside its model; principal point central."""
    missing = [key for key in ("width", "height", "fx", "fy") if key not in settings]
    if missing:
        raise InputError(f"{where} has no {' and no '.join(missing)}.")
    rotation = _floats(settings["rotation"], (3, 3), f"{where}: the rotation")
    pose = np.column_stack([rotation, _floats(settings["position"], (3,), f"{where}: the position")])
    width, height = _size(settings["width"], settings["height"], where)
    lens = _lens((settings["fx"], settings["fy"], width / 2, height / 2), width, height, False, where)
    return _Frame(str(settings.get("img_name", "")), _inverse(_rigid(pose, where)), lens)


def _matrix_frame(settings: Mapping[str, Any], where: str) -> _Frame:
    """A frame of OpenCV matrices; its split, if any, is train or another word."""
    missing = [key for key in ("K", "width", "height") if key not in settings]
    if missing:
        raise InputError(f"{where} has no {' and no '.join(missing)}.")
    K = _floats(settings["K"], (3, 3), f"{where}: K")
    if K[0, 1] != 0 or K[1, 0] != 0 or (K[2] != [0, 0, 1]).any():
        raise InputError(f"{where}: K is not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]].")
    lens = _lens((K[0, 0], K[1, 1], K[0, 2], K[1, 2]), settings["width"], settings["height"], False, where)
    name = settings.get("file", settings.get("file_path", ""))
    return _Frame(
        str(name), _rigid(settings["world_to_camera"], where), lens, settings.get("split", "train") == "train"
    )


# Checks -----------------------------------------------------------------------------------------------------------


def _floats(values: Any, shape: tuple[int, ...], what: str) -> Float64Array:
    """Finite numbers of a given shape."""
    try:
        array = np.array(values, np.float64)
    except (ValueError, TypeError, OverflowError):
        array = np.array([[[np.nan]]])
    if array.shape != shape or not np.isfinite(array).all():
        count = " x ".join(map(str, shape)) or "one"
        raise InputError(f"{what} must be {count} finite number{'s' if shape else ''}.")
    return array


def _integer(text: str, where: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InputError(f"{where}: '{text[:20]}' is no whole number; is the file damaged?") from None


def _size(width: Any, height: Any, where: str) -> tuple[int, int]:
    size = _floats([width, height], (2,), f"{where}: the image size")
    if (size < 1).any() or (size > _MAX_IMAGE_SIDE).any() or (size % 1 != 0).any():
        raise InputError(f"{where}: an image of {width} x {height} pixels is not possible.")
    return int(size[0]), int(size[1])


def _lens(pinhole: Sequence[Any], width: Any, height: Any, distorted: bool, where: str) -> _Lens:
    """Intrinsics from fx, fy, cx, cy and the image size."""
    fx, fy, cx, cy = _floats(pinhole, (4,), f"{where}: focal lengths and principal point")
    if fx <= 0 or fy <= 0:
        raise InputError(f"{where}: the focal lengths {fx} and {fy} must be positive.")
    return _Lens(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), *_size(width, height, where), distorted)


def _rigid(matrix: Any, where: str) -> Float64Array:
    """A rigid transform (4, 4) from three or four rows, its rotation rounded to the nearest orthonormal matrix."""
    rows = len(matrix) if isinstance(matrix, (list, np.ndarray)) else 4
    given = _floats(matrix, (3 if rows == 3 else 4, 4), f"{where}: the pose")
    left, stretch, right = np.linalg.svd(given[:3, :3])
    rotation = left @ right
    if abs(stretch - 1).max() > _RIGID_TOLERANCE or np.linalg.det(rotation) < 0:
        raise InputError(f"{where}: the pose is scaled, sheared or mirrored; a rotation and a translation are needed.")
    if rows != 3 and abs(given[3] - [0, 0, 0, 1]).max() > 1e-6:
        raise InputError(f"{where}: the last row of the pose must be 0 0 0 1.")
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, given[:3, 3]
    return transform


def _inverse(transform: Float64Array) -> Float64Array:
    """Inverse of a rigid transform (4, 4)."""
    inverse = np.eye(4)
    inverse[:3, :3] = transform[:3, :3].T
    inverse[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return inverse


def _unit_vector(values: Any, what: str) -> Float64Array:
    vector = _floats(values, (3,), what)
    if np.linalg.norm(vector) < 1e-9:
        raise InputError(f"{what} has length zero.")
    return np.asarray(vector / np.linalg.norm(vector))

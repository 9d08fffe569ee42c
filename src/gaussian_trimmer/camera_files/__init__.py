"""Camera files: COLMAP models, transforms.json, Inria's cameras.json and lists of OpenCV matrices.

| what | where | pose |
|---|---|---|
| COLMAP model, binary or text | a folder, or sparse/0 or sparse below it | world to camera, OpenCV axes |
| transforms.json of nerfstudio, Instant-NGP, Blender | frames with `transform_matrix` | camera to world, OpenGL axes |
| Inria's cameras.json | a list with `position` and `rotation` | camera to world, OpenCV axes |
| OpenCV matrices | frames with `world_to_camera` and `K` | world to camera, OpenCV axes |

Poses are given in the frame that the file uses. The `applied_transform` of a transforms.json is already contained in
its matrices and is not undone. Trainers that recentre and rescale the poses once more (nerfstudio's dataparser does)
leave a splat that no longer fits them: `read_cameras_of` brings cameras to a scene in the folder of such a training.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from gaussian_trimmer.camera_files.colmap import read_colmap_frames
from gaussian_trimmer.camera_files.frames import DISTORTION_TOLERANCE
from gaussian_trimmer.camera_files.json_files import read_json_frames
from gaussian_trimmer.camera_files.nerfstudio_world import dataparser_file, in_training_world
from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.reading import is_file, is_folder, reading

__all__ = ["DISTORTION_TOLERANCE", "read_camera_set", "read_cameras_of"]


def read_cameras_of(
    scene: Path, path: str | Path, *, trust_paths: bool = False, say: Callable[[str], None] = lambda note: None
) -> CameraSet:
    """Return the cameras that a scene was trained with, in its coordinates; otherwise as `read_camera_set`.

    Args:
        scene: file or folder of the scene. In the folder of a nerfstudio training, the cameras of the dataset are
            brought to the coordinates of the training.
        path: file or folder of the cameras.
        trust_paths: as for `read_camera_set`.
        say: called with what was done to the cameras, if anything.

    Raises:
        InputError: as for `read_camera_set`, or what the training says of its coordinates is damaged.
    """
    found = read_camera_set(path, trust_paths=trust_paths)
    dataparser = dataparser_file(scene)
    if dataparser is None:
        return found
    say(f"{path}: brought to the coordinates of the training by {dataparser}")
    return in_training_world(found, dataparser, Path(path))


def read_camera_set(path: str | Path, *, trust_paths: bool = False) -> CameraSet:
    """Return cameras, split and up vector of a COLMAP folder or of a JSON file; the kind is found by content.

    Arguments:
        trust_paths: open a picture that a transforms.json names outside its own folder, should its size be needed.

    Raises:
        InputError: nothing readable is there, two kinds are, the file is damaged or changes meanwhile, or a camera is
            not possible.
    """
    found, up = _camera_file(Path(path)), None
    with reading(found):
        if found.suffix.lower() == ".json":
            frames, up = read_json_frames(found, trust_paths=trust_paths)
        else:
            with reading(found.with_stem("cameras")):
                frames = read_colmap_frames(found)
    if not frames:
        raise InputError(f"'{found}' holds no posed images; give the cameras of a finished reconstruction.")
    cameras = tuple(
        Camera(frame.world_to_camera, frame.intrinsics.K, frame.intrinsics.width, frame.intrinsics.height, name)
        for frame, name in zip(frames, _image_names([frame.path for frame in frames]), strict=True)
    )
    train, distorted = tuple(frame.train for frame in frames), any(frame.intrinsics.distorted for frame in frames)
    return CameraSet(cameras, up, train, distorted)


def _camera_file(path: Path) -> Path:
    """Return the JSON file, or the COLMAP images file, that a path stands for."""
    if is_file(path):
        if path.suffix.lower() == ".json":
            return path
        if path.stem in ("cameras", "images") and path.suffix in (".bin", ".txt"):
            return _camera_file(path.parent)
        raise InputError(f"'{path}' is not a camera file; give a COLMAP folder, a transforms.json or a cameras.json.")
    if not is_folder(path):
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
        names = ", ".join(str(candidate.relative_to(path)) for candidate in candidates)
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
    """Return file names of images; where two would be equal, paths without steps that lead out of a folder."""
    parts = [[part for part in path.replace("\\", "/").split("/") if part not in ("", ".", "..")] for path in paths]
    last = [part[-1] if part else "" for part in parts]
    repeated = {name for name, count in Counter(last).items() if count > 1}
    return ["/".join(part) if name in repeated else name for part, name in zip(parts, last, strict=True)]

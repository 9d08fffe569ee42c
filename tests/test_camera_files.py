"""Cameras written in every format that is read, from one set of random cameras."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import gaussian_trimmer as gt
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, CameraSet, as_camera_set, intrinsics, look_at
from gaussian_trimmer.errors import InputError

OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def random_cameras(n: int = 4, *, centred: bool = True) -> list[Camera]:
    rng = np.random.default_rng(7)
    cameras = []
    for i in range(n):
        transform = np.eye(4)
        transform[:3, :3] = cv2.Rodrigues(rng.uniform(-1.5, 1.5, size=3))[0]
        transform[:3, 3] = rng.normal(size=3)
        width, height = 640 + 2 * i, 480
        cx, cy = (width / 2, height / 2) if centred else (width / 2 + 3.25, height / 2 - 1.5)
        K = np.array([[500.0 + i, 0, cx], [0, 510.0 + i, cy], [0, 0, 1]])
        cameras.append(Camera(transform, K, width, height, f"view {i}.png"))
    return cameras


def quaternion(camera: Camera) -> list[float]:
    r = camera.rotation
    w = np.sqrt(1 + np.trace(r)) / 2  # far from zero: the random rotations are by less than 150 degrees
    return [w, (r[2, 1] - r[1, 2]) / (4 * w), (r[0, 2] - r[2, 0]) / (4 * w), (r[1, 0] - r[0, 1]) / (4 * w)]


def write_colmap_binary(cameras: list[Camera], folder: Path, model: int = 1, tail: tuple[float, ...] = ()) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    lenses, poses = struct.pack("<Q", len(cameras)), struct.pack("<Q", len(cameras))
    for i, c in enumerate(cameras):
        focals = (c.K[0, 0],) if model in (0, 2, 3, 8, 9) else (c.K[0, 0], c.K[1, 1])
        parameters = (*focals, c.K[0, 2], c.K[1, 2], *tail)
        lenses += struct.pack(f"<IiQQ{len(parameters)}d", i + 10, model, c.width, c.height, *parameters)
        poses += struct.pack("<I7dI", i + 1, *quaternion(c), *c.world_to_camera[:3, 3], i + 10)
        poses += c.name.encode() + b"\0" + struct.pack("<Q", i) + bytes(24 * i)
    (folder / "cameras.bin").write_bytes(lenses)
    (folder / "images.bin").write_bytes(poses)
    return folder


def write_colmap_text(cameras: list[Camera], folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    lenses, poses = "# Camera list\n", "# Image list\n# with two lines of data per image\n"
    for i, c in enumerate(cameras):
        parameters = (c.K[0, 0], c.K[1, 1], c.K[0, 2], c.K[1, 2])
        lenses += f"{i} PINHOLE {c.width} {c.height} {' '.join(repr(float(p)) for p in parameters)}\n"
        pose = [float(p) for p in (*quaternion(c), *c.world_to_camera[:3, 3])]
        # Image 0 has no 2D points: its second line is empty.
        poses += f"{i + 1} {' '.join(map(repr, pose))} {i} {c.name}\n{'1.5 2.5 -1 ' * i}\n"
    (folder / "cameras.txt").write_text(lenses)
    (folder / "images.txt").write_text(poses)
    return folder


def write_json(document: Any, path: Path) -> Path:
    path.write_text(json.dumps(document))
    return path


def transforms_frame(camera: Camera) -> dict[str, Any]:
    pose = np.linalg.inv(camera.world_to_camera) @ OPENGL
    return {"file_path": f"./images/{camera.name}", "transform_matrix": pose.tolist()} | {
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.K[0, 0],
        "fl_y": camera.K[1, 1],
        "cx": camera.K[0, 2],
        "cy": camera.K[1, 2],
    }


def write_transforms(cameras: list[Camera], folder: Path) -> Path:
    return write_json({"frames": [transforms_frame(c) for c in cameras]}, folder / "transforms.json")


def write_inria(cameras: list[Camera], folder: Path) -> Path:
    entries = [
        {
            "id": i,
            "img_name": c.name,
            "width": c.width,
            "height": c.height,
            "position": c.centre.tolist(),
            "rotation": c.rotation.T.tolist(),
            "fy": c.K[1, 1],
            "fx": c.K[0, 0],
        }
        for i, c in enumerate(cameras)
    ]
    return write_json(entries, folder / "cameras.json")


def matrix_frame(camera: Camera) -> dict[str, Any]:
    return {
        "file": camera.name,
        "width": camera.width,
        "height": camera.height,
        "K": camera.K.tolist(),
        "world_to_camera": camera.world_to_camera.tolist(),
    }


def write_matrices(cameras: list[Camera], folder: Path) -> Path:
    return write_json({"frames": [matrix_frame(c) for c in cameras]}, folder / "cameras.json")


WRITERS = {
    "colmap binary": write_colmap_binary,
    "colmap text": write_colmap_text,
    "colmap in sparse/0": lambda cameras, folder: write_colmap_binary(cameras, folder / "sparse" / "0").parents[1],
    "colmap in sparse": lambda cameras, folder: write_colmap_text(cameras, folder / "sparse").parent,
    "transforms": write_transforms,
    "inria": write_inria,
    "matrices": write_matrices,
    "folder of transforms": lambda cameras, folder: write_transforms(cameras, folder).parent,
    "a file of the model": lambda cameras, folder: write_colmap_binary(cameras, folder) / "cameras.bin",
}


def assert_same(found: CameraSet, cameras: list[Camera]) -> None:
    points = np.random.default_rng(0).normal(size=(50, 3))
    assert len(found.cameras) == len(cameras)
    for camera, expected in zip(found.cameras, cameras, strict=True):
        assert (camera.name, camera.width, camera.height) == (expected.name, expected.width, expected.height)
        np.testing.assert_allclose(camera.world_to_camera, expected.world_to_camera, atol=1e-12)
        np.testing.assert_allclose(camera.K, expected.K, rtol=1e-12)
        front = expected.project(points)[1] > 0.1
        np.testing.assert_allclose(camera.project(points)[0][front], expected.project(points)[0][front], atol=1e-6)


@pytest.mark.parametrize("kind", WRITERS)
def test_every_format_gives_the_same_cameras(kind: str, tmp_path: Path) -> None:
    cameras = random_cameras(centred=kind == "inria")  # that file says no principal point
    found = read_camera_set(WRITERS[kind](cameras, tmp_path))
    assert_same(found, cameras)
    assert found.up is None and not found.distorted and found.train == (True,) * 4
    assert found.pinhole_cameras() == found.cameras


def test_opengl_camera_looks_along_minus_z(tmp_path: Path) -> None:
    frame = {"file_path": "a.png", "transform_matrix": np.eye(4).tolist(), "w": 100, "h": 80, "fl_x": 50}
    (camera,) = read_camera_set(write_json({"frames": [frame]}, tmp_path / "transforms.json")).cameras
    pixels, depths = camera.project(np.array([[0.0, 0.0, -2.0], [1.0, 1.0, -2.0]]))
    np.testing.assert_allclose(depths, [2, 2])
    np.testing.assert_allclose(pixels, [[50, 40], [75, 15]])  # +x is right, +y up in the image


def test_splits_and_up(tmp_path: Path) -> None:
    cameras = random_cameras(2)
    frames = [matrix_frame(c) | {"split": s} for c, s in zip(cameras, ("train", "test"), strict=True)]
    found = read_camera_set(write_json({"up": [0, 0, 2], "frames": frames}, tmp_path / "c.json"))
    assert found.train == (True, False)
    assert found.up is not None and found.up.tolist() == [0, 0, 1]
    frames = [transforms_frame(c) for c in cameras]
    document = {"train_filenames": [frames[1]["file_path"]], "frames": frames}
    assert read_camera_set(write_json(document, tmp_path / "t.json")).train == (False, True)


def test_blender_file_without_sizes_takes_them_from_the_first_image(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "r_0.png"), np.zeros((60, 80, 3), np.uint8))
    frames = [{"file_path": f"./r_{i}", "transform_matrix": np.eye(4).tolist()} for i in range(2)]
    document = {"camera_angle_x": np.pi / 2, "frames": frames}
    cameras = read_camera_set(write_json(document, tmp_path / "transforms_train.json")).cameras
    assert [(c.width, c.height, c.name) for c in cameras] == [(80, 60, "r_0"), (80, 60, "r_1")]
    np.testing.assert_allclose(cameras[1].K, [[40, 0, 40], [0, 40, 30], [0, 0, 1]])


def test_focal_length_goes_before_angle_and_frame_before_file(tmp_path: Path) -> None:
    frames = [{"transform_matrix": np.eye(4).tolist()}, {"transform_matrix": np.eye(4).tolist(), "fl_x": 70.0}]
    document = {"camera_angle_x": 1.0, "camera_angle_y": np.pi / 2, "fl_x": 90.0, "w": 80, "h": 60, "frames": frames}
    cameras = read_camera_set(write_json(document, tmp_path / "transforms.json")).cameras
    assert [(c.K[0, 0], round(c.K[1, 1], 9)) for c in cameras] == [(90, 30), (70, 30)]


@pytest.mark.parametrize(
    ("model", "tail", "distorted"),
    [
        (0, (), False),
        (2, (0.0,), False),
        (2, (-0.05,), True),
        (4, (0.0,) * 4, False),
        (4, (0.0, 0.0, 0.0, 0.02), True),
        (5, (0.0,) * 4, True),  # a fisheye is not pinhole even without coefficients
        (6, (0.0,) * 8, False),
        (7, (0.9,), True),
        (8, (0.0,), True),
        (11, (0.0,) * 12, True),
    ],
)
def test_colmap_models(model: int, tail: tuple[float, ...], distorted: bool, tmp_path: Path) -> None:
    found = read_camera_set(write_colmap_binary(random_cameras(), tmp_path, model, tail))
    assert found.distorted is distorted and len(found.cameras) == 4
    assert found.cameras[1].K[0, 2] == 321
    if distorted:
        with pytest.raises(InputError, match="undistort"):
            found.pinhole_cameras()


def test_equal_file_names_keep_their_folders_but_do_not_lead_out(tmp_path: Path) -> None:
    frames = [matrix_frame(random_cameras(1)[0]) | {"file": f} for f in ("a/0.png", "../../b/0.png", "c\\1.png")]
    names = [c.name for c in read_camera_set(write_json({"frames": frames}, tmp_path / "c.json")).cameras]
    assert names == ["a/0.png", "b/0.png", "1.png"]


@pytest.mark.parametrize(
    ("name", "change"),
    [
        *(("images.bin", lambda data, keep=keep: data[:keep]) for keep in (0, 30, 75, 90, 300)),
        ("cameras.bin", lambda data: data[:40]),
        ("cameras.bin", lambda data: struct.pack("<Q", 1 << 60) + data[8:]),
        ("images.bin", lambda data: data[: 8 + 64 + 11] + struct.pack("<Q", 1 << 62) + data[8 + 64 + 19 :]),
    ],
)
def test_truncated_files_and_false_counts(name: str, change: Callable[[bytes], bytes], tmp_path: Path) -> None:
    path = write_colmap_binary(random_cameras(), tmp_path) / name
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(InputError, match="truncated"):
        read_camera_set(tmp_path)


def test_unknown_colmap_model(tmp_path: Path) -> None:
    write_colmap_binary(random_cameras(1), tmp_path, model=99)
    with pytest.raises(InputError, match="unknown camera model '99'"):
        read_camera_set(tmp_path)
    write_colmap_text(random_cameras(1), tmp_path / "text")
    lenses = tmp_path / "text" / "cameras.txt"
    lenses.write_text(lenses.read_text().replace("PINHOLE", "ORTHO"))
    with pytest.raises(InputError, match="unknown camera model"):
        read_camera_set(tmp_path / "text")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0 view 0.png", "77 view 0.png", "its camera 77 is not in"),
        ("0 view 0.png", "x view 0.png", "not a whole number"),
        (" view 0.png", "", "ten entries"),
        ("\n1 0.", "\n1 x0.", "finite"),
    ],
)
def test_damaged_colmap_text(old: str, new: str, message: str, tmp_path: Path) -> None:
    images = write_colmap_text(random_cameras(1), tmp_path) / "images.txt"
    assert old in images.read_text()
    images.write_text(images.read_text().replace(old, new))
    with pytest.raises(InputError, match=message):
        read_camera_set(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"world_to_camera": (2 * np.eye(4)).tolist()}, "scaled, sheared or mirrored"),
        ({"world_to_camera": np.diag([1.0, 1, -1, 1]).tolist()}, "scaled, sheared or mirrored"),
        ({"world_to_camera": [[float("nan")] * 4] * 4}, "4 x 4 finite numbers"),
        ({"world_to_camera": [[1, 2], [3]]}, "4 x 4 finite numbers"),
        ({"world_to_camera": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1]]}, "last row"),
        ({"K": [[500, 3, 0], [0, 500, 0], [0, 0, 1]]}, "K is not"),
        ({"K": [[-500, 0, 0], [0, 500, 0], [0, 0, 1]]}, "must be positive"),
        ({"K": [[10**400, 0, 0], [0, 500, 0], [0, 0, 1]]}, "finite"),
        ({"width": 0}, "0 x 480 pixels is not possible"),
        ({"width": 12.5}, "not possible"),
        ({"width": 60_000, "height": 60_000}, "not possible"),
        ({"K": [[1e12, 0, 12], [0, 1e12, 8], [0, 0, 1]]}, "not possible"),
        ({"K": [[1e-9, 0, 12], [0, 30, 8], [0, 0, 1]]}, "not possible"),
        ({"K": [[30, 0, 1e12], [0, 30, 8], [0, 0, 1]]}, "not possible"),
        ({"world_to_camera": [[1, 0, 0, 1e30], [0, 1, 0, 0], [0, 0, 1, 0]]}, r"up to 1e\+15"),
    ],
)
def test_impossible_cameras(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    frames = [matrix_frame(random_cameras(1)[0]), matrix_frame(random_cameras(1)[0]) | change]
    with pytest.raises(InputError, match=f"frame 1.*{message}"):
        read_camera_set(write_json({"frames": frames}, tmp_path / "c.json"))


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ({}, "neither a list"),
        ({"frames": []}, "no posed images"),
        ([], "no posed images"),
        ([{"id": 0}], "frame 0 has no pose"),
        ([{"position": [0, 0, 0], "rotation": np.eye(3).tolist()}], "no width and no height and no fx"),
        ({"frames": [{"world_to_camera": np.eye(4).tolist()}]}, "has no K and no width"),
        ({"frames": [{"transform_matrix": np.eye(4).tolist()}]}, "image size"),
        ({"frames": [{"transform_matrix": np.eye(4).tolist()}], "w": 9, "h": 9}, "no focal length"),
        ({"frames": [{"transform_matrix": np.eye(4).tolist()}], "w": 9, "h": 9, "camera_angle_x": 4}, "between 0"),
        ({"up": [0, 0, 0], "frames": [matrix_frame(random_cameras(1)[0])]}, "not all zero"),
        ({"up": [0, 1], "frames": [matrix_frame(random_cameras(1)[0])]}, "three finite numbers"),
    ],
)
def test_wrong_documents(document: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        read_camera_set(write_json(document, tmp_path / "c.json"))


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe\x00", b"[" * 100_000])
def test_no_json(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "c.json").write_bytes(content)
    with pytest.raises(InputError, match="cannot be read as JSON"):
        read_camera_set(tmp_path / "c.json")


def test_nothing_there_and_too_much_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no file or folder"):
        read_camera_set(tmp_path / "missing")
    with pytest.raises(InputError, match="holds no cameras"):
        read_camera_set(tmp_path)
    (tmp_path / "scene.ply").write_text("ply")
    with pytest.raises(InputError, match="not a camera file"):
        read_camera_set(tmp_path / "scene.ply")
    (tmp_path / "cameras.bin").write_text("")
    with pytest.raises(InputError, match="holds no cameras"):
        read_camera_set(tmp_path / "cameras.bin")
    write_colmap_text(random_cameras(), tmp_path / "sparse")
    write_transforms(random_cameras(), tmp_path)
    with pytest.raises(InputError, match=r"several sets of cameras \(sparse/images.txt, transforms.json\)"):
        read_camera_set(tmp_path)


# --- from arrays

POSES = np.stack([look_at(np.array([x, -3.0, 1.0]), np.zeros(3), np.array([0, 0, 1.0])) for x in (0.0, 1.0)])
K = intrinsics(1.0, 64, 48)


class Tensor:
    """What PyTorch's tensors have."""

    def __init__(self, values):
        self.values = values

    def detach(self):
        return self

    def cpu(self):
        return np.asarray(self.values, np.float32)


@pytest.mark.parametrize("kind", [np.asarray, Tensor])
def test_arrays_and_tensors_become_cameras(kind):
    cameras = gt.cameras_from_arrays(kind(POSES), kind(K), kind([64, 48]), ["a.png", "b.png"])
    for camera, pose, name in zip(cameras.cameras, POSES, ("a.png", "b.png"), strict=True):
        np.testing.assert_allclose(camera.world_to_camera, pose, atol=1e-6)
        np.testing.assert_allclose(camera.K, K, rtol=1e-6)
        assert (camera.width, camera.height, camera.name) == (64, 48, name)
    each = gt.cameras_from_arrays(POSES[:, :3], np.stack([K, 2 * K]), [[64, 48], [128, 96]])
    assert [(camera.width, camera.name) for camera in each.cameras] == [(64, "0"), (128, "1")]


@pytest.mark.parametrize(
    "arrays",
    [(POSES[0], K, (64, 48)), (POSES, K[:2], (64, 48)), (POSES, K, (64,)), (2 * POSES, K, (64, 48)), (POSES, K, (0, 9)),
     ("poses", K, (64, 48)), (POSES[:0], K, (64, 48))],
)  # fmt: skip
def test_what_is_no_camera_is_refused(arrays):
    with pytest.raises(gt.InputError):
        gt.cameras_from_arrays(*arrays)


def test_a_list_of_cameras_is_a_set():
    cameras = gt.cameras_from_arrays(POSES, K, (64, 48))
    assert as_camera_set(list(cameras.cameras)).cameras == cameras.cameras
    assert as_camera_set(cameras) is cameras and as_camera_set(None) is None
    for wrong in ([], "cameras.json", [np.eye(4)]):
        with pytest.raises(gt.InputError, match="read_cameras"):
            as_camera_set(wrong)

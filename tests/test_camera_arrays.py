"""Cameras from arrays, and lists of cameras."""

import numpy as np
import pytest

import gaussian_trimmer as gt
from gaussian_trimmer.cameras import as_camera_set, intrinsics, look_at

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

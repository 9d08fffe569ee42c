"""What `info` says of files of every kind."""

from __future__ import annotations

import json

import numpy as np
import pytest
from selection_builders import checkpoint_state, classifier_state, identity_columns, make_scene, rows_mask, save_ply

from gaussian_trimmer.commands.info import describe_file
from gaussian_trimmer.errors import InputError

N = 12


def test_splats(tmp_path):
    extras = identity_columns([0, 1] * 6) | {"mask": np.ones(N, np.float32)}
    text = describe_file(save_ply(tmp_path / "scene.ply", make_scene(N, coefficients=8, extras=extras)))
    assert "12 Gaussians, SH degree 2" in text
    assert "extra columns: obj_dc_0 to obj_dc_15, mask" in text
    assert "--set selection.classifier=VALUE and --set selection.object-id" in text
    assert "property mask: selects" in text


def test_splats_have_bounds_and_opacities(tmp_path):
    scene = make_scene(N).replace(
        means=np.repeat(np.float32([[1, 2, 3]]), N, axis=0), opacity_logits=np.full(N, -10, np.float32)
    )
    text = describe_file(save_ply(tmp_path / "scene.ply", scene))
    assert "x 1 to 1, y 2 to 2, z 3 to 3" in text
    assert "100 % below 0.05, 0 % above 0.95" in text
    assert "extra columns" not in text


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (rows_mask(N, 2, 3), ["bool (12,), 2 true", "selects from a scene of 12 Gaussians"]),
        (np.array([0, 0, 3, 5, 3]), ["0 to 5: 0 (2), 3 (2), 5 (1)", "5 Gaussians, with --set selection.object-id"]),
        (np.array([7, 4, 9]), ["int64 (3,), 4 to 9\n", "listed rows of a scene with more Gaussians"]),
        (np.linspace(0, 1, 5), ["float64 (5,), 0 to 1"]),
        (np.zeros((3, 4), int), ["holds no selection of a known kind"]),
        (np.zeros(0, bool), ["empty"]),
    ],
)
def test_arrays(tmp_path, values, expected):
    np.save(tmp_path / "a.npy", values)
    text = describe_file(tmp_path / "a.npy")
    for part in expected:
        assert part in text


def test_arrays_that_have_to_be_named(tmp_path):
    np.savez(tmp_path / "a.npz", exact=rows_mask(N, 2), wobbly=rows_mask(N, 3), other=np.zeros(3))
    text = describe_file(tmp_path / "a.npz")
    assert f"of {N} Gaussians by one of these arrays, with --set selection.property=NAME" in text


def test_clusters(tmp_path):
    np.savez(tmp_path / "cluster_lang.npz", leaf_feat=np.zeros((2, 512)), leaf_ind=np.array([0, 1, 1]))
    text = describe_file(tmp_path / "cluster_lang.npz")
    assert "0 (1), 1 (2)" in text
    assert "selects from a scene of 3 Gaussians, with --set selection.object-id" in text


@pytest.mark.needs("torch")
@pytest.mark.smoke
def test_torch_files(tmp_path):
    import torch

    scene = make_scene(N)
    torch.save(classifier_state(8), tmp_path / "classifier.pth")
    torch.save((checkpoint_state(scene, torch.zeros(N)), 30_000), tmp_path / "cob.pth")
    torch.save((checkpoint_state(scene, torch.zeros(N, 1, 16)), 30_000), tmp_path / "grouping.pth")
    torch.save(checkpoint_state(scene), tmp_path / "plain.pth")
    torch.save(torch.ones(3, N), tmp_path / "view_num_010_objnum_002.pth")
    assert "classifier of 8 ids from 16 identity features" in describe_file(tmp_path / "classifier.pth")
    text = describe_file(tmp_path / "cob.pth")
    assert "iteration 30000, which can be the scene\n  splats: 12 Gaussians, SH degree 3" in text
    assert "selects the Gaussians with COB-GS's foreground probability" in text
    assert "--set selection.query-row" in describe_file(tmp_path / "grouping.pth")
    assert "holds no selection" in describe_file(tmp_path / "plain.pth")
    assert "scene of 12 Gaussians by FlashSplat" in describe_file(tmp_path / "view_num_010_objnum_002.pth")


def test_cameras(tmp_path):
    frame = {"K": [[50, 0, 32], [0, 50, 24], [0, 0, 1]], "width": 64, "height": 48, "file": "a.png", "split": "test"}
    frames = [{**frame, "world_to_camera": np.eye(4).tolist()}]
    (tmp_path / "cameras.json").write_text(json.dumps({"frames": frames, "up": [0, 0, 2]}))
    for path in (tmp_path / "cameras.json", tmp_path):
        text = describe_file(path)
        assert "1 views (0 for training)" in text
        assert "64 x 48" in text
        assert "up: 0, 0, 1" in text


def test_unknown_files(tmp_path):
    with pytest.raises(InputError, match="There is no file or folder"):
        describe_file(tmp_path / "absent.ply")
    (tmp_path / "picture.png").write_bytes(b"")
    with pytest.raises(InputError, match="of an unknown kind"):
        describe_file(tmp_path / "picture.png")

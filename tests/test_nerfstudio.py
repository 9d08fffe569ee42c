"""Trainings of nerfstudio: the Gaussians of checkpoints, and cameras in the coordinates of the training."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run
from format_samples import sample
from fuzz.torch_archives import torch_file

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set, read_cameras_of
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Gaussians

START = "_model.gauss_params."


def checkpoint(gaussians: Gaussians, start: str = START, **changes: Any) -> bytes:
    """A checkpoint as nerfstudio's trainer writes it; entries may be changed, or left out by None."""
    state = {
        "means": gaussians.means, "scales": gaussians.log_scales, "quats": gaussians.quaternions,
        "features_dc": gaussians.sh_dc, "features_rest": gaussians.sh_rest.transpose(0, 2, 1),
        "opacities": gaussians.opacity_logits[:, None],
    } | changes  # fmt: skip
    named = {start + name: values for name, values in state.items() if values is not None}
    return torch_file(
        {"step": 29999, "pipeline": {"_model.lpips.0.weight": np.ones((2, 2), np.float32), **named}, "schedulers": {}}
    )


def training(folder: Path, gaussians: Gaussians) -> Path:
    (folder / "nerfstudio_models").mkdir(parents=True)
    for step, some in ((2000, gaussians.select(np.arange(3))), (29999, gaussians)):
        (folder / "nerfstudio_models" / f"step-{step:09d}.ckpt").write_bytes(checkpoint(some))
    return folder


@pytest.mark.parametrize("start", [START, "_model."])
def test_a_checkpoint_is_read(tmp_path: Path, start: str) -> None:
    gaussians = sample(20, 2)
    (tmp_path / "step-000000100.ckpt").write_bytes(checkpoint(gaussians, start))
    found = formats.read(tmp_path / "step-000000100.ckpt")
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
        np.testing.assert_array_equal(getattr(found, name), getattr(gaussians, name))


def test_without_harmonics_colours_are_logits(tmp_path: Path) -> None:
    gaussians = sample(20, 0)
    (tmp_path / "a.ckpt").write_bytes(checkpoint(gaussians, features_rest=np.zeros((20, 0, 3), np.float32)))
    colours = 0.5 + 0.2820948 * formats.read(tmp_path / "a.ckpt").sh_dc
    np.testing.assert_allclose(colours, 1 / (1 + np.exp(-gaussians.sh_dc)), atol=1e-5)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scales": None}, "0 of its models"),
        ({"scales": np.zeros((20, 1), np.float32)}, "log_scales has shape"),
        ({"opacities": np.zeros((7, 1), np.float32)}, "cannot reshape"),
        ({"features_rest": np.zeros((20, 7, 3), np.float32)}, "sh_rest has shape"),
        ({"means": np.full((20, 3), np.nan, np.float32)}, "means that cannot be used"),
    ],
)
def test_other_checkpoints_are_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    (tmp_path / "a.ckpt").write_bytes(checkpoint(sample(20, 1), **changes))
    with pytest.raises(InputError, match=message):
        formats.read(tmp_path / "a.ckpt")


def test_a_folder_means_its_latest_checkpoint_unless_it_holds_an_export(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = training(tmp_path / "run", sample(20, 1))
    assert len(formats.read(folder)) == len(formats.read(folder / "nerfstudio_models")) == 20
    assert run("convert", folder, tmp_path / "a.ply") == 0
    assert "step-000029999.ckpt" in capsys.readouterr().out
    formats.write(sample(4, 1), folder / "splat.ply")
    assert len(formats.read(folder)) == 4


def test_checkpoints_are_not_written(tmp_path: Path) -> None:
    assert formats.written_suffix("step-000029999.ckpt") == ".ply"
    with pytest.raises(InputError, match=r"cannot be written: give it one of the endings \.ply"):
        formats.write(sample(3, 0), tmp_path / "a.ckpt")


@pytest.mark.parametrize("applied", [None, [[1, 0, 0, 0.5], [0, 0, 1, 0], [0, -1, 0, 2]]])
def test_cameras_follow_the_scene_into_the_coordinates_of_the_training(
    tmp_path: Path, applied: list[list[float]] | None
) -> None:
    """A point that the training moved is where it was in every picture."""
    angle, scale = 0.3, 0.25
    turn = np.array([[np.cos(angle), -np.sin(angle), 0, 1], [np.sin(angle), np.cos(angle), 0, 2], [0, 0, 1, 3]])
    frame = {"file_path": "a.png", "transform_matrix": [[0, 0, 1, 4], [1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 0, 1]]}
    dataset = {"w": 64, "h": 48, "fl_x": 50, "frames": [frame], **({"applied_transform": applied} if applied else {})}
    (tmp_path / "transforms.json").write_text(json.dumps(dataset))
    folder = training(tmp_path / "run", sample(5, 0))
    (folder / "dataparser_transforms.json").write_text(json.dumps({"transform": turn.tolist(), "scale": scale}))
    said: list[str] = []
    (before,) = read_camera_set(tmp_path / "transforms.json").cameras
    (after,) = read_cameras_of(folder, tmp_path / "transforms.json", say=said.append).cameras
    (same,) = read_cameras_of(tmp_path, tmp_path / "transforms.json").cameras
    points = np.random.default_rng(0).normal(size=(9, 3))
    # What the dataset's points are in COLMAP's world, from where the training's transform goes.
    undone = points if applied is None else (points - np.array(applied)[:, 3]) @ np.array(applied)[:, :3]
    moved = scale * (undone @ turn[:, :3].T + turn[:, 3])
    np.testing.assert_allclose(after.project(moved)[0], before.project(points)[0], atol=1e-6)
    np.testing.assert_array_equal(same.world_to_camera, before.world_to_camera)
    assert "dataparser_transforms.json" in said[0]


@pytest.mark.parametrize("text", ["{", "[]", '{"transform": [[2,0,0,0],[0,2,0,0],[0,0,2,0]], "scale": 1}',
                                  '{"transform": [[1,0,0,0],[0,1,0,0],[0,0,1,0]], "scale": 0}'])  # fmt: skip
def test_damaged_transforms_are_refused(tmp_path: Path, text: str) -> None:
    frame = {"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}
    (tmp_path / "transforms.json").write_text(json.dumps({"w": 64, "h": 48, "fl_x": 50, "frames": [frame]}))
    (tmp_path / "dataparser_transforms.json").write_text(text)
    with pytest.raises(InputError, match="dataparser_transforms"):
        read_cameras_of(tmp_path, tmp_path / "transforms.json")

"""Small whole files of every kind that is read, and what reads them."""

from __future__ import annotations

import io
import json
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import test_camera_files
import test_nerfstudio
from format_samples import sample
from selection_builders import checkpoint_entries, save_ply
from test_streamed_sog import PLAYBOT, streamed

from gaussian_trimmer import formats
from gaussian_trimmer.app import edits
from gaussian_trimmer.app.session import Session, project_as_json, read_project, restore
from gaussian_trimmer.camera_files import read_camera_set, read_cameras_of
from gaussian_trimmer.cameras import Camera, Viewpoint, intrinsics
from gaussian_trimmer.commands.info import describe_file
from gaussian_trimmer.commands.manifest import Item, read_manifest
from gaussian_trimmer.errors import InputError, printable
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.masks.mask_files import mask_of
from gaussian_trimmer.selecting.marks import (
    Box3D,
    Click,
    FromFile,
    Grow,
    Marks,
    Sphere,
    marks_as_json,
    read_marks,
)
from gaussian_trimmer.selection_files import SelectionOptions, load_selection

from .torch_archives import storage, tensor, torch_file

N = 40
Files = dict[str, bytes]
"""Contents of the files of a folder, by their names; the first is the one to read."""


@dataclass(frozen=True)
class Reader:
    """A reader under test."""

    samples: list[Files]
    """Folders that it reads."""
    read: Callable[[Path], Any]
    """Reads the first file, and raises AssertionError if what it returns is not what it promises."""


def with_columns(gaussians: Gaussians) -> Gaussians:
    """Gaussians with a mask, a label and identity features."""
    rng, n = np.random.default_rng(0), len(gaussians)
    extras = {"mask": (rng.random(n) < 0.3).astype(np.float32), "label": rng.integers(0, 4, n).astype(np.int32)}
    features = {f"obj_dc_{i}": rng.normal(size=n).astype(np.float32) for i in range(16)}
    return gaussians.replace(extras={**extras, **features})


SCENE = with_columns(sample(N, 1))


def readers() -> dict[str, Reader]:
    """Every reader by name."""
    return {**_splat_readers(), **_selection_readers(), **_camera_readers(), **_other_readers()}


def check_message(error: InputError) -> None:
    """A message must be fit for a terminal."""
    assert str(error) == printable(str(error)) and 10 < len(str(error)) <= 1000, repr(str(error))


def _written(write: Callable[[Path], Any], name: str) -> Files:
    """What a function writes into a folder; the file of the name comes first."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / name)
        files = {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}
    return {name: files.pop(name), **files}


def _folder(folder: Path) -> Files:
    """The files of a folder, those of its own before those of folders in it."""
    files = sorted((path for path in folder.rglob("*") if path.is_file()), key=lambda path: len(path.parts))
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files if path.suffix != ".md"}


def _check_text(path: Path) -> None:
    try:
        text = describe_file(path)
    except InputError as error:
        check_message(error)
        return
    assert all(line == printable(line) for line in text.splitlines())
    assert len(text) < 20_000


def _splat_readers() -> dict[str, Reader]:
    samples = {
        suffix: [_written(lambda path: formats.write(SCENE, path), f"a{suffix}"),
                 _written(lambda path: formats.write(sample(9, 3), path), f"a{suffix}")] for suffix in formats.FORMATS
    }  # fmt: skip
    samples[".ply"] += [_written(lambda path: save_ply(path, SCENE), "a.ply"), {"a.ply": _ascii_ply()}]
    samples[".ckpt"] = [{"a.ckpt": test_nerfstudio.checkpoint(sample(9, degree))} for degree in (0, 2)]
    with zipfile.ZipFile(io.BytesIO(samples[".sog"][0]["a.sog"])) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    samples["unbundled sog"] = [{"meta.json": members.pop("meta.json"), **members}]
    samples["streamed sog"] = [_folder(PLAYBOT), _written(lambda path: streamed(path.parent), "lod-meta.json")]
    return {suffix.lstrip("."): Reader(files, _read_splats) for suffix, files in samples.items()}


def _ascii_ply() -> bytes:
    """With an element before the vertices."""
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", *(f"scale_{i}" for i in range(3))]
    names += [f"rot_{i}" for i in range(4)]
    header = "ply\nformat ascii 1.0\nelement camera 2\nproperty float f\nelement vertex 7\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n1.5\n2\n"
    rows = np.random.default_rng(1).uniform(-2, 2, (7, len(names)))
    return (header + "\n".join(" ".join(f"{value:.4f}" for value in row) for row in rows)).encode()


def _read_splats(path: Path) -> None:
    found = formats.read(path)
    assert len(found) > 0
    blank = found.blank  # rows that cannot be used, with opacities of exactly zero
    assert not blank.all()
    found = found.select(~blank)
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
        values = getattr(found, name)
        assert values.dtype == np.float32 and np.isfinite(values).all(), name
    assert np.isfinite(found.covariances()).all()
    _check_text(path)


def _selection_readers() -> dict[str, Reader]:
    rng = np.random.default_rng(5)
    mask, labels, rows = rng.random(N) < 0.4, rng.integers(0, 4, N), rng.permutation(N)[:12]
    arrays = [mask[:, None], labels.astype(">i4"), rows.astype(np.uint64), rng.random(N).astype(np.float16)]
    archives = [
        {"mask": mask, "labels": labels, "note": np.array("x")},
        {"leaf_feat": rng.random((4, 512)), "leaf_ind": labels},
    ]
    text = ["# rows\n" + ", ".join(map(str, rows)) + " # end\n3", json.dumps(rows.tolist())]
    weight, bias = rng.normal(size=(8, 16, 1, 1)).astype(np.float32), rng.normal(size=8).astype(np.float32)
    scene = _written(lambda path: save_ply(path, SCENE), "a.ply")
    cut = SCENE.select(np.array([3, 1, 20, 33, 8])).replace(extras={})
    moved = cut.replace(means=cut.means + np.float32(0.25), log_scales=cut.log_scales - np.float32(0.1))
    classifiers = [torch_file({"weight": weight, "bias": bias}), torch_file(weight[:, :, 0, 0])]
    return {
        "npy": Reader([_written(lambda path, a=array: np.save(path, a), "a.npy") for array in arrays], _read_selection),
        "npz": Reader(
            [_written(lambda path, a=found: np.savez_compressed(path, **a), "a.npz") for found in archives],
            _read_selection,
        ),
        "text": Reader([{"a.txt": text[0].encode()}, {"a.json": text[1].encode()}], _read_selection),
        "torch": Reader([{"a.pt": data} for data in _torch_samples(mask, labels)], _read_selection),
        "checkpoint": Reader([{"a.pth": data} for data in _checkpoints()], _read_selection),
        "subset": Reader(
            [scene, *(_written(lambda path, g=part: formats.write(g, path), "a.ply") for part in (cut, moved))],
            _read_selection,
        ),
        "classifier": Reader([{**scene, "classifier.pth": data} for data in classifiers], _read_classified),
    }


_OPTIONS = (
    SelectionOptions(object_id=(1,)),
    SelectionOptions(threshold=0.5),
    SelectionOptions(property="mask"),
    SelectionOptions(property="label", object_id=(2,)),
    SelectionOptions(query_row=5),
    SelectionOptions(kind="indices"),
    SelectionOptions(kind="mask", threshold=0.1),
    SelectionOptions(kind="flashsplat", gamma=-0.5),
    SelectionOptions(kind="labels", object_id=(2,)),
)


def _read_selection(path: Path) -> None:
    """The file with all choices of options; it succeeds if one does."""
    selections, refused = [], None
    for options in (SelectionOptions(), *_OPTIONS):
        try:
            selections.append(load_selection(path, SCENE, options))
        except InputError as error:
            check_message(error)
            refused = error
    _check_text(path)
    for selection in selections:
        assert selection.shape == (N,) and selection.dtype == np.bool_ and selection.any()
    if not selections and refused is not None:
        raise refused


def _read_classified(path: Path) -> None:
    classifier = path.parent / "classifier.pth"
    options = SelectionOptions(classifier=classifier, object_id=(1,), threshold=0.05)
    _check_text(classifier)
    assert load_selection(path, formats.read(path), options).any()


def _torch_samples(mask: np.ndarray, labels: np.ndarray) -> list[bytes]:
    """A mask, labels, weights of FlashSplat, a dict with a view, and numbers that NumPy has not."""
    half = storage("BFloat16Storage", "h", N)
    views = {"mask": tensor(storage("ByteStorage", "v", 2 * N), 0, (N,), (2,)), "name": "cup"}
    return [
        torch_file(mask[:, None]),
        torch_file({"labels": labels}),
        torch_file(np.random.default_rng(6).random((3, N)).astype(np.float32)),
        torch_file(views, storages={"v": bytes([1, 0] * N)}),
        torch_file(tensor(half, 0, (N,), (1,)), storages={"h": bytes([0, 63]) * N}),
    ]


def _checkpoints() -> list[bytes]:
    """With logits, and with features, which are selected by one of the options."""
    part, logits = SCENE.select(slice(0, 12)), np.linspace(-5, 5, 12).astype(np.float16)
    state = {"state": {0: {"exp_avg": part.means}}, "param_groups": [{"lr": 0.1, "params": [0]}]}
    *entries, _, extent = checkpoint_entries(part, logits)
    *others, _, _ = checkpoint_entries(part, logits.astype(np.float32))
    return [torch_file(((*entries, state, extent), 30_000)), torch_file((*others, state, extent))]


def _camera_readers() -> dict[str, Reader]:
    cameras = test_camera_files.random_cameras()
    writers = {
        "transforms.json": test_camera_files.write_transforms, "cameras.json": test_camera_files.write_inria,
        "images.bin": test_camera_files.write_colmap_binary, "images.txt": test_camera_files.write_colmap_text,
    }  # fmt: skip
    samples = {name: [_written(lambda path, w=write: w(cameras, path.parent), name)] for name, write in writers.items()}
    samples["cameras.json"].append(
        _written(lambda path: test_camera_files.write_matrices(cameras, path.parent), "cameras.json")
    )
    training = {"transform": np.eye(4)[:3].tolist(), "scale": 0.5}
    world = {"dataparser_transforms.json": json.dumps(training).encode(), **samples["transforms.json"][0]}
    return {
        **{name: Reader(files, _read_cameras) for name, files in samples.items()},
        "dataparser": Reader([world], _read_cameras_of_training),
    }


def _read_cameras(path: Path) -> None:
    found = read_camera_set(path)
    assert len(found.cameras) == len(found.train) > 0
    poses, lenses = (np.array([getattr(camera, name) for camera in found.cameras]) for name in ("world_to_camera", "K"))
    assert np.isfinite(np.linalg.inv(poses)).all() and np.isfinite(np.linalg.inv(lenses)).all()
    assert (abs(np.linalg.det(poses[:, :3, :3]) - 1) < 1e-6).all()
    assert found.up is None or abs(np.linalg.norm(found.up) - 1) < 1e-9
    _check_text(path)


def _read_cameras_of_training(path: Path) -> None:
    found = read_cameras_of(path.parent, path.parent / "transforms.json")
    assert all(np.isfinite(camera.world_to_camera).all() for camera in found.cameras)


_WIDTH, _HEIGHT = 24, 18


def _other_readers() -> dict[str, Reader]:
    """Masks, marks, projects and manifests."""
    picture = np.zeros((_HEIGHT, _WIDTH, 4), np.uint8)
    picture[4:12, 5:15] = 255
    masks = {".png": picture, ".jpg": picture[..., :3], ".tiff": picture[..., 0], ".webp": picture, ".bmp": picture}
    view = Viewpoint(Camera(np.eye(4), np.array([[50.0, 0, 32], [0, 50, 24], [0, 0, 1]]), 64, 48, "0.png"))
    listed = (
        Click(3, 4, view),
        Grow(2.0),
        Box3D((-9.0, -9.0, 0), (9.0, 9.0, 9.0), "up", "intersect"),
        FromFile(Path("a.npy")),
    )
    marks = marks_as_json(Marks(listed, (0.0, 0.0, 1.0), ((1.0, 2.0, 3.0),), N, Path("cameras.json")), Path())
    rows = "scene,selection,name,up,options\na.ply,b.npy,mug,0 0 1,--views 5\na.ply,c.npy,cup,,\n"
    return {
        "masks": Reader([{f"a{end}": cv2.imencode(end, mask)[1].tobytes()} for end, mask in masks.items()], _read_mask),
        "marks": Reader([{"a.json": json.dumps(marks).encode()}], read_marks),
        "project": Reader([{"a.project.json": _project()}], _read_project),
        "manifest.csv": Reader([{"a.csv": rows.encode()}], lambda path: read_manifest(path, Item)),
    }


@cache
def _session() -> Session:
    """A session of the app with the scene and an object marked in it."""
    session = Session()
    with tempfile.TemporaryDirectory() as folder:
        formats.write(SCENE, Path(folder) / "a.ply")
        session.open(Path(folder) / "a.ply")
    session.do(edits.mark, Sphere((0.0, 0.0, 0.0), 5.0), Box3D((1.0, -5.0, -5.0), (5.0, 5.0, 5.0), effect="remove"))
    session.do(edits.describe, 1, "name", "mug")
    session.do(edits.describe, 1, "colour", "#010203")
    return session


def _project() -> bytes:
    return project_as_json(_session().now, Path()).encode()


def _read_project(path: Path) -> None:
    change = restore(_session().now, read_project(path))
    assert all(part.mask.shape == (N,) for part in change.after.objects)


def _read_mask(path: Path) -> None:
    camera = Camera(np.eye(4), intrinsics(0.8, _WIDTH, _HEIGHT), _WIDTH, _HEIGHT, path.with_suffix(".JPG").name)
    mask = mask_of(camera, path)
    assert mask.shape == (_HEIGHT, _WIDTH) and mask.dtype == np.bool_

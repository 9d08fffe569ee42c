"""Small whole files of every kind that is read, and what reads them."""

from __future__ import annotations

import gzip
import io
import json
import random
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.batch.manifest import read_manifest
from gaussian_trimmer.camera_files import read_camera_set, read_cameras_of
from gaussian_trimmer.cameras import Camera, intrinsics
from gaussian_trimmer.commands.inspection import describe_file
from gaussian_trimmer.errors import InputError, printable
from gaussian_trimmer.formats import ply, spz
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.segmentation.segmenters.mask_files import cameras_with_masks, ids_of, mask_of
from gaussian_trimmer.selecting.marks import Box, Click, FromFile, Grow, Marks, Plane, Sphere, Viewpoint
from gaussian_trimmer.selecting.marks_file import marks_as_json, read_marks
from gaussian_trimmer.selection_files import SelectionOptions, load_selection

from .torch_archives import named, storage, tensor, torch_file

N = 40
Files = dict[str, bytes]
"""Contents of the files of a folder, by their names."""


@dataclass(frozen=True)
class Reader:
    """A reader under test."""

    samples: list[Files]
    """Folders that it reads; the first file of each is the one that it is given, the others belong to it."""
    read: Callable[[Path], Any]
    """Reads the first file, and raises AssertionError if what it returns is not what it promises."""
    files: tuple[str, ...] = ()
    """Names of the files that are changed; all of them if none is named."""


def gaussians(n: int = N, degree: int = 1, seed: int = 0) -> Gaussians:
    """Random Gaussians with a mask, a label and identity features."""
    rng = np.random.default_rng(seed)
    extras = {"mask": (rng.random(n) < 0.3).astype(np.float32), "label": rng.integers(0, 4, n).astype(np.int32)}
    extras |= {f"obj_dc_{i}": rng.normal(size=n).astype(np.float32) for i in range(16)}
    return Gaussians(
        means=rng.normal(0, 3, (n, 3)).astype(np.float32),
        log_scales=rng.uniform(-7, -1, (n, 3)).astype(np.float32),
        quaternions=rng.normal(0, 2, (n, 4)).astype(np.float32),
        opacity_logits=rng.uniform(-6, 6, n).astype(np.float32),
        sh_dc=rng.uniform(-1.5, 1.5, (n, 3)).astype(np.float32),
        sh_rest=rng.uniform(-0.9, 0.9, (n, 3, (degree + 1) ** 2 - 1)).astype(np.float32),
        extras=extras,
    )


SCENE = gaussians()


def readers() -> dict[str, Reader]:
    """Every reader by name."""
    return {**_splat_readers(), **_selection_readers(), **_camera_readers(), "masks": _mask_reader(), **_list_readers()}


# Splats ---------------------------------------------------------------------------------------------------------------


def written(suffix: str, scene: Gaussians, **options: Any) -> bytes:
    """What the project's own writer makes of a scene."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a{suffix}"
        if options:
            ply.write(scene, path, **options)
        else:
            formats.write(scene, path)
        return path.read_bytes()


def _splat_readers() -> dict[str, Reader]:
    contents = {
        ".ply": [written(".ply", SCENE, extras=True), written(".ply", gaussians(9, 3)), *_other_plys()],
        ".compressed.ply": [written(".compressed.ply", gaussians(n, d)) for n, d in ((N, 0), (300, 2), (9, 3))],
        ".splat": [written(".splat", SCENE), written(".splat", gaussians(3))],
        ".spz": [written(".spz", SCENE), written(".spz", gaussians(9, 3)), *_other_spz()],
        ".sog": [written(".sog", SCENE), written(".sog", gaussians(200, 0)), _sog_version_1()],
        ".glb": [written(".glb", SCENE), written(".glb", gaussians(9, 3)), _packed_glb()],
        ".ckpt": [_nerfstudio(SCENE), _nerfstudio(gaussians(9, 0))],
        ".ksplat": [written(".ksplat", SCENE), _ksplat(1, 1), _ksplat(2, 2), _ksplat(1, 0)],
    }
    readers = {
        suffix[1:]: Reader([{f"a{suffix}": data} for data in samples], _read_splats)
        for suffix, samples in contents.items()
    }
    return {**readers, "unbundled sog": Reader([_unbundled(SCENE), _unbundled(gaussians(200, 0))], _read_splats)}


def _unbundled(scene: Gaussians) -> Files:
    with zipfile.ZipFile(io.BytesIO(written(".sog", scene))) as archive:
        return {name: archive.read(name) for name in ("meta.json", *sorted({*archive.namelist()} - {"meta.json"}))}


def _packed_glb() -> bytes:
    """Gaussians that are packed as .spz."""
    data = written(".spz", gaussians(9, 2))
    packed = {"extensions": {"KHR_gaussian_splatting_compression_spz_2": {"bufferView": 0}}}
    document = {
        "meshes": [{"primitives": [{"extensions": {"KHR_gaussian_splatting": packed}}]}],
        "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
    }
    text = json.dumps(document).encode()
    header = struct.pack("<4sIII4s", b"glTF", 2, 28 + len(text) + len(data), len(text), b"JSON")
    return header + text + struct.pack("<I4s", len(data), b"BIN\0") + data


def _nerfstudio(scene: Gaussians) -> bytes:
    state = {
        "means": scene.means, "scales": scene.log_scales, "quats": scene.quaternions, "features_dc": scene.sh_dc,
        "features_rest": scene.sh_rest.transpose(0, 2, 1), "opacities": scene.opacity_logits[:, None],
    }  # fmt: skip
    return torch_file({"step": 9, "pipeline": {f"_model.gauss_params.{name}": part for name, part in state.items()}})


def _read_splats(path: Path) -> Gaussians:
    found = formats.read(path)
    _check_gaussians(found)
    _check_text(describe_file(path))
    return found


def _check_gaussians(found: Gaussians) -> None:
    assert len(found) > 0
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
        values = getattr(found, name)
        assert values.dtype == np.float32 and np.isfinite(values).all(), name
    assert np.isfinite(found.covariances()).all()
    assert np.isfinite(found.scales).all()


def _check_text(text: str) -> None:
    assert all(line == printable(line) for line in text.splitlines())
    assert len(text) < 20_000


def _columns(scene: Gaussians) -> dict[str, np.ndarray]:
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"]
    names += [f"rot_{i}" for i in range(4)]
    parts = [scene.means, scene.sh_dc, scene.opacity_logits[:, None], scene.log_scales, scene.quaternions]
    return dict(zip(names, np.concatenate(parts, axis=1).T, strict=True))


def _other_plys() -> list[bytes]:
    """An ascii file with an element before the vertices, and a big-endian one of several types."""
    columns = _columns(gaussians(7, 0))
    header = "element camera 2\nproperty float f\nelement vertex 7\n"
    header += "".join(f"property float {name}\n" for name in columns) + "end_header\n"
    rows = "\n".join(" ".join(f"{value:.4f}" for value in row) for row in np.array(list(columns.values())).T)
    kinds = {name: "double" if i % 3 else "float" for i, name in enumerate(columns)} | {"id": "uchar"}
    columns["id"] = np.arange(7)
    table = np.zeros(
        7, np.dtype([(name, {"double": ">f8", "float": ">f4"}.get(kind, "u1")) for name, kind in kinds.items()])
    )
    for name, values in columns.items():
        table[name] = values
    mixed = "ply\nformat binary_big_endian 1.0\ncomment mixed\nelement vertex 7\n"
    mixed += "".join(f"property {kind} {name}\n" for name, kind in kinds.items()) + "end_header\n"
    return [f"ply\nformat ascii 1.0\n{header}1.5\n2\n{rows}\n".encode(), mixed.encode() + table.tobytes()]


def _other_spz() -> list[bytes]:
    """Version 2, and version 4 where its compression is known."""
    n, rng = 9, np.random.default_rng(2)
    sizes = [9 * n, n, 3 * n, 3 * n, 3 * n, 9 * n]
    header = struct.pack("<4sIIBBBB", b"NGSP", 2, n, 1, 12, 0, 0)
    samples = [gzip.compress(header + rng.bytes(sum(sizes)), mtime=0)]
    try:
        zstd = spz._zstd()
    except InputError:
        return samples
    else:
        sizes[4] = 4 * n
        streams = [zstd.compress(rng.bytes(size)) for size in sizes]
        header = struct.pack("<4sIIBBBB", b"NGSP", 4, n, 1, 12, 0, 6) + struct.pack("<I", 32) + bytes(12)
        table = b"".join(struct.pack("<QQ", len(data), size) for data, size in zip(streams, sizes, strict=True))
        samples.append(header + table + b"".join(streams))
    return samples


def _sog_version_1() -> bytes:
    """The same textures with evenly spread values."""
    with zipfile.ZipFile(io.BytesIO(written(".sog", SCENE))) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    two = json.loads(members["meta.json"])
    one = {
        "means": {**two["means"], "shape": [N, 3]},
        "scales": {"mins": [-7, -7, -7], "maxs": [-1, -1, -1], "files": two["scales"]["files"]},
        "quats": two["quats"],
        "sh0": {"mins": [-1, -1, -1, -4], "maxs": [1, 1, 1, 4], "files": two["sh0"]["files"]},
        "shN": {"mins": -1, "maxs": 1, "files": two["shN"]["files"]},
    }
    return _zip_of({**members, "meta.json": json.dumps(one).encode()})


def _zip_of(members: dict[str, bytes]) -> bytes:
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w") as archive:
        for name, data in members.items():
            archive.writestr(zipfile.ZipInfo(name), data)
    return target.getvalue()


def _ksplat(level: int, degree: int) -> bytes:
    """Three sections of a packed level, the second of them empty, as viewers leave them."""
    rng, k = np.random.default_rng(3), (0, 3, 8)[degree]
    row = 6 + 14 + 4 + 3 * k * (2 if level == 1 else 1)
    header = struct.pack("<BBxxIIIIHxx3f2f", 0, 1, 3, 3, 14, 14, level, 0, 0, 0, -1.0, 1.0).ljust(4096, b"\0")
    data = b""
    for sizes in ((4, 4, 3, 1), (), (2,)):
        n, full = sum(sizes), sum(size == 4 for size in sizes)
        section = struct.pack("<IIIIfHxxI", n, n, 4, len(sizes), 5.0, 12, 32767)
        header += (section + struct.pack("<IIIH", 0, full, len(sizes) - full, degree)).ljust(1024, b"\0")
        data += np.array([size for size in sizes if size < 4], "<u4").tobytes()
        data += rng.normal(size=(len(sizes), 3)).astype("<f4").tobytes()
        for _ in range(n):
            halves = rng.uniform(0.1, 1, 7).astype("<f2").tobytes()
            data += (
                rng.bytes(6)
                + halves
                + rng.bytes(4)
                + (rng.uniform(-1, 1, 3 * k).astype("<f2").tobytes() if level == 1 else rng.bytes(3 * k))
            )
    assert len(data) == 14 * row + 4 * 3 + 12 * 5
    return header + data


# Selections -----------------------------------------------------------------------------------------------------------


def _selection_readers() -> dict[str, Reader]:
    rng = np.random.default_rng(5)
    mask, labels, rows = rng.random(N) < 0.4, rng.integers(0, 4, N), rng.permutation(N)[:12]
    arrays = [
        mask,
        mask[:, None],
        labels,
        labels.astype(">i4"),
        rows.astype(np.uint64),
        rng.random(N),
        mask.astype(np.float32),
    ]
    clusters = {"leaf_feat": rng.random((4, 512)).astype(np.float32), "leaf_ind": labels, "occu_count": rng.random(4)}
    archives = [{"mask": mask}, {"mask": mask, "labels": labels, "note": np.array("x")}, clusters]
    text = ["\n".join(map(str, rows)), "# rows\n" + ", ".join(map(str, rows)) + " # end\n3", "0 1 2 3"]
    return {
        "npy": Reader([{"a.npy": _npy(array)} for array in arrays], _read_selection),
        "npz": Reader([{"a.npz": _npz(found, pack)} for found in archives for pack in (False, True)], _read_selection),
        "txt": Reader([{f"a.{suffix}": part.encode()} for part in text for suffix in ("txt", "csv")], _read_selection),
        "torch": Reader([{"a.pt": data} for data in _torch_samples(mask, labels)], _read_selection),
        "checkpoint": Reader([{"a.pth": data} for data in _checkpoints()], _read_selection),
        "subset": Reader([{"a.ply": data} for data in _cut_outs()], _read_selection),
        "classifier": Reader(
            [{"a.ply": written(".ply", SCENE, extras=True), "classifier.pth": data} for data in _classifiers()],
            _read_classified,
        ),
    }  # fmt: skip


_OPTIONS = (
    SelectionOptions(),
    SelectionOptions(object_id=(1,)),
    SelectionOptions(threshold=0.5),
    SelectionOptions(property="mask"),
    SelectionOptions(property="label", object_id=(2,)),
    SelectionOptions(query_row=5),
    SelectionOptions(kind="indices"),
    SelectionOptions(kind="labels", object_id=(0, 3)),
    SelectionOptions(kind="mask", threshold=0.1),
    SelectionOptions(kind="flashsplat", gamma=-0.5),
    SelectionOptions(kind="clusters", object_id=(2,)),
)


def _read_selection(path: Path) -> Any:
    """The file with some choices of options, which the file itself settles; it succeeds if one does."""
    selections, refused = [], None
    chosen = random.Random(zlib.crc32(path.read_bytes())).sample(_OPTIONS[1:], 3)
    for options in (_OPTIONS[0], *chosen):
        try:
            selections.append(load_selection(path, SCENE, options))
        except InputError as error:
            check_message(error)
            refused = error
    _describe(path)
    for selection in selections:
        assert selection.shape == (N,) and selection.dtype == np.bool_ and selection.any()
    if not selections and refused is not None:
        raise refused
    return selections


def _describe(path: Path) -> None:
    try:
        _check_text(describe_file(path))
    except InputError as error:
        check_message(error)


def _read_classified(path: Path) -> Any:
    classifier = path.parent / "classifier.pth"
    options = SelectionOptions(classifier=classifier, object_id=(1,), threshold=0.05)
    _describe(classifier)
    selection = load_selection(path, formats.read(path), options)
    assert selection.any()
    return selection


def check_message(error: InputError) -> None:
    """A message must be fit for a terminal."""
    assert str(error) == printable(str(error)) and 10 < len(str(error)) <= 1000, repr(str(error))


def _npy(array: np.ndarray) -> bytes:
    target = io.BytesIO()
    np.save(target, array, allow_pickle=False)
    return target.getvalue()


def _npz(arrays: dict[str, np.ndarray], packed: bool) -> bytes:
    target = io.BytesIO()
    (np.savez_compressed if packed else np.savez)(target, **arrays)
    return target.getvalue()


def _torch_samples(mask: np.ndarray, labels: np.ndarray) -> list[bytes]:
    """Masks, labels, scores, weights of FlashSplat, dicts, tensors that are views, numbers that NumPy has not."""
    weights = np.random.default_rng(6).random((3, N)).astype(np.float32)
    half = storage("BFloat16Storage", "h", N)
    views = {"mask": tensor(storage("ByteStorage", "v", 2 * N), 1, (N,), (2,)), "x": mask}
    odd = {
        "c": tensor(storage("ComplexFloatStorage", "v", 9), 0, (3, 3), (3, 1)),
        "f8": named("torch", "float8_e4m3fn"),
    }
    odd["f8"] = type(half)(odd["f8"])
    return [
        torch_file(mask),
        torch_file(mask[:, None]),
        torch_file(labels),
        torch_file(weights),
        torch_file({"mask": mask, "name": "cup", "scores": weights[0].astype(np.float16)}),
        torch_file(tensor(half, 0, (N,), (1,)), storages={"h": bytes([0, 63]) * N}),
        torch_file(views, storages={"v": bytes([1, 0] * N)}),
        torch_file(odd, storages={"v": bytes(72)}),
    ]


def _checkpoints() -> list[bytes]:
    """Plain, with logits, and with features; with and without an optimizer."""
    n = 12
    part = SCENE.select(slice(0, n))
    rest = np.ascontiguousarray(part.sh_rest.transpose(0, 2, 1))
    base = [part.means, part.sh_dc[:, None], rest, part.log_scales, part.quaternions, part.opacity_logits[:, None]]
    state = {"state": {0: {"step": np.zeros(1), "exp_avg": part.means}}, "param_groups": [{"lr": 0.1, "params": [0]}]}
    tail = [np.zeros(n, np.float32), np.zeros((n, 1), np.float32), np.zeros((n, 1), np.float32), state, 4.7]
    logits = np.linspace(-5, 5, n).astype(np.float32)
    features = np.random.default_rng(8).normal(size=(n, 1, 16)).astype(np.float32)
    return [
        torch_file(((1, *base, *tail), 30_000)),
        torch_file(((1, *base, logits, *tail), 30_000)),
        torch_file((1, *base, features, *tail)),
        torch_file(((1, *base, np.zeros((n, 3), np.float32), *tail), 7)),
    ]


def _cut_outs() -> list[bytes]:
    """Rows of the scene as they are, moved, with a mask, and without colours."""
    part = SCENE.select(np.array([3, 1, 20, 33, 8]))
    moved = part.replace(means=part.means + np.float32(0.25), log_scales=part.log_scales - np.float32(0.1))
    bare = {name: values for name, values in _columns(part).items() if name in "xyz"}
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 5\n"
    header += "".join(f"property float {name}\n" for name in bare) + "end_header\n"
    return [
        written(".ply", part),
        written(".ply", moved),
        written(".ply", part, extras=True),
        header.encode() + np.array(list(bare.values()), "<f4").T.tobytes(),
        written(".ply", SCENE, extras=True),
    ]


def _classifiers() -> list[bytes]:
    rng = np.random.default_rng(9)
    weight, bias = rng.normal(size=(8, 16, 1, 1)).astype(np.float32), rng.normal(size=8).astype(np.float32)
    return [
        torch_file({"weight": weight, "bias": bias}),
        torch_file(weight[:, :, 0, 0]),
        torch_file({"weight": weight}),
    ]


# Marks and manifests --------------------------------------------------------------------------------------------------


def _list_readers() -> dict[str, Reader]:
    view = Viewpoint(Camera(np.array(_pose(0)), np.array([[50.0, 0, 32], [0, 50, 24], [0, 0, 1]]), 64, 48, "0.png"))
    listed = (
        Click(3, 4, view), Box(1, 2, 30, 40, view, "remove"), Sphere((0.0, 1.0, 2.0), 0.5), Grow(2.0),
        Plane((0.0, 0.0, 1.0), 0.1, "up", "intersect"), FromFile(Path("a.npy")),
    )  # fmt: skip
    marks = marks_as_json(Marks(listed, (0.0, 0.0, 1.0), ((1.0, 2.0, 3.0),), N, Path("cameras.json")), Path())
    rows = "scene,selection,name,up,options\na.ply,b.npy,mug,0 0 1,--views 5\na.ply,c.npy,cup,,\n"
    lines = [{"scene": "a.ply", "labels": "l.npy", "objects": [1, 2]}, {"scene": "b.ply", "selection": "s.npy"}]
    with tempfile.TemporaryDirectory() as folder:  # What reads options is loaded here, and not in a case.
        (Path(folder) / "a.csv").write_text(rows, encoding="utf-8")
        read_manifest(Path(folder) / "a.csv")
    return {
        "marks": Reader([{"a.json": json.dumps(marks).encode()}], read_marks),
        "manifest.csv": Reader([{"a.csv": rows.encode()}], read_manifest),
        "manifest.jsonl": Reader([{"a.jsonl": "\n".join(map(json.dumps, lines)).encode()}], read_manifest),
    }


# Cameras and masks ----------------------------------------------------------------------------------------------------


def _camera_readers() -> dict[str, Reader]:
    picture = cv2.imencode(".png", np.zeros((48, 64), np.uint8))[1].tobytes()
    frames = [_pose(i) for i in range(4)]
    transforms = {
        "w": 64, "h": 48, "fl_x": 50.0, "fl_y": 51.0, "cx": 32, "cy": 24, "k1": 0.0, "camera_model": "OPENCV",
        "applied_transform": np.eye(4)[:3].tolist(), "train_filenames": ["images/0.png"],
        "frames": [{"file_path": f"images/{i}.png", "transform_matrix": pose} for i, pose in enumerate(frames)],
    }  # fmt: skip
    blender = {
        "camera_angle_x": 0.9,
        "frames": [
            {"file_path": f"./r_{i}", "rotation": 0.1, "transform_matrix": pose} for i, pose in enumerate(frames)
        ],
    }
    inria = [
        {"id": i, "img_name": f"{i}.png", "width": 64, "height": 48, "position": [0.1, 0.2, 0.3],
         "rotation": np.eye(3).tolist(), "fy": 50.0, "fx": 51.0} for i in range(3)
    ]  # fmt: skip
    matrices = {
        "up": [0, 0, 1],
        "frames": [
            {"file": f"{i}.png", "width": 64, "height": 48, "K": [[50, 0, 32], [0, 50, 24], [0, 0, 1]],
             "split": "test" if i else "train", "world_to_camera": pose} for i, pose in enumerate(frames)
        ],
    }  # fmt: skip
    return {
        "dataparser_transforms.json": Reader([_training_world(_pose(1)[:3], _pose(2)[:3])], _read_cameras_of_training),
        "transforms.json": Reader(
            [
                {"transforms.json": json.dumps(transforms).encode()},
                {"transforms.json": json.dumps(blender).encode(), "r_0.png": picture},
            ],
            _read_cameras,
        ),
        "cameras.json": Reader(
            [{"cameras.json": json.dumps(document).encode()} for document in (inria, matrices)], _read_cameras
        ),
        "colmap binary": Reader([_colmap_binary(model) for model in (1, 0, 2, 4)], _read_cameras),
        "colmap text": Reader([_colmap_text()], _read_cameras),
    }


def _training_world(turn: list[list[float]], applied: list[list[float]]) -> Files:
    dataset = {
        "w": 64, "h": 48, "fl_x": 50.0, "applied_transform": applied, "applied_scale": 2.0,
        "frames": [{"file_path": "a.png", "transform_matrix": _pose(3)}],
    }  # fmt: skip
    training = {"transform": turn, "scale": 0.5}
    return {
        "dataparser_transforms.json": json.dumps(training).encode(), "transforms.json": json.dumps(dataset).encode()
    }  # fmt: skip


def _read_cameras_of_training(path: Path) -> Any:
    found = read_cameras_of(path.parent, path.parent / "transforms.json")
    assert all(np.isfinite(camera.world_to_camera).all() for camera in found.cameras)
    return found


def _read_cameras(path: Path) -> Any:
    found = read_camera_set(path)
    assert len(found.cameras) == len(found.train) > 0
    poses, lenses = (np.array([getattr(camera, name) for camera in found.cameras]) for name in ("world_to_camera", "K"))
    assert np.isfinite(poses).all() and np.isfinite(np.linalg.inv(poses)).all()
    assert np.isfinite(lenses).all() and np.isfinite(np.linalg.inv(lenses)).all()
    assert (abs(np.linalg.det(poses[:, :3, :3]) - 1) < 1e-6).all()
    assert found.up is None or abs(np.linalg.norm(found.up) - 1) < 1e-9
    _check_text(describe_file(path))
    with_masks = path.parent / "masks"
    with_masks.mkdir(exist_ok=True)
    try:
        cameras_with_masks(found.cameras, with_masks)
    except InputError as error:
        check_message(error)
    return found


def _pose(i: int) -> list[list[float]]:
    turn, _ = cv2.Rodrigues(np.array([0.1 * i, 0.3, -0.2 * i]))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, [i, 1, 2]
    return pose.tolist()


def _colmap_binary(model: int) -> Files:
    parameters = {
        0: (50.0, 32.0, 24.0),
        1: (50.0, 51.0, 32.0, 24.0),
        2: (50.0, 32.0, 24.0, 0.1),
        4: (50.0, 51.0, 32.0, 24.0, 0, 0, 0, 0),
    }
    lenses = struct.pack("<Q", 2)
    for i in range(2):
        lenses += struct.pack(f"<IiQQ{len(parameters[model])}d", i + 1, model, 64, 48, *parameters[model])
    images = struct.pack("<Q", 4)
    for i in range(4):
        images += struct.pack("<I7dI", i, 1.0, 0.1 * i, 0.2, 0, 1.0, 2.0, i, i % 2 + 1) + f"{i}.png".encode() + b"\0"
        images += struct.pack("<Q", i) + bytes(24 * i)
    return {"images.bin": images, "cameras.bin": lenses}


def _colmap_text() -> Files:
    lenses = "# Camera list\n1 PINHOLE 64 48 50 51 32 24\n2 OPENCV 64 48 50 51 32 24 0 0 0.1 0\n"
    images = "# Image list\n"
    for i in range(4):
        images += f"{i} 0.9 0.1 {0.1 * i:.2f} 0 1.5 2 {i} {i % 2 + 1} a/{i}.png\n{'1.5 2.5 -1 ' * i}\n"
    return {"images.txt": images.encode(), "cameras.txt": lenses.encode()}


_WIDTH, _HEIGHT = 24, 18


def _mask_reader() -> Reader:
    grey = np.zeros((_HEIGHT, _WIDTH), np.uint8)
    grey[4:12, 5:15] = 255
    colours = np.dstack([grey, grey, grey, grey])
    pictures = [
        *((".png", picture) for picture in (grey, colours, grey.astype(np.uint16) * 257)),
        (".jpg", grey), (".jpg", colours[..., :3]), (".bmp", grey), (".bmp", colours), (".webp", colours[..., :3]),
        (".tiff", grey), (".tiff", grey.astype(np.float32)), (".tiff", colours[..., :3].astype(np.uint16)),
    ]  # fmt: skip
    samples = [{f"a{suffix}": cv2.imencode(suffix, picture)[1].tobytes()} for suffix, picture in pictures]
    progressive = [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]
    samples.append({"a.jpg": cv2.imencode(".jpg", colours[..., :3], progressive)[1].tobytes()})
    one_bit = cv2.imencode(".png", grey, [cv2.IMWRITE_PNG_BILEVEL, 1])[1].tobytes()
    return Reader([*samples, {"a.png": one_bit}], _read_masks)


def _read_masks(path: Path) -> Any:
    camera = Camera(np.eye(4), intrinsics(0.8, _WIDTH, _HEIGHT), _WIDTH, _HEIGHT, path.with_suffix(".JPG").name)
    try:
        ids = ids_of(camera, path.parent)
        assert ids.shape == (_HEIGHT, _WIDTH) and ids.dtype.kind in "iu"
    except InputError as error:
        check_message(error)
    mask = mask_of(camera, path.parent)
    assert mask.shape == (_HEIGHT, _WIDTH) and mask.dtype == np.bool_
    return mask

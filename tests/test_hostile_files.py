"""Files that were made to hurt: what they would cost, print or break is refused with a sentence."""

from __future__ import annotations

import gzip
import io
import json
import os
import struct
import sys
import tracemalloc
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from command_line import run
from format_samples import sample
from selection_builders import make_scene, rows_mask, save_ply

from gaussian_trimmer import camera_files, formats
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.commands.info import describe_file
from gaussian_trimmer.errors import InputError, clip_name, printable
from gaussian_trimmer.io.reading import picture_size
from gaussian_trimmer.masks.mask_files import find_mask
from gaussian_trimmer.selection_files import SelectionOptions, load_selection, selection_file

N = 12
SCENE = make_scene(N)
ESCAPES = "\x1b]0;owned\x07\x1b[31mred"


@contextmanager
def memory_below(limit: float) -> Iterator[None]:
    """Refuse more memory of Python's and NumPy's than a limit in bytes."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < limit
    finally:
        tracemalloc.stop()


def save(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def npy(header: str, data: bytes = bytes(64), version: int = 1) -> bytes:
    text = header.encode("latin-1") + b"\n"
    return b"\x93NUMPY" + bytes([version, 0]) + struct.pack("<H" if version == 1 else "<I", len(text)) + text + data


def shape(text: str, descr: str = "|b1") -> str:
    return f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {text}, }}"


def zipped(members: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", compression) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return target.getvalue()


def sog_members(path: Path) -> dict[str, bytes]:
    formats.write(sample(40, 0), path)
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def frame(**changes: Any) -> dict[str, Any]:
    K = [[30, 0, 12], [0, 30, 8], [0, 0, 1]]
    return {"file": "a.png", "width": 24, "height": 16, "K": K, "world_to_camera": np.eye(4).tolist()} | changes


def cameras_of(path: Path, *frames: dict[str, Any], **document: Any) -> tuple[Camera, ...]:
    path.write_text(json.dumps({"frames": list(frames), **document}))
    return read_camera_set(path).cameras


class TestMessages:
    def test_texts_from_files_are_printable_and_short(self):
        assert printable("a\x1b[2J\x07\u202eb\ud800\n\tc") == "a\\x1b[2J\\x07\\u202eb\\ud800  c"
        assert printable("Fläche, 面") == "Fläche, 面"
        assert printable("a" * 600 + "b" * 600, 1000) == "a" * 499 + "..." + "b" * 498
        assert len(clip_name("\x1b" * 200)) == 80
        assert len(str(InputError("x" * 20_000))) == 1000

    def test_names_in_files_do_not_reach_the_terminal_as_they_are(self, tmp_path, capsys):
        path = save_ply(tmp_path / "a.ply", SCENE.replace(extras={ESCAPES: np.zeros(N, np.float32)}))
        members = sog_members(tmp_path / "a.sog")
        meta = json.loads(members["meta.json"])
        meta["quats"]["files"] = [ESCAPES]
        save(tmp_path / "a.sog", zipped({**members, "meta.json": json.dumps(meta).encode()}))
        np.savez(tmp_path / "a.npz", **{ESCAPES: np.zeros((2, 2))})
        cameras_of(tmp_path / "c.json", frame(file=ESCAPES), frame(file=f"{ESCAPES}2"))
        assert run("info", path) == run("info", tmp_path / "a.npz") == 0
        assert run("info", tmp_path / "a.sog") == 2
        assert run("trim", path, path, "--set", "selection.property=absent", "--output", tmp_path / "out") == 2
        assert run("select", path, "--cameras", tmp_path / "c.json", "--box", 1, 1, 2, 2, "--view", "b") == 2
        printed = "".join(capsys.readouterr())
        assert printed.count("\\x1b]0;owned\\x07") >= 5
        assert not set("\x1b\x07") & set(printed)

    def test_a_name_beyond_ascii_on_an_ascii_terminal(self, tmp_path, monkeypatch):
        formats.write(sample(5, 0), tmp_path / "ä.ply")
        for name, code in (("ä.ply", 0), ("ö.ply", 2), (os.fsdecode(b"\xff.ply"), 2)):
            streams = [io.TextIOWrapper(io.BytesIO(), encoding="ascii") for _ in range(2)]
            monkeypatch.setattr(sys, "stdout", streams[0])
            monkeypatch.setattr(sys, "stderr", streams[1])
            assert run("info", tmp_path / name) == code
            written = b""
            for stream in streams:
                stream.flush()
                written += stream.buffer.getvalue()
            assert b".ply" in written and b"\\" in written


class TestFilesThatChange:
    def test_selections(self, tmp_path, monkeypatch):
        np.save(tmp_path / "a.npy", rows_mask(N, 2))
        read = selection_file._read_npy
        monkeypatch.setattr(selection_file, "_read_npy", lambda path: (read(path), os.utime(path, (7, 7)))[0])
        with pytest.raises(InputError, match="changed while it was read"):
            load_selection(tmp_path / "a.npy", SCENE)

    @pytest.mark.parametrize("changed", ["cameras.txt", "images.txt"])
    def test_cameras(self, changed, tmp_path, monkeypatch):
        (tmp_path / "cameras.txt").write_text("1 PINHOLE 24 16 30 30 12 8\n")
        (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.png\n\n")
        assert len(read_camera_set(tmp_path).cameras) == 1
        read = camera_files.read_colmap
        monkeypatch.setattr(
            camera_files, "read_colmap", lambda path: (read(path), os.utime(tmp_path / changed, (7, 7)))[0]
        )
        with pytest.raises(InputError, match=f"{changed}' changed while it was read"):
            read_camera_set(tmp_path)


class TestMemory:
    def test_arrays_of_an_archive_have_one_limit(self, tmp_path):
        array = npy(shape("(30000000,)"), bytes(30_000_000))
        path = save(tmp_path / "a.npz", zipped({f"{i}.npy": array for i in range(4)}, zipfile.ZIP_DEFLATED))
        with memory_below(100e6), pytest.raises(InputError, match="too many for a selection"):
            load_selection(path, SCENE)
        assert "30000000" in describe_file(path)  # without a scene the limit is another

    def test_claims_of_compressed_scenes_are_held_against_the_size_of_the_file(self, tmp_path):
        n = 400_000
        header = struct.pack("<4sIIBBBB", b"NGSP", 3, n, 3, 12, 0, 0)
        path = save(tmp_path / "a.spz", gzip.compress(header + bytes(n * 65)))
        with memory_below(10e6), pytest.raises(InputError, match="announces 400000 Gaussians"):
            formats.read(path)

    def test_textures_are_held_against_the_number_of_gaussians(self, tmp_path):
        empty = cv2.imencode(".webp", np.zeros((3000, 3000, 4), np.uint8), [cv2.IMWRITE_WEBP_QUALITY, 101])[1].tobytes()
        members = {**sog_members(tmp_path / "a.sog"), "scales.webp": empty, "filler": os.urandom(9_000_000)}
        with memory_below(40e6), pytest.raises(InputError, match=r"claims 3000 x 3000 pixels"):
            formats.read(save(tmp_path / "a.sog", zipped(members)))

    def test_json_of_a_glb(self, tmp_path):
        text = b'{"a":[' + b"[]," * 1_500_000 + b"[]]}"
        body = struct.pack("<II", len(text), 0x4E4F534A) + text
        path = save(tmp_path / "a.glb", struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body)
        with memory_below(20e6), pytest.raises(InputError, match="its JSON has"):
            formats.read(path)

    def test_pictures_of_more_bytes_than_pixels(self):
        def chunk(kind: bytes, data: bytes) -> bytes:
            return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

        header = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 64, 48, 8, 2, 0, 0, 0))
        packed = zlib.compress(bytes(350 << 20), 1)  # 350 MB of zeros
        assert picture_size(header + chunk(b"IDAT", packed[:100_000])) is not None
        assert picture_size(header + chunk(b"IDAT", packed)) is None


class TestDamage:
    @pytest.mark.parametrize("ending", [".pt", ".pth", ".ckpt"])
    def test_frames_of_pickles(self, ending, tmp_path):
        path = save(tmp_path / f"a{ending}", zipped({"archive/data.pkl": b"\x80\x04\x95" + b"\xff" * 8 + b"."}))
        assert run("info", path) == run("trim", save_ply(tmp_path / "a.ply", SCENE), path) == 2

    @pytest.mark.parametrize("packed", [False, True])
    @pytest.mark.parametrize(
        "header",
        [
            shape("(40"), shape("(99999999999999999999,)"), shape("(1000000000000000,)"), shape("(40, -1)"),
            shape("(" + "[" * 900 + "]" * 900 + ")"), shape("(40,)", "|O"), shape("(40,)", "x"), "", "[" * 5000,
        ],
    )  # fmt: skip
    def test_headers_of_arrays(self, header, packed, tmp_path):
        data = npy(header)
        path = save(tmp_path / ("a.npz" if packed else "a.npy"), zipped({"a.npy": data}) if packed else data)
        with pytest.raises(InputError, match=r"damaged|booleans or numbers|no array of numbers"):
            load_selection(path, SCENE)

    @pytest.mark.parametrize("version", [1, 2, 3])
    def test_headers_that_others_write(self, version, tmp_path):
        path = save(tmp_path / "a.npy", npy(shape("( 12 , 1)"), rows_mask(N, 3).tobytes(), version))
        assert np.flatnonzero(load_selection(path, SCENE)).tolist() == [3]

    @pytest.mark.parametrize("data", [b"PK\3\4" + bytes(50), b"PK\5\6" + bytes(18), b"\x93NUMPY", b"nonsense"])
    @pytest.mark.parametrize("name", ["a.npy", "a.npz", "a.sog", "a.pt"])
    def test_heads_without_bodies(self, name, data, tmp_path):
        path = save(tmp_path / name, data)
        with pytest.raises(InputError):
            formats.read(path) if name == "a.sog" else load_selection(path, SCENE)

    def test_compression_that_takes_as_much_memory_as_it_likes(self, tmp_path):
        path = save(tmp_path / "a.npz", zipped({"mask.npy": npy(shape("(12,)"))}, zipfile.ZIP_LZMA))
        with pytest.raises(InputError, match="otherwise than by deflate"):
            load_selection(path, SCENE)

    def test_damage_shows_in_the_checksum(self, tmp_path):
        data = bytearray(zipped({"mask.npy": npy(shape("(12,)"), bytes(12))}))
        data[data.index(b"\n", data.index(b"NUMPY")) + 3] ^= 1
        with pytest.raises(InputError, match="CRC"):
            load_selection(save(tmp_path / "a.npz", bytes(data)), SCENE)
        whole = gzip.compress(struct.pack("<4sIIBBBB", b"NGSP", 2, 1, 0, 12, 0, 0) + bytes(19))
        assert len(formats.read(save(tmp_path / "a.spz", whole))) == 1
        with pytest.raises(InputError, match="damaged"):
            formats.read(save(tmp_path / "a.spz", whole[:-8] + b"1234" + whole[-4:]))

    @pytest.mark.parametrize("name", ["x" * 300 + ".png", "\x00.png", "\ud800.png", "..", "/", "x" * 5000])
    def test_names_that_no_file_has(self, name, tmp_path):
        cameras = cameras_of(tmp_path / "c.json", frame(file=name))
        assert find_mask(tmp_path, cameras[0]) is None
        pose = {"file_path": name, "transform_matrix": np.eye(4).tolist()}
        with pytest.raises(InputError, match="image size"):
            cameras_of(tmp_path / "transforms.json", pose, camera_angle_x=0.8)
        for read in (formats.read, lambda path: load_selection(path, SCENE)):
            with pytest.raises(InputError):
                read(f"{name}.ply")


class TestExtremeValues:
    @pytest.mark.parametrize("ending", [".splat", ".sog", ".compressed.ply"])
    def test_centres_in_other_formats(self, ending, tmp_path):
        gaussians = sample(40, 0)
        formats.write(gaussians.replace(means=gaussians.means * np.float32(1e30)), tmp_path / f"a{ending}")
        with pytest.raises(InputError, match=r"means that cannot be used, the first in row 0 \(.*e\+[23]\d, "):
            formats.read(tmp_path / f"a{ending}")

    @pytest.mark.parametrize("w", ["1e200", "1e-200", "nan", "x"])
    def test_quaternions_of_colmap(self, w, tmp_path):
        (tmp_path / "cameras.txt").write_text("1 PINHOLE 24 16 30 30 12 8\n")
        (tmp_path / "images.txt").write_text(f"1 1 0 0 0 0 0 0 1 a.png\n\n2 {w} 0 0 0 0 0 0 1 b.png\n\n")
        with pytest.raises(InputError, match=r"image 'b\.png': .* finite numbers"):
            read_camera_set(tmp_path)

    def test_weights_and_features(self, tmp_path):
        weights = np.ones((2, N))
        weights[1, 3] = 1e200
        np.save(tmp_path / "a.npy", weights)
        with pytest.raises(InputError, match="NaN, infinite or huge"):
            load_selection(tmp_path / "a.npy", SCENE, SelectionOptions(kind="flashsplat"))
        extras = {f"obj_dc_{i}": np.full(N, 1e30, np.float32) for i in range(16)}
        path = save_ply(tmp_path / "a.ply", SCENE.replace(extras=extras))
        with pytest.raises(InputError, match="NaN, infinite or huge"):
            load_selection(path, SCENE, SelectionOptions(query_row=2))
        path = save_ply(tmp_path / "b.ply", SCENE.replace(extras={"id": np.full(N, 1e30, np.float32)}))
        with pytest.raises(InputError, match="not whole, or huge"):
            load_selection(path, SCENE, SelectionOptions(property="id", object_id=(1,)))


class TestPaths:
    """A transforms.json without the size of its pictures makes the first one be looked at."""

    def document(self, folder: Path, name: str) -> Path:
        pose = {"file_path": name, "transform_matrix": np.eye(4).tolist()}
        folder.mkdir(exist_ok=True)
        (folder / "transforms.json").write_text(json.dumps({"camera_angle_x": 0.8, "frames": [pose]}))
        return folder / "transforms.json"

    @pytest.mark.parametrize("name", ["../secret", "..\\secret.png", "{}/secret.png", "link.png"])
    def test_pictures_elsewhere_are_opened_on_demand_alone(self, name, tmp_path, capsys):
        save(tmp_path / "secret.png", cv2.imencode(".png", np.zeros((16, 24), np.uint8))[1].tobytes())
        path = self.document(tmp_path / "scene", name.format(tmp_path))
        (tmp_path / "scene" / "link.png").symlink_to(tmp_path / "secret.png")
        with pytest.raises(InputError, match=r"outside the folder .* --trust-paths"):
            read_camera_set(path)
        (camera,) = read_camera_set(path, trust_paths=True).cameras
        assert (camera.width, camera.height) == (24, 16)
        assert run("info", path) == 2
        assert run("info", path, "--trust-paths") == 0

"""Files that were made to hurt: what they would cost, print, open or break is refused with a sentence."""

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

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import json_files, read_camera_set
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.commands.inspection import describe_file
from gaussian_trimmer.errors import InputError, printable, shown
from gaussian_trimmer.formats import ply
from gaussian_trimmer.segmentation.segmenters.mask_files import cameras_with_masks, find_mask
from gaussian_trimmer.selection_files import SelectionOptions, load_selection, number_lists, selection_file
from gaussian_trimmer.selection_files.selection_file import open_selection

N = 12
SCENE = make_scene(N)
ENDINGS = (".ply", ".compressed.ply", ".splat", ".spz", ".sog", ".ksplat")
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


def png(width: int, height: int, depth: int = 8, colours: int = 0, rows: int = 1) -> bytes:
    """A PNG that announces a size, with some of its rows."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    channels = {0: 1, 2: 3, 6: 4}[colours]
    pixels = zlib.compress(bytes(rows * (1 + (width * channels * depth + 7) // 8)))
    head = struct.pack(">IIBBBBB", width, height, depth, colours, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def frame(**changes: Any) -> dict[str, Any]:
    K = [[30, 0, 12], [0, 30, 8], [0, 0, 1]]
    return {"file": "a.png", "width": 24, "height": 16, "K": K, "world_to_camera": np.eye(4).tolist()} | changes


def cameras_of(path: Path, *frames: dict[str, Any], **document: Any) -> tuple[Camera, ...]:
    path.write_text(json.dumps({"frames": list(frames), **document}))
    return read_camera_set(path).cameras


class TestMessages:
    def test_escapes_line_ends_and_bidirectional_marks_are_spelt_out(self):
        assert printable("a\x1b[2J\x07\u202eb\ud800\n\tc") == "a\\x1b[2J\\x07\\u202eb\\ud800  c"
        assert printable("Fläche, 面") == "Fläche, 面"

    def test_long_texts_lose_their_middle(self):
        assert printable("a" * 600 + "b" * 600, 1000) == "a" * 499 + "..." + "b" * 498
        assert len(shown("\x1b" * 200)) == 80
        assert len(str(InputError("x" * 20_000))) == 1000

    def test_names_in_a_ply_do_not_reach_the_terminal_as_they_are(self, tmp_path, capsys):
        scene = SCENE.replace(extras={ESCAPES: np.zeros(N, np.float32)})
        path = save_ply(tmp_path / "a.ply", scene)
        assert run("info", path) == 0
        assert run("trim", path, path, "--selection.property", "absent", "--output", tmp_path / "out") == 2
        printed = "".join(capsys.readouterr())
        assert "\\x1b]0;owned\\x07" in printed
        assert not set("\x1b\x07") & set(printed)

    def test_names_in_archives_pictures_and_arrays_do_not_either(self, tmp_path, capsys):
        formats.write(sample(40, 0), tmp_path / "a.sog")
        with zipfile.ZipFile(tmp_path / "a.sog") as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        meta = json.loads(members["meta.json"])
        meta["quats"]["files"] = [ESCAPES]
        save(tmp_path / "a.sog", zipped({**members, "meta.json": json.dumps(meta).encode()}))
        np.savez(tmp_path / "a.npz", **{ESCAPES: np.zeros((2, 2))})
        cameras_of(tmp_path / "c.json", frame(file=ESCAPES), frame(file=f"{ESCAPES}2"))
        assert run("info", tmp_path / "a.sog") == 2
        assert run("info", tmp_path / "a.npz") == 0
        formats.write(sample(40, 0), tmp_path / "a.ply")
        assert (
            run("select", tmp_path / "a.ply", "--cameras", tmp_path / "c.json", "--box", 1, 1, 2, 2, "--view", "b") == 2
        )
        printed = "".join(capsys.readouterr())
        assert printed.count("\\x1b") >= 3
        assert "\x1b" not in printed

    def test_a_thousand_columns_are_not_listed(self, tmp_path, capsys):
        names = [f"column_{chr(97 + i % 26)}{chr(97 + i // 26)}" for i in range(400)]
        scene = SCENE.replace(extras={name: np.zeros(N, np.float32) for name in names})
        path = save_ply(tmp_path / "a.ply", scene)
        with pytest.raises(InputError, match=r"and 38\d more"):
            load_selection(path, scene, SelectionOptions(property="absent"))
        assert len(describe_file(path)) < 2000

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
        read = selection_file.read_npy
        monkeypatch.setattr(selection_file, "read_npy", lambda path: (read(path), os.utime(path, (7, 7)))[0])
        with pytest.raises(InputError, match="changed while it was read"):
            load_selection(tmp_path / "a.npy", SCENE)

    @pytest.mark.parametrize("changed", ["cameras.txt", "images.txt"])
    def test_cameras(self, changed, tmp_path, monkeypatch):
        (tmp_path / "cameras.txt").write_text("1 PINHOLE 24 16 30 30 12 8\n")
        (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.png\n\n")
        assert len(read_camera_set(tmp_path).cameras) == 1
        import gaussian_trimmer.camera_files as camera_files

        read = camera_files.read_colmap_frames
        monkeypatch.setattr(
            camera_files, "read_colmap_frames", lambda path: [*read(path), os.utime(tmp_path / changed, (7, 7))][:-1]
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

    def test_an_array_is_measured_before_it_is_unpacked(self, tmp_path):
        array = npy(shape("(300000000,)"), bytes(10))
        for name, data in (("a.npz", zipped({"a.npy": array}, zipfile.ZIP_DEFLATED)), ("a.npy", array)):
            with memory_below(1e6), pytest.raises(InputError, match=r"damaged|too many"):
                load_selection(save(tmp_path / name, data), SCENE)

    def test_text_is_read_in_pieces(self, tmp_path, monkeypatch):
        monkeypatch.setattr(number_lists, "_TEXT_BYTES_AT_ONCE", 1 << 14)
        path = save(tmp_path / "a.txt", b"11 " * 100_000)
        with memory_below(5e6), pytest.raises(InputError, match="some of them equal"):
            load_selection(path, SCENE)  # twenty times its size, if it were split at once

    def test_json_of_millions_of_values_is_not_parsed(self, tmp_path):
        path = save(tmp_path / "a.json", b'{"frames":[' + b"{}," * 4_200_000 + b"{}]}")
        with memory_below(30e6), pytest.raises(InputError, match="too many for a camera file"):
            read_camera_set(path)

    def test_claims_of_compressed_scenes_are_held_against_the_size_of_the_file(self, tmp_path):
        n = 400_000
        header = struct.pack("<4sIIBBBB", b"NGSP", 3, n, 3, 12, 0, 0)
        packed = gzip.compress(header + bytes(n * 65))
        for data in (packed, packed + bytes(n)):  # what follows the data is no Gaussian either
            with memory_below(10e6), pytest.raises(InputError, match="announces 400000 Gaussians"):
                formats.read(save(tmp_path / "a.spz", data))

    def test_textures_are_held_against_the_number_of_gaussians(self, tmp_path):
        formats.write(sample(40, 0), tmp_path / "a.sog")
        with zipfile.ZipFile(tmp_path / "a.sog") as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        empty = cv2.imencode(".webp", np.zeros((3000, 3000, 4), np.uint8), [cv2.IMWRITE_WEBP_QUALITY, 101])[1].tobytes()
        data = zipped({**members, "scales.webp": empty, "filler": os.urandom(9_000_000)})
        with memory_below(40e6), pytest.raises(InputError, match=r"claims 3000 x 3000 pixels"):
            formats.read(save(tmp_path / "a.sog", data))


class TestSmallFilesThatBrokeReaders:
    @pytest.mark.parametrize("packed", [False, True])
    @pytest.mark.parametrize(
        "header",
        [
            shape("(40"), shape("(" + "-" * 3000 + "1,)"), shape("(99999999999999999999,)"), shape("(40, -1)"),
            shape("(True,)"), shape("(" + "[" * 900 + "]" * 900 + ")"), shape("(0, 999999999999999, 999999999999999)"),
            shape("(²,)"), shape("(1,,2)"), shape("40"), shape("(40,)", "|b8"),
            shape("(40,)", "<i3"), shape("(40,)", "x"), shape("(40,)") * 2, "", "{", "{'descr': '|b1'}", "[" * 5000,
        ],
    )  # fmt: skip
    def test_headers_of_arrays(self, header, packed, tmp_path):
        data = npy(header)
        path = save(tmp_path / ("a.npz" if packed else "a.npy"), zipped({"a.npy": data}) if packed else data)
        with pytest.raises(InputError, match=r"damaged|booleans or numbers|no array of numbers"):
            load_selection(path, SCENE)

    @pytest.mark.parametrize("version", [1, 2, 3])
    @pytest.mark.parametrize("text", ["(12,)", "( 12 , )", "(12, 1)"])
    def test_headers_that_others_write(self, version, text, tmp_path):
        header = shape(text).replace("'", '"') if version == 2 else shape(text)
        path = save(tmp_path / "a.npy", npy(header, rows_mask(N, 3).tobytes(), version))
        assert np.flatnonzero(load_selection(path, SCENE)).tolist() == [3]

    def test_booleans_that_are_neither_true_nor_false(self, tmp_path):
        path = save(tmp_path / "a.npy", npy(shape("(12,)"), bytes([0, 2, 255, 1] + [0] * 8)))
        assert open_selection(path).arrays[""].view(np.uint8).tolist() == [0, 1, 1, 1] + [0] * 8

    @pytest.mark.parametrize("data", [b"PK\3\4" + bytes(50), b"PK\5\6" + bytes(18), b"\x93NUMPY", b"\x93NUMPY\1\0\xff"])
    @pytest.mark.parametrize("name", ["a.npy", "a.npz", "a.sog", "a.pt"])
    def test_heads_without_bodies(self, name, data, tmp_path):
        path = save(tmp_path / name, data)
        with pytest.raises(InputError):
            formats.read(path) if name == "a.sog" else load_selection(path, SCENE)

    def test_an_archive_of_arrays_is_no_array(self, tmp_path):
        np.savez_compressed(tmp_path / "a.npz", mask=rows_mask(N, 2))
        with pytest.raises(InputError, match="no NumPy array"):
            load_selection((tmp_path / "a.npz").rename(tmp_path / "a.npy"), SCENE)

    @pytest.mark.parametrize("least", [np.inf, np.nan, -3e38])
    def test_ranges_of_a_ksplat_that_are_not_finite(self, least, tmp_path):
        row = struct.pack("<3H7e4B9B", 0, 0, 0, *[1.0] * 7, *[9] * 13)
        header = struct.pack("<BBxxIIIIHxx3f2f", 0, 1, 1, 1, 1, 1, 2, 0, 0, 0, least, 3e38).ljust(4096, b"\0")
        section = struct.pack("<IIIIfHxxIIIIH", 1, 1, 4, 1, 5.0, 12, 32767, 0, 0, 1, 1).ljust(1024, b"\0")
        path = save(tmp_path / "a.ksplat", header + section + struct.pack("<I3f", 1, 0, 0, 0) + row)
        with pytest.raises(InputError, match="sh_rest that cannot be used"):
            formats.read(path)

    def test_a_picture_that_claims_more_than_can_be(self, tmp_path):
        save(tmp_path / "a.png", png(60_000, 60_000, 1))
        pose = {"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}
        with pytest.raises(InputError, match="60000 x 60000 pixels is not possible"):
            cameras_of(tmp_path / "transforms.json", pose, camera_angle_x=0.8)

    @pytest.mark.parametrize("name", ["x" * 300 + ".png", "\x00.png", "\ud800.png", "a/" * 3000 + "x", "..", "/", "-"])
    def test_names_that_no_file_has(self, name, tmp_path):
        cameras = cameras_of(tmp_path / "c.json", frame(file=name if len(name) < 4096 else name[:4000]))
        assert find_mask(tmp_path, cameras[0]) is None
        with pytest.raises(InputError, match="No mask in"):
            cameras_with_masks(cameras, tmp_path)
        pose = {"file_path": name, "transform_matrix": np.eye(4).tolist()}
        with pytest.raises(InputError, match=r"image size|outside|longer than"):
            cameras_of(tmp_path / "transforms.json", pose, camera_angle_x=0.8)

    @pytest.mark.parametrize("name", [["a"], {"a": 1}, "x" * 5000])
    def test_names_of_pictures_that_are_no_names(self, name, tmp_path):
        with pytest.raises(InputError, match="a name that is no text"):
            cameras_of(tmp_path / "c.json", frame(file=name))

    def test_a_path_too_long_for_the_file_system(self):
        with pytest.raises(InputError, match="There is no file"):
            formats.read("x" * 5000 + ".ply")
        with pytest.raises(InputError, match="There is no file"):
            load_selection("x" * 5000 + ".npy", SCENE)


class TestExtremeValues:
    @pytest.mark.parametrize(
        ("name", "value", "message"),
        [
            ("means", 1e19, r"means .* row 7 \(1e\+19, "),
            ("means", -1e30, r"means .* row 7 \(-1e\+30, "),
            ("log_scales", 81.0, r"log_scales .* row 7 \(81, "),
            ("quaternions", 1e-30, r"quaternions .* row 7 \(1e-30, "),
            ("quaternions", 1e20, r"quaternions .* row 7 \(1e\+20, "),
            ("sh_dc", 1e30, r"sh_dc .* row 7 \(1e\+30, "),
            ("sh_rest", -1e30, r"sh_rest .* row 7 \(-1e\+30, "),
        ],
    )
    @pytest.mark.parametrize("kind", ["float", "double", "ascii"])
    def test_scenes(self, name, value, message, kind, tmp_path):
        gaussians = sample(40, 1)
        array = getattr(gaussians, name).copy()
        array[7] = value
        path = tmp_path / "a.ply"
        ply.write(gaussians.replace(**{name: array}), path)
        if kind != "float":
            header, data = path.read_bytes().split(b"end_header\n", 1)
            rows = np.frombuffer(data, "<f4").reshape(40, -1).astype("<f8")
            text = "\n".join(" ".join(map(repr, row)) for row in rows.tolist()).encode()
            header = (
                header.replace(b"float", b"double")
                if kind == "double"
                else header.replace(b"binary_little_endian", b"ascii")
            )
            save(path, header + b"end_header\n" + (rows.tobytes() if kind == "double" else text))
        with pytest.raises(InputError, match=message):
            formats.read(path)

    @pytest.mark.parametrize("bits", [0x7FF0000000000001, 0x7FF8000000000000, 0xFFF0000000000000, 0x7FEFFFFFFFFFFFFF])
    def test_doubles_that_float32_has_not(self, bits, tmp_path):
        """Among them NaN that makes processors complain."""
        ply.write(sample(40, 0), tmp_path / "a.ply")
        header, data = (tmp_path / "a.ply").read_bytes().split(b"end_header\n", 1)
        rows = np.frombuffer(data, "<f4").reshape(40, -1).astype("<f8")
        for column, name in ((0, "means"), (-1, "quaternions"), (9, "opacity_logits")):
            changed = rows.copy()
            changed.view("<u8")[7, column] = bits
            path = save(tmp_path / "b.ply", header.replace(b"float", b"double") + b"end_header\n" + changed.tobytes())
            if name == "opacity_logits" and bits in (0xFFF0000000000000, 0x7FEFFFFFFFFFFFFF):
                assert abs(formats.read(path).opacities[7] - (bits == 0x7FEFFFFFFFFFFFFF)) < 1e-6
            else:
                with pytest.raises(InputError, match=f"have {name} that cannot be used, the first in row 7"):
                    formats.read(path)

    def test_scales_of_zero_and_opacities_of_any_size_are_right(self, tmp_path):
        gaussians = sample(40, 1)
        log_scales, logits = gaussians.log_scales.copy(), gaussians.opacity_logits.copy()
        log_scales[3], log_scales[4], logits[3], logits[4] = -1e30, -90, 1e30, -1e30
        ply.write(gaussians.replace(log_scales=log_scales, opacity_logits=logits), tmp_path / "a.ply")
        found = formats.read(tmp_path / "a.ply")
        np.testing.assert_allclose(found.scales[3:5], 1e-12, rtol=1e-5)
        assert found.opacities[3:5].tolist() == [1, 0]
        np.testing.assert_array_equal(found.log_scales[5:], gaussians.log_scales[5:])

    @pytest.mark.parametrize("ending", [".splat", ".ksplat", ".sog", ".compressed.ply"])
    def test_centres_in_other_formats(self, ending, tmp_path):
        gaussians = sample(40, 0)
        formats.write(gaussians.replace(means=gaussians.means * np.float32(1e30)), tmp_path / f"a{ending}")
        with pytest.raises(InputError, match=r"means that cannot be used, the first in row 0 \(.*e\+[23]\d, "):
            formats.read(tmp_path / f"a{ending}")

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"K": [[1e30, 0, 12], [0, 1e30, 8], [0, 0, 1]]}, r"focal lengths 1e\+30"),
            ({"K": [[1e-9, 0, 12], [0, 30, 8], [0, 0, 1]]}, "focal lengths 1e-09"),
            ({"K": [[30, 0, 1e12], [0, 30, 8], [0, 0, 1]]}, r"principal point \(1e\+12"),
            ({"width": 60_000, "height": 60_000}, "60000 x 60000 pixels is not possible"),
            ({"world_to_camera": [[1, 0, 0, 1e30], [0, 1, 0, 0], [0, 0, 1, 0]]}, r"numbers beyond 1e\+15"),
            ({"world_to_camera": [[1e200, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}, r"numbers beyond 1e\+15"),
        ],
    )
    def test_cameras(self, change, message, tmp_path):
        with pytest.raises(InputError, match=message):
            cameras_of(tmp_path / "c.json", frame(), frame(**change))

    @pytest.mark.parametrize("length", [1e-5, 1e300])
    def test_up_vectors_of_any_length(self, length, tmp_path):
        cameras_of(tmp_path / "c.json", frame(), up=[0, length, length])
        up = read_camera_set(tmp_path / "c.json").up
        np.testing.assert_allclose(up, [0, np.sqrt(0.5), np.sqrt(0.5)])

    @pytest.mark.parametrize("w", ["1e200", "1e-200", "nan", "1e400", "x"])
    def test_quaternions_of_colmap(self, w, tmp_path):
        (tmp_path / "cameras.txt").write_text("1 PINHOLE 24 16 30 30 12 8\n")
        (tmp_path / "images.txt").write_text(f"1 1 0 0 0 0 0 0 1 a.png\n\n2 {w} 0 0 0 0 0 0 1 b.png\n\n")
        with pytest.raises(InputError, match=r"image 'b\.png': the quaternion"):
            read_camera_set(tmp_path)

    def test_weights_and_features(self, tmp_path):
        weights = np.ones((2, N))
        weights[1, 3] = 1e200
        np.save(tmp_path / "a.npy", weights)
        for value in (1e200, np.nan, np.inf):
            weights[1, 3] = value
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
    def document(self, folder: Path, name: str) -> Path:
        pose = {"file_path": name, "transform_matrix": np.eye(4).tolist()}
        folder.mkdir(exist_ok=True)
        (folder / "transforms.json").write_text(json.dumps({"camera_angle_x": 0.8, "frames": [pose]}))
        return folder / "transforms.json"

    @pytest.mark.parametrize(
        "name", ["../secret", "../secret.png", "a/../../secret.png", "..\\secret.png", "{}/secret.png"]
    )
    def test_pictures_elsewhere_are_opened_on_demand_alone(self, name, tmp_path, monkeypatch):
        save(tmp_path / "secret.png", png(24, 16))
        (tmp_path / "scene" / "a").mkdir(parents=True)
        path = self.document(tmp_path / "scene", name.format(tmp_path))
        looked: list[Path] = []
        monkeypatch.setattr(json_files, "is_file", lambda path: looked.append(path) or path.is_file())
        with pytest.raises(InputError, match=r"outside the folder .* --trust-paths"):
            read_camera_set(path)
        assert looked == []  # not even looked up
        (camera,) = read_camera_set(path, trust_paths=True).cameras
        assert (camera.width, camera.height) == (24, 16)

    def test_links_lead_elsewhere_too(self, tmp_path):
        save(tmp_path / "secret.png", png(24, 16))
        path = self.document(tmp_path / "scene", "link.png")
        (tmp_path / "scene" / "link.png").symlink_to(tmp_path / "secret.png")
        with pytest.raises(InputError, match="--trust-paths"):
            read_camera_set(path)
        assert len(read_camera_set(path, trust_paths=True).cameras) == 1

    def test_the_option_reaches_the_reader(self, tmp_path, capsys):
        save(tmp_path / "secret.png", png(24, 16))
        path = self.document(tmp_path / "scene", "../secret.png")
        assert run("info", path) == 2
        assert run("info", path, "--trust-paths") == 0
        assert "24 x 16" in capsys.readouterr().out
        formats.write(sample(40, 0), tmp_path / "a.ply")
        for command in (["trim", "--output", tmp_path / "out"], ["select", "--box", 1, 1, 2, 2, "--view", "absent"]):
            arguments = [command[0], tmp_path / "a.ply", *command[1:], "--cameras", path]
            assert run(*arguments) == 2
            assert "--trust-paths" in capsys.readouterr().err
        assert run(*arguments, "--trust-paths") == 2
        assert "views are named 'absent'" in capsys.readouterr().err

    def test_pictures_inside_are_measured_and_not_decoded(self, tmp_path, monkeypatch):
        for name in ("imread", "imdecode"):
            monkeypatch.setattr(cv2, name, None)
        save(tmp_path / "a.png", png(12_000, 12_000, 16, 6))
        (camera,) = read_camera_set(self.document(tmp_path, "a")).cameras
        assert (camera.width, camera.height) == (12_000, 12_000)


class TestArchives:
    @pytest.mark.parametrize("compression", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
    def test_compression_that_takes_as_much_memory_as_it_likes(self, compression, tmp_path):
        path = save(tmp_path / "a.npz", zipped({"mask.npy": npy(shape("(12,)"))}, compression))
        with pytest.raises(InputError, match="otherwise than by deflate"):
            load_selection(path, SCENE)

    def test_damage_shows_in_the_checksum(self, tmp_path):
        data = bytearray(zipped({"mask.npy": npy(shape("(12,)"), bytes(12))}))
        data[data.index(b"\n", data.index(b"NUMPY")) + 3] ^= 1
        with pytest.raises(InputError, match="CRC"):
            load_selection(save(tmp_path / "a.npz", bytes(data)), SCENE)
        payload = struct.pack("<4sIIBBBB", b"NGSP", 2, 1, 0, 12, 0, 0) + bytes(19)
        whole = gzip.compress(payload)
        assert len(formats.read(save(tmp_path / "a.spz", whole))) == 1
        with pytest.raises(InputError, match="damaged"):
            formats.read(save(tmp_path / "a.spz", whole[:-8] + b"1234" + whole[-4:]))

    def test_thousands_of_arrays(self, tmp_path):
        path = save(tmp_path / "a.npz", zipped({f"{i}.npy": b"" for i in range(5000)}))
        with pytest.raises(InputError, match="5000 arrays"):
            load_selection(path, SCENE)

    def test_an_empty_gzip_member_after_the_other(self, tmp_path):
        data = gzip.compress(b"") * 1000
        with pytest.raises(InputError, match=r"no \.spz file"):
            formats.read(save(tmp_path / "a.spz", data))

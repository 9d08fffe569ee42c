"""Files are read whole, within bounds, and refused if they change; pictures are measured before they are decoded."""

import itertools
import os
import struct
import zipfile
import zlib

import cv2
import numpy as np
import pytest

from gaussian_trimmer.cameras import Camera, intrinsics
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.reading import decoded_picture, file_bytes, member_bytes, open_archive, picture_size, reading
from gaussian_trimmer.masks.mask_files import find_mask, ids_of, mask_of

WIDTH, HEIGHT = 24, 16


def camera(name="a.jpg", width=WIDTH, height=HEIGHT):
    return Camera(np.eye(4), intrinsics(1.0, width, height), width, height, name)


def jpeg(*options):
    picture = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH), np.uint8)
    return cv2.imencode(".jpg", picture, options)[1].tobytes()


def png(width, height, depth=8, colours=0, data=b""):
    """A PNG that announces a size, with some data."""

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = struct.pack(">IIBBBBB", width, height, depth, colours, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@pytest.mark.parametrize("ending", [".png", ".jpg", ".bmp", ".tiff", ".webp"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_sizes_are_those_of_the_decoder(ending, channels):
    shape = (HEIGHT, WIDTH, 3 if ending == ".webp" and channels == 1 else channels)  # WebP has no grey pictures
    picture = np.random.default_rng(0).integers(0, 255, shape, np.uint8)
    data = cv2.imencode(ending, picture)[1].tobytes()
    assert picture_size(data) == (WIDTH, HEIGHT)
    assert decoded_picture(data, cv2.IMREAD_COLOR).shape == (HEIGHT, WIDTH, 3)


def test_a_photograph_with_a_film_appended(tmp_path):
    """Phones save motion photographs: megabytes of film follow the JPEG, and any bytes occur in them."""
    film = np.random.default_rng(0).integers(0, 256, 6_000_000, np.uint8).tobytes()
    assert film.count(b"\xff\xda") > 64
    (tmp_path / "a.jpg").write_bytes(jpeg())
    alone = mask_of(camera(), tmp_path / "a.jpg")
    (tmp_path / "a.jpg").write_bytes(jpeg() + film)
    np.testing.assert_array_equal(mask_of(camera(), tmp_path / "a.jpg"), alone)
    assert alone.shape == (HEIGHT, WIDTH)


def test_a_picture_turned_on_its_side(tmp_path):
    """Cameras save how they were held; OpenCV turns such pictures upright."""
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\1\x01\x12\0\3\0\0\0\1\0\6\0\0\0\0\0\0"
    data = jpeg()
    (tmp_path / "a.jpg").write_bytes(data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:])
    assert mask_of(camera(width=HEIGHT, height=WIDTH), tmp_path / "a.jpg").shape == (WIDTH, HEIGHT)


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(lambda: b"", id="empty"),
        pytest.param(lambda: b"\x89PNG\r\n\x1a\n", id="PNG cut short"),
        pytest.param(lambda: b"P5 24 16 255\n" + bytes(384), id="PGM"),
        pytest.param(lambda: b"GIF89a" + bytes(99), id="GIF"),
        pytest.param(lambda: b"\x76\x2f\x31\x01" + bytes(99), id="EXR"),
    ],
)
def test_what_cannot_be_measured_is_not_decoded(data, tmp_path, monkeypatch):
    (tmp_path / "a.jpg").write_bytes(data())
    monkeypatch.setattr(cv2, "imdecode", None)
    with pytest.raises(InputError, match=r"a\.jpg' is not a picture"):
        mask_of(camera(), tmp_path / "a.jpg")


def test_pixels_that_a_png_cannot_hold_take_no_memory(tmp_path, monkeypatch):
    rows = zlib.compress(bytes(1001 * 1000), 9)  # a thousandth, which is as small as they can be
    assert decoded_picture(png(1000, 1000, data=rows), cv2.IMREAD_GRAYSCALE).shape == (1000, 1000)
    monkeypatch.setattr(cv2, "imdecode", None)
    for colours in (0, 2, 3, 4, 6):
        (tmp_path / "a.png").write_bytes(png(1200, 1000, data=rows, colours=colours))
        with pytest.raises(InputError, match=r"a\.png' is not a picture"):
            mask_of(camera(), tmp_path / "a.png")


@pytest.mark.parametrize("size", [(30_000, 30_000), (60_000, 60_000)])
def test_pictures_are_measured_before_they_are_decoded(size, tmp_path, monkeypatch):
    (tmp_path / "a.png").write_bytes(png(*size, depth=1))
    monkeypatch.setattr(cv2, "imdecode", None)
    for read, seen in itertools.product((mask_of, ids_of), (camera(), camera(width=size[0], height=size[1]))):
        with pytest.raises(InputError, match="pixels, too many"):
            read(seen, tmp_path / "a.png")


class TestNamesOfCameras:
    @pytest.mark.parametrize("name", ["../private/a.png", "sub/../../private/a.png", "{}/private/a.png", "..", "/", ""])
    def test_they_do_not_lead_out_of_the_folder(self, name, tmp_path):
        for folder in ("private", "given", "given/sub"):
            (tmp_path / folder).mkdir()
        (tmp_path / "private" / "a.png").write_bytes(jpeg())
        outside = camera(name.format(tmp_path))
        assert find_mask(tmp_path / "given", outside) is None

    @pytest.mark.parametrize("name", ["sub/a.jpg", "sub/a", "./sub/a.PNG"])
    def test_they_lead_to_folders_below(self, name, tmp_path):
        (tmp_path / "sub").mkdir()
        (tmp_path / "sub" / "a.png").write_bytes(jpeg())
        assert find_mask(tmp_path, camera(name)) == tmp_path / "sub" / "a.png"


def test_files_that_change_while_they_are_read(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"12345678")
    with pytest.raises(InputError, match="changed while it was read"), reading(path):
        path.write_bytes(b"1234567")
    with pytest.raises(InputError, match="changed while it was read"), reading(path):
        os.utime(path, (1, 1))
    with pytest.raises(InputError, match="changed while it was read"), reading(path):
        (tmp_path / "b").write_bytes(b"7654321")
        (tmp_path / "b").replace(path)
    with pytest.raises(InputError, match="Cannot read"), reading(path):
        path.unlink()


def test_files_larger_than_any_of_their_kind(tmp_path):
    (tmp_path / "a").write_bytes(bytes(11))
    assert file_bytes(tmp_path / "a", 11) == bytes(11)
    with pytest.raises(InputError, match="11 bytes; at most 10"):
        file_bytes(tmp_path / "a", 10)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes and devices")
def test_pipes_and_devices_are_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero"):
        with pytest.raises(InputError, match="not a regular file"):
            file_bytes(type(tmp_path)(path))
        with pytest.raises(InputError, match="not a regular file"), reading(type(tmp_path)(path)):
            pytest.fail("it was opened")


def save_archive(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def test_members_are_asked_for_by_name_and_size(tmp_path):
    path = save_archive(tmp_path / "a.zip", {"a": bytes(100)})
    with open_archive(path, "archive") as archive:
        assert member_bytes(archive, "a", 100, path) == bytes(100)
        with pytest.raises(InputError, match="claims 100 bytes"):
            member_bytes(archive, "a", 99, path)
        with pytest.raises(InputError, match="no member 'b'"):
            member_bytes(archive, "b", 99, path)

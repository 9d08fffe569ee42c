"""Niantic's .spz: versions 2, 3 and 4, axes as in the file, round trips within its bits, bombs and lies."""

from __future__ import annotations

import gzip
import struct
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from format_samples import (
    ATTRIBUTES,
    error,
    rotation_error,
    round_trip,
    sample,
    splat_transform,
    unit,
)

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import spz

HEADER = struct.Struct("<4sIIBBBB")


def raw(version: int, count: int, degree: int, payload: bytes, magic: bytes = b"NGSP", bits: int = 12) -> bytes:
    return gzip.compress(HEADER.pack(magic, version, count, degree, bits, 0, 0) + payload, mtime=0)


def fixed(*values: int) -> bytes:
    return b"".join(struct.pack("<i", value)[:3] for value in values)


def test_known_bytes_of_version_2(tmp_path: Path) -> None:
    coefficients = bytes([128 + 64, 128, 128, 128, 128 + 32, 128, 128, 128, 128 - 128])  # y red, z green, x blue
    payload = fixed(4096, -8192, 2048) + bytes([128, 255, 128, 0, 160, 176, 0]) + bytes([255, 128, 128]) + coefficients
    (tmp_path / "a.spz").write_bytes(raw(2, 1, 1, payload))
    gaussians = formats.read(tmp_path / "a.spz")
    np.testing.assert_array_equal(gaussians.means, [[1.0, -2.0, 0.5]])
    np.testing.assert_array_equal(gaussians.log_scales, [[0, 1, -10]])
    np.testing.assert_allclose(gaussians.opacities, [128 / 255], atol=1e-6)
    np.testing.assert_allclose(gaussians.sh_dc, [[1 / 0.3, 0.5 / 255 / 0.15, -1 / 0.3]], rtol=1e-5)
    np.testing.assert_allclose(unit(gaussians.quaternions), [[0, 1, 0, 0]], atol=0.01)
    np.testing.assert_array_equal(gaussians.sh_rest, [[[0.5, 0, 0], [0, 0.25, 0], [0, 0, -1]]])


def test_degree_4_is_cut_to_degree_3(tmp_path: Path) -> None:
    body = fixed(0, 0, 0) + bytes([128] * 7) + struct.pack("<I", 3 << 30) + bytes(range(72))
    (tmp_path / "a.spz").write_bytes(raw(3, 1, 4, body))
    gaussians = formats.read(tmp_path / "a.spz")
    assert gaussians.sh_degree == 3
    codes = gaussians.sh_rest[0] * 128 + 128
    np.testing.assert_array_equal(codes, np.arange(45).reshape(15, 3).T)
    np.testing.assert_array_equal(gaussians.quaternions, [[1, 0, 0, 0]])


def test_what_cannot_be_held_is_refused(tmp_path: Path) -> None:
    gaussians = sample(3, 0)
    with pytest.raises(InputError, match="up to 8388607"):
        formats.write(gaussians.replace(means=gaussians.means + np.float32(1e7)), tmp_path / "a.spz")
    assert list(tmp_path.iterdir()) == []


def as_version_4(version_3: bytes) -> bytes:
    """The same Gaussians as plain header, table and zstd streams."""
    zstd = zstd_or_skip()
    data = gzip.decompress(version_3)
    magic, _, count, degree, bits, _, _ = HEADER.unpack(data[:16])
    sizes = [count * size for size in (9, 1, 3, 3, 4, 3 * ((degree + 1) ** 2 - 1)) if size]
    ends = np.cumsum([16, *sizes])
    streams = [zstd.compress(data[a:b]) for a, b in pairwise(ends)]
    header = HEADER.pack(magic, 4, count, degree, bits, 0, len(streams)) + struct.pack("<I", 40) + bytes(12)
    table = b"".join(struct.pack("<QQ", len(s), size) for s, size in zip(streams, sizes, strict=True))
    return header + b"skipped!" + table + b"".join(streams)


def zstd_or_skip() -> ModuleType:
    name = "compression.zstd" if find_spec("compression") else "backports.zstd"
    return pytest.importorskip(name, reason="zstd comes with Python 3.14 or backports.zstd")


@pytest.mark.parametrize("degree", [0, 3])
def test_version_4_is_version_3_in_other_wrapping(tmp_path: Path, degree: int) -> None:
    gaussians = sample(300, degree)
    three = round_trip(gaussians, tmp_path / "3.spz")
    content = as_version_4((tmp_path / "3.spz").read_bytes())
    (tmp_path / "4.spz").write_bytes(content)
    formats.write(gaussians, tmp_path / "own.spz", version=4)
    assert (tmp_path / "own.spz").read_bytes()[:8] == b"NGSP\4\0\0\0"
    for path in (tmp_path / "4.spz", tmp_path / "own.spz"):
        four = formats.read(path)
        for name in ATTRIBUTES:
            np.testing.assert_array_equal(getattr(four, name), getattr(three, name))
    for damaged in (content[:-5], content[:60], content[:20], content[:90] + bytes(20) + content[110:]):
        (tmp_path / "4.spz").write_bytes(damaged)
        with pytest.raises(InputError, match="damaged"):
            formats.read(tmp_path / "4.spz")
    with pytest.raises(InputError, match="version 5 cannot be written"):
        formats.write(gaussians, tmp_path / "5.spz", version=5)


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.needs("splat-transform")
def test_the_converter_reads_the_same_numbers(tmp_path: Path, version: int) -> None:
    zstd_or_skip()
    formats.write(sample(200, 3), tmp_path / "ours.spz", version=version)
    splat_transform(tmp_path / "ours.spz", tmp_path / "ours.ply")
    ours, theirs = formats.read(tmp_path / "ours.spz"), formats.read(tmp_path / "ours.ply")
    for name in ("means", "log_scales", "sh_dc", "sh_rest"):
        assert error(ours, theirs, name) < 1e-6, name
    assert rotation_error(ours, theirs) < 1e-6


def test_version_4_without_zstd_names_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(spz, "import_module", refuse)
    table = b"".join(struct.pack("<QQ", 1, size) for size in (9, 1, 3, 3, 4))
    header = HEADER.pack(b"NGSP", 4, 1, 0, 12, 0, 5) + struct.pack("<I", 32) + bytes(12)
    (tmp_path / "a.spz").write_bytes(header + table + b"zzzzz")
    with pytest.raises(InputError, match=r"pip install backports\.zstd"):
        formats.read(tmp_path / "a.spz")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not an .spz file"),
        (raw(2, 1, 0, b"")[:12], "not an .spz file"),
        (raw(2, 1, 0, bytes(16))[:-9], "truncated"),
        (raw(2, 1, 0, bytes(19), magic=b"ABCD"), "does not begin with 'NGSP'"),
        (raw(1, 1, 0, bytes(19)), "version 1"),
        (raw(2, 0, 0, b""), "zero Gaussians"),
        (raw(2, 2, 0, bytes(19)), "truncated"),
        (raw(2, 1, 5, bytes(300)), "SH degree 5"),
        (raw(2, 1, 0, bytes(19), bits=200), "200 fractional bits"),
        (raw(3, 4_000_000_000, 3, bytes(1000)), "announces 4000000000 Gaussians"),
        (raw(2, 1_000_000, 0, bytes(20_000_000)), "announces 1000000 Gaussians"),  # a bomb of 20 kB
        (HEADER.pack(b"NGSP", 5, 1, 0, 12, 0, 6) + bytes(16), "version 5"),
        (HEADER.pack(b"NGSP", 4, 1, 0, 12, 0, 255) + struct.pack("<I", 2**32 - 1), "streams do not fit"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.spz"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        formats.read(path)

"""The .ksplat file: packed levels built by hand, round trips of level 0, damaged files."""

from __future__ import annotations

import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from format_samples import error, rotation_error, round_trip, sample, splat_transform

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Gaussians

CAPACITY = 4
BLOCK = 5.0


def section_header(n: int, level: int, degree: int, buckets: list[int], max_n: int | None = None) -> bytes:
    full = sum(size == CAPACITY for size in buckets)
    header = struct.pack("<IIIIfHxxI", n, max_n or n, CAPACITY, len(buckets), BLOCK, 12, 32767 if level else 1)
    return (header + struct.pack("<IIIH", 0, full, len(buckets) - full, degree)).ljust(1024, b"\0")


def file_header(n: int, level: int, sections: int, sh_range: tuple[float, float] = (-1.5, 1.5)) -> bytes:
    header = struct.pack("<BBxxIIIIHxx3f2f", 0, 1, sections, sections, n, n, level, 0, 0, 0, *sh_range)
    return header.ljust(4096, b"\0")


def section_data(gaussians: Gaussians, level: int, buckets: list[int], sh_range: tuple[float, float]) -> bytes:
    """Partial lengths, bucket centres and rows of a section of level 1 or 2."""
    starts = np.cumsum([0, *buckets])
    parts = [gaussians.means[a:b] for a, b in pairwise(starts)]
    centres = np.array([part.mean(axis=0) for part in parts], "<f4")
    data = np.array([size for size in buckets if size < CAPACITY], "<u4").tobytes() + centres.tobytes()
    k = gaussians.sh_rest.shape[2]
    for i in range(len(gaussians)):
        centre = centres[np.searchsorted(starts, i, side="right") - 1]
        data += np.rint((gaussians.means[i] - centre) / (BLOCK / 2 / 32767) + 32767).astype("<u2").tobytes()
        data += gaussians.scales[i].astype("<f2").tobytes() + gaussians.quaternions[i].astype("<f2").tobytes()
        data += bytes([10, 20, 30, 200])
        for band in [slice(0, 3), slice(3, 8)][: {0: 0, 3: 1, 8: 2}[k]]:
            values = gaussians.sh_rest[i][:, band].ravel()
            low, high = sh_range
            if level == 2:
                data += np.rint((values - low) / (high - low) * 255).astype(np.uint8).tobytes()
            else:
                data += values.astype("<f2").tobytes()
    return data


def packed_file(gaussians: Gaussians, level: int) -> bytes:
    """Two sections: of all coefficients with buckets of 4, 4, 3 and 1, and of none with one of 2."""
    first, second = gaussians.select(slice(0, 12)), gaussians.select(slice(12, 14))
    second = second.replace(sh_rest=second.sh_rest[:, :, :0])
    headers = file_header(14, level, 2, (-1.0, 1.0)) + section_header(12, level, gaussians.sh_degree, [4, 4, 3, 1])
    headers += section_header(2, level, 0, [2])
    data = section_data(first, level, [4, 4, 3, 1], (-1.0, 1.0))
    return headers + data + section_data(second, level, [2], (-1.0, 1.0))


def compact(n: int, degree: int) -> Gaussians:
    gaussians = sample(n, degree)
    return gaussians.replace(means=gaussians.means * np.float32(0.1))  # within a block of five units


@pytest.mark.parametrize("level", [1, 2])
@pytest.mark.parametrize("degree", [1, 2])
def test_packed_levels(tmp_path: Path, level: int, degree: int) -> None:
    gaussians = compact(14, degree)
    (tmp_path / "a.ksplat").write_bytes(packed_file(gaussians, level))
    again = formats.read(tmp_path / "a.ksplat")
    assert error(again, gaussians, "means") <= 0.5 * BLOCK / 2 / 32767 + 1e-6  # half a step of the 16 bits
    assert error(again, gaussians, "log_scales") <= 2.0**-10  # float16 has 11 bits; the smallest scale is normal there
    np.testing.assert_allclose(again.quaternions, gaussians.quaternions, rtol=2.0**-10)
    np.testing.assert_allclose(again.opacities, 200 / 255, atol=1e-6)
    np.testing.assert_allclose(0.5 + 0.28209479 * again.sh_dc, [[10 / 255, 20 / 255, 30 / 255]] * 14, atol=1e-6)
    tolerance = 0.5 * 2 / 255 if level == 2 else 2.0**-11  # half a step of 8 bits over two units, or float16
    np.testing.assert_allclose(again.sh_rest[:12], gaussians.sh_rest[:12], atol=tolerance + 1e-6)
    np.testing.assert_array_equal(again.sh_rest[12:], 0)


@pytest.mark.parametrize("level", [1, 2])
@pytest.mark.needs("splat-transform")
def test_packed_levels_agree_with_the_fields_converter(tmp_path: Path, level: int) -> None:
    (tmp_path / "a.ksplat").write_bytes(packed_file(compact(14, 2), level))
    splat_transform(tmp_path / "a.ksplat", tmp_path / "a.ply")
    ours, theirs = formats.read(tmp_path / "a.ksplat"), formats.read(tmp_path / "a.ply")
    for name in ("means", "log_scales", "quaternions", "sh_dc"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-5)
    np.testing.assert_allclose(ours.sh_rest[:12], theirs.sh_rest[:12], atol=1e-5)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_round_trip_within_quantisation(tmp_path: Path, degree: int) -> None:
    gaussians = sample(300, degree)
    again = round_trip(gaussians, tmp_path / "a.ksplat")
    np.testing.assert_array_equal(again.means, gaussians.means)  # float32, as the next three
    np.testing.assert_array_equal(again.sh_rest, gaussians.sh_rest[:, :, :8])  # degree 3 is more than the format has
    assert error(again, gaussians, "log_scales") < 1e-6
    assert rotation_error(again, gaussians) < 1e-6
    assert error(again, gaussians, "opacities") <= 0.5 / 255 + 1e-6  # 8 bits
    assert error(again, gaussians, "sh_dc") <= 0.5 / 255 / 0.28209479 + 1e-6  # 8 bits of colour


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("level", [0, 1, 2])
def test_empty_sections_are_passed_over(tmp_path: Path, level: int, degree: int, first: bool) -> None:
    (tmp_path / "a.ksplat").write_bytes(with_empty_section(level, degree, first=first))
    assert len(formats.read(tmp_path / "a.ksplat")) == 3


def with_empty_section(level: int, degree: int, *, first: bool) -> bytes:
    """A file of three Gaussians with a section of none before or after them."""
    k = (degree + 1) ** 2 - 1
    row = np.zeros(3, [("mean", "f4" if level == 0 else "u2", 3), ("scale", "f4" if level == 0 else "f2", 3),
                       ("rotation", "f4" if level == 0 else "f2", 4), ("rgba", "u1", 4),
                       ("sh", ("f4", "f2", "u1")[level], 3 * k)])  # fmt: skip
    row["rotation"] = (1, 0, 0, 0)
    buckets = [] if level == 0 else [3]
    sections = [section_header(3, level, degree, buckets), section_header(0, level, degree, [])]
    data = row.tobytes() if level == 0 else np.uint32(3).tobytes() + bytes(12) + row.tobytes()
    return file_header(3, level, 2) + b"".join(sections[:: -1 if first else 1]) + data


def test_rows_reserved_but_not_filled_are_passed_over(tmp_path: Path) -> None:
    """A file saved while it was still loading has sections with room for more rows than they hold."""
    gaussians = sample(3, 0)
    formats.write(gaussians, tmp_path / "a.ksplat")
    rows = (tmp_path / "a.ksplat").read_bytes()[5120:]
    headers = file_header(3, 0, 2) + section_header(2, 0, 0, [], max_n=5) + section_header(1, 0, 0, [])
    (tmp_path / "a.ksplat").write_bytes(headers + rows[:88] + bytes(3 * 44) + rows[88:])
    np.testing.assert_array_equal(formats.read(tmp_path / "a.ksplat").means, gaussians.means)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (bytes(100), "no header of 4096 bytes"),
        (file_header(1, 7, 1), "level 7"),
        (file_header(1, 0, 2**32 - 1), "no room for 4294967295 section headers"),
        (file_header(1, 0, 1) + section_header(1, 0, 9, []) + bytes(44), "SH degree 9"),
        (file_header(1, 0, 1) + section_header(9, 0, 0, [], max_n=1) + bytes(44), "9 of 1 rows"),
        (file_header(2**31, 0, 1) + section_header(2**31, 0, 0, []) + bytes(44), "truncated"),
        (file_header(2, 0, 1) + section_header(1, 0, 0, []) + bytes(44), "announces 2 Gaussians and has 1"),
        (file_header(2, 1, 1) + section_header(2, 1, 0, []) + bytes(48), "buckets of a section"),
        (file_header(1, 0, 1) + section_header(1, 0, 0, []) + bytes(44), "quaternions that cannot be used"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.ksplat"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        formats.read(path)

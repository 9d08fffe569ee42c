"""SuperSplat's compressed PLY: known words, round trips within the bits of each attribute, damaged files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from format_samples import error, rotation_error, round_trip, sample, smallest_three_error

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import compressed_ply


def spans(values: np.ndarray) -> np.ndarray:
    """Width of each row's chunk of 256, (N, 3)."""
    chunks = [values[start : start + 256] for start in range(0, len(values), 256)]
    return np.concatenate([np.repeat(np.ptp(chunk, axis=0)[None], len(chunk), axis=0) for chunk in chunks])


def test_known_words(tmp_path: Path) -> None:
    chunk = np.array([[0, 0, 0, 1, 2, 4, -8, -8, -8, -4, -4, -4, 0, 0, 0, 1, 1, 1]], "<f4")
    # Second row: centre and scale at the ends of their ranges, a half turn about z (largest component 3, the rest 0).
    zero = 512 << 20 | 512 << 10 | 512
    words = np.array([[0, zero, 0, 0x00_00_00_80], [0xFFFFFFFF, 3 << 30 | zero, 0xFFFFFFFF, 0xFF_80_00_FF]], "<u4")
    names = [f"{end}_{name}" for group in ("x y z", "scale_x scale_y scale_z", "r g b") for end in ("min", "max")
             for name in group.split()]  # fmt: skip
    header = ["ply", "format binary_little_endian 1.0", "element chunk 1", *[f"property float {n}" for n in names]]
    header += ["element vertex 2", *[f"property uint packed_{n}" for n in ("position", "rotation", "scale", "color")]]
    path = tmp_path / "a.ply"
    path.write_bytes("\n".join([*header, "end_header\n"]).encode() + chunk.tobytes() + words.tobytes())
    gaussians = formats.read(path)
    np.testing.assert_array_equal(gaussians.means, [[0, 0, 0], [1, 2, 4]])
    np.testing.assert_array_equal(gaussians.log_scales, [[-8, -8, -8], [-4, -4, -4]])
    np.testing.assert_allclose(gaussians.quaternions, [[1, 0, 0, 0], [0, 0, 0, 1]], atol=1e-3)
    np.testing.assert_allclose(gaussians.opacities, [128 / 255, 1.0], atol=1e-6)
    np.testing.assert_allclose(0.5 + 0.28209479 * gaussians.sh_dc, [[0, 0, 0], [1, 128 / 255, 0]], atol=1e-6)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("n", [1, 256, 600])
def test_round_trip_within_quantisation(tmp_path: Path, degree: int, n: int) -> None:
    gaussians = sample(n, degree)
    again = round_trip(gaussians, tmp_path / "a.compressed.ply")
    # 11, 10 and 11 bits make 2047, 1023 and 2047 steps of a chunk's width: half a step, and float32 on top.
    half_steps = 0.5 / np.array([2047, 1023, 2047])
    for name in ("means", "log_scales"):
        values = getattr(gaussians, name)
        off = np.abs(getattr(again, name).astype(np.float64) - values)
        assert (off <= spans(values) * half_steps + 1e-6 * np.abs(values).max()).all()
    # Colours have 8 bits between the chunk's extremes, and a coefficient is 0.2821 of its colour.
    assert (np.abs(again.sh_dc - gaussians.sh_dc) <= spans(gaussians.sh_dc) * 0.5 / 255 + 1e-5).all()
    assert error(again, gaussians, "opacities") <= 0.5 / 255 + 1e-6  # 8 bits
    assert rotation_error(again, gaussians) <= smallest_three_error(1024)  # 10 bits a component
    assert error(again, gaussians, "sh_rest") <= 4 / 256 + 1e-6  # 256 bins over 8 units, read at their centres


def test_files_without_colour_extremes(tmp_path: Path) -> None:
    path = tmp_path / "a.compressed.ply"
    gaussians = sample(256, 0)
    compressed_ply.write(gaussians, path)
    header, data = path.read_bytes().split(b"end_header\n")
    for name in ("min_r", "min_g", "min_b", "max_r", "max_g", "max_b"):
        header = header.replace(f"property float {name}\n".encode(), b"")
    path.write_bytes(header + b"end_header\n" + data[:48] + data[72:])
    again = formats.read(path)
    np.testing.assert_allclose(again.means, round_trip(gaussians, tmp_path / "b.compressed.ply").means)
    colours = 0.5 + 0.28209479 * again.sh_dc
    assert colours.min() == pytest.approx(0)  # each chunk's extremes are the words' extremes, now meaning 0 and 1
    assert colours.max() == pytest.approx(1)


def test_damage_is_found(tmp_path: Path) -> None:
    path = tmp_path / "a.compressed.ply"
    compressed_ply.write(sample(300, 1), path)
    good = path.read_bytes()
    for old, new, message in [
        (b"element chunk 2", b"element chunk 1", "300 Gaussians cannot lie in 1 chunks"),
        (b"element sh 300", b"element sh 299", "not 9, 24 or 45 bytes"),
        (b"float min_x", b"float any_x", "lacks min_x"),
        (b"uint packed_scale", b"int packed_scale", "lacks packed_scale"),
        (b"uint packed_position", b"uint position", "not a compressed PLY"),
    ]:
        path.write_bytes(good.replace(old, new))
        with pytest.raises(InputError, match=message):
            compressed_ply.read(path)
    path.write_bytes(good[:-1])
    with pytest.raises(InputError, match="truncated"):
        compressed_ply.read(path)
    start = good.index(b"end_header\n") + len(b"end_header\n")
    path.write_bytes(good[:start] + np.float32(np.nan).tobytes() + good[start + 4 :])
    with pytest.raises(InputError, match="means that cannot be used"):
        formats.read(path)

"""All formats: dispatch, round trips within their precision, conversion, agreement with the field's converter."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from format_samples import (
    ATTRIBUTES,
    error,
    real,
    rotation_error,
    round_trip,
    sample,
    smallest_three_error,
    splat_transform,
)

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import FORMATS, compressed_ply, ply
from gaussian_trimmer.formats.packing import morton_order
from gaussian_trimmer.gaussians import Gaussians, concatenate

SUFFIXES = list(FORMATS)
EXACT_AGAIN = {
    ".ply": ATTRIBUTES,
    ".compressed.ply": ("means", "log_scales", "opacity_logits", "sh_rest"),  # extremes of colours are rounded
    ".splat": ("means", "opacity_logits", "sh_dc"),
    ".spz": ("means", "log_scales", "opacity_logits", "sh_dc", "sh_rest"),
    ".sog": ("log_scales", "opacity_logits", "sh_dc", "sh_rest"),
    ".glb": ("means", "sh_dc", "sh_rest"),
}
"""What a second round trip leaves as it is, to the last bit."""


def spans(values: np.ndarray) -> np.ndarray:
    """Width of each row's chunk of 256, (N, 3)."""
    chunks = [values[start : start + 256] for start in range(0, len(values), 256)]
    return np.concatenate([np.repeat(np.ptp(chunk, axis=0)[None], len(chunk), axis=0) for chunk in chunks])


def log_means(gaussians: Gaussians) -> np.ndarray:
    means = gaussians.means.astype(np.float64)
    return np.asarray(np.sign(means) * np.log1p(np.abs(means)))


EIGHT_BITS = 0.5 / 255 + 1e-6


def largest_errors(suffix: str, g: Gaussians) -> tuple[dict[str, Any], float]:
    """How far each attribute may be off after a round trip, half a step and float32 on top, and angles of rotations."""
    match suffix:
        case ".ply":
            return dict.fromkeys(("means", "log_scales", "opacities", "sh_dc", "sh_rest"), 0), 0
        case ".glb":
            return {"means": 0, "log_scales": 1e-5, "opacities": 1e-6, "sh_dc": 0, "sh_rest": 0}, 1e-5
        case ".splat":  # float32 but for colours and rotations, whose greatest byte is one step short of 1
            return {
                "means": 0,
                "log_scales": 1e-6,
                "opacities": EIGHT_BITS,
                "sh_dc": 0.5 / 255 / 0.28209479 + 1e-6,
            }, 2 / 128
        case ".compressed.ply":
            # 11, 10 and 11 bits make 2047, 1023 and 2047 steps of a chunk's width; coefficients are read at the centres
            # of 256 bins over 8 units, and a coefficient of degree 0 is 0.2821 of its colour.
            steps = {
                name: spans(values) * 0.5 / np.array([2047, 1023, 2047]) + 1e-6 * np.abs(values).max()
                for name, values in (("means", g.means), ("log_scales", g.log_scales))
            }
            colours = spans(g.sh_dc) * 0.5 / 255 + 1e-5
            return {
                **steps,
                "opacities": EIGHT_BITS,
                "sh_dc": colours,
                "sh_rest": 4 / 256 + 1e-6,
            }, smallest_three_error(1024)
        case ".spz":
            # 24 bits of fixed point, of which the sign and the whole part of the largest coordinate are taken.
            bits = int(np.floor(np.log2((2**23 - 1) / np.abs(g.means).max())))
            colours = {"sh_dc": 0.5 / 255 / 0.15 + 1e-5, "sh_rest": 0.5 / 128 + 1e-6}
            means, scales = 0.5 * 2.0**-bits + 1e-6, 0.5 / 16 + 1e-6
            return {"means": means, "log_scales": scales, "opacities": EIGHT_BITS, **colours}, smallest_three_error(
                1023
            )
        case _:
            # 256 values that are at least as well placed as evenly spaced ones: a whole step covers their unevenness.
            tables = {
                name: np.ptp(values) / 255
                for name in ("log_scales", "sh_dc", "sh_rest")
                if (values := getattr(g, name)).size
            }
            # 16 bits between the least and the greatest logarithm of the centres.
            step = (0.5 / 65535 * np.ptp(log_means(g), axis=0) + 1e-6) * (1 + np.abs(g.means)) * 1.01
            return {"means": step, **tables, "opacities": EIGHT_BITS}, smallest_three_error(256)


@pytest.mark.parametrize("n", [1, 256, 700])
@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_round_trip_within_quantisation(tmp_path: Path, suffix: str, degree: int, n: int) -> None:
    gaussians = sample(n, degree)
    again = round_trip(gaussians, tmp_path / f"a{suffix}")
    bounds, turned = largest_errors(suffix, gaussians)
    for name, bound in bounds.items():
        off = np.abs(getattr(again, name).astype(np.float64) - getattr(gaussians, name))
        assert (off <= bound).all(), name
    assert rotation_error(again, gaussians) <= turned + 1e-7
    assert again.sh_degree == (0 if suffix == ".splat" else degree)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_second_round_trip_changes_nearly_nothing(tmp_path: Path, suffix: str) -> None:
    gaussians = sample(700, 2)
    once = round_trip(gaussians, tmp_path / f"a{suffix}")
    twice = round_trip(once, str(tmp_path / f"b{suffix}"))
    assert error(once, gaussians, "means") < 0.02  # far less than the distance of neighbours in the file: its order
    for name in ATTRIBUTES:
        assert getattr(once, name).dtype == np.float32
        if name in EXACT_AGAIN[suffix]:
            np.testing.assert_array_equal(getattr(twice, name), getattr(once, name))
        elif name != "quaternions":
            assert error(twice, once, name) < 2e-6 * np.abs(getattr(once, name)).max(initial=1)
    assert rotation_error(twice, once) <= 2 / 128  # normalised anew, and two components may tie for the largest


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_extremes_survive_every_format(tmp_path: Path, suffix: str) -> None:
    gaussians = sample(40, 1)
    gaussians = gaussians.replace(
        opacity_logits=np.repeat(np.array([-90, 90], np.float32), 20),
        log_scales=gaussians.log_scales * 15,
        sh_dc=gaussians.sh_dc * 50,
        sh_rest=gaussians.sh_rest * 50,
    )
    again = round_trip(gaussians, tmp_path / f"a{suffix}")  # a value that is not finite would be refused
    np.testing.assert_allclose(again.opacities, gaussians.opacities, atol=1e-6)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_equal_gaussians(tmp_path: Path, suffix: str) -> None:
    """Ranges of no width and codebooks of one value."""
    gaussians = sample(1, 1).select(np.zeros(300, np.int64))
    again = round_trip(gaussians, tmp_path / f"a{suffix}")
    assert error(again, gaussians, "means") < 1e-5
    assert rotation_error(again, gaussians) < 0.02


@pytest.mark.parametrize("suffix", [suffix for suffix in SUFFIXES if suffix not in (".ply", ".splat")])
def test_formats_that_cannot_hold_nothing_say_so(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(InputError, match="cannot hold zero Gaussians"):
        formats.write(sample(2).select(slice(0, 0)), tmp_path / f"a{suffix}")
    assert list(tmp_path.iterdir()) == []


def test_a_plys_kind_is_told_by_its_header(tmp_path: Path) -> None:
    gaussians = sample(10, 0)
    compressed_ply.write(gaussians, tmp_path / "packed.ply")
    ply.write(gaussians, tmp_path / "plain.compressed.ply")
    assert error(formats.read(tmp_path / "packed.ply"), gaussians, "means") < 0.01
    np.testing.assert_array_equal(formats.read(tmp_path / "plain.compressed.ply").means, gaussians.means)


def test_names(tmp_path: Path) -> None:
    for name in ("scene.obj", "rough.npy"):
        (tmp_path / name).touch()
    with pytest.raises(InputError, match=r"'scene.obj' is not in a known splat format; known endings: .ply"):
        formats.read(tmp_path / "scene.obj")
    with pytest.raises(InputError, match=r"\.pt\. A selection is given after its scene\.$"):
        formats.read(tmp_path / "rough.npy")
    with pytest.raises(InputError, match="There is no file"):
        formats.read(tmp_path / "scene.spz")
    with pytest.raises(InputError, match="holds no splat file"):
        (tmp_path / "folder.ply").mkdir()
        formats.read(tmp_path / "folder.ply")
    assert formats.format_suffix(Path("a.COMPRESSED.ply")) == ".compressed.ply"


def test_a_format_that_went_is_answered_by_its_replacement(tmp_path):
    (tmp_path / "a.ksplat").touch()
    with pytest.raises(InputError, match=r"'a\.ksplat' .*convert it: splat-transform a\.ksplat scene\.ply"):
        formats.read(tmp_path / "a.ksplat")


def test_convert(tmp_path: Path) -> None:
    gaussians = sample(30, 1)
    formats.write(gaussians, tmp_path / "a.ply")
    read = formats.convert(tmp_path / "a.ply", tmp_path / "a.spz")
    np.testing.assert_array_equal(read.means, gaussians.means)
    assert error(formats.read(tmp_path / "a.spz"), gaussians, "means") < 1e-5
    with pytest.raises(InputError, match=r"'a\.obj' cannot be written: .* \.sog, \.glb\.$"):
        formats.convert(tmp_path / "missing.ply", tmp_path / "a.obj")


def test_sorting_makes_a_compressed_ply_finer(tmp_path: Path) -> None:
    gaussians = sample(20_000, 0)
    ply.write(gaussians, tmp_path / "a.ply")
    errors = []
    for sort in (False, True):
        written = formats.convert(tmp_path / "a.ply", tmp_path / "a.compressed.ply", sort=sort)
        errors.append(np.abs(formats.read(tmp_path / "a.compressed.ply").means - written.means).mean())
        np.testing.assert_array_equal(np.sort(written.means, axis=0), np.sort(gaussians.means, axis=0))
    order = morton_order(gaussians.means)
    np.testing.assert_array_equal(written.opacity_logits, gaussians.opacity_logits[order])
    steps = np.linalg.norm(np.diff(written.means, axis=0), axis=1).mean()
    assert steps < 0.2 * np.linalg.norm(np.diff(gaussians.means, axis=0), axis=1).mean()
    assert errors[1] < 0.5 * errors[0]  # 79 chunks divide the scene in four along each axis


REAL_FILES = {"guitar.compressed.ply": 90_854, "wolf.spz": 90_586, "statue.sog": 71_359}
"""Number of Gaussians of real captures."""


@pytest.mark.parametrize("name", REAL_FILES)
def test_real_files_are_read(name: str) -> None:
    assert len(formats.read(real(name))) == REAL_FILES[name]


@pytest.mark.parametrize("name", ["seal.splat", *REAL_FILES])
@pytest.mark.needs("splat-transform")
def test_real_files_are_read_as_the_fields_converter_reads_them(tmp_path: Path, name: str) -> None:
    splat_transform(real(name), tmp_path / "a.ply")
    ours, theirs = formats.read(real(name)), formats.read(tmp_path / "a.ply")
    for attribute in ("means", "log_scales", "sh_dc", "sh_rest"):
        assert error(ours, theirs, attribute) < 1e-5
    assert error(ours, theirs, "opacities") < 1e-5
    # It reads .splat's bytes of rotation as b / 127.5 - 1, their writer as (b - 128) / 128: half a step apart.
    assert rotation_error(ours, theirs) < (0.01 if name.endswith(".splat") else 1e-3)


@pytest.mark.parametrize("suffix", [suffix for suffix in SUFFIXES if suffix not in (".ply", ".glb")])
@pytest.mark.needs("splat-transform")
def test_the_fields_converter_reads_what_we_write(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    ours = round_trip(sample(600, 2), path)
    splat_transform(path, tmp_path / "b.ply")
    theirs = formats.read(tmp_path / "b.ply")
    for attribute in ("means", "log_scales", "sh_dc", "sh_rest"):
        assert error(ours, theirs, attribute) < 1e-5
    assert error(ours, theirs, "opacities") < 1e-5
    assert rotation_error(ours, theirs) < (0.01 if suffix == ".splat" else 1e-3)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_rows_of_a_scene_and_others_after_them_are_written_as_one_file(tmp_path: Path, suffix: str) -> None:
    scene, others = sample(700, 1), sample(40, 1)
    rows = np.flatnonzero(np.arange(700) % 3)
    formats.write_selected(scene, rows, others, tmp_path / f"parts{suffix}")
    formats.write(concatenate([scene.select(rows), others]).replace(extras={}), tmp_path / f"whole{suffix}")
    assert (tmp_path / f"parts{suffix}").read_bytes() == (tmp_path / f"whole{suffix}").read_bytes()


# --- .splat


def test_known_bytes_of_splat(tmp_path: Path) -> None:
    path = tmp_path / "a.splat"
    path.write_bytes(struct.pack("<6f8B", 1, 2, 3, 0.5, 1, 2, 255, 0, 128, 255, 128, 255, 128, 128))
    gaussians = formats.read(path)
    np.testing.assert_array_equal(gaussians.means, [[1, 2, 3]])
    np.testing.assert_allclose(gaussians.scales, [[0.5, 1, 2]])
    np.testing.assert_allclose(0.5 + 0.28209479 * gaussians.sh_dc, [[1, 0, 128 / 255]], atol=1e-6)
    np.testing.assert_array_equal(gaussians.quaternions, [[0, 1, 0, 0]])
    assert np.isfinite(gaussians.opacity_logits).all()
    assert gaussians.opacities[0] > 0.9999


def test_view_dependent_colour_is_dropped_and_colours_are_clipped(tmp_path: Path) -> None:
    gaussians = sample(10, 2)
    again = round_trip(gaussians.replace(sh_dc=gaussians.sh_dc * 10), tmp_path / "a.splat")
    assert again.sh_degree == 0
    colours = 0.5 + 0.28209479 * again.sh_dc
    np.testing.assert_allclose(colours, np.clip(0.5 + 0.28209479 * 10 * gaussians.sh_dc, 0, 1), atol=0.51 / 255)


def test_four_zero_bytes_of_rotation_mean_none(tmp_path: Path) -> None:
    path = tmp_path / "a.splat"
    path.write_bytes(struct.pack("<6f8B", 0, 0, 0, 1, 1, 1, 9, 9, 9, 9, 128, 128, 128, 128))
    np.testing.assert_array_equal(formats.read(path).quaternions, [[1, 0, 0, 0]])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "zero Gaussians"),
        (bytes(33), "not whole rows"),
        (struct.pack("<6f8B", 0, 0, 0, 1, -1, 1, *[9] * 8), "negative scale in row 0"),
        (struct.pack("<6f8B", 0, np.nan, 0, 1, 1, 1, *[9] * 8), "means that cannot be used"),
        (struct.pack("<6f8B", 0, 0, 0, 1, np.inf, 1, *[9] * 8), "log_scales that cannot be used"),
    ],
)
def test_damaged_splat_files_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.splat"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        formats.read(path)


# --- SuperSplat's compressed PLY


def test_known_words_of_compressed_ply(tmp_path: Path) -> None:
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


def test_compressed_ply_without_colour_extremes(tmp_path: Path) -> None:
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


def test_damaged_compressed_ply_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.compressed.ply"
    compressed_ply.write(sample(300, 1), path)
    good = path.read_bytes()
    for old, new, message in [
        (b"element chunk 2", b"element chunk 1", "300 Gaussians cannot lie in 1 chunks"),
        (b"element sh 300", b"element sh 299", "not 9, 24 or 45 bytes"),
        (b"float min_x", b"float any_x", "lacks min_x"),
        (b"uint packed_scale", b"int packed_scale", "lacks packed_scale"),
        (b"uint packed_position", b"uint position", "lacks packed_position"),
    ]:
        path.write_bytes(good.replace(old, new))
        with pytest.raises(InputError, match=message):
            compressed_ply.read(path)
    path.write_bytes(good[:-1])
    with pytest.raises(InputError, match="truncated"):
        compressed_ply.read(path)
    start = good.index(b"end_header\n") + len(b"end_header\n")
    path.write_bytes(good[:start] + np.float32(np.nan).tobytes() + good[start + 4 :])
    assert np.count_nonzero(formats.read(path).blank) == 256

"""The table of formats: dispatch, conversion, agreement with the field's converter, and files made to do harm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from format_samples import ATTRIBUTES, error, real, rotation_error, round_trip, sample, splat_transform

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import FORMATS, compressed_ply, ply
from gaussian_trimmer.formats.packing import morton_order
from gaussian_trimmer.gaussians import concatenate

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


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_damage_anywhere_gives_one_sentence_or_finite_gaussians(tmp_path: Path, suffix: str) -> None:
    """Cut short, or with bytes overwritten: no other exception, no warning, no hang."""
    path = tmp_path / f"a{suffix}"
    formats.write(sample(40, 1), path)
    good = path.read_bytes()
    rng = np.random.default_rng(5)
    damaged = [good[: int(length)] for length in np.linspace(0, len(good) - 1, 25)]
    head = min(len(good), 5300)
    for _ in range(120):
        content = bytearray(good)
        for position in rng.integers(0, head if rng.random() < 0.7 else len(good), 3):
            content[position] = rng.choice([0, 1, 255, rng.integers(256)])
        damaged.append(bytes(content))
    refused = 0
    for content in damaged:
        path.write_bytes(content)
        try:
            gaussians = formats.read(path)
        except InputError as refusal:
            refused += 1
            assert str(refusal).endswith(".")
            assert "\n" not in str(refusal)
        else:
            assert np.isfinite(gaussians.means).all()
            assert np.isfinite(gaussians.sh_rest).all()
    assert refused > 10


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

"""SOG: both versions' tables, codebooks, round trips, damaged archives and textures."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from format_samples import ATTRIBUTES, error, round_trip, sample

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.packing import row_codebook, scalar_codebook
from gaussian_trimmer.formats.sog import decode_webp, encode_webp, read_meta
from gaussian_trimmer.io.reading import webp_size


def members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def rewrite(path: Path, contents: dict[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in contents.items():
            archive.writestr(name, data)


def with_meta(path: Path, **changes: Any) -> None:
    """Change entries of meta.json; names with two underscores reach one level down."""
    contents = members(path)
    meta = json.loads(contents["meta.json"])
    for name, value in changes.items():
        *outer, inner = name.split("__")
        (meta[outer[0]] if outer else meta)[inner] = value
    rewrite(path, {**contents, "meta.json": json.dumps(meta).encode()})


@pytest.mark.parametrize("opaque", [True, False])
def test_webp_keeps_channels_in_order(opaque: bool) -> None:
    pixels = np.random.default_rng(0).integers(1, 256, (8, 12, 4), dtype=np.uint8)
    if opaque:
        pixels[..., 3] = 255
    data = encode_webp(pixels)
    assert webp_size(data) == (12, 8)
    np.testing.assert_array_equal(decode_webp(data), pixels)


def test_colour_is_kept_down_to_the_faintest_opacity(tmp_path: Path) -> None:
    gaussians = sample(200, 0)
    again = round_trip(gaussians.replace(opacity_logits=np.full(200, -5.5, np.float32)), tmp_path / "a.sog")
    assert again.opacities.max() == pytest.approx(1 / 255)
    assert error(again, gaussians, "sh_dc") < 0.02


def test_version_1(tmp_path: Path) -> None:
    path = tmp_path / "a.sog"
    gaussians = round_trip(sample(300, 1), path)
    contents = members(path)
    two = json.loads(contents["meta.json"])
    one = {
        "means": {**two["means"], "shape": [300, 3]},
        "scales": {"mins": [-7, -6, -5], "maxs": [-1, -1, -1], "files": two["scales"]["files"]},
        "quats": two["quats"],
        "sh0": {"mins": [-1, -1, -1, -4], "maxs": [1, 1, 1, 4], "files": two["sh0"]["files"]},
        "shN": {"mins": -2, "maxs": 2, "files": two["shN"]["files"]},
    }
    rewrite(path, {**contents, "meta.json": json.dumps(one).encode()})
    again = formats.read(path)
    np.testing.assert_array_equal(again.means, gaussians.means)
    np.testing.assert_array_equal(again.quaternions, gaussians.quaternions)
    codes = np.searchsorted(np.array(two["scales"]["codebook"], np.float32), gaussians.log_scales)
    lows = np.array([-7, -6, -5])
    np.testing.assert_allclose(again.log_scales, lows + (-1 - lows) * codes / 255, atol=1e-5)
    np.testing.assert_allclose(again.opacity_logits, -4 + 8 * gaussians.opacities, atol=1e-4)
    codes = np.searchsorted(np.array(two["shN"]["codebook"], np.float32), gaussians.sh_rest)
    np.testing.assert_allclose(again.sh_rest, -2 + 4 * codes / 255, atol=1e-5)


def test_null_at_the_head_of_a_codebook_is_mended(tmp_path: Path) -> None:
    path = tmp_path / "a.sog"
    gaussians = round_trip(sample(300, 0), path)
    codebook = json.loads(members(path)["meta.json"])["scales"]["codebook"]
    with_meta(path, scales__codebook=[None, *codebook[1:]])
    again = formats.read(path)
    first = gaussians.log_scales == np.float32(codebook[0])
    assert first.any()
    np.testing.assert_array_equal(again.log_scales[~first], gaussians.log_scales[~first])
    np.testing.assert_allclose(again.log_scales[first], codebook[1] + (codebook[1] - codebook[255]) / 255, rtol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 3}, "version 3"),
        ({"count": 0}, "zero Gaussians"),
        ({"count": 10**9}, "announces 1000000000 Gaussians"),
        ({"count": 1000}, "pixels for 1000 Gaussians"),
        ({"means": 7}, "not that of a SOG"),
        ({"means__mins": [float("nan")] * 3}, "means that cannot be used"),
        ({"means__files": ["means_l.webp"] * 3}, "means has not the names of 2 files"),
        ({"quats__files": ["../../secret"]}, "no member '../../secret'"),
        ({"scales__codebook": [0.0] * 3}, "log_scales that cannot be used"),
        ({"shN__files": ["sh0.webp", "shN_labels.webp"]}, "palette of coefficients"),
        ({"shN__files": ["shN_centroids.webp", "means_u.webp"]}, "in a palette"),
    ],
)
def test_damaged_meta_is_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    path = tmp_path / "a.sog"
    formats.write(sample(300, 1), path)
    with_meta(path, **changes)
    with pytest.raises(InputError, match=message):
        formats.read(path)


def test_numbers_that_are_too_large_make_no_noise(tmp_path: Path) -> None:
    formats.write(sample(300, 1), tmp_path / "a.sog")
    with_meta(tmp_path / "a.sog", scales__codebook=[1e300] * 256)
    assert read_meta(tmp_path / "a.sog").count == 300


def test_damaged_archives_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.sog"
    formats.write(sample(300, 0), path)
    contents = members(path)
    big = bytearray(contents["quats.webp"])
    big[21:25] = b"\xff\xff\xff\x0f"  # 16384 x 16384 pixels
    bomb = json.dumps({"version": 2, "pad": " " * 2_000_000}).encode()
    quats = decode_webp(contents["quats.webp"])
    assert quats is not None
    quats[0, 0, 3] = 7
    for changes, message in [
        ({"quats.webp": bytes(big)}, "claims 16384 x 16384 pixels"),
        ({"quats.webp": contents["quats.webp"][:60]}, "not a WebP picture"),
        ({"quats.webp": encode_webp(quats)}, "which of its components is the largest"),
        ({"meta.json": b"["}, "not that of a SOG"),
        ({"meta.json": bomb}, "member 'meta.json' claims"),
    ]:
        rewrite(path, {**contents, **changes})
        with pytest.raises(InputError, match=message):
            formats.read(path)
    del contents["meta.json"]
    rewrite(path, contents)
    with pytest.raises(InputError, match=r"no member 'meta.json'"):
        formats.read(path)


def test_scalar_codebook_follows_the_values() -> None:
    values = np.concatenate([np.random.default_rng(0).normal(size=5000), [100.0]]).astype(np.float32)
    codebook, labels = scalar_codebook(values)
    assert (np.diff(codebook) >= 0).all()
    errors = np.abs(codebook[labels] - values)
    assert errors[-1] < 1e-4  # the outlier has an entry of its own
    assert np.sqrt(np.mean(errors**2)) < 0.02  # evenly spaced entries would give 0.11
    nearest = np.abs(values[:, None] - codebook).min(axis=1)
    np.testing.assert_allclose(errors, nearest, atol=1e-6)


def test_row_codebook_is_exact_where_it_can_be() -> None:
    distinct = np.random.default_rng(0).normal(size=(40, 9)).astype(np.float32)
    rows = distinct[np.random.default_rng(1).integers(0, 40, 900)]
    entries, labels = row_codebook(rows, 64)
    assert len(entries) <= 40
    np.testing.assert_array_equal(entries[labels], rows)


class TestUnbundled:
    """The files of a SOG in a folder of their own."""

    def unpacked(self, folder: Path) -> Path:
        formats.write(sample(300, 2), folder / "a.sog")
        (folder / "sog").mkdir()
        for name, data in members(folder / "a.sog").items():
            (folder / "sog" / name).write_bytes(data)
        return folder / "sog"

    def test_it_is_what_it_is_bundled(self, tmp_path: Path) -> None:
        folder, bundled = self.unpacked(tmp_path), formats.read(tmp_path / "a.sog")
        for path in (folder, folder / "meta.json"):
            found = formats.read(path)
            for name in ATTRIBUTES:
                np.testing.assert_array_equal(getattr(found, name), getattr(bundled, name))
        assert formats.written_suffix(folder / "meta.json") == ".sog"
        with pytest.raises(InputError, match=r"cannot be written: give it one of the endings \.ply"):
            formats.write(bundled, folder / "meta.json")

    def test_missing_and_foreign_textures_are_refused(self, tmp_path: Path) -> None:
        folder = self.unpacked(tmp_path)
        (folder / "quats.webp").rename(tmp_path / "quats.webp")
        with pytest.raises(InputError, match=r"no texture 'quats\.webp'"):
            formats.read(folder)
        text = (folder / "meta.json").read_text()
        (folder / "meta.json").write_text(text.replace("quats.webp", "../quats.webp"))
        with pytest.raises(InputError, match="no texture"):
            formats.read(folder)

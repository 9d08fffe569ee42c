"""PlayCanvas' SOG: a zip of lossless WebP textures, a pixel a Gaussian, and a meta.json that says what bytes mean.

Version 2 looks bytes up in codebooks, version 1 spreads them evenly between a least and a greatest value; both become
tables of 256 values here.

Textures are filled row by row in the order of the Gaussians. Unbundled, the same files lie in a folder.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.formats.packing import (
    ByteArray,
    check_count,
    drop_largest,
    from_levels,
    opacity_bytes,
    opacity_logits_of,
    restore_largest,
    row_codebook,
    scalar_codebook,
    to_levels,
)
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, SplatModel
from gaussian_trimmer.io.reading import (
    decoded_picture,
    file_bytes,
    is_file,
    member_bytes,
    open_archive,
    reading,
    webp_size,
)
from gaussian_trimmer.io.writing import atomic_file

META = "meta.json"
"""What the file is called that says what the textures mean."""
_COEFFICIENTS = (3, 8, 15)
_PALETTE_SIZE = 1 << 16
_PALETTE_COLUMNS = 64
_LOSSLESS = 101
_MAX_META_BYTES = 1 << 20
_FREE_PIXELS = _PALETTE_SIZE * max(_COEFFICIENTS)
"""Pixels that a texture may have beyond twice as many as there are Gaussians: those of the largest palette."""
_ROTATION_RANGE = float(np.sqrt(0.5))
_FIRST_TAG = 252
"""Alpha of a rotation's pixel when w is the largest component; 253, 254 and 255 say x, y and z."""
_FILES = {"means": 2, "scales": 1, "quats": 1, "sh0": 1, "shN": 2}
"""How many textures each attribute has."""


def read(path: Path) -> Gaussians:
    """Return the Gaussians of a SOG of version 1 or 2, rows in texture order.

    Args:
        path: a .sog file, or the meta.json of an unbundled one, whose textures lie in the same folder.

    Raises:
        InputError: a file cannot be read, is not a SOG, is damaged, or announces more than the sizes of the files can
            hold.
    """
    with _opened(path) as (meta, contents):
        return _decode(contents, meta, path)


def read_meta(path: Path) -> SogMeta:
    """Return what the meta.json of a SOG says, which must not be more than its files can hold; errors as of `read`."""
    with _opened(path) as (meta, _):
        return meta


def scene_files(path: Path, _: int | None = None) -> list[Path]:
    """Return the files that a SOG consists of; errors as of `read`."""
    if path.name.lower() != META:
        return [path]
    meta = parse_meta(file_bytes(path, _MAX_META_BYTES), path)
    return [path, *(_beside(path, name) for names in meta.files.values() for name in names)]


@contextmanager
def _opened(path: Path) -> Iterator[tuple[SogMeta, Callable[[str], bytes]]]:
    """Give the meta.json of a SOG, and a function from the name of a texture to the contents of its file."""
    if path.name.lower() == META:
        meta = parse_meta(file_bytes(path, _MAX_META_BYTES), path)
        textures = {name: _beside(path, name) for names in meta.files.values() for name in names}
        check_count(meta.count, path, sum(texture.stat().st_size for texture in textures.values()))
        with reading(*textures.values()):
            yield meta, lambda name: file_bytes(textures[name])
        return
    with open_archive(path, ".sog file") as archive:
        meta = parse_meta(member_bytes(archive, META, _MAX_META_BYTES, path), path)
        check_count(meta.count, path)
        most = path.stat().st_size
        yield meta, lambda name: member_bytes(archive, name, most, path)


def _beside(path: Path, name: str) -> Path:
    """Return a texture in the folder of a meta.json, and nowhere else."""
    texture = path.parent / name
    if name != texture.name or not is_file(texture):
        raise InputError(
            f"There is no texture '{clip_name(name)}' beside '{path}'; an unbundled SOG needs all files of its folder."
        )
    return texture


def _decode(contents: Callable[[str], bytes], meta: SogMeta, path: Path) -> Gaussians:
    """Return the Gaussians of a meta.json and of textures, whose files' contents are given by name."""
    n = meta.count

    def texture(attribute: str, place: int) -> ByteArray:
        name = meta.files[attribute][place]
        data = contents(name)
        width, height = webp_size(data) or (0, 0)
        if width * height > 2 * n + _FREE_PIXELS:
            raise InputError(f"'{path}' is damaged: its texture '{clip_name(name)}' claims {width} x {height} pixels.")
        pixels = decode_webp(data)
        if pixels is None:
            raise InputError(f"'{path}' is damaged: its texture '{clip_name(name)}' is not a WebP picture.")
        return pixels

    def first_pixels(attribute: str, place: int = 0) -> ByteArray:
        pixels = texture(attribute, place).reshape(-1, 4)
        if len(pixels) < n:
            raise InputError(f"'{path}' is damaged: a texture has {len(pixels)} pixels for {n} Gaussians.")
        return pixels[:n]

    levels = first_pixels("means", 0)[:, :3] | first_pixels("means", 1)[:, :3].astype(np.uint16) << 8
    quats, scales, sh0 = (first_pixels(name) for name in ("quats", "scales", "sh0"))
    if (quats[:, 3] < _FIRST_TAG).any():
        raise InputError(f"'{path}' is damaged: a rotation does not say which of its components is the largest.")
    others = from_levels(quats[:, :3], -_ROTATION_RANGE, _ROTATION_RANGE, 8)
    sh_rest = np.zeros((n, 3, 0), np.float32)
    if meta.sh is not None:
        sh_rest = _decode_sh(texture("shN", 0), first_pixels("shN", 1), meta.sh, path)
    channels = np.arange(3)
    return Gaussians(
        means=_linear_of(from_levels(levels, meta.mins, meta.maxs, 16)).astype(np.float32),
        log_scales=meta.scales[scales[:, :3], channels],
        quaternions=restore_largest(quats[:, 3] - _FIRST_TAG, others),
        opacity_logits=meta.opacity_logits[sh0[:, 3]],
        sh_dc=meta.colours[sh0[:, :3], channels],
        sh_rest=sh_rest,
        model=meta.model,
    )


def _decode_sh(centroids: ByteArray, label_pixels: ByteArray, values: FloatArray, path: Path) -> FloatArray:
    """Return coefficients (N, 3, K) of the palette's texture (H, W, 4) and of each Gaussian's row in it (N, 4)."""
    k, remainder = divmod(centroids.shape[1], _PALETTE_COLUMNS)
    if k not in _COEFFICIENTS or remainder:
        raise InputError(f"'{path}' is damaged: its palette of coefficients is {centroids.shape[1]} pixels wide.")
    palette = centroids[..., :3].reshape(-1, k, 3)
    pixels = label_pixels.astype(np.int64)
    labels = pixels[:, 0] | pixels[:, 1] << 8
    if labels.max() >= len(palette):
        raise InputError(f"'{path}' is damaged: a Gaussian asks for row {labels.max()} of {len(palette)} in a palette.")
    coefficients: FloatArray = values[palette.transpose(0, 2, 1)][labels]
    return coefficients


def write(gaussians: Gaussians, path: Path) -> None:
    """Write a .sog file of version 2 in the given order.

    View-dependent colours become a palette of at most 65,536 rows. The colour of a Gaussian whose opacity rounds to
    zero is lost: lossless WebP keeps none where alpha is zero.

    Raises:
        InputError: there are no Gaussians, which this format cannot hold.
    """
    textures, meta = _encode(gaussians)
    with atomic_file(path) as part, zipfile.ZipFile(part, "w") as archive:
        for name, texture in textures.items():
            archive.writestr(zipfile.ZipInfo(name), encode_webp(texture))
        archive.writestr(zipfile.ZipInfo(META), json.dumps(meta), zipfile.ZIP_DEFLATED)


def _encode(gaussians: Gaussians) -> tuple[dict[str, ByteArray], dict[str, Any]]:
    """Textures by file name, and meta.json."""
    logs = _log_of(gaussians.means)
    mins, maxs = logs.min(axis=0), logs.max(axis=0)
    levels = to_levels(logs, mins, maxs, 16)
    largest, others = drop_largest(gaussians.quaternions)
    quats = np.column_stack([to_levels(others, -_ROTATION_RANGE, _ROTATION_RANGE, 8), largest + _FIRST_TAG])
    scale_codebook, scales = scalar_codebook(gaussians.log_scales)
    colour_codebook, colours = scalar_codebook(gaussians.sh_dc)
    textures = {
        "means_l.webp": _texture(levels & 0xFF),
        "means_u.webp": _texture(levels >> 8),
        "scales.webp": _texture(scales),
        "quats.webp": _texture(quats),
        "sh0.webp": _texture(np.column_stack([colours, opacity_bytes(gaussians)])),
    }
    meta: dict[str, Any] = {
        "version": 2,
        "count": len(gaussians),
        "means": {"mins": mins.tolist(), "maxs": maxs.tolist(), "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": scale_codebook.tolist(), "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": colour_codebook.tolist(), "files": ["sh0.webp"]},
    }
    if gaussians.model != "default":
        meta["model"] = gaussians.model
    if gaussians.sh_degree:
        palette, labels = row_codebook(gaussians.sh_rest.reshape(len(gaussians), -1), _PALETTE_SIZE)
        codebook, entries = scalar_codebook(palette)
        textures["shN_centroids.webp"] = _palette_texture(entries.reshape(len(palette), 3, -1))
        textures["shN_labels.webp"] = _texture(np.column_stack([labels & 0xFF, labels >> 8, np.zeros_like(labels)]))
        meta["shN"] = {
            "count": len(palette),
            "bands": gaussians.sh_degree,
            "codebook": codebook.tolist(),
            "files": ["shN_centroids.webp", "shN_labels.webp"],
        }
    return textures, meta


def _texture(values: NDArray[Any]) -> ByteArray:
    """Return a nearly square texture (H, W, 4), sides multiples of four, of one pixel a row of bytes (N, 3 or 4)."""
    n = len(values)
    width = 4 * int(np.ceil(np.sqrt(n) / 4))
    height = 4 * -(-n // (4 * width))
    texture = np.zeros((height * width, 4), np.uint8)
    texture[:, 3] = 255
    texture[:n, : values.shape[1]] = values
    return texture.reshape(height, width, 4)


def _palette_texture(entries: ByteArray) -> ByteArray:
    """Return the palette (P, 3, K) as a texture: 64 rows of it beside each other, each K pixels wide."""
    n, _, k = entries.shape
    texture = np.full((-(-n // _PALETTE_COLUMNS) * _PALETTE_COLUMNS, k, 4), 255, np.uint8)
    texture[:n, :, :3] = entries.transpose(0, 2, 1)
    texture[n:, :, :3] = 0
    return texture.reshape(-1, _PALETTE_COLUMNS * k, 4)


def _log_of(values: FloatArray) -> Float64Array:
    """sign(x) log(1 + |x|): fine near the origin, coarse far away."""
    wide = values.astype(np.float64)
    return np.asarray(np.sign(wide) * np.log1p(np.abs(wide)))


def _linear_of(logs: Float64Array) -> Float64Array:
    """Inverse of `_log_of`."""
    return np.asarray(np.sign(logs) * np.expm1(np.abs(logs)))


def encode_webp(pixels: ByteArray) -> bytes:
    """A lossless WebP file of pixels (H, W, 4), red, green, blue, alpha; colours under an alpha of zero are lost."""
    done, data = cv2.imencode(".webp", pixels[..., [2, 1, 0, 3]], [cv2.IMWRITE_WEBP_QUALITY, _LOSSLESS])
    assert done
    return bytes(data)


def decode_webp(data: bytes) -> ByteArray | None:
    """Pixels (H, W, 4), red, green, blue, alpha, of a WebP file; None if it is damaged."""
    image = decoded_picture(data, cv2.IMREAD_UNCHANGED)
    if image is None or image.ndim != 3 or image.dtype != np.uint8:
        return None
    pixels = np.full((*image.shape[:2], 4), 255, np.uint8)
    pixels[..., :3] = image[..., 2::-1]
    if image.shape[2] == 4:
        pixels[..., 3] = image[..., 3]
    return pixels


@dataclass(frozen=True, eq=False)
class SogMeta:
    """What meta.json says, checked."""

    count: int
    mins: Float64Array
    """Least centre, as sign(x) log(1 + |x|), (3,)."""
    maxs: Float64Array
    """Greatest centre, (3,)."""
    scales: FloatArray
    """Log scales by byte and axis, (256, 3)."""
    colours: FloatArray
    """Degree-0 coefficients by byte and channel, (256, 3)."""
    opacity_logits: FloatArray
    """Opacity logits by byte, (256,)."""
    sh: FloatArray | None
    """Coefficients of degrees 1 to 3 by byte, (256,), where there are any."""
    files: dict[str, list[str]]
    """Names of the textures by attribute: means, scales, quats, sh0, shN."""
    model: SplatModel


@np.errstate(over="ignore", invalid="ignore")  # what damaged numbers become is found where they are used
def parse_meta(data: bytes, path: Path) -> SogMeta:
    """Return what the meta.json of a SOG file of version 1 or 2 says.

    Raises:
        InputError: it is not that of a SOG.
    """
    try:
        meta = json.loads(data)
        version = meta.get("version", 1)
        if version not in (1, 2):
            raise ValueError(f"it is of version {version}; versions 1 and 2 can be read")
        files = {name: meta[name]["files"] for name in _FILES if name != "shN" or meta.get("shN")}
        for name, names in files.items():
            if len(names) != _FILES[name] or not all(isinstance(file, str) for file in names):
                raise ValueError(f"{name} has not the names of {_FILES[name]} files")
        mins, maxs = (np.array(meta["means"][end], np.float64).reshape(3) for end in ("mins", "maxs"))
        count = int(meta["count"] if version == 2 else meta["means"]["shape"][0])
        tables = _tables(meta)
    except (ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError) as error:
        raise InputError(
            f"'{path}' is damaged: its meta.json is not that of a SOG, {clip_name(str(error))}."
        ) from error
    model = meta.get("model")
    return SogMeta(count, mins, maxs, *tables, files, model if model in ("antialiased", "2dgs") else "default")


def _tables(meta: dict[str, Any]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
    """Tables of log scales, colours, opacity logits and coefficients."""
    sh = meta.get("shN")
    if meta.get("version", 1) == 1:
        colours = _range(meta["sh0"], 4)
        return _range(meta["scales"], 3), colours[:, :3], colours[:, 3], _range(sh, 1)[:, 0] if sh else None
    scales, colours = (np.repeat(_codebook(meta[name])[:, None], 3, axis=1) for name in ("scales", "sh0"))
    return scales, colours, opacity_logits_of(np.arange(256, dtype=np.uint8)), _codebook(sh) if sh else None


def _range(entry: dict[str, Any], width: int) -> FloatArray:
    """Return the values (256, width) that bytes of version 1 mean."""
    low, high = (np.array(entry[end], np.float64).reshape(width) for end in ("mins", "maxs"))
    return from_levels(np.arange(256)[:, None], low, high, 8).astype(np.float32)


def _codebook(entry: dict[str, Any]) -> FloatArray:
    """Return a codebook (256,) of version 2; entries that are not there are NaN, so that their use is found."""
    values = np.array(entry["codebook"], np.float32).reshape(-1)[:256]
    if len(values) == 256 and np.isnan(values[0]):
        values[0] = values[1] + (values[1] - values[255]) / 255  # an early writer left null here; viewers mend it so
    return np.pad(values, (0, 256 - len(values)), constant_values=np.nan)

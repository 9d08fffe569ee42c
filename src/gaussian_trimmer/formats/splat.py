"""The .splat file of antimatter15's viewer: no header, 32 bytes a Gaussian, no view-dependent colour."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.packing import (
    colours_of,
    linear_scales,
    log_scales_of,
    opacity_bytes,
    opacity_logits_of,
    sh_dc_of,
    to_levels,
)
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.io.reading import file_bytes
from gaussian_trimmer.io.writing import atomic_file, write_array

ROW = np.dtype([("mean", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("rotation", "u1", 4)])
"""One Gaussian: its centre, standard deviations, colour with opacity, and rotation (w, x, y, z)."""


def read(path: Path) -> Gaussians:
    """Return the Gaussians of a .splat file, rows in file order; a rotation of four zeros is read as none.

    Raises:
        InputError: the file cannot be read, is not whole rows, is empty, or holds negative or non-finite values.
    """
    data = file_bytes(path)
    if len(data) % ROW.itemsize:
        raise InputError(
            f"'{path}' is not a .splat file or truncated: {len(data)} bytes are not whole rows of 32 bytes."
        )
    if not data:
        raise InputError(f"'{path}' holds zero Gaussians.")
    rows = np.frombuffer(data, ROW)
    quaternions = (rows["rotation"].astype(np.float32) - 128.0) / 128.0
    quaternions[~quaternions.any(axis=1), 0] = 1.0
    return Gaussians(
        means=rows["mean"].astype(np.float32),
        log_scales=log_scales_of(rows["scale"], path),
        quaternions=quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True),
        opacity_logits=opacity_logits_of(rows["rgba"][:, 3]),
        sh_dc=sh_dc_of(rows["rgba"][:, :3] / 255.0),
        sh_rest=np.zeros((len(rows), 3, 0), np.float32),
    )


def write(gaussians: Gaussians, path: Path) -> None:
    """Write a .splat file in the given order; colours are clipped to 0 ... 1 and lose their view-dependent part."""
    unit = gaussians.quaternions / np.linalg.norm(gaussians.quaternions, axis=1, keepdims=True)
    rows = np.empty(len(gaussians), ROW)
    rows["mean"] = gaussians.means
    rows["scale"] = linear_scales(gaussians)
    rows["rgba"][:, :3] = to_levels(colours_of(gaussians.sh_dc), 0.0, 1.0, 8)
    rows["rgba"][:, 3] = opacity_bytes(gaussians)
    rows["rotation"] = np.clip(np.rint(unit * 128.0 + 128.0), 0, 255)
    with atomic_file(path) as part, part.open("wb") as file:
        write_array(file, rows)

"""Gaussians, real files and comparisons that the tests of the formats share."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import benchmark_data
import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians

ATTRIBUTES = ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest")


def sample(n: int = 600, degree: int = 3, seed: int = 0) -> Gaussians:
    """Random Gaussians within what every format holds without clipping."""
    rng = np.random.default_rng(seed)
    k = (degree + 1) ** 2 - 1
    return Gaussians(
        means=rng.normal(0, 3, (n, 3)).astype(np.float32),
        log_scales=rng.uniform(-7, -1, (n, 3)).astype(np.float32),
        quaternions=rng.normal(0, 2, (n, 4)).astype(np.float32),
        opacity_logits=rng.uniform(-6, 6, n).astype(np.float32),
        sh_dc=rng.uniform(-1.5, 1.5, (n, 3)).astype(np.float32),
        sh_rest=rng.uniform(-0.9, 0.9, (n, 3, k)).astype(np.float32),
    )


def unit(quaternions: FloatArray) -> Float64Array:
    wide = quaternions.astype(np.float64)
    return np.asarray(wide / np.linalg.norm(wide, axis=1, keepdims=True))


def rotation_error(a: Gaussians, b: Gaussians) -> float:
    """Greatest distance of the unit quaternions, of which q and -q are one rotation."""
    p, q = unit(a.quaternions), unit(b.quaternions)
    return float(np.minimum(np.linalg.norm(p - q, axis=1), np.linalg.norm(p + q, axis=1)).max())


def error(a: Gaussians, b: Gaussians, name: str) -> float:
    """Greatest difference in an attribute; 'opacities' is one too."""
    x, y = getattr(a, name).astype(np.float64), getattr(b, name).astype(np.float64)
    assert x.shape == y.shape
    return float(np.abs(x - y).max(initial=0.0))


def smallest_three_error(levels: int) -> float:
    """Bound of the rotation error when three components are rounded to one of `levels` values in +-sqrt(1/2).

    Each is off by half a step at most; the fourth, at least 1/2, follows from the unit length and is off by at most
    sqrt(3) times their joint error, which makes twice that in all; a tenth is for the terms of second order.
    """
    half_step = np.sqrt(0.5) / (levels - 1)
    return float(1.1 * 2 * np.sqrt(3) * half_step)


def splat_transform(source: Path, target: Path) -> None:
    """Convert with the field's converter: npm install -g @playcanvas/splat-transform."""
    program = os.environ.get("SPLAT_TRANSFORM", "splat-transform")
    subprocess.run([program, "-q", "-w", str(source), str(target)], check=True, capture_output=True, timeout=120)


def real(name: str) -> Path:
    """A real capture, or skip the test where there is none."""
    return benchmark_data.find(f"real/{name}")


def round_trip(gaussians: Gaussians, path: str | Path) -> Gaussians:
    formats.write(gaussians, path)
    return formats.read(path)

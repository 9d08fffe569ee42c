"""What Gaussians would lose in each format: what is left out, cut off and rounded, with the numbers of this scene.

Stated are bounds that follow from the formats (docs/formats.md); nothing is written to find them.
"""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.formats.packing import colours_of
from gaussian_trimmer.gaussians import BoolArray, Gaussians

_CHUNK = 256
_STEPS_OF_CHUNK = np.array([2047, 1023, 2047])
"""Steps that a compressed PLY divides the range of 256 centres into, along x, y and z."""
_SPZ_BITS, _SPZ_MOST_FRACTIONAL = 23, 23
_SPZ_SCALES = (-10.0, 255 / 16 - 10.0)
_SPZ_COLOURS = 0.5 / 0.15
_COMPRESSED_SH = 4.0


def losses(gaussians: Gaussians) -> dict[str, str]:
    """For each format by its suffix, what Gaussians would lose in it; an empty text where that is nothing."""
    found = {
        ".ply": [],
        ".compressed.ply": _in_compressed_ply(gaussians),
        ".splat": _in_splat(gaussians),
        ".spz": _in_spz(gaussians),
        ".sog": _in_sog(gaussians),
        ".ksplat": _in_ksplat(gaussians),
        ".glb": [],
    }
    extra = ["leaves out the extra columns"] if gaussians.extras else []
    return {suffix: "; ".join([*extra, *parts]) for suffix, parts in found.items()}


def _in_compressed_ply(gaussians: Gaussians) -> list[str]:
    parts = [f"moves centres by up to {_half_step_of_chunks(gaussians):.2g} in this order of rows (--sort: less)"]
    parts += _cut("view-dependent colours beyond 4", np.abs(gaussians.sh_rest) > _COMPRESSED_SH)
    return [*parts, "10 bits for rotations, 8 for colours and opacities"]


def _half_step_of_chunks(gaussians: Gaussians) -> float:
    """The most that a centre moves when each 256 rows share a range."""
    starts = np.arange(0, len(gaussians), _CHUNK)
    high = np.maximum.reduceat(gaussians.means, starts, axis=0)
    low = np.minimum.reduceat(gaussians.means, starts, axis=0)
    return float(np.linalg.norm((high - low) / _STEPS_OF_CHUNK / 2, axis=1).max())


def _in_splat(gaussians: Gaussians) -> list[str]:
    colours = colours_of(gaussians.sh_dc)
    parts = [f"loses spherical harmonics of degrees 1 to {gaussians.sh_degree}"] if gaussians.sh_degree else []
    parts += _cut("colours beyond 0 and 1", (colours < 0) | (colours > 1))
    return [*parts, "8 bits for rotations, colours and opacities"]


def _in_spz(gaussians: Gaussians) -> list[str]:
    reach = max(float(np.abs(gaussians.means).max()), 1e-6)
    bits = min(_SPZ_MOST_FRACTIONAL, int(np.floor(np.log2((2**_SPZ_BITS - 1) / reach))))
    if bits < 0:
        return [f"cannot be written: coordinates up to {reach:.3g} are beyond 8388607"]
    low, high = _SPZ_SCALES
    parts = [f"moves centres by up to {np.sqrt(3) / 2 * 2.0**-bits:.2g}"]
    parts += _cut("scales beyond e^-10 and e^5.94", (gaussians.log_scales < low) | (gaussians.log_scales > high))
    parts += _cut("colours", np.abs(gaussians.sh_dc) > _SPZ_COLOURS)
    parts += _cut("view-dependent colours beyond 1", np.abs(gaussians.sh_rest) > 1)
    return [*parts, "10 bits for rotations, 8 for scales, colours and opacities"]


def _in_sog(gaussians: Gaussians) -> list[str]:
    logs = np.log1p(np.abs(gaussians.means.astype(np.float64)))
    signed = np.sign(gaussians.means) * logs
    half_steps = (signed.max(axis=0) - signed.min(axis=0)) / 65535 / 2 * np.exp(logs)
    parts = [f"moves centres by up to {np.linalg.norm(half_steps, axis=1).max():.2g}"]
    if gaussians.sh_degree:
        parts.append("view-dependent colours from at most 65,536 sets")
    return [*parts, "256 values for scales and for colours, 8 bits for rotations and opacities"]


def _in_ksplat(gaussians: Gaussians) -> list[str]:
    colours = colours_of(gaussians.sh_dc)
    parts = ["loses spherical harmonics of degree 3"] if gaussians.sh_degree > 2 else []
    parts += _cut("colours beyond 0 and 1", (colours < 0) | (colours > 1))
    return [*parts, "8 bits for colours and opacities"]


def _cut(what: str, beyond: BoolArray) -> list[str]:
    """A part on what is cut off, if anything; which values are is given, (N, ...)."""
    number = int(np.count_nonzero(beyond.reshape(len(beyond), -1).any(axis=1)))
    return [f"cuts off {what} of {number:,} Gaussians"] if number else []

"""Splat files for the programs that show them: in a format that each reads, turned so that they stand upright there.

`docs/engines.md` says where the facts come from, and what remains to be set in each program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, quaternions_of, rotation_matrices

if TYPE_CHECKING:  # conversions need no trimmer
    from gaussian_trimmer.output.result import TrimResult

EngineName = Literal["blender", "cesium", "playcanvas", "three", "unity", "unreal"]
_DOWN_Y = (0.0, -1.0, 0.0)
_BAND_ENDS = (0, 3, 8, 15)
"""Where the coefficients of degrees 1, 2 and 3 begin and end."""
_CHUNK = 1 << 18


@dataclass(frozen=True)
class Engine:
    """What a program expects of a splat file."""

    name: str
    """As the program calls itself."""
    reads: tuple[str, ...]
    """Endings of files that it reads; the first is the usual one."""
    up: tuple[float, float, float]
    """Where up must point in the file so that the object stands upright."""


ENGINES: dict[str, Engine] = {
    "blender": Engine("Blender", (".ply",), (0.0, 0.0, 1.0)),
    "cesium": Engine("Cesium", (".ply",), _DOWN_Y),
    "playcanvas": Engine("PlayCanvas", (".sog", ".ply", ".compressed.ply"), _DOWN_Y),
    "three": Engine("three.js", (".spz", ".ply", ".compressed.ply", ".splat", ".ksplat", ".sog"), (0.0, 1.0, 0.0)),
    "unity": Engine("Unity", (".ply", ".spz"), _DOWN_Y),
    "unreal": Engine("Unreal", (".ply",), _DOWN_Y),
}
assert tuple(ENGINES) == get_args(EngineName)


def engine_files(engine: EngineName) -> tuple[str, str]:
    """Names of the files that `write_for_engine` writes: the object's, and the background's."""
    suffix = ENGINES[engine].reads[0]
    return f"object_for_{engine}{suffix}", f"background_for_{engine}{suffix}"


def write_for_engine(result: TrimResult, engine: EngineName, folder: Path) -> None:
    """Write object and background of a trim for a program into an existing folder; an empty background is not written.

    Raises:
        InputError: a file cannot be written, or the format cannot hold the Gaussians.
    """
    for gaussians, name in zip((result.object, result.background), engine_files(engine), strict=True):
        if len(gaussians):
            formats.write(upright(gaussians, result.up.direction, engine), folder / name)


def upright(gaussians: Gaussians, up: Sequence[float] | Float64Array, engine: EngineName) -> Gaussians:
    """Gaussians as a program expects them: turned about the origin by the smallest angle that makes them upright.

    Args:
        gaussians: N Gaussians.
        up: the unit up vector in their coordinates.
        engine: name of the program.
    """
    return turned(gaussians, rotation_between(np.asarray(up, np.float64), np.array(ENGINES[engine].up)))


def rotation_between(source: Float64Array, target: Float64Array) -> Float64Array:
    """The smallest rotation (3, 3) from one unit vector to another; of opposite ones, half a turn about some axis.

    >>> rotation_between(np.array([0.0, -1, 0]), np.array([0.0, 0, 1])) @ [0, -1, 0]
    array([0., 0., 1.])
    """
    middle = source + target
    if np.linalg.norm(middle) < 1e-9:
        middle = np.cross(source, np.eye(3)[np.argmin(np.abs(source))])
        middle /= np.linalg.norm(middle)
        return np.asarray(2 * np.outer(middle, middle) - np.eye(3))
    # Two reflections: in the plane across the source, then in the one across the middle.
    return np.asarray(
        (np.eye(3) - 2 * np.outer(middle, middle) / (middle @ middle)) @ (np.eye(3) - 2 * np.outer(source, source))
    )


def turned(gaussians: Gaussians, rotation: Float64Array) -> Gaussians:
    """Gaussians turned about the origin: centres, shapes and view-dependent colours.

    Args:
        gaussians: N Gaussians.
        rotation: from old to new coordinates, (3, 3).
    """
    if np.allclose(rotation, np.eye(3), atol=1e-12):
        return gaussians
    quaternions = np.empty_like(gaussians.quaternions)
    for start in range(0, len(gaussians), _CHUNK):
        rows = slice(start, start + _CHUNK)
        quaternions[rows] = quaternions_of(rotation @ rotation_matrices(gaussians.quaternions[rows]))
    sh_rest = gaussians.sh_rest.copy()
    for first, end in pairwise(_BAND_ENDS):
        if end <= sh_rest.shape[2]:
            sh_rest[:, :, first:end] = gaussians.sh_rest[:, :, first:end] @ _turn_of_band(rotation, first, end)
    means = (gaussians.means.astype(np.float64) @ rotation.T).astype(np.float32)
    return replace(gaussians, means=means, quaternions=quaternions, sh_rest=sh_rest)


def _turn_of_band(rotation: Float64Array, first: int, end: int) -> FloatArray:
    """What a rotation does to the coefficients of one degree, to be multiplied from the right.

    A turned harmonic is a sum of harmonics of its own degree, so values in a few directions determine it.
    """
    from gaussian_trimmer.rendering.reference import sh_basis

    directions = np.random.default_rng(0).normal(size=(64, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before = sh_basis(directions @ rotation)[:, first + 1 : end + 1]
    after = sh_basis(directions)[:, first + 1 : end + 1]
    return np.asarray(np.linalg.lstsq(after, before, rcond=None)[0].T, np.float32)

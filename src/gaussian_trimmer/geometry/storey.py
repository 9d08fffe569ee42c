"""The floor and ceiling of a capture: horizontal layers that cover its plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import up_frame
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians, IntArray, mask_of_rows, rotation_matrices

_MAX_TILT_COSINE, _MAX_THICKNESS = 0.9, 0.5
"""Cosine of the tilt of a horizontal Gaussian, and its largest thickness relative to its width."""
_END_PERCENTILES = (0.5, 99.5)
"""Heights beyond these percentiles are not looked at."""
_BINS, _CELLS = 200, 150
"""Number of layers between the ends, and of cells along the longer side of the plan."""
_LAYER_BINS = 3
"""Thickness of a layer, in bins."""
_MIN_STOREY = 0.05
"""Smallest height of a storey, relative to that of the capture."""
_CEILING_SHARE = 0.5
"""Share of the floor's cells that a ceiling covers at least."""
MIN_FLOOR = 0.1
"""Share of the plan's square that the floor of a room covers at least: a flat's covers 0.3, the lid of a thing 0.04."""
_SAMPLE_SIZE = 200_000
TILE_SIDES = 8.0, 4.0, 2.0
"""Sides of tiles, relative to the height of what stands in a place, from a whole room to a chair: a thing is whole in
tiles of one size, and large enough to be seen in another."""
_THING_PERCENTILES = (2, 98)
"""Percentiles of the heights between which things are."""
_LOWEST = 0.01
"""Smallest height of things, relative to the width of the ground that they stand on; it bounds the number of tiles."""


@dataclass(frozen=True)
class Storey:
    """Heights along the up vector."""

    floor: float
    ceiling: float | None
    """None outdoors, and where the ceiling was not captured."""
    area: float
    """Area of the plan that the larger of both covers, in square scene units."""
    share: float
    """That area, relative to the square of the plan's longer side."""
    is_upright: bool
    """Whether more of what lies level is above the floor or, below a ceiling, in the lower half: tables and seats."""

    @property
    def is_room(self) -> bool:
        """Whether a ceiling is above the floor, and both are as wide as those of a room."""
        return self.ceiling is not None and self.share >= MIN_FLOOR

    @property
    def head_height(self) -> float:
        """Height at which the capture is cut to look in from above: half way to the ceiling; infinite without one."""
        return np.inf if self.ceiling is None else (self.floor + self.ceiling) / 2


def find_storey(scene: Gaussians, up: Float64Array) -> Storey:
    """Find floor and ceiling: the two horizontal layers that cover most cells of the plan.

    Args:
        scene: all N Gaussians.
        up: the up vector, (3,).
    """
    axes = up_frame(up)
    points = scene.means.astype(np.float64) @ axes.T  # (N, 3), heights last
    rows = np.flatnonzero(_is_horizontal(scene, axes[2]))
    if not len(rows):
        return Storey(float(np.percentile(points[:, 2], _END_PERCENTILES[0])), None, 0.0, 0.0, True)
    low, high = np.percentile(points[:, 2], _END_PERCENTILES)
    bin_height = max(float(high - low), 1e-9) / (_BINS - 2 * _LAYER_BINS)
    low -= _LAYER_BINS * bin_height  # what lies in the lowest and the highest layer is spread around their heights
    covered, cell = _covered_cells(points[rows], float(low), bin_height)
    first = int(np.argmax(covered))
    others, margin = covered.copy(), int(_MIN_STOREY * _BINS)
    others[max(0, first - margin) : first + margin + 1] = 0
    second = int(np.argmax(others))
    found = float(covered[first]) * cell**2, float(covered[first]) / _CELLS**2
    floor, ceiling = (float(low + (place + 0.5) * bin_height) for place in sorted((first, second)))
    if others[second] < _CEILING_SHARE * covered[first]:
        upright = others[first:].sum() >= others[:first].sum()
        return Storey(float(low + (first + 0.5) * bin_height), None, *found, bool(upright))
    others[max(0, second - margin) : second + margin + 1] = 0
    middle = (first + second) // 2
    upright = others[min(first, second) : middle].sum() >= others[middle : max(first, second)].sum()
    return Storey(floor, ceiling, *found, bool(upright))


def tile_sides(storey: Storey, heights: Float64Array) -> tuple[float, ...]:
    """Return the sides of the tiles of each size, in scene units; none of a place that one look from around shows.

    Such a place has no ceiling, and a floor or ground no wider than the largest tile, or nothing that stands on it.

    Args:
        storey: where floor and ceiling are.
        heights: of all N Gaussians, (N,).
    """
    shown, width = heights[heights < storey.head_height], float(np.sqrt(storey.area))
    if not len(shown):
        return ()
    low, high = np.percentile(shown, _THING_PERCENTILES)
    sides = tuple(share * (float(high) - storey.floor) for share in TILE_SIDES)
    is_wide = TILE_SIDES[0] * (high - low) < width < (high - low) / _LOWEST
    return sides if storey.is_room or is_wide else ()


def sampled(scene: Gaussians) -> Gaussians:
    """Return a part of the Gaussians, evenly spread over the rows, uncopied: as many as tell where layers are."""
    return scene.select(slice(None, None, 1 + len(scene) // _SAMPLE_SIZE))


def _is_horizontal(scene: Gaussians, up: Float64Array) -> BoolArray:
    """Find flat Gaussians that lie horizontally, (N,)."""
    scales = np.sort(scene.log_scales, axis=1)
    flat = np.flatnonzero(scales[:, 0] < scales[:, 1] + np.log(_MAX_THICKNESS))
    thinnest = np.argmin(scene.log_scales[flat], axis=1)
    normals = rotation_matrices(scene.quaternions[flat])[np.arange(len(flat)), :, thinnest]
    return mask_of_rows(flat[np.abs(normals @ up) > _MAX_TILT_COSINE], len(scene))


def _covered_cells(points: Float64Array, low: float, bin_height: float) -> tuple[IntArray, float]:
    """Count the cells of the plan that each layer covers, (bins,), and return the side of a cell."""
    bins = np.floor((points[:, 2] - low) / bin_height).astype(np.int64)
    left, right = np.percentile(points[:, :2], [2, 98], axis=0)
    cell = max(float((right - left).max()), 1e-9) / _CELLS
    cells = np.floor((points[:, :2] - left) / cell).astype(np.int64)
    kept = (bins >= 0) & (bins < _BINS) & (cells >= 0).all(axis=1) & (cells < _CELLS).all(axis=1)
    filled = np.zeros((_BINS, _CELLS, _CELLS), np.bool_)
    filled[bins[kept], cells[kept, 0], cells[kept, 1]] = True
    half = _LAYER_BINS // 2
    layers = filled.copy()
    for shift in range(1, half + 1):
        layers[shift:] |= filled[:-shift]
        layers[:-shift] |= filled[shift:]
    return np.asarray(layers.sum(axis=(1, 2))), cell

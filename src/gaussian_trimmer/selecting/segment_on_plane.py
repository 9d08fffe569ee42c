"""Objects that stand on a plane: the connected piece around a seed that is stable under changes of the gap.

Below the seed a horizontal layer is searched, a table top or a floor. What lies above it falls apart into pieces of
Gaussians that are connected across some gap. Too small a gap breaks objects, too large a gap joins them; in between,
over a range that grows with the object's distance from others, the piece that holds the seed hardly changes. All this
is done in windows of several sizes, since the size of the object is not known beforehand.

Two seeds on one object must give one object. So pieces are connected by distance, not by cells of a grid that would
move with the seed, and windows and gaps come from one ladder of lengths for all seeds of a scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, IntArray, mask_of_rows
from gaussian_trimmer.geometry.graphs import connected_points, nearest
from gaussian_trimmer.geometry.planes import densest_layer, median_radius
from gaussian_trimmer.parallel import parallel_map

_STEPS_PER_OCTAVE = 2
"""Windows of the ladder within a factor of two."""
_WINDOW_RADII = 0.8 * 2.0 ** (np.arange(-5, 1) / _STEPS_PER_OCTAVE)
"""Radii of the windows, relative to half of the picture's longer side at the seed's depth, rounded to the ladder."""
_GAP_RADII = np.geomspace(0.03, 0.6, 14)
"""Gaps to try, relative to the window's radius."""
_BIN_HEIGHT = 0.02
"""Height of the histogram's bins, relative to the window's radius; the layer is three bins thick."""
_MAX_DEPTH = 4.0
"""Depth below the seed down to which the layer is searched, in window radii."""
_LAYER_DISTANCE = 1.5
"""Horizontal distance from the seed within which the layer is searched, in window radii."""
REACH = float(np.hypot(_MAX_DEPTH, _LAYER_DISTANCE))
"""Distance from the seed beyond which nothing is looked at, in window radii."""
_CLEARANCES = (0.03, 0.06, 0.1)
"""Heights above the layer from which on Gaussians belong to what stands on it, in window radii; a greater one is taken
only where the smaller ones find nothing, since a rough surface that is not cleared connects all that stands on it."""
_MIN_VISIBLE = 0.5
"""Gaussians with less visible weight, in pixels of five views of 512 x 512, connect nothing."""
_MIN_GAUSSIANS = 200
"""Smallest number of Gaussians in a piece."""
_MIN_STABILITY, _GOOD_STABILITY = 2, 3
"""Number of steps between gaps over which a piece must be stable, and from which on it is preferred."""
_SAME_SHARE = 0.85
"""Two pieces are the same if the smaller one has at least this share of the other's visible weight."""
_MAX_GAP = 0.375
"""Largest gap within one piece, relative to the piece's radius."""
_MAX_RADIUS, _GOOD_RADIUS = 2.5, 1.3
"""Radius of the largest piece that a window can hold, and up to which it is preferred, relative to the window's."""
_SAME_SURFACE = 0.1
"""Layers closer to each other than this, relative to the scale, are the same one."""
_HIDDEN_GAP = 1 / 3
"""Hardly visible Gaussians belong to a piece within this share of its gap."""
_MAX_FOOT_HEIGHT = 0.5
"""Largest height of a piece's foot above the layer that it stands on, relative to the piece's radius."""
_END_QUANTILES = (0.02, 0.98)
"""Quantiles that are taken for the ends of a piece, so that single Gaussians do not count."""
_FOOT_HEIGHT = 0.3
"""Height of the part that is a piece's foot, relative to its radius."""
_CELL_SIDE, _RING_CELLS = 0.15, 2
"""Side of the cells in which the layer is counted, relative to the piece's radius; width of a ring around the foot."""
_LAYER_HALF_THICKNESS = 0.05
"""Half of the layer's thickness, relative to the window's radius."""
_MIN_COVERED = 0.7
"""Smallest share of that ring that the layer must cover."""
_UPRIGHT = 1 / 3
"""Share of the variance of a Gaussian without direction that is along the up vector; what lies level has less."""
_ROUNDING = 1e-3


@dataclass(frozen=True, eq=False)
class _Piece:
    rows: IntArray
    gap: float
    radius: float
    stability: int
    """Number of steps between gaps over which the piece stays the same."""


def pieces_on_plane(
    positions: Float64Array,
    seeds: FloatArray,
    visible: FloatArray,
    upright: FloatArray,
    scale: float,
    windows: Float64Array,
) -> list[BoolArray]:
    """Return the objects that hold the seeds and stand on a layer below them, (N,) each, the likeliest first.

    Nearer layers come first: for a statue on a plinth, first the statue, then both.

    Args:
        positions: centres relative to the selected point, the third axis upwards, (N, 3).
        seeds: blend weight of each Gaussian at the selected pixel, zero for most, (N,).
        visible: visible weight of each Gaussian, in pixels of five views of 512 x 512, (N,).
        upright: share of each Gaussian's variance that is along the third axis, (N,).
        scale: half of the length that the picture's longer side spans at the depth of the point, in scene units.
        windows: radii of the windows, as `windows_around` gives them.
    """
    distance, shows = np.linalg.norm(positions, axis=1), visible > _MIN_VISIBLE

    def found_in(clearance: float, radius: float) -> list[tuple[float, float, _Piece, BoolArray]]:
        """Find, in a window, heights of layers, its radius, pieces that stand there, and each with what it hides."""
        surface = _find_layer(positions, visible, radius)
        if surface is None:
            return []
        above = (positions[:, 2] > surface + clearance * radius) & (distance < _MAX_DEPTH * radius)
        rows, hidden = np.flatnonzero(above & shows), np.flatnonzero(above & ~shows)
        return [
            (surface, radius, piece, _with_hidden(positions, piece, hidden))
            for piece in _stable_pieces(positions, seeds, visible, rows, _GAP_RADII * radius)
            if piece.radius <= _MAX_RADIUS * radius and _stands(positions, shows, upright, piece, surface, radius)
        ]

    found: list[tuple[float, float, _Piece, BoolArray]] = []
    for clearance in _CLEARANCES:
        found = [one for of_window in parallel_map(partial(found_in, clearance), windows.tolist()) for one in of_window]
        if found:
            break
    highest = max((surface for surface, *_ in found), default=0.0)

    def order(candidate: tuple[float, float, _Piece, BoolArray]) -> tuple[bool, int, bool]:
        surface, radius, piece, _ = candidate
        level = round((highest - surface) / (_SAME_SURFACE * scale))
        return piece.stability < _GOOD_STABILITY, level, piece.radius > _GOOD_RADIUS * radius

    return [selection for *_, selection in sorted(found, key=order)]


def windows_around(scale: float, positions: Float64Array) -> Float64Array:
    """Return radii of windows about a scale: the same for all points and views of a scene (N, 3) near it."""
    scene_size = median_radius(positions)
    if scene_size == 0:
        return np.asarray(_WINDOW_RADII * scale)
    step = round(_STEPS_PER_OCTAVE * np.log2(scale / scene_size)) / _STEPS_PER_OCTAVE
    return np.asarray(_WINDOW_RADII * (scene_size * 2.0**step))


def _find_layer(positions: Float64Array, visible: FloatArray, window: float) -> float | None:
    """Return the height of the most visible layer below the origin, or None where nothing is below it."""
    height, bin_height = positions[:, 2], _BIN_HEIGHT * window
    below = (
        (np.hypot(positions[:, 0], positions[:, 1]) < _LAYER_DISTANCE * window)
        & (height < -bin_height)
        & (height > -_MAX_DEPTH * window)
    )
    if visible[below].sum() <= 0:
        return None
    layer = densest_layer(height[below], visible[below], bin_height, -_MAX_DEPTH * window)
    return layer[0] if layer else None


def _stable_pieces(
    positions: Float64Array, seeds: FloatArray, visible: FloatArray, rows: IntArray, gaps: Float64Array
) -> list[_Piece]:
    """Return the pieces of some rows around the seeds that stay the same over several gaps, the most stable first."""
    if not seeds[rows].any():
        return []
    members = _nested_pieces(positions, seeds, rows, gaps)
    sizes = np.array([visible[piece].sum() for piece in members])
    found = {}
    for k in range(len(gaps)):
        different = np.flatnonzero((sizes < _SAME_SHARE * sizes[k]) | (sizes * _SAME_SHARE > sizes[k]))
        first = int(different[different < k].max(initial=-1)) + 1
        last = int(different[different > k].min(initial=len(gaps))) - 1
        middle = (first + last) // 2
        piece, gap = members[middle], float(gaps[middle])
        low, high = np.quantile(positions[piece], _END_QUANTILES, axis=0)
        radius = float(np.linalg.norm(high - low) / 2)
        if last - first >= _MIN_STABILITY and len(piece) >= _MIN_GAUSSIANS and gap <= _MAX_GAP * radius:
            found[middle] = _Piece(piece, gap, radius, last - first)
    return sorted(found.values(), key=lambda piece: (-piece.stability, -len(piece.rows)))


def _nested_pieces(positions: Float64Array, seeds: FloatArray, rows: IntArray, gaps: Float64Array) -> list[IntArray]:
    """Return, for each gap, rising, the rows of the connected piece that holds most of the seeds.

    A piece is searched within that of the next larger gap, which is what it falls out of as the gap shrinks.
    """
    pieces = []
    for gap in gaps[::-1]:
        piece = connected_points(positions[rows], gap)
        rows = rows[piece == np.bincount(piece, seeds[rows]).argmax()]
        pieces.append(rows)
    return pieces[::-1]


def _stands(
    positions: Float64Array, shows: BoolArray, upright: FloatArray, piece: _Piece, surface: float, window: float
) -> bool:
    """Tell whether the piece reaches down to the layer, and what shows of the layer goes on around its foot, level.

    A layer of what is upright is a slice through sides of the thing itself.
    """
    height = positions[piece.rows, 2] - surface
    lowest = np.quantile(height, _END_QUANTILES[0])
    if lowest > _MAX_FOOT_HEIGHT * piece.radius:
        return False
    foot = positions[piece.rows[height <= lowest + _FOOT_HEIGHT * piece.radius], :2]
    cell = _CELL_SIDE * piece.radius
    origin = foot.min(axis=0) - (_RING_CELLS + 1) * cell
    corners = np.floor((foot - origin) / cell).astype(np.int32)
    footprint = np.zeros(corners.max(axis=0)[::-1] + _RING_CELLS + 2, np.uint8)
    cv2.fillConvexPoly(footprint, cv2.convexHull(corners), 1)
    ring = (_grown(footprint, _RING_CELLS) > 0) & (footprint == 0)

    layer = shows & (np.abs(positions[:, 2] - surface) < _LAYER_HALF_THICKNESS * window)
    x, y = np.floor((positions[layer, :2] - origin) / cell).astype(np.int64).T
    within = (x >= 0) & (y >= 0) & (x < footprint.shape[1]) & (y < footprint.shape[0])
    covered = np.zeros_like(footprint)
    covered[y[within], x[within]] = 1
    if np.mean(_grown(covered, 1)[ring] > 0) < _MIN_COVERED:
        return False
    around = np.flatnonzero(layer)[within][ring[y[within], x[within]]]
    return bool(np.median(upright[around]) <= _UPRIGHT + _ROUNDING)


def _grown(cells: NDArray[np.uint8], steps: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.dilate(cells, np.ones((2 * steps + 1, 2 * steps + 1), np.uint8)))


def _with_hidden(positions: Float64Array, piece: _Piece, hidden: IntArray) -> BoolArray:
    """Return the piece, and those of some hardly visible rows that are near it, (N,)."""
    chosen = mask_of_rows(piece.rows, len(positions))
    if len(hidden):
        points, queries = (positions[rows].astype(np.float32) for rows in (piece.rows, hidden))
        squared, _ = nearest(points, queries, 1)
        chosen[hidden[squared[:, 0] < (_HIDDEN_GAP * piece.gap) ** 2]] = True
    return chosen

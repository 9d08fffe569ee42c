"""The flat surfaces of a room: table tops, floors, shelves and walls.

Horizontal layers and upright ones are found one after the other, the largest first, as peaks in the histogram of the
visible surface that faces a direction. A surface of the room is a connected part of such a layer that is large beside
what a picture shows: the top of a book or the front of a box is not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, Float64Array
from gaussian_trimmer.geometry.planes import Plane, find_plane, floor_and_wall_directions
from gaussian_trimmer.surface.visible_surface import VisibleSurface

_MIN_AREA = 0.8
"""Smallest area of a surface of the room, with all that stands on it, in square units: a quarter of a picture."""
_MIN_COVERED = 0.4
"""Smallest share of that area that must be seen as the surface itself."""
_MIN_PEAK = 1 / 8
"""Smallest area in one layer, relative to that of a surface, from which on surfaces are looked for in it."""
_MIN_FLATNESS, _FACING, _NEARLY_FACING = 0.6, 0.9, 0.8
"""Flatness of the surface that makes up planes; cosines of the angle between its normal and that of the plane."""
_MAX_SPACING = 0.1
"""Distance between neighbours, in units, beyond which nothing is known of the surface between them."""
_MIN_BIN, _BIN_SPACINGS = 0.005, 0.2
"""Height of the histograms' bins, in units, or in distances between neighbours if that is more."""
_CORE_BINS, _LAYER_BINS = 3, 20
"""Distance from the plane of what it is fitted to, and of what its upper side is found from, in bins."""
_CELL_BINS, _CELL_SPACINGS = 10, 3
"""Side of the cells in which a layer's extent is counted, in bins, or in distances between its neighbours."""
_EDGE_SHARE = 0.1
"""A layer ends where less than this share of its densest bin is left."""
_MAX_SIDES = 2.5
"""Largest area of sides below a table top or floor, relative to its own: a box has more, a table less."""
_MAX_OPPOSITE = 0.2
"""Largest area behind a wall that faces away from it, relative to its own: walls are seen from one side."""
_BEHIND = 0.15
"""Distance behind a surface, in units, up to which what is there belongs to it."""
_BORDER_BINS = 2
"""Depth below its upper side down to which something else may lie on a surface, in bins, at most."""
_FOOT_BINS = 8
"""Height of the part of an object that is its foot, in bins."""
_MAX_LAYERS, _MAX_CELLS = 150, 4000


@dataclass(frozen=True, eq=False)
class RoomSurface:
    """One flat surface, for the S Gaussians of the visible surface."""

    plane: Plane
    """In units; its normal points to the side that is seen."""
    area: float
    """With all that stands on it, in square units."""
    within: BoolArray
    """Which Gaussians lie above, on or below its extent, (S,)."""
    heights: Float64Array
    """Height of each above its upper side, in units, (S,)."""
    horizontal: bool
    border: float
    """Depth below its upper side, in units, down to which it may be something thin that lies on it."""

    @property
    def own(self) -> BoolArray:
        """Which Gaussians are the surface itself, (S,)."""
        return self.within & (self.heights < 0) & (self.heights > -_BEHIND)


@dataclass(frozen=True, eq=False)
class Room:
    """What the surfaces of a room mean for the S Gaussians of the visible surface."""

    surfaces: tuple[RoomSurface, ...]
    own: BoolArray
    """Which belong to a surface of the room, (S,)."""
    border: BoolArray
    """Which of these may as well be something that lies or stands on it: near its upper side, or facing another way
    than it does not far below that, (S,)."""
    feet: BoolArray
    """Which lie close above a horizontal one, (S,)."""
    leaning: BoolArray
    """Which lie close before an upright one, (S,)."""
    under: BoolArray
    """Which lie close below a horizontal one, (S,)."""

    @property
    def has_floor(self) -> bool:
        """Whether there is anything to stand on."""
        return any(surface.horizontal for surface in self.surfaces)


def find_room(surface: VisibleSurface) -> Room:
    """Return the surfaces of the room, and which Gaussians they are, carry or hold."""
    bin_height = max(_MIN_BIN, _BIN_SPACINGS * surface.resolution)
    found = tuple(_room_surfaces(surface, bin_height))
    own, certain, feet, leaning, under = (np.zeros(len(surface.rows), np.bool_) for _ in range(5))
    for one in found:
        own |= one.own
        # What stands on a surface reaches down into its layer, but faces another way there.
        facing = (surface.normals @ one.plane.normal > _NEARLY_FACING) | (surface.flatness < _MIN_FLATNESS)
        certain |= one.own & (one.heights < -one.border - np.where(facing, 0, _CORE_BINS * bin_height))
        near = one.within & (one.heights >= 0) & (one.heights < _FOOT_BINS * bin_height)
        if one.horizontal:
            feet |= near
            under |= one.within & (one.heights < -_BEHIND) & (one.heights > -2 * _BEHIND)
        else:
            leaning |= near
    return Room(found, own, own & ~certain, feet & ~own, leaning & ~own, under & ~own)


def _room_surfaces(surface: VisibleSurface, bin_height: float) -> list[RoomSurface]:
    """Return the surfaces, the largest layer first; what one layer took is free for no other."""
    found: list[RoomSurface] = []
    directions, least, core_height = floor_and_wall_directions(), _MIN_PEAK * _MIN_AREA, _CORE_BINS * bin_height
    flat = surface.flatness > _MIN_FLATNESS
    free = flat & (surface.areas < _MAX_SPACING**2)
    for _ in range(_MAX_LAYERS):
        areas_facing = partial(_areas_facing, surface, free)
        plane, guess, held = find_plane(surface.points, directions, areas_facing, bin_height, core_height)
        if held.max() < least:
            break
        normal, horizontal = plane.normal, bool(guess.normal[2] == 1)
        heights = plane.signed_distance(surface.points)
        core = free & (surface.normals @ normal > _NEARLY_FACING) & (np.abs(heights) < core_height)
        guessed = np.abs(guess.signed_distance(surface.points)) < bin_height
        free = free & ~core & ~(guessed & (surface.normals @ guess.normal > _FACING))
        directions = directions[held >= least]
        facing = flat & (surface.normals @ normal > _NEARLY_FACING)
        for area, within in _extents(surface, core, normal, bin_height):
            if _belongs_to_a_thing(surface, within, heights, normal, horizontal):
                continue
            top = _upper_side(heights[within & facing], surface.areas[within & facing], bin_height)
            free = free & ~(within & facing & (np.abs(heights) < max(top, 2 * core_height)))
            border = min(max(top - core_height, 0.0), _BORDER_BINS * bin_height)
            found.append(RoomSurface(plane, area, within, heights - top, horizontal, border))
    return found


def _areas_facing(surface: VisibleSurface, free: BoolArray, direction: Float64Array) -> Float64Array:
    """Return the areas (S,) of what is free, (S,), and faces a direction, (3,); 0 for the rest."""
    return np.where(free & (surface.normals @ direction > _FACING), surface.areas, 0)


def _extents(
    surface: VisibleSurface, core: BoolArray, normal: Float64Array, bin_height: float
) -> Iterator[tuple[float, BoolArray]]:
    """Yield the area of each large connected part of a layer (S,), and what lies above, on or below it, (S,)."""
    if not core.any():
        return
    across = np.eye(3)[0] if abs(normal[0]) < _FACING else np.eye(3)[1]
    first = np.cross(normal, across)
    first /= np.linalg.norm(first)
    flat = surface.points @ np.stack([first, np.cross(normal, first)], axis=1)
    spacing = float(np.median(np.sqrt(surface.areas[core])))
    side = max(_CELL_BINS * bin_height, _CELL_SPACINGS * spacing)
    cells = np.floor(flat / side).astype(np.int64)
    margin = 3
    lowest = cells[core].min(axis=0) - margin
    size = cells[core].max(axis=0) - lowest + margin + 1
    if size.max() > _MAX_CELLS:
        return
    cells -= lowest
    seen = np.zeros(size, np.uint8)
    seen[tuple(cells[core].T)] = 1
    closed = cv2.morphologyEx(seen, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    count, parts = cv2.connectedComponents(closed, connectivity=8)
    covered = np.bincount(parts[seen > 0], minlength=count) * side**2
    inside = ((cells >= 0) & (cells < size)).all(axis=1)
    for part in range(1, count):
        extent = _hull(np.asarray(parts == part))
        area = float(extent.sum()) * side**2
        if area < _MIN_AREA or covered[part] < _MIN_COVERED * area:
            continue
        extent = np.asarray(cv2.dilate(extent, np.ones((3, 3), np.uint8)))
        within = np.zeros(len(cells), np.bool_)
        within[inside] = extent[tuple(cells[inside].T)] > 0
        yield area, within


def _belongs_to_a_thing(
    surface: VisibleSurface, within: BoolArray, heights: Float64Array, normal: Float64Array, horizontal: bool
) -> bool:
    """Tell whether a layer is the top or side of a thing: its sides are below it, or its other side is behind it."""
    towards = surface.normals @ normal
    own = within & (towards > _NEARLY_FACING) & (np.abs(heights) < _BEHIND)
    if horizontal:
        others, limit = within & (np.abs(towards) < _NEARLY_FACING) & (heights < -_BEHIND), _MAX_SIDES
    else:
        others, limit = within & (towards < -_NEARLY_FACING) & (heights < 0), _MAX_OPPOSITE
    return bool(surface.areas[others].sum() > limit * surface.areas[own].sum())


def _hull(cells: BoolArray) -> NDArray[np.uint8]:
    """Return the convex hull of some cells of a grid."""
    filled = np.zeros(cells.shape, np.uint8)
    corners = cv2.convexHull(np.argwhere(cells)[:, ::-1].astype(np.int32))
    return np.asarray(cv2.fillConvexPoly(filled, corners, (1,)), np.uint8)


def _upper_side(heights: Float64Array, areas: Float64Array, bin_height: float) -> float:
    """Return the height above a plane at which the layer ends that lies in it, with one bin more for its roughness."""
    near = np.abs(heights) < _LAYER_BINS * bin_height
    bins = (heights[near] / bin_height + _LAYER_BINS).astype(np.int64)
    held = np.convolve(np.bincount(bins, areas[near], 2 * _LAYER_BINS), np.ones(3))[1:-1]
    middle = slice(_LAYER_BINS - 2, _LAYER_BINS + 3)
    peak = int(np.argmax(held[middle])) + middle.start
    below = np.flatnonzero(held[peak:] <= _EDGE_SHARE * held[peak])
    top = peak + int(below[0]) if len(below) else 2 * _LAYER_BINS
    return (top - _LAYER_BINS + 1) * bin_height

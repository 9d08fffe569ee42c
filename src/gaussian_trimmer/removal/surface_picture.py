"""A picture of a surface from straight above, without what stands on it, and which parts of it are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, IntArray, quaternions_of, rotation_matrices
from gaussian_trimmer.removal.views import THICKNESS_RADII, RemovalViews, Sight, Surface, above_all
from gaussian_trimmer.rendering import blend_values
from gaussian_trimmer.rendering.blending import view_colours
from gaussian_trimmer.views.view import HALF, grown, opened

PIXELS_A_RADIUS = 64
_HALF_WIDTH_RADII = 2.0
"""The picture shows the surface this far to all sides of the object's centre, in object radii."""
_SLAB_RADII = 0.08
"""Height above and below the surface up to which Gaussians may be of it, in object radii."""
_DISTANCE_RADII = 12.0
"""Height of the camera above the surface: from so far away it looks straight down nearly everywhere."""
_MIN_VISIBLE_SHARE = 0.5
"""Smallest blend weight in the scene, relative to that without the object, of a Gaussian whose colours are trusted."""
_HEIGHT_STEP_RADII = 1e-3
"""Of what differs less in height, position in the surface decides which covers which."""
_FAINT = 1e-3
_EDGE_PIXELS = 2
"""Depths are not trusted so near the object's silhouette."""
_MIN_VIEWS_THROUGH = 2
_COARSENING = 2
"""What views see is asked once for this many pixels along each axis."""
_SPECK_PIXELS = 2
"""Emptiness and holes narrower than about twice this are noise of the depths."""
_RING_PIXELS = 20
"""Width of the ring around a hole that tells whether a surface goes on there."""
_FOOT_PIXELS = 3
"""What is seen so near to where the object touches the surface is left of the object, or its contact shadow."""
_REACH_RADII = 0.15
"""A hole that does not come so near to the object's foot point is not the object's."""


@dataclass(frozen=True, eq=False)
class SurfacePicture:
    """The surface from straight above, with what is known of each of P x P pixels."""

    surface: Surface
    rgb: FloatArray
    """Colours, (P, P, 3), by first and second coordinate in the surface."""
    known: BoolArray
    """Where some view sees the surface, (P, P)."""
    empty: BoolArray
    """Where views see that the surface is not there, (P, P)."""
    hole: BoolArray
    """Where the object hides whether it is there, (P, P)."""

    @property
    def coordinates(self) -> Float64Array:
        """Coordinates in the surface of the pixels' centres, (P, P, 3)."""
        along = (np.arange(len(self.hole)) + 0.5) / PIXELS_A_RADIUS - _HALF_WIDTH_RADII
        first, second = np.meshgrid(along, along, indexing="ij")
        return np.stack([first, second, np.zeros_like(first)], axis=-1)

    def pixels_of(self, points: FloatArray) -> tuple[IntArray, BoolArray]:
        """Return rows and columns at which points (N, 3) lie, (2, N), and whether the picture has them, (N,)."""
        pixels = np.floor((self.surface.coordinates(points)[:, :2] + _HALF_WIDTH_RADII) * PIXELS_A_RADIUS)
        inside: BoolArray = np.asarray(((pixels >= 0) & (pixels < len(self.hole))).all(axis=1), np.bool_)
        return np.where(inside[:, None], pixels, 0).astype(np.int64).T, inside


def look_at(
    views: RemovalViews, surface: Surface, surfaces: Sequence[Surface], drawn: BoolArray | None = None
) -> SurfacePicture:
    """Return where one of the surfaces around an object is known, empty and hidden, as a picture without colours.

    Args:
        views: the object in views from all around. Of one from behind any of the surfaces nothing counts, and only one
            that shows the object tells that the surface is seen through: what stands behind a wall is not its end.
        surface: the surface.
        surfaces: all of them; each ends where another begins.
        drawn: where Gaussians of the surface are, (P, P); None: wherever it is seen.
    """
    size = round(2 * _HALF_WIDTH_RADII * PIXELS_A_RADIUS)
    nothing = np.zeros((size, size), np.bool_)
    picture = SurfacePicture(surface, np.zeros((size, size, 3), np.float32), nothing, nothing, nothing)
    coordinates = picture.coordinates
    seen, through, by_object, by_others = _count_views(views, surface, surfaces, coordinates)
    before, clear = ~nothing, ~nothing
    for other in surfaces:
        if other is not surface:
            height = other.heights(surface.points(coordinates.reshape(-1, 3))).reshape(size, size)
            before &= height > 0
            clear &= height > THICKNESS_RADII
    empty = opened((through > seen) & (through >= _MIN_VIEWS_THROUGH), _SPECK_PIXELS)
    empty &= ~_seen_through_the_object(empty, picture, views)
    known = seen >= np.maximum(through, 1)
    if drawn is not None:
        known &= drawn
    hole = before & ~known & ~empty & (by_object > 0) & (by_object >= by_others)
    hole |= before & ~empty & _foot(picture, views)
    return replace(
        picture, known=known & clear, empty=empty, hole=_at_the_object(opened(hole, _SPECK_PIXELS), picture, views)
    )


def take_picture(
    views: RemovalViews, surface: Surface, surfaces: Sequence[Surface], isolated: FloatArray, gone: BoolArray
) -> SurfacePicture:
    """Return the picture of one of the surfaces around an object.

    Args:
        views, surface, surfaces: as those of `look_at`.
        isolated: blend weight of each Gaussian in the views without the object, (N,).
        gone: Gaussians that leave with the object, (N,).
    """
    rgb, alpha = _from_above(views, surface, surfaces, isolated, gone, round(2 * _HALF_WIDTH_RADII * PIXELS_A_RADIUS))
    return replace(look_at(views, surface, surfaces, alpha > HALF), rgb=rgb)


def goes_on(views: RemovalViews, surface: Surface, others: Sequence[Surface]) -> bool:
    """Tell whether a surface goes on behind an object: it, rather than nothing, is seen around the hole.

    The side of a thing may be as flat as a wall, but ends. Where the object hides nothing of it, what is around counts.
    """
    picture = look_at(views, surface, [*others, surface])
    behind = picture.hole if picture.hole.any() else _near_the_object(picture, views)
    ring = grown(behind, _RING_PIXELS) & ~picture.hole
    return int(picture.known[ring].sum()) > int(picture.empty[ring].sum())


def _from_before(views: RemovalViews, surfaces: Sequence[Surface]) -> list[Sight]:
    """Return what views, steep ones and those from where the object was seen too, show from before all surfaces."""
    sights = (*views.sights, *views.above.sights, *views.observed.sights)
    return [sight for sight in sights if _is_before(sight.camera, surfaces)]


def _is_before(camera: Camera, surfaces: Sequence[Surface]) -> bool:
    return bool(above_all(surfaces, camera.centre[None], THICKNESS_RADII).all())


def _count_views(
    views: RemovalViews, surface: Surface, surfaces: Sequence[Surface], coordinates: Float64Array
) -> list[IntArray]:
    """Return in how many views the surface is seen, seen through, hidden by the object and by others, (P, P) each."""
    if (surface, *surfaces) in views.counted:
        return views.counted[surface, *surfaces]
    coarse = coordinates[::_COARSENING, ::_COARSENING] + [*[(_COARSENING - 1) / 2 / PIXELS_A_RADIUS] * 2, 0]
    points = surface.points(coarse.reshape(-1, 3))
    counts = np.zeros((4, len(points)), np.int64)
    for camera, silhouette, depth, sighted in _from_before(views, surfaces):
        pixels, _ = camera.project(points)
        rows = np.flatnonzero(camera.contains(pixels))
        x, y = pixels[rows].astype(np.int64).T
        height = surface.pixel_heights(camera, depth)[y, x]
        of_object, near_it = silhouette[y, x], grown(silhouette, _EDGE_PIXELS)[y, x]
        counts[0, rows] += ~near_it & (np.abs(height) <= THICKNESS_RADII)
        counts[1, rows] += sighted & ~near_it & (height < -THICKNESS_RADII)
        counts[2, rows] += of_object & (height > -THICKNESS_RADII)
        counts[3, rows] += ~near_it & (height > THICKNESS_RADII)
    views.counted[surface, *surfaces] = [
        np.repeat(np.repeat(count.reshape(coarse.shape[:2]), _COARSENING, axis=0), _COARSENING, axis=1)
        for count in counts
    ]
    return views.counted[surface, *surfaces]


def _from_above(
    views: RemovalViews,
    surface: Surface,
    surfaces: Sequence[Surface],
    isolated: FloatArray,
    gone: BoolArray,
    size: int,
) -> tuple[FloatArray, FloatArray]:
    """Return colours (P, P, 3) and opacity (P, P) of the visible Gaussians of the surface alone."""
    means = views.gaussians.means
    height = np.abs(surface.heights(means))
    ours = (height < _SLAB_RADII) & ~views.removed & ~gone
    ours &= views.total_visible > _MIN_VISIBLE_SHARE * isolated
    for other in surfaces:
        ours &= np.abs(other.heights(means)) >= height
    # Nobody looked from straight above, so the colours are those of the views, and not what they would be from there.
    drawn, before = views.gaussians.select(ours), [view for view in views.cameras if _is_before(view, surfaces)]
    colours = np.mean([view_colours(drawn, view) for view in before], axis=0) if before else np.zeros((len(drawn), 3))
    # In the surface's own frame, and with heights rounded, for in a level surface depths are equal: neither the order
    # of rows nor the scene's axes may decide.
    coordinates = surface.coordinates(drawn.means)
    coordinates[:, 2] = np.round(coordinates[:, 2] / _HEIGHT_STEP_RADII) * _HEIGHT_STEP_RADII
    order = np.lexsort(coordinates.T)
    drawn = drawn.select(order).replace(
        means=coordinates[order].astype(np.float32),
        log_scales=drawn.log_scales[order] - np.float32(np.log(surface.unit)),
        quaternions=quaternions_of(surface.axes @ rotation_matrices(drawn.quaternions[order])),
    )
    values = np.column_stack([colours[order], np.ones(len(drawn))]).astype(np.float32)
    # The image's right and down are the first and second coordinate, so that it must be seen from below: mirror one.
    transform = np.diag([1.0, -1.0, -1.0, 1.0])
    transform[2, 3] = _DISTANCE_RADII
    focal = _DISTANCE_RADII * PIXELS_A_RADIUS
    K = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1.0]])
    image = blend_values(drawn, Camera(transform, K, size, size, near=0.01), values)
    image = np.swapaxes(image[::-1], 0, 1)
    return np.asarray(np.clip(image[..., :3] / np.maximum(image[..., 3:], _FAINT), 0, 1)), np.asarray(image[..., 3])


def _seen_through_the_object(empty: BoolArray, picture: SurfacePicture, views: RemovalViews) -> BoolArray:
    """Return the connected parts of what is empty that lie mostly at the object and do not reach the picture's edge.

    What nobody photographed from behind is open there: one looks into it, and through the hole that it stands on.
    """
    _, parts = cv2.connectedComponents(empty.astype(np.uint8))
    at_edge = np.unique(np.concatenate([parts[0], parts[-1], parts[:, 0], parts[:, -1]]))
    pixels = np.bincount(parts.ravel())
    near = np.bincount(parts[_near_the_object(picture, views)], minlength=len(pixels))
    return np.isin(parts, np.setdiff1d(np.flatnonzero(near > HALF * pixels), at_edge)) & empty


def _near_the_object(picture: SurfacePicture, views: RemovalViews) -> BoolArray:
    """Return where the object is as it is seen from above, and a little around it, (P, P)."""
    return _shown(picture, views.gaussians.means[views.of_object], round(_REACH_RADII * PIXELS_A_RADIUS))


def _foot(picture: SurfacePicture, views: RemovalViews) -> BoolArray:
    """Return where the object touches the surface, and a little around, (P, P)."""
    means = views.gaussians.means[views.of_object]
    return _shown(picture, means[np.abs(picture.surface.heights(means)) < _REACH_RADII], _FOOT_PIXELS)


def _shown(picture: SurfacePicture, points: FloatArray, margin: int) -> BoolArray:
    """Return where points (N, 3) are as they are seen from above, and so many pixels around them, (P, P)."""
    pixels, inside = picture.pixels_of(points)
    there = np.zeros_like(picture.hole)
    there[tuple(pixels[:, inside])] = True
    return grown(there, margin)


def _at_the_object(hole: BoolArray, picture: SurfacePicture, views: RemovalViews) -> BoolArray:
    """Return the connected parts of the hole that come near to the object as it is seen from above."""
    _, parts = cv2.connectedComponents(hole.astype(np.uint8))
    return np.asarray(hole & np.isin(parts, np.unique(parts[hole & _near_the_object(picture, views)])))

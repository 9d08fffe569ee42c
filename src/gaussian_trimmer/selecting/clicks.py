"""From a click or a box in one view to a rough selection of the object there.

The Gaussians that show at the pixel give its position in the scene. An object that stands on a plane there is found in
3D, from all around. If there is none, a box is segmented in 3D too, and around a click the view is segmented by colour
and the mask propagated to the object's other sides.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import (
    BoolArray,
    Float64Array,
    FloatArray,
    Gaussians,
    IntArray,
    ellipsoid_points,
)
from gaussian_trimmer.geometry.bounds import up_frame
from gaussian_trimmer.planning.camera_rings import ring_poses
from gaussian_trimmer.rendering import Renderer, Rendering
from gaussian_trimmer.segmentation.view_rendering import visible_weight
from gaussian_trimmer.selecting.image_cut import cut_out_around_click, cut_out_box, lift_visible
from gaussian_trimmer.selecting.propagation import propagate_mask
from gaussian_trimmer.selecting.segment_in_box import CONTRIBUTORS, box_overlap, segment_in_box, surface_depths
from gaussian_trimmer.selecting.segment_on_plane import REACH, pieces_on_plane, windows_around
from gaussian_trimmer.views import Box, bounding_box

Way = Literal["piece", "part", "colour"]

_MAX_SIDE = 640
_VISIBILITY_SCALE = 0.5
_AROUND = 8
"""Places on a circle around a point from which it is seen what is visible; the clicked view takes the first."""
_PITCH_DEGREES = (10.0, 60.0)
_BOX_SEEDS = ((0.5, 0.5), (0.5, 0.3), (0.5, 0.7), (0.3, 0.5), (0.7, 0.5))
"""Pixels in a box at which objects are searched, relative to its sides."""
_FEW = 15_000
"""Gaussians around a point up to which objects are of so few that the extents of each count."""
_GOOD_BOX_OVERLAP = 0.85
_MIN_BOX_OVERLAP = 0.5


@dataclass(frozen=True, eq=False)
class Pick:
    """The selection that a click or a box stands for."""

    selection: BoolArray
    """The rough selection, (N,)."""
    ways: tuple[Way, ...]
    """How each click was understood: as a `piece` that stands on a plane, or as a region of its `colour`. A box may
    also be a `part`, which stands on nothing."""


class NothingToldApartError(InputError):
    """Something is seen at a mark, and nothing of it can be told from the rest."""


@dataclass(frozen=True, eq=False)
class Target:
    """The point of the scene that a pixel shows."""

    point: Float64Array
    """World point, (3,)."""
    depth: float
    seeds: FloatArray
    """Blend weights at the pixel, (N,)."""


def select_by_clicks(
    gaussians: Gaussians,
    camera: Camera,
    clicks: Sequence[tuple[int, int]],
    up: Float64Array,
    renderer: Renderer,
    seen_from: Sequence[Camera] = (),
) -> Pick:
    """The objects at some pixels (x, y) of a view, all in one selection.

    Args:
        up: the scene's up vector, (3,).
        seen_from: training cameras, if known: objects are not looked at from other sides.

    Raises:
        InputError: there is no click, one is outside the picture, or nothing is seen there.
    """
    if not clicks:
        raise InputError("There is no click; give at least one pixel of the view.")
    small = small_view(camera)
    for x, y in clicks:
        if not (0 <= x < camera.width and 0 <= y < camera.height):
            raise InputError(f"The pixel ({x}, {y}) is outside the view of {camera.width} x {camera.height} pixels.")
    found = [_click(gaussians, small, *_rescaled((x, y), camera, small), up, renderer, seen_from) for x, y in clicks]
    return Pick(np.any([selection for selection, _ in found], axis=0), tuple(way for _, way in found))


def select_by_box(
    gaussians: Gaussians, camera: Camera, box: Box, up: Float64Array, renderer: Renderer,
    seen_from: Sequence[Camera] = (),
) -> Pick:  # fmt: skip
    """The object or part that fills a box (x0, y0, x1, y1) of a view best; x1 and y1 are exclusive.

    The box is clipped to the picture; on sides where it reaches the picture's edge, the object may go on beyond it.

    Args:
        up: the scene's up vector, (3,).
        seen_from: training cameras, if known: objects are not looked at from other sides.

    Raises:
        InputError: the box is empty or wholly outside the picture, or nothing is seen in it.
    """
    small = small_view(camera)
    box = _rescaled_box(_clipped(box, camera), camera, small)
    overlap, piece = 0.0, None
    for standing in _pieces_in_box(gaussians, small, box, up, renderer):
        fit = box_overlap(_visible_box(gaussians, small, standing, renderer), box)
        if fit > overlap:
            overlap, piece = fit, standing
        if overlap >= _GOOD_BOX_OVERLAP:
            return Pick(standing, ("piece",))
    segment = segment_in_box(gaussians, small, box, up, renderer, seen_from)
    if segment is not None and segment.overlap >= max(overlap, _MIN_BOX_OVERLAP):
        return Pick(segment.selection, ("part",))
    if piece is not None and overlap >= _MIN_BOX_OVERLAP:
        return Pick(piece, ("piece",))
    picture = renderer.render(gaussians, small)
    if not (picture.alpha[box[1] : box[3], box[0] : box[2]] > 0.5).any():
        raise InputError(f"Nothing is seen in the box {box}; choose another one or another view.")
    mask = cut_out_box(_shown(picture), box)
    return Pick(_object_in_mask(gaussians, small, picture, mask, up, renderer, seen_from), ("colour",))


def _click(
    gaussians: Gaussians, camera: Camera, x: int, y: int, up: Float64Array, renderer: Renderer,
    seen_from: Sequence[Camera],
) -> tuple[BoolArray, Way]:  # fmt: skip
    target = look_at_pixel(gaussians, camera, x, y, renderer)
    visible = _visible_around(gaussians, camera, target, up, renderer)
    pieces = _pieces_at(gaussians, camera, target, visible, up)
    if pieces:
        return pieces[0], "piece"
    picture = renderer.render(gaussians, camera)
    mask = cut_out_around_click(_shown(picture), x, y)
    return _object_in_mask(gaussians, camera, picture, mask, up, renderer, seen_from), "colour"


def _object_in_mask(
    gaussians: Gaussians, camera: Camera, picture: Rendering, mask: BoolArray, up: Float64Array, renderer: Renderer,
    seen_from: Sequence[Camera],
) -> BoolArray:  # fmt: skip
    """The object that a mask shows, on all of its sides; without a surface to follow, the Gaussians that show it."""
    whole = propagate_mask(gaussians, camera, picture, mask, up, renderer, seen_from)
    selection = whole if whole.any() else lift_visible(gaussians, camera, picture, mask, renderer)
    if not selection.any():
        raise NothingToldApartError(
            "Nothing could be told apart there; choose another pixel, or draw a box around the object."
        )
    return selection


def _pieces_in_box(
    gaussians: Gaussians, camera: Camera, box: Box, up: Float64Array, renderer: Renderer
) -> Iterator[BoolArray]:
    """The objects that stand at some pixels in the middle of a box."""
    x0, y0, x1, y1 = box
    places = [(int(x0 + u * (x1 - x0)), int(y0 + v * (y1 - y0))) for u, v in _BOX_SEEDS]
    targets = []
    for x, y in places:
        try:
            targets.append(look_at_pixel(gaussians, camera, x, y, renderer))
        except InputError:
            continue
    if not targets:
        return
    middle = sorted(targets, key=lambda target: target.depth)[len(targets) // 2]
    visible = _visible_around(gaussians, camera, middle, up, renderer)
    for target in targets:
        yield from _pieces_at(gaussians, camera, target, visible, up, extents=False)


def _pieces_at(
    gaussians: Gaussians, camera: Camera, target: Target, visible: FloatArray, up: Float64Array, extents: bool = True
) -> list[BoolArray]:
    """Objects that stand at a point that a view shows, (N,) each, the likeliest first.

    Where objects are of few Gaussians, these connect by their extents: each stands for points on its ellipsoid. Without
    `extents` only centres count, which finds fewer objects there, but does not take along what is under them.
    """
    frame = up_frame(up)
    positions = (gaussians.means - target.point) @ frame.T
    scale = target.depth * max(camera.width, camera.height) / (2 * camera.K[0, 0])
    windows = windows_around(scale, positions)
    near = np.flatnonzero(np.linalg.norm(positions, axis=1) < REACH * windows.max())
    if not extents or len(near) > _FEW:
        return pieces_on_plane(positions, target.seeds, visible, scale, windows)
    ellipsoids = ellipsoid_points(gaussians.select(near))
    points, of = (ellipsoids.reshape(-1, 3) - target.point) @ frame.T, np.repeat(near, ellipsoids.shape[1])
    pieces = pieces_on_plane(points, target.seeds[of], visible[of], scale, windows)
    return [_held(piece, of, len(positions)) for piece in pieces]


def _held(points: BoolArray, of: IntArray, count: int) -> BoolArray:
    """Which Gaussians (count,) have more than half of their points, that `of` (P,) gives them, among some (P,)."""
    return np.asarray(2 * np.bincount(of, points, count) > np.bincount(of, minlength=count))


def pieces_at_click(
    gaussians: Gaussians, camera: Camera, target: Target, up: Float64Array, renderer: Renderer
) -> list[BoolArray]:
    """Objects that stand at a clicked point of a view, (N,) each, the likeliest first."""
    small = small_view(camera)
    visible = _visible_around(gaussians, small, target, up, renderer)
    return _pieces_at(gaussians, small, target, visible, up)


def look_at_pixel(gaussians: Gaussians, camera: Camera, x: int, y: int, renderer: Renderer) -> Target:
    """The surface point at a pixel, at the weighted median depth of the Gaussians that show there.

    Raises:
        InputError: the pixel is outside the view, or nothing is seen there.
    """
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        raise InputError(f"The pixel ({x}, {y}) is outside the view of {camera.width} x {camera.height} pixels.")
    rows, weights = renderer.top_contributors(gaussians, camera, np.array([[x, y]]), CONTRIBUTORS)
    depth = float(surface_depths(gaussians, camera, rows, weights)[0])
    if not np.isfinite(depth):
        raise InputError(f"Nothing is seen at the pixel ({x}, {y}); choose another one, or another view.")
    ray = camera.ray_directions(np.array([[x + 0.5, y + 0.5]]))[0]
    seeds = np.zeros(len(gaussians), np.float32)
    seeds[rows[rows >= 0]] = weights[rows >= 0]
    return Target(camera.centre + ray * depth / (ray @ camera.forward), depth, seeds)


def _visible_around(
    gaussians: Gaussians, camera: Camera, target: Target, up: Float64Array, renderer: Renderer
) -> FloatArray:
    """How much each Gaussian shows in the view and in others around the point, (N,)."""
    cameras = _views_around(camera, target, up)
    weights = [
        renderer.blend_weights(gaussians, view, np.zeros((view.height, view.width), np.uint8), 1)[:, 0]
        for view in cameras
    ]
    return visible_weight(weights, cameras)


def _views_around(camera: Camera, target: Target, up: Float64Array) -> list[Camera]:
    """The view itself, and those from the other places of a circle around the point, about as high; small."""
    axes = up_frame(up)
    offset = axes @ (camera.centre - target.point)
    pitch = np.clip(np.arctan2(offset[2], np.hypot(*offset[:2])), *np.radians(_PITCH_DEGREES))
    yaws = np.arctan2(offset[1], offset[0]) + 2 * np.pi * np.arange(1, _AROUND) / _AROUND
    poses = ring_poses(target.point, axes, float(np.linalg.norm(offset)), yaws, pitch)
    views = [camera, *(replace(camera, world_to_camera=pose) for pose in poses)]
    return [view.resized(_VISIBILITY_SCALE) for view in views]


def _visible_box(gaussians: Gaussians, camera: Camera, selection: BoolArray, renderer: Renderer) -> Box:
    shares = renderer.blend_values(gaussians, camera, selection.astype(np.float32)[:, None])[..., 0]
    return bounding_box(shares > 0.5)


def small_view(camera: Camera) -> Camera:
    """The view at a size at which it is quick to render from all around."""
    return camera.resized(min(1.0, _MAX_SIDE / max(camera.width, camera.height)))


def _rescaled(pixel: tuple[int, int], camera: Camera, small: Camera) -> tuple[int, int]:
    return pixel[0] * small.width // camera.width, pixel[1] * small.height // camera.height


def _clipped(box: Box, camera: Camera) -> Box:
    """A box without what is outside the view."""
    x0, y0, x1, y1 = box
    inside = max(x0, 0), max(y0, 0), min(x1, camera.width), min(y1, camera.height)
    if not (inside[0] < inside[2] and inside[1] < inside[3]):
        raise InputError(
            f"The box {box} holds no pixel of the view of {camera.width} x {camera.height} pixels; "
            "give left, top, right and bottom."
        )
    return inside


def _rescaled_box(box: Box, camera: Camera, small: Camera) -> Box:
    x0, y0 = _rescaled(box[:2], camera, small)
    x1, y1 = (max(low + 1, high) for low, high in zip((x0, y0), _rescaled(box[2:], camera, small), strict=True))
    return x0, y0, min(x1, small.width), min(y1, small.height)


def _shown(picture: Rendering) -> FloatArray:
    return np.clip(picture.rgb, 0, 1)

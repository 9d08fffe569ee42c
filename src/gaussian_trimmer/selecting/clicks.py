"""From a click or a box in one view to a rough selection of the object there.

The Gaussians that show at the pixel give its position in the scene. An object that stands on a plane there is found in
3D, from all around. If there is none, a box is segmented in 3D too; a lone click says too little then.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera, up_frame
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import (
    SH_C0,
    BoolArray,
    Float64Array,
    FloatArray,
    ellipsoid_points,
    mask_of_rows,
)
from gaussian_trimmer.geometry.graphs import connected_bodies
from gaussian_trimmer.output.pictures import zoomed
from gaussian_trimmer.rendering import render
from gaussian_trimmer.rendering.tile_renderer import shown_weights
from gaussian_trimmer.selecting.graph_cuts import correct_at_click, fills, segment_in_box
from gaussian_trimmer.selecting.segment_on_plane import REACH, pieces_on_plane, windows_around
from gaussian_trimmer.selecting.selection import Seed
from gaussian_trimmer.surface.regions import FILLED
from gaussian_trimmer.surface.viewed_scene import (
    Target,
    ViewedScene,
    check_pixel,
    look_at_pixel,
    look_at_pixels,
)
from gaussian_trimmer.trimming.up_vector import up_from_ground_plane
from gaussian_trimmer.views.camera_rings import ring_poses
from gaussian_trimmer.views.view import HALF, Box, box_slices, visible_weight

_VISIBILITY_SCALE = 0.5
_VIEWS_AROUND = 8
"""Places on a circle around a point from which it is seen what is visible; the clicked view takes the first."""
_PITCH_DEGREES = (10.0, 60.0)
_BOX_SEEDS = np.array([(0.5, 0.5), (0.5, 0.3), (0.5, 0.7), (0.3, 0.5), (0.7, 0.5)])
"""Pixels in a box at which objects are searched, relative to its sides."""
_MAX_FOR_EXTENTS = 15_000
"""Gaussians around a point up to which objects are of so few that the extents of each count."""
_GOOD_BOX_OVERLAP = 0.85
_MIN_BOX_OVERLAP = 0.5
_WIDENED = 3
"""How much wider than the picture it is looked whether something is seen alone: it may go on beyond the picture."""
_SOFT_EDGE = 2
"""Pixels by which what is seen alone reaches beyond where it is opaque."""
_COLOUR_GAP_PIXELS = 8
"""How far apart, as they are seen, Gaussians of like colour still go on in one another."""
_REGION_SHARE = 0.15
"""Radius that is expected of the region around a click, relative to the picture's height."""


class NothingFoundError(InputError):
    """Something is seen at a mark, and nothing of it can be told from the rest."""


def select_by_click(scene: ViewedScene, x: int, y: int) -> tuple[BoolArray, str]:
    """Select the object at a pixel that stands on a plane, has nothing beside it, or else the region around it, (N,).

    The second value says which: it is a `piece`, is seen `alone`, or lies `around` the pixel.

    Raises:
        InputError: the pixel is outside the picture, or nothing is seen there.
    """
    check_pixel(scene.camera, x, y)
    small = scene.small()
    target = look_at_pixel(small, *_rescaled((x, y), scene.camera, small.camera))
    if pieces := pieces_at_click(small, target):
        return pieces[0], "piece"
    if (alone := seen_alone(small, target)) is not None:
        return alone, "alone"
    return select_around_click(scene, x, y), "around"


def select_around_click(scene: ViewedScene, x: int, y: int) -> BoolArray:
    """Return the region around a pixel: what a click means where nothing stands.

    Raises as `select_by_click` where nothing is seen.
    """
    small, nothing = scene.small(), np.zeros(len(scene.gaussians), np.bool_)
    target = look_at_pixel(small, *_rescaled((x, y), scene.camera, small.camera))
    radius = _REGION_SHARE * small.camera.height * target.depth / float(small.camera.K[1, 1])
    return correct_at_click(small, nothing, Seed(target.point, radius, True), ())


def select_by_colour(scene: ViewedScene, x: int, y: int, tolerance: float) -> BoolArray:
    """Return what goes on from a pixel in colours that differ by no more than a tolerance, 0 to 1, in any channel.

    Raises as `select_by_click` where nothing is seen.
    """
    target, colours = look_at_pixel(scene, x, y), SH_C0 * scene.gaussians.sh_dc
    alike = np.abs(colours - target.seeds @ colours / target.seeds.sum()).max(axis=1) <= tolerance
    rows = np.union1d(np.flatnonzero(alike), np.argmax(target.seeds))
    gap = _COLOUR_GAP_PIXELS * target.depth / float(scene.camera.K[1, 1])
    pieces = connected_bodies(scene.gaussians.means[rows, None].astype(np.float64), gap)
    within = np.isin(pieces, pieces[target.seeds[rows] > 0])
    return mask_of_rows(rows[within], len(scene.gaussians))


def seen_alone(scene: ViewedScene, target: Target) -> BoolArray | None:
    """Return all that shows at a point with nothing beside it, (N,); None where there is more, or a floor in it.

    What fills photographs was not captured as a whole: that nothing is beside it beyond their edges says nothing.
    """
    wide = replace(scene, camera=zoomed(scene.camera, 1 / _WIDENED))
    alone = _seen_alone(wide, *wide.camera.project(target.point[None])[0][0].astype(int))
    floor = None if alone is None else up_from_ground_plane(scene.gaussians.select(alone))
    return alone if floor is None else None


def _seen_alone(scene: ViewedScene, x: int, y: int) -> BoolArray | None:
    """Return what shows around a pixel with nothing beside it, (N,); None where that goes on beyond the picture."""
    camera, alone = scene.camera, np.zeros(len(scene.gaussians), np.bool_)
    seen = render(scene.gaussians, camera).alpha > HALF
    middle = seen[tuple(slice(side // _WIDENED, side - side // _WIDENED) for side in seen.shape)]
    if scene.seen_from and middle.mean() > FILLED:
        return None
    _, pieces, boxes, _ = cv2.connectedComponentsWithStats(seen.astype(np.uint8))
    left, top, width, height = boxes[pieces[y, x], :4]
    if not seen[y, x] or min(left, top, camera.width - left - width, camera.height - top - height) == 0:
        return None
    outline = cv2.dilate((pieces == pieces[y, x]).astype(np.uint8), np.ones((3, 3), np.uint8), iterations=_SOFT_EDGE)
    pixels, depths = camera.project(scene.gaussians.means.astype(np.float64))
    rows = np.flatnonzero((depths > camera.near) & camera.contains(pixels))
    alone[rows] = outline[tuple(pixels[rows].astype(np.int64).T[::-1])] > 0
    return alone


def select_by_box(scene: ViewedScene, box: Box) -> tuple[BoolArray, str]:
    """Return the object or part that fills a box (x0, y0, x1, y1) of a view best, (N,); x1 and y1 are exclusive.

    The second value says whether it is a `piece` that stands on a plane, or a `part` that stands on nothing.

    The box is clipped to the picture; on sides where it reaches the picture's edge, the object may go on beyond it.

    Raises:
        InputError: the box is empty or wholly outside the picture, nothing is seen in it, or (`NothingFoundError`)
            nothing in it can be told from the rest.
    """
    small = scene.small()
    box = _rescaled_box(_clipped(box, scene.camera), scene.camera, small.camera)
    overlap, piece = 0.0, None
    for standing in _pieces_in_box(small, box):
        fit = fills(small.coverage(standing) > HALF, box)
        if fit > overlap:
            overlap, piece = fit, standing
        if overlap >= _GOOD_BOX_OVERLAP:
            return standing, "piece"
    segment, fit = segment_in_box(small, box)
    if fit >= max(overlap, _MIN_BOX_OVERLAP):
        return segment, "part"
    if piece is not None and overlap >= _MIN_BOX_OVERLAP:
        return piece, "piece"
    if not (render(small.gaussians, small.camera).alpha[box_slices(box)] > HALF).any():
        raise InputError("Nothing is seen in the box; choose another one or another view.")
    raise NothingFoundError(
        "The contents of the box cannot be separated from their surroundings. Draw the box close around what you mean, "
        "take another view."
    )


def pieces_at_click(scene: ViewedScene, target: Target) -> list[BoolArray]:
    """Return objects that stand at a clicked point of a view, (N,) each, the likeliest first."""
    small = scene.small()
    return _pieces_at(small, target, _visible_around(small, target))


def _pieces_in_box(scene: ViewedScene, box: Box) -> Iterator[BoolArray]:
    """Yield the objects that stand at some pixels in the middle of a box."""
    x0, y0, x1, y1 = box
    pixels = np.array([x0, y0]) + _BOX_SEEDS * np.array([x1 - x0, y1 - y0])
    targets = look_at_pixels(scene, pixels.astype(np.int64))
    if not targets:
        return
    middle = sorted(targets, key=lambda target: target.depth)[len(targets) // 2]
    visible = _visible_around(scene, middle)
    for target in targets:
        widest = max(x1 - x0, y1 - y0) * target.depth / float(scene.camera.K[0, 0])
        yield from _pieces_at(scene, target, visible, widest, extents=False)


def _pieces_at(
    scene: ViewedScene, target: Target, visible: FloatArray, widest: float = np.inf, extents: bool = True
) -> list[BoolArray]:
    """Return objects that stand at a point that a view shows, (N,) each, the likeliest first.

    Windows that are wider than `widest`, in scene units, are left out: they look far beyond a box that was drawn.
    Where objects are of few Gaussians, these connect by their extents: each stands for points on its ellipsoid. Without
    `extents` only centres count, which finds fewer objects there, but does not take along what is under them.
    """
    gaussians, camera, frame = scene.gaussians, scene.camera, up_frame(scene.up)
    positions = (gaussians.means - target.point) @ frame.T
    scale = target.depth * max(camera.width, camera.height) / (2 * camera.K[0, 0])
    windows = windows_around(scale, positions)
    windows = windows[windows <= max(widest, windows.min())]
    near = np.flatnonzero(np.linalg.norm(positions, axis=1) < REACH * windows.max())
    local, points, of = gaussians.select(near), positions[near], np.arange(len(near))
    variances = np.square(frame @ local.factors())
    upright = (variances[:, 2].sum(axis=1) / variances.sum(axis=(1, 2))).astype(np.float32)
    if extents and len(near) <= _MAX_FOR_EXTENTS:
        ellipsoids = ellipsoid_points(local)
        points, of = (ellipsoids.reshape(-1, 3) - target.point) @ frame.T, np.repeat(of, ellipsoids.shape[1])
    shown = target.seeds[near][of], visible[near][of]
    pieces = pieces_on_plane(points, *shown, upright[of], scale, windows)
    each, n = np.bincount(of), len(positions)
    # A Gaussian is of a piece with more than half of its points.
    return [mask_of_rows(near[2 * np.bincount(of, piece, len(near)) > each], n) for piece in pieces]


def _visible_around(scene: ViewedScene, target: Target) -> FloatArray:
    """Return how much each Gaussian shows in the view and in others around the point, (N,)."""
    cameras = _views_around(scene.camera, target, scene.up)
    return visible_weight(shown_weights(scene.gaussians, cameras), cameras)


def _views_around(camera: Camera, target: Target, up: Float64Array) -> list[Camera]:
    """Return the view itself, and those from the other places of a circle around the point, about as high; small."""
    axes = up_frame(up)
    offset = axes @ (camera.centre - target.point)
    pitch = np.clip(np.arctan2(offset[2], np.hypot(*offset[:2])), *np.radians(_PITCH_DEGREES))
    yaws = np.arctan2(offset[1], offset[0]) + 2 * np.pi * np.arange(1, _VIEWS_AROUND) / _VIEWS_AROUND
    poses = ring_poses(target.point, axes, float(np.linalg.norm(offset)), yaws, pitch)
    views = [camera, *(replace(camera, world_to_camera=pose) for pose in poses)]
    return [view.resized(_VISIBILITY_SCALE) for view in views]


def _rescaled(pixel: tuple[int, int], camera: Camera, small: Camera) -> tuple[int, int]:
    return pixel[0] * small.width // camera.width, pixel[1] * small.height // camera.height


def _clipped(box: Box, camera: Camera) -> Box:
    """Return a box without what is outside the view."""
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

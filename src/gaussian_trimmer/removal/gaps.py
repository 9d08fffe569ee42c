"""Close what still gapes behind an object where no flat surface was found: what ends at the gap goes on.

Seen from where the object was, a gap is a part of its silhouette in which the scene without it shows nothing, although
something is seen on both sides of it, and more of its rim is seen than ends. There colour goes on as in a picture, and
inverse depth as a soap film does (the harmonic function of its rim). What was hidden lies behind the object, and in no
view before what is seen beside it; and most views see it hidden by the object. One view closes after the other what
those before it left open.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.removal.inpainting import continued, made_up
from gaussian_trimmer.removal.shift_map import inpaint_shift_map, shifted
from gaussian_trimmer.removal.views import RemovalViews, points_at
from gaussian_trimmer.rendering import Rendering, render
from gaussian_trimmer.rendering.tile_renderer import draw, render_views
from gaussian_trimmer.views.view import HALF, bounding_box, box_slices, clearly_nearer, grown, opened

_RIM_PIXELS = 3
"""Pixels around a gap that go on, too: what is seen there is half open."""
_SPECK_PIXELS = 1
"""Gaps narrower than about twice this are noise."""
_LINES = [(1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1)]
"""Steps along the lines, right and down, along which something is looked for on both sides of a gap."""
_LEAST_OPACITY = 0.1
"""Fainter Gaussians of the object do not tell how far back it reaches."""
_BLUR_PIXELS = 3.0
"""Standard deviation of the blur of depths, which are rough where the object's back bounds them."""
_SAME_DEPTH = 0.97
"""What is nearer than this, relative to what is seen, hides it."""


class _Behind(NamedTuple):
    """What one view shows of the object alone, and of the scene when it is gone."""

    camera: Camera
    object: Rendering
    rest: Rendering

    @property
    def silhouette(self) -> BoolArray:
        return self.object.alpha > HALF

    @property
    def seen(self) -> BoolArray:
        """Where anything is seen around the object, (H, W)."""
        return self.rest.alpha > HALF

    @property
    def open(self) -> BoolArray:
        """Where nothing is seen behind the object, (H, W)."""
        return opened(self.silhouette & ~self.seen, _SPECK_PIXELS)

    def gap(self, radius: float) -> tuple[BoolArray, BoolArray]:
        """Return which pixels are to be closed, and which are known to be behind the object, (H, W) each.

        Args:
            radius: the object's, in scene units.
        """
        if not self.open.any():
            return self.open, self.open
        front = _nearest(self.object.depth, self.silhouette)
        behind = ~(self.seen & clearly_nearer(self.rest.depth, front, radius))
        hole = grown(self.open, _RIM_PIXELS) & behind & (self.silhouette | self.seen)
        outside = self.seen & ~hole
        nothing = ~self.seen & ~hole & ~self.silhouette
        goes_on = continued(outside.astype(np.float64), outside | nothing, hole) > HALF
        closed = opened(self.open & goes_on & _between(outside, hole), _SPECK_PIXELS)
        return hole & grown(closed, _RIM_PIXELS), outside & behind


def close_gaps(views: RemovalViews, background: Gaussians) -> Gaussians:
    """Return new Gaussians that close the gaps behind an object.

    Args:
        views: the object and what is around it, and the views from where it was seen.
        background: what is around it when it is gone.
    """
    new, target = background.select(slice(0)), views.gaussians.select(views.of_object)

    def seen(scene: Gaussians) -> list[_Behind]:
        rests = render_views(scene, views.observing)
        return [
            _Behind(*sight) for sight in zip(views.observing, views.observed.alone.renderings(), rests, strict=True)
        ]

    sights = seen(background)
    if not any(_stays_open(sight, background, views) for sight in sights):
        return new
    if views.beyond:
        background = concatenate([background, views.beyond(views.observing)])
        sights = seen(background)
    for sight in sights:
        if len(new) and sight.open.any():
            sight = sight._replace(rest=render(concatenate([background, new]), sight.camera))
        hole, known = sight.gap(views.bounds.radius)
        if hole.any() and known.any():
            found, gap = _continued(sight, hole, known, target)
            elsewhere = _not_behind(found.means, sights)
            # A gap most of which the object did not hide is none: the rest of it would hang in the air.
            wrong = np.bincount(gap, elsewhere) > HALF * np.bincount(gap)
            new = concatenate([new, found.select(~(elsewhere | wrong[gap]))])
    return new


def _stays_open(sight: _Behind, background: Gaussians, views: RemovalViews) -> bool:
    """Tell whether the rest of the scene leaves something open; no more than what is open without it is drawn."""
    still_open = sight.open
    if not views.beyond or not still_open.any():
        return bool(still_open.any())
    box = bounding_box(still_open)
    part = sight.camera.part(*box)
    (alpha,) = draw(concatenate([background, views.beyond([part])]), [part], colours=False).alpha
    still_open[box_slices(box)] &= alpha <= HALF
    return bool(opened(still_open, _SPECK_PIXELS).any())


def _continued(sight: _Behind, hole: BoolArray, known: BoolArray, target: Gaussians) -> tuple[Gaussians, IntArray]:
    """Return a Gaussian for each pixel of a hole (H, W), in the colours and depths that go on from what is known.

    With them comes the number of the gap, a connected part of the hole, that each one closes, (N,).
    """
    camera, rest = sight.camera, sight.rest
    inverse_depth = np.divide(1, rest.depth, out=np.zeros(known.shape), where=known)
    inverse_depth = continued(inverse_depth, known, hole)
    hole = hole & (inverse_depth > 0)
    inverse_depth[hole] = np.minimum(inverse_depth, 1 / _farthest(target, sight))[hole]
    depth = np.zeros(hole.shape)
    depth[hole] = 1 / _blurred(inverse_depth, known | hole)[hole]
    depth = np.maximum(depth, np.where(sight.seen, rest.depth, 0))
    rgb = rest.rgb / np.where(sight.seen, rest.alpha, 1)[..., None]
    colour = inpaint_shift_map(np.clip(rgb, 0, 1), known, hole)[0][hole]
    widths = np.repeat(depth[hole][:, None] / camera.K[0, 0], 3, axis=1)
    turn, rest = np.array([[1, 0, 0, 0]]), target.sh_rest.shape[2]
    _, gaps = cv2.connectedComponents(hole.astype(np.uint8))
    return made_up(points_at(camera, depth)[hole], widths, turn, colour, rest), gaps[hole].astype(np.int64)


def _not_behind(means: FloatArray, sights: Sequence[_Behind]) -> BoolArray:
    """Return which points (N, 3) are not what the object hid, (N,).

    Some view sees past them, beside the object, or the object does not hide them in most views: what one view shows
    through a window, far behind the object, is nothing that the object could have hidden from all of them.
    """
    past, hiding = np.zeros(len(means), np.bool_), np.zeros(len(means), np.int64)
    for sight in sights:
        pixels, depths = sight.camera.project(means.astype(np.float64))
        rows = np.flatnonzero(sight.camera.contains(pixels))
        x, y = pixels[rows].astype(np.int64).T
        behind = grown(sight.silhouette, _RIM_PIXELS + 1)[y, x]
        hiding[rows] += behind
        past[rows] |= ~behind & (~sight.seen[y, x] | (depths[rows] < _SAME_DEPTH * sight.rest.depth[y, x]))
    return past | (hiding <= HALF * len(sights))


def _farthest(target: Gaussians, sight: _Behind) -> FloatArray:
    """Return how far back the object reaches in each pixel of a view, (H, W)."""
    pixels, depths = sight.camera.project(target.means.astype(np.float64))
    rows = np.flatnonzero(sight.camera.contains(pixels) & (target.opacities > _LEAST_OPACITY))
    x, y = pixels[rows].astype(np.int64).T
    farthest = np.zeros(sight.silhouette.shape, np.float32)
    np.maximum.at(farthest, (y, x), depths[rows].astype(np.float32))
    farthest = np.asarray(cv2.dilate(farthest, np.ones((5, 5), np.uint8)), np.float32)
    return _nearest(farthest, farthest > 0)


def _blurred(image: Float64Array, inside: BoolArray) -> Float64Array:
    """Return an image (H, W), blurred where it counts."""
    weight, weighted = (
        cv2.GaussianBlur(part, (0, 0), _BLUR_PIXELS) for part in (inside.astype(np.float64), np.where(inside, image, 0))
    )
    return np.asarray(weighted / np.maximum(weight, 1e-9))


def _nearest(image: FloatArray, known: BoolArray) -> FloatArray:
    """Return an image (H, W) with the value of the nearest known pixel in each one that is not known."""
    from scipy.ndimage import distance_transform_edt

    rows, columns = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(image[rows, columns])


def _between(known: BoolArray, hole: BoolArray) -> BoolArray:
    """Return the pixels of a hole that lie between known ones along some line through them, (H, W)."""
    between = np.zeros_like(hole)
    for right, down in _LINES:
        between |= _met(known, hole, right, down) & _met(known, hole, -right, -down)
    return between


def _met(known: BoolArray, hole: BoolArray, right: int, down: int) -> BoolArray:
    """Return from where in a hole the first pixel outside of it, in some direction, is a known one, (H, W)."""
    everywhere, met = box_slices((0, 0, *hole.shape[::-1])), known
    while True:
        farther = met | (hole & shifted(met, down, right, everywhere))
        if np.array_equal(farther, met):
            return met & hole
        met = farther

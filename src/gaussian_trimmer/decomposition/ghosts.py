"""What stands in the object's place once the object is gone.

Training puts Gaussians where no photograph can contradict them: inside an object, below its foot, behind its skin. The
object hides them; in the scene without it they are a dark cloud, a charred ring, coloured crumbs. These ghosts are told
by three things: they show in the background alone and hardly in the whole scene; what they show lies within the
object's silhouette, from every side and height; and they lie where the object was. Below the object, where the ground
goes on, only those are ghosts whose colours are not those of the ground around it.

A few more are no ghosts but crumbs: visible scraps of the object's own skin that the masks gave to the background.
Nearly all that is near a crumb belongs to the object, so the crumb does too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import SH_C0, BoolArray, FloatArray, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.kd_tree import nearest
from gaussian_trimmer.geometry.support_plane import SupportPlane
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.scope import Scope
from gaussian_trimmer.views import HALF, bounding_box

_MAX_ROUNDS = 3
"""What a ghost has hidden shows when it is gone, and may be another ghost."""
_MIN_SHOWN_SHARE = 2e-6
"""Smallest blend weight in the background alone, as a share of the views' pixels, of what can be noticed."""
_MAX_VISIBLE_SHARE = 0.2
"""Largest blend weight in the whole scene, relative to that in the background alone."""
_MIN_INSIDE_SHARE = 0.8
"""Smallest share of the blend weight in the background alone within the object's silhouettes."""
_RIM_MAX_VISIBLE_SHARE, _RIM_MIN_INSIDE_SHARE = 0.5, 0.5
"""The same for those in the ground whose colours are not the ground's: a charred ring lies half under the object."""
_BOUNDS_MARGIN_RADII = 0.1
"""Margin around the object's bounds, in object radii."""
_FOREIGN_DEVIATIONS = 2.0
"""Distance of a ghost's colour from those of the ground, in their standard deviations, in some channel."""
_MIN_COLOUR_SPREAD = 0.06
"""Least standard deviation of the ground's colours in each channel."""
_GROUND_REACH_RADII = 1.5
"""Horizontal distance within which Gaussians near the support plane give the ground's colours, in object radii."""
_MIN_GROUND_GAUSSIANS = 10
_GROUND_VISIBLE_SHARE = 0.5
"""Share of what it shows in the background alone that a Gaussian of the ground shows in the scene, at the least."""
_CRUMB_NEIGHBOURS = 12
_CRUMB_NEIGHBOUR_SHARE = 0.75
"""Share of the nearest Gaussians of a crumb that are the object's or ghosts, at the least."""
_CRUMB_INSIDE_SHARE = 0.9
_MAX_CRUMB_WEIGHT_SHARE = 0.01
"""Largest blend weight of all crumbs in the scene, relative to the object's; more is no crumb."""
_MAX_JOINING_SHARE = 0.02
"""Largest blend weight in the object, relative to that in the background alone, of a ghost that joins the object."""
_MIN_PSNR_DB = 45.0
"""Smallest PSNR in dB of object and background together against the scene, in every view."""
_BISECTIONS = 4
"""Trials to find how many ghosts can go until that holds."""


@dataclass(frozen=True, eq=False)
class Cleaning:
    """What is taken from the background, of N Gaussians."""

    to_object: BoolArray
    """Those that belong to the object and do not change how it looks in isolation, (N,)."""
    dropped: BoolArray
    """Those that show in the background alone and in nothing else, (N,)."""


def clean_background(
    gaussians: Gaussians,
    keep: BoolArray,
    bounds: Bounds,
    plane: SupportPlane | None,
    cameras: Sequence[Camera],
    renderer: Renderer,
) -> Cleaning:
    """Which Gaussians of the background are only there because the object hid them, or are scraps of it.

    Args:
        gaussians: the object and the Gaussians around it, N of them.
        keep: which of them are the object, whole or in part, (N,).
        bounds: the object's bounds; their third axis is up.
        plane: what the object stands on, if anything.
        cameras: small views from all sides, at several heights.
        renderer: draws scene, background and object by themselves.
    """
    nothing = Cleaning(np.zeros(len(keep), np.bool_), np.zeros(len(keep), np.bool_))
    if keep.all() or not keep.any() or not cameras:
        return nothing
    silhouettes = _silhouettes(gaussians.select(keep), cameras, renderer)
    everything = np.ones(len(keep), np.bool_)
    seen = _weights(gaussians, everything, cameras, silhouettes, renderer)
    # Whether something is hidden is asked in all views; what it shows then, in every other one of them.
    cameras, silhouettes, share = cameras[::2], silhouettes[::2], len(cameras[::2]) / len(cameras)
    seen *= np.float32(share)
    where = _ObjectRegion(gaussians, keep, keep, seen.sum(axis=1), bounds, plane)
    ghosts, shown = _find_ghosts(gaussians, keep, seen, where, cameras, silhouettes, renderer)
    crumbs = _find_crumbs(gaussians, keep, ghosts, seen, where)
    joins = crumbs
    if ghosts.any():
        both = _weights(gaussians, keep | ghosts | crumbs, cameras, silhouettes, renderer).sum(axis=1)
        # What lies in the ground would show below the object, where no view looks.
        joins = crumbs | (ghosts & where.above & (both <= _MAX_JOINING_SHARE * shown))
    return Cleaning(joins, _droppable(gaussians, ghosts & ~joins, seen.sum(axis=1), shown, cameras, renderer))


def hidden_by_several(
    scope: Scope, members: BoolArray, find_plane: Callable[[FloatArray], SupportPlane | None], renderer: Renderer
) -> BoolArray:
    """Which Gaussians of the scene without several objects are only there because one of them hid them, (L,).

    What joins an object in `clean_background` stays where it is, so that objects do not depend on each other.

    Args:
        scope: one object, which is selected, the Gaussians around it, and small views of its place.
        members: which Gaussians are of any object, whole or in part, (L,).
        find_plane: gives the plane that the object stands on, if there is one, by the blend weight that each Gaussian
            has in the views, (L,).
        renderer: draws scene, background and object by themselves.
    """
    gaussians, own, cameras = scope.local, scope.selected, scope.cameras
    if members.all() or not own.any() or not cameras:
        return np.zeros(len(members), np.bool_)
    silhouettes = _silhouettes(gaussians.select(own), cameras, renderer)
    seen = _weights(gaussians, np.ones(len(members), np.bool_), cameras, silhouettes, renderer)
    visible = seen.sum(axis=1)
    where = _ObjectRegion(gaussians, members, own, visible, scope.bounds, find_plane(visible))
    ghosts, shown = _find_ghosts(gaussians, members, seen, where, cameras, silhouettes, renderer)
    return _droppable(gaussians, ghosts, visible, shown, cameras, renderer)


class _ObjectRegion:
    """Where the Gaussians lie relative to the object and the ground that it stands on."""

    def __init__(
        self,
        gaussians: Gaussians,
        keep: BoolArray,
        own: BoolArray,
        seen: FloatArray,
        bounds: Bounds,
        plane: SupportPlane | None,
    ) -> None:
        local = (gaussians.means - bounds.centre) @ bounds.axes.T
        margin = _BOUNDS_MARGIN_RADII * bounds.radius
        beside = (np.abs(local[:, :2]) <= bounds.half_extents[:2] + margin).all(axis=1)
        # The bounds are robust ones, so a thin top rises above them.
        top = max(bounds.half_extents[2], float(local[own, 2].max(initial=0.0))) + margin
        ground = -bounds.half_extents[2] if plane is None else (plane.height + plane.thickness) * bounds.radius
        self.above = beside & (local[:, 2] < top) & (local[:, 2] > ground)
        """Which ones lie where the object was, above the ground, (N,)."""
        self.below = beside & (local[:, 2] <= ground) & (plane is not None)
        """Which ones lie in the ground below it, (N,)."""
        around = np.zeros(len(keep), np.bool_)
        if plane is not None:
            distance = np.hypot(local[:, 0], local[:, 1]) / bounds.radius
            around = ~keep & plane.on_surface & (distance < _GROUND_REACH_RADII)
        self.colours = np.clip(0.5 + SH_C0 * gaussians.sh_dc.astype(np.float64), 0, 1)
        self._ground, self._weights = around, seen

    def foreign(self, shown: FloatArray) -> BoolArray:
        """Which ones have other colours than the visible ground around the object, (N,)."""
        known = self._ground & (self._weights > _GROUND_VISIBLE_SHARE * shown) & (self._weights > 0)
        if known.sum() < _MIN_GROUND_GAUSSIANS:
            return np.zeros(len(known), np.bool_)
        weights = self._weights[known].astype(np.float64)
        mean = np.average(self.colours[known], axis=0, weights=weights)
        spread = np.sqrt(np.average((self.colours[known] - mean) ** 2, axis=0, weights=weights))
        return np.asarray(
            (np.abs(self.colours - mean) > _FOREIGN_DEVIATIONS * np.maximum(spread, _MIN_COLOUR_SPREAD)).any(axis=1)
        )


def _find_ghosts(
    gaussians: Gaussians,
    keep: BoolArray,
    seen: FloatArray,
    where: _ObjectRegion,
    cameras: Sequence[Camera],
    silhouettes: Sequence[BoolArray],
    renderer: Renderer,
) -> tuple[BoolArray, FloatArray]:
    """Which Gaussians are ghosts, and the most that each Gaussian showed in the background alone, (N,) each."""
    ghosts, most = np.zeros(len(keep), np.bool_), np.zeros(len(keep), np.float32)
    noticed = _MIN_SHOWN_SHARE * sum(camera.width * camera.height for camera in cameras)
    for _ in range(_MAX_ROUNDS):
        alone = _weights(gaussians, ~(keep | ghosts), cameras, silhouettes, renderer)
        shown = alone.sum(axis=1)
        most = np.maximum(most, shown)
        visible = seen.sum(axis=1)
        floating = where.above & (visible <= _MAX_VISIBLE_SHARE * shown) & (alone[:, 1] >= _MIN_INSIDE_SHARE * shown)
        charred = (
            where.below & (visible <= _RIM_MAX_VISIBLE_SHARE * shown) & (alone[:, 1] >= _RIM_MIN_INSIDE_SHARE * shown)
        )
        found = (shown > noticed) & (floating | (charred & where.foreign(shown)))
        if not found.any():
            break
        ghosts |= found
    return ghosts, most


def _find_crumbs(
    gaussians: Gaussians, keep: BoolArray, ghosts: BoolArray, seen: FloatArray, where: _ObjectRegion
) -> BoolArray:
    """Visible scraps of the object among the background, (N,)."""
    total = seen.sum(axis=1)
    possible = np.flatnonzero(~keep & ~ghosts & where.above & (total > 0) & (seen[:, 1] >= _CRUMB_INSIDE_SHARE * total))
    crumbs = np.zeros(len(keep), np.bool_)
    if not len(possible):
        return crumbs
    _, near = nearest(gaussians.means, gaussians.means[possible], min(_CRUMB_NEIGHBOURS + 1, len(keep)))
    others = near != possible[:, None]
    ours = ((keep | ghosts)[near] & others).sum(axis=1) >= _CRUMB_NEIGHBOUR_SHARE * others.sum(axis=1)
    rows = possible[ours]
    rows = rows[np.argsort(total[rows], kind="stable")]
    crumbs[rows[np.cumsum(total[rows]) <= _MAX_CRUMB_WEIGHT_SHARE * total[keep].sum()]] = True
    return crumbs


def _silhouettes(isolated: Gaussians, cameras: Sequence[Camera], renderer: Renderer) -> list[BoolArray]:
    return [renderer.render(isolated, camera).alpha > HALF for camera in cameras]


def _weights(
    gaussians: Gaussians,
    part: BoolArray,
    cameras: Sequence[Camera],
    silhouettes: Sequence[BoolArray],
    renderer: Renderer,
) -> FloatArray:
    """Blend weight outside and inside the silhouettes over all views, where only a part is drawn, (N, 2)."""
    total, drawn = np.zeros((len(part), 2), np.float32), gaussians if part.all() else gaussians.select(part)
    for camera, silhouette in zip(cameras, silhouettes, strict=True):
        total[part] += renderer.blend_weights(drawn, camera, silhouette.astype(np.uint8), 2)
    return total


def _over_black_and_white(gaussians: Gaussians, camera: Camera, renderer: Renderer) -> FloatArray:
    """A picture before two backgrounds, (2, H, W, 3): what lies farther away is not drawn, and may have any colour."""
    drawn = renderer.render(gaussians, camera)
    return np.asarray(np.clip([drawn.rgb, drawn.rgb + (1 - drawn.alpha)[..., None]], 0, 1))


def _part_that_shows(gaussians: Gaussians, camera: Camera, renderer: Renderer) -> tuple[Camera, int] | None:
    """The part of a view outside which Gaussians change nothing, and the view's number of pixels; None: nowhere."""
    shown = renderer.render(gaussians, camera).alpha > 0
    if not shown.any():
        return None
    left, top, right, bottom = bounding_box(shown)
    return camera.part(left, top, right, bottom), shown.size


def _droppable(
    gaussians: Gaussians,
    ghosts: BoolArray,
    visible: FloatArray,
    shown: FloatArray,
    cameras: Sequence[Camera],
    renderer: Renderer,
) -> BoolArray:
    """The ghosts without which the whole scene still looks as it did, (N,).

    Those go first that cost the scene least for what they spoil of the background: the error grows with the square of
    the blend weight in the scene, `visible` (N,), and the gain with that in the background alone, `shown` (N,).
    """
    rows = np.flatnonzero(ghosts)
    rows = rows[np.argsort((visible.astype(np.float64) ** 2 / np.maximum(shown, 1e-9))[rows], kind="stable")]
    if not len(rows):
        return ghosts
    parts = [part for camera in cameras if (part := _part_that_shows(gaussians.select(rows), camera, renderer))]
    before = [(part, pixels, _over_black_and_white(gaussians, part, renderer)) for part, pixels in parts]

    def without(count: int) -> BoolArray:
        dropped = np.zeros(len(ghosts), np.bool_)
        dropped[rows[:count]] = True
        return dropped

    def looks_the_same(count: int) -> bool:
        rest = gaussians.select(~without(count))
        for place, (part, pixels, pictures) in enumerate(before):
            difference = pictures - _over_black_and_white(rest, part, renderer)
            error = np.sum(difference**2, axis=(1, 2, 3), dtype=np.float64).max() / (3 * pixels)
            if error > 10 ** (-_MIN_PSNR_DB / 10):
                before.insert(0, before.pop(place))  # what shows it here will show it again
                return False
        return True

    if looks_the_same(len(rows)):
        return ghosts
    fine, spoiled = 0, len(rows)
    for _ in range(_BISECTIONS):
        middle = (fine + spoiled) // 2
        fine, spoiled = (middle, spoiled) if looks_the_same(middle) else (fine, middle)
    return without(fine)

"""Views of an object that are chosen by what they show of it, for scenes without cameras.

A view says nothing of what it does not show: from behind a wall, over a table's edge, through the haze of a side that
nobody photographed. So cameras all around are tried on small pictures of the scene, and of these the next one chosen is
always that which adds most to what is seen of each of the object's Gaussians. What a view adds counts less the more of
a Gaussian was seen already, and less the more of the object the view hides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds, robust_bounds
from gaussian_trimmer.rendering.tile_renderer import shown_weights
from gaussian_trimmer.views.camera_rings import framing_ring
from gaussian_trimmer.views.small_views import angles_around
from gaussian_trimmer.views.standing import thinned
from gaussian_trimmer.views.virtual_cameras import MAX_PITCH, PlanConfig, cameras_around, cameras_that_see

_PITCHES_DEGREES = (8.0, 25.0, 45.0, 65.0)
_YAWS_AT_HORIZON = 16
"""Directions that there are at the lowest heights; higher rings are shorter and have fewer."""
_TRIAL_PIXELS = 32
"""Width and height of the small pictures. They are taken from nearby, in the lens of planned views."""
_TRIAL_RADII = 2.5
"""Distance from the object's centre, in object radii, up to which the scene is drawn: all these cameras are nearer."""
_TRIED_GAUSSIANS = 5000
"""Gaussians of the object, and around it, that are drawn on trial at most, larger as they are fewer."""
_FREE_SHARE = 0.5
"""Share of the object that a free view shows."""
_LEAST_SHARE = 0.2
"""Share of what the best view shows that every chosen one shows, since a view of less tells what hides the object."""
_ENOUGH_FREE = 0.75
"""Share of every second direction that is free where those between them are not tried."""


@dataclass(frozen=True, eq=False)
class ChosenViews:
    """Directions to look at an object from, the best one first."""

    bounds: Bounds
    """What the views frame."""
    yaws: Float64Array
    pitches: Float64Array
    """Angles in radians, (V,) each."""
    free: int
    """How many of the directions that were tried show at least half of the object."""

    def cameras(self, count: int, size: int, fov_degrees: float, fill: float) -> list[Camera]:
        """Return the first views, in order of yaw, as square pictures of `size` pixels a side that the object fills."""
        order = np.argsort(self.yaws[:count], kind="stable")
        fov = float(np.radians(fov_degrees))
        return framing_ring(self.bounds, self.yaws[:count][order], self.pitches[:count][order], size, fov, fill)


def place_cameras(
    scene: Gaussians,
    target: Gaussians,
    rows: IntArray,
    bounds: Bounds,
    config: PlanConfig,
    count: int,
    training: Sequence[Camera],
    marked_from: Sequence[Camera],
) -> tuple[list[Camera], ChosenViews | None]:
    """Return virtual cameras, within the angles from which training cameras saw the object, or else by what they show.

    Args:
        scene: all N Gaussians.
        target: the selected object.
        rows: what is selected of the scene, without floaters.
        bounds: the selected object's; their third axis is up.
        config: how many cameras, and where they may stand.
        count: number of directions to choose, if they are chosen by what they show; these are returned, too.
        training: training cameras, if known.
        marked_from: cameras from whose directions somebody has seen the object.
    """
    seeing = cameras_that_see(training, bounds)
    if seeing or not config.is_free:
        return cameras_around(target, bounds, config, seeing), None
    near = bounds.squared_distances(scene.means) < (_TRIAL_RADII * bounds.radius) ** 2
    near[rows] = False
    if len(rows) < len(target):
        bounds = robust_bounds(scene.select(rows), bounds.axes)
    chosen = choose_views(scene, rows, np.flatnonzero(near), bounds, count, marked_from)
    return chosen.cameras(config.views, config.size, config.fov_degrees, config.fill), chosen


def choose_views(
    scene: Gaussians,
    rows: IntArray,
    around: IntArray,
    bounds: Bounds,
    count: int,
    marked_from: Sequence[Camera] = (),
) -> ChosenViews:
    """Choose where to look at an object from.

    Args:
        scene: all N Gaussians.
        rows: those of the object.
        around: those that may hide it, up to `_TRIAL_RADII` away.
        bounds: the object's; their third axis is up.
        count: number of views; fewer are chosen if no others show enough.
        marked_from: cameras from whose directions somebody has seen the object: these are taken first.
    """
    known_yaws, known_pitches = angles_around(marked_from, bounds)
    yaws, pitches = _directions()
    yaws = np.append(known_yaws, yaws)
    pitches = np.append(np.clip(known_pitches, -MAX_PITCH, MAX_PITCH), pitches)
    target, rest = (thinned(scene, part, -(-len(part) // _TRIED_GAUSSIANS)) for part in (rows, around))
    everything, fov, half = concatenate([target, rest]), float(np.radians(PlanConfig.fov_degrees)), -(-len(yaws) // 2)
    cameras = framing_ring(bounds, yaws, pitches, _TRIAL_PIXELS, fov, PlanConfig.fill)
    shown = np.stack(shown_weights(everything, cameras[:half]))[:, : len(target)]
    free = _free(shown, target, cameras)
    if count > half or free.mean() < _ENOUGH_FREE:
        shown = np.concatenate([shown, np.stack(shown_weights(everything, cameras[half:]))[:, : len(target)]])
        free = _free(shown, target, cameras)
    total, most = shown.sum(axis=1), shown.max(axis=0)
    total[total < _LEAST_SHARE * total.max()] = 0
    relative = shown / np.maximum(most, 1e-9)
    new = 1 - np.exp(-relative)
    seen, chosen, known = np.zeros_like(most), list[int](), np.arange(len(shown)) < len(marked_from)
    for _ in range(min(count, len(shown))):
        gains = total * (np.exp(-seen) * new * most).sum(axis=1)
        gains[chosen] = 0
        if (gains * known).any():
            gains *= known
        best = int(np.argmax(gains))
        if gains[best] <= 0:
            break
        chosen.append(best)
        seen += relative[best]
    chosen = chosen or list(range(0, len(yaws), -(-len(yaws) // count)))  # nothing is seen from anywhere
    return ChosenViews(bounds, yaws[chosen], pitches[chosen], int(np.count_nonzero(free)))


def _directions() -> tuple[Float64Array, Float64Array]:
    """Return yaws and pitches to look from, in radians, (V,) each: every second one, then those between them."""
    rings = [np.arange(n) * 2 * np.pi / n for n in (_YAWS_AT_HORIZON * np.cos(np.radians(_PITCHES_DEGREES))).round()]
    yaws = np.concatenate([yaws + i * np.pi / len(yaws) for i, yaws in enumerate(rings)]) % (2 * np.pi)
    pitches = np.repeat(np.radians(_PITCHES_DEGREES), [len(yaws) for yaws in rings])
    order = np.argsort(np.arange(len(yaws)) % 2, kind="stable")
    return yaws[order], pitches[order]


def _free(shown: FloatArray, target: Gaussians, cameras: Sequence[Camera]) -> BoolArray:
    """Return which views show much of the object, by what is seen of each Gaussian (V, M), (V,).

    Much is half of what the best view would show if nothing were before the object.
    """
    total = shown.sum(axis=1)
    whole = shown_weights(target, [cameras[int(np.argmax(total))]])[0].sum()
    return np.asarray(total > _FREE_SHARE * whole)

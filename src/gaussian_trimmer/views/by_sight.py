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
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.rendering import render
from gaussian_trimmer.views.camera_rings import NEAR_RADII, Lens, framing_distance, ring
from gaussian_trimmer.views.standing import thinned
from gaussian_trimmer.views.virtual_cameras import PlanConfig

_PITCHES_DEGREES = (8.0, 25.0, 45.0, 65.0)
_YAWS_AT_HORIZON = 16
"""Directions that are tried at the lowest heights; higher rings are shorter and have fewer."""
_TRIAL_PIXELS = 96
"""Width and height of the small pictures. They are taken from nearby, in the lens of planned views."""
_TRIAL_RADII = 6.0
"""Distance from the object's centre, in object radii, up to which the scene is drawn in them."""
_TRIED_GAUSSIANS = 40_000
"""Gaussians of the object, and around it, that are drawn on trial at most, larger as they are fewer."""
_FREE_SHARE = 0.5
"""Share of the object that a free view shows."""


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
        yaws, pitches, fov = self.yaws[:count][order], self.pitches[:count][order], float(np.radians(fov_degrees))
        distance = framing_distance(self.bounds, yaws, pitches, fov, fill)
        lens = Lens(size, fov, NEAR_RADII * self.bounds.radius)
        return ring(self.bounds.centre, self.bounds.axes, distance, yaws, pitches, lens)


def choose_views(scene: Gaussians, rows: IntArray, bounds: Bounds, count: int) -> ChosenViews:
    """Choose where to look at an object from.

    Args:
        scene: all N Gaussians.
        rows: those of the object.
        bounds: the object's; their third axis is up.
        count: number of views; fewer are chosen if no other shows anything.
    """
    rings = [np.arange(n) * 2 * np.pi / n for n in (_YAWS_AT_HORIZON * np.cos(np.radians(_PITCHES_DEGREES))).round()]
    yaws = np.concatenate([yaws + i * np.pi / len(yaws) for i, yaws in enumerate(rings)]) % (2 * np.pi)
    pitches = np.repeat(np.radians(_PITCHES_DEGREES), [len(yaws) for yaws in rings])
    shown, share = _shown(scene, rows, bounds, yaws, pitches)
    most = shown.max(axis=0)
    relative = shown / np.maximum(most, 1e-9)
    new = 1 - np.exp(-relative)
    seen, chosen = np.zeros_like(most), list[int]()
    for _ in range(min(count, len(yaws))):
        gains = share * (np.exp(-seen) * new * most).sum(axis=1)
        gains[chosen] = 0
        best = int(np.argmax(gains))
        if gains[best] <= 0:
            break
        chosen.append(best)
        seen += relative[best]
    chosen = chosen or list(range(0, len(yaws), -(-len(yaws) // count)))  # nothing is seen from anywhere
    return ChosenViews(bounds, yaws[chosen], pitches[chosen], int(np.count_nonzero(share >= _FREE_SHARE)))


def _shown(
    scene: Gaussians, rows: IntArray, bounds: Bounds, yaws: Float64Array, pitches: Float64Array
) -> tuple[FloatArray, FloatArray]:
    """Return what each direction shows of each of the object's Gaussians, (V, M), and what share of them all, (V,)."""
    offset = scene.means - bounds.centre.astype(np.float32)
    around = np.einsum("ni,ni->n", offset, offset) < (_TRIAL_RADII * bounds.radius) ** 2
    around[rows] = False
    target, rest = (thinned(scene, part, -(-len(part) // _TRIED_GAUSSIANS)) for part in (rows, np.flatnonzero(around)))
    everything = concatenate([target, rest])
    lens = Lens(_TRIAL_PIXELS, float(np.radians(PlanConfig.fov_degrees)), NEAR_RADII * bounds.radius)
    distance = framing_distance(bounds, yaws, pitches, lens.fov_radians, PlanConfig.fill)

    def of_view(camera: Camera) -> tuple[FloatArray, float]:
        alone = render(target, camera, weights=True).weights.sum()
        weights = render(everything, camera, weights=True).weights[: len(target)]
        return weights, float(weights.sum() / max(alone, 1e-9))

    cameras = ring(bounds.centre, bounds.axes, distance, yaws, pitches, lens)
    views: Sequence[tuple[FloatArray, float]] = list(parallel_map(of_view, cameras))
    return np.stack([weights for weights, _ in views]), np.array([share for _, share in views])

"""What one view shows of a thing, carried on to the sides that it does not show.

A click or a mask tells what is meant in one view. Seen from all around, the surface goes on from there, and is divided
where that costs least: along grooves, where the colour changes, far from what the view shows to be the object and close
to what it shows not to be. What lies behind the object but beside its outline in the view would have been seen if it
belonged to it. What the view hides is drawn to neither side, but a little to the surroundings, so that a thing that
hardly touches the object does not come along.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians
from gaussian_trimmer.geometry.components import connected_points
from gaussian_trimmer.rendering import Renderer, Rendering
from gaussian_trimmer.selecting.surface import Surface, look_around

HIDDEN = -0.05
"""Pull of what the first view hides, by area in squared radii."""
COLOUR_ROUNDS = 3
"""How often colours are learnt from the division and the division made with them."""
GAP = 0.2
"""Widest gap within one thing, in radii."""
_SHOWN = 15.0
"""Pull of what the view shows, by area in squared radii."""
_COLOUR = 0.3
"""Pull of colours that tell object and surroundings apart, by area in squared radii and log-ratio."""
_IN_FRONT = 0.2
"""What is nearer than the mask beside it, by this many radii, may hide parts of the object."""
_MARGIN = 1.0
"""How far beside the mask the surroundings are looked at, in radii."""
LEAST_SURFACE = 20
"""Gaussians that a surface must have."""


def carry_on(
    gaussians: Gaussians, camera: Camera, picture: Rendering, mask: BoolArray, up: Float64Array, renderer: Renderer,
    seen_from: Sequence[Camera] = (),
) -> BoolArray:  # fmt: skip
    """The Gaussians (N,) of the thing that a view's mask (H, W) shows, on all of its sides; none for an empty mask.

    Args:
        picture: what the view shows.
        up: the scene's up vector, (3,).
        seen_from: training cameras, if known: the thing is not looked at from where they were not.
    """
    nothing = np.zeros(len(gaussians), np.bool_)
    solid = mask & (picture.alpha > 0.5)
    if not solid.any():
        return nothing
    centre, radius = _place_of(camera, picture, solid)
    pixels, depths = camera.project(gaussians.means.astype(np.float64))
    spot = np.clip(np.nan_to_num(pixels), 0, (camera.width - 1, camera.height - 1)).astype(np.int64)
    wanted = (depths > 0) & _near(mask, pixels, _MARGIN * radius * camera.K[0, 0] / np.median(picture.depth[solid]))
    surface = look_around(gaussians, camera, centre, radius, wanted, up, renderer, seen_from)
    if len(surface.rows) < LEAST_SURFACE:
        return nothing
    behind = _visible_beside(picture, mask, _IN_FRONT * radius)
    allowed = mask[spot[:, 1], spot[:, 0]] | ~behind[spot[:, 1], spot[:, 0]]

    outside, inside = renderer.blend_weights(gaussians, camera, mask.astype(np.uint8), 2)[surface.rows].T
    share = inside / np.maximum(inside + outside, 1e-12)
    unseen = np.where(allowed[surface.rows], HIDDEN, -_SHOWN)
    pulls = surface.areas * np.where(surface.in_first, _SHOWN * (2 * share - 1), unseen)
    undecided = surface.areas * (~surface.in_first & allowed[surface.rows])
    part = surface.divide(pulls)
    for _ in range(COLOUR_ROUNDS):
        ratio, told = surface.colour_evidence(part)
        part = surface.divide(pulls + _COLOUR * colour_trust(told) * undecided * ratio)
    part = _connected_to_seen(surface, part, surface.in_first & (share > 0.5))
    return surface.with_hidden(gaussians, part, allowed)


def colour_trust(told: float) -> float:
    """Weight of colours that tell this share of both sides right, 0 to 1.

    >>> colour_trust(0.5), colour_trust(1.0)
    (0.0, 1.0)
    """
    return float(np.clip((told - 0.6) / 0.35, 0, 1)) ** 2


def _place_of(camera: Camera, picture: Rendering, mask: BoolArray) -> tuple[Float64Array, float]:
    """World point in the middle of what a mask shows, and half of its larger side there."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    depth = float(np.median(picture.depth[mask]))
    middle = np.array([[columns[0] + columns[-1] + 1, rows[0] + rows[-1] + 1]]) / 2
    ray = camera.ray_directions(middle)[0]
    half = max(columns[-1] + 1 - columns[0], rows[-1] + 1 - rows[0]) / 2
    return camera.centre + ray * depth / (ray @ camera.forward), float(half * depth / camera.K[0, 0])


def _near(mask: BoolArray, pixels: Float64Array, margin: float) -> BoolArray:
    """Which pixel coordinates (N, 2) lie within the mask's bounding box and a margin around it, (N,)."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    low = np.array([columns[0], rows[0]]) - margin
    high = np.array([columns[-1], rows[-1]]) + 1 + margin
    return np.asarray(((pixels > low) & (pixels < high)).all(axis=1))


def _visible_beside(picture: Rendering, mask: BoolArray, tolerance: float) -> BoolArray:
    """Pixels (H, W) outside a mask that show what is not clearly nearer than the mask beside them: no part of the
    object can hide there."""
    _, labels = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    depths = np.zeros(labels.max() + 1, np.float32)
    depths[labels[mask]] = picture.depth[mask]
    clear: FloatArray = depths[labels]
    return np.asarray(~mask & ((picture.depth > clear - tolerance) | (picture.alpha < 0.5)))


def _connected_to_seen(surface: Surface, part: BoolArray, seen: BoolArray) -> BoolArray:
    """The pieces of a part (S,) in which something is seen, (S,)."""
    rows = np.flatnonzero(part)
    if len(rows) == 0:
        return part
    piece = connected_points(surface.places[rows].astype(np.float64), GAP * surface.radius)
    kept = np.bincount(piece, seen[rows])[piece] > 0
    found = np.zeros(len(part), np.bool_)
    found[rows[kept]] = True
    return found

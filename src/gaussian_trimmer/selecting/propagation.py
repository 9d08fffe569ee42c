"""From the mask of one view to the object on all of its sides.

The surface graph around the object goes on where the view ends. What is visible in the view is object or background by
the mask. What is hidden cannot be object where it lies behind the background beside the mask: it would have been
visible. Everything else is decided by the minimum cut: a short boundary along concave edges and changes of colour. A
small unary term for the background keeps out what is hidden and hardly touches the object.
"""

from __future__ import annotations

import cv2
import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray
from gaussian_trimmer.rendering import Rendering
from gaussian_trimmer.surface.surface_cut import HIDDEN_UNARY, SurfaceCut
from gaussian_trimmer.surface.surface_graph import SurfaceGraph, axis_ends, build_surface_graph
from gaussian_trimmer.surface.viewed_scene import ViewedScene
from gaussian_trimmer.views.view import bounding_box

_COLOUR_ROUNDS = 3
_VISIBLE_UNARY = 15.0
"""Unary term of surface that is visible in the user's view, by area in squared radii."""
_COLOUR_WEIGHT = 0.3
"""Weight of the colours' log-likelihood ratio, by area in squared radii."""
_IN_FRONT_DEPTH = 0.2
"""Depth difference, in radii, from which something beside the mask may hide a part of the object."""
_SURROUNDINGS_RADII = 1.0
"""Width of the surroundings that are looked at, in radii."""
_MIN_PIECE_SHARE = 0.01
"""Smallest share of the visible object that a piece of it must hold."""
_MAX_REMNANT_AREA, _MIN_ATTACHED_LENGTH = 0.1, 0.5
"""Area of a remnant relative to the object's, and length of its boundary with it relative to the root of its area."""


def propagate_mask(scene: ViewedScene, picture: Rendering, mask: BoolArray) -> BoolArray:
    """Return the object that a view's mask shows, on all of its sides, (N,); nothing where the mask shows no surface.

    Args:
        scene: the scene in that view.
        picture: the view's rendering.
        mask: the object in it, (H, W).
    """
    gaussians, camera = scene.gaussians, scene.camera
    nothing = np.zeros(len(gaussians), np.bool_)
    solid = mask & (picture.alpha > 0.5)
    if not solid.any():
        return nothing
    box, depth = bounding_box(solid), float(np.median(picture.depth[solid]))
    radius = max(box[2] - box[0], box[3] - box[1]) / 2 * depth / camera.K[0, 0]
    ray = camera.ray_directions(np.array([[box[0] + box[2], box[1] + box[3]]]) / 2)[0]
    centre = camera.centre + ray * depth / (ray @ camera.forward)
    pixels, depths = camera.project(gaussians.means.astype(np.float64))
    margin = _SURROUNDINGS_RADII * radius / depth * camera.K[0, 0]
    candidates = (depths > 0) & ((pixels > np.array(box[:2]) - margin) & (pixels < np.array(box[2:]) + margin)).all(1)
    graph = build_surface_graph(scene, centre, radius, candidates)
    if graph is None:
        return nothing

    possible = ~_visible_background(picture, mask, _IN_FRONT_DEPTH * radius)
    allowed = _at(possible, pixels)
    rows = np.concatenate([graph.rows, graph.hidden])
    for ends in axis_ends(gaussians.select(rows)):
        allowed[rows] &= _at(possible, camera.project(ends)[0])
    outside, inside = (weights[graph.rows] for weights in scene.label_weights(mask))
    share = inside / np.maximum(inside + outside, 1e-12)
    part = _cut(graph, share, allowed[graph.rows])
    part = _with_remnants(graph, _without_specks(graph, part, graph.visible_in_view & (share > 0.5)))
    return graph.with_hidden(gaussians, part, allowed)


def _cut(graph: SurfaceGraph, share: FloatArray, allowed: BoolArray) -> BoolArray:
    """Cut by the share of each node in the mask (S,), and by which hidden ones can be object, (S,)."""
    hidden = np.where(allowed, HIDDEN_UNARY, -_VISIBLE_UNARY)
    unaries = graph.areas * np.where(graph.visible_in_view, _VISIBLE_UNARY * (2 * share - 1), hidden)
    undecided = graph.areas * (~graph.visible_in_view & allowed)
    cut = SurfaceCut(graph, np.zeros(len(allowed), np.bool_), True, undecided, _COLOUR_ROUNDS)
    *_, last = cut.cuts(unaries, _COLOUR_WEIGHT)
    return last


def _at(mask: BoolArray, pixels: Float64Array) -> BoolArray:
    """Return values of a mask (H, W) at pixels (N, 2), outside the image those of the nearest ones, (N,)."""
    x, y = np.clip(np.nan_to_num(pixels), 0, (mask.shape[1] - 1, mask.shape[0] - 1)).astype(np.int64).T
    return np.asarray(mask[y, x])


def _visible_background(picture: Rendering, mask: BoolArray, tolerance: float) -> BoolArray:
    """Return pixels outside a mask at which nothing clearly nearer than its nearest part can hide it, (H, W)."""
    _, nearest_pixel = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    depths = np.zeros(nearest_pixel.max() + 1, np.float32)
    depths[nearest_pixel[mask]] = picture.depth[mask]
    in_front = (picture.alpha > 0.5) & (picture.depth < depths[nearest_pixel] - tolerance)
    return np.asarray(~mask & ~in_front)


def _without_specks(graph: SurfaceGraph, part: BoolArray, visible: BoolArray) -> BoolArray:
    """Return the connected pieces of a part (S,) that hold enough of what is visible of it, (S,)."""
    rows, piece = graph.pieces(part)
    if len(rows) == 0:
        return part
    areas = np.bincount(piece, graph.areas[rows] * visible[rows])
    found = np.zeros(len(part), np.bool_)
    found[rows] = (areas > _MIN_PIECE_SHARE * areas.sum())[piece]
    return found


def _with_remnants(graph: SurfaceGraph, part: BoolArray) -> BoolArray:
    """Add to a part (S,) the small connected pieces of the rest that are attached to it and nothing else, (S,)."""
    rows, numbers = graph.pieces(~part)
    if len(rows) == 0 or not part.any():
        return part
    piece = np.zeros(len(part), np.int64)
    piece[rows] = numbers
    across = part[graph.edges[:, 0]] != part[graph.edges[:, 1]]
    outer = graph.edges[across][~part[graph.edges[across]]]
    areas = np.bincount(piece[rows], graph.areas[rows], len(part))
    attached = np.bincount(piece[outer], graph.lengths[across], len(part))
    remnant = (areas < _MAX_REMNANT_AREA * graph.areas[part].sum()) & (attached > _MIN_ATTACHED_LENGTH * np.sqrt(areas))
    found = part.copy()
    found[rows] = remnant[piece[rows]]
    return found

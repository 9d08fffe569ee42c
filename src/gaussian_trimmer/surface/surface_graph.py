"""The visible surface around a point as a graph: its nodes are Gaussians, its edges say which belong together.

Views from all around tell which Gaussians are visible; the others follow the nearest visible ones. An edge between
neighbours is weak where their colours differ and where the surface is concave: objects that touch each other, and the
parts of an object, meet in concave edges ("Object Partitioning using Local Convexity", Stein et al., CVPR 2014). A
minimum cut of this graph is a short boundary that runs along such places.

A unary term of growing strength lets ever more nodes change sides: a weak one moves only what hardly hangs on the rest,
a strong one all that may be meant. Each cut is repeated with the colours that it found on either side. Of all parts
that change sides in this way, good ones have a short boundary along concave edges and changes of colour.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera, up_frame
from gaussian_trimmer.gaussians import (
    BoolArray,
    Float64Array,
    FloatArray,
    Gaussians,
    IntArray,
    mask_of_rows,
    rotation_matrices,
)
from gaussian_trimmer.geometry.graphs import connected_points, min_cut, nearest
from gaussian_trimmer.rendering.tile_renderer import shown_weights
from gaussian_trimmer.surface.surface_estimates import (
    colour_bins,
    colour_evidence,
    directions_to,
    estimate_surface,
)
from gaussian_trimmer.surface.viewed_scene import ViewedScene, shown_weight
from gaussian_trimmer.views.camera_rings import NEAR_RADII, Lens, ring, ring_directions
from gaussian_trimmer.views.view import HALF, visible_weight

_REACH_RADII = 3.0
"""Distance from the point within which Gaussians are looked at, in radii."""
_VIEW_RINGS = ((5.0, 8), (35.0, 8), (65.0, 4))
"""Pitch in degrees and number of views of each ring around the point."""
_MAX_ANGLE_COSINE = np.cos(np.radians(50))
"""Cosine of the largest angle between a view and the nearest training camera: beyond it nothing was photographed."""
_SIZE_PIXELS, _FOV_RADIANS, _DISTANCE_RADII = 256, float(np.radians(60)), 4.0
"""Size in pixels, field of view and distance in radii of these views."""
_REFERENCE_RADIUS = 64.0
"""Radius in pixels to which the weights of the user's view are scaled, whatever its resolution."""
_MIN_VISIBLE, _MIN_VISIBLE_IN_VIEW = 0.5, 0.3
"""Smallest visible weight of a node, in pixels over all views, and in the user's view to be judged by it."""
_MIN_NODES = 20
"""Fewer visible Gaussians are no surface that can be cut."""
_MAX_NODES = 15_000
_GAP_RADII, _GAP_SPACINGS = 0.1, 3.0
"""Largest gap within a connected piece, in radii, or in distances between neighbouring nodes if that is more."""
_HIDDEN_NEIGHBOURS, _HIDDEN_REACH_RADII = 4, 0.5
"""Number of nodes that a hidden Gaussian follows, and its largest distance from the nearest, in radii."""
HIDDEN_UNARY = -0.05
"""Unary term of surface that is hidden in the user's view, by area in squared radii."""
_LENGTH_PENALTY = 0.25
"""How fast the score falls with the boundary's weight, relative to the root of the part's area."""


@dataclass(frozen=True, eq=False)
class SurfaceGraph:
    """The S visible Gaussians, of a scene's N, around a point."""

    centre: Float64Array
    """The point, (3,)."""
    radius: float
    """The unit of lengths and areas, about half the object's size, in scene units."""
    rows: IntArray
    """Rows of the nodes in the scene, (S,)."""
    hidden: IntArray
    """Rows of the other Gaussians around the point, (H,)."""
    means: FloatArray
    """Centres of the nodes, (S, 3)."""
    colours: FloatArray
    """Lab colours of the nodes, smoothed along the surface, (S, 3)."""
    areas: Float64Array
    """Area of surface that each node stands for, in squared radii, (S,)."""
    visible_in_view: BoolArray
    """Which nodes are visible in the user's view, (S,)."""
    edges: IntArray
    """Pairs of neighbouring nodes, each once, (E, 2)."""
    lengths: Float64Array
    """Length of boundary that passes between both nodes of an edge, in radii, (E,)."""
    weights: Float64Array
    """That length times how much both belong together, 0 to 1, (E,)."""

    @property
    def gap(self) -> float:
        """Largest distance between nodes in one connected piece, in scene units."""
        return self.radius * max(_GAP_RADII, _GAP_SPACINGS * float(np.sqrt(np.median(self.areas))))

    def cut(self, unaries: Float64Array) -> BoolArray:
        """Return which nodes are object by the minimum cut, (S,).

        Args:
            unaries: the cost of each node as background, or, below zero, of each as object, (S,); minus infinity for
                certain background.
        """
        free = ~np.isneginf(unaries)
        numbers = np.cumsum(free) - 1
        ends = free[self.edges]
        within, across = ends.all(axis=1), ends[:, 0] != ends[:, 1]
        border = self.edges[across][ends[across]]
        unaries = unaries - np.bincount(border, self.weights[across], len(unaries))
        found = np.zeros(len(unaries), np.bool_)
        found[free] = min_cut(unaries[free], numbers[self.edges[within]], self.weights[within])
        return found

    def boundary(self, part: BoolArray, others: BoolArray) -> tuple[float, float]:
        """Return the weight and length of the boundary between some nodes (S,) and others (S,), in radii."""
        a, b = self.edges.T
        across = (part[a] & others[b]) | (part[b] & others[a])
        return float(self.weights[across].sum()), float(self.lengths[across].sum())

    def pieces(self, part: BoolArray) -> tuple[IntArray, IntArray]:
        """Return the nodes of a part (S,), and the number of the connected piece that each is in, (P,) each."""
        nodes = np.flatnonzero(part)
        if len(nodes) == 0:
            return nodes, nodes
        return nodes, connected_points(self.means[nodes].astype(np.float64), self.gap)

    def colour_evidence(self, part: BoolArray, others: BoolArray) -> tuple[Float64Array, float]:
        """Return the clipped log-likelihood ratio of each node's colour in a part (S,) against others (S,), (S,).

        The second value is the balanced accuracy of the ratio's sign, 0.5 for colours that tell nothing.
        """
        return colour_evidence(colour_bins(self.colours), self.areas * part, self.areas * others)

    def with_hidden(self, gaussians: Gaussians, part: BoolArray, allowed: BoolArray) -> BoolArray:
        """Return some nodes (S,) and the hidden Gaussians beside them that are allowed (N,), as a selection (N,)."""
        selection = mask_of_rows(self.rows[part], len(gaussians))
        candidates = self.hidden[allowed[self.hidden]]
        selection[self.followers(gaussians, part, np.ones(len(part), np.bool_), candidates)] = True
        return selection

    def followers(self, gaussians: Gaussians, part: BoolArray, comparable: BoolArray, candidates: IntArray) -> IntArray:
        """Return those of some rows of the scene most of whose nearest comparable nodes (S,) are in a part (S,)."""
        if len(candidates) == 0:
            return candidates
        neighbours = min(_HIDDEN_NEIGHBOURS, len(self.means))
        squared, near = nearest(self.means, gaussians.means[candidates], neighbours)
        share = (part & comparable)[near].sum(axis=1) / np.maximum(comparable[near].sum(axis=1), 1)
        return np.asarray(candidates[(share > HALF) & (squared[:, 0] < (_HIDDEN_REACH_RADII * self.radius) ** 2)])


@dataclass(frozen=True, eq=False)
class SurfaceCut:
    """Which of the S nodes of a surface graph may change sides."""

    graph: SurfaceGraph
    before: BoolArray
    """Which nodes are selected before the cut, (S,)."""
    inside: bool
    """Whether nodes become selected by the cut, rather than not."""
    colour_areas: Float64Array
    """Areas of the nodes for which colour counts, zero for the others, (S,)."""
    colour_rounds: int
    """How often a cut is repeated with the colours of its parts."""

    def cuts(
        self, unaries: Float64Array, colour: float, tidied: Callable[[BoolArray], BoolArray] = lambda part: part
    ) -> Iterator[BoolArray]:
        """Yield the selected nodes after the cut, and after each repetition with colours, (S,) each.

        Args:
            unaries: as for `SurfaceGraph.cut`, (S,).
            colour: weight of the colours' log-likelihood ratio.
            tidied: what is made of each cut before the next one.
        """
        areas = self.colour_areas if self.inside else -self.colour_areas
        part = tidied(self.graph.cut(unaries))
        yield part
        for _ in range(self.colour_rounds):
            ratio, accuracy = self.graph.colour_evidence(*self.sides(part))
            part = tidied(self.graph.cut(unaries + colour * colour_weight(accuracy) * areas * ratio))
            yield part

    def sweep(
        self,
        terms: Iterable[tuple[Float64Array, float]],
        tidied: Callable[[BoolArray], BoolArray] = lambda part: part,
    ) -> Iterator[BoolArray]:
        """Yield the cuts for several unary terms and weights of colour, each once."""
        seen: set[bytes] = set()
        for unaries, colour in terms:
            for part in self.cuts(unaries, colour, tidied):
                if part.tobytes() in seen:
                    break
                seen.add(part.tobytes())
                yield part

    def sides(self, part: BoolArray) -> tuple[BoolArray, BoolArray]:
        """Return which nodes changed sides and which stayed on the side that they left, (S,) each."""
        changed = part != self.before
        return changed, (self.before != self.inside) & ~changed

    def separation(self, part: BoolArray, least_contrast: float = 0.0) -> float:
        """Return how well what changed sides is separated from what did not, about 0 to 1."""
        changed, others = self.sides(part)
        if not changed.any() or not others.any():
            return 0.0
        weight, length = self.graph.boundary(changed, others)
        _, accuracy = self.graph.colour_evidence(changed, others)
        contrast = least_contrast + (1 - weight / max(length, 1e-12))
        shortness = float(np.exp(-_LENGTH_PENALTY * weight / np.sqrt(self.graph.areas[changed].sum())))
        return contrast**2 * accuracy * shortness


def colour_weight(accuracy: float) -> float:
    """Return the weight of colour models by their balanced accuracy, 0 to 1.

    >>> colour_weight(0.5), colour_weight(1.0)
    (0.0, 1.0)
    """
    return float(np.clip((accuracy - 0.6) / 0.35, 0, 1)) ** 2


def build_surface_graph(
    scene: ViewedScene, centre: Float64Array, radius: float, candidates: BoolArray, reach: float = 1.0
) -> SurfaceGraph | None:
    """Return the visible surface around a point, from the user's view and from all around; None if hardly any shows.

    Args:
        scene: the scene in the user's view.
        centre: the point, (3,).
        radius: about half the size of the object there, in scene units.
        candidates: which Gaussians may become nodes, (N,).
        reach: factor on the distance within which Gaussians are looked at.
    """
    gaussians, camera = scene.gaussians, scene.camera
    near = np.flatnonzero(np.linalg.norm(gaussians.means - centre, axis=1) < _REACH_RADII * reach * radius)
    local = gaussians.select(near)
    views = _views_around(scene, centre, reach * radius)
    pixels = radius * camera.K[0, 0] / float(np.linalg.norm(camera.centre - centre))
    in_view = shown_weight(gaussians, camera)[near] * np.float32((_REFERENCE_RADIUS / pixels) ** 2)
    weights = shown_weights(local, views)
    visible = in_view + (visible_weight(weights, views) if views else np.float32(0))
    nodes = candidates[near] & (visible > _MIN_VISIBLE)
    if np.count_nonzero(nodes) > _MAX_NODES:
        nodes &= visible >= np.partition(visible[nodes], -_MAX_NODES)[-_MAX_NODES]
    if np.count_nonzero(nodes) < _MIN_NODES:
        return None
    facing = np.zeros((np.count_nonzero(nodes), 3), np.float32)
    for weight, view in zip([*weights, in_view], [*views, camera], strict=True):
        facing += weight[nodes, None] * directions_to(local.means[nodes], view.centre)
    surface = estimate_surface(local.select(nodes), visible[nodes], facing)
    return SurfaceGraph(
        centre,
        radius,
        near[nodes],
        near[~nodes],
        local.means[nodes],
        surface.colours,
        np.square(surface.spacing / radius, dtype=np.float64),
        in_view[nodes] > _MIN_VISIBLE_IN_VIEW,
        surface.edges,
        surface.lengths / radius,
        surface.lengths / radius * surface.affinity,
    )


def axis_ends(gaussians: Gaussians) -> tuple[Float64Array, Float64Array]:
    """Return both ends of each Gaussian's longest axis, two standard deviations from its centre, (N, 3) each."""
    longest = np.argmax(gaussians.log_scales, axis=1)
    axes = rotation_matrices(gaussians.quaternions)[np.arange(len(gaussians)), :, longest]
    arms = 2 * np.exp(gaussians.largest_log_scales.astype(np.float64))[:, None] * axes
    return gaussians.means - arms, gaussians.means + arms


def _views_around(scene: ViewedScene, centre: Float64Array, radius: float) -> list[Camera]:
    """Return small views of a point from all around, starting at the user's yaw."""
    axes = up_frame(scene.up)
    offset = axes @ (scene.camera.centre - centre)
    steps = np.concatenate([2 * np.pi * np.arange(number) / number for _, number in _VIEW_RINGS])
    yaws = np.arctan2(offset[1], offset[0]) + steps
    pitches = np.concatenate([np.full(number, np.radians(pitch)) for pitch, number in _VIEW_RINGS])
    photographed = -directions_to(np.array([taken.centre for taken in scene.seen_from]).reshape(-1, 3), centre)
    if len(photographed):
        near = (ring_directions(axes, yaws, pitches) @ photographed.T).max(axis=1) > _MAX_ANGLE_COSINE
        yaws, pitches = yaws[near], pitches[near]
    return ring(
        centre, axes, _DISTANCE_RADII * radius, yaws, pitches, Lens(_SIZE_PIXELS, _FOV_RADIANS, NEAR_RADII * radius)
    )

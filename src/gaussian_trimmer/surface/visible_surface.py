"""The visible surface of a scene: the Gaussians that show in its views, and how their neighbours hang together.

Lengths are in units that do not depend on the scene's own: one is half of what a picture's longer side spans at the
usual depth. Axes are turned so that the third points up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from gaussian_trimmer.cameras import Camera, CameraSet, Viewpoint, training_cameras, up_frame
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, IntArray, rotation_matrices
from gaussian_trimmer.geometry.graphs import nearest
from gaussian_trimmer.parallel import in_shares, parallel_map
from gaussian_trimmer.surface.overview import drawn_part, plan_overview
from gaussian_trimmer.surface.surface_estimates import SurfaceEstimates, colour_bins, directions_to, estimate_surface
from gaussian_trimmer.surface.viewed_scene import shown_weight

Item = TypeVar("Item")

_MOST_VIEWS = 16
"""Number of the training cameras, evenly spread, from which the scene is looked at."""
_SIDE_PIXELS = 320
"""Longer side of a view."""
_MIN_SHOWN_PIXELS = 0.5
"""Weight over all views, in pixels, from which on a Gaussian belongs to the visible surface."""
_REACH = 5.0
"""Distance from the middle beyond which nothing is looked at: far walls, trees and sky."""
_MOST_NODES = 400_000
_MIN_NODES = 50


class NothingShowsError(InputError):
    """Hardly anything shows in the views."""


@dataclass(frozen=True, eq=False)
class Look:
    """What V views show of a scene: S of its N Gaussians."""

    views: list[Viewpoint]
    rows: IntArray
    """Rows of the scene, (S,), ascending."""
    shown: FloatArray
    """Weight of each Gaussian in each view, in pixels, (V, S)."""
    unit: float
    """Length of one unit in the scene's own."""
    centre: Float64Array
    """Middle of what shows, (3,)."""


@dataclass(frozen=True, eq=False)
class MeasuredSurface:
    """M Gaussians of a scene of N that show somewhere, and the E edges between neighbours."""

    rows: IntArray
    """Rows of the scene, (M,), ascending."""
    estimates: SurfaceEstimates
    overlap: Float64Array
    """How much the Gaussians of each edge overlap, 0 to 1, (E,)."""
    nearest: IntArray
    """Which of the M Gaussians is nearest to each of the scene, (N,)."""
    distance: FloatArray
    """Squared distance to it, (N,)."""


@dataclass(frozen=True, eq=False)
class VisibleSurface:
    """The S visible Gaussians of a scene of N, seen in V views, and the E edges between neighbours."""

    rows: IntArray
    """Rows of the scene, (S,)."""
    unit: float
    """Length of one unit in the scene's own."""
    centre: Float64Array
    """Middle of the surface in the scene, (3,)."""
    axes: Float64Array
    """Two horizontal axes and up, in the scene, (3, 3)."""
    points: Float64Array
    """Centres, in units and along these axes, from the middle, (S, 3)."""
    normals: Float64Array
    """Unit normals on the side that is seen, along these axes, (S, 3)."""
    flatness: FloatArray
    """How flat the surface is around each, 0 to 1, (S,)."""
    areas: Float64Array
    """Area that each stands for, in square units, (S,)."""
    shown: FloatArray
    """Share of each view that each Gaussian fills, (V, S)."""
    inside: FloatArray
    """Share of the views in which each lies within the picture, (S,)."""
    colours: IntArray
    """Bin of the colour histogram that each lies in, (S,)."""
    measured: MeasuredSurface
    """What it is a part of."""
    edges: IntArray
    """Pairs of neighbours, each once, (E, 2)."""
    contact: Float64Array
    """Length of boundary along which both touch, in units, (E,)."""
    affinity: Float64Array
    """How much both belong together by colour and convexity, 0 to 1, (E,)."""

    @property
    def filled(self) -> float:
        """Share of the pictures that the scene fills."""
        return float(self.shown.sum(axis=1).mean())

    @property
    def resolution(self) -> float:
        """Distance between neighbours, in units."""
        return float(np.median(np.sqrt(self.areas)))

    def box_in_scene(self, low: Float64Array, high: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return the middle of a box in the scene, (3,), and its size, (3,), by its corners among the points."""
        return self.centre + self.unit * (low + high) / 2 @ self.axes, self.unit * (high - low)


def evenly_spread(items: Sequence[Item], most: int) -> list[Item]:
    """Return at most so many of the items, evenly spread, with the first and the last one.

    >>> evenly_spread("abcdefg", 3)
    ['a', 'd', 'g']
    """
    places = np.unique(np.linspace(0, len(items) - 1, min(most, len(items))).round().astype(np.int64))
    return [items[place] for place in places]


def views_of(scene: Gaussians, cameras: CameraSet | None, up: Float64Array) -> list[Viewpoint]:
    """Return views to look at a scene from: some of the training cameras or, without cameras, around its middle."""
    taken = training_cameras(cameras)
    if taken:
        return [Viewpoint(camera) for camera in evenly_spread(taken, _MOST_VIEWS)]
    overview = plan_overview(scene, up)
    return overview.views if len(overview.whole) == len(overview.views) else overview.views[: overview.whole.start]


def look_at(
    scene: Gaussians,
    views: Sequence[Viewpoint],
    looked: Callable[[int], None] = lambda number: None,
) -> Look:
    """Find the Gaussians that show in some views.

    Args:
        scene: all N Gaussians.
        views: where it is seen from.
        looked: called before each view with its number, from 1.

    Raises:
        NothingShowsError: hardly anything shows.
    """
    plain = scene.replace(sh_rest=scene.sh_rest[:, :, :0])  # how much they show does not depend on colours
    small = [replace(view, camera=_small(view.camera)) for view in views]
    shown = np.zeros((len(views), len(scene)), np.float32)

    def weighed(view: Viewpoint) -> tuple[IntArray, FloatArray]:
        drawn, rows = drawn_part(plain, view)
        return rows, shown_weight(drawn, view.camera)

    for number, (rows, weights) in enumerate(parallel_map(weighed, small)):
        looked(number + 1)
        shown[number, rows] = weights
    total = shown.sum(axis=0)
    rows = np.flatnonzero(total > _MIN_SHOWN_PIXELS)
    if len(rows) < _MIN_NODES:
        raise NothingShowsError("Hardly anything shows in the views; check that the cameras belong to this scene.")
    points = scene.means[rows].astype(np.float64)
    unit, centre = _unit(points, shown[:, rows], [view.camera for view in small]), np.median(points, axis=0)
    rows = rows[np.linalg.norm(points - centre, axis=1) < _REACH * unit]
    if len(rows) > _MOST_NODES:
        rows = np.sort(rows[np.argsort(-total[rows], kind="stable")[:_MOST_NODES]])
    return Look(small, rows, shown[:, rows], unit, centre)


def measure(scene: Gaussians, looks: Sequence[Look]) -> MeasuredSurface:
    """Measure the Gaussians that show in some looks at a scene of N Gaussians."""
    shown, facing = np.zeros(len(scene), np.float32), np.zeros((len(scene), 3), np.float32)
    for look in looks:
        shown[look.rows] += look.shown.sum(axis=0)
        for weight, view in zip(look.shown, look.views, strict=True):
            facing[look.rows] += weight[:, None] * directions_to(scene.means[look.rows], view.camera.centre)
    rows = np.unique(np.concatenate([look.rows for look in looks]))
    local = scene.select(rows)
    found = estimate_surface(local, shown[rows], facing[rows])
    hidden = np.setdiff1d(np.arange(len(scene)), rows, assume_unique=True)
    beside, distance = np.empty(len(scene), np.int64), np.zeros(len(scene), np.float32)
    beside[rows] = np.arange(len(rows))
    squared, near = nearest(local.means, scene.means[hidden], 1)
    beside[hidden], distance[hidden] = near[:, 0], squared[:, 0]
    return MeasuredSurface(rows, found, _touching(local, found.edges), beside, distance)


def visible_surface(scene: Gaussians, look: Look, measured: MeasuredSurface, up: Float64Array) -> VisibleSurface:
    """Return the surface that a look shows.

    Args:
        scene: all N Gaussians.
        look: what is seen of it.
        measured: the Gaussians that show in this look, and maybe others.
        up: the up vector, (3,).
    """
    places = np.searchsorted(measured.rows, look.rows)
    found, axes, unit = measured.estimates, up_frame(up), look.unit
    numbers = np.full(len(measured.rows), -1)
    numbers[places] = np.arange(len(places))
    edges = _edges_among(found.edges, numbers)
    pixels = np.array([[view.camera.width * view.camera.height] for view in look.views], np.float32)
    areas = np.square(found.spacing[places] / unit, dtype=np.float64)
    means = scene.means[look.rows]
    return VisibleSurface(
        rows=look.rows,
        unit=unit,
        centre=look.centre,
        axes=axes,
        points=(means - look.centre) @ axes.T / unit,
        normals=found.normals[places] @ axes.T,
        flatness=found.flatness[places],
        areas=np.minimum(areas, np.quantile(areas, 0.99)),
        shown=look.shown / pixels,
        inside=_inside(means.astype(np.float64), [view.camera for view in look.views]),
        colours=colour_bins(found.colours[places]),
        measured=measured,
        edges=numbers[found.edges[edges]],
        contact=found.lengths[edges] / unit * measured.overlap[edges],
        affinity=found.affinity[edges],
    )


def find_visible_surface(
    scene: Gaussians,
    views: Sequence[Viewpoint],
    up: Float64Array,
    looked: Callable[[int], None] = lambda number: None,
) -> VisibleSurface:
    """Return the surface that some views show, as `look_at` and `visible_surface` find it."""
    look = look_at(scene, views, looked)
    return visible_surface(scene, look, measure(scene, [look]), up)


def with_hidden(surface: VisibleSurface, numbers: IntArray, reach: float, among: IntArray) -> IntArray:
    """Return the number of the nearest Gaussian that shows for some rows of the scene, 0 beyond reach, (A,).

    Args:
        surface: what shows.
        numbers: of its Gaussians, (S,).
        reach: largest distance, in units.
        among: the rows, (A,).
    """
    measured = surface.measured
    of_measured = np.zeros(len(measured.rows), np.int64)
    of_measured[np.searchsorted(measured.rows, surface.rows)] = numbers
    near = measured.distance[among] < (reach * surface.unit) ** 2
    return np.where(near, of_measured[measured.nearest[among]], 0)


def _edges_among(edges: IntArray, numbers: IntArray) -> IntArray:
    """Find the edges (E, 2), sorted by their first end, both of whose ends have a number (M,) that is not negative."""
    first, last = np.searchsorted(edges[:, 0], np.flatnonzero(numbers >= 0) + np.array([[0], [1]]))
    count = last - first
    found = np.repeat(last - np.cumsum(count), count) + np.arange(count.sum())
    return np.asarray(found[numbers[edges[found, 1]] >= 0])


def _small(camera: Camera) -> Camera:
    return camera.resized(min(1.0, _SIDE_PIXELS / max(camera.width, camera.height)))


def _unit(points: Float64Array, shown: FloatArray, cameras: Sequence[Camera]) -> float:
    """Return half of what a picture's longer side spans at the median depth of what each view shows."""
    spans = []
    for weight, camera in zip(shown, cameras, strict=True):
        depths = camera.project(points[weight > _MIN_SHOWN_PIXELS])[1]
        if len(depths):
            spans.append(float(np.median(depths)) * max(camera.width, camera.height) / (2 * camera.K[0, 0]))
    return float(np.median(spans))


def _inside(means: Float64Array, cameras: Sequence[Camera]) -> FloatArray:
    """Return the share of the cameras in whose pictures each centre (S, 3) lies, (S,)."""
    inside = np.zeros(len(means), np.float32)
    for camera in cameras:
        inside += camera.contains(camera.project(means)[0])
    return inside / np.float32(len(cameras))


def _touching(gaussians: Gaussians, edges: IntArray) -> Float64Array:
    """Return how much the Gaussians of each edge overlap, 0 to 1, (E,).

    It is the density of a normal distribution, relative to its peak, at their distance in sums of their standard
    deviations along it: surfaces are covered by Gaussians that overlap, dense scenes' as well as sparse ones'.
    """
    axes = rotation_matrices(gaussians.quaternions) * gaussians.scales[:, None]  # standard deviations long

    def overlap(rows: slice) -> Float64Array:
        a, b = edges[rows].T
        offset = (gaussians.means.take(b, axis=0) - gaussians.means.take(a, axis=0)).astype(np.float64)
        square = np.maximum(np.square(offset).sum(axis=1), 1e-30)
        along = [np.einsum("eik,ei->ek", axes.take(ends, axis=0), offset) for ends in (a, b)]
        deviations = [np.linalg.norm(one, axis=1) for one in along]
        return np.asarray(np.exp(-0.5 * np.square(square / np.maximum(deviations[0] + deviations[1], 1e-30))))

    return np.concatenate(in_shares(overlap, len(edges)))


def seen_share(shown: FloatArray) -> float:
    """Return the share of views in which something is seen well, beside the best one, by its share of each (V,)."""
    return float(np.mean(shown > 0.2 * shown.max(initial=0.0))) if shown.any() else 0.0

"""Small views of an object from all around, with it and without it, and the planes in them that it touches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray, LabelArray
from gaussian_trimmer.geometry.bounds import Bounds, own_frame, robust_bounds
from gaussian_trimmer.geometry.planes import Plane
from gaussian_trimmer.rendering.projection import Projection, project_views
from gaussian_trimmer.rendering.tile_renderer import Drawing, draw_projected
from gaussian_trimmer.views.small_views import views_of_place
from gaussian_trimmer.views.view import HALF, shown_by

THICKNESS_RADII = 0.05
"""Half of a surface's thickness, in object radii."""

_FAR = 1e6
"""Depth of what is seen where nothing is, in scene units."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A plane, and a frame in it, with lengths in object radii."""

    origin: Float64Array
    """The point of the plane nearest to the object's centre, (3,)."""
    axes: Float64Array
    """Unit vectors: two in the plane and its normal, which points to the object; right-handed, (3, 3)."""
    unit: float
    """The object's radius in scene units."""

    def coordinates(self, points: FloatArray | Float64Array) -> Float64Array:
        """Return two coordinates in the plane and the height above it of points (N, 3), in object radii."""
        return np.asarray((points - self.origin) @ self.axes.T / self.unit)

    def heights(self, points: FloatArray | Float64Array) -> Float64Array:
        """Return heights of points (..., 3) above the plane, in object radii, (...)."""
        return np.asarray((points - self.origin) @ self.axes[2] / self.unit)

    def pixel_heights(self, camera: Camera, depth: FloatArray) -> Float64Array:
        """Return heights above the plane of what a camera's pixels show at these depths (H, W), (H, W)."""
        plane = Plane(self.axes[2], float(self.axes[2] @ self.origin))
        return plane.pixel_heights(camera, depth) / self.unit

    def points(self, coordinates: Float64Array) -> Float64Array:
        """Return the points of the scene with given coordinates (N, 3)."""
        return np.asarray(coordinates @ self.axes * self.unit + self.origin)


def above_all(surfaces: Sequence[Surface], points: FloatArray | Float64Array, margin: float) -> BoolArray:
    """Return the points (N, 3) that lie higher than a margin, in object radii, above every surface, (N,)."""
    above = np.ones(len(points), np.bool_)
    for surface in surfaces:
        above &= surface.heights(points) > margin
    return above


class Sight(NamedTuple):
    """What one view shows."""

    camera: Camera
    silhouette: BoolArray
    """The object alone, (H, W)."""
    depth: FloatArray
    """Depth of what its pixels show, far away where nothing is, (H, W)."""
    of_object: bool
    """Whether it shows half as much of the object as the best view does, rather than a wall before it."""


@dataclass(frozen=True, eq=False)
class RemovalViews:
    """An object of a scene and the Gaussians around it, N in all, and small views of them; made as they are needed."""

    gaussians: Gaussians
    of_object: BoolArray
    """Gaussians that are the object, whole or in part, (N,)."""
    removed: BoolArray
    """Gaussians of any object that is removed, this one or another, (N,)."""
    bounds: Bounds
    """The object's bounds; their third axis is up."""
    cameras: Sequence[Camera]
    cameras_above: Sequence[Camera] = ()
    """Steep views, which only tell where surfaces are seen."""
    observing: Sequence[Camera] = ()
    """Views from where the object was seen, for what no surface explains."""
    beyond: Callable[[Sequence[Camera]], Gaussians] | None = None
    """Returns what cameras show of the rest of the scene; None if there is no rest."""
    pruned: BoolArray | None = None
    """Selected Gaussians that are not the object's only since they stick out of it when it is alone, (N,)."""
    projected: dict[tuple[Camera, ...], Projection] = field(default_factory=dict)
    """Everything in the views of some cameras, by these: which of it is the object makes no difference."""
    counted: dict[tuple[Surface, ...], list[IntArray]] = field(default_factory=dict, init=False)
    """How views see a surface among others, which is asked when it is found and when its picture is taken."""

    @cached_property
    def above(self) -> RemovalViews:
        """The same in the steep views."""
        return self._in(self.cameras_above)

    @cached_property
    def observed(self) -> RemovalViews:
        """The same in the views from where the object was seen."""
        return self._in(self.observing)

    @property
    def projection(self) -> Projection:
        """Everything in the views."""
        cameras = tuple(self.cameras)
        if cameras not in self.projected:
            self.projected[cameras] = project_views(self.gaussians, cameras, colours=False)
        return self.projected[cameras]

    @cached_property
    def alone(self) -> Drawing:
        """The object alone in each view, without colours."""
        return draw_projected(self.gaussians, self.projection.of(self.of_object), colours=False)

    @cached_property
    def silhouettes(self) -> list[BoolArray]:
        """The object alone in each view, (H, W)."""
        return [alpha > HALF for alpha in self.alone.alpha]

    @cached_property
    def scene(self) -> Drawing:
        """Everything in each view, without colours, with blend weights outside and inside the silhouette."""
        return draw_projected(self.gaussians, self.projection, images=self._sides, colours=False)

    @cached_property
    def _sides(self) -> list[FloatArray]:
        """Where each view shows what is outside and inside the silhouette, (2, H, W)."""
        return [np.stack([~mask, mask]).astype(np.float32) for mask in self.silhouettes]

    @cached_property
    def sights(self) -> list[Sight]:
        """What each view shows of the object and of the rest."""
        drawn = zip(self.visible_in_view, self.alone.alpha, strict=True)
        shares = [float(weights[self.of_object].sum() / max(alpha.sum(), 1)) for weights, alpha in drawn]
        least = HALF * max(shares, default=0)
        shown = zip(self.cameras, self.silhouettes, self.scene.alpha, self.scene.depth, shares, strict=True)
        return [
            Sight(camera, mask, np.where(alpha > HALF, depth, _FAR), share > least)
            for camera, mask, alpha, depth, share in shown
        ]

    @property
    def visible_in_view(self) -> FloatArray:
        """Blend weight of each Gaussian outside and inside the silhouette, with everything in each view, (V, N, 2)."""
        return self.scene.weights

    @cached_property
    def visible(self) -> FloatArray:
        """The same, in all views together, (N, 2)."""
        return np.asarray(self.visible_in_view.sum(axis=0))

    @cached_property
    def total_visible(self) -> FloatArray:
        """Blend weight of each Gaussian with everything in the views, (N,)."""
        return np.asarray(self.visible.sum(axis=1))

    def weigh(self, part: BoolArray) -> FloatArray:
        """Return the same as `visible` where only a part (N,) is in the views, (N, 2)."""
        drawn = draw_projected(self.gaussians, self.projection.of(part), images=self._sides, colours=False)
        return np.asarray(drawn.weights.sum(axis=0))

    def _in(self, cameras: Sequence[Camera]) -> RemovalViews:
        return replace(self, cameras=cameras, cameras_above=(), observing=())


def views_around(
    scene: Gaussians,
    gaussians: Gaussians,
    rows: IntArray,
    owner: LabelArray,
    number: int,
    up: Float64Array,
    cameras: Sequence[Camera],
    size: int,
    pruned: BoolArray | None,
) -> RemovalViews:
    """Return small views of an object and of what is around it.

    Args:
        scene: all Gaussians.
        gaussians: the object and those around it, N of them.
        rows: their rows in the scene, ascending, (N,).
        owner: number of the object that has each Gaussian of the scene, 0 for none.
        number: the object's.
        up: the up vector, (3,).
        cameras: views from where the object was seen.
        size: width and height of the views in pixels.
        pruned: those of the N that were pruned from the object, (N,); None where it is not known.
    """
    of_object = owner[rows] == number
    target = gaussians.select(of_object)
    bounds = robust_bounds(target, own_frame(target, up))
    around, above = (views_of_place(bounds, size, steep) for steep in (False, True))
    observing = [camera.resized(min(1, size / max(camera.width, camera.height))) for camera in cameras]

    def beyond(cameras: Sequence[Camera]) -> Gaussians:
        shown = shown_by(scene, cameras) & (owner == 0)
        shown[rows] = False
        return scene.select(shown)

    return RemovalViews(gaussians, of_object, owner[rows] > 0, bounds, around, above, observing, beyond, pruned)


def points_at(camera: Camera, depth: FloatArray | Float64Array) -> Float64Array:
    """Return the points of the scene that the pixels of a view show at given depths (H, W), (H, W, 3)."""
    y, x = np.indices(depth.shape) + 0.5
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(camera.K).T @ camera.rotation
    return np.asarray(camera.centre + rays * depth[..., None])

"""Small views of an object from all around, with it and without it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.rendering import Rendering, blend_weights, render
from gaussian_trimmer.views.view import HALF


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

    @cached_property
    def above(self) -> RemovalViews:
        """The same in the steep views."""
        return replace(self, cameras=self.cameras_above, cameras_above=())

    @cached_property
    def silhouettes(self) -> list[BoolArray]:
        """The object alone in each view, (H, W)."""
        return [rendering.alpha > HALF for rendering in self._render(self.gaussians.select(self.of_object))]

    @cached_property
    def renderings(self) -> list[Rendering]:
        """Everything in each view."""
        return self._render(self.gaussians)

    @cached_property
    def visible_in_view(self) -> FloatArray:
        """Blend weight of each Gaussian outside and inside the silhouette, with everything in each view, (V, N, 2)."""
        return np.array(list(self._weigh_in_views(self.gaussians)))

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
        total = np.zeros((len(part), 2), np.float32)
        for weights in self._weigh_in_views(self.gaussians.select(part)):
            total[part] += weights
        return total

    def _weigh_in_views(self, drawn: Gaussians) -> Iterator[FloatArray]:
        def weighed(camera: Camera, silhouette: BoolArray) -> FloatArray:
            return blend_weights(drawn, camera, silhouette.astype(np.uint8), 2)

        return parallel_map(weighed, self.cameras, self.silhouettes)

    def _render(self, part: Gaussians) -> list[Rendering]:
        return list(parallel_map(lambda c: render(part, c), self.cameras))

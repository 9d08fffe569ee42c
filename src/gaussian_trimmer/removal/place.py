"""The place of an object in small views from all around, with it and without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.rendering import Renderer, Rendering, parallel_map
from gaussian_trimmer.views import HALF


@dataclass(frozen=True, eq=False)
class Place:
    """An object of a scene, the Gaussians around it, N in all, and small views of them."""

    gaussians: Gaussians
    own: BoolArray
    """Which Gaussians are the object, whole or in part, (N,)."""
    removed: BoolArray
    """Which ones are any object that is removed, this one or another, (N,)."""
    bounds: Bounds
    """The object's bounds; their third axis is up."""
    cameras: Sequence[Camera]
    renderer: Renderer

    @cached_property
    def silhouettes(self) -> list[BoolArray]:
        """The object alone in each view, (H, W)."""
        alone = self.gaussians.select(self.own)
        drawn = parallel_map(lambda camera: self.renderer.render(alone, camera), self.cameras, using=[self.renderer])
        return [rendering.alpha > HALF for rendering in drawn]

    @cached_property
    def renderings(self) -> list[Rendering]:
        """The views with everything in them."""
        return list(
            parallel_map(lambda c: self.renderer.render(self.gaussians, c), self.cameras, using=[self.renderer])
        )

    @cached_property
    def seen(self) -> FloatArray:
        """Blend weight of each Gaussian outside and inside the silhouettes, with everything in the views, (N, 2)."""
        return self.weigh(np.ones(len(self.gaussians), np.bool_))

    def weigh(self, part: BoolArray) -> FloatArray:
        """The same where only a part (N,) is in the views, (N, 2)."""
        total, drawn = (
            np.zeros((len(part), 2), np.float32),
            self.gaussians if part.all() else self.gaussians.select(part),
        )

        def weighed(camera: Camera, silhouette: BoolArray) -> FloatArray:
            return self.renderer.blend_weights(drawn, camera, silhouette.astype(np.uint8), 2)

        for weights in parallel_map(weighed, self.cameras, self.silhouettes, using=[self.renderer]):
            total[part] += weights
        return total

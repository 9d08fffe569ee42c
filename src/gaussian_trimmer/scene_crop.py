"""The part of a scene that is looked at for one object: the object, the Gaussians around it, and the views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.support_plane import SupportPlane, SupportPlaneConfig, find_support_plane


@dataclass(frozen=True, eq=False)
class SceneCrop:
    """L Gaussians of a scene, and the cameras of the views that show them."""

    scene: Gaussians
    """All N Gaussians."""
    bounds: Bounds
    """Bounds of the selected object; their third axis is up."""
    cameras: Sequence[Camera]
    rows: IntArray
    """Scene rows of the Gaussians, ascending, (L,)."""
    selected: BoolArray
    """Which of them are selected, without floaters far from the object, (L,)."""
    excluded: BoolArray
    """Which of them may not become part of the object, (L,)."""
    occluders: Gaussians
    """What else the cameras see before the object, if they were given: photographs and masks show that, too."""

    @cached_property
    def local(self) -> Gaussians:
        """The L Gaussians themselves; a copy of the crop does not keep them."""
        return self.scene.select(self.rows)

    @cached_property
    def shown(self) -> Gaussians:
        """What the views show: the L Gaussians, and the occluders after them."""
        return concatenate([self.local, self.occluders]) if len(self.occluders) else self.local

    def support_plane(self, members: BoolArray, visible: FloatArray, config: SupportPlaneConfig) -> SupportPlane | None:
        """The plane that the object stands on, if there is one.

        Args:
            members: which Gaussians are the object, (L,).
            visible: blend weight of each Gaussian in the views, (L,).
            config: what counts as a plane.
        """
        positions = self.local.means / np.float32(self.bounds.radius)
        return find_support_plane(positions, members, visible.astype(np.float64), self.bounds, config)

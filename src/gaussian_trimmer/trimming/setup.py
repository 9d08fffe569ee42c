"""What all objects of a trim have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.planning.up_vector import UpVector
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.segmentation.segmenters import Segmenter

Made = TypeVar("Made")


@dataclass(frozen=True, eq=False, kw_only=True)
class Setup:
    """A scene of N Gaussians, how its objects are trimmed, and what draws and segments them."""

    scene: Gaussians
    config: TrimConfig
    renderer: Renderer
    segmenter: Segmenter
    cameras: CameraSet | None = None
    """The cameras that the scene was trained with."""
    view_cameras: Sequence[Camera] | None = None
    """Cameras to look from in place of virtual ones."""
    excluded: BoolArray | None = None
    """Which Gaussians join no object unless they are selected, (N,); None: all may."""
    up: UpVector | None = None
    """The up vector of all objects; None if each must find the plane that it stands on."""
    up_warning: str | None = None
    """What speaks against it."""

    def map(self, work: Callable[..., Made], *items: Iterable[Any]) -> Iterator[Made]:
        """Like `map`, for work with renderer and segmenter."""
        return parallel_map(work, *items, using=[self.renderer, self.segmenter])

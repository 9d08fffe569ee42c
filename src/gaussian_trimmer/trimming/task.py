"""One object to trim, with arguments that were checked and what renders and segments."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.planning.up_vector import UpVector
from gaussian_trimmer.rendering import Renderer, get_renderer, parallel_map
from gaussian_trimmer.segmentation.segmenters import Segmenter, get_segmenter
from gaussian_trimmer.trimming.plugin_checks import CheckedRenderer, CheckedSegmenter

Made = TypeVar("Made")


@dataclass(frozen=True, eq=False)
class PlugIns:
    """A renderer and a segmenter, as they were given and with their answers checked."""

    given_renderer: Renderer
    given_segmenter: Segmenter
    renderer: CheckedRenderer
    segmenter: CheckedSegmenter

    @classmethod
    def of(cls, renderer: Renderer | str, segmenter: Segmenter | str) -> PlugIns:
        """Plug-ins from objects or names.

        Raises:
            InputError: there is none of that name, or a method is missing.
        """
        renderer = get_renderer(renderer) if isinstance(renderer, str) else renderer
        segmenter = get_segmenter(segmenter) if isinstance(segmenter, str) else segmenter
        return cls(renderer, segmenter, CheckedRenderer(renderer), CheckedSegmenter(segmenter))

    def map(self, work: Callable[..., Made], *items: Iterable[Any]) -> Iterator[Made]:
        """Like `map`, for work with both."""
        return parallel_map(work, *items, using=[self.given_renderer, self.given_segmenter])

    def report_parts_to(self, report: Callable[[str], None]) -> None:
        """Have the segmenter say which view it is at, if it can."""
        if hasattr(self.given_segmenter, "report_to"):
            self.given_segmenter.report_to(report)


@dataclass(frozen=True)
class KnownUp:
    """The up vector of a scene, which several of its objects have in common."""

    up: UpVector
    warning: str | None
    """What speaks against it."""


@dataclass(frozen=True, eq=False)
class Task:
    """One object to trim in a scene of N Gaussians."""

    scene: Gaussians
    selection: BoolArray
    """The selected object, (N,)."""
    excluded: BoolArray
    """Which Gaussians may not join the object unless they are selected, (N,)."""
    config: TrimConfig
    plug_ins: PlugIns
    cameras: CameraSet | None = None
    """The cameras that the scene was trained with."""
    view_cameras: Sequence[Camera] | None = None
    """Cameras to look from in place of virtual ones."""
    known_up: KnownUp | None = None
    """The up vector, if it need not be looked for."""

    @property
    def renderer(self) -> CheckedRenderer:
        """What draws, with its answers checked."""
        return self.plug_ins.renderer

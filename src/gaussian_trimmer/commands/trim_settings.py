"""The settings of a trim on the command line, for `trim` and for `select --trim`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from tyro.conf import arg

from gaussian_trimmer.commands.pages import PageOptions
from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.rendering import DEFAULT_RENDERER, RENDERER_CHOICES
from gaussian_trimmer.segmentation.segmenters import (
    DEFAULT_SEGMENTER,
    SEGMENTERS,
    Segmenter,
    all_options,
    options_of,
    segmenter_with,
)

_SegmenterOptions = all_options()
_COMMON_OPTIONS = (
    "--cameras", "--up", "--photos", "--views", "--segmenter", "--preset", "--background", "--fill", "--output",
    "--overwrite", "--format", "--html", "--export-viewer", "--quiet",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class TrimSettings:
    """The options of `trim` and of `select --trim` beside what is selected."""

    COMMON_OPTIONS: ClassVar[tuple[str, ...]] = _COMMON_OPTIONS

    cameras: Annotated[Path | None, arg(metavar="PATH")] = None
    """Training cameras: a COLMAP folder, transforms.json or cameras.json. They give the up vector and the range of
    angles from which the object was observed."""
    photos: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of the training pictures: the object is segmented in those that show it best, in place of virtual views.
    Needs --cameras."""
    trust_paths: bool = False
    """Open pictures outside its folder that a transforms.json names, if it does not say their size."""
    overwrite: bool = False
    """Replace earlier results in the output folder. Other files in it are left alone."""
    format: Annotated[str | None, arg(metavar="ENDING", help_behavior_hint="(default: that of the scene)")] = None
    """File format of object and background: ply, compressed.ply, splat, spz, sog, ksplat or glb."""
    preset: Literal["default", "paper"] = "default"
    """Defaults of all settings below: those of this program, or those of the GaussianTrimmer paper."""
    views: Annotated[int | None, arg(metavar="INT")] = None
    """Number of virtual views; short for --plan.views."""
    segmenter: Annotated[str, arg(metavar="{" + ",".join(SEGMENTERS) + "}")] = DEFAULT_SEGMENTER
    """What segments the object in the views."""
    renderer: Annotated[str, arg(metavar="{" + ",".join(RENDERER_CHOICES) + "}")] = DEFAULT_RENDERER
    """What renders the views; auto is numba, on the CPU. gsplat (GPU) is used only if you ask for it."""
    quiet: bool = False
    """Print nothing but errors."""
    pages: Annotated[PageOptions, arg(name="")] = field(default_factory=PageOptions)
    config: Annotated[TrimConfig, arg(name="")] = field(default_factory=TrimConfig)
    segmenter_options: Annotated[Any, arg(name="", constructor=_SegmenterOptions)] = field(
        default_factory=_SegmenterOptions
    )

    def used_options(self) -> Any:
        """The options of the segmenter that is used, or None if it has none."""
        return options_of(self.segmenter, self.segmenter_options)

    def make_segmenter(self) -> Segmenter:
        """The segmenter with its options."""
        return segmenter_with(self.segmenter, self.segmenter_options)

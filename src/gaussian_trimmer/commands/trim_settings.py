"""The settings of a trim on the command line, for `trim` and for `select --trim`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

from tyro.conf import arg

from gaussian_trimmer.commands.pages import PageOptions
from gaussian_trimmer.trimming.options import TrimOptions

_COMMON_OPTIONS = (
    "--cameras",
    "--up",
    "--photos",
    "--views",
    "--segmenter",
    "--preset",
    "--background",
    "--output",
    "--overwrite",
    "--format",
    "--html",
    "--export-viewer",
    "--quiet",
)


@dataclass(frozen=True, kw_only=True)
class TrimSettings(TrimOptions):
    """The options of `trim` and of `select --trim` beside what is selected."""

    COMMON_OPTIONS: ClassVar[tuple[str, ...]] = _COMMON_OPTIONS

    cameras: Annotated[Path | None, arg(metavar="PATH")] = None
    """Training cameras: a COLMAP folder, transforms.json or cameras.json. They give the up vector and the range of
    angles from which the object was observed."""
    photos: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of the training pictures: the object is segmented in those that show it best, in place of virtual views.
    Needs --cameras."""
    overwrite: bool = False
    """Replace earlier results in the output folder. Other files in it are left alone."""
    quiet: bool = False
    """Print nothing but errors."""
    pages: Annotated[PageOptions, arg(name="")] = field(default_factory=PageOptions)

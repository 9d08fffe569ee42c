"""The settings of a trim on the command line, for `trim` and for `select --trim`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from gaussian_trimmer.commands.pages import PageOptions
from gaussian_trimmer.options import arg
from gaussian_trimmer.output.engines import EngineName
from gaussian_trimmer.trimming.options import TrimOptions


@dataclass(frozen=True, kw_only=True)
class TrimSettings(TrimOptions):
    """The options of `trim` and of `select --trim` beside what is selected."""

    cameras: Annotated[Path | None, arg(metavar="PATH")] = None
    """Training cameras: a COLMAP folder, transforms.json or cameras.json. They tell which way is up, and from which
    sides the object was observed."""
    photos: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of the training pictures, in which to segment the object in place of virtual views. Those that show it
    best are taken. Needs --cameras."""
    engine: Annotated[EngineName | None, arg(name="for")] = None
    """Also write object and background for this program, in a format that it reads and upright."""
    overwrite: bool = False
    """Replace earlier results in the output folder. Other files in it are left alone."""
    quiet: bool = False
    """Print nothing but errors."""
    json: bool = False
    """Print one JSON document on standard output, and nothing else there: the report, the folder and its files."""
    log_level: Literal["debug", "info", "warning", "error"] | None = None
    """Log each stage on standard error."""
    pages: Annotated[PageOptions, arg(name="")] = field(default_factory=PageOptions)

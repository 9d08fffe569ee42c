"""The scene of a command, and its cameras: what `trim`, `select` and `objects` have in common."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

from rich.console import Console

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.options import Positional, arg
from gaussian_trimmer.output.saving import suffix_of
from gaussian_trimmer.trimming.trim_options import TrimOptions

_NAMES_OF_ALL = re.compile(r"scene|splats?|point_cloud|iteration_\d+|meta|lod-meta|output", re.IGNORECASE)
"""What trainings and converters call every scene's file, and the folders around it."""

ReadScene = Callable[..., Gaussians]
"""Reads a scene as `formats.read` does."""


@dataclass(frozen=True)
class SceneInputs:
    """A scene, and the cameras that it was trained with."""

    scene: Annotated[Positional[Path], arg(metavar="SCENE")]
    """Splat file of the scene, or the folder of a training."""
    cameras: Annotated[Path | None, arg(metavar="PATH")] = None
    """Training cameras: a COLMAP folder, transforms.json or cameras.json. They tell which way is up, and from which
    sides the object was observed."""

    @property
    def name(self) -> str:
        """What the scene is called: its file without endings, or the folder of one that is called as all are."""
        names = [part.split(".")[0] for part in self.scene.parts if part not in ("/", ".", "..")]
        own = [name for name in names if not _NAMES_OF_ALL.fullmatch(name)]
        return [self.scene.resolve().name, *names[-1:], *own][-1]

    def read(
        self, options: TrimOptions, console: Console, read: ReadScene = formats.read
    ) -> tuple[Gaussians, CameraSet | None]:
        """Return the Gaussians and, in their coordinates, the cameras if they are given; what is read is said.

        Raises:
            InputError: a file cannot be read.
        """
        cameras = None
        if self.cameras is not None:  # first, since wrong ones are soon found
            found, trusted = identify(self.scene).scene, options.trust_paths
            cameras = read_cameras_of(found, self.cameras, trust_paths=trusted, say=console.print)
        return read(self.scene, level=options.level, say=console.print), cameras

    def suffix(self, options: TrimOptions) -> str:
        """Return the ending of the splat files that are written.

        Raises:
            InputError: no format has the name that is given, or a folder holds no scene.
        """
        if options.format is None:
            return formats.written_suffix(identify(self.scene).scene)
        return suffix_of(options.format)

    def words(self, options: TrimOptions) -> list[str]:
        """Return the words of a command that make it read the same, with the same up vector."""
        words = [str(self.scene), *reading_words(options)]
        words += ["--cameras", str(self.cameras)] if self.cameras else []
        up = options.config.up
        return [*words, "--up", *(f"{value:g}" for value in up)] if up else words

    def as_json(self, options: TrimOptions) -> dict[str, Any]:
        """Return what the report says of what was read."""
        cameras = str(self.cameras) if self.cameras else None
        said = {"scene": str(self.scene), "level": options.level, "cameras": cameras}
        return said | {"trust_paths": options.trust_paths}


def changed_words(settings: Any) -> list[str]:
    """Return the settings of a dataclass that are not the defaults, as words of a command.

    >>> from gaussian_trimmer.surface.overview import OverviewConfig
    >>> changed_words(OverviewConfig(ring=3, target=(0, 0.5, 1)))
    ['--target', '0', '0.5', '1', '--ring', '3']
    """
    words = []
    for option in fields(settings):
        value = getattr(settings, option.name)
        if value != option.default:
            values = value if isinstance(value, tuple) else () if value is True else (value,)
            words += [f"--{option.name.replace('_', '-')}", *(f"{number:.9g}" for number in values)]
    return words


def reading_words(options: TrimOptions) -> list[str]:
    """Return the options that say how scene and cameras are read, as words of a command."""
    level = [] if options.level is None else ["--level", str(options.level)]
    return [*level, *(["--trust-paths"] if options.trust_paths else [])]

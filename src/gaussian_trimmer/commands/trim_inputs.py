"""What `trim` is given on the command line: scene, selection and further files, where results go, and their readers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from rich.console import Console

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.commands.mark_options import MarkOptions
from gaussian_trimmer.commands.trim_settings import TrimSettings
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.options import Positional, arg
from gaussian_trimmer.output.saving import suffix_of
from gaussian_trimmer.selection_files import SelectionOptions, load_selection
from gaussian_trimmer.selection_files.method_files import scene_of_selection
from gaussian_trimmer.selection_files.selection_file import open_selection
from gaussian_trimmer.selection_files.several import load_objects
from gaussian_trimmer.selection_files.trimmed import is_trimmed


@dataclass(frozen=True)
class TrimInputs(TrimSettings):
    """The inputs of a trim of one object, or of several."""

    COMMON_OPTIONS: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "the scene": ("--cameras", "--up", "--photos"),
        "several objects": ("--labels", "--exclude"),
        "how to trim": ("--views", "--segmenter", "--background", "--preset"),
        "results": ("--output", "--overwrite", "--format", "--for", "--html", "--quiet"),
    }
    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "gaussian-trimmer trim scene.ply selection.npy --cameras sparse/0",
        "gaussian-trimmer trim scene.ply cut.ply --up z --output cup --html",
        "gaussian-trimmer trim scene.ply --labels labels.npy --cameras transforms.json",
        "gaussian-trimmer trim object.ply --up -y --for unreal",
    )

    scene: Annotated[Positional[Path], arg(metavar="SCENE")]
    """Splat file of the scene, or of the object alone; or a training's folder."""
    selection: Annotated[Positional[Path | None], arg(metavar="SELECTION")] = None
    """Which Gaussians roughly are the object. A mask, labels, row numbers, a PLY cut out of the scene, what a
    segmentation method saved, or marks saved as .json."""
    output: Annotated[Path | None, arg(metavar="DIR", default="trimmed/SCENE-SELECTION")] = None
    """Folder for the results."""
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    """How the selection file is read; the defaults suffice unless the file can be understood in several ways."""
    labels: Annotated[Path | None, arg(metavar="FILE")] = None
    """Trim several objects at once, in place of SELECTION. FILE has an id for each Gaussian, or is what a method with
    several objects saved, or a folder of masks whose pixels are ids. Each object becomes a file object_ID, and there is
    one background without all of them."""
    objects: Annotated[tuple[int, ...], arg(metavar="ID ...")] = ()
    """Which objects of --labels to trim; by default all whose ids are above zero."""
    exclude: Annotated[tuple[Path, ...], arg(metavar="FILE ...")] = ()
    """Selections of other objects, such as labels.npz of an earlier trim, whose Gaussians stay out of this one."""
    mark_options: Annotated[MarkOptions, arg(name="")] = field(default_factory=MarkOptions)

    def suffix(self) -> str:
        """Ending of the splat files that are written."""
        if self.format is None:
            return formats.written_suffix(formats.find_scene(scene_of_selection(self.scene, self.selection)))
        return suffix_of(self.format)

    def folder(self) -> Path:
        """The folder for the results."""
        if self.output is not None:
            return self.output
        given = self.selection or self.labels
        names = [self.scene.name.split(".")[0], *([given.name.split(".")[0]] if given else [])]
        return Path("trimmed") / "-".join([*names, *map(str, self.objects or self.selection_options.object_id)])

    def read_scene(self, console: Console) -> Gaussians:
        """Return the Gaussians of the scene; which file and level of a folder these are is said."""
        scene = scene_of_selection(self.scene, self.selection)
        return formats.read(scene, level=self.level, say=console.print)

    def read_cameras(self, console: Console) -> CameraSet | None:
        """The training cameras, if they are given, in the coordinates of the scene."""
        if self.cameras is None:
            return None
        scene = formats.find_scene(self.scene)
        return read_cameras_of(scene, self.cameras, trust_paths=self.trust_paths, say=console.print)

    def excluded_rows(self, scene: Gaussians) -> BoolArray:
        """Which Gaussians of the scene --exclude names, (N,)."""
        excluded = np.zeros(len(scene), np.bool_)
        for path in self.exclude:
            if path.suffix == ".npz" and is_trimmed(open_selection(path, len(scene))):
                excluded |= np.any(list(load_objects(path, scene).values()), axis=0)
            else:
                excluded |= load_selection(path, scene)
        return excluded

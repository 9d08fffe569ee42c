"""`gaussian-trimmer select`: a rough selection by clicks, boxes, volumes, files, or masks of posed pictures."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from rich.console import Console

from gaussian_trimmer.cameras import CameraSet, Viewpoint, up_frame
from gaussian_trimmer.commands.console import in_lengths, print_up, refuse_existing
from gaussian_trimmer.commands.mark_options import MarkOptions
from gaussian_trimmer.commands.scene_inputs import SceneInputs, changed_words
from gaussian_trimmer.commands.trim_run import ResultOptions, SelectedScene, TrimRun
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.io.manifest import is_made_of
from gaussian_trimmer.io.reading import is_file
from gaussian_trimmer.io.writing import atomic_folder, save_array
from gaussian_trimmer.options import arg
from gaussian_trimmer.output.pictures import as_picture, with_grid, write_picture
from gaussian_trimmer.rendering import render
from gaussian_trimmer.selecting.lifting import lift_id_masks
from gaussian_trimmer.selecting.marks import FromMasks, Mark, Marks, read_marks
from gaussian_trimmer.selecting.select import resolve_views, select
from gaussian_trimmer.selecting.selection import Selection
from gaussian_trimmer.settings import Range
from gaussian_trimmer.surface.overview import Overview, OverviewConfig, drawn_rows, plan_views
from gaussian_trimmer.trimming.result import THE_OBJECT
from gaussian_trimmer.trimming.trim_options import TrimOptions
from gaussian_trimmer.trimming.up_vector import UpVector, find_up

_LISTING = "select --list-views"
_END_PERCENTILES = (2, 98)
"""Percentiles of the selected centres that are taken for the ends of what is selected."""


@dataclass(frozen=True)
class Select:
    """Select an object roughly: by clicks and boxes in views, volumes, other selections, or masks of training pictures.

    The views are those of --cameras or, without cameras, numbered ones: what a person sees in rooms, otherwise views
    from all around. --list-views writes them as pictures in which to find pixels. A mask belongs to the picture with
    the same name: IMG_7.png or IMG_7.JPG.png to IMG_7.JPG; pictures without a mask are skipped. The marks are saved
    beside the selection, as a .json file from which --marks makes it again and goes on.
    """

    COMMON_OPTIONS: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "find pixels": ("--list-views", "--cameras", "--up"),
        "mark": ("--view", "--view-index", "--click", "--remove-click", "--box", "--add", "--subtract"),
        "or take masks of the pictures": ("--masks", "--object-ids"),
        "results": ("--marks", "--output", "--overwrite", "--trim", "--quiet"),
    }
    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "gaussian-trimmer select scene.ply --list-views views",
        "gaussian-trimmer select scene.ply --view-index 0 --click 330 200 --trim cup",
        "gaussian-trimmer select scene.ply --marks scene_selection.json --view-index 4 --remove-click 250 350",
        "gaussian-trimmer select scene.ply --masks masks --cameras sparse/0 --output cup.npy",
    )

    inputs: Annotated[SceneInputs, arg(name="")]
    mark_options: Annotated[MarkOptions, arg(name="")] = field(default_factory=MarkOptions)
    marks: Annotated[Path | None, arg(metavar="FILE")] = None
    """Begin with the marks of an earlier run."""
    list_views: Annotated[Path | None, arg(metavar="DIR")] = None
    """Only write pictures of all views to this folder, named by the numbers that --view-index takes."""
    grid: bool = False
    """Draw a grid of pixel numbers over these pictures."""
    overview: Annotated[OverviewConfig, arg(name="")] = field(default_factory=OverviewConfig)
    masks: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of masks in which the object is bright. Or a pattern such as 'out/*/chosen_cup.png', in which * stands for
    the picture's name or number. Needs --cameras."""
    output: Annotated[Path | None, arg(metavar="FILE", default="SCENE_selection.npy")] = None
    """File for the selection, .npy. It has booleans, or object numbers with --object-ids; the marks go beside it. An
    earlier selection of the same scene is replaced; one of another scene only with --overwrite."""
    trim: Annotated[Path | None, arg(metavar="DIR")] = None
    """Also trim, and write the results to this folder. All settings of trim can be given. Earlier results of the same
    selection file are replaced; others only with --overwrite."""
    gamma: Annotated[float, Range(-1, 1)] = 0.0
    """Bias of --masks towards the background, from -1 to 1."""
    object_ids: bool = False
    """Select all objects at once, by masks that hold their numbers. 0 is the background."""
    options: Annotated[TrimOptions, arg(name="")] = field(default_factory=TrimOptions)
    results: Annotated[ResultOptions, arg(name="")] = field(default_factory=ResultOptions)

    @property
    def selection_path(self) -> Path:
        """Where the selection is saved."""
        return Path(f"{self.inputs.name}_selection.npy") if self.output is None else self.output

    def run(self) -> int:
        """Select and save the selection, then trim it if asked to; return the exit code, 3 where nothing was trimmed.

        Raises:
            InputError: something that the user gave cannot be used, or the selection is empty.
        """
        console = self.results.console()
        self._check()
        if self.list_views is not None:
            self._write_views(self.list_views, console)
        elif self.trim is not None:
            return self._run_of(self.trim).run(console, lambda: self._select(console))
        else:
            made = self._select(console)
            selection = made.selections[THE_OBJECT]
            console.print(f"Now: {self._next_command(selection.marks)}")
            counts = {"selected": int(np.count_nonzero(selection.mask)), "scene": len(made.scene)}
            self.results.printing.print_json({"selection": str(self.selection_path), "counts": counts})
        return 0

    def _run_of(self, folder: Path) -> TrimRun:
        """Return the trim of what is selected."""
        path, inputs = self.selection_path, self.inputs
        results = replace(self.results, overwrite=self.results.overwrite or is_made_of(folder, path))
        used = vars(self.options.used_options()).values() if self.options.used_options() else ()
        return TrimRun(
            folder=folder,
            suffix=inputs.suffix(self.options),
            options=self.options,
            results=results,
            for_report=inputs.as_json(self.options) | {"selection": str(path)},
            files=[file for file in (inputs.scene, path, inputs.cameras, *used) if isinstance(file, Path)],
            source=path,
        )

    def _select(self, console: Console) -> SelectedScene:
        """Make the selection and save it; returns it, and what it was made from."""
        scene, cameras = self.inputs.read(self.options, console)
        if self.object_ids:
            assert self.masks is not None, "checked before"
            labels, n_masks = lift_id_masks(scene, cameras, self.masks, self.gamma)
            if not labels.any():
                raise InputError("No Gaussian was selected; check that the cameras and masks belong to this scene.")
            save_array(labels, self.selection_path)
            count = f"{np.count_nonzero(labels):,} of {len(scene):,} Gaussians"
            console.print(f"{self.selection_path}: {count}, {n_masks} masks")
            return SelectedScene(scene, cameras, {THE_OBJECT: Selection(labels != 0)})
        up = find_up(scene, cameras, self.options.config.up)
        print_up(console, up)
        marks = self._resolved(scene, cameras, up)
        made = select(scene, marks, cameras=cameras)
        made.save(self.selection_path)
        ends = np.percentile(scene.means[made.mask] @ up_frame(up.direction).T, _END_PERCENTILES, axis=0)
        size, understood = in_lengths(np.ptp(ends, axis=0)), ", ".join(made.interpretations)
        count = f"{np.count_nonzero(made.mask):,} of {len(scene):,} Gaussians"
        console.print(f"{self.selection_path}: {count}, {size}, {understood}")
        return SelectedScene(scene, cameras, {THE_OBJECT: made}, up)

    def _resolved(self, scene: Gaussians, cameras: CameraSet | None, up: UpVector) -> Marks:
        """All marks, those of an earlier run first."""
        views = self._overview(scene, None, up).views if cameras is None else None
        marks: list[Mark] = self.mark_options.marks()
        if self.masks is not None:
            marks.insert(0, FromMasks(self.masks, self.gamma))
        resolved = resolve_views(
            scene, marks, cameras=cameras, up=up.direction, views=views, camera_path=self.inputs.cameras
        )
        resolved = replace(resolved, scene=self.inputs.scene)
        return resolved if self.marks is None else read_marks(self.marks).followed_by(resolved, self.inputs.cameras)

    def _check(self) -> None:
        """Refuse what is not possible or cannot go together before anything is read."""
        marks = self.mark_options.marks()
        if self.list_views is not None and (marks or self.masks or self.marks):
            raise InputError("--list-views only writes the views; leave the marks out.")
        if self.list_views is None and not marks and self.masks is None and self.marks is None:
            raise InputError(
                "Say what to select: --click X Y, --box X0 Y0 X1 Y1, a volume, --add FILE, --masks DIR or --marks FILE."
            )
        if self.masks is not None and self.inputs.cameras is None:
            raise InputError("Masks need the cameras of their pictures: --cameras PATH.")
        if self.object_ids and (self.masks is None or marks or self.marks):
            raise InputError("Object numbers come from --masks alone; give it, and leave marks out.")
        if self.object_ids and self.trim is not None:
            raise InputError("Trim all objects afterwards, with 'trim SCENE --labels FILE'; leave --trim out.")
        if self.results.html and self.trim is None:
            raise InputError("--html shows a trim; add --trim DIR, or leave it out.")
        if self.selection_path.suffix != ".npy":
            raise InputError(f"The selection '{self.selection_path}' is saved as .npy; give a name with that ending.")
        if self.list_views is None:
            self._check_files()

    def _check_files(self) -> None:
        """Refuse to replace inputs, and files that an earlier selection of this scene did not write."""
        path, scene, overwrite = self.selection_path, self.inputs.scene, self.results.overwrite
        beside = path.with_suffix(".json")
        # Of an array that was written after its marks, these do not tell.
        marked = is_file(path) and identify(beside).kind == "marks" and path.stat().st_mtime <= beside.stat().st_mtime
        earlier = read_marks(beside).scene if marked else None
        inputs = [file for file in (scene, self.inputs.cameras, *self.mark_options.files) if file is not None]
        again = not self.object_ids and earlier is not None and earlier.resolve() == scene.resolve()
        if marked and not (again or self.object_ids or overwrite):
            raise InputError(
                f"'{path}' is a selection of another scene ('{earlier or 'unknown'}'); choose another name with "
                "--output, or replace it with --overwrite."
            )
        refuse_existing(path, inputs=inputs, overwrite=overwrite or again)
        if not self.object_ids:
            refuse_existing(beside, inputs=inputs, overwrite=overwrite or again)

    def _overview(self, scene: Gaussians, cameras: CameraSet | None, up: UpVector) -> Overview:
        if cameras is None:
            return plan_views(scene, up.direction, self.overview)
        return Overview([Viewpoint(camera) for camera in cameras.pinhole_cameras()], range(0))

    def _write_views(self, folder: Path, console: Console) -> None:
        scene_file = self.inputs.scene
        overwrite = self.results.overwrite or is_made_of(folder, scene_file)
        with atomic_folder(
            folder, _LISTING, names=["[0-9][0-9][0-9].png"], source=scene_file, overwrite=overwrite
        ) as part:
            scene, cameras = self.inputs.read(self.options, console)
            up = find_up(scene, cameras, self.options.config.up)
            overview = self._overview(scene, cameras, up)
            for number, view in enumerate(overview.views):
                picture = as_picture(render(scene.select(drawn_rows(scene.means, view)), view.camera).rgb)
                write_picture(with_grid(picture) if self.grid else picture, part / f"{number:03d}.png")
        self.results.printing.print_json({"views": len(overview.views)}, (folder, _LISTING))
        print_up(console, up)
        console.print(f"{folder}: {len(overview.views)} views, each named by its number for --view-index")
        if 0 < len(overview.whole) < len(overview.views):
            first, last = overview.whole[0], overview.whole[-1]
            console.print(f"Views {first} to {last} show the whole capture, the others its most detailed part.")
        words = ["gaussian-trimmer", "select", *self.inputs.words(self.options), *changed_words(self.overview)]
        console.print(f"To mark: {shlex.join(words)} --view-index N --click X Y")

    def _next_command(self, marks: Marks | None) -> str:
        scene, *options = self.inputs.words(self.options)
        path = self.selection_path.with_suffix(".json") if marks is not None and marks.exclude else self.selection_path
        selection = [*(["--labels"] if self.object_ids else []), str(path)]
        return shlex.join(["gaussian-trimmer", "trim", scene, *selection, *options])

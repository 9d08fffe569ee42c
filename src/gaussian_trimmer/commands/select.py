"""`gaussian-trimmer select`: a rough selection by clicks, boxes, volumes, files, or masks of posed pictures."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from tyro.conf import Positional, arg

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.commands.console import open_console, print_up, refuse_existing
from gaussian_trimmer.commands.mark_options import MarkOptions
from gaussian_trimmer.commands.trim import Loaded, Trim
from gaussian_trimmer.commands.trim_settings import TrimSettings
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.io.manifest import MANIFEST
from gaussian_trimmer.io.writing import atomic_folder
from gaussian_trimmer.output.view_listing import VIEW_FILES, write_view_listing
from gaussian_trimmer.planning.up_vector import UpVector, find_up
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.segmentation.segmenters.mask_files import cameras_with_masks, ids_of
from gaussian_trimmer.segmentation.segmenters.sam import SamSegmenter
from gaussian_trimmer.selecting.lifting import lift_objects_by_assignment
from gaussian_trimmer.selecting.marks import FromMasks, Mark, Marks, Viewpoint
from gaussian_trimmer.selecting.marks_file import is_marks_file, read_marks
from gaussian_trimmer.selecting.overview import OverviewConfig, drawn_rows, plan_overview
from gaussian_trimmer.selecting.saved_selection import is_own_selection, save_array, save_selection
from gaussian_trimmer.selecting.select import select, settle_marks
from gaussian_trimmer.settings import Range, Share, check_settings

_LISTING = "select --list-views"


@dataclass(frozen=True)
class Select(TrimSettings):
    """Make a rough selection: by clicks and boxes in views, volumes, other selections, or masks of training pictures.

    The views are those of --cameras or, without cameras, numbered views from all around; --list-views writes them as
    pictures in which to find pixels. A mask belongs to the picture with the same name: IMG_7.png or IMG_7.JPG.png to
    IMG_7.JPG; pictures without a mask are skipped. The marks are saved beside the selection, as a .json file from which
    --marks makes it again and goes on.
    """

    COMMON_OPTIONS: ClassVar[tuple[str, ...]] = (
        "--list-views", "--view", "--view-index", "--click", "--remove-click", "--box", "--add", "--subtract",
        "--marks", "--masks", "--object-ids", "--cameras", "--up", "--output", "--overwrite", "--trim", "--quiet",
    )  # fmt: skip

    scene: Annotated[Positional[Path], arg(metavar="SCENE")]
    """Splat file of the scene, or the folder of a training."""
    mark_options: Annotated[MarkOptions, arg(name="")] = field(default_factory=MarkOptions)
    marks: Annotated[Path | None, arg(metavar="FILE")] = None
    """Begin with the marks that an earlier run saved."""
    list_views: Annotated[Path | None, arg(metavar="DIR")] = None
    """Write pictures of all views, and a page to click in, to this folder and stop."""
    grid: bool = False
    """Draw a grid of pixel numbers over these pictures."""
    overview: Annotated[OverviewConfig, arg(name="")] = field(default_factory=OverviewConfig)
    masks: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of masks; the object is bright. Needs --cameras."""
    output: Annotated[Path, arg(metavar="FILE")] = Path("selection.npy")
    """File for the selection: .npy with booleans, or with object numbers if --object-ids is given. The marks go beside
    it; earlier ones of this program are replaced, and their marks kept as FILE.before.json."""
    trim: Annotated[Path | None, arg(metavar="DIR")] = None
    """Also trim the selection, with all settings of trim, and write the results to this folder."""
    method: Literal["assignment", "vote"] = "assignment"
    """How masks select Gaussians: by the pixels that a Gaussian contributes to, or by votes for its centre."""
    gamma: Annotated[float, Range(-1, 1)] = 0.0
    """For `assignment`: bias towards the background, -1 to 1."""
    threshold: Share = 0.7
    """For `vote`: a centre must lie in more than this share of the masks."""
    object_ids: bool = False
    """The masks hold object numbers, 0 for the background; all objects are selected at once."""

    def in_order_of(self, arguments: Sequence[str]) -> Select:
        """This command, with its marks in the order of the arguments that it was made from."""
        return replace(self, mark_options=self.mark_options.in_order_of(arguments))

    def run(self) -> int:
        """Select and save the selection, then trim it if asked to; returns the exit code, that of `Trim.run`.

        Raises:
            InputError: something that the user gave cannot be used, or the selection is empty.
        """
        console = open_console(quiet=self.quiet)
        self._check()
        if self.list_views is not None:
            self._write_views(self.list_views, console)
        elif self.trim is not None:
            settings = {known.name: getattr(self, known.name) for known in fields(TrimSettings)}
            settings["overwrite"] = self.overwrite or (self.trim / MANIFEST).is_file()
            return Trim(self.scene, self.output, output=self.trim, **settings).run(load=lambda: self._select(console))
        else:
            self._select(console)
            console.print(f"Now: {self._next_command()}")
        return 0

    def _select(self, console: Console) -> Loaded:
        """Make the selection and save it; returns it, and what it was made from."""
        scene, cameras = self._read(console)
        if self.object_ids:
            labels, how = self._label(scene, cameras)
            if not labels.any():
                raise InputError("No Gaussian was selected; check that the cameras and masks belong to this scene.")
            save_array(labels, self.output)
            console.print(f"{self.output}: {np.count_nonzero(labels):,} of {len(scene):,} Gaussians, {how}")
            return Loaded(scene, labels != 0, cameras)
        up = find_up(scene, cameras, self.config.up)
        print_up(console, up)
        marks, model = self._settled(scene, cameras, up), self.make_segmenter() if self.segmenter == "sam" else None
        assert model is None or isinstance(model, SamSegmenter)
        made = select(scene, marks, cameras=cameras, renderer=self.renderer, model=model)
        save_selection(made, self.output)
        console.print(
            f"{self.output}: {np.count_nonzero(made.mask):,} of {len(scene):,} Gaussians, {', '.join(made.ways)}"
        )
        return Loaded(scene, made.mask, cameras, made.marks, made.excluded)

    def _settled(self, scene: Gaussians, cameras: CameraSet | None, up: UpVector) -> Marks:
        """All marks, those of an earlier run first."""
        views = None if cameras is not None else self._views(scene, cameras, up)
        marks: list[Mark] = self.mark_options.marks()
        if self.masks is not None:
            marks.insert(0, FromMasks(self.masks, self.method, self.gamma, self.threshold))
        settled = settle_marks(scene, marks, cameras=cameras, up=up.direction, views=views, camera_path=self.cameras)
        if self.marks is None:
            return settled
        return read_marks(self.marks).followed_by(settled, self.cameras)

    def _read(self, console: Console) -> tuple[Gaussians, CameraSet | None]:
        found = formats.find_scene(self.scene)
        if found != self.scene:
            console.print(f"{self.scene}: reading {found}")
        cameras = None
        if self.cameras:
            cameras = read_cameras_of(found, self.cameras, trust_paths=self.trust_paths, say=console.print)
        return formats.read(found), cameras

    def _check(self) -> None:
        """Refuse what is not possible or cannot go together before anything is read."""
        check_settings(self)
        marks = self.mark_options.marks()
        if self.list_views is not None and (marks or self.masks or self.marks):
            raise InputError("--list-views writes the views and stops; leave out what selects.")
        if self.list_views is None and not marks and self.masks is None and self.marks is None:
            raise InputError(
                "Say what to select: --click X Y, --box X0 Y0 X1 Y1, a volume, --add FILE, --masks DIR or --marks FILE."
            )
        if self.masks is not None and self.cameras is None:
            raise InputError("Masks need the cameras of their pictures: --cameras PATH.")
        if self.object_ids and (self.masks is None or self.method == "vote" or marks or self.marks):
            raise InputError("Object numbers are lifted from --masks alone and only by 'assignment'.")
        if self.object_ids and self.trim is not None:
            raise InputError("Trim all objects afterwards, with 'trim SCENE --labels FILE'; leave --trim out.")
        if self.pages.wished() and self.trim is None:
            raise InputError("--html and --export-viewer show a trim; add --trim DIR, or leave them out.")
        if self.trim is not None:
            self.pages.check(self.trim, overwrite=self.overwrite)
        if self.output.suffix != ".npy":
            raise InputError(f"The selection '{self.output}' is saved as .npy; give a name with that ending.")
        if self.list_views is None:
            given = (self.scene, self.cameras, *self.mark_options.files)
            inputs = [path for path in given if path is not None]
            overwrite = self.overwrite or (not self.object_ids and is_own_selection(self.output))
            refuse_existing(self.output, inputs=inputs, overwrite=overwrite)
            if not self.object_ids:
                marks_path = self.output.with_suffix(".json")
                refuse_existing(marks_path, inputs=inputs, overwrite=self.overwrite or is_marks_file(marks_path))

    def _label(self, scene: Gaussians, cameras: CameraSet | None) -> tuple[NDArray[Any], str]:
        """Object numbers (N,) by the masks, and how they came about."""
        assert self.masks is not None and cameras is not None
        posed = cameras_with_masks(cameras.pinhole_cameras(), self.masks)
        labels = [ids_of(camera, self.masks) for camera in posed]
        found = lift_objects_by_assignment(scene, posed, labels, get_renderer(self.renderer), self.gamma)
        return found, f"{len(posed)} masks"

    def _views(self, scene: Gaussians, cameras: CameraSet | None, up: UpVector) -> list[Viewpoint]:
        if cameras is not None:
            return [Viewpoint(camera) for camera in cameras.pinhole_cameras()]
        return plan_overview(scene, up.direction, self.overview).views

    def _write_views(self, folder: Path, console: Console) -> None:
        overwrite = self.overwrite or (folder / MANIFEST).is_file()
        with atomic_folder(folder, _LISTING, names=VIEW_FILES, overwrite=overwrite) as part:
            scene, cameras = self._read(console)
            up = find_up(scene, cameras, self.config.up)
            whole: Sequence[int] = ()
            if cameras is None:
                overview = plan_overview(scene, up.direction, self.overview)
                views, whole = overview.views, overview.whole
            else:
                views = self._views(scene, cameras, up)
            renderer = get_renderer(self.renderer)
            drawn = [(view.camera, drawn_rows(scene.means, view)) for view in views]
            write_view_listing(scene, drawn, whole, self._command_of_views(), part, renderer, grid=self.grid)
        print_up(console, up)
        console.print(f"{folder}: {len(views)} views, each named by its number for --view-index")
        if len(whole) < len(views) and whole:
            console.print(
                f"The whole capture is in views {whole[0]} to {whole[-1]}, the part with most detail in the others."
            )
        console.print(f"To click: open {folder / 'index.html'} in a browser.")

    def _command_of_views(self) -> list[str]:
        """The command that selects in the views, without marks."""
        parts = ["gaussian-trimmer", "select", str(self.scene), *self._common_options()]
        for option in fields(OverviewConfig):
            value = getattr(self.overview, option.name)
            if value != option.default:
                values = value if isinstance(value, tuple) else (value,)
                parts += [f"--{option.name}", *(f"{number:.9g}" for number in values)]
        return parts

    def _common_options(self) -> list[str]:
        parts = []
        if self.cameras:
            parts += ["--cameras", str(self.cameras), *(["--trust-paths"] if self.trust_paths else [])]
        if self.config.up:
            parts += ["--up", *(f"{value:g}" for value in self.config.up)]
        return parts

    def _next_command(self) -> str:
        if self.object_ids:
            parts = ["gaussian-trimmer", "trim", str(self.scene), "--labels", str(self.output)]
        else:
            parts = ["gaussian-trimmer", "trim", str(self.scene), str(self.output)]
        return shlex.join([*parts, *self._common_options()])

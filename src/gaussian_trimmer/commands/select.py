"""`gaussian-trimmer select`: a rough selection from a click, a box, or masks of posed pictures."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from tyro.conf import Positional, UseAppendAction, arg

from gaussian_trimmer import formats
from gaussian_trimmer.atomic import atomic_file, atomic_folder
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.commands.console import open_console, refuse_existing
from gaussian_trimmer.commands.trim import Loaded, Trim
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray
from gaussian_trimmer.output.pictures import write_picture
from gaussian_trimmer.pipeline import TrimConfig
from gaussian_trimmer.planning.up_vector import UpVector, find_up
from gaussian_trimmer.rendering import DEFAULT_RENDERER, RENDERER_CHOICES, Renderer, get_renderer
from gaussian_trimmer.segmentation.segmenters.mask_files import cameras_with_masks, ids_of, mask_of
from gaussian_trimmer.selecting.clicks import Pick, select_by_box, select_by_clicks
from gaussian_trimmer.selecting.lifting import lift_by_assignment, lift_by_vote, lift_objects_by_assignment
from gaussian_trimmer.selecting.overview import plan_overview
from gaussian_trimmer.settings import Range, Share, Vector, check_settings

_WAYS = {
    "piece": "an object that stands on a surface",
    "part": "the part that fills the box, on all of its sides",
    "colour": "what has its colour in that view, on all of its sides",
}


@dataclass(frozen=True)
class Select:
    """Make a rough selection of an object: by clicks or a box in one view, or by masks of the training pictures.

    The views are those of --cameras or, without cameras, numbered views from all around; --list-views writes them as
    pictures in which to find pixels. A mask belongs to the picture with the same name: IMG_7.png or IMG_7.JPG.png to
    IMG_7.JPG; pictures without a mask are skipped.
    """

    scene: Annotated[Positional[Path], arg(metavar="SCENE")]
    """Splat file of the scene."""
    click: Annotated[UseAppendAction[tuple[tuple[int, int], ...]], arg(metavar="X Y")] = ()
    """A pixel on the object, counted from the left and the top. May be repeated, also to select several objects."""
    box: Annotated[tuple[int, int, int, int] | None, arg(metavar="X0 Y0 X1 Y1")] = None
    """Left, top, right and bottom of a box around the object."""
    view: Annotated[str | None, arg(metavar="NAME")] = None
    """The view in which clicks and box are given: the name of a picture of --cameras, with or without its ending."""
    view_index: Annotated[int | None, arg(metavar="INT")] = None
    """The same view by its number, from 0."""
    list_views: Annotated[Path | None, arg(metavar="DIR")] = None
    """Write pictures of all views to this folder and stop."""
    masks: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of masks; the object is bright."""
    cameras: Annotated[Path | None, arg(metavar="PATH")] = None
    """Training cameras: a COLMAP folder, transforms.json or cameras.json. They are required with --masks."""
    trust_paths: bool = False
    """Open pictures outside its folder that a transforms.json names, if it does not say their size."""
    up: Annotated[Vector | None, arg(metavar="X Y Z")] = None
    """Up vector of the scene. If it is not given, it is found from the cameras, or else from the ground plane."""
    output: Annotated[Path, arg(metavar="FILE")] = Path("selection.npy")
    """File for the selection: .npy with booleans, or with object numbers if --object-ids is given."""
    trim: Annotated[Path | None, arg(metavar="DIR")] = None
    """Also trim the selection, and write the results to this folder."""
    method: Literal["assignment", "vote"] = "assignment"
    """How masks select Gaussians: by the pixels that a Gaussian contributes to, or by votes for its centre."""
    gamma: Annotated[float, Range(-1, 1)] = 0.0
    """For `assignment`: bias towards the background, -1 to 1."""
    threshold: Share = 0.7
    """For `vote`: a centre must lie in more than this share of the masks."""
    object_ids: bool = False
    """The masks hold object numbers, 0 for the background; all objects are selected at once."""
    renderer: Annotated[str, arg(metavar="{" + ",".join(RENDERER_CHOICES) + "}")] = DEFAULT_RENDERER
    """What renders the views."""
    overwrite: bool = False
    """Replace the output if it exists, and earlier results of --trim or --list-views; other files stay."""
    quiet: bool = False
    """Print nothing but errors."""

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
            return Trim(
                self.scene, self.output, cameras=self.cameras, trust_paths=self.trust_paths, output=self.trim,
                overwrite=self.overwrite, renderer=self.renderer, quiet=self.quiet, config=TrimConfig(up=self.up),
            ).run(load=lambda: self._select(console))  # fmt: skip
        else:
            self._select(console)
            console.print(f"Now: {self._next_command()}")
        return 0

    def _select(self, console: Console) -> Loaded:
        """Make the selection and save it; returns it, and what it was made from."""
        scene, cameras = self._read()
        selection, how = self._lift(scene, cameras) if self.masks else self._pick(scene, cameras)
        if not selection.any():
            raise InputError("No Gaussian was selected; check that the cameras and masks belong to this scene.")
        _save(selection, self.output)
        console.print(f"{self.output}: {np.count_nonzero(selection):,} of {len(scene):,} Gaussians, {how}")
        return scene, selection, cameras

    def _read(self) -> tuple[Gaussians, CameraSet | None]:
        cameras = read_camera_set(self.cameras, trust_paths=self.trust_paths) if self.cameras else None
        return formats.read(self.scene), cameras

    def _check(self) -> None:
        """Refuse what is not possible or cannot go together before anything is read."""
        check_settings(self)
        ways = [bool(self.click), self.box is not None, self.masks is not None, self.list_views is not None]
        if sum(ways) != 1:
            raise InputError("Say in one way what to select: --click X Y, --box X0 Y0 X1 Y1, or --masks DIR.")
        if self.masks is not None and self.cameras is None:
            raise InputError("Masks need the cameras of their pictures: --cameras PATH.")
        if self.object_ids and (self.masks is None or self.method == "vote"):
            raise InputError("Object numbers are lifted from --masks only by 'assignment'; leave --method out.")
        if self.object_ids and self.trim is not None:
            raise InputError("Only one object can be trimmed at a time; leave --trim out and choose an object id then.")
        if self.output.suffix != ".npy":
            raise InputError(f"The selection '{self.output}' is saved as .npy; give a name with that ending.")
        if self.list_views is None:
            inputs = [path for path in (self.scene, self.cameras) if path is not None]
            refuse_existing(self.output, inputs=inputs, overwrite=self.overwrite)

    def _lift(self, scene: Gaussians, cameras: CameraSet | None) -> tuple[NDArray[Any], str]:
        """Selection or object numbers (N,) by the masks, and how they came about."""
        assert self.masks is not None and cameras is not None
        posed = cameras_with_masks(cameras.pinhole_cameras(), self.masks)
        how = f"{len(posed)} masks"
        if self.object_ids:
            labels = [ids_of(camera, self.masks) for camera in posed]
            return lift_objects_by_assignment(scene, posed, labels, get_renderer(self.renderer), self.gamma), how
        masks = [mask_of(camera, self.masks) for camera in posed]
        if self.method == "vote":
            return lift_by_vote(scene, posed, masks, self.threshold), how
        return lift_by_assignment(scene, posed, masks, get_renderer(self.renderer), self.gamma), how

    def _pick(self, scene: Gaussians, cameras: CameraSet | None) -> tuple[BoolArray, str]:
        """Selection (N,) by clicks or box, and how they were understood."""
        renderer, up = get_renderer(self.renderer), find_up(scene, cameras, self.up)
        views, rows = _views(scene, cameras, up)
        camera, drawn = self._view(views), scene.select(rows)
        pick = self._understand(drawn, camera, up, renderer, _training_cameras(cameras))
        selection = np.zeros(len(scene), np.bool_)
        selection[rows[pick.selection]] = True
        return selection, ", ".join(_WAYS[way] for way in pick.ways)

    def _understand(
        self, drawn: Gaussians, camera: Camera, up: UpVector, renderer: Renderer, seen_from: Sequence[Camera]
    ) -> Pick:
        if self.box is not None:
            return select_by_box(drawn, camera, self.box, up.direction, renderer, seen_from)
        return select_by_clicks(drawn, camera, self.click, up.direction, renderer, seen_from)

    def _view(self, views: list[Camera]) -> Camera:
        """The view that clicks and box refer to."""
        if self.view is not None:
            named = [camera for camera in views if self.view in (camera.name, Path(camera.name).stem)]
            if len(named) != 1:
                known = f"{views[0].name} ... {views[-1].name}"
                raise InputError(f"{len(named)} views are named '{self.view}'; the views are {known}.")
            return named[0]
        if self.view_index is None:
            raise InputError("Name the view of the pixels: --view NAME or --view-index INT (see --list-views DIR).")
        if not 0 <= self.view_index < len(views):
            raise InputError(f"There is no view {self.view_index}; the {len(views)} views are numbered from 0.")
        return views[self.view_index]

    def _write_views(self, folder: Path, console: Console) -> None:
        names = ["[0-9][0-9][0-9].png"]
        with atomic_folder(folder, "select --list-views", names=names, overwrite=self.overwrite) as part:
            scene, cameras = self._read()
            renderer, up = get_renderer(self.renderer), find_up(scene, cameras, self.up)
            views, rows = _views(scene, cameras, up)
            drawn = scene.select(rows)
            for number, camera in enumerate(views):
                bgr = np.clip(renderer.render(drawn, camera).rgb[..., ::-1], 0, 1)
                write_picture((255 * bgr).astype(np.uint8), part / f"{number:03d}.png")
        console.print(f"{folder}: {len(views)} views, each named by its number for --view-index")

    def _next_command(self) -> str:
        parts = ["gaussian-trimmer", "trim", str(self.scene), str(self.output)]
        if self.cameras:
            parts += ["--cameras", str(self.cameras), *(["--trust-paths"] if self.trust_paths else [])]
        if self.up:
            parts += ["--up", *(f"{value:g}" for value in self.up)]
        if self.object_ids:
            parts += ["--selection.object-id", "ID"]
        return shlex.join(parts)


def _training_cameras(cameras: CameraSet | None) -> list[Camera]:
    listed = zip(cameras.cameras, cameras.train, strict=True) if cameras else ()
    return [camera for camera, train in listed if train]


def _save(selection: NDArray[Any], path: Path) -> None:
    """Write an .npy file; `np.save` does not notice everywhere that a disk is full, but memory has room."""
    buffer = BytesIO()
    np.save(buffer, selection, allow_pickle=False)
    with atomic_file(path) as part:
        part.write_bytes(buffer.getbuffer())


def _views(scene: Gaussians, cameras: CameraSet | None, up: UpVector) -> tuple[list[Camera], IntArray]:
    """Views to click in, and the rows of the Gaussians that are drawn in them."""
    if cameras is not None:
        return list(cameras.pinhole_cameras()), np.arange(len(scene))
    overview = plan_overview(scene, up.direction)
    return overview.cameras, overview.rows

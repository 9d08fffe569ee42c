"""`gaussian-trimmer select`: a rough selection by clicks, boxes, files, or masks of posed pictures."""

from __future__ import annotations

import shlex
from argparse import Namespace
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from rich.console import Console

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import CameraSet, Viewpoint, check_facing, up_frame
from gaussian_trimmer.commands.arguments import add_marks, add_scene, add_trimming, config_of, mark_files, marks_of
from gaussian_trimmer.commands.console import console_of, in_lengths, print_json, print_up, refuse_existing
from gaussian_trimmer.commands.trim_run import (
    MARKS,
    Request,
    add_results,
    read_scene,
    scene_name,
    trim_into,
    words_again,
)
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import STREAMED, identify
from gaussian_trimmer.formats.streamed_sog import open_streamed
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.io.folders import atomic_folder, is_made_of
from gaussian_trimmer.io.reading import is_file
from gaussian_trimmer.io.writing import npy_bytes, write_whole
from gaussian_trimmer.output.pictures import Picture, as_picture, side_by_side, with_axes, with_grid, write_picture
from gaussian_trimmer.parser import PROGRAM, Parser
from gaussian_trimmer.rendering import blend_values, render
from gaussian_trimmer.selecting.lifting import lift_folder
from gaussian_trimmer.selecting.marks import Box, Click, FromMasks, Marks, read_marks
from gaussian_trimmer.selecting.select import resolve_views, select
from gaussian_trimmer.selecting.selection import Selection
from gaussian_trimmer.settings import Range
from gaussian_trimmer.surface.overview import Overview, OverviewConfig, drawn_rows, plan_views
from gaussian_trimmer.trimming.result import THE_OBJECT
from gaussian_trimmer.trimming.up_vector import UpVector, find_up, up_text

ABOUT = """Select an object roughly: by clicks and boxes in views, other selections, or masks of training pictures.

The views are those of --cameras or, without cameras, numbered ones: what a person sees in rooms, otherwise views from
all around. --list-views writes them as pictures in which to find pixels. A mask belongs to the picture with the same
name: IMG_7.png or IMG_7.JPG.png to IMG_7.JPG; pictures without a mask are skipped. The marks are saved beside the
selection, as a .json file from which --marks makes it again and goes on."""
EXAMPLES = (
    "gaussian-trimmer select scene.ply --list-views views",
    "gaussian-trimmer select scene.ply --view-index 0 --click 330 200 --trim cup",
    "gaussian-trimmer select scene.ply --marks scene_selection.json --view-index 4 --remove-click 250 350",
    "gaussian-trimmer select scene.ply --masks masks --cameras sparse/0 --output cup.npy",
)
_LISTING, _PICTURES = "select --list-views", "[0-9][0-9][0-9].png"
_END_PERCENTILES = (2, 98)
"""Percentiles of the selected centres that are taken for the ends of what is selected."""
_MARKED_PIXELS = 480
"""Height of the pictures of marked views."""
_TAKEN_COLOUR, _TINT, _MARK_COLOURS = (0.1, 0.5, 1.0), 0.55, ((90, 230, 90), (60, 60, 255))
"""Colour of what was taken, red first, and how strong it is; colours of marks that add or keep, and of those that take
away, blue first."""


def add_arguments(parser: Parser) -> None:
    """Say what the command takes."""
    parser.describe(ABOUT, run, EXAMPLES)
    add_scene(parser)
    group = parser.add_argument_group("find pixels")
    group.add_argument(
        "--list-views", kind=Path, metavar="DIR", help="Only write pictures of all views here, named by their numbers"
    )
    group.add_argument("--grid", kind=bool, help="Draw a grid of pixel numbers over these pictures")
    parser.add_fields("where views stand, without cameras", OverviewConfig)
    add_marks(parser)
    group = parser.add_argument_group("or take earlier marks, or masks of the pictures")
    group.add_argument(
        "--marks", dest="marks_file", kind=Path, metavar="FILE", help="Begin with those of an earlier run"
    )
    masks = "Folder of masks in which the object is bright; or a pattern such as 'out/*/chosen_cup.png', in which * "
    masks += "stands for the picture's name or number"
    group.add_argument("--masks", kind=Path, metavar="DIR", help=masks)
    bias = "Bias of --masks towards the background, from -1 to 1"
    group.add_argument("--gamma", kind=Annotated[float, Range(-1, 1)], default=0.0, help=bias)
    group.add_argument("--object-ids", kind=bool, help="Select all objects at once, by masks that hold their numbers")
    output = "File for the selection, .npy, and the marks beside it (default: SCENE_selection.npy)"
    group = add_results(parser, "FILE", output)
    group.add_argument("--trim", kind=Path, metavar="DIR", help="Also trim, and write the results to this folder")
    add_trimming(parser, rare=True)


def run(arguments: Namespace) -> int:
    """Select and save the selection, then trim it if asked to; return the exit code, 3 where nothing was trimmed.

    Raises:
        InputError: something that the user gave cannot be used, or the selection is empty.
    """
    console, path = console_of(arguments), arguments.output or Path(f"{scene_name(arguments.scene)}_selection.npy")
    _check(arguments, path)
    if arguments.list_views is not None:
        _write_views(arguments, console)
        return 0
    if (folder := arguments.trim) is not None:
        given = [file for file in (arguments.scene, path, arguments.cameras, arguments.sam) if isinstance(file, Path)]
        arguments.overwrite = arguments.overwrite or is_made_of(folder, path)
        read = partial(_select, arguments, path, console)
        return trim_into(folder, arguments, console, read, files=given, source=path)
    request = _select(arguments, path, console)
    selection, scene = request.objects[THE_OBJECT], request.scene
    console.print(f"Now: {shlex.join([PROGRAM, *request.command])}")
    counts = {"selected": int(np.count_nonzero(selection.mask)), "scene": len(scene)}
    print_json(arguments, {"selection": str(path), "counts": counts})
    return 0


def _select(arguments: Namespace, path: Path, console: Console) -> Request:
    """Make the selection and save it; return it, and what it was made from."""
    inputs = {"scene": arguments.scene, "selection": path, "cameras": arguments.cameras}
    scene, cameras = read_scene(arguments, console)
    if arguments.object_ids:
        check_facing(cameras, scene.means)
        labels, n_masks = lift_folder(scene, cameras, arguments.masks, arguments.gamma, ids=True)
        if not labels.any():
            raise InputError("No Gaussian was selected; check that the cameras and masks belong to this scene.")
        write_whole(path, npy_bytes(labels))
        console.print(f"{path}: {np.count_nonzero(labels):,} of {len(scene):,} Gaussians, {n_masks} masks")
        return Request(scene, cameras, {THE_OBJECT: Selection(labels != 0)}, _next_words(arguments, path), inputs)
    up = find_up(scene, cameras, arguments.up)
    made = select(scene, _resolved(arguments, scene, cameras, up), cameras=cameras)
    made.save(path)
    if (picture := _draw_marks(scene, made)) is not None:
        write_picture(picture, path.with_suffix(".png"))
    ends = np.percentile(scene.means[made.mask] @ up_frame(up.direction).T, _END_PERCENTILES, axis=0)
    size, understood = in_lengths(np.ptp(ends, axis=0)), "; then ".join(made.interpretations)
    count = f"{np.count_nonzero(made.mask):,} of {len(scene):,} Gaussians"
    seen = f"; {path.with_suffix('.png')} shows it" if picture is not None else ""
    console.print(f"{path}: {count}, {size}, {understood}{seen}")
    if arguments.trim is None:  # else the trim says what it found for the object
        console.print(f"up: {up_text(**vars(up))}")
    known_up = config_of(arguments).up or up.for_trims()
    words = _next_words(arguments, path, made.marks, known_up)
    return Request(scene, cameras, {THE_OBJECT: made}, words, inputs, made.marks, up)


def _draw_marks(scene: Gaussians, made: Selection) -> Picture | None:
    """Return each view in which something was marked, with the marks and, tinted, what they took; None without any."""
    assert made.marks is not None, "they made the selection"
    by_view = dict[bytes, list[Click | Box]]()
    for mark in made.marks.marks:
        if isinstance(mark, Click | Box) and isinstance(mark.view, Viewpoint):
            by_view.setdefault(mark.view.camera.world_to_camera.tobytes(), []).append(mark)
    pictures = []
    for marks in by_view.values():
        view = marks[0].view
        assert isinstance(view, Viewpoint), "others have no marks"
        scale = _MARKED_PIXELS / view.camera.height
        rows, camera = drawn_rows(scene.means, view), view.camera.resized(scale)
        drawn = scene.select(rows)
        taken = _TINT * np.clip(blend_values(drawn, camera, made.mask[rows].astype(np.float32)[:, None]), 0, 1)
        picture = as_picture((1 - taken) * render(drawn, camera).rgb + taken * np.array(_TAKEN_COLOUR, np.float32))
        for mark in marks:
            colour = _MARK_COLOURS[mark.effect == "remove"]
            places = (mark.x, mark.y) if isinstance(mark, Click) else (mark.x0, mark.y0, mark.x1, mark.y1)
            x, y, *corner = (round(scale * place) for place in places)
            if corner:
                cv2.rectangle(picture, (x, y), (corner[0], corner[1]), colour, 2, cv2.LINE_AA)
            else:
                cv2.drawMarker(picture, (x, y), colour, cv2.MARKER_CROSS, 20, 2, cv2.LINE_AA)
        pictures.append(picture)
    return side_by_side(pictures) if pictures else None


def _resolved(arguments: Namespace, scene: Gaussians, cameras: CameraSet | None, up: UpVector) -> Marks:
    """Return all marks, those of an earlier run first."""
    views = _overview(arguments, scene, None, up).views if cameras is None else None
    marks: list[Any] = marks_of(arguments)
    if arguments.masks is not None:
        marks.insert(0, FromMasks(arguments.masks, arguments.gamma))
    path = arguments.cameras
    resolved = resolve_views(scene, marks, cameras=cameras, up=up.direction, views=views, camera_path=path)
    resolved = replace(resolved, scene=arguments.scene)
    return resolved if arguments.marks_file is None else read_marks(arguments.marks_file).followed_by(resolved, path)


def _check(arguments: Namespace, path: Path) -> None:
    """Refuse what is not possible or cannot go together before anything is read."""
    marks, masks, earlier = marks_of(arguments), arguments.masks, arguments.marks_file
    if arguments.list_views is not None and (marks or masks or earlier):
        raise InputError("--list-views only writes the views; leave the marks out.")
    if arguments.list_views is None and not marks and masks is None and earlier is None:
        raise InputError("Say what to select: --click X Y, --box X0 Y0 X1 Y1, --add FILE, --masks DIR or --marks FILE.")
    if masks is not None and arguments.cameras is None:
        raise InputError("Masks need the cameras of their pictures: --cameras PATH.")
    if arguments.object_ids and (masks is None or marks or earlier):
        raise InputError("Object numbers come from --masks alone; give it, and leave marks out.")
    if arguments.object_ids and arguments.trim is not None:
        raise InputError("Trim all objects afterwards, with 'trim SCENE --labels FILE'; leave --trim out.")
    if arguments.html and arguments.trim is None:
        raise InputError("--html shows a trim; add --trim DIR, or leave it out.")
    if path.suffix != ".npy":
        raise InputError(f"The selection '{path}' is saved as .npy; give a name with that ending.")
    if arguments.list_views is None:
        _check_files(arguments, path)


def _check_files(arguments: Namespace, path: Path) -> None:
    """Refuse to replace inputs, and files that an earlier selection of this scene did not write."""
    scene, overwrite, beside = arguments.scene, arguments.overwrite, path.with_suffix(".json")
    inputs = [file for file in (scene, arguments.cameras, *mark_files(arguments)) if file is not None]
    # Of an array that was written after its marks, these do not tell.
    marked = is_file(path) and identify(beside).kind == "marks" and path.stat().st_mtime <= beside.stat().st_mtime
    earlier = read_marks(beside).scene if marked else None
    again = not arguments.object_ids and earlier is not None and earlier.resolve() == scene.resolve()
    if marked and not (again or arguments.object_ids or overwrite):
        raise InputError(
            f"'{path}' is a selection of another scene ('{earlier or 'unknown'}'); choose another name with --output, "
            "or replace it with --overwrite."
        )
    for file in [path] if arguments.object_ids else [path, beside, path.with_suffix(".png")]:
        refuse_existing(file, inputs=inputs, overwrite=overwrite or again)


def _overview(arguments: Namespace, scene: Gaussians, cameras: CameraSet | None, up: UpVector) -> Overview:
    """Return the views of the cameras, or those that are planned: of a capture with levels, the same at each."""
    if cameras is not None:
        return Overview([Viewpoint(camera) for camera in cameras.pinhole_cameras()], range(0))
    path = identify(arguments.scene).scene
    if path.name == STREAMED:
        scene = formats.read(path, level=open_streamed(path).coarsest, say=lambda text: None)
        up = find_up(scene, None, arguments.up)
    config = OverviewConfig(**{field.name: getattr(arguments, field.name) for field in fields(OverviewConfig)})
    return plan_views(scene, up.direction, config)


def _write_views(arguments: Namespace, console: Console) -> None:
    folder, scene_file = arguments.list_views, arguments.scene
    overwrite = arguments.overwrite or is_made_of(folder, scene_file)
    with atomic_folder(folder, _LISTING, names=[_PICTURES], source=scene_file, overwrite=overwrite) as part:
        scene, cameras = read_scene(arguments, console)
        check_facing(cameras, scene.means)
        up = find_up(scene, cameras, arguments.up)
        overview = _overview(arguments, scene, cameras, up)
        for number, view in enumerate(overview.views):
            picture = as_picture(render(scene.select(drawn_rows(scene.means, view)), view.camera).rgb)
            picture = picture if up.is_sure else with_axes(picture, view.camera)
            write_picture(with_grid(picture) if arguments.grid else picture, part / f"{number:03d}.png")
    print_json(arguments, {"views": len(overview.views)}, folder)
    print_up(console, up)
    console.print(f"{folder}: {len(overview.views)} views, each named by its number for --view-index")
    if 0 < len(overview.whole) < len(overview.views):
        first, last = overview.whole[0], overview.whole[-1]
        console.print(f"Views {first} to {last} show the whole capture, the others its most detailed part.")
    words = [PROGRAM, *words_again("select", arguments, list_views=None, grid=False)]
    console.print(f"To mark: {shlex.join(words)} --view-index N --click X Y")


def _next_words(arguments: Namespace, path: Path, marks: Marks | None = None, up: Any = None) -> list[str]:
    """Return the words of the command that trims the selection, again if it is trimmed now."""
    if arguments.trim is not None:
        return words_again("trim", arguments, selection=arguments.trim / MARKS, in_order=(), up=up)
    file = path.with_suffix(".json") if marks is not None and marks.exclude else path
    what = {"labels": file} if arguments.object_ids else {"selection": file}
    return words_again("trim", arguments, in_order=(), **what)

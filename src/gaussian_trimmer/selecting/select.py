"""From a list of marks to a selection, and which views marks refer to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.cameras import Camera, CameraSet, Viewpoint, check_facing, point_of, training_cameras
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array, Gaussians, check_gaussians
from gaussian_trimmer.geometry.limits import check_places
from gaussian_trimmer.rendering import top_contributors
from gaussian_trimmer.selecting.interpretation import apply_marks
from gaussian_trimmer.selecting.marks import Box, Click, Mark, Marks, View, read_marks
from gaussian_trimmer.selecting.selection import Selection
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.surface.overview import plan_views
from gaussian_trimmer.surface.viewed_scene import check_pixel
from gaussian_trimmer.trimming.up_vector import find_up


def select(
    scene: Gaussians,
    marks: Sequence[Mark] | Marks | str | Path,
    *,
    cameras: CameraSet | None = None,
    up: Any = None,
    views: Sequence[Viewpoint] | None = None,
) -> Selection:
    """Select Gaussians by marks: clicks and boxes in views, volumes, files and masks, in order.

    Args:
        scene: all N Gaussians.
        marks: a list of marks; or marks that were saved, or their file: then `cameras` and `up` are known.
        cameras: the cameras that the scene was trained with, if known. Marks name their views.
        up: the up vector in the scene's coordinates, if known: three numbers, or an axis, "z" or "-y".
        views: the views that marks can name, in place of those of `cameras`, or of planned ones.

    Raises:
        InputError: the coordinates are as large as a map's, a mark is not possible, a view is not known, nothing is
            seen at a pixel, or nothing is selected.
    """
    check_gaussians(scene)
    check_places(scene)
    if isinstance(marks, str | Path):
        marks = read_marks(marks)
    if not isinstance(marks, Marks):
        marks = resolve_views(scene, marks, cameras=cameras, up=up, views=views)
    return apply_marks(scene, marks, cameras)


def resolve_views(
    scene: Gaussians,
    marks: Sequence[Mark],
    *,
    cameras: CameraSet | None = None,
    up: Any = None,
    views: Sequence[Viewpoint] | None = None,
    camera_path: Path | None = None,
) -> Marks:
    """Return marks whose views are looked up, with the up vector and the places that the scene was photographed from.

    Args:
        scene: all N Gaussians.
        marks: name their views, or hold them.
        cameras: the training cameras, if known.
        up: the scene's up vector, (3,), if known.
        views: the views that marks can name, in place of those of `cameras`, or of planned ones.
        camera_path: where the cameras came from, if known.

    Raises:
        InputError: a view is not known, or the cameras look away from the scene.
    """
    check_facing(cameras, scene.means)
    found = find_up(scene, cameras, up)
    resolved = []
    for mark in marks:
        if isinstance(mark, Click | Box) and isinstance(mark.view, Camera):
            mark = replace(mark, view=Viewpoint(mark.view))
        elif isinstance(mark, Click | Box) and not isinstance(mark.view, Viewpoint):
            views = views_to_click_in(scene, cameras, found.direction) if views is None else views
            mark = replace(mark, view=find_view(views, mark.view))
        resolved.append(mark)
    photographed_from = tuple(point_of(camera.centre) for camera in training_cameras(cameras))
    return Marks(tuple(resolved), point_of(found.direction), photographed_from, len(scene), camera_path)


def views_to_click_in(scene: Gaussians, cameras: CameraSet | None, up: Float64Array) -> list[Viewpoint]:
    """Return the views of the cameras or, without cameras, those that `plan_views` plans."""
    if cameras is not None:
        return [Viewpoint(camera) for camera in cameras.pinhole_cameras()]
    return plan_views(scene, up).views


def with_query_row(
    options: SelectionOptions, scene: Gaussians, view: View | None, cameras: CameraSet | None
) -> SelectionOptions:
    """Return options in which a queried pixel has become the row of the Gaussian that shows most there.

    Args:
        options: how a selection file is read.
        scene: all N Gaussians.
        view: the view of the pixel.
        cameras: the training cameras, if known.

    Raises:
        InputError: the view is not named or known, or the pixel is outside of it, or shows nothing.
    """
    if options.query_point is None:
        return options
    if view is None:
        raise InputError("Name the view of the queried pixel: --view NAME or --view-index INT.")
    camera = find_view(views_to_click_in(scene, cameras, find_up(scene, cameras).direction), view).camera
    check_pixel(camera, *options.query_point)
    rows, _ = top_contributors(scene, camera, np.array([options.query_point]), 1)
    if rows[0, 0] < 0:
        raise InputError(f"Nothing is seen at the pixel {options.query_point}; choose another one, or another view.")
    return replace(options, query_point=None, query_row=int(rows[0, 0]))


def find_view(views: Sequence[Viewpoint], wanted: View) -> Viewpoint:
    """Return the view of a name, with or without its ending, or else of a number from 0.

    Raises:
        InputError: there is none, or there are several.
    """
    if isinstance(wanted, Viewpoint):
        return wanted
    if isinstance(wanted, str):
        named = [view for view in views if wanted in (view.camera.name, Path(view.camera.name).stem)]
        if len(named) == 1:
            return named[0]
        if named or not wanted.isdigit():
            known = f"{views[0].camera.name} ... {views[-1].camera.name}" if views[0].camera.name else "numbered from 0"
            how_many = f"{len(named)} views are" if named else "No view is"
            raise InputError(f"{how_many} named '{wanted}'; the {len(views)} views are {known}.")
    number = int(wanted)  # type: ignore[arg-type]
    if not 0 <= number < len(views):
        raise InputError(f"There is no view {wanted}; the {len(views)} views are numbered from 0.")
    return views[number]

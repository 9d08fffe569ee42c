"""The pictures of the report: each view before and after, the scene with and without the object, what was changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.output.html.comparison import Figure, Pairing
from gaussian_trimmer.output.pictures import Picture, draw_gaussians, draw_outlines, nearby_background, nearby_scene
from gaussian_trimmer.planning.observed_angles import cameras_that_see
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.result import TrimResult
from gaussian_trimmer.views import TrimmedView

_Thing = TypeVar("_Thing")
_MOST_PIXELS = 512
"""Longer side of a picture."""
_MOST_VIEWS = 12
_TRAINING_CAMERAS = 2
"""Number of those from which the whole scene is shown."""
_INVISIBLE_LOGIT = -100.0
"""Of what no renderer draws."""
SELECTION, OBJECT, OUTLINES = "rough selection", "trimmed object", "outlines"
CHANGES, SCENE, REST = "what was done", "scene", "scene without the object"
VIEW_PAIRINGS = (
    Pairing("before and after", SELECTION, OBJECT, "The rough selection and the trimmed object, each alone."),
    Pairing(
        "where the views put the edge", OBJECT, OUTLINES,
        "The view as it was segmented: orange is the outline of the rough selection, light blue that of the mask, red "
        "that of a mask that was rejected.",
    ),
)  # fmt: skip
CHANGE_PAIRINGS = (Pairing("what was done", SELECTION, CHANGES),)
BACKGROUND_PAIRINGS = (
    Pairing("scene and what is left", SCENE, REST, "The object should be gone, and everything else still there."),
)


def shown_views(result: TrimResult) -> list[int]:
    """Numbers of the views that a page shows, ascending: rejected ones before others where there are too many."""
    numbers = range(len(result.views))
    rejected = [i for i in numbers if result.views[i].rejected]
    accepted = [i for i in numbers if not result.views[i].rejected]
    few = _spread(rejected, _MOST_VIEWS if not accepted else _MOST_VIEWS // 2)
    return sorted([*few, *_spread(accepted, _MOST_VIEWS - len(few))])


def view_figures(result: TrimResult, changes: Gaussians) -> list[Figure]:
    """A figure for each shown view, with the pictures of `VIEW_PAIRINGS` and `CHANGE_PAIRINGS`."""
    coarse = result.scene.select(result.selection)
    figures = []
    for number in shown_views(result):
        view = result.views[number]
        parts = {SELECTION: coarse, OBJECT: result.object, CHANGES: changes}
        figure = draw_figure(_caption(number, view), view.view.camera, parts, result.used_renderer)
        outlines = _at_size(draw_outlines(view), small_camera(view.view.camera))
        doubt = f"rejected: {view.rejected}" if view.rejected else ""
        figures.append(Figure(figure.caption, {**figure.pictures, OUTLINES: outlines}, doubt))
    return figures


def background_figures(result: TrimResult) -> list[Figure]:
    """The scene and what is left of it, whole from training cameras if they are known, and about the object."""
    seeing = _spread(cameras_that_see(result.cameras, result.bounds), _TRAINING_CAMERAS)
    whole = [(f"the whole scene from {camera.name or 'a training camera'}", camera) for camera in seeing]
    near = [(f"about the object, view {i}", result.views[i].view.camera) for i in shown_views(result)]
    parts = {SCENE: result.scene, REST: _without_object(result)} if whole else {}
    near_parts = {SCENE: nearby_scene(result), REST: nearby_background(result)} if near else {}
    return [
        *(draw_figure(caption, camera, parts, result.used_renderer) for caption, camera in whole),
        *(draw_figure(caption, camera, near_parts, result.used_renderer) for caption, camera in near),
    ]


def _without_object(result: TrimResult) -> Gaussians:
    """The whole background; where it is rows of the scene alone, by hiding the others, since a copy may be large."""
    if len(result.appended):
        return result.background
    logits = np.full(len(result.scene), _INVISIBLE_LOGIT, np.float32)
    logits[result.background_rows] = result.scene.opacity_logits[result.background_rows]
    return result.scene.replace(opacity_logits=logits)


def draw_figure(caption: str, camera: Camera, parts: Mapping[str, Gaussians], renderer: Renderer) -> Figure:
    """A figure with a picture of each of several sets of Gaussians, by what they are."""
    camera = small_camera(camera)
    return Figure(caption, {name: draw_gaussians(part, camera, renderer) for name, part in parts.items()})


def _caption(number: int, view: TrimmedView) -> str:
    name = f" ({view.view.camera.name})" if view.view.camera.name else ""
    return f"view {number}{name}"


def small_camera(camera: Camera) -> Camera:
    """The camera with a picture that is no larger than a page shows."""
    return camera.resized(min(1.0, _MOST_PIXELS / max(camera.width, camera.height)))


def _at_size(picture: Picture, camera: Camera) -> Picture:
    if picture.shape[:2] == (camera.height, camera.width):
        return picture
    return np.asarray(cv2.resize(picture, (camera.width, camera.height), interpolation=cv2.INTER_AREA), np.uint8)


def _spread(things: Sequence[_Thing], count: int) -> list[_Thing]:
    """That many of the things, evenly spread; all of them if they are no more."""
    if len(things) <= count:
        return list(things)
    return [things[i * len(things) // count] for i in range(count)]

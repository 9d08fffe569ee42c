"""The pictures of the report: each view before and after, the scene with and without the object, what was changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.output.html.comparison import Figure, Pairing
from gaussian_trimmer.output.pictures import draw_gaussians, draw_outlines, nearby_background, nearby_scene
from gaussian_trimmer.planning.observed_angles import cameras_that_see
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.result import TrimResult

_Thing = TypeVar("_Thing")
_MOST_PIXELS = 512
"""Longer side of a picture."""
_MOST_VIEWS = 12
_TRAINING_CAMERAS = 2
"""Number of those from which the whole scene is shown."""
SELECTION, OBJECT, OUTLINES = "selection", "trimmed object", "outlines"
CHANGES, SCENE, REST = "what was done", "scene", "scene without the object"
VIEW_PAIRINGS = (
    Pairing("before and after", SELECTION, OBJECT, "The selection and the trimmed object, each alone."),
    Pairing(
        "where the views put the edge",
        OBJECT,
        OUTLINES,
        "The view as it was segmented: orange is the outline of the selection, light blue that of the mask, red "
        "that of a mask that was rejected.",
    ),
)
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
    selected = result.scene.select(result.selection)
    figures = []
    for number in shown_views(result):
        view = result.views[number]
        parts = {SELECTION: selected, OBJECT: result.object, CHANGES: changes}
        name = f" ({view.view.camera.name})" if view.view.camera.name else ""
        figure = draw_figure(f"view {number}{name}", view.view.camera, parts, result.used_renderer)
        height, width = figure.pictures[OBJECT].shape[:2]
        outlines = np.asarray(cv2.resize(draw_outlines(view), (width, height), interpolation=cv2.INTER_AREA), np.uint8)
        doubt = f"rejected: {view.rejected}" if view.rejected else ""
        figures.append(Figure(figure.caption, {**figure.pictures, OUTLINES: outlines}, doubt))
    return figures


def background_figures(result: TrimResult) -> list[Figure]:
    """The scene and what is left of it, whole from training cameras if they are known, and about the object."""
    seeing = _spread(cameras_that_see(result.cameras, result.bounds), _TRAINING_CAMERAS)
    whole = [(f"the whole scene from {camera.name or 'a training camera'}", camera) for camera in seeing]
    near = [(f"about the object, view {i}", result.views[i].view.camera) for i in shown_views(result)]
    parts = {SCENE: result.scene, REST: result.background} if whole else {}
    near_parts = {SCENE: nearby_scene(result), REST: nearby_background(result)} if near else {}
    return [
        *(draw_figure(caption, camera, parts, result.used_renderer) for caption, camera in whole),
        *(draw_figure(caption, camera, near_parts, result.used_renderer) for caption, camera in near),
    ]


def draw_figure(caption: str, camera: Camera, parts: Mapping[str, Gaussians], renderer: Renderer) -> Figure:
    """A figure with a picture of each of several sets of Gaussians, by what they are."""
    camera = camera.resized(min(1.0, _MOST_PIXELS / max(camera.width, camera.height)))
    return Figure(caption, {name: draw_gaussians(part, camera, renderer) for name, part in parts.items()})


def _spread(things: Sequence[_Thing], count: int) -> list[_Thing]:
    """That many of the things, evenly spread; all of them if they are no more."""
    if len(things) <= count:
        return list(things)
    return [things[i * len(things) // count] for i in range(count)]

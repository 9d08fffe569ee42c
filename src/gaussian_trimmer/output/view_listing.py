"""Views to click in: a picture of each, and a page that turns clicks into a command."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import Gaussians, IntArray
from gaussian_trimmer.io.writing import write_whole
from gaussian_trimmer.output.html.document import asset, document, json_block, render
from gaussian_trimmer.output.pictures import Picture, as_picture, write_picture
from gaussian_trimmer.rendering import Renderer

VIEW_FILES = ("[0-9][0-9][0-9].png", "index.html")
"""Patterns of the names of the files in a listing."""
_GRID_STEPS = (20, 25, 50, 100, 200, 250, 500, 1000)
_GRID_LINES = 12
"""Number of lines that a grid has along the longer side, about."""
_INK_COLOUR, _SHADE_COLOUR = (255, 255, 255), (0, 0, 0)
_FONT_SCALE = 0.4


def write_view_listing(
    scene: Gaussians,
    views: Sequence[tuple[Camera, IntArray]],
    whole: Sequence[int],
    command: Sequence[str],
    folder: Path,
    renderer: Renderer,
    *,
    grid: bool = False,
) -> None:
    """Write a picture of each view, 000.png and so on, and `index.html`.

    Args:
        views: the cameras, and the rows of the Gaussians that are drawn in each.
        whole: numbers of the views that show the whole capture, which the page shows first.
        command: the words of the command that the page completes by the marks.
        folder: an existing folder.
        grid: draw a grid of pixel numbers over the pictures.

    Raises:
        InputError: a file cannot be written.
    """
    for number, (camera, rows) in enumerate(views):
        drawn = scene if len(rows) == len(scene) else scene.select(rows)
        picture = as_picture(renderer.render(drawn, camera).rgb)
        write_picture(with_grid(picture) if grid else picture, folder / f"{number:03d}.png")
    write_whole(folder / "index.html", page([camera for camera, _ in views], whole, command))


def with_grid(picture: Picture) -> Picture:
    """A picture with lines at round pixel numbers, which stand at its upper and left edge."""
    height, width = picture.shape[:2]
    step = next((step for step in _GRID_STEPS if step * _GRID_LINES >= max(height, width)), _GRID_STEPS[-1])
    drawn = picture.copy()
    for x in range(step, width, step):
        cv2.line(drawn, (x, 0), (x, height - 1), _INK_COLOUR, 1)
    for y in range(step, height, step):
        cv2.line(drawn, (0, y), (width - 1, y), _INK_COLOUR, 1)
    drawn = np.asarray(cv2.addWeighted(drawn, 0.25, picture, 0.75, 0), np.uint8)
    for x in range(step, width, step):
        draw_number(drawn, x, (x + 2, 10))
    for y in range(step, height, step):
        draw_number(drawn, y, (2, y - 3))
    return drawn


def page(cameras: Sequence[Camera], whole: Sequence[int], command: Sequence[str]) -> str:
    """The page as HTML; it works without a server, and loads nothing but the pictures beside it."""
    order = [*whole, *(number for number in range(len(cameras)) if number not in set(whole))]
    words = json_block("words", shlex.join(command))
    body = render("view_listing.html", order=order, cameras=cameras, whole=set(whole), words=words)
    style, script = asset("view_listing.css"), asset("view_listing.js")
    return document("Views to click in", body, style=style, script=script, stands_alone=False)


def draw_number(picture: Picture, number: int, place: tuple[int, int], scale: float = _FONT_SCALE) -> None:
    """Write a number into a picture, to be read on any ground; `place` is its lower left corner, x and y."""
    for colour, thickness in ((_SHADE_COLOUR, 3), (_INK_COLOUR, 1)):
        cv2.putText(picture, str(number), place, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, thickness, cv2.LINE_AA)

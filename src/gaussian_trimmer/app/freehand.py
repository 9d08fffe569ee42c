"""Which Gaussians a lasso, a polygon or a stroke of the brush takes. N Gaussians, H x W pixels of a small view."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from gaussian_trimmer.app.gestures import Place
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.selecting.marks import Viewpoint
from gaussian_trimmer.selecting.viewed_scene import CONTRIBUTORS, small_view, surface_depths

_SHIFT = 4
"""Bits of a pixel's fraction in OpenCV's coordinates."""


def drawn_mask(camera: Camera, places: Sequence[Place], radius: float | None) -> BoolArray:
    """The pixels inside a closed line, or within a radius of an open one, (H, W).

    Args:
        camera: the view; it says the size.
        places: where the line goes.
        radius: in pixels of the view; None: the line is closed, and what it surrounds is meant.
    """
    mask = np.zeros((camera.height, camera.width), np.uint8)
    line = np.round((np.array(places) * (camera.width, camera.height) - 0.5) * (1 << _SHIFT)).astype(np.int32)
    if radius is None:
        cv2.fillPoly(mask, [line], 1, shift=_SHIFT)
    else:
        cv2.polylines(mask, [line], False, 1, max(1, round(2 * radius)), shift=_SHIFT)
        for x, y in line:
            cv2.circle(mask, (int(x), int(y)), max(1, round(radius * (1 << _SHIFT))), 1, -1, shift=_SHIFT)
    return mask.astype(np.bool_)


def rows_drawn(
    gaussians: Gaussians,
    view: Viewpoint,
    places: Sequence[Place],
    *,
    radius: float | None,
    through: bool,
    renderer: Renderer,
) -> BoolArray:
    """The Gaussians whose centres lie within what was drawn over them, (N,).

    Those of the surface reach as deep below it as the brush's radius, or half of the width that a lasso has.

    Args:
        gaussians: those that are shown.
        view: from where.
        places: where the line goes.
        radius: of the brush, in pixels of the view; None for a lasso or a polygon.
        through: take all depths, not only the surface.
        renderer: finds the surface.

    Raises:
        InputError: nothing is seen there.
    """
    camera = small_view(view.camera)
    shrunk = None if radius is None else radius * camera.width / view.camera.width
    mask = drawn_mask(camera, places, shrunk)
    pixels, depths = camera.project(gaussians.means.astype(np.float64))
    rows = np.flatnonzero((depths > camera.near) & camera.contains(pixels))
    x, y = pixels[rows].astype(np.int64).T
    rows, x, y = (values[mask[y, x]] for values in (rows, x, y))
    if not through and len(rows):
        reach = shrunk if shrunk is not None else np.sqrt(np.count_nonzero(mask) / np.pi)
        corners = np.argwhere(mask)[:, ::-1]
        surface = np.full(mask.shape, np.inf)
        surface[mask] = surface_depths(
            gaussians, camera, *renderer.top_contributors(gaussians, camera, corners, CONTRIBUTORS)
        )
        front = surface[y, x]
        rows = rows[depths[rows] <= front * (1 + reach / camera.K[0, 0])]
    if not len(rows):
        raise InputError("Nothing that is shown is there; draw over what you see.")
    taken = np.zeros(len(gaussians), np.bool_)
    taken[rows] = True
    return taken

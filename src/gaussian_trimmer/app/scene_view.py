"""What is seen in the browser's 3D view: splats, virtual cameras, the up vector, and the tools' gizmos."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.app.display import Splats
from gaussian_trimmer.app.space_box import SpaceBox
from gaussian_trimmer.app.viewpoints import Frame
from gaussian_trimmer.cameras import up_frame
from gaussian_trimmer.gaussians import Float64Array, quaternions_of
from gaussian_trimmer.output.result import TrimResult
from gaussian_trimmer.selecting.marks import Box3D, Effect, Point, point_of
from gaussian_trimmer.views import TrimmedView

_ACCEPTED_COLOUR, _REJECTED_COLOUR = (60, 200, 90), (230, 60, 60)
_MASK_TINT = (40, 230, 120)
_THUMBNAIL_PIXELS = 192
"""Pixels of the pictures in the virtual cameras."""
_FRUSTUM_RADII = 0.3
"""Size of a virtual camera, relative to the object's radius."""
_BACKDROP_SIZE, _CHECKER_PIXELS, _CHECKER_TONES = (450, 800), 25, (150, 105)


class SceneView:
    """The 3D view that all tabs share. Points and sizes are given in the scene's coordinates."""

    def __init__(self, server: Any) -> None:
        self._server = server
        self._splats: Any = None
        self._views: list[Any] = []
        self._points: list[Any] = []
        self._box: SpaceBox | None = None
        self.frame = Frame(np.zeros(3), 1.0)

    def show(self, splats: Splats) -> None:
        """Show Gaussians in place of those before."""
        centres, colours = splats.centres, splats.colours
        covariances, opacities = splats.covariances, splats.opacities
        if not len(splats):  # an invisible one, since an empty buffer has no texture
            centres, colours = np.zeros((1, 3), np.float32), np.zeros((1, 3), np.float32)
            covariances, opacities = np.eye(3, dtype=np.float32)[None] * 1e-4, np.zeros((1, 1), np.float32)
        if self._splats is None:
            self._splats = self._server.scene.add_gaussian_splats("/splats", centres, covariances, colours, opacities)
        else:
            self._splats.set_gaussians(centres, covariances, colours, opacities)
        self._server.flush()

    def show_up(self, up: Float64Array) -> None:
        """Turn the view of all tabs, and of those to come, so that up is up."""
        self._server.scene.set_up_direction(point_of(up))
        self._server.initial_camera.up = point_of(up)
        for client in self._server.get_clients().values():
            client.camera.up_direction = point_of(up)

    def show_views(self, result: TrimResult | None) -> None:
        """Show the virtual cameras of a trim with what they saw and its masks, or none."""
        for handle in self._views:
            handle.remove()
        self._views = []
        for number, view in enumerate(result.views if result is not None else ()):
            assert result is not None
            size = _FRUSTUM_RADII * result.bounds.radius * self.frame.scale
            self._views.append(self._frustum(f"/views/{number}", view, size))

    def show_points(self, points: Sequence[Point]) -> None:
        """Show points that were clicked."""
        for handle in self._points:
            handle.remove()
        self._points = [
            self._server.scene.add_icosphere(
                f"/points/{number}", 0.06, (40, 120, 255), position=self._place(point), cast_shadow=False
            )
            for number, point in enumerate(points)
        ]

    def show_box(self, centre: Point, size: Sequence[float], up: Float64Array) -> None:
        """Show a box that stands upright, with handles."""
        self.hide_box()
        place, sides = self.frame.to_viewer(np.array(centre)), np.array(size) * self.frame.scale
        self._box = SpaceBox(self._server.scene, place, sides, up_frame(up))

    def hide_box(self) -> None:
        """Take the box away."""
        if self._box is not None:
            self._box.remove()
        self._box = None

    def box_mark(self, up: Float64Array, effect: Effect) -> Box3D | None:
        """The mark that the box stands for; None if there is no box."""
        if self._box is None:
            return None
        centre, half = up_frame(up) @ self.frame.to_scene(self._box.centre), self._box.size / self.frame.scale / 2
        return Box3D(point_of(centre - half), point_of(centre + half), "up", effect)

    def show_backdrop(self, colour: tuple[int, int, int] | None) -> None:
        """Show a colour behind everything, or a checker."""
        height, width = _BACKDROP_SIZE
        picture = np.empty((height, width, 3), np.uint8)
        if colour is None:
            rows, columns = np.indices((height, width)) // _CHECKER_PIXELS
            picture[:] = np.where((rows + columns) % 2, *_CHECKER_TONES)[..., None]
        else:
            picture[:] = colour
        self._server.scene.set_background_image(picture, "png")

    def look(self, client: Any, eye: Point, target: Point) -> None:
        """Let one tab, or all tabs that open later, look from one point at another."""
        camera: Any = self._server.initial_camera if client is None else client.camera
        camera.position = self._place(eye)
        camera.look_at = self._place(target)

    def _place(self, point: Point) -> Point:
        return point_of(self.frame.to_viewer(np.array(point)))

    def _frustum(self, name: str, view: TrimmedView, size: float) -> Any:
        camera = view.view.camera
        return self._server.scene.add_camera_frustum(
            name,
            fov=float(2 * np.arctan(camera.height / 2 / camera.K[1, 1])),
            aspect=camera.width / camera.height,
            scale=size,
            color=_REJECTED_COLOUR if view.rejected else _ACCEPTED_COLOUR,
            image=_thumbnail(view),
            format="jpeg",
            wxyz=quaternions_of(camera.rotation.T[None])[0],
            position=self._place(point_of(camera.centre)),
            cast_shadow=False,
        )


def _thumbnail(view: TrimmedView) -> NDArray[np.uint8]:
    """What a view saw, its mask tinted."""
    picture = np.clip(view.view.rgb, 0, 1) * 255
    tinted = np.where(view.mask[..., None], 0.5 * picture + 0.5 * np.array(_MASK_TINT), picture)
    scale = _THUMBNAIL_PIXELS / max(tinted.shape[:2])
    size = max(1, round(tinted.shape[1] * scale)), max(1, round(tinted.shape[0] * scale))
    return np.asarray(cv2.resize(tinted.astype(np.uint8), size, interpolation=cv2.INTER_AREA))

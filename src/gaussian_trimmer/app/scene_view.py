"""What is seen in the browser's 3D view: splats, virtual cameras, the up vector, and a box with handles."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from gaussian_trimmer.app.display import Splats
from gaussian_trimmer.app.viewpoints import Frame, viewpoint_of
from gaussian_trimmer.cameras import Point, Viewpoint, point_of, up_frame
from gaussian_trimmer.gaussians import Float64Array, FloatArray, quaternions_of
from gaussian_trimmer.output.pictures import draw_outlines
from gaussian_trimmer.selecting.marks import Box3D, Effect
from gaussian_trimmer.trimming.result import TrimResult
from gaussian_trimmer.views.view import TrimmedView

_ACCEPTED_COLOUR, _REJECTED_COLOUR = (60, 200, 90), (230, 60, 60)
_FRUSTUM_RADII = 0.3
"""Size of a virtual camera, relative to the object's radius."""
_BACKDROP_SIZE, _CHECKER_PIXELS, _CHECKER_TONES = (450, 800), 25, (150, 105)


class SceneView:
    """The 3D view that all tabs share. Points and sizes are given in the scene's coordinates."""

    def __init__(self, server: Any) -> None:
        self._server = server
        self._splats: Any = None
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
        self._server.scene.remove_by_name("/views")
        if result is not None:
            size = _FRUSTUM_RADII * result.objects[0].bounds.radius * self.frame.scale
            for number, view in enumerate(result.objects[0].views):
                self._show_frustum(f"/views/{number}", view, size)

    def show_points(self, points: Sequence[Point]) -> None:
        """Show points that were clicked."""
        self._server.scene.remove_by_name("/points")
        for number, point in enumerate(points):
            self._server.scene.add_icosphere(
                f"/points/{number}", 0.06, (40, 120, 255), position=self._place(point), cast_shadow=False
            )

    def show_box(self, ends: Float64Array, up: Float64Array) -> None:
        """Show a box with handles; its ends are corners (2, 3) in coordinates in which up is z."""
        self._box = SpaceBox(self._server.scene, self._upright(up).to_viewer(ends), up_frame(up))

    def hide_box(self) -> None:
        """Take the box away."""
        self._server.scene.remove_by_name(NODE)
        self._box = None

    def box_mark(self, up: Float64Array, effect: Effect) -> Box3D | None:
        """The mark that the box stands for; None if there is no box."""
        if self._box is None:
            return None
        low, high = self._upright(up).to_scene(self._box.ends)
        return Box3D(point_of(low), point_of(high), "up", effect)

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

    def viewpoint(self, client: Any) -> Viewpoint:
        """Return where a tab looks from."""
        return viewpoint_of(client.camera, self.frame)

    def _upright(self, up: Float64Array) -> Frame:
        """Return the viewer's coordinates for points of the scene that are turned so that up is z."""
        return Frame(up_frame(up) @ self.frame.centre, self.frame.scale)

    def _place(self, point: Point) -> Point:
        return point_of(self.frame.to_viewer(np.array(point)))

    def _show_frustum(self, name: str, view: TrimmedView, size: float) -> None:
        camera = view.view.camera
        self._server.scene.add_camera_frustum(
            name,
            fov=float(2 * np.arctan(camera.height / 2 / camera.K[1, 1])),
            aspect=camera.width / camera.height,
            scale=size,
            color=_REJECTED_COLOUR if view.rejected else _ACCEPTED_COLOUR,
            image=draw_outlines(view)[..., ::-1],
            format="jpeg",
            wxyz=quaternions_of(camera.rotation.T[None])[0],
            position=self._place(point_of(camera.centre)),
            cast_shadow=False,
        )


NODE = "/box3d"
"""Name of all that is shown of it in viser's scene."""
_EDGE_PIXELS, _EDGE_COLOUR = 2.0, (255, 170, 40)
_ARROW_PIXELS, _SQUARE_PIXELS = 45.0, 90.0
_LEAST_SIDE = 1e-3
"""Sides at least, in the viewer's units, so that no face passes the opposite one."""
_EDGES = np.array([[corner, corner | bit] for bit in (1, 2, 4) for corner in range(8) if not corner & bit])
"""Corners of a box that an edge joins, (12, 2); the bits of a corner's number are its sides in x, y and z."""
_SIDES = np.array([[corner >> axis & 1 for axis in range(3)] for corner in range(8)])
"""At which end of each axis the corners lie, 0 or 1, (8, 3)."""
_OUTWARD = np.stack([sign * np.roll(np.eye(3), -axis, axis=0) for axis in range(3) for sign in (-1.0, 1.0)])
"""Axes, as rows, of the arrow on each face, the first of which points outward, (6, 3, 3)."""
_OUTWARD[::2, 2] *= -1  # right-handed again


class SpaceBox:
    """A box that is shown, with its handles."""

    def __init__(self, scene: Any, ends: Float64Array, axes: Float64Array) -> None:
        """Show a box.

        Args:
            scene: viser's.
            ends: its lowest and its highest corner along its axes, (2, 3).
            axes: its axes as rows, (3, 3).
        """
        self.ends = ends
        scene.add_frame(NODE, show_axes=False, wxyz=quaternions_of(axes.T[None])[0])
        self._edges = scene.add_line_segments(
            f"{NODE}/edges", self._lines(), _EDGE_COLOUR, thickness=_EDGE_PIXELS, thickness_units="screen"
        )
        look = {"fixed": True, "disable_rotations": True}
        self._middle = scene.add_transform_controls(f"{NODE}/middle", _SQUARE_PIXELS, disable_axes=True, **look)
        self._faces = [
            scene.add_transform_controls(
                f"{NODE}/face{number}",
                _ARROW_PIXELS,
                active_axes=(True, False, False),
                disable_sliders=True,
                wxyz=quaternions_of(outward.T[None])[0],
                **look,
            )
            for number, outward in enumerate(_OUTWARD)
        ]
        self._draw()
        self._middle.on_update(self._moved)
        for number, face in enumerate(self._faces):
            face.on_update(partial(self._dragged, number))

    def drag_face(self, number: int, place: Float64Array) -> None:
        """Move one face to a place, along its normal; the opposite one stays."""
        axis, end = divmod(number, 2)
        opposite = self.ends[1 - end, axis]
        low, high = (opposite + _LEAST_SIDE, np.inf) if end else (-np.inf, opposite - _LEAST_SIDE)
        self.ends[end, axis] = np.clip(place[axis], low, high)
        self._draw(but=number)

    async def _moved(self, event: Any) -> None:  # not in a pool of threads, so that places stay in order
        self.ends += event.target.position - self.ends.mean(axis=0)
        self._draw()

    async def _dragged(self, number: int, event: Any) -> None:
        self.drag_face(number, event.target.position)

    def _draw(self, but: int | None = None) -> None:
        """Bring lines and handles, but the one that is being dragged, to where they belong."""
        self._edges.points = self._lines()
        middle = self.ends.mean(axis=0)
        self._middle.position = middle
        for number, face in enumerate(self._faces):
            axis, end = divmod(number, 2)
            if number != but:
                face.position = np.where(np.arange(3) == axis, self.ends[end], middle)

    def _lines(self) -> FloatArray:
        """Ends of the edges, (12, 2, 3)."""
        return np.asarray(self.ends[_SIDES, np.arange(3)][_EDGES], np.float32)

"""The box in space: an upright wire box whose faces are dragged by arrows, and which is moved by squares at its middle.

All is in the viewer's coordinates. A box with faces would hide the splats behind it, however transparent it is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from gaussian_trimmer.gaussians import Float64Array, FloatArray, quaternions_of
from gaussian_trimmer.selecting.marks import Point, point_of

_EDGE_PIXELS, _EDGE_COLOUR = 2.0, (255, 170, 40)
_ARROW_PIXELS, _SQUARE_PIXELS = 45.0, 90.0
_LEAST_SIDE = 1e-3
"""Sides at least, in the viewer's units, so that no face passes the opposite one."""
_EDGES = np.array([[corner, corner | bit] for bit in (1, 2, 4) for corner in range(8) if not corner & bit])
"""Corners of a box that an edge joins, (12, 2); the bits of a corner's number are its sides in x, y and z."""
_CORNERS = np.array([[(corner >> axis & 1) - 0.5 for axis in range(3)] for corner in range(8)])
"""Corners of a box of side one around the origin, (8, 3)."""
_OUTWARD = np.stack([sign * np.roll(np.eye(3), -axis, axis=0) for axis in range(3) for sign in (-1.0, 1.0)])
"""Axes, as rows, of the arrow on each face, the first of which points outward, (6, 3, 3)."""
_OUTWARD[::2, 2] *= -1  # right-handed again


class SpaceBox:
    """A box that is shown, with its handles."""

    def __init__(self, scene: Any, centre: Float64Array, size: Float64Array, axes: Float64Array) -> None:
        """Show a box.

        Args:
            scene: viser's.
            centre: its middle.
            size: lengths of its sides along its axes.
            axes: its axes as rows, (3, 3).
        """
        self.centre, self.size, self._axes = centre, size, axes
        self._edges = scene.add_line_segments(
            "/box3d/edges", self._lines(), _EDGE_COLOUR, thickness=_EDGE_PIXELS, thickness_units="screen"
        )
        look = {"fixed": True, "disable_rotations": True}
        self._middle = scene.add_transform_controls(
            "/box3d/middle",
            scale=_SQUARE_PIXELS,
            disable_axes=True,
            wxyz=quaternions_of(axes.T[None])[0],
            position=point_of(centre),
            **look,
        )
        self._faces = [
            scene.add_transform_controls(
                f"/box3d/face{number}",
                scale=_ARROW_PIXELS,
                active_axes=(True, False, False),
                disable_sliders=True,
                wxyz=quaternions_of((outward @ axes).T[None])[0],
                position=point_of(self._face_centre(number)),
                **look,
            )
            for number, outward in enumerate(_OUTWARD)
        ]
        self._middle.on_update(self._moved)
        for number, face in enumerate(self._faces):
            face.on_update(self._dragger(number))

    def remove(self) -> None:
        """Take the box away."""
        for handle in (*self._faces, self._middle, self._edges):
            handle.remove()

    def drag_face(self, number: int, place: Point) -> None:
        """Move one face to a place, along its normal; the opposite one stays."""
        axis, sign = number // 2, 2 * (number % 2) - 1
        out = sign * float((np.array(place) - self.centre) @ self._axes[axis])
        side = max(out + self.size[axis] / 2, _LEAST_SIDE)
        self.centre = self.centre + sign * (side - self.size[axis]) / 2 * self._axes[axis]
        self.size = np.where(np.arange(3) == axis, side, self.size)
        self._draw(but=number)

    async def _moved(self, event: Any) -> None:  # not in a pool of threads, so that places stay in order
        self.centre = np.array(event.target.position, np.float64)
        self._draw()

    def _dragger(self, number: int) -> Callable[[Any], Any]:
        async def dragged(event: Any) -> None:
            self.drag_face(number, point_of(np.array(event.target.position)))

        return dragged

    def _draw(self, but: int | None = None) -> None:
        """Bring lines and handles, but the one that is being dragged, to where they belong."""
        self._edges.points = self._lines()
        self._middle.position = point_of(self.centre)
        for number, face in enumerate(self._faces):
            if number != but:
                face.position = point_of(self._face_centre(number))

    def _lines(self) -> FloatArray:
        """Ends of the edges, (12, 2, 3)."""
        return np.asarray((self.centre + (_CORNERS * self.size) @ self._axes)[_EDGES], np.float32)

    def _face_centre(self, number: int) -> Float64Array:
        return np.asarray(self.centre + (2 * (number % 2) - 1) * self.size[number // 2] / 2 * self._axes[number // 2])

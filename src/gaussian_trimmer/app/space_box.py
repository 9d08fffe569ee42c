"""The box in space: an upright wire box whose faces are dragged by arrows, and which is moved by squares at its middle.

All is in the viewer's coordinates, turned to the box's axes. A box with faces would hide the splats behind it, however
transparent it is.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from gaussian_trimmer.gaussians import Float64Array, FloatArray, quaternions_of

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

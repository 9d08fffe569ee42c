"""What all tabs see in their 3D views: splats, virtual cameras, the up vector, clicked points, and a box."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from itertools import count
from threading import Lock
from typing import Any

import cv2
import numpy as np

from gaussian_trimmer.app.display import Layer, Painter, States, changes_as_bytes
from gaussian_trimmer.app.page import Drag, Page, Tab
from gaussian_trimmer.app.snapshots import Snapshot
from gaussian_trimmer.app.viewpoints import Frame, first_look, viewpoint_of
from gaussian_trimmer.cameras import Camera, Point, Viewpoint, point_of, up_frame
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Float64Array
from gaussian_trimmer.geometry.bounds import robust_bounds
from gaussian_trimmer.output.pictures import draw_outlines
from gaussian_trimmer.selecting.marks import Box3D, Effect
from gaussian_trimmer.trimming.result import TrimResult

_FRUSTUM_RADII = 0.3
"""Size of a virtual camera, relative to the object's radius."""
_JPEG_QUALITY = 85


class SceneView:
    """The 3D view that all tabs share. Points and sizes are given in the scene's coordinates."""

    def __init__(self, page: Page, most: int) -> None:
        """Show what there is in a page's tabs, of large scenes about so many Gaussians at most."""
        self._page, self._most = page, most
        self.painter: Painter | None = None
        self._told: tuple[States, list[Layer]] | None = None
        self._numbers = count(time.time_ns() // 1_000_000)  # others than before the program was started again
        self._scene = 0
        self._views: list[bytes] = []
        self._box: Drag | None = None
        self._standing: tuple[object, Point | None] = (None, None)
        self.start: tuple[Point, Point] = ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        """From where the scene was looked at first, and at which point."""
        self._lock = Lock()
        page.dragged_box, page.came = self._dragged, self._show_to

    @property
    def frame(self) -> Frame:
        """The viewer's coordinates."""
        return self.painter.packing.frame if self.painter else Frame(np.zeros(3), 1.0)

    def open(self, now: Snapshot) -> None:
        """Show another scene, or the same one turned, from its first view; tabs that are there look from it, too."""
        scene, up = now.document.scene, now.up.direction
        self.start = first_look(scene, now.document.cameras, up)
        if self.painter is None or self.painter.scene is not scene:
            self.painter, self._told, self._scene = Painter(scene), None, next(self._numbers)
        packing, looks = self.painter.packing, [self._place(point) for point in self.start]
        shown = packing.shown(self._most)
        facts = {"count": len(scene), "shown": shown, "covered": packing.covered}
        facts |= {"tones": packing.tones, "harmonics": packing.harmonics}
        self.show_up(up)
        self._page.show(drawn={"number": self._scene, **facts}, start=[next(self._numbers), *looks])

    def portions(self, scene: int) -> Iterator[bytes]:
        """Yield what a tab draws of a scene with a number; nothing of an earlier one."""
        if self.painter is not None and scene == self._scene:
            yield from self.painter.packing.portions(self.painter.scene, self._most)

    def layer(self, number: int) -> bytes | None:
        """Return what a tab draws of a layer; None if it is not shown any more."""
        painter, told = self.painter, self._told
        found = next((layer for layer in told[1] if layer.number == number), None) if told else None
        return painter.packing.pack(found.gaussians) if painter and found else None

    def picture(self, number: int) -> bytes | None:
        """Return what a virtual camera saw, as JPEG."""
        return self._views[number] if number < len(self._views) else None

    def show(self, now: Snapshot) -> None:
        """Tell all tabs how a state of the scene differs from the one before."""
        if self.painter is None or self.painter.scene is not now.document.scene:
            self.open(now)
        assert self.painter is not None, "it is of the scene"
        states = self.painter.states(now)
        with self._lock:
            before, self._told = self._told, (states, self.painter.layers(now, states))
            change = changes_as_bytes(before and before[0], *self._told, self.painter.packing.order)
            for tab in self._page.tabs:
                tab.send(change)
        moved = [part.moved and asdict(self.frame.moved(part.moved)) for part in now.objects]
        axes = [point_of(axis) for axis in up_frame(now.up.direction)]
        self._page.show(placing={"foot": self._foot(now), "axes": axes, "moved": moved})

    def _foot(self, now: Snapshot) -> Point | None:
        """Return the middle of the active object's foot, around which it is turned; None if there is none."""
        selected = now.object.selected
        if self._standing[0] is not selected:
            found = now.document.scene.select(np.flatnonzero(selected.mask))
            bounds = robust_bounds(found, up_frame(now.up.direction)) if len(found) else None
            foot = bounds.centre - bounds.half_extents[2] * bounds.axes[2] if bounds else None
            self._standing = selected, None if foot is None else self._place(point_of(foot))
        return self._standing[1]

    def _show_to(self, tab: Tab) -> None:
        with self._lock:
            if self._told is not None and self.painter is not None:
                tab.send(changes_as_bytes(None, *self._told, self.painter.packing.order))

    def rows(self, bits: bytes) -> BoolArray:
        """Return which Gaussians of the scene a tab means by bits in its own order, (N,).

        Raises:
            InputError: the bits are of another scene.
        """
        order = self.painter.packing.order if self.painter else np.zeros(0, np.int64)
        if len(bits) != (len(order) + 7) // 8:
            raise InputError("This was drawn over another scene.")
        mask = np.zeros(len(order), np.bool_)
        mask[order] = np.unpackbits(np.frombuffer(bits, np.uint8), count=len(order), bitorder="little")
        return mask

    def show_up(self, up: Float64Array) -> None:
        """Turn the view of all tabs so that up is up."""
        self._page.show(upwards=point_of(up))

    def show_views(self, result: TrimResult | None) -> None:
        """Show the virtual cameras of a trim with what they saw and its masks, or none."""
        shown, self._views = [], []
        if result is not None:
            size = _FRUSTUM_RADII * result.objects[0].bounds.radius
            for view in result.objects[0].views:
                done, data = cv2.imencode(".jpg", draw_outlines(view), [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
                assert done, "OpenCV writes JPEG"
                self._views.append(data.tobytes())
                places = [self._place(point_of(point)) for point in _frustum(view.view.camera, size)]
                shown.append({"places": places, "rejected": view.rejected or ""})
        self._page.show(frusta=shown)

    def show_points(self, points: Sequence[Point]) -> None:
        """Show points that were clicked."""
        self._page.show(points=[self._place(point) for point in points])

    def show_box(self, ends: Float64Array, up: Float64Array) -> None:
        """Show a box with handles; its ends are corners (2, 3) in coordinates in which up is z."""
        low, high = self._upright(up).to_viewer(ends)
        self._show_drag(Drag(point_of(low), point_of(high)), up)

    def hide_box(self) -> None:
        """Take the box away."""
        self._box = None
        self._page.show(box=None)

    def box_mark(self, up: Float64Array, effect: Effect) -> Box3D | None:
        """The mark that the box stands for; None if there is no box."""
        if self._box is None:
            return None
        low, high = self._upright(up).to_scene(np.array([self._box.low, self._box.high]))
        return Box3D(point_of(low), point_of(high), "up", effect)

    def look(self, client: Tab | None, eye: Point, target: Point) -> None:
        """Let one tab look from one point at another."""
        if client is not None:
            client.send({"look": [self._place(eye), self._place(target)]})

    def viewpoint(self, client: Tab) -> Viewpoint:
        """Return where a tab looks from.

        Raises:
            InputError: it has not said so.
        """
        if client is None or client.view is None:
            raise InputError("The picture is not there yet.")
        return viewpoint_of(client.view, self.frame)

    def _show_drag(self, drag: Drag, up: Float64Array) -> None:
        self._box = drag
        self._page.show(box={"low": drag.low, "high": drag.high, "axes": [point_of(axis) for axis in up_frame(up)]})

    def _dragged(self, drag: Drag) -> None:
        if self._box is not None and all(low < high for low, high in zip(drag.low, drag.high, strict=True)):
            self._box = drag

    def _upright(self, up: Float64Array) -> Frame:
        """Return the viewer's coordinates for points of the scene that are turned so that up is z."""
        return Frame(up_frame(up) @ self.frame.centre, self.frame.scale)

    def _place(self, point: Point) -> Point:
        return point_of(self.frame.to_viewer(np.array(point)))


def _frustum(camera: Camera, size: float) -> list[Any]:
    """Return a camera's centre and the corners of its picture at a distance, (5, 3)."""
    corners = np.array([(0, 0), (camera.width, 0), (camera.width, camera.height), (0, camera.height)], np.float64)
    return [camera.centre, *(camera.centre + size * camera.ray_directions(corners))]

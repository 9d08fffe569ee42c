"""The tools that mark in the 3D view: clicks, boxes, a box in space, a brush, and three points for the up vector."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np

from gaussian_trimmer.app.panels import BOX, BOX3D, BRUSH, CLICK, EFFECTS, POINTS, Panels
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.viewpoints import BrowserCamera, box_at, pixel_at, surface_points
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selecting.marks import Box, Click, Effect, Mark, Point, Sphere, Viewpoint

Do = Callable[[str, Callable[[], str], Any], None]
"""Has something done in the worker's thread; takes its name, the work, and the tab that asked for it."""

_MODIFIERS: dict[str | None, Effect | None] = {
    None: None, "shift": "add", "cmd/ctrl": "remove", "cmd/ctrl+shift": "intersect",
}  # fmt: skip
"""What keys that are held make of a mark; None: what the panel says."""
_DABS_APART = 0.5
"""Distance of a stroke's balls, in their radius."""
_MOST_DABS = 500
"""Number of balls of a stroke at most."""
_BOX_ENDS = (0.02, 0.98)
"""Quantiles of the selection between which the box in space begins."""


class Tools:
    """Listens to the 3D view for the tool that is chosen, and makes marks of what is done there."""

    def __init__(self, server: Any, session: Session, panels: Panels, view: SceneView, do: Do) -> None:
        self._server, self._session, self._panels, self._view, self._do = server, session, panels, view, do
        self._corners: list[Point] = []
        self._stroke: list[Point] = []
        self._path: list[tuple[Viewpoint, Sequence[float]]] = []
        panels.tool.on_update(lambda event: self._changed(event.client))
        panels.three_points.on_click(lambda event: self.choose(POINTS))
        panels.box_size.on_update(lambda event: view.resize_box(panels.box_size.value))
        panels.box_apply.on_click(lambda event: self._apply_box(event.client))

    def choose(self, tool: str) -> None:
        """Take another tool."""
        if self._panels.tool.value == tool:
            self._changed(None)
        else:
            self._panels.tool.value = tool  # which tells the function above

    def viewpoint(self, client: Any) -> Viewpoint:
        """Where a tab looks from."""
        camera = client.camera
        return BrowserCamera(
            np.asarray(camera.position, np.float64), np.asarray(camera.wxyz, np.float64), float(camera.fov),
            int(camera.image_width), int(camera.image_height), float(camera.near),
        ).viewpoint(self._view.frame)  # fmt: skip

    def _changed(self, client: Any) -> None:
        tool = self._panels.tool.value
        self._panels.show_tool(tool)
        self._do(tool, lambda: self._begin(tool), client)

    def _begin(self, tool: str) -> str:
        """Listen for the clicks or boxes of a tool, and show what belongs to it."""
        self._corners, scene = [], self._server.scene
        scene.remove_click_callback()
        scene.remove_rect_select_callback()
        for modifier in _MODIFIERS:
            if tool in (CLICK, BRUSH, POINTS):
                scene.on_click(modifier=modifier)(self._clicked)
            elif tool == BOX:
                scene.on_rect_select(modifier=modifier)(self._boxed)
        self._view.show_points([])
        if tool != BRUSH:
            self._view.hide_ball()
        if tool != BOX3D:
            self._view.hide_box()
            return "Click three points of the ground." if tool == POINTS else self._panels.status_text
        now, means = self._session.now, self._session.document.scene.means
        mask = now.object.selected.mask
        low, high = np.quantile(means[mask] if mask.any() else means, _BOX_ENDS, axis=0)
        size = float(np.linalg.norm(high - low)) / (1.5 if mask.any() else 4)
        x, y, z = ((low + high) / 2).tolist()
        self._panels.box_size.value = (size, size, size)
        self._view.show_box((x, y, z), (size, size, size), now.up.direction)
        return self._panels.status_text

    def _effect(self, modifier: str | None) -> Effect:
        return _MODIFIERS.get(modifier) or cast("Effect", EFFECTS[self._panels.effect.value])

    def _clicked(self, event: Any) -> None:
        effect, place, view = self._effect(event.modifier), event.screen_pos, self.viewpoint(event.client)
        work = {CLICK: self._click, BRUSH: self._dab, POINTS: self._corner}.get(self._panels.tool.value)
        if work is not None:
            self._do("Marking", lambda: work(view, place, effect), event.client)

    def _boxed(self, event: Any) -> None:
        view, effect = self.viewpoint(event.client), self._effect(event.modifier)

        def work() -> str:
            return self._mark(Box(*box_at(view, event.screen_min, event.screen_max), view, effect))

        self._do("Marking", work, event.client)

    def _click(self, view: Viewpoint, place: Sequence[float], effect: Effect) -> str:
        return self._mark(Click(*pixel_at(view, place), view, effect))

    def _dab(self, view: Viewpoint, place: Sequence[float], effect: Effect) -> str:
        point = self._surface_point(view, place)
        self._view.show_ball(point, self._radius, self._dragged)
        return self._mark(Sphere(point, self._radius, effect=effect))

    def _corner(self, view: Viewpoint, place: Sequence[float], effect: Effect) -> str:
        self._corners.append(self._surface_point(view, place))
        self._view.show_points(self._corners)
        if len(self._corners) < 3:
            return f"{3 - len(self._corners)} more on the ground."
        corners, self._corners = self._corners, []
        x, y, z = view.camera.centre.tolist()
        try:
            up = self._session.up_from_points(corners, (x, y, z))
        finally:
            self._view.show_points([])
        return f"Up is {' '.join(f'{value:.3f}' for value in up.direction)}."

    def _dragged(self, event: Any) -> None:
        """Collect where the brush is dragged; it paints, as one step, once it is let go."""
        if event.phase == "start":
            self._path = []
        self._path.append((self.viewpoint(event.client), event.end_screen_pos))
        if event.phase == "end":
            path, effect = self._path, self._effect(event.modifier)
            self._do("Marking", lambda: self._paint(path, effect), event.client)

    def _paint(self, path: Sequence[tuple[Viewpoint, Sequence[float]]], effect: Effect) -> str:
        """Mark along a path over the surface."""
        document, view = self._session.document, path[0][0]
        found = surface_points(document.scene, view, [place for _, place in path], document.renderer)
        stroke: list[Point] = []
        for point in found:
            far = _DABS_APART * self._radius
            if point is not None and (not stroke or np.linalg.norm(np.subtract(point, stroke[-1])) > far):
                stroke.append(point)
        if not stroke:
            raise InputError("The brush touched nothing.")
        if len(stroke) > _MOST_DABS:
            raise InputError("This stroke is too long for so small a brush; paint it in parts.")
        self._view.move_ball(stroke[-1])
        return self._mark(*(Sphere(point, self._radius, effect=effect) for point in stroke))

    def _apply_box(self, client: Any) -> None:
        def work() -> str:
            up = self._session.now.up.direction
            mark = self._view.box_mark(self._panels.box_size.value, up, self._effect(None))
            if mark is None:
                raise InputError("There is no box; choose the tool '3D box' first.")
            return self._mark(mark)

        self._do("Marking", work, client)

    def _mark(self, *marks: Mark) -> str:
        way = self._session.mark(*marks)
        self._panels.when.value = "Before"  # a mark makes a trim out of date
        return f"{self._session.now.object.n_selected:,} Gaussians selected: {way}."

    def _surface_point(self, view: Viewpoint, place: Sequence[float]) -> Point:
        document = self._session.document
        (point,) = surface_points(document.scene, view, [place], document.renderer)
        if point is None:
            raise InputError("Nothing is seen there; click on a surface.")
        return point

    @property
    def _radius(self) -> float:
        return float(self._panels.brush.value / self._view.frame.scale)

"""The tools that mark in the 3D view: clicks, boxes, a box in space, a brush, and three points for the up vector."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np

from gaussian_trimmer.app.display import shown_rows
from gaussian_trimmer.app.documents import normal_of
from gaussian_trimmer.app.panels import BOX, BOX3D, BRUSH, CLICK, EFFECTS, LOOK, POINTS, TINT, Panels
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.viewpoints import before_what_shows, box_at, pixel_at, surface_points, viewpoint_of
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.geometry.bounds import up_frame
from gaussian_trimmer.selecting.marks import Box, Click, Effect, Mark, Point, Sphere, Viewpoint, point_of

Place = Sequence[float]
"""A place in the browser's picture, from (0, 0) at the upper left to (1, 1)."""
Do = Callable[[str, Callable[[], str], Any], None]
"""Has something done in the worker's thread; takes its name, the work, and the tab that asked for it."""

_MODIFIERS: dict[str | None, Effect | None] = {
    None: None,
    "shift": "add",
    "cmd/ctrl": "remove",
    "cmd/ctrl+shift": "intersect",
}
"""What keys that are held make of a mark; None: what the panel says."""
_SCREEN_MIDDLE = (0.5, 0.5)
_DABS_APART = 0.5
"""Distance of a stroke's balls, in their radius."""
_MOST_DABS = 500
"""Number of balls of a stroke at most."""
_BOX_PADDING = 0.05
"""What the box in space is larger at first than the selection, at each side, relative to its longest side."""
_BOX_SHARE = 0.4
"""Side of the box in space where nothing is selected, relative to its distance from the eye."""
_BOX_PROBES = 12
"""Places across a box in the picture at which it is asked what shows there."""


class Tools:
    """Listens to the 3D view for the tool that is chosen, and makes marks of what is done there."""

    def __init__(self, server: Any, session: Session, panels: Panels, view: SceneView, do: Do) -> None:
        self._server, self._session, self._panels, self._view, self._do = server, session, panels, view, do
        self._corners: list[Point] = []
        self._path: list[tuple[Viewpoint, Place]] = []
        panels.tool.on_click(lambda event: self.choose(panels.tool.value, event.client))
        panels.three_points.on_click(lambda event: self.choose(POINTS, event.client))
        panels.brush.on_update(lambda event: view.change_ball(radius=self._radius))
        panels.box_size.on_update(lambda event: view.resize_box(panels.box_size.value))
        panels.box_apply.on_click(lambda event: self._apply_box(event.client))

    def choose(self, tool: str, client: Any) -> None:
        """Take another tool."""
        self._panels.show_tool(tool)
        self._do(tool, lambda: self.begin(tool, client), client)

    def viewpoint(self, client: Any) -> Viewpoint:
        """Where a tab looks from."""
        return viewpoint_of(client.camera, self._view.frame)

    def begin(self, tool: str, client: Any) -> str:
        """Listen for the clicks or boxes of a tool, and show what belongs to it."""
        self._corners, scene = [], self._server.scene
        scene.remove_click_callback()
        scene.remove_rect_select_callback()
        self._view.show_points([])
        self._view.hide_ball()
        self._view.hide_box()
        if self._session.glance() is None:
            self._panels.show_tool(LOOK)
            raise InputError("Open a scene first.")
        for modifier in _MODIFIERS:
            if tool in (CLICK, BRUSH, POINTS):
                scene.on_click(modifier=modifier)(self._clicked)
            elif tool == BOX:
                scene.on_rect_select(modifier=modifier)(self._boxed)
        if tool == BRUSH:
            self._show_ball(client)
        elif tool == BOX3D:
            self._show_box(client)
        return "Click three points on the ground." if tool == POINTS else self._session.now.sentence

    def _show_ball(self, client: Any) -> None:
        """Show the brush in the middle of the picture, so that its size can be seen."""
        (point,) = self._surface_points(self.viewpoint(client), [_SCREEN_MIDDLE])
        if point is not None:
            self._view.show_ball(point, self._radius, self._dragged)

    def _show_box(self, client: Any) -> None:
        """Show a box around the selection or, if nothing is selected, around what is in the middle of the picture."""
        now, scene = self._session.now, self._session.document.scene
        turn, mask = up_frame(now.up.direction), now.object.selected.mask
        if mask.any():
            local = scene.means[mask].astype(np.float64) @ turn.T
            low, high = local.min(axis=0), local.max(axis=0)
            size = high - low + 2 * _BOX_PADDING * max(float((high - low).max()), 1e-6)
            centre = (low + high) / 2 @ turn
        else:
            view = self.viewpoint(client)
            (point,) = self._surface_points(view, [_SCREEN_MIDDLE])
            if point is None:
                raise InputError("Nothing is in the middle of the picture; turn towards the object, then choose again.")
            centre = np.array(point)
            size = np.full(3, _BOX_SHARE * float(np.linalg.norm(centre - view.camera.centre)))
        sides = point_of(size)
        self._panels.box_size.value = sides
        self._view.show_box(point_of(centre), sides, now.up.direction)

    def _effect(self, modifier: str | None) -> Effect:
        return _MODIFIERS.get(modifier) or cast("Effect", EFFECTS[self._panels.effect.value])

    def _clicked(self, event: Any) -> None:
        effect, place, view = self._effect(event.modifier), event.screen_pos, self.viewpoint(event.client)
        work = {CLICK: self._click, BRUSH: self._dab, POINTS: self._corner}.get(self._panels.tool.value)
        if work is not None:
            self._do("Marking", lambda: work(view, place, effect), event.client)

    def _boxed(self, event: Any) -> None:
        view, effect = self.viewpoint(event.client), self._effect(event.modifier)
        low, high = event.screen_min, event.screen_max

        def work() -> str:
            across, down = (np.linspace(low[axis], high[axis], _BOX_PROBES) for axis in (0, 1))
            places = [(float(x), float(y)) for x in across for y in down]
            return self._mark(Box(*box_at(view, low, high), self._past_hidden(view, places), effect))

        self._do("Marking", work, event.client)

    def _click(self, view: Viewpoint, place: Place, effect: Effect) -> str:
        return self._mark(Click(*pixel_at(view, place), self._past_hidden(view, [place]), effect))

    def _dab(self, view: Viewpoint, place: Place, effect: Effect) -> str:
        point = self._surface_point(view, place)
        self._view.show_ball(point, self._radius, self._dragged)
        return self._mark(Sphere(point, self._radius, effect=effect))

    def _corner(self, view: Viewpoint, place: Place, effect: Effect) -> str:
        self._corners.append(self._surface_point(view, place))
        self._view.show_points(self._corners)
        if len(self._corners) < 3:
            return f"{3 - len(self._corners)} more on the ground."
        corners, self._corners = self._corners, []
        self._view.show_points([])
        up = self._session.set_up(normal_of(corners, point_of(view.camera.centre)))
        self._panels.show_tool(LOOK)
        self.begin(LOOK, None)
        return f"Up is {' '.join(f'{value:.3f}' for value in up.direction)}."

    def _dragged(self, event: Any) -> None:
        """Collect where the brush is dragged; it paints, as one step, once it is let go."""
        if event.phase == "start":
            self._path = []
        self._path.append((self.viewpoint(event.client), event.end_screen_pos))
        if event.phase == "end":
            path, effect = self._path, self._effect(event.modifier)
            self._do("Marking", lambda: self._paint(path, effect), event.client)

    def _paint(self, path: Sequence[tuple[Viewpoint, Place]], effect: Effect) -> str:
        """Mark along a path over the surface."""
        stroke: list[Point] = []
        for point in self._surface_points(path[0][0], [place for _, place in path]):
            far = _DABS_APART * self._radius
            if point is not None and (not stroke or np.linalg.norm(np.subtract(point, stroke[-1])) > far):
                stroke.append(point)
        if not stroke:
            raise InputError("The brush touched nothing.")
        if len(stroke) > _MOST_DABS:
            raise InputError("This stroke is too long for so small a brush; paint it in parts.")
        self._view.change_ball(point=stroke[-1])
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
        sentence = self._session.mark(*marks)
        self._panels.when.value = "Before"  # a mark makes a trim out of date
        self._panels.overlays[TINT] = True
        return sentence

    def _shown(self) -> Gaussians:
        """The Gaussians of the scene that are to be seen."""
        now = self._session.now
        rows = shown_rows(now, self._panels.showing)
        return now.document.scene if rows.all() else now.document.scene.select(np.flatnonzero(rows))

    def _past_hidden(self, view: Viewpoint, places: Sequence[Place]) -> Viewpoint:
        """The view, or the view past what is hidden, if something is."""
        shown, document = self._shown(), self._session.document
        if shown is document.scene:
            return view
        return before_what_shows(shown, view, places, document.renderer)

    def _surface_points(self, view: Viewpoint, places: Sequence[Place]) -> list[Point | None]:
        return surface_points(self._shown(), view, places, self._session.document.renderer)

    def _surface_point(self, view: Viewpoint, place: Place) -> Point:
        (point,) = self._surface_points(view, [place])
        if point is None:
            raise InputError("Nothing is seen there; click on a surface.")
        return point

    @property
    def _radius(self) -> float:
        return float(self._panels.brush.value / self._view.frame.scale)

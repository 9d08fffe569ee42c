"""The tools that mark in the 3D view: clicks, boxes, lassos, a brush, a box in space, and points for the up vector."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from gaussian_trimmer.app import edits, panels
from gaussian_trimmer.app.display import markable_rows, shown_rows
from gaussian_trimmer.app.jobs import Jobs
from gaussian_trimmer.app.page import Gesture
from gaussian_trimmer.app.viewpoints import Event, Place, Showing, before_what_shows, pixel_at, points_at
from gaussian_trimmer.cameras import Point, Viewpoint, point_of, up_frame
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import SH_C0, FloatArray, Gaussians, IntArray, mask_of_rows
from gaussian_trimmer.rendering import top_contributors
from gaussian_trimmer.selecting.clicks import NothingFoundError
from gaussian_trimmer.selecting.marks import Box, Click, Effect, Grow, Mark, Rows, Shrink, Stroke
from gaussian_trimmer.selecting.shapes import in_spacings, in_spheres, shows_under, under_stroke
from gaussian_trimmer.surface.viewed_scene import CONTRIBUTORS, small_view
from gaussian_trimmer.views.view import HALF

_SCREEN_MIDDLE = (0.5, 0.5)
_GROWN_PIXELS = 8
"""How far a selection grows or shrinks, in pixels as it is seen."""
_BOX_PADDING = 0.05
"""What the box in space is larger at first than the selection, at each side, relative to its longest side."""
_BOX_SHARE = 0.2
"""Half a side of the box in space where nothing is selected, relative to its distance from the eye."""
_BOX_PROBES = 12
"""Places across a box in the picture at which it is asked what shows there."""
_BRUSH_STEP = 1.25
_LIKE = 0.1
"""How far a colour may be from the picked one in each channel, 0 to 1, unless a tolerance is chosen."""


class Tools:
    """Makes marks of what is done in the 3D view with the tool that is chosen."""

    def __init__(self, jobs: Jobs) -> None:
        self._session, self._panels, self._view, self._do = jobs.session, jobs.panels, jobs.view, jobs.do
        self._corners: list[Point] = []
        self._clicked: tuple[tuple[Mark, ...], float, Callable[[float], Mark]] | None = None
        """The marks after the last click, its tolerance, and what it is with another one; None after other marks."""

    def choose(self, tool: str, client: Any) -> None:
        """Take a tool. Only the box in space has to look at the scene, and waits for what is being done."""
        if self._session.glance() is None:
            self._panels.tool.value = panels.LOOK
            self._panels.say("Open a scene first.", wrong=True)
            return
        self._panels.tool.value = tool
        if tool == panels.BOX3D:
            self._do(tool, lambda: self.begin(client))
        else:
            self._panels.say(self.begin(client), quietly=True)

    def begin(self, client: Any) -> str:
        """Show what belongs to the tool that is chosen."""
        self._corners = []
        self._view.show_points([])
        self._view.hide_box()
        tool: str = self._panels.tool.value
        if tool == panels.BOX3D:
            self._show_box(client)
        now = self._session.glance()
        if tool in panels.PLACING and now is not None:
            self._panels.showing = Showing("Everything", "Selection" if now.object.result is None else "Cut-out", "Own")
        return panels.HINTS[tool]

    def resize_brush(self, client: Any, *, larger: bool) -> None:
        """Let the brush be larger or smaller by a step."""
        brush = self._panels.brush
        low, high = brush.facts["limits"]
        brush.value = round(min(max(brush.value * (_BRUSH_STEP if larger else 1 / _BRUSH_STEP), low), high))

    def heard(self, gesture: Gesture, client: Any) -> None:
        """Do what was meant by a gesture."""
        work: dict[str, Callable[[Viewpoint, Gesture], str]] = {
            panels.CLICK: self._click,
            panels.COLOUR: self._pick,
            panels.BOX: self._box,
            panels.POINTS: self._corner,
            **dict.fromkeys((panels.LASSO, panels.POLYGON, panels.BRUSH, panels.SPHERE), self._draw),
        }
        if gesture.places and gesture.tool in work and gesture.tool == self._panels.tool.value:
            self._panels.ghost = gesture.ghost
            view, event = self._view.viewpoint(client), None if gesture.tool == panels.POINTS else Event.MARKED
            self._do("Marking", lambda: work[gesture.tool](view, gesture), event)

    def change_selection(self, way: str, client: Any) -> None:
        """Let the selection grow or shrink, invert it, or select all."""

        def work() -> str:
            if way == "Invert":
                return self._session.do(edits.invert)
            if way == "All":
                return self._mark(Rows.of(self._shown_rows(), "all that is shown"))
            now, camera = self._session.now, self._view.viewpoint(client).camera
            means, mask = now.document.scene.means, now.object.selected.mask
            depths = np.abs(camera.to_camera(means[mask].astype(np.float64))[:, 2])
            depth = float(np.median(depths)) if mask.any() else 0.0
            step = in_spacings(_GROWN_PIXELS * depth / camera.K[1, 1], means, mask)
            return self._mark((Grow if way == "Grow" else Shrink)(step or 1.0))

        self._do(way, work, Event.MARKED)

    def _show_box(self, client: Any) -> None:
        """Show a box around the selection or, if nothing is selected, around what is in the middle of the picture."""
        now, scene = self._session.now, self._session.document.scene
        turn, mask = up_frame(now.up.direction), now.object.selected.mask
        if mask.any():
            local = scene.means[mask].astype(np.float64) @ turn.T
            padding = _BOX_PADDING * max(float(np.ptp(local, axis=0).max()), 1e-6)
        else:
            view = self._view.viewpoint(client)
            middle = np.array(self._surface_point(view, _SCREEN_MIDDLE))
            local, padding = middle[None] @ turn.T, _BOX_SHARE * float(np.linalg.norm(middle - view.camera.centre))
        self._view.show_box(np.stack([local.min(axis=0) - padding, local.max(axis=0) + padding]), now.up.direction)

    def _effect(self, asked: Effect | None) -> Effect:
        return asked or panels.EFFECTS[self._panels.effect.value]

    def _click(self, view: Viewpoint, gesture: Gesture) -> str:
        """Mark what was clicked on; without a key or another mode, go on with the object that has it.

        For a new object it is taken from the one that has it.
        """
        place, effect = gesture.places[0], self._effect(gesture.effect)
        self._surface_point(view, place)
        other = self._other_at(view, place)
        if other is not None and self._session.now.object.marks and gesture.effect is None and effect == "add":
            return self._session.do(edits.activate, other, joined=True)
        click = Click(*pixel_at(view, place), self._past_hidden(view, [place]), effect)
        return self._mark_with_tolerance(lambda tolerance: replace(click, tolerance=tolerance), gesture)

    def _pick(self, view: Viewpoint, gesture: Gesture) -> str:
        """Mark all that is shown in about the colour of what was clicked on."""
        rows, weights = self._at(view, gesture.places[0])
        if not len(rows):
            raise InputError("Nothing is seen there; click on a surface.")
        colours, effect, shown = self._session.document.scene.sh_dc, self._effect(gesture.effect), self._shown_rows()
        far = SH_C0 * np.abs(colours - np.average(colours[rows], axis=0, weights=weights)).max(axis=1)

        def like(tolerance: float) -> Mark:
            return Rows.of((far <= (tolerance or _LIKE)) & shown, "colour", effect)

        return self._mark_with_tolerance(like, gesture)

    def _mark_with_tolerance(self, make: Callable[[float], Mark], gesture: Gesture) -> str:
        """Make a mark that depends on the tolerance, so that another one can be tried."""
        tolerance = self._panels.tolerance.value / 100
        said = self._mark(make(tolerance), gesture)
        self._clicked = self._session.now.object.marks, tolerance, make
        return said

    def tolerate(self, client: Any) -> None:
        """Make the last click again with the tolerance that is chosen, if nothing was done after it."""

        def work() -> str | None:
            tolerance, clicked = self._panels.tolerance.value / 100, self._clicked
            if clicked is None or self._session.now.object.marks is not clicked[0] or clicked[1] == tolerance:
                return None
            self._session.undo()
            try:
                said = self._mark(clicked[2](tolerance))
                self._clicked = self._session.now.object.marks, tolerance, clicked[2]
                return said
            except InputError:
                self._session.redo()
                raise

        self._do("Marking", work, Event.MARKED)

    def _other_at(self, view: Viewpoint, place: Place) -> int | None:
        """Return the number of another object that has most of what shows at a place; None if none has."""
        now, (rows, weights) = self._session.now, self._at(view, place)
        for part in now.objects:
            if part is not now.object and weights[(part.mask & ~now.object.mask)[rows]].sum() > HALF * weights.sum():
                return part.id
        return None

    def _at(self, view: Viewpoint, place: Place) -> tuple[IntArray, FloatArray]:
        """Return rows of the scene that show at a place, and how much of it each is."""
        small = small_view(view.camera)
        found, weights = top_contributors(
            self._shown(), small, np.array([pixel_at(Viewpoint(small), place)]), CONTRIBUTORS
        )
        rows = np.flatnonzero(self._shown_rows())[found[0][weights[0] > 0]]
        return rows, weights[0][weights[0] > 0]

    def _box(self, view: Viewpoint, gesture: Gesture) -> str:
        """Mark the thing in a box while nothing is selected; otherwise, or where none is found, what shows in it."""
        low, high = (tuple(choose(values) for values in zip(*gesture.places, strict=True)) for choose in (min, max))
        if not self._session.now.object.n_selected:
            across, down = (np.linspace(low[axis], high[axis], _BOX_PROBES) for axis in (0, 1))
            places = [(float(x), float(y)) for x in across for y in down]
            with suppress(NothingFoundError):
                (x0, y0), (x1, y1) = (pixel_at(view, corner) for corner in (low, high))
                past, effect = self._past_hidden(view, places), self._effect(gesture.effect)
                return self._mark(Box(x0, y0, x1 + 1, y1 + 1, past, effect), gesture)
        corners = (low, (high[0], low[1]), high, (low[0], high[1]))
        return self._draw(view, replace(gesture, places=corners))

    def _draw(self, view: Viewpoint, gesture: Gesture) -> str:
        """Mark what was drawn over, among what is shown; of an object that is seen cut out, cut it off."""
        controls, now, effect = self._panels, self._session.now, self._effect(gesture.effect)
        sphere, radius = gesture.tool == panels.SPHERE, float(controls.brush.value)
        stroke = Stroke(view, gesture.places, radius if sphere or gesture.tool == panels.BRUSH else None)
        through, by_centres = controls.reach.value == panels.THROUGH, sphere or controls.taking.value == panels.CENTRES
        rows, gaussians = np.flatnonzero(self._shown_rows()), self._shown()
        cuts, showing = False, controls.showing
        if now.object.fresh is not None and (showing.part, showing.when, showing.ghost) == ("Object", "Cut-out", False):
            rows, gaussians = now.object.fresh.objects[0].source_index, now.object.fresh.object
            cuts = effect == "remove" and not through and not by_centres
        if gesture.rows is not None and by_centres:  # the page has found them as they were drawn
            taken = self._view.rows(gesture.rows)[rows]
        elif sphere:
            taken = in_spheres(gaussians, stroke)
        else:
            taken = under_stroke(gaussians, stroke, through=through, by_centres=by_centres)
        if not (taken.any() or (cuts and shows_under(gaussians, stroke))):
            raise InputError("Nothing that is shown is there; draw over what you see.")
        whole = np.setdiff1d(rows[taken], rows[~taken])  # all of its parts
        mask = mask_of_rows(whole, len(now.document.scene))
        settled = now.object.result is not None and showing.when == "Cut-out"
        cut = stroke if cuts else None
        return self._mark(Rows.of(mask, gesture.tool.lower(), effect, cut, settled=settled), gesture)

    def _corner(self, view: Viewpoint, gesture: Gesture) -> str:
        self._corners.append(self._surface_point(view, gesture.places[0]))
        self._view.show_points(self._corners)
        if len(self._corners) < 3:
            return f"{3 - len(self._corners)} more on the ground."
        corners, self._corners = self._corners, []
        said = self._session.do(edits.set_up, edits.normal_of(corners, point_of(view.camera.centre)))
        self._panels.tool.value = panels.LOOK
        self.begin(None)
        return said

    def apply_box(self, client: Any) -> None:
        """Mark what is in the box in space."""

        def work() -> str:
            up = self._session.now.up.direction
            mark = self._view.box_mark(up, self._effect(None))
            if mark is None:
                raise InputError("There is no box; choose the tool '3D box' first.")
            return self._mark(mark)

        self._do("Marking", work, Event.MARKED)

    def _mark(self, mark: Mark, gesture: Gesture | None = None) -> str:
        """Make a mark; what was drawn without a key replaces the selection where the mode says so."""
        anew = self._panels.effect.value == panels.ANEW and gesture is not None and gesture.effect is None
        among = markable_rows(self._session.now, self._panels.showing)
        sentence = self._session.do(edits.mark, mark, among=among, anew=anew)
        self._clicked = None
        if self._panels.effect.value == panels.KEEP_ONLY:  # else the next mark would keep nothing
            self._panels.effect.value = panels.ADD
        return sentence

    def _shown_rows(self) -> Any:
        return shown_rows(self._session.now, self._panels.showing)

    def _shown(self) -> Gaussians:
        """Return the Gaussians of the scene that are to be seen."""
        scene, rows = self._session.document.scene, self._shown_rows()
        return scene if rows.all() else scene.select(np.flatnonzero(rows))

    def _past_hidden(self, view: Viewpoint, places: Sequence[Place]) -> Viewpoint:
        """Return the view, past what is hidden if something is."""
        shown, document = self._shown(), self._session.document
        if shown is document.scene:
            return view
        return before_what_shows(shown, view, places)

    def _surface_point(self, view: Viewpoint, place: Place) -> Point:
        (point,) = points_at(self._shown(), view, [place])
        if np.isnan(point).any():
            middle = "in the middle of the picture; turn towards the object, then choose again"
            raise InputError(f"Nothing is seen {middle if place == _SCREEN_MIDDLE else 'there; click on a surface'}.")
        return point_of(point)

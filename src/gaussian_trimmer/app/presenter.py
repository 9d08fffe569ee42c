"""Brings the 3D view and the controls up to the present state, and does only what has changed."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.app.display import Painter
from gaussian_trimmer.app.gestures import GestureChannel
from gaussian_trimmer.app.panels import ARROW, BACKDROPS, VIEWS, WIPE, Panels
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.showing import Comparison, compared
from gaussian_trimmer.app.viewpoints import Frame
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError

_EYE_STEP, _EYE_TURN = 0.1, 0.1
"""How far an eye moves, in the viewer's units, or turns, in radians, before the scene is drawn anew for it."""


class Presenter:
    """Shows the state of a session. Used by the worker's thread alone."""

    def __init__(self, session: Session, panels: Panels, view: SceneView, channel: GestureChannel, most: int) -> None:
        self._session, self._panels, self._view, self._channel = session, panels, view, channel
        self._most = most
        self._painter: Painter | None = None
        self._eye: Camera | None = None
        self._shown: dict[str, object] = {}
        self.wipe: Comparison | None = None
        """The comparison that is going on."""
        self._has_still = False

    def refresh(self) -> None:
        """Show the present state, if a scene is open."""
        now = self._session.glance()
        if self._is_new("backdrop", self._panels.backdrop.value):
            self._view.show_backdrop(BACKDROPS[self._panels.backdrop.value])
        if now is None:
            return
        painter, overlays = self.painter(), self._panels.overlays
        showing = self.wipe.other if self.wipe is not None and self._has_still else self._panels.showing
        if self._is_new("splats", (now, showing, self._eye)):
            self._view.show(painter.paint(now, showing, self._eye))
        if self._is_new("up", now.up):
            self._view.show_up(now.up.direction)
        if self._is_new("arrow", (now.up, overlays[ARROW])):
            self._view.show_arrow(now.up.direction, overlays[ARROW])
        views = now.object.fresh if overlays[VIEWS] else None
        if self._is_new("views", views):
            self._view.show_views(views)
        if self._is_new("state", now):  # otherwise, what somebody is typing is kept
            self._panels.refresh(now)

    def begin_wipe(self) -> str:
        """Compare what is shown with another state, with a line to drag; return what is compared.

        The browser draws one state at a time. So the page takes a picture of what is shown, lays it over one side of
        the line, and answers; only then the 3D view shows the other state. They meet as long as the view rests.

        Raises:
            InputError: the object has not been cut out.
        """
        if self._session.now.object.cut.result is None:
            raise InputError("There is nothing to compare yet: cut the object out first.")
        self.wipe, self._has_still = compared(self._panels.showing), False
        self._panels.compare[WIPE] = True
        self._channel.compare(self.wipe)
        left, right = self.wipe.names
        return f"Left of the line: {left.lower()}; right: {right.lower()}. Drag it. Moving the view ends this."

    def show_other_state(self) -> None:
        """Show the other state of a comparison, now that the page has its picture."""
        self._has_still = True
        self.refresh()

    def end_wipe(self) -> None:
        """Show one state again."""
        if self.wipe is not None:
            self.wipe = None
            self._channel.compare(None)
        self._panels.compare[WIPE] = False

    def look_from(self, eye: Camera) -> None:
        """Show the scene as it looks from an eye, and what is near it in full, if that differs from what is shown."""
        if self._session.glance() is None or not self.painter().depends_on_eye:
            return
        last = self._eye
        if last is None or _differ(last, eye, self.painter().frame):
            self._eye = eye
            self.refresh()

    def painter(self) -> Painter:
        """Return what draws the open scene; made anew, with a view without tools, for another scene."""
        scene = self._session.document.scene
        if self._painter is None or self._painter.scene is not scene:
            self._painter, self._eye = Painter(scene, self._most), None
            self._view.frame = self._painter.frame
            self._view.hide_box()
            self._view.show_points([])
        return self._painter

    def _is_new(self, what: str, state: object) -> bool:
        """Tell whether something is not in this state yet; it is from now on."""
        if self._shown.get(what) == state:
            return False
        self._shown[what] = state
        return True


def _differ(one: Camera, other: Camera, frame: Frame) -> bool:
    """Tell whether two eyes are so far apart, or look so differently, that the scene looks different."""
    moved = float(np.linalg.norm(one.centre - other.centre)) * frame.scale
    return moved > _EYE_STEP or float(one.forward @ other.forward) < np.cos(_EYE_TURN)

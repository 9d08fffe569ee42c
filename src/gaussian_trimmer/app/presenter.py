"""Brings the 3D view and the controls up to the present state, and does only what has changed."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.app.display import Painter
from gaussian_trimmer.app.files import DOWNLOADS
from gaussian_trimmer.app.page import Page
from gaussian_trimmer.app.panels import BACKDROPS, Panels
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.showing import Showing, compared
from gaussian_trimmer.app.viewpoints import Frame
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError

_EYE_STEP, _EYE_TURN = 0.1, 0.1
"""How far an eye moves, in the viewer's units, or turns, in radians, before the scene is drawn anew for it."""


class Presenter:
    """Shows the state of a session. Used by the worker's thread alone."""

    def __init__(self, session: Session, panels: Panels, view: SceneView, page: Page, most: int) -> None:
        self._session, self._panels, self._view, self._page = session, panels, view, page
        self._most = most
        self._painter: Painter | None = None
        self._eye: Camera | None = None
        self._shown: dict[str, object] = {}
        self._other: Showing | None = None
        """What is seen while it is compared with what is shown."""

    def refresh(self) -> None:
        """Show the present state, if a scene is open."""
        now = self._session.glance()
        if self._is_new("backdrop", self._panels.backdrop.value):
            self._view.show_backdrop(BACKDROPS[self._panels.backdrop.value])
        if now is None:
            return
        painter, controls = self.painter(), self._panels
        showing = self._other or controls.showing
        if self._is_new("splats", (now, showing, self._eye)):
            self._view.show(painter.paint(now, showing, self._eye))
        if self._is_new("up", now.up):
            self._view.show_up(now.up.direction)
        views = now.object.fresh if controls.views.value else None
        if self._is_new("views", views):
            self._view.show_views(views)
        if self._is_new("state", now):  # otherwise, what somebody is typing is kept
            controls.refresh(now, self._idle())

    def compare(self, *, on: bool) -> None:
        """Show another state in place of what is shown, or no longer.

        Raises:
            InputError: the object has not been cut out.
        """
        if on and self._session.now.object.cut.result is None:
            raise InputError("There is nothing to compare yet: cut the object out first.")
        self._other, name = compared(self._panels.showing) if on else (None, "")
        self._page.show(compared=name)

    def look_from(self, eye: Camera) -> None:
        """Show the scene as it looks from an eye, and what is near it in full, if that differs from what is shown."""
        if self._session.glance() is None or not self.painter().depends_on_eye:
            return
        last = self._eye
        if last is None or _differ(last, eye, self.painter().frame):
            self._eye = eye
            self.refresh()

    def painter(self) -> Painter:
        """Return what draws the open scene; made anew for another scene."""
        scene = self._session.document.scene
        if self._painter is None or self._painter.scene is not scene:
            self._painter, self._eye = Painter(scene, self._most), None
            self._view.frame = self._painter.frame
        return self._painter

    def _idle(self) -> list[str]:
        """Return the actions that can do nothing in this state."""
        part, (back, forth) = self._session.now.object, self._session.can_step
        idle = {
            "Undo": not back,
            "Redo": not forth,
            **dict.fromkeys(("Cut out", "Grow", "Shrink", "Clear", "Look at the object"), not part.n_selected),
            **dict.fromkeys((*(f"Download: {what}" for what in DOWNLOADS), "Save in this folder"), part.fresh is None),
        }
        return [name for name, cannot in idle.items() if cannot]

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

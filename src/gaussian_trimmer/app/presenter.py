"""Brings the 3D view and the controls up to the present state, and does only what has changed."""

from __future__ import annotations

from gaussian_trimmer.app.display import Painter
from gaussian_trimmer.app.panels import ARROW, VIEWS, Panels
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Session


class Presenter:
    """Shows the state of a session. Used by the worker's thread alone."""

    def __init__(self, session: Session, panels: Panels, view: SceneView, most: int) -> None:
        self._session, self._panels, self._view, self._most = session, panels, view, most
        self._painter: Painter | None = None
        self._shown: dict[str, object] = {}

    def refresh(self) -> None:
        """Show the present state, if a scene is open."""
        now = self._session.glance()
        if now is None:
            return
        painter, showing, overlays = self.painter(), self._panels.showing, self._panels.overlays
        if self._is_new("splats", (now, showing)):
            self._view.show(painter.paint(now, showing))
        if self._is_new("up", now.up):
            self._view.show_up(now.up.direction)
        if self._is_new("arrow", (now.up, overlays[ARROW])):
            self._view.show_arrow(now.up.direction, overlays[ARROW])
        views = now.object.result if overlays[VIEWS] else None
        if self._is_new("views", views):
            self._view.show_views(views)
        if self._is_new("state", now):  # otherwise, what somebody is typing is kept
            self._panels.refresh(now)

    def painter(self) -> Painter:
        """What draws the open scene; made anew, with a view without tools, for another scene."""
        scene = self._session.document.scene
        if self._painter is None or self._painter.scene is not scene:
            self._painter = Painter(scene, self._most)
            self._view.frame = self._painter.frame
            self._view.hide_ball()
            self._view.hide_box()
            self._view.show_points([])
        return self._painter

    def _is_new(self, what: str, state: object) -> bool:
        """Whether something is not in this state yet; it is from now on."""
        if self._shown.get(what) == state:
            return False
        self._shown[what] = state
        return True

"""Brings the 3D view and the controls up to the present state, and does only what has changed."""

from __future__ import annotations

from gaussian_trimmer.app.display import Painter, Showing
from gaussian_trimmer.app.documents import Snapshot
from gaussian_trimmer.app.panels import ARROW, VIEWS, Panels
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.planning.up_vector import UpVector
from gaussian_trimmer.result import TrimResult


class Presenter:
    """Shows the state of a session. Used by the worker's thread alone."""

    def __init__(self, session: Session, panels: Panels, view: SceneView, most: int) -> None:
        self._session, self._panels, self._view, self._most = session, panels, view, most
        self._painter: Painter | None = None
        self._painted: tuple[Snapshot, Showing] | None = None
        self._listed: Snapshot | None = None
        self._up: UpVector | None = None
        self._arrow: tuple[UpVector, bool] | None = None
        self._views_of: TrimResult | None = None

    def refresh(self) -> None:
        """Show the present state, if a scene is open."""
        now = self._session.glance()
        if now is None:
            return
        painter, showing = self.painter(), self._panels.showing
        if self._painted != (now, showing):
            self._view.show(painter.paint(now, showing))
            self._painted = now, showing
        self._show_up(now.up)
        wanted = now.object.result if self._panels.overlays[VIEWS] else None
        if wanted is not self._views_of:
            self._view.show_views(wanted)
            self._views_of = wanted
        if now is not self._listed:  # otherwise, what somebody is typing is kept
            self._panels.refresh(now)
            self._listed = now

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

    def _show_up(self, up: UpVector) -> None:
        if self._up is not up:
            self._view.show_up(up.direction)
            self._up = up
        arrow = up, self._panels.overlays[ARROW]
        if self._arrow != arrow:
            self._view.show_arrow(up.direction, arrow[1])
            self._arrow = arrow

"""Brings the 3D view and the controls up to the present state, and does only what has changed."""

from __future__ import annotations

from typing import cast

from gaussian_trimmer.app.display import Painter, Part, Showing, When
from gaussian_trimmer.app.documents import Snapshot
from gaussian_trimmer.app.highlights import Highlights, find_highlights
from gaussian_trimmer.app.panels import PARTS, WHENS, Panels
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.result import TrimResult


class Presenter:
    """Shows the state of a session. Used by the worker's thread alone."""

    def __init__(self, session: Session, panels: Panels, view: SceneView, most: int) -> None:
        self._session, self._panels, self._view, self._most = session, panels, view, most
        self._painter: Painter | None = None
        self._painted: tuple[Snapshot, Showing] | None = None
        self._listed: Snapshot | None = None
        self._turned: tuple[object, bool] | None = None
        self._highlights: tuple[TrimResult, Highlights] | None = None
        self._views_of: TrimResult | None = None

    def refresh(self) -> None:
        """Show the present state, if a scene is open."""
        now = self._session.glance()
        if now is None:
            return
        painter, showing = self.painter(), self._showing()
        if self._painted != (now, showing):
            highlights = self._find_highlights(now) if showing.straddlers or showing.unchecked else None
            self._view.show(painter.paint(now, showing, highlights))
            self._painted = now, showing
        turned = now.up, self._panels.up_shown.value
        if self._turned != turned:
            self._view.show_up(now.up.direction, self._panels.up_shown.value)
            self._turned = turned
        wanted = now.object.result if self._panels.views.value else None
        if wanted is not self._views_of:
            self._view.show_views(wanted)
            self._views_of = wanted
        if now is not self._listed:  # what somebody is typing is kept otherwise
            self._panels.refresh(now)
            self._listed = now

    def painter(self) -> Painter:
        """What draws the open scene; made anew, with a view without tools, for another scene."""
        document = self._session.document
        if self._painter is None or self._painter.document is not document:
            self._painter = Painter(document, self._most)
            self._view.frame = self._painter.frame
            self._view.hide_ball()
            self._view.hide_box()
            self._view.show_points([])
        return self._painter

    def _showing(self) -> Showing:
        panels = self._panels
        return Showing(
            cast("Part", PARTS[panels.part.value]), cast("When", WHENS[panels.when.value]), panels.colours.value,
            panels.straddlers.value, panels.unchecked.value,
        )  # fmt: skip

    def _find_highlights(self, now: Snapshot) -> Highlights | None:
        result = now.object.result
        if result is None:
            return None
        if self._highlights is None or self._highlights[0] is not result:
            self._highlights = result, find_highlights(result)
        return self._highlights[1]

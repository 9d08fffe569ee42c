"""What happens when a control is used: the session does it in the worker's thread, and all tabs see what came of it."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from gaussian_trimmer.app import panels as controls
from gaussian_trimmer.app.display import Painter, Part, Showing, When
from gaussian_trimmer.app.documents import Snapshot
from gaussian_trimmer.app.highlights import Highlights, find_highlights
from gaussian_trimmer.app.panels import BOX, BOX3D, BRUSH, CLICK, EFFECTS, LOOK, PARTS, POINTS, WHENS, Panels
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Cancelled, Session
from gaussian_trimmer.app.viewpoints import BrowserCamera, box_at, pixel_at, surface_points
from gaussian_trimmer.app.worker import Worker
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.result import TrimResult
from gaussian_trimmer.selecting.marks import Box, Click, Effect, Point, Sphere, Viewpoint
from gaussian_trimmer.selecting.select import views_to_click_in

_MODIFIERS: dict[str | None, Effect | None] = {
    None: None, "shift": "add", "cmd/ctrl": "remove", "cmd/ctrl+shift": "intersect",
}  # fmt: skip
"""What keys that are held make of a mark; None: what the panel says."""
_STAGES = 12.0
"""About as many stages as a trim has, for the progress bar."""
_AXES: dict[str, Point] = {
    "+X": (1.0, 0.0, 0.0), "-X": (-1.0, 0.0, 0.0), "+Y": (0.0, 1.0, 0.0), "-Y": (0.0, -1.0, 0.0),
    "+Z": (0.0, 0.0, 1.0), "-Z": (0.0, 0.0, -1.0),
}  # fmt: skip
_STEP_OF_BRUSH = 1.25
_DABS_APART = 0.5
"""Distance of a stroke's balls, in their radius."""
_AWAY = 3.0
"""Distance from which an object is looked at, in its radius."""


class Controller:
    """Connects controls, session and 3D view. All that takes time is done in one worker's thread."""

    def __init__(self, server: Any, session: Session, most: int, path: str, camera_path: str) -> None:
        self._server, self._session, self._most = server, session, most
        self._panels = Panels(server.gui, path, camera_path)
        self._view = SceneView(server)
        self._painter: Painter | None = None
        self._painted: tuple[Snapshot, Showing] | None = None
        self._framed: tuple[Snapshot, bool] | None = None
        self._highlights: tuple[TrimResult, Highlights] | None = None
        self._views_of: TrimResult | None = None
        self._corners: list[Point] = []
        self._stroke: list[Point] = []
        self._worker = Worker(lambda name, error: traceback.print_exception(error))
        self._connect()

    def open(self, path: str, camera_path: str, client: Any = None) -> None:
        """Open a scene."""

        def work() -> str:
            if not path.strip():
                raise InputError("Give the path of a splat file first.")
            steps = iter(range(100))
            self._session.open(
                Path(path.strip()).expanduser(),
                Path(camera_path.strip()).expanduser() if camera_path.strip() else None,
                lambda stage: self._panels.busy(stage.capitalize(), next(steps) / 4),
            )
            self._panels.busy("Preparing the display", 0.75)
            document = self._session.document
            self._painter, self._painted, self._framed = Painter(document, self._most), None, None
            self._view.frame = self._painter.frame
            self._view.hide_ball()
            self._panels.when.value, self._panels.summary.content = "Before", ""
            self._panels.folder.value = str(Path("trimmed") / document.path.name.split(".")[0])
            self._look_from_camera()
            n, shown = len(document.scene), self._painter.shown
            thinned = f", {shown:,} of them shown" if shown < n else ""
            return f"{document.path.name}: {n:,} Gaussians{thinned}."

        self._do("Opening", work, client)

    def stop(self) -> None:
        """End the worker."""
        self._worker.stop()

    def _do(self, name: str, work: Callable[[], str], client: Any = None) -> None:
        """Have something done in the worker's thread, and show what comes of it."""

        def job() -> None:
            self._panels.busy(name, 0)
            text, wrong = "", True
            try:
                text, wrong = work(), False
            except InputError as error:
                text = str(error)
            except Cancelled:
                text = "Cancelled; everything is as it was."
            except MemoryError:
                text = "There is not enough memory for this; everything is as it was."
            except OSError as error:
                text = f"{error.strerror or error}: '{error.filename}'." if error.filename else f"{error}."
            except Exception as error:
                traceback.print_exc(file=sys.stderr)
                text = f"This is a defect of the program ({type(error).__name__}: {error}); everything is as it was."
            self._refresh()
            self._panels.busy("", 0)
            self._panels.say(text)
            if wrong:
                self._complain(text, client)

        self._worker.submit(name, job)

    def _complain(self, text: str, client: Any) -> None:
        """Show a message in the tab that it concerns, or in all."""
        for tab in [client] if client is not None else self._server.get_clients().values():
            tab.add_notification("Not done", text, color="red", auto_close_seconds=12.0)

    def _refresh(self) -> None:
        """Show the present state."""
        now = self._session.glance()
        if now is None or self._painter is None:
            return
        showing = self._showing()
        if self._painted is None or (now, showing) != self._painted:
            highlights = self._find_highlights(now) if showing.straddlers or showing.unchecked else None
            self._view.show(self._painter.paint(now, showing, highlights))
            self._painted = now, showing
        up = now, self._panels.up_shown.value
        if self._framed is None or self._framed[0].up is not now.up or self._framed[1] != up[1]:
            self._view.show_up(now.up.direction, up[1])
        self._framed = up
        wanted = now.object.result if self._panels.views.value else None
        if wanted is not self._views_of:
            self._view.show_views(wanted)
            self._views_of = wanted
        self._panels.refresh(now)

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

    def _connect(self) -> None:
        panels = self._panels
        panels.open.on_click(lambda event: self.open(panels.path.value, panels.camera_path.value, event.client))
        panels.cancel.on_click(lambda event: self._worker.cancel())
        panels.up.on_click(lambda event: self._set_up(panels.up.value, event.client))
        panels.three_points.on_click(lambda event: self._choose_tool(POINTS))
        panels.tool.on_update(lambda event: self._tool_changed(event.client))
        panels.box_size.on_update(lambda event: self._view.resize_box(panels.box_size.value))
        panels.box_apply.on_click(lambda event: self._apply_box(event.client))
        panels.history.on_click(lambda event: self._step(panels.history.value, event.client))
        panels.load.on_click(lambda event: self._load(event.client))
        panels.objects.on_click(lambda event: self._change_object(panels.objects.value, event.client))
        panels.active.on_update(lambda event: self._activate(event.client))
        panels.trim.on_click(lambda event: self._trim(event.client))
        panels.save.on_click(lambda event: self._save(event.client))
        panels.save_all.on_click(lambda event: self._save_all(event.client))
        for control in (
            panels.part, panels.when, panels.colours, panels.straddlers, panels.unchecked, panels.views,
            panels.up_shown,
        ):  # fmt: skip
            control.on_update(self._show_again)
        self._server.on_client_connect(self._welcome)
        self._add_keys()

    def _welcome(self, client: Any) -> None:
        """Tell a second tab that it is one."""
        if len(self._server.get_clients()) > 1:
            client.add_notification(
                "Open in several tabs", "All tabs show and change the same scene.", auto_close_seconds=8.0
            )  # fmt: skip

    def _show_again(self, event: Any) -> None:
        if event.client is not None:
            self._do("Showing", lambda: self._panels.status_text, event.client)

    # Tools

    def _choose_tool(self, tool: str) -> None:
        self._panels.tool.value = tool
        self._tool_changed(None)

    def _use_tool(self, tool: str, event: Any) -> None:
        self._choose_tool(tool)

    def _tool_changed(self, client: Any) -> None:
        """Listen for the clicks or boxes of the tool that was chosen, and show what belongs to it."""
        tool, scene = self._panels.tool.value, self._server.scene
        self._panels.show_tool(tool)
        self._corners = []
        scene.remove_click_callback()
        scene.remove_rect_select_callback()
        for modifier in _MODIFIERS:
            if tool in (CLICK, BRUSH, POINTS):
                scene.on_click(modifier=cast("Any", modifier))(self._clicked)
            elif tool == BOX:
                scene.on_rect_select(modifier=cast("Any", modifier))(self._boxed)
        self._do(tool, lambda: self._begin_tool(tool), client)

    def _begin_tool(self, tool: str) -> str:
        self._view.show_points([])
        if tool != BRUSH:
            self._view.hide_ball()
        if tool != BOX3D:
            self._view.hide_box()
        else:
            now, scene = self._session.now, self._session.document.scene
            mask = now.object.selected.mask
            low, high = np.quantile(scene.means[mask] if mask.any() else scene.means, (0.02, 0.98), axis=0)
            size = float(np.linalg.norm(high - low)) / (1.5 if mask.any() else 4)
            x, y, z = ((low + high) / 2).tolist()
            self._panels.box_size.value = (size, size, size)
            self._view.show_box((x, y, z), (size, size, size), now.up.direction)
        return self._panels.status_text

    def _effect(self, modifier: str | None) -> Effect:
        return _MODIFIERS.get(modifier) or cast("Effect", EFFECTS[self._panels.effect.value])

    def _clicked(self, event: Any) -> None:
        tool, effect, place = self._panels.tool.value, self._effect(event.modifier), event.screen_pos
        view = self._viewpoint(event.client)
        work = {CLICK: self._mark_click, BRUSH: self._mark_dab, POINTS: self._mark_corner}.get(tool)
        if work is not None:
            self._do("Marking", lambda: work(view, place, effect), event.client)

    def _mark_click(self, view: Viewpoint, place: Sequence[float], effect: Effect) -> str:
        x, y = pixel_at(view, place)
        self._before()
        return self._marked(self._session.mark(Click(x, y, view, effect)))

    def _boxed(self, event: Any) -> None:
        view, effect = self._viewpoint(event.client), self._effect(event.modifier)

        def work() -> str:
            box = box_at(view, event.screen_min, event.screen_max)
            self._before()
            return self._marked(self._session.mark(Box(*box, view, effect)))

        self._do("Marking", work, event.client)

    def _mark_dab(self, view: Viewpoint, place: Sequence[float], effect: Effect) -> str:
        point = self._surface_point(view, place)
        self._view.show_ball(point, self._brush_radius, self._dragged)
        self._before()
        return self._marked(self._session.mark(Sphere(point, self._brush_radius, effect=effect)))

    def _dragged(self, event: Any) -> None:
        """Collect the points along which the brush is dragged; they are one step once it is let go."""
        view, place = self._viewpoint(event.client), event.end_screen_pos
        if event.phase == "end":
            self._do("Marking", lambda: self._mark_stroke(self._effect(event.modifier)), event.client)
        elif event.phase == "start" or self._worker.doing == "":  # what comes too fast is left out
            self._worker.submit("brush", lambda: self._extend_stroke(view, place, event.phase == "start"))

    def _extend_stroke(self, view: Viewpoint, place: Sequence[float], begins: bool) -> None:
        document = self._session.document
        (point,) = surface_points(document.scene, view, [place], document.renderer)
        self._stroke = [] if begins else self._stroke
        if point is not None:
            self._view.move_ball(point)
            far = _DABS_APART * self._brush_radius
            if not self._stroke or np.linalg.norm(np.subtract(point, self._stroke[-1])) > far:
                self._stroke.append(point)

    def _mark_stroke(self, effect: Effect) -> str:
        stroke, self._stroke = self._stroke, []
        if not stroke:
            return self._panels.status_text
        self._before()
        return self._marked(self._session.mark(*(Sphere(point, self._brush_radius, effect=effect) for point in stroke)))

    def _mark_corner(self, view: Viewpoint, place: Sequence[float], effect: Effect) -> str:
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

    def _apply_box(self, client: Any) -> None:
        def work() -> str:
            up = self._session.now.up.direction
            mark = self._view.box_mark(self._panels.box_size.value, up, self._effect(None))
            if mark is None:
                raise InputError("There is no box; choose the tool '3D box' first.")
            self._before()
            return self._marked(self._session.mark(mark))

        self._do("Marking", work, client)

    def _surface_point(self, view: Viewpoint, place: Sequence[float]) -> Point:
        document = self._session.document
        (point,) = surface_points(document.scene, view, [place], document.renderer)
        if point is None:
            raise InputError("Nothing is seen there; click on a surface.")
        return point

    @property
    def _brush_radius(self) -> float:
        return float(self._panels.brush.value / self._view.frame.scale)

    def _before(self) -> None:
        """Show what is selected: a mark makes a trim out of date."""
        self._panels.when.value = "Before"

    def _marked(self, way: str) -> str:
        return f"{self._session.now.object.n_selected:,} Gaussians selected: {way}."

    def _viewpoint(self, client: Any) -> Viewpoint:
        camera = client.camera
        return BrowserCamera(
            np.asarray(camera.position, np.float64), np.asarray(camera.wxyz, np.float64), float(camera.fov),
            int(camera.image_width), int(camera.image_height), float(camera.near),
        ).viewpoint(self._view.frame)  # fmt: skip

    # Steps

    def _set_up(self, name: str, client: Any) -> None:
        def work() -> str:
            up = self._session.set_up(_AXES.get(name))
            return f"Up is {' '.join(f'{value:.3f}' for value in up.direction)} ({up.source})."

        self._do("Turning", work, client)

    def _step(self, name: str, client: Any) -> None:
        def work() -> str:
            if name == "Clear":
                self._session.clear()
                return "Cleared."
            done = self._session.undo() if name == "Undo" else self._session.redo()
            self._panels.when.value = "After" if self._session.now.object.result is not None else "Before"
            return f"{'Undone' if name == 'Undo' else 'Done again'}: {done}."

        self._do(name, work, client)

    def _load(self, client: Any) -> None:
        path = self._panels.selection_path.value.strip()

        def work() -> str:
            if not path:
                raise InputError("Give the path of a selection file first.")
            self._before()
            return self._marked(self._session.load(Path(path).expanduser()))

        self._do("Loading", work, client)

    def _change_object(self, name: str, client: Any) -> None:
        def work() -> str:
            if name == "New":
                return f"{self._session.add_object().name}: mark it."
            if name == "Delete":
                self._session.remove_object()
                return "Deleted."
            self._session.rename(self._panels.name.value)
            red, green, blue = self._panels.colour.value
            self._session.recolour((int(red), int(green), int(blue)))
            return "Applied."

        self._do(name, work, client)

    def _activate(self, client: Any) -> None:
        if client is None:
            return
        number = int(self._panels.active.value.partition(":")[0])

        def work() -> str:
            self._session.activate(number)
            return f"Marks go to {self._session.now.object.name}."

        self._do("Choosing", work, client)

    def _trim(self, client: Any) -> None:
        choices = self._panels.choices
        steps = iter(range(1000))

        def work() -> str:
            text = self._session.trim(
                choices, lambda stage: self._panels.busy(f"Trimming: {stage}", min(1.0, next(steps) / _STAGES)),
                self._worker.cancelled,
            )  # fmt: skip
            self._panels.when.value = "After"
            self._panels.summary.content = controls.escaped(text)
            return text

        self._do("Trimming", work, client)

    def _save(self, client: Any) -> None:
        folder, format, overwrite = self._target()

        def work() -> str:
            command = self._session.save(folder, format, overwrite=overwrite)
            self._panels.command.content = f"The same by command:\n\n```\n{command}\n```"
            return f"Saved in {folder.absolute()}."

        self._do("Saving", work, client)

    def _save_all(self, client: Any) -> None:
        folder, format, overwrite = self._target()

        def work() -> str:
            text = self._session.save_objects(
                folder, format, overwrite=overwrite, progress=lambda stage: self._panels.busy(f"Trimming {stage}", 0.5),
                cancelled=self._worker.cancelled,
            )  # fmt: skip
            return f"{text} saved in {folder.absolute()}."

        self._do("Saving", work, client)

    def _target(self) -> tuple[Path, str | None, bool]:
        panels = self._panels
        format = None if panels.format.value == controls.AS_SCENE else panels.format.value
        return Path(panels.folder.value.strip() or "trimmed").expanduser(), format, panels.overwrite.value

    # The view

    def _look_from_camera(self) -> None:
        """Let all tabs look from the first view of the scene."""
        document, up = self._session.document, self._session.now.up.direction
        camera = (
            document.cameras.cameras[0] if document.cameras is not None
            else views_to_click_in(document.scene, None, up)[0].camera
        )  # fmt: skip
        ahead = (document.scene.means - camera.centre) @ camera.forward
        depth = float(np.median(ahead[ahead > 0])) if (ahead > 0).any() else 1.0
        eye, target = camera.centre.tolist(), (camera.centre + depth * camera.forward).tolist()
        self._view.show_up(up, self._panels.up_shown.value)
        for client in (None, *self._server.get_clients().values()):
            self._view.look(client, (eye[0], eye[1], eye[2]), (target[0], target[1], target[2]), up)

    def _focus(self, client: Any) -> None:
        def work() -> str:
            now, scene = self._session.now, self._session.document.scene
            if not now.object.n_selected:
                raise InputError("Nothing is selected to look at.")
            points = scene.means[now.object.selected.mask].astype(np.float64)
            centre = np.median(points, axis=0)
            radius = float(np.quantile(np.linalg.norm(points - centre, axis=1), 0.9))
            backward = -self._viewpoint(client).camera.forward
            eye = (centre + _AWAY * max(radius, 1e-9) * backward).tolist()
            target = centre.tolist()
            self._view.look(
                client, (eye[0], eye[1], eye[2]), (target[0], target[1], target[2]), now.up.direction
            )  # fmt: skip
            return self._panels.status_text

        self._do("Looking", work, client)

    # Keys

    def _add_keys(self) -> None:
        """Bind keys, those of SuperSplat where it has a habit."""
        panels = self._panels
        for tool, key in ((LOOK, "escape"), (CLICK, "C"), (BOX, "R"), (BOX3D, "X"), (BRUSH, "B")):
            self._key(f"Tool: {tool}", key, None, partial(self._use_tool, tool))
        self._key("Undo", "Z", "cmd/ctrl", lambda event: self._step("Undo", event.client))
        self._key("Redo", "Z", "cmd/ctrl+shift", lambda event: self._step("Redo", event.client))
        self._key("Select nothing", "A", "cmd/ctrl+shift", lambda event: self._step("Clear", event.client))
        self._key("Trim", "T", None, lambda event: self._trim(event.client))
        self._key("Look at the selection", "F", None, lambda event: self._focus(event.client))
        self._key("Larger brush", "pageup", None, lambda event: self._grow_brush(_STEP_OF_BRUSH))
        self._key("Smaller brush", "pagedown", None, lambda event: self._grow_brush(1 / _STEP_OF_BRUSH))
        for part, key in zip(PARTS, "123", strict=True):
            self._key(f"Show: {part}", key, None, partial(self._show, panels.part, part))
        self._key(
            "Before / after", "space", None,
            lambda event: self._show(panels.when, "Before" if panels.when.value == "After" else "After", event),
        )  # fmt: skip

    def _key(self, label: str, key: str, modifier: str | None, act: Callable[[Any], None]) -> None:
        command = self._server.gui.add_command(label, hotkey=cast("Any", key), modifier=cast("Any", modifier))
        command.on_trigger(act)

    def _show(self, control: Any, value: str, event: Any) -> None:
        control.value = value
        self._show_again(event)

    def _grow_brush(self, factor: float) -> None:
        brush = self._panels.brush
        brush.value = min(max(brush.value * factor, brush.min), brush.max)

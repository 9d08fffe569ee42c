"""The keys: those of SuperSplat where it has a habit. Ctrl+K lists them, as the panel's last tab does."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from gaussian_trimmer.app import panels as controls

if TYPE_CHECKING:
    from gaussian_trimmer.app.controller import Controller

_TOOL_KEYS = {
    "escape": controls.LOOK,
    "C": controls.CLICK,
    "R": controls.BOX,
    "L": controls.LASSO,
    "P": controls.POLYGON,
    "B": controls.BRUSH,
    "X": controls.BOX3D,
}


def bind_keys(gui: Any, app: Controller) -> None:
    """Bind all keys."""

    def bind(label: str, key: str, act: Callable[[Any], None], modifier: str | None = None) -> None:
        command = gui.add_command(label, hotkey=key, modifier=modifier)
        command.on_trigger(lambda event: act(event.client))

    def bind_work(label: str, key: str, work: Callable[[], str], modifier: str | None = None) -> None:
        bind(label, key, lambda client: app.do(label, work, client), modifier)

    panels = app.panels
    for key, tool in _TOOL_KEYS.items():
        bind(f"Tool: {tool}", key, partial(app.tools.choose, tool))
    for way, key, modifier in (("Grow", "G", None), ("Shrink", "G", "shift"), ("Invert", "I", None)):
        bind(f"{way} the selection", key, partial(app.tools.change_selection, way), modifier)
    bind_work("Undo", "Z", lambda: app.step("Undo"), "cmd/ctrl")
    bind_work("Redo", "Z", lambda: app.step("Redo"), "cmd/ctrl+shift")
    bind_work("Clear the selection", "A", lambda: app.step("Clear"), "cmd/ctrl+shift")
    bind_work("Cut out", "T", app.cut_out)
    bind("Look at the selection", "F", lambda client: app.do("Looking", lambda: app.focus(client), client))
    bind("Look at all", "home", lambda client: app.do("Looking", lambda: app.focus(client, whole=True), client))
    for key, part in zip("123", controls.PARTS, strict=True):
        bind_work(f"Show: {part}", key, partial(app.show_part, part))
    bind_work("Before / after", "space", lambda: app.choose_next(panels.when))
    bind("Before / after, with a line to drag", "space", app.switch_wipe, "shift")
    bind_work("Colours", "V", lambda: app.choose_next(panels.colours))
    bind_work("Hide the object", "H", app.hide)
    bind_work("Show all objects", "U", lambda: app.change_objects("Show all"))

"""Keys of the app: those of SuperSplat where it has a habit."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from gaussian_trimmer.app.panels import BOX, BOX3D, BRUSH, CLICK, LOOK, PARTS

if TYPE_CHECKING:
    from gaussian_trimmer.app.controller import Controller

_STEP_OF_BRUSH = 1.25
_TOOLS = {"escape": LOOK, "C": CLICK, "R": BOX, "X": BOX3D, "B": BRUSH}


def bind_keys(gui: Any, controller: Controller) -> None:
    """Bind all keys; they are listed in the app's last tab, and in the list of commands that viser shows by Ctrl+K."""

    def bind(label: str, key: str, act: Callable[[Any], None], modifier: str | None = None) -> None:
        gui.add_command(label, hotkey=key, modifier=modifier).on_trigger(act)

    panels = controller.panels
    for key, tool in _TOOLS.items():
        bind(f"Tool: {tool}", key, partial(_choose, controller, tool))
    bind("Undo", "Z", lambda event: controller.step("Undo", event.client), "cmd/ctrl")
    bind("Redo", "Z", lambda event: controller.step("Redo", event.client), "cmd/ctrl+shift")
    bind("Select nothing", "A", lambda event: controller.step("Clear", event.client), "cmd/ctrl+shift")
    bind("Trim", "T", lambda event: controller.trim(event.client))
    bind("Look at the selection", "F", lambda event: controller.focus(event.client))
    bind("Larger brush", "pageup", lambda event: _grow_brush(panels.brush, _STEP_OF_BRUSH))
    bind("Smaller brush", "pagedown", lambda event: _grow_brush(panels.brush, 1 / _STEP_OF_BRUSH))
    for key, part in zip("123", PARTS, strict=True):
        bind(f"Show: {part}", key, partial(_show, controller, panels.part, part))
    bind("Before / after", "space", partial(_turn_around, controller))


def _choose(controller: Controller, tool: str, event: Any) -> None:
    controller.tools.choose(tool)


def _show(controller: Controller, control: Any, value: str, event: Any) -> None:
    control.value = value
    controller.show_again(event.client)


def _turn_around(controller: Controller, event: Any) -> None:
    when = controller.panels.when
    _show(controller, when, "Before" if when.value == "After" else "After", event)


def _grow_brush(brush: Any, factor: float) -> None:
    brush.value = min(max(brush.value * factor, brush.min), brush.max)

"""The keys: those of SuperSplat where it has a habit. Ctrl+K lists them, as the panel's last tab does."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

_PAGE_KEYS = (
    ("Shift, Ctrl, Ctrl+Shift", "add, remove, keep only, regardless of the mode in the panel"),
    ("Alt", "turn the view while a tool is chosen"),
    ("[ ]", "smaller, larger brush"),
    ("Enter, Esc", "leave a field; Esc also closes a question"),
)
"""What the page itself understands."""
_LEGEND = """
Changes are green where something was added, red where it was removed, blue where the outline was cut, yellow where
something is made up.
"""


@dataclass(frozen=True)
class Binding:
    """A key and what it does."""

    key: str
    label: str
    act: Callable[[Any], None]
    """Called with the tab in which the key was pressed."""
    modifier: str | None = None


def bind_keys(gui: Any, bindings: Iterable[Binding]) -> None:
    """Have the page listen to keys."""
    for binding in bindings:
        command = gui.add_command(binding.label, hotkey=binding.key, modifier=binding.modifier)
        command.on_trigger(lambda event, act=binding.act: act(event.client))


def help_text(bindings: Iterable[Binding]) -> str:
    """Return what all keys do, as Markdown."""
    rows = [(f"{binding.modifier or ''}+{binding.key}".lstrip("+"), binding.label) for binding in bindings]
    table = "".join(f"| {key.replace('cmd/ctrl', 'ctrl').title()} | {does} |\n" for key, does in (*rows, *_PAGE_KEYS))
    return f"| key | |\n|---|---|\n{table}{_LEGEND}"

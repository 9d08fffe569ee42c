"""What is done in the 3D view, as the page tells it: clicks, boxes, lassos and strokes of the brush."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gaussian_trimmer.app.showing import Comparison
from gaussian_trimmer.app.viewpoints import Place
from gaussian_trimmer.selecting.marks import Effect

_CHANNEL = "gesture:"
_SCRIPT = Path(__file__).with_name("page.js")
_EFFECTS: dict[str, Effect] = {"shift": "add", "ctrl": "remove", "both": "intersect"}
"""What keys that are held make of a mark."""
_MOST_CHARACTERS = 200_000
STILL_TAKEN, CANCEL, SMALLER, LARGER = "Still taken", "Cancel", "[", "]"
"""In place of a tool: the page has its picture; the job is to stop; the brush is to be smaller, or larger."""


@dataclass(frozen=True)
class Gesture:
    """What was done with a tool, or a key that only the page hears."""

    tool: str
    places: tuple[Place, ...]
    """A click's place, a box's corners, a polygon's corners, or the way of lasso or brush."""
    effect: Effect | None
    """What keys ask for; None: what the panel says."""


class GestureChannel:
    """The page's script, what it has to know and show, and the hidden field through which it answers."""

    def __init__(self, gui: Any, heard: Callable[[Gesture, Any], None]) -> None:
        """Call a function with each gesture, and the tab in which it was made."""
        # The script is run by an element that fails to load; viser has no other place for it.
        script = html.escape(_SCRIPT.read_text(encoding="utf-8"), quote=True)
        gui.add_html(f'<img src="data:," alt="" style="display:none" onerror="{script}">')
        self._state = gui.add_html("")
        gui.add_html("<style>div:has(> [data-channel]) + * {display: none}</style><span data-channel></span>")
        field = gui.add_text("", _CHANNEL)

        def answer(event: Any) -> None:
            gesture = parse_gesture(str(event.target.value))
            if gesture is not None and event.client is not None:
                heard(gesture, event.client)

        field.on_update(answer)
        self._tool, self._still, self._stills = "data-tool='Look' data-radius='0'", "", 0
        self._status = ""
        self._tell()

    def show(self, tool: str, radius: float) -> None:
        """Tell the page the tool, and the brush's radius in pixels."""
        self._tool = f"data-tool='{html.escape(tool)}' data-radius='{radius:g}'"
        self._tell()

    def show_status(self, text: str, share: float | None = None, *, wrong: bool = False) -> None:
        """Have the page show a sentence over the picture, with a bar and Cancel while something is going on.

        Args:
            text: the sentence; a path in single quotes can be copied.
            share: how far what is going on is, 0 to 1; None: nothing is.
            wrong: it says why something was not done.
        """
        progress = "" if share is None else f" data-share='{share:.2f}'"
        self._status = f" data-said='{html.escape(text)}'{progress}" + wrong * " data-wrong='yes'"
        self._tell()

    def compare(self, comparison: Comparison | None) -> None:
        """Have the page take a picture of what is shown and lay it over one side, or take it away again."""
        self._still = ""
        if comparison is not None:
            self._stills += 1
            side, sides = "left" if comparison.shown_left else "right", html.escape("|".join(comparison.names))
            self._still = f" data-still='{side}' data-number='{self._stills}' data-sides='{sides}'"
        self._tell()

    def _tell(self) -> None:
        self._state.content = f"<span {self._tool}{self._still}{self._status}></span>"


def parse_gesture(text: str) -> Gesture | None:
    """Return what the page has said; None if it is not understood."""
    if not text.startswith(_CHANNEL) or len(text) > _MOST_CHARACTERS:
        return None
    try:
        said = json.loads(text[len(_CHANNEL) :])
        places = tuple((float(x), float(y)) for x, y in said["places"])
        gesture = Gesture(str(said["tool"]), places, _EFFECTS.get(str(said["keys"])))
    except (ValueError, TypeError, KeyError):
        return None
    return gesture if all(math.isfinite(value) for place in places for value in place) else None

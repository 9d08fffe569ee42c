"""The page over the 3D view: what all tabs show, as one state that their script draws, and what they answer.

The script hears of the state by a hidden element, and answers by a hidden field. Controls and actions have names, by
which `surface.js` places them.
"""

from __future__ import annotations

import html
import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from gaussian_trimmer.app.viewpoints import Place
from gaussian_trimmer.selecting.marks import Effect

Act = Callable[[Any], None]
"""Called with the tab that asks for it."""
_CHANNEL = "gesture:"
_FOLDER = Path(__file__).parent
_MOST_CHARACTERS, _MOST_TYPED = 400_000, 4096


@dataclass(frozen=True)
class Gesture:
    """What was done with a tool in the 3D view."""

    tool: str
    places: tuple[Place, ...]
    """A click's place, a box's corners, a polygon's corners, or the way of lasso or brush."""
    effect: Effect | None
    """What keys ask for; None: what the panel says."""


@dataclass(frozen=True)
class Action:
    """What a button or a key of the page does."""

    name: str
    act: Act
    key: str = ""
    """As the page's script calls it, such as Ctrl+Shift+Z; several with ", " between."""
    end: Act | None = None
    """Called when the key is let go."""


class Control:
    """A text, switch, number or choice that all tabs show and can change."""

    def __init__(self, page: Page, name: str, value: Any, **facts: Any) -> None:
        """Put a control on the page; `facts` are its `options`, or the `limits` of a number."""
        self.facts, self._page, self._value = facts, page, value
        self.changed: Act = lambda client: None
        """Called with the tab in which the value was changed, or chosen again."""
        page.controls[name] = self

    @property
    def value(self) -> Any:
        """What is entered or chosen."""
        return self._value

    @value.setter
    def value(self, value: Any) -> None:
        if value != self._value:
            self._value = value
            self._page.tell()

    def choose_next(self, client: Any) -> None:
        """Take the next of the options."""
        options = self.facts["options"]
        self.enter(options[(options.index(self.value) + 1) % len(options)], client)

    def enter(self, value: object, client: Any) -> None:
        """Take what a tab has sent, if it can be a value of this control."""
        low, high = self.facts.get("limits", (-math.inf, math.inf))
        if isinstance(self._value, (int, float)) and not isinstance(self._value, bool):
            fits = isinstance(value, (int, float)) and low <= value <= high
        else:
            fits = type(value) is type(self._value) and value in self.facts.get("options", (value,))
        if fits and len(str(value)) <= _MOST_TYPED:
            self.value = value
            self.changed(client)


class Page:
    """What all tabs show beside the 3D view, and what they say."""

    def __init__(self, gui: Any) -> None:
        self.controls, self.actions = dict[str, Control](), dict[str, Action]()
        self.drawn: Callable[[Gesture, Any], None] = lambda gesture, client: None
        """Called with what was drawn, and in which tab."""
        self.changed_object: Callable[[int, str, Any, Any], None] = lambda number, what, value, client: None
        """Called with an object's number, what of it was changed to which value, and in which tab."""
        self._shown: dict[str, object] = {}
        self._heard = dict[int, float]()
        # The script is run by an element that fails to load; viser has no other place for it.
        style, *scripts = ((_FOLDER / name).read_text("utf-8") for name in ("page.css", "page.js", "surface.js"))
        script = html.escape("".join(scripts), quote=True)
        gui.add_html(f'<style>{style}</style><img src="data:," alt="" style="display:none" onerror="{script}">')
        self._state = gui.add_html("")
        gui.add_text("", _CHANNEL).on_update(lambda event: self._hear(str(event.target.value), event.client))

    def offer(self, actions: Iterable[Action]) -> None:
        """Let buttons and keys do actions."""
        self.actions |= {action.name: action for action in actions}
        self.tell()

    def show(self, **changes: object) -> None:
        """Show other values of what is no control."""
        self._shown |= changes
        self.tell()

    def tell(self) -> None:
        """Tell the page how everything is."""
        state = self._shown | {
            "controls": {name: {"value": each.value, **each.facts} for name, each in self.controls.items()},
            "keys": {name: [each.key, each.end is not None] for name, each in self.actions.items() if each.key},
        }
        self._state.content = f"<span data-gaussian-trimmer='{html.escape(json.dumps(state))}'></span>"

    def _hear(self, text: str, client: Any) -> None:
        """Do what a tab says; what it has said before is in the field again, since not every text arrives."""
        if client is None:
            return
        for said in parse(text):
            if said["number"] <= self._heard.get(client.client_id, 0):
                continue
            self._heard[client.client_id] = said["number"]
            if (gesture := parse_gesture(said)) is not None:
                self.drawn(gesture, client)
            elif (control := self.controls.get(str(said.get("set")))) is not None:
                control.enter(said.get("to"), client)
            elif (action := self.actions.get(str(said.get("do")))) is not None:
                (action.end if said.get("ends") and action.end else action.act)(client)
            elif isinstance(said.get("object"), int):
                self.changed_object(said["object"], str(said.get("what")), said.get("to"), client)


def parse(text: str) -> Sequence[dict[str, Any]]:
    """Return what a tab has said lately, with numbers; nothing if it is not understood."""
    if not text.startswith(_CHANNEL) or len(text) > _MOST_CHARACTERS:
        return ()
    try:
        return [said for said in json.loads(text[len(_CHANNEL) :]) if isinstance(said["number"], (int, float))]
    except (ValueError, TypeError, KeyError, RecursionError):
        return ()


def parse_gesture(said: dict[str, Any]) -> Gesture | None:
    """Return the gesture that was made; None if there is none."""
    try:
        places = tuple((float(x), float(y)) for x, y in said["places"])
        effect = said["effect"] if said["effect"] in get_args(Effect) else None
        gesture = Gesture(str(said["tool"]), places, effect)
    except (ValueError, TypeError, KeyError):
        return None
    return gesture if all(math.isfinite(value) for place in places for value in place) else None

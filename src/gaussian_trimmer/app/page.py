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

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.app.edits import describe_up
from gaussian_trimmer.app.snapshots import Colour, Snapshot, TrimChoices
from gaussian_trimmer.app.viewpoints import COLOURINGS, PARTS, WHENS, Place, Showing
from gaussian_trimmer.app.words import in_app
from gaussian_trimmer.cameras import Point, point_of
from gaussian_trimmer.io.writing import safe_file_name
from gaussian_trimmer.output.engines import ENGINES, EngineName
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


TOOLS = ("Look", "Click", "Box", "Lasso", "Polygon", "Brush", "Sphere", "3D box")
LOOK, CLICK, BOX, LASSO, POLYGON, BRUSH, SPHERE, BOX3D = TOOLS
POINTS = "Up by 3 points"
ADD, REMOVE, KEEP_ONLY, ANEW = "Add", "Remove", "Keep only", "Replace"
EFFECTS: dict[str, Effect] = {ADD: "add", REMOVE: "remove", KEEP_ONLY: "intersect", ANEW: "add"}
BACKDROPS: dict[str, Colour | None] = {
    "Black": (0, 0, 0),
    "Grey": (119, 119, 119),
    "White": (255, 255, 255),
    "Checker": None,
}
SURFACE, THROUGH = "Surface", "Through"
FOOTPRINT, CENTRES = "Footprint", "Centres"
UPS: dict[str, Point | None] = {"Automatic": None} | {
    f"{sign}{name}": point_of(factor * axis)
    for name, axis in zip("XYZ", np.eye(3), strict=True)
    for sign, factor in (("+", 1.0), ("-", -1.0))
}
_TRIM_OPTIONS = {
    "recover": "Take in what is attached",
    "fit": "Fit the outline",
    "clean": "Clean the background",
    "fill": "Continue the surface",
}
"""Names of the settings in `TrimChoices`."""
AS_SCENE, AS_IT_LIES = "as the scene", "as it lies in the scene"
KEEP, REPLACE = "Keep", "Replace"
HINTS = {
    LOOK: "Drag to turn, right-drag to move, wheel to zoom.",
    CLICK: "Click on the object. Ctrl-click removes. A click on a mistake moves the boundary.",
    BOX: "Drag a box around the object, or around a part of it to correct. Ctrl removes, Alt turns the view.",
    LASSO: "Draw around what is meant. Ctrl removes, Alt turns the view.",
    POLYGON: "Click corners, then on the first one or Enter. Ctrl removes, Alt turns the view.",
    BRUSH: "Paint. Ctrl removes, [ and ] change the size, Alt turns the view.",
    SPHERE: "Paint; all within the ring's radius of the surface is taken. Ctrl removes, [ and ] change it.",
    BOX3D: "Drag the box's faces by their arrows, and the box by the squares in it; then apply it.",
    POINTS: "Click three points on the ground.",
}
WELCOME = "Cut one object out of a splat scene."
PROGRAM_ENDED = (
    "The program has ended. Nothing on this page works any more. Start 'gaussian-trimmer view' again: what you have "
    "marked is kept, and is back when you open the scene."
)


class Panels:
    """All controls, made once and shared by all tabs."""

    def __init__(self, page: Page, path: str, camera_path: str) -> None:
        self.status_text = WELCOME
        """The sentence over the picture while nothing is going on."""
        self._page, self._offered = page, ""

        def choice(name: str, options: tuple[str, ...]) -> Control:
            return Control(page, name, options[0], options=options)

        self.tool = choice("Tool", (*TOOLS, POINTS))
        self.effect, self.reach = choice("Mode", tuple(EFFECTS)), choice("Reach", (SURFACE, THROUGH))
        self.taking = choice("Take by", (FOOTPRINT, CENTRES))
        self.brush = Control(page, "Brush radius", 24, limits=(3, 200))
        self.tolerance = Control(page, "Tolerance", 0, limits=(0, 100))
        self.ghost = False
        """Whether the rest is seen through while the object is shown."""
        self.part, self.when = choice("Show", PARTS), choice("Trim", WHENS)
        self.colours, self.backdrop = choice("Colours", COLOURINGS), choice("Backdrop", tuple(BACKDROPS))
        self.showing = Showing()
        self.path, self.camera_path = Control(page, "Scene", path), Control(page, "Cameras", camera_path)
        self.selection_path, self.up = Control(page, "Selection", ""), choice("Up is", tuple(UPS))
        self._trim = {option: Control(page, name, True) for option, name in _TRIM_OPTIONS.items()}
        self.views = Control(page, "Virtual cameras", False)
        self.format = choice("Format", (AS_SCENE, *(name.lstrip(".") for name in formats.FORMATS)))
        self.program = choice("For", (AS_IT_LIES, *(each.name for each in ENGINES.values() if each.reads)))
        self.folder, self.existing = Control(page, "Folder", ""), choice("Earlier results", (KEEP, REPLACE))
        self.command = Control(page, "The same by command", "")

    @property
    def choices(self) -> TrimChoices:
        """The settings of the next trim."""
        return TrimChoices(**{option: control.value for option, control in self._trim.items()})

    @property
    def ending(self) -> str | None:
        """The format of splat files; None: that of the scene."""
        return None if self.format.value == AS_SCENE else self.format.value

    @property
    def engine(self) -> EngineName | None:
        """The program for which objects are put upright at the origin; None: they stay where they are."""
        return next((name for name, each in ENGINES.items() if each.name == self.program.value), None)

    @property
    def showing(self) -> Showing:
        """What is to be seen in the 3D view."""
        part = self.part.value
        return Showing(part, self.when.value, self.colours.value, self.ghost and part == "Object")

    @showing.setter
    def showing(self, showing: Showing) -> None:
        self.part.value, self.when.value, self.colours.value = showing.part, showing.when, showing.colours

    def start_afresh(self) -> None:
        """Forget what was chosen and entered for the scene before."""
        self.tool.value, self.effect.value, self.reach.value, self.existing.value = LOOK, ADD, SURFACE, KEEP
        self.taking.value, self.tolerance.value = FOOTPRINT, 0
        self.folder.value = self.selection_path.value = self.command.value = ""

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Show a sentence over the picture, now that nothing is going on; a path in single quotes can be copied."""
        self.status_text = text = in_app(text)
        self._page.show(said=text, wrong=wrong, share=None)

    def busy(self, doing: str, share: float) -> None:
        """Show what is being done, and how far it is, 0 to 1."""
        self._page.show(said=f"{doing} ...", wrong=False, share=share)

    def refresh(self, now: Snapshot, idle: list[str]) -> None:
        """Show the objects and names of a state, and what can do nothing in it."""
        part = now.object
        objects = [
            {"id": each.id, "name": each.name, "colour": each.colour, "hidden": each.hidden, "locked": each.locked,
             "selected": each.n_selected, "cut": len(each.fresh.object) if each.fresh else 0, "active": each is part}
            for each in now.objects
        ]  # fmt: skip
        stem = now.document.path.name.split(".")[0]
        offered = str(Path("trimmed") / (stem if len(now.objects) == 1 else f"{stem}-{safe_file_name(part.name)}"))
        if self.folder.value in ("", self._offered):  # otherwise somebody has chosen another one
            self.folder.value = offered
        self._offered = offered
        self._page.show(scene=now.document.path.name, objects=objects, up=describe_up(now.up), idle=idle)

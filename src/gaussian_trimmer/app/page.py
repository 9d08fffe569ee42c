"""The page: what all tabs show, as one state that they are told changes of, and the messages by which they answer.

Controls and actions have names, by which `panel.js` places them.
"""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from threading import Lock
from typing import Annotated, Any, Protocol

from gaussian_trimmer.app.snapshots import Similarity
from gaussian_trimmer.app.viewpoints import Place, View
from gaussian_trimmer.cameras import Point
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selecting.marks import Effect
from gaussian_trimmer.settings import Range, from_plain

_MOST_BYTES, _MOST_TYPED, _MOST_ROWS = 4_000_000, 4096, 1 << 30
"""Bytes of a message, characters of a text that is entered, and bits of rows."""


class Tab(Protocol):
    """A tab that shows the page."""

    view: View | None
    """Where it looks from; None until it has said so."""

    def send(self, message: dict[str, Any] | bytes) -> None:
        """Tell it something; any thread may."""

    def send_file(self, name: str, data: bytes) -> None:
        """Have it download a file."""


Act = Callable[[Any], None]
"""Called with the tab that asks for it."""


@dataclass(frozen=True)
class Gesture:
    """What was done with a tool in the 3D view."""

    tool: str
    places: tuple[Place, ...]
    """A click's place, a box's corners, a polygon's corners, or the way of lasso or brush."""
    effect: Effect | None = None
    """What keys ask for; None: what the panel says."""
    ghost: bool = False
    """Whether the rest was seen through."""
    rows: bytes | None = None
    """What it means, if the page has found that: a bit for each Gaussian, in the page's order."""


@dataclass(frozen=True)
class Do:
    """A button or a key was pressed."""

    action: str


@dataclass(frozen=True)
class Enter:
    """A control was set."""

    control: str
    value: Any


@dataclass(frozen=True)
class Alter:
    """Something of an object was changed."""

    object: Annotated[int, Range(0, 1 << 31)]
    what: str
    value: Any


@dataclass(frozen=True)
class Drag:
    """The box in space was dragged: its lowest and its highest corner, in the viewer's coordinates with z up."""

    low: Point
    high: Point


@dataclass(frozen=True)
class Move:
    """An object was moved, turned or scaled, in the viewer's coordinates."""

    object: Annotated[int, Range(0, 1 << 31)]
    by: Similarity


MESSAGES: dict[str, type[Any]] = {
    "gesture": Gesture,
    "do": Do,
    "enter": Enter,
    "alter": Alter,
    "drag": Drag,
    "move": Move,
    "view": View,
}
"""What a tab can say, by the names that messages have; each may have the `view` of the tab beside it."""


@dataclass(frozen=True)
class Action:
    """What a button or a key of the page does."""

    name: str
    act: Act | None
    """None: the page does it by itself."""
    key: str = ""
    """As the page's script calls it, such as Ctrl+Shift+Z; several with ", " between."""


class Control:
    """A text, switch, number or choice that all tabs show and can change."""

    def __init__(self, page: Page, name: str, value: Any, **facts: Any) -> None:
        """Put a control on the page; `facts` are its `options`, or the `limits` of a number."""
        self.facts, self._page, self._value, self._name = facts, page, value, name
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

    def __init__(self) -> None:
        self.controls, self.actions = dict[str, Control](), dict[str, Action]()
        self.tabs: list[Tab] = []
        self.drawn: Callable[[Gesture, Any], None] = lambda gesture, client: None
        """Called with what was drawn, and in which tab."""
        self.changed_object: Callable[[int, str, Any, Any], None] = lambda number, what, value, client: None
        """Called with an object's number, what of it was changed to which value, and in which tab."""
        self.dragged_box: Callable[[Drag], None] = lambda drag: None
        """Called with where the box in space is."""
        self.moved: Callable[[Move], None] = lambda move: None
        """Called with where an object is to lie."""
        self.came: Callable[[Tab], None] = lambda tab: None
        """Called with a tab that is new."""
        self._shown: dict[str, Any] = {}
        self._told: dict[str, str] = {}
        self._lock = Lock()

    def offer(self, actions: Iterable[Action]) -> None:
        """Let buttons and keys do actions."""
        self.actions |= {action.name: action for action in actions}
        self.show(keys={name: each.key for name, each in self.actions.items() if each.key})

    def show(self, **changes: Any) -> None:
        """Show other values of what is no control."""
        self._shown |= changes
        self.tell()

    def tell(self) -> None:
        """Tell all tabs what has changed."""
        with self._lock:
            state = self._state()
            changed = {name: text for name, text in state.items() if self._told.get(name) != text}
            self._told = state
            if changed:
                message = {"state": {name: json.loads(text) for name, text in changed.items()}}
                for tab in self.tabs:
                    tab.send(message)

    def welcome(self, tab: Tab) -> None:
        """Tell a new tab everything, and all tabs what changes from now on."""
        with self._lock:
            self.tabs = [*self.tabs, tab]
            tab.send({"state": {name: json.loads(text) for name, text in self._told.items()}})
        self.came(tab)

    def forget(self, tab: Tab) -> None:
        """Tell a tab nothing any more."""
        with self._lock:
            self.tabs = [each for each in self.tabs if each is not tab]

    def _state(self) -> dict[str, str]:
        """Return everything as JSON, by names; those of controls begin with "="."""
        state = {f"={name}": {"value": each.value, **each.facts} for name, each in self.controls.items()}
        return {name: json.dumps(value) for name, value in (self._shown | state).items()}

    def hear(self, text: str | bytes, tab: Tab) -> None:
        """Do what a tab says, if it is understood."""
        try:
            said, view = parse(text)
        except InputError:
            return
        if view is not None:
            tab.view = view
        match said:
            case Gesture():
                self.drawn(said, tab)
            case Enter() if (control := self.controls.get(said.control)) is not None:
                control.enter(said.value, tab)
            case Do() if (action := self.actions.get(said.action)) is not None and action.act is not None:
                action.act(tab)
            case Alter():
                self.changed_object(said.object, said.what, said.value, tab)
            case Drag():
                self.dragged_box(said)
            case Move():
                self.moved(said)


def parse(text: str | bytes) -> tuple[Any, View | None]:
    """Return a message, and the view of the tab that sent it if it says that.

    Bytes are JSON in UTF-8, a zero, and rows as compressed bits.

    Raises:
        InputError: it cannot be understood.
    """
    rows = None
    if isinstance(text, bytes):
        text, _, packed = text.partition(b"\0")
        unpacked = zlib.decompressobj()
        try:
            rows = unpacked.decompress(packed, _MOST_ROWS // 8) if packed else None
        except zlib.error as error:
            raise InputError("The rows of a message cannot be read.") from error
        if packed and not unpacked.eof:
            raise InputError("The rows of a message are not whole.")
    if len(text) > _MOST_BYTES:
        raise InputError("A message is too long.")
    try:
        raw = json.loads(text)
        kind, view = raw.pop("is"), raw.pop("view", None)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise InputError("A message is no JSON object.") from error
    if not isinstance(kind, str) or kind not in MESSAGES:
        raise InputError("A message is of no kind that is known.")
    said = from_plain(raw | ({} if rows is None else {"rows": rows}), MESSAGES[kind], kind)
    return said, from_plain(view, View | None, "view")

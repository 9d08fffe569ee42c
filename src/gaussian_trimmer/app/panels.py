"""The controls that all tabs share, and what the app says. `panel.js` places controls by their names."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.app.edits import describe_up
from gaussian_trimmer.app.page import Control, Page
from gaussian_trimmer.app.snapshots import Snapshot, TrimChoices
from gaussian_trimmer.app.viewpoints import COLOURINGS, PARTS, WHENS, Showing
from gaussian_trimmer.app.words import in_app
from gaussian_trimmer.cameras import Point, point_of
from gaussian_trimmer.io.writing import safe_file_name
from gaussian_trimmer.output.engines import ENGINES, EngineName
from gaussian_trimmer.selecting.marks import Effect

TOOLS = ("Look", "Click", "Colour", "Box", "Lasso", "Polygon", "Brush", "Sphere", "3D box")
LOOK, CLICK, COLOUR, BOX, LASSO, POLYGON, BRUSH, SPHERE, BOX3D = TOOLS
MOVE, TURN, SCALE = PLACING = ("Move", "Rotate", "Scale")
"""Tools with which objects are seen where files have them."""
POINTS = "Up by 3 points"
ADD, REMOVE, KEEP_ONLY, ANEW = "Add", "Remove", "Keep only", "Replace"
EFFECTS: dict[str, Effect] = {ADD: "add", REMOVE: "remove", KEEP_ONLY: "intersect", ANEW: "add"}
BACKDROPS = ("Black", "Grey", "White", "Checker")
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
    "with_standing": "Take along what stands on it",
}
"""Names of the settings in `TrimChoices`."""
AS_SCENE, AS_IT_LIES = "as the scene", "as it lies in the scene"
KEEP, REPLACE = "Keep", "Replace"
HINTS = {
    LOOK: "Drag to turn, right-drag to move, wheel to zoom.",
    CLICK: "Click on the object. Ctrl-click removes. A click on a mistake moves the boundary.",
    COLOUR: "Click on a colour; all that is shown in it is taken. 'Tolerance' says how like it. Ctrl removes.",
    BOX: "Drag a box around the object, or around a part of it to correct. Ctrl removes, Alt turns the view.",
    LASSO: "Draw around what is meant. Ctrl removes, Alt turns the view.",
    POLYGON: "Click corners, then on the first one or Enter. Ctrl removes, Alt turns the view.",
    BRUSH: "Paint. Ctrl removes, [ and ] change the size, Alt turns the view.",
    SPHERE: "Paint; all within the ring's radius of the surface is taken. Ctrl removes, [ and ] change it.",
    BOX3D: "Drag the box's faces by their dots, and the box by its square; then apply it.",
    MOVE: "Drag an arrow, or the square; or use the arrow keys. Files have the object there.",
    TURN: "Drag a ring; or use the arrow keys.",
    SCALE: "Drag the dot; or use the arrow keys.",
    POINTS: "Click three points on the ground.",
}
WELCOME = "Cut one object out of a splat scene."
PROGRAM_ENDED = (
    "The program has ended. Start 'gaussian-trimmer view' again, and this page comes back; your marks are kept."
)


class Panels:
    """All controls, made once and shared by all tabs."""

    def __init__(self, page: Page, path: str, camera_path: str) -> None:
        self.status_text = WELCOME
        """The sentence over the picture while nothing is going on."""
        self._page, self._offered, self._stem, self.is_busy = page, "", "", False

        def choice(name: str, options: tuple[str, ...]) -> Control:
            return Control(page, name, options[0], options=options)

        self.tool = choice("Tool", (*TOOLS, *PLACING, POINTS))
        self.effect = Control(page, "Mode", ADD, options=tuple(EFFECTS), effects=EFFECTS)
        self.reach = choice("Reach", (SURFACE, THROUGH))
        self.taking = choice("Take by", (FOOTPRINT, CENTRES))
        self.brush = Control(page, "Brush radius", 24, limits=(3, 200))
        self.tolerance = Control(page, "Tolerance", 0, limits=(0, 100))
        self.ghost = False
        """Whether the rest is seen through while the object is shown."""
        self.part, self.when = choice("Show", PARTS), choice("Trim", WHENS)
        self.colours, self.backdrop = choice("Colours", COLOURINGS), choice("Backdrop", BACKDROPS)
        self.showing = Showing()
        self.path, self.camera_path = Control(page, "Scene", path), Control(page, "Cameras", camera_path)
        self.selection_path, self.up = Control(page, "Selection", ""), choice("Up is", tuple(UPS))
        usual = asdict(TrimChoices())
        self._trim = {option: Control(page, name, usual[option]) for option, name in _TRIM_OPTIONS.items()}
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

    def say(self, text: str, *, wrong: bool = False, quietly: bool = False) -> None:
        """Show a sentence over the picture, now that nothing is going on; a path in single quotes can be copied.

        With `quietly`, it does not take the place of what is going on.
        """
        self.status_text = text = in_app(text)
        if not (quietly and self.is_busy):
            self._page.show(said=text, wrong=wrong, share=None)
            self.is_busy = False

    def busy(self, doing: str, share: float) -> None:
        """Show what is being done, and how far it is, 0 to 1."""
        self.is_busy = True
        self._page.show(said=f"{doing} ...", wrong=False, share=share)

    def folder_for(self, together: bool) -> str:
        """Where to save the active object, or all; what is offered for one is not meant for all."""
        chosen = str(self.folder.value)
        return self._stem if together and chosen == self._offered else chosen

    def refresh(self, now: Snapshot, idle: list[str]) -> None:
        """Show the objects and names of a state, and what can do nothing in it."""
        part = now.object
        objects = [
            {"id": each.id, "name": each.name, "colour": each.colour, "hidden": each.hidden, "locked": each.locked,
             "selected": each.n_selected, "cut": len(each.fresh.object) if each.fresh else 0, "active": each is part,
             "result": each.result is not None, "together": each.together}
            for each in now.objects
        ]  # fmt: skip
        self._stem = str(Path("trimmed") / now.document.path.name.split(".")[0])
        offered = self._stem if len(now.objects) == 1 else f"{self._stem}-{safe_file_name(part.name)}"
        if self.folder.value in ("", self._offered):  # otherwise somebody has chosen another one
            self.folder.value = offered
        self._offered = offered
        shown = {"scene": now.document.path.name, "objects": objects, "up": describe_up(now.up), "idle": idle}
        self._page.show(**shown, folder=self.folder_for(together=True))
